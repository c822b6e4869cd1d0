"""The estimator: rounds of Gauss-Newton fits of the parameters and the trajectory of the device (host)."""

import dataclasses
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from ._levels import Levels
from ._model import NAMES, field_of, model_of
from ._noise_floor import Floor
from ._normal import chain_of, inertial, rows, whitened
from ._start import Start
from ._state import SIZES, Noise, Place, Point, Rests, Solution, Way, hand_prior, with_prior
from ._windows import GYRO_DELAY, MAG_DELAY, REACH, Record

#: rounds of fits: at least, at most, and at most where the motion does not determine all parameters; most steps of a fit, and of one
#: where the motion does not determine all parameters
_ROUNDS, _MOST, _BLIND, _STEPS, _FEW = 3, 8, 5, 25, 10
#: a fit has converged when a step is expected to lower the cost (half the sum of squares) by less; the rounds end when weights, and
#: logarithms of noise levels, change by less
_SETTLED, _SAME = 1e-4, 0.05
#: noise of a reading of the field, as a part of it, in the first fit. Rms field residual of a window in standard deviations: above the
#: second number it gets less weight, above the third that of the fourth, which is not zero, so that its residuals are still computed
_FIELD_NOISE, _FAR, _GONE, _LITTLE = 0.01, 1.5, 4.0, 1e-2


def rounds(record: Record, start: Start, free: np.ndarray, floors: tuple[Floor, Floor]) -> tuple[Solution, Place]:
    """Fit repeatedly. Between fits, update the noise levels, the weights of disturbed windows, and the reach and speed of the hand."""
    (gyro, accel), centre, settled = floors, start.vector.copy(), False
    place, rests = Place(0.3, 0.4), start.rests
    # in motion the hand hides the noise of the accelerometer from the fit
    level = Noise(gyro.fast, np.where(rests.windows, accel.fast, accel.slow), _FIELD_NOISE)
    white, levels, counts = level, Levels(), np.ones(len(record.broken))
    # two steps show which parameters the motion does not determine. In their directions the cost is flat, so more steps are useless
    found: Any = start
    steps, fewest = 2, _BLIND
    for turn in range(-1, _MOST):
        found = solved(record, found.vector, found.way, free, level, place, counts, steps, rests, centre)
        blind = bool(found.unseen.any())
        steps = _FEW if blind else _STEPS
        if turn < 0:
            fewest = 2 if blind else fewest
            continue
        if (settled and turn >= _ROUNDS - 1) or (blind and turn >= fewest - 1) or turn == _MOST - 1:
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
    rests: Rests, centre: np.ndarray,
) -> Solution:  # fmt: skip
    """Least squares from a start. `counts` (K,) are weights of the magnetometer's residuals, `centre` is the centre of the prior."""
    wanted = {field_of(NAMES[i]) for i in free}
    options = {"sensitivity": "gyro.g_sensitivity" in wanted, "lever": "lever" in wanted}
    sizes, damping = SIZES[free], 0.0

    def at(vector: np.ndarray, way: Way, back: int) -> Point:
        w, model = record.windows(vector, back), model_of(vector)
        moved = inertial(model, w, **options)
        whiten = whitened(moved, noise.gyro, noise.accel, record.time, record.broken)
        weight = counts[:, None] * record.kept(back) / np.reshape(noise.mag, (-1, 1))
        made = rows(way.states, w, moved, model, whiten, weight, record.gravity, record.earth)
        prior = hand_prior(way, place, rests, record.time)
        squares = [made.inertial, made.field, (vector - centre)[free] / sizes, *(tie.residual for tie in prior)]
        return Point(vector, way, back, moved, made, prior, 0.5 * sum(float(np.sum(part**2)) for part in squares))

    def equations(now: Point) -> Any:
        chain, off = with_prior(chain_of(now.rows, free), now.prior), (now.vector - centre)[free] / sizes**2
        return dataclasses.replace(chain, corner=chain.corner + np.diag(sizes**-2.0), score=chain.score + off)

    now = at(vector, way, record.back(vector))
    chain, done = equations(now), False
    for _ in range(steps):
        known = chain.eliminated()
        while True:
            move = -np.linalg.solve(known.information + damping * np.diag(sizes**-2.0), known.score)
            promised = -0.5 * float(move @ known.score) - 0.5 * float(np.sum(chain.link_score * known.links(np.zeros(len(free)))))
            trial = now.vector.copy()
            trial[free] += move
            trial[[GYRO_DELAY, MAG_DELAY]] = np.clip(trial[[GYRO_DELAY, MAG_DELAY]], -REACH, REACH)
            found = at(trial, now.way.moved(known.links(move)), now.back)
            if found.cost <= now.cost * (1 + 1e-9) + 1e-6 or damping > 1e12:
                break
            damping = max(10 * damping, 1.0)
        done, now = abs(promised) < _SETTLED, found
        if (back := record.back(now.vector, now.back)) != now.back:
            now = at(now.vector, now.way, back)
        damping = damping / 10 if damping > 1 else 0.0
        chain = equations(now)
        if done:
            break
    return Solution(**vars(now), chain=chain, eliminated=chain.eliminated(), converged=done, free=free, counts=counts,
                    kept=record.kept(now.back), noise=noise, rests=rests)  # fmt: skip
