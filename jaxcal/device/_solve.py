"""The estimator: rounds of Gauss-Newton fits of the parameters and the trajectory of the device (host)."""

import dataclasses
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs, skew, windowed_variance
from ._levels import Levels
from ._model import AT, NAMES, field_of, model_of
from ._noise_floor import Floor
from ._normal import Inertial, chain_of, inertial, rows
from ._start import Start
from ._state import SIZES, Noise, Place, Point, Rests, Solution, Way, hand_prior, with_prior
from ._windows import GYRO_DELAY, MAG_DELAY, REACH, Record

#: rounds of fits: at least, at most, and at most where the motion does not determine all parameters; most steps of a fit, and of one
#: where the motion does not determine all parameters
_ROUNDS, _MOST, _BLIND, _STEPS, _FEW = 3, 8, 5, 25, 10
#: a fit has converged when a step is expected to lower the cost (half the sum of squares) by less; the rounds end when weights, and
#: logarithms of noise levels, change by less
_SETTLED, _SAME = 1e-4, 0.05
_SLOW, _FURTHEST = 0.5, 30.0  # ratio of successive steps above which a step is lengthened; largest factor
#: noise of a reading of the field, as a part of it, in the first fit. Rms field residual of a window in standard deviations: above the
#: second number it gets less weight, above the third that of the fourth, which is not zero, so that its residuals are still computed
_FIELD_NOISE, _FAR, _GONE, _LITTLE = 0.01, 1.5, 4.0, 1e-2
#: m/s^2 and rad/s: at rest, readings scatter by less, and the mean rate is below the second number; how much more than inside the rest a
#: window at its edge may scatter; number of windows by which a rest may grow at each edge
_STILL_FORCE, _STILL_RATE, _CALM, _MARGIN_WINDOWS = 0.35, 0.06, 1.1, 4


def rounds(record: Record, start: Start, free: np.ndarray, floors: tuple[Floor, Floor]) -> tuple[Solution, Place]:
    """Fit repeatedly. Between fits, update the noise levels, the weights of disturbed windows, and the reach and speed of the hand."""
    (gyro, accel), centre, settled = floors, start.vector.copy(), False
    place, rests = Place(0.3, 0.4), rests_of(record, start.vector)
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


def rests_of(record: Record, vector: np.ndarray) -> Rests:
    """Windows in which the specific force hardly changes and the device hardly rotates, for at least a second."""
    size = 2 * max(round(0.5 / record.grid.step), 2) + 1
    rate_of = record.gyro - vector[AT["gyro.bias"]]
    rate = np.stack([np.convolve(x, np.ones(size) / size, mode="same") for x in rate_of.T], axis=1)
    calm = np.zeros(len(record.gyro), dtype=bool)
    half = size // 2
    shaken, turned = windowed_variance(record.accel, size), windowed_variance(record.gyro, size)
    calm[half : half + len(shaken)] = (shaken < _STILL_FORCE**2) & (turned < _STILL_RATE**2)
    calm &= np.linalg.norm(rate, axis=1) < _STILL_RATE
    still = calm[record.grid.inner].all(axis=1)
    if not still.any():
        return Rests(still)
    # the scatter is computed over a second, which must fit into the rest: extend the rest while single windows are as calm as inside
    force, turns = record.accel[record.grid.inner], rate_of[record.grid.inner]
    own = [np.ptp(force, axis=1).max(axis=1), np.linalg.norm(turns.mean(axis=1), axis=1), np.ptp(turns, axis=1).max(axis=1)]
    for first, stop in zip(*runs(still), strict=True):
        usual = [_CALM * np.max(size[first:stop]) for size in own]
        for at, way in ((first - 1, -1), (stop, 1)):
            for k in range(at, at + way * _MARGIN_WINDOWS, way):
                if not 0 <= k < len(still) or any(size[k] > most for size, most in zip(own, usual, strict=True)):
                    break
                still[k] = True
    return Rests(still & ~record.broken)


