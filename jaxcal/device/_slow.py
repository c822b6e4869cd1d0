"""Noise of the sensors over times longer than those over which the fit sets its noise levels."""

import numpy as np

from ._levels import FEW, residuals
from ._noise_floor import markov_spectrum, white_and_markov
from ._solve import Place, Rests, Solution

_CORRELATED = (2, 64)  # shortest and longest time constant of the noise, in windows
_CONSTANTS = 11  # number of time constants
#: gain in log-likelihood over white noise from which the residuals show such noise. The device moves less than the fit allows at rest, so
#: white noise gains something too: at most 19 in 24 simulations with 8 rests, 18 to 60 in 12 with 24 rests. A false gain of 33 to 60
#: made the errors 2 to 14 % larger
_CLEAR = 30.0


def slow_noise(found: Solution, place: Place, rests: Rests, time: float, pushed: dict[str, np.ndarray]) -> np.ndarray:
    """(p, p) variance of the score from the noise that the levels of the fit do not contain.

    The noise of a sensor is described as white noise and a Gauss-Markov process. Their powers and the time constant are those that explain
    the spectrum of the residuals in octaves. The fit absorbs a part of the noise. Fits to white noise show how large this part is at each
    frequency. At each frequency, the power above the level of the fit counts. `pushed` (K, p, 3) is the change of the score by a bias of
    the sensor in one window.
    """
    total = np.zeros(2 * pushed["mag"].shape[1:2])
    number = found.kept.sum() / max(np.count_nonzero(found.kept.any(axis=1)), 1)
    keep = np.exp(-1 / np.geomspace(*_CORRELATED, _CONSTANTS))
    for name, (seen, drawn) in residuals(found, place, rests, time).items():
        count = len(seen)
        level = np.broadcast_to(getattr(found.noise, name), count) ** 2 * (time / number if name == "mag" else 1.0)
        parts = [which for which in (rests.windows, ~rests.windows) if which.sum() >= FEW]
        # rests show the noise of the inertial sensors, which motion hides; the attitude of a rest absorbs that of the magnetometer
        read = parts[-1] if name == "mag" else parts[0]
        ratio, freedom, shapes = _octaves(seen, drawn, read, keep)
        white, slow, best, gain = white_and_markov(level[read][0] * ratio, shapes, freedom)
        if gain < _CLEAR:
            continue
        spectrum = white + slow * markov_spectrum(keep[best : best + 1], np.pi * np.arange(count + 1) / count)
        felt = np.zeros((count + 1, *pushed[name].shape[1:]), dtype=complex)
        for which in parts:
            more = np.sqrt(np.maximum(spectrum - level[which][0], 0.0) / time)
            felt += more[:, None, None] * np.fft.rfft(pushed[name] * which[:, None, None], 2 * count, axis=0)
        felt[1:-1] *= np.sqrt(2)  # negative frequencies
        total = total + np.einsum("fpa,fqa->pq", felt, felt.conj(), optimize=True).real / (2 * count)
    return total


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
