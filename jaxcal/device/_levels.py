"""Noise of each sensor over times longer than a reading, from the residuals of a fit: its level, and its part below that level."""

import numpy as np

from .._units import factor
from ..noise import Noise as SlowNoise, mean_covariance
from ._model import NAMES
from ._noise_floor import CLEAR, markov_spectrum, white_and_markov
from ._normal import LINK
from ._state import SIZES, Noise, Solution, pushed

#: records of white noise that are drawn; fewest windows at rest, or in motion, whose residuals show a noise level
_DRAWS, _FEW = 16, 10
#: lengths of sums in windows; number of those whose power always counts, because many sums determine it, and one length is too few: noise
#: may be correlated within a window; standard deviations by which the power of longer sums must be larger to count
_LENGTHS, _SHORT, _MARGIN = (1, 2, 4, 8, 16, 32, 64), 3, 2.5
_DAY = factor("d", "time")  # s, over which the bias is a mean: the time within which a calibration is used


def residuals(found: Solution) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Sensor -> residuals (K, 3) of the windows, and those of fits to simulated white noise (K, 3, draws); sums of those of the field.

    Near its solution the fit is linear. So the function draws white noise for every row and solves the normal equations for it. The
    residuals show how much of the noise the unknowns absorb.
    """
    rng = np.random.default_rng(0)
    free, rows, size = found.free, found.rows, len(NAMES)
    count, width = len(rows.inertial), len(found.free)
    draw = lambda *shape: rng.normal(size=(*shape, _DRAWS))  # noqa: E731
    own = rows.inertial_by[:, :, np.append(free, np.arange(size, size + 18))]
    noise = draw(count, 9)
    push = np.swapaxes(own, 1, 2) @ noise
    ends = np.zeros((count + 1, LINK, _DRAWS))
    ends[:-1, :9] += push[:, width : width + 9]
    ends[1:, :9] += push[:, width + 9 :]
    score = push[:, :width].sum(axis=0)
    field_by = rows.field_by[..., np.append(free, np.arange(size, size + 3))].reshape(count, -1, width + 3)
    seen = draw(count, field_by.shape[1]) * np.repeat(found.kept, 3, axis=1)[..., None]
    push = np.swapaxes(field_by, 1, 2) @ seen
    ends[:-1, :3] += push[:, width:]
    score += push[:, :width].sum(axis=0)
    ends += pushed(found.prior, [draw(*tie.residual.shape) for tie in found.prior], count + 1)
    score += draw(width) / SIZES[free][:, None]
    links, steps = found.chain.steps(ends, score)
    steps_all = np.broadcast_to(steps, (count, *steps.shape))
    left = noise + own @ np.concatenate([steps_all, links[:-1, :9], links[1:, :9]], axis=1)
    field = (seen + field_by @ np.concatenate([steps_all, links[:-1, :3]], axis=1)).reshape(count, -1, 3, _DRAWS).sum(axis=1)
    inertial = rows.inertial
    return {"gyro": (inertial[:, :3], left[:, :3]), "accel": (inertial[:, 3:6], left[:, 3:6]), "mag": (rows.field.sum(axis=1), field)}


def _powers(values: np.ndarray, which: np.ndarray, turn: np.ndarray) -> np.ndarray:
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

    def next(self, found: Solution, white: Noise) -> tuple[Noise, float]:
        """The levels for the next fit, and the largest change, of a logarithm, that the residuals ask for."""
        resting = found.rests.windows
        levels, most, count = {}, 0.0, len(resting)
        for name, (seen, drawn) in residuals(found).items():
            now, least = (np.array(np.broadcast_to(getattr(noise, name), count), dtype=float) for noise in (found.noise, white))
            for part, which in enumerate((resting, ~resting)):
                if which.sum() >= _FEW:
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


def slow_noise(found: Solution, time: float, felt_by: dict[str, np.ndarray], wander: dict[str, SlowNoise]) -> np.ndarray:
    """(p, p) variance of the score from the noise that the levels of the fit do not contain.

    The noise of a sensor is described as white noise and a Gauss-Markov process. Their powers and the time constant are those that explain
    the spectrum of the residuals in octaves. The fit absorbs a part of the noise. Fits to white noise show how large this part is at each
    frequency. At each frequency, the power above the level of the fit counts. `felt_by` (K, p, 3) is the change of the score by a bias of
    the sensor in one window. That of the biases, `wander`, adds if the caller gives it.
    """
    total = np.zeros(2 * felt_by["mag"].shape[1:2])
    for sensor, noise in wander.items():
        total = total + _wandering(felt_by[sensor], noise, time)
    resting = found.rests.windows
    number = found.kept.sum() / max(np.count_nonzero(found.kept.any(axis=1)), 1)
    keep = np.exp(-1 / np.array(_LENGTHS[1:]))
    for name, (seen, drawn) in residuals(found).items():
        count = len(seen)
        level = np.broadcast_to(getattr(found.noise, name), count) ** 2 * (time / number if name == "mag" else 1.0)
        parts = [which for which in (resting, ~resting) if which.sum() >= _FEW]
        # rests show the noise of the inertial sensors, which motion hides; the attitude of a rest absorbs that of the magnetometer
        read = parts[-1] if name == "mag" else parts[0]
        ratio, freedom, shapes = _octaves(seen, drawn, read, keep)
        white, slow, best, gain = white_and_markov(level[read][0] * ratio, shapes, freedom)
        if gain < CLEAR:
            continue
        spectrum = white + slow * markov_spectrum(keep[best : best + 1], np.pi * np.arange(count + 1) / count)
        felt = np.zeros((count + 1, *felt_by[name].shape[1:]), dtype=complex)
        for which in parts:
            more = np.sqrt(np.maximum(spectrum - level[which][0], 0.0) / time)
            felt += more[:, None, None] * np.fft.rfft(felt_by[name] * which[:, None, None], 2 * count, axis=0)
        felt[1:-1] *= np.sqrt(2)  # negative frequencies
        total = total + np.einsum("fpa,fqa->pq", felt, felt.conj(), optimize=True).real / (2 * count)
    return total


def _wandering(pushed: np.ndarray, noise: SlowNoise, time: float) -> np.ndarray:
    """(p, p) variance of the score from a bias that wanders about its mean over a day, with the recording in its middle.

    `pushed` (K, p, 3) is the change of the score by a bias in one window. Flicker has no mean over all time.
    """
    dwell = np.concatenate([[_DAY / 2], np.full(len(pushed), time), [_DAY / 2]])
    matrix = mean_covariance(noise, np.cumsum(dwell) - dwell, dwell)[1:-1, 1:-1]
    return np.einsum("kpa,kl,lqa->pq", pushed, matrix, pushed, optimize=True)


def _octaves(seen: np.ndarray, drawn: np.ndarray, which: np.ndarray, keep: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Power of the residuals over that of fits to white noise, its degrees of freedom, and this ratio for each process (c, octaves)."""
    count = len(which)
    edges = [1, 3]
    while 4 * edges[-1] < count:
        edges.append(2 * edges[-1])
    powers = [np.abs(np.fft.rfft(y * which.reshape(-1, *np.ones(y.ndim - 1, dtype=int)), axis=0)) ** 2 for y in (seen, drawn)]
    own, null = (np.add.reduceat(power, edges, axis=0) for power in powers)
    own, null = own.sum(axis=1), null.sum(axis=1)
    mean = null.mean(axis=-1)
    lag = np.minimum(np.arange(2 * count), 2 * count - np.arange(2 * count))
    both = np.fft.irfft(np.abs(np.fft.rfft(which, 2 * count)) ** 2, 2 * count)  # pairs of these windows at each lag
    keep = np.append(keep, 0.0)[:, None]
    power = np.fft.rfft((1 - keep) / (1 + keep) * keep**lag * both, axis=1).real[:, ::2]
    shapes = np.add.reduceat(power, edges, axis=1)
    return own / mean, 2 * (mean / null.std(axis=-1)) ** 2, shapes[:-1] / shapes[-1]
