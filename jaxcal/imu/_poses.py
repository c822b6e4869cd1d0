"""`Poses` and `Turns` of a recording, padded to a few shapes so that records of like length share their programs (host, NumPy)."""

import equinox as eqx
import numpy as np

from ._recording import Recording
from ._residuals import Poses, Turns


class Rests(eqx.Module):
    """Means over k still intervals: readings (k, 3), middle (s from the middle of the record), duration (s), and rows of the padding."""

    accel: np.ndarray
    gyro: np.ndarray
    time: np.ndarray
    duration: np.ndarray
    slots: int

    def poses(self, sigma: np.ndarray, gyro_sigma: np.ndarray | None = None) -> Poses:
        """Padded poses with the given standard deviations, (k,) and (k, 3)."""
        accel, gyro, time = (padded(x, self.slots) for x in (self.accel, self.gyro, self.time))
        if gyro_sigma is None:
            return Poses(accel, padded(sigma, self.slots, np.inf))
        return Poses(accel, padded(sigma, self.slots, np.inf), gyro, padded(gyro_sigma, self.slots, np.inf), time)


def padded(x: np.ndarray, slots: int, fill: float | None = None) -> np.ndarray:
    """Up to so many rows: of the first row, or of a number."""
    more = np.repeat(x[:1], slots - len(x), axis=0)
    return np.concatenate([x, more if fill is None else np.full_like(more, fill)])


def power_of_two(n: int, least: int = 1) -> int:
    """Smallest power of two of at least n."""
    return max(1 << max(n - 1, 0).bit_length(), least)


def rests_of(recording: Recording, start: np.ndarray, stop: np.ndarray) -> Rests:
    """Means over whole intervals."""

    def mean(readings: np.ndarray) -> np.ndarray:
        return np.array([readings[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])

    accel = mean(recording.accel)
    gyro = 0 * accel if recording.gyro is None else mean(recording.gyro)
    middle = (recording.time[start] + recording.time[stop - 1]) / 2 - recording.time[-1] / 2
    return Rests(accel, gyro, middle, (stop - start) / recording.rate, power_of_two(len(start) + 1, 32))


def turns_of(recording: Recording, start: np.ndarray, stop: np.ndarray, slots: int) -> Turns:
    """Turns from the last sample of each interval to the last before the next one; sigma is one, infinite where samples are missing."""
    gyro, accel = recording.gyro, recording.accel
    assert gyro is not None
    first, last = stop[:-1] - 1, start[1:]  # samples first <= i < last
    n = power_of_two(int((last - first).max()) - 1, 64)
    index = np.minimum(first[:, None] + np.arange(n + 1)[None, :], last[:, None] - 1)
    index = np.concatenate([index, np.repeat(index[:1, :1], slots - 1 - len(first), axis=0) + np.zeros(n + 1, dtype=int)])
    good = np.isfinite(np.concatenate([gyro[index], accel[index]], axis=2)).all(axis=(1, 2))
    sigma = np.where(good & (np.arange(slots - 1) < len(first)), 1.0, np.inf)
    kept = np.reshape(good, (-1, 1, 1))
    return Turns(np.where(kept, gyro[index], 0.0), np.where(kept, accel[index], 0.0), np.diff(recording.time[index], axis=1), sigma)
