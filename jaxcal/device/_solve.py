"""The estimator: rounds of Gauss-Newton fits of the parameters and the trajectory of the device (host)."""

import dataclasses
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from ._model import NAMES, field_of, model_of
from ._noise_floor import Floor
from ._normal import Inertial, chain_of, inertial, rows, whitened
from ._start import Start
from ._state import SIZES, Noise, Place, Point, Rests, Solution, Way, hand_prior, with_prior
from ._windows import GYRO_DELAY, MAG_DELAY, REACH, Record

#: rounds of fits: at least, at most, and at most where the motion does not determine all parameters; most steps of a fit, and of one
#: where the motion does not determine all parameters
_ROUNDS, _MOST, _BLIND, _STEPS, _FEW = 3, 8, 5, 25, 10
#: the last fit has converged when a step is expected to lower the cost (half the sum of squares) by less; the rounds end when weights,
#: and logarithms of noise levels, change by less, and fits before the last stop there, too
_SETTLED, _SAME = 1e-5, 0.05
#: noise of a reading of the field, as a part of it, in the first fit. Rms field residual of a window in standard deviations: above the
#: second number it gets less weight, above the third that of the fourth, which is not zero, so that its residuals are still computed
_FIELD_NOISE, _FAR, _GONE, _LITTLE = 0.01, 1.5, 4.0, 1e-2
#: lengths of sums in windows; number of those whose power always counts, because many sums determine it, and one length is too few: noise
#: may be correlated within a window; standard deviations by which the power of longer sums must be larger to count; fewest windows at rest,
#: or in motion, whose residuals show a noise level
LENGTHS, _SHORT, _MARGIN, ENOUGH = (1, 2, 4, 8, 16, 32, 64), 3, 2.5, 10


def rounds(record: Record, start: Start, free: np.ndarray, floors: tuple[Floor, Floor]) -> tuple[Solution, Place]:
    """Fit repeatedly. Between fits, update the noise levels, the weights of disturbed windows, and the reach and speed of the hand."""
    (gyro, accel), centre, settled = floors, start.vector.copy(), False
    place, rests = Place(0.3, 0.4), start.rests
    # in motion the hand hides the noise of the accelerometer from the fit
    level = Noise(gyro.fast, np.where(rests.windows, accel.fast, accel.slow), _FIELD_NOISE)
    white, levels, counts = level, Levels(), np.ones(len(record.broken))
    # two steps show which parameters the motion does not determine. In their directions the cost is flat, so more steps are useless
    found: Any = start
    steps, fewest, moved, blind = 2, _BLIND, None, False
    for turn in range(-1, _MOST):
        last = (settled and turn >= _ROUNDS - 1) or turn == _MOST - 1
        near = _SETTLED if last or blind else _SAME  # weights and levels that still change move the solution further
        try:
            found = solved(record, found.vector, found.way, free, level, place, counts, steps, rests, centre, near, moved)
        except np.linalg.LinAlgError as error:
            raise DataError("the sensors show no common motion. Check the range and the unit of each", code="no_motion") from error
        blind, moved = bool(found.unseen.any()), found.moved
        steps = _FEW if blind else _STEPS
        if turn < 0:
            fewest = 2 if blind else fewest
            continue
        if last or (blind and near == _SETTLED and turn >= fewest - 1):
            break
        # rms field residual of each window; the median over windows ignores the few that may be disturbed
        number = found.kept.sum(axis=1)
        some, size = number > 0, found.noise.mag * np.sqrt(found.field_power)
        white = Noise(white.gyro, white.accel, float(np.sqrt(np.median(size[some] ** 2) / _median(3 * float(np.median(number[some]))))))
        level, change = levels.next(found, white)
        far = size / white.mag
        new = np.where(far > _GONE, _LITTLE, np.minimum(1.0, _FAR / np.maximum(far, 1e-9)))
        settled = bool(np.max(np.abs(new - counts)) < _SAME and change < _SAME)
        counts = new
        place, rests = found.hand(record.time, level)
    return found, place


def _median(freedom: float) -> float:
    """Median of a chi-square variable, divided by its degrees of freedom."""
    return float(scipy.special.chdtri(freedom, 0.5) / freedom)


