"""Evidence for the unit of a sensor in its values, independent of names.

There are four kinds of evidence. The *step* of the values: sensors count, and the size of a count is known for common sensors (an MPU-6050
has 131 counts per deg/s). *Gravity* and the Earth's *field*, whose magnitudes are known. And *rotation*: in the frame of a rotating
sensor, gravity and the field rotate by ``da/dt = -omega x a``, so a regression of the two sides gives the unit of the gyroscope.
"""

import dataclasses
import itertools

import numpy as np

from .._arrays import interpolated, quantile
from .._quality import all_finite
from .._units import STANDARD_GRAVITY
from ..evidence._values import FEW, SAMPLE
from ._readers._bounds import PIECE

#: size of one count of common gyroscopes (deg/s) and accelerometers (g). Powers of two are evidence only together with a magnitude
#: near 1 g, because every number format has them.
_COUNTS = {
    "gyro": (
        *(1 / counts for counts in (131.0, 65.5, 32.8, 16.4, 131.2, 65.6, 262.4, 14.375)),
        *(span / 32768 for span in (125.0, 250.0, 500.0, 1000.0, 2000.0, 4000.0)),
        *(0.004375, 0.00875, 0.0175, 0.035, 0.07, 0.14),
    ),
    "accel": (*(2.0**-n for n in range(8, 16)), *(1e-3 * mg for mg in (0.061, 0.122, 0.244, 0.488, 0.732, 3.9))),
}  # fmt: skip
_MATCH = 4e-4


@dataclasses.dataclass(frozen=True)
class Turning:
    """Regression of the rotation of a fixed vector (gravity, field) on that predicted by a gyroscope in rad/s: slope, correlation."""

    slope: float
    correlation: float

    @property
    def unit(self) -> str | None:
        """Unit of the gyroscope if the slope fits one, else None."""
        units = (("rad/s", 1.0), ("deg/s", np.radians(1.0)))
        return next((unit for unit, size in units if 0.25 < abs(self.slope) / size < 4.0), None)


