"""Noise of inertial sensors from the frequencies at which a hand hardly moves."""

from typing import NamedTuple

import numpy as np

from ._windows import WINDOW

#: Hz: hands hardly move above it; part of half the rate, because at the last frequencies the spectrum of real numbers is distributed
#: otherwise
_TREMOR, _TOP = 15.0, 0.96
#: s, length of a segment; fewest frequencies of a spectrum; order of the differences that keep low frequencies from leaking
_SEGMENT, _FREQUENCIES, _DIFFERENCES = 1.28, 5, 4
_REWEIGHTED = 10  # rounds of least squares with renewed weights
#: gain in log-likelihood over white noise from which the spectrum of residuals, or of a sensor, shows such noise. The device moves less
#: than the fit allows at rest, so white noise gains something too: at most 19 in 24 simulations with 8 rests, 18 to 60 in 12 with 24
#: rests. A false gain of 33 to 60 made the errors 2 to 14 % larger
CLEAR = 30.0


class Floor(NamedTuple):
    """Densities of the noise: at the highest frequencies, and at the rate of the windows. They are equal if the noise is white."""

    fast: float
    slow: float


def noise_floor(y: np.ndarray, rate: float, lost: np.ndarray) -> Floor:
    """Noise of readings (n, 3), of which some are `lost`. It is at least that of rounding, which a device at rest may not show.

    Filters, and processes within a sensor, make noise that is stronger at low frequencies, where motion hides it. So the spectrum above
    the band of a hand is described as white noise and a Gauss-Markov process, whose corner frequency is at least that of the windows.
    A steep filter has another shape: with Butterworth filters of order 2 and 4 at 10 to 42 Hz the result was 0.3 to 3.8 times the density.
    """
    changes = np.abs(np.diff(y, axis=0))
    least = float(np.min(changes[changes > 0])) ** 2 / 12 / rate
    length = round(_SEGMENT * rate)
    frequency = np.fft.rfftfreq(length, 1 / rate)
    # readings at less than 40 Hz show no frequency above the band of a hand: the highest ones have the least motion
    top = frequency[(frequency > 0) & (frequency < _TOP * rate / 2)]
    band = (frequency >= min(_TREMOR, top[-_FREQUENCIES:][0])) & (frequency <= top[-1])
    broken = _parts(lost[_DIFFERENCES:], length).mean(axis=-1)
    window = np.hanning(length + 2)[1:-1]
    # segments without a gap, or those with the shortest gaps
    high = _parts(np.diff(y, _DIFFERENCES, axis=0), length)[broken == broken.min()] * window
    power = np.abs(np.fft.rfft(high, axis=-1)[..., band]) ** 2 / np.sum(window**2) / rate
    angle = 2 * np.pi * frequency[band] / rate
    # the median ignores knocks and stretches with vibration
    seen = np.median(power, axis=0).mean(axis=0) / np.log(2) / (2 * np.sin(angle / 2)) ** (2 * _DIFFERENCES)
    seen = np.maximum(seen, least)
    keep = np.exp(-2 * np.pi * top[top >= min(1 / WINDOW, top[-1])] / rate)[:, None]
    if len(seen) >= _FREQUENCIES:
        white, slow, _, gain = white_and_markov(seen, markov_spectrum(keep, angle), 2 * power.shape[0] * power.shape[1])
        if gain > CLEAR:
            return Floor(float(np.sqrt(seen[len(seen) // 2 :].mean())), float(np.sqrt(white + slow)))
    return Floor(*2 * [float(np.sqrt(seen.mean()))])


def _parts(y: np.ndarray, length: int) -> np.ndarray:
    """Segments of this length, which overlap by half, along a new last axis."""
    return np.lib.stride_tricks.sliding_window_view(y, length, axis=0)[:: length // 2]


def markov_spectrum(keep: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """Spectrum of a Gauss-Markov process, 1 at frequency zero. `keep` is the correlation over a step, `angle` is in rad per step."""
    return (1 - keep) ** 2 / (1 + keep**2 - 2 * keep * np.cos(angle))


def white_and_markov(seen: np.ndarray, shapes: np.ndarray, freedom: np.ndarray | int) -> tuple[float, float, int, float]:
    """Powers of white noise and of a Gauss-Markov process that explain a spectrum, by iteratively reweighted least squares.

    Parameters
    ----------
    seen : (f,) spectrum.
    shapes : (c, f) spectra of the processes from which to choose; the power of a process is that at frequency zero.
    freedom : (f,) degrees of freedom of each value, or one number.

    Returns
    -------
    Both powers, the index of the process, and the gain in log-likelihood over white noise alone.
    """
    freedom = np.broadcast_to(freedom, seen.shape)
    alone = float(np.average(seen, weights=freedom))
    parts = np.stack([np.ones_like(shapes), shapes], axis=1)  # (c, 2, f)
    sizes = np.full((len(shapes), 2), alone)
    for _ in range(_REWEIGHTED):
        weighted = freedom * parts / np.einsum("cp,cpf->cf", sizes, parts)[:, None] ** 2
        normal, right = weighted @ np.swapaxes(parts, 1, 2), weighted @ seen
        sizes = np.linalg.solve(normal, right[..., None])[..., 0]
        # a negative part is zero, and the other part is fitted alone
        single = right / np.diagonal(normal, axis1=1, axis2=2)
        sizes = np.where(sizes[:, ::-1] < 0, single, np.maximum(sizes, 0.0))
    coloured, white = (seen / model for model in (np.einsum("cp,cpf->cf", sizes, parts), alone))
    misfit = 0.5 * np.sum(freedom * (coloured - 1 - np.log(coloured)), axis=-1)
    best = int(np.argmin(misfit))
    return *sizes[best].tolist(), best, float(0.5 * np.sum(freedom * (white - 1 - np.log(white))) - misfit[best])