def solved(
    record: Record, vector: np.ndarray, way: Way, free: np.ndarray, noise: Noise, place: Place, counts: np.ndarray, steps: int,
    rests: Rests, centre: np.ndarray, near: float, moved: Inertial | None = None,
) -> Solution:  # fmt: skip
    """Least squares from a start. `counts` (K,) are weights of the magnetometer's residuals, `centre` is the centre of the prior.

    The fit has converged when a step is expected to lower the cost, half the sum of squares, by less than `near`. `moved` are the
    integrals at the start, if they are known.
    """
    wanted = {field_of(NAMES[i]) for i in free}
    options = {"sensitivity": "gyro.g_sensitivity" in wanted, "lever": "lever" in wanted}
    sizes, damping = SIZES[free], 0.0

    def at(vector: np.ndarray, way: Way, back: int | None = None, moved: Inertial | None = None) -> Point:
        back = record.back(vector, back)
        w, model = record.windows(vector, back), model_of(vector)
        moved = inertial(model, w, **options) if moved is None else moved
        whiten = whitened(moved, noise.gyro, noise.accel, record.time, record.broken)
        weight = counts[:, None] * record.kept(back) / np.reshape(noise.mag, (-1, 1))
        made = rows((way.rotation, way.velocity, way.place), w, moved, model, whiten, weight, record.gravity, record.earth)
        prior = hand_prior(way, place, rests, record.time)
        squares = [made.inertial, made.field, (vector - centre)[free] / sizes, *(tie.residual for tie in prior)]
        return Point(vector, way, back, moved, made, prior, 0.5 * sum(float(np.sum(part**2)) for part in squares))

    def equations(now: Point) -> Any:
        chain, off = with_prior(chain_of(now.rows, free), now.prior), (now.vector - centre)[free] / sizes**2
        return dataclasses.replace(chain, corner=chain.corner + np.diag(sizes**-2.0), score=chain.score + off)

    now, done = at(vector, way, moved=moved), False
    known = (chain := equations(now)).eliminated()
    for _ in range(steps):
        while True:
            move = -np.linalg.solve(known.information + damping * np.diag(sizes**-2.0), known.score)
            promised = -0.5 * float(move @ known.score) - 0.5 * float(np.sum(chain.link_score * known.links(np.zeros(len(free)))))
            # the rest of the way is far shorter than the errors
            if done := abs(promised) < near:
                break
            trial = now.vector.copy()
            trial[free] += move
            trial[[GYRO_DELAY, MAG_DELAY]] = np.clip(trial[[GYRO_DELAY, MAG_DELAY]], -REACH, REACH)
            found = at(trial, now.way.moved(known.links(move)), now.back)
            if found.cost <= now.cost * (1 + 1e-9) + 1e-6 or damping > 1e12:
                now = found
                break
            damping = max(10 * damping, 1.0)
        if done:
            break
        damping = damping / 10 if damping > 1 else 0.0
        known = (chain := equations(now)).eliminated()
    return Solution(**vars(now), chain=chain, eliminated=known, converged=done, free=free, counts=counts,
                    kept=record.kept(now.back), noise=noise, rests=rests)  # fmt: skip


class Levels:
    """Noise levels that explain the size of the residuals, at least those of the white noise.

    Sensors have errors beside white noise: from their filters, from nonlinearity, from biases that wander, and from iron in the room.
    The fit treats all of them as noise, with the size that they have over the times over which it compares the sensors. Rest and motion
    have separate levels.
    """

    def __init__(self) -> None:
        #: (sensor, rest or motion) -> logarithm of the level before, and the change that its residuals asked for
        self._before: dict[tuple[str, int], tuple[float, float]] = {}

    def next(self, found: Solution, white: Noise) -> tuple[Noise, float]:
        """The levels for the next fit, and the largest change, of a logarithm, that the residuals ask for."""
        resting = found.rests.windows
        levels, most, count = {}, 0.0, len(resting)
        for name, (seen, drawn) in found.residuals.items():
            now, least = (np.array(np.broadcast_to(getattr(noise, name), count), dtype=float) for noise in (found.noise, white))
            for part, which in enumerate((resting, ~resting)):
                if which.sum() >= ENOUGH:
                    at, least_at = np.log(now[which][0]), np.log(least[which][0])
                    excess, sure = _excess(seen, drawn, which, found.way.rotation[:-1])
                    if at <= least_at and not sure:  # white noise explains the residuals, so an estimate would only add scatter
                        excess = 1.0
                    asked = max(0.5 * np.log(excess), least_at - at)
                    now[which] = np.exp(max(at + self._pace((name, part), at, asked) * asked, least_at))
                    most = max(most, abs(asked))
            levels[name] = now
        return Noise(**levels), most

    def _pace(self, key: tuple[str, int], at: float, asked: float) -> float:
        """Factor up to 1 on the asked change, from the secant: levels of two sensors that explain the same residuals would oscillate."""
        before, self._before[key] = self._before.get(key), (at, asked)
        if before is None or before[0] == at or (slope := (asked - before[1]) / (at - before[0])) >= 0:
            return 1.0
        return min(-1 / slope, 1.0)


def _excess(seen: np.ndarray, left: np.ndarray, which: np.ndarray, turn: np.ndarray) -> tuple[float, bool]:
    """Power of the residuals over that of noise with the present level, and whether it is clearly larger.

    The power is that of sums over a few windows in a row, or over many if that is clearly larger.
    """
    own, drawn = _powers(seen, which, turn), _powers(left, which, turn)
    mean, spread = drawn.mean(axis=-1), drawn.std(axis=-1)
    degrees = 2 * (mean / spread) ** 2
    ratio = (own / mean * degrees + 1) / (degrees + 1)  # with a prior of 1 that weighs one degree of freedom
    short, margin = np.max(ratio[0, :_SHORT]), np.exp(_MARGIN * spread / mean)
    # a variance from few degrees of freedom may be too small by chance: use that of Student's t
    many = np.max(np.where(ratio > short * margin, ratio * (1 + 2 / degrees), 0.0))
    return float(max(short, many)), bool(np.any(ratio > margin))


def _powers(values: np.ndarray, which: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(2, lengths, ...) mean squares of sums over consecutive windows: in the axes of the device, then in those of the world."""
    values = values * which.reshape(-1, *np.ones(values.ndim - 1, dtype=int))
    out = []
    for own in (values, np.einsum("kab,kb...->ka...", turn, values)):
        total = np.concatenate([np.zeros((1, *own.shape[1:])), np.cumsum(own, axis=0)])
        out.append([np.mean((total[n:] - total[:-n]) ** 2, axis=(0, 1)) for n in LENGTHS])
    return np.array(out)