def thinned(values: np.ndarray) -> np.ndarray:
    """A subset of the rows from which a spread is found to 1 %, without rows with missing values."""
    # sums over rows that are apart take several times as long
    values = np.ascontiguousarray(values[:: max(1, len(values) // SAMPLE)])
    return values if all_finite(values) else values[np.isfinite(values).all(axis=1)]


def norms(values: np.ndarray) -> np.ndarray:
    """Magnitudes of a subset of the vectors."""
    seen = thinned(values)
    return np.sqrt(np.einsum("ij,ij->i", seen, seen))


def median_norm(values: np.ndarray) -> float:
    """Median magnitude of the vectors."""
    return float(interpolated(found, 0.5)) if len(found := norms(values)) else np.nan


def spread(values: np.ndarray) -> float:
    """Standard deviation of the magnitudes, relative to their median."""
    found = norms(values)
    median = float(interpolated(found, 0.5)) if len(found) else 0.0
    return float(np.std(found) / median) if median else np.inf


def all_integer(values: np.ndarray) -> bool:
    """Whether all values are whole numbers with a range of 5 or more."""
    seen = thinned(values)
    first = seen[:FEW]  # settles it for most
    return bool(len(seen) and np.all(first == np.round(first)) and np.all(seen == np.round(seen)) and np.ptp(seen) >= 5)


def noise_floor(values: np.ndarray) -> float:
    """Standard deviation of the noise of a sample in quiet parts of the record: the 10 % quantile over about 50 parts.

    The function uses third differences, which suppress motion; for white noise of standard deviation s theirs is sqrt(20) s.
    """
    seen = values[:PIECE]
    seen = seen if all_finite(seen) else seen[np.isfinite(seen).all(axis=1)]
    width = max(8, len(seen) // 50)
    count = len(seen) // width
    if not count:
        return 0.0
    steps = np.abs(np.diff(seen[: count * width].T.reshape(-1, count, width), n=3))
    # 1.4826 converts the median absolute value of normal noise to a standard deviation
    each = 1.4826 / np.sqrt(20.0) * np.median(quantile(steps, 0.5), axis=0)
    return float(np.quantile(each, 0.1))


def normalised(values: np.ndarray) -> float | None:
    """Common length of rotating vectors if all agree to a part in a thousand: normalised directions, not measurements. Else None."""
    seen = thinned(values)
    if values.shape[1] != 3 or len(seen) < 10:
        return None
    lengths = norms(seen)
    middle = float(interpolated(lengths, 0.5))
    if not middle or not np.isfinite(middle) or np.ptp(lengths) > 2e-3 * middle:
        return None
    return middle if np.ptp(seen, axis=0).max() > 0.02 * middle else None


# the step


def steps_fit(differences: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Whether differences, in ascending order, are multiples of a step of each size to one part in 2500, and some are only a few steps."""
    # the tests that reject most come before those that take long
    least, half, few, most = np.searchsorted(differences, np.outer([0.02, 0.5, 4.5, 300.0], sizes))
    fits = (most - least >= 30) & (half - least <= 0.02 * (most - least)) & (few - least >= 3)
    for i in np.flatnonzero(fits):
        fits[i] = _multiples(differences[least[i] : most[i]], sizes[i])
    return fits


def _multiples(near: np.ndarray, size: float) -> bool:
    some = near[:: len(near) // 1000 + 1] / size
    if np.mean(np.abs(some - np.round(some))) > 0.225:  # 0.25 of any values, and 0.21 at most of such steps: 300 times 1/2500 and 0.09
        return False
    near = near / size
    # the size may be wrong by one part in 2500 at most, so that up to 300 steps are counted correctly
    whole = np.round(near)
    refined = float(near @ whole / (whole @ whole))
    if abs(refined - 1.0) > _MATCH or not np.mean(np.abs(near / refined - whole)) < 0.09:
        return False
    return len(np.unique(whole)) >= 5 and int(np.gcd.reduce(whole.astype(np.int64))) == 1


def _differences(values: np.ndarray) -> list[np.ndarray]:
    """Absolute differences between successive samples of every channel, without zeros, in ascending order."""
    found = []
    for channel in values[:SAMPLE].T:
        difference = np.abs(np.diff(channel))
        # values that differ only by rounding count as equal
        floor = 1e-6 * max(np.fmax.reduce(channel, initial=0.0), -np.fmin.reduce(channel, initial=0.0))
        found.append(np.sort(difference[difference > floor]))
    return [difference for difference in found if len(difference) >= 30]


def step_unit(sensor: str, values: np.ndarray) -> tuple[str, str] | None:
    """Unit in which the step of the values is that of a known sensor, and its description; None if no unit or several units fit."""
    differences = _differences(values)
    if not differences:
        return None
    units = {"gyro": {"deg/s": (1.0,), "rad/s": (np.radians(1.0),)}, "accel": {"g": (1.0,), "m/s^2": (STANDARD_GRAVITY, 9.81, 9.8)}}[sensor]
    tried = [(unit, known, known * one) for unit, ones in units.items() for known, one in itertools.product(_COUNTS[sensor], ones)]
    fits = np.sum([steps_fit(difference, np.array([size for *_, size in tried])) for difference in differences], axis=0)
    found = {unit: known for (unit, known, _), count in zip(tried, fits, strict=True) if count > len(differences) / 2}
    if len(found) != 1:
        return None
    unit, known = next(iter(found.items()))
    return unit, f"steps of {known:.4g} {'deg/s' if sensor == 'gyro' else 'g'}{'' if unit in ('deg/s', 'g') else ' in ' + unit}"


def counts_hint(sensor: str, values: np.ndarray) -> str | None:
    """Size of one count of an accelerometer if the magnitude of its raw counts fits a common sensor, else None."""
    norm = median_norm(values) if sensor == "accel" and values.shape[1] == 3 else np.nan
    return next((f"{size:.6g} g" for size in _COUNTS["accel"] if 0.93 < norm * size < 1.07), None)


# turning


def turning(gyro: np.ndarray, vector: np.ndarray, period: float) -> Turning | None:
    """Compare the rotation of a fixed vector (gravity, field) with the gyroscope; None if there is too little rotation or agreement."""
    if gyro.shape[1] != 3 or vector.shape[1] != 3 or len(gyro) < 50 or not np.isfinite(period) or period <= 0:
        return None
    gyro, vector = gyro[:PIECE], vector[:PIECE]
    width = int(np.clip(round(0.1 / period), 1, len(gyro) // 20))
    count = len(gyro) // width
    shape = (count, width, 3)
    rate, held = gyro[: count * width].reshape(shape).mean(axis=1), vector[: count * width].reshape(shape).mean(axis=1)
    length = np.linalg.norm(held, axis=1, keepdims=True)
    whole = np.isfinite(length[:, 0]) & (length[:, 0] > 0)
    # a rotation of less than 6 degrees rms could be noise
    if not whole.any() or np.linalg.norm(np.mean(held[whole] / length[whole], axis=0)) > 0.995:
        return None
    # between blocks the vector rotates with the mean of both rates
    turned = held[1:] - held[:-1]
    stated = -np.cross(0.5 * (rate[1:] + rate[:-1]), 0.5 * (held[1:] + held[:-1])) * (width * period)
    good = np.isfinite(turned).all(axis=1) & np.isfinite(stated).all(axis=1)
    turned, stated = turned[good].ravel(), stated[good].ravel()
    if len(turned) < 60:
        return None
    # leave out shocks, so that a few of them do not determine the result
    limit = 20 * np.median(np.abs(turned)) + 1e-12
    kept = np.abs(turned) < max(limit, float(np.quantile(np.abs(turned), 0.99)))
    turned, stated = turned[kept], stated[kept]
    power, own, common = float(stated @ stated), float(turned @ turned), float(stated @ turned)
    if not power or not own:
        return None
    correlation = common / np.sqrt(power * own)
    if abs(correlation) < max(0.35, 8 / np.sqrt(len(turned))):
        return None
    return Turning(common / power, correlation)


def gravity_stays(accel: np.ndarray, period: float | None) -> float:
    """Share of the vectors' magnitude that remains after averaging over a second: near 1 with gravity, small without it.

    Vectors of nearly constant magnitude contain gravity however fast they rotate; for them the function returns 1.
    """
    found = norms(accel)
    if len(found) and np.ptp(np.quantile(found, [0.25, 0.75])) < 0.35 * np.median(found):
        return 1.0
    width = int(np.clip(round(1.0 / period) if period and np.isfinite(period) else 50, 2, max(2, len(accel) // 4)))
    count = len(accel) // width
    if not count:
        return np.nan
    blocks = accel[: count * width].reshape(count, width, -1)
    means = np.linalg.norm(blocks.mean(axis=1), axis=1)
    means, median = means[np.isfinite(means)], median_norm(accel)
    return float(np.median(means) / median) if len(means) and median else np.nan


def field_size(values: np.ndarray) -> tuple[float, str]:
    """Radius of a sphere fitted to the vectors, or their median magnitude if they cover too little of a sphere; and which of the two."""
    seen = thinned(values)
    if len(seen) > 5000:
        seen = seen[:: len(seen) // 5000]
    if values.shape[1] == 3 and len(seen) > 10:
        centred = seen - seen.mean(axis=0)
        size = np.sqrt(np.mean(np.sum(centred**2, axis=1)))
        unit = centred / size if 0 < size < np.inf else np.zeros_like(centred)
        scatter = unit.T @ unit / len(unit)
        if np.linalg.eigvalsh(scatter)[0] > 0.1**2:
            # |v|^2 = 2 c.v + r^2 - |c|^2 is linear in c and the constant; the mean of v is zero, and that of |v|^2 one
            middle = np.linalg.solve(2.0 * scatter, np.sum(unit**2, axis=1) @ unit / len(unit))
            radius = np.sqrt(1.0 + middle @ middle)
            # noise fills the sphere instead of lying on its surface
            lies = np.std(np.linalg.norm(unit - middle, axis=1)) < 0.25 * radius
            # a radius much smaller than the vectors is the noise of a sensor at rest
            if lies and size * radius > 0.05 * np.median(np.linalg.norm(seen, axis=1)):
                return float(size * radius), "sphere radius"
    return median_norm(values), "median norm"
