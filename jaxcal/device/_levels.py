"""Noise levels of each sensor over times longer than a reading, from the residuals of a fit."""

import numpy as np

from ._solve import LINK, SIZES, Noise, Place, Rests, Solution
from ._windows import NAMES

_DRAWS = 16
_LENGTHS = (1, 2, 4, 8, 16, 32, 64)  # windows
#: number of lengths whose power always counts. Many sums determine it. One length is too few: noise may be correlated within a window
_SHORT = 3
#: fewest windows at rest, or in motion, whose residuals show a noise level
FEW = 10
_PACE = (0.25, 4.0)  # smallest and largest factor on the change that the residuals ask for
#: weight of the prior ratio of 1, in degrees of freedom; standard deviations by which a ratio must be larger over many windows than few
_SURE, _MARGIN = 1.0, 2.5


def null(found: Solution, place: Place, rests: Rests, time: float) -> tuple[np.ndarray, np.ndarray]:
    """Residuals of fits to simulated white noise: (K, 9, draws) of the inertial rows, and sums (K, 3, draws) of those of the field.

    Near its solution the fit is linear. So the function draws white noise for every row and solves the normal equations for it. The
    residuals show how much of the noise the unknowns absorb.
    """
    rng = np.random.default_rng(0)
    free, rows, size = found.free, found.rows, len(NAMES)
    count, width = len(rows.inertial), len(found.free)
    draw = lambda *shape: rng.normal(size=(*shape, _DRAWS))  # noqa: E731
    ends = np.zeros((count + 1, LINK, _DRAWS))
    own = rows.inertial_by[:, :, np.append(free, np.arange(size, size + 18))]
    noise = draw(count, 9)
    push = np.swapaxes(own, 1, 2) @ noise
    ends[:-1, :9] += push[:, width : width + 9]
    ends[1:, :9] += push[:, width + 9 :]
    score = push[:, :width].sum(axis=0)
    field_by = rows.field_by[..., np.append(free, np.arange(size, size + 3))].reshape(count, -1, width + 3)
    seen = draw(count, field_by.shape[1]) * np.repeat(found.kept, 3, axis=1)[..., None]
    push = np.swapaxes(field_by, 1, 2) @ seen
    ends[:-1, :3] += push[:, width:]
    score += push[:, :width].sum(axis=0)
    step, inverse, begin = place.transition(time)
    root, first = np.linalg.cholesky(inverse), np.linalg.cholesky(begin)
    at = np.array([[3, 6, 9], [4, 7, 10], [5, 8, 11]])
    pace = rests.moving[:, None, None, None]
    moved = np.einsum("ab,kxbd->kxad", root, draw(count, 3, 3) * pace)
    ends[1:, at] += moved
    ends[:-1, at] -= np.einsum("ba,kxbd->kxad", step, moved)
    ends[0, at] += np.einsum("ab,xbd->xad", first, draw(3, 3))
    if rests.windows.any():
        still = np.concatenate([np.full(3, 1 / rests.speed), np.full(3, place.reach / (3 * place.speed**2))])
        ends[:, [3, 4, 5, 9, 10, 11]] += still[:, None] * draw(count + 1, 6) * rests.ends[:, None, None]
        back = np.swapaxes(found.way.rotation[:-1], 1, 2) @ found.way.rotation[1:]
        turned = draw(count, 3) * rests.windows[:, None, None] / rests.turn
        ends[1:, :3] += turned
        ends[:-1, :3] -= back @ turned
    score += draw(width) / SIZES[free][:, None]
    links, steps = found.chain.steps(ends, score)
    steps_all = np.broadcast_to(steps, (count, *steps.shape))
    left = noise + own @ np.concatenate([steps_all, links[:-1, :9], links[1:, :9]], axis=1)
    field = seen + field_by @ np.concatenate([steps_all, links[:-1, :3]], axis=1)
    return left, field.reshape(count, -1, 3, _DRAWS).sum(axis=1)


def residuals(found: Solution, place: Place, rests: Rests, time: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Sensor -> residuals (K, 3) of the windows, and those of fits to white noise (K, 3, draws): see `null`."""
    left, field = null(found, place, rests, time)
    inertial = found.rows.inertial
    return {
        "gyro": (inertial[:, :3], left[:, :3]), "accel": (inertial[:, 3:6], left[:, 3:6]), "mag": (found.rows.field.sum(axis=1), field),
    }  # fmt: skip


def powers(values: np.ndarray, which: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(2, lengths, ...) mean squares of sums over consecutive windows: in the axes of the device, then in those of the world."""
    values = values * which.reshape(-1, *np.ones(values.ndim - 1, dtype=int))
    out = []
    for own in (values, np.einsum("kab,kb...->ka...", turn, values)):
        total = np.concatenate([np.zeros((1, *own.shape[1:])), np.cumsum(own, axis=0)])
        out.append([np.mean((total[n:] - total[:-n]) ** 2, axis=(0, 1)) for n in _LENGTHS])
    return np.array(out)


class Levels:
    """Noise levels that explain the size of the residuals, at least those of the white noise.

    Sensors have errors beside white noise: from their filters, from nonlinearity, from biases that wander, and from iron in the room.
    The fit treats all of them as noise, with the size that they have over the times over which it compares the sensors. Rest and motion
    have separate levels.
    """

    def __init__(self) -> None:
        #: (sensor, rest or motion) -> logarithm of the level before, and the change that its residuals asked for
        self._before: dict[tuple[str, int], tuple[float, float]] = {}

    def next(self, found: Solution, place: Place, rests: Rests, time: float, white: Noise) -> tuple[Noise, float]:
        """The levels for the next fit, and the largest change, of a logarithm, that the residuals ask for."""
        levels, most, count = {}, 0.0, len(rests.windows)
        for name, (seen, drawn) in residuals(found, place, rests, time).items():
            now, least = (np.array(np.broadcast_to(getattr(noise, name), count), dtype=float) for noise in (found.noise, white))
            for part, which in enumerate((rests.windows, ~rests.windows)):
                if which.sum() >= FEW:
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
        """Factor on the asked change, from the secant: with 1, levels of two sensors that explain the same residuals would oscillate."""
        before, self._before[key] = self._before.get(key), (at, asked)
        if before is None or before[0] == at or (slope := (asked - before[1]) / (at - before[0])) >= 0:
            return 1.0
        return float(np.clip(-1 / slope, *_PACE))


def _excess(seen: np.ndarray, left: np.ndarray, which: np.ndarray, turn: np.ndarray) -> tuple[float, bool]:
    """Power of the residuals over that of noise with the present level, and whether it is clearly larger.

    The power is that of sums over a few windows in a row, or over many if that is clearly larger.
    """
    own, drawn = powers(seen, which, turn), powers(left, which, turn)
    mean, spread = drawn.mean(axis=-1), drawn.std(axis=-1)
    degrees = 2 * (mean / spread) ** 2
    ratio = (own / mean * degrees + _SURE) / (degrees + _SURE)
    short, margin = np.max(ratio[0, :_SHORT]), np.exp(_MARGIN * spread / mean)
    # a variance from few degrees of freedom may be too small by chance: use that of Student's t
    many = np.max(np.where(ratio > short * margin, ratio * (1 + 2 / degrees), 0.0))
    return float(max(short, many)), bool(np.any(ratio > margin))