def _spread_of(mean: np.ndarray, end: np.ndarray, gyro: np.ndarray, accel: np.ndarray, time: float) -> np.ndarray:
    """(K, 9, 9) covariances of the inertial residuals for white noise with densities (K,).

    They depend on the mean specific force of a window (K, 3), and on the rotation from its end back to its beginning (K, 3, 3).
    """
    up, eye = skew(mean), np.eye(3)
    square = -(up @ up)  # an error of attitude rotates the specific force
    g, a = (level[:, None, None] ** 2 for level in (gyro, accel))
    speed, place = g * time**2 / 2 * end @ up, g * time**3 / 6 * end @ up
    both = a * time**2 / 2 * eye + g * time**4 / 8 * square
    rows = (
        (g * time * eye, speed, place),
        (np.swapaxes(speed, 1, 2), a * time * eye + g * time**3 / 3 * square, both),
        (np.swapaxes(place, 1, 2), np.swapaxes(both, 1, 2), a * time**3 / 3 * eye + g * time**5 / 20 * square),
    )
    return np.concatenate([np.concatenate(row, axis=2) for row in rows], axis=1)


def _whitened(found: Inertial, noise: Noise, time: float, broken: np.ndarray) -> np.ndarray:
    """(K, 9, 9) matrices that whiten the inertial residuals, for white noise of gyroscope and accelerometer."""
    gyro, accel = (np.broadcast_to(level, len(found.speed)) for level in (noise.gyro, noise.accel))
    matrix = _spread_of(found.speed / time, np.swapaxes(found.rotation[:, -1], 1, 2), gyro, accel, time)
    matrix[broken] = np.diag(np.repeat([1.0, 10.0, 1.0], 3) ** 2)
    return np.linalg.inv(np.linalg.cholesky(matrix))


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
        whiten, weight = _whitened(moved, noise, record.time, record.broken), counts[:, None] * record.kept(back)
        made = rows(way.states, w, moved, model, whiten, weight / np.reshape(noise.mag, (-1, 1)), record.gravity, record.earth)
        prior = hand_prior(way, place, rests, record.time)
        squares = [made.inertial, made.field, (vector - centre)[free] / sizes, *(tie.residual for tie in prior)]
        return Point(vector, way, back, w, moved, whiten, made, prior, 0.5 * sum(float(np.sum(part**2)) for part in squares))

    def equations(now: Point) -> Any:
        chain, off = with_prior(chain_of(now.rows, free), now.prior), (now.vector - centre)[free] / sizes**2
        return dataclasses.replace(chain, corner=chain.corner + np.diag(sizes**-2.0), score=chain.score + off)

    now = at(vector, way, record.back(vector))
    chain, done, before = equations(now), False, None
    for _ in range(steps):
        known, stretch = chain.eliminated(), 1.0
        while True:
            move = -np.linalg.solve(known.information + damping * np.diag(sizes**-2.0), known.score)
            if stretch and before is not None:
                # steps that shrink slowly form a geometric series: take the sum of the remaining series in one step
                shrinks = float(before @ known.information @ move) / float(before @ known.information @ before)
                stretch = min(1 / (1 - shrinks), _FURTHEST) if _SLOW < shrinks < 1 else 1.0
                move = stretch * move
            promised = -0.5 * float(move @ known.score) - 0.5 * float(np.sum(chain.link_score * known.links(np.zeros(len(free)))))
            trial = now.vector.copy()
            trial[free] += move
            trial[[GYRO_DELAY, MAG_DELAY]] = np.clip(trial[[GYRO_DELAY, MAG_DELAY]], -REACH, REACH)
            found = at(trial, now.way.moved(known.links(move)), now.back)
            if found.cost <= now.cost * (1 + 1e-9) + 1e-6 or damping > 1e12:
                break
            if stretch > 1:
                stretch = 0.0
            else:
                damping = max(10 * damping, 1.0)
        before = None if stretch > 1 or damping else move
        done, now = abs(promised) < _SETTLED, found
        if (back := record.back(now.vector, now.back)) != now.back:
            now = at(now.vector, now.way, back)
        damping = damping / 10 if damping > 1 else 0.0
        chain = equations(now)
        if done:
            break
    return Solution(**vars(now), chain=chain, eliminated=chain.eliminated(), converged=done, free=free, counts=counts,
                    kept=record.kept(now.back), noise=noise, rests=rests)  # fmt: skip
