"""Rotations integrated from rates; and `hard_iron_by_turning`, which needs a few turns only, not readings in all directions."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import DataError
from ..._precision import host_float64
from ..._types import AnyArray
from ...fitting import information

SEGMENT = 2.0  # rad travelled in one segment: the error of rates with a slightly wrong scale grows with the angle
_LONGEST = 10.0  # longest segment in s, because the bias of the rates enters to first order only


def array(values: Any, name: str) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise DataError(f"The {name} have shape {values.shape}; expected (n, 3), one row per reading.")
    return values


def like(values: Any, y: np.ndarray, name: str) -> np.ndarray:
    values = array(values, name)
    if len(values) != len(y):
        raise DataError(f"There are {len(y)} readings and {len(values)} rows of {name}; give one for each reading.")
    return values


def permutations() -> np.ndarray:
    """The 24 rotations that exchange axes, (24, 3, 3), the identity first."""
    found = scipy.spatial.transform.Rotation.create_group("O").as_matrix().round()
    return found[np.argsort(-np.trace(found, axis1=1, axis2=2), kind="stable")]


def delayed(gyro: np.ndarray, samples: float) -> np.ndarray:
    """Rates `samples` samples earlier, with linear interpolation; at the edge of a gap the rate of the sample itself."""
    if samples == 0:
        return gyro
    place = np.arange(len(gyro)) - samples
    first = np.clip(np.floor(place).astype(int), 0, max(len(gyro) - 2, 0))
    share = np.clip(place - first, 0.0, 1.0)[:, None]
    earlier = (1 - share) * gyro[first] + share * gyro[np.minimum(first + 1, len(gyro) - 1)]
    return np.where(np.isfinite(earlier) & np.isfinite(gyro), earlier, gyro)


def attitudes_in_segments(gyro: np.ndarray, rate: float, most: float, delay: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Attitude of each reading relative to the first of its segment, from rates (n, 3) at the times of the samples.

    A reading shows the field `delay` seconds before the sample of the rates beside it.

    A segment ends when the angle travelled reaches `most` rad, after 10 s, or at a NaN sample, which belongs to no segment. Returns the
    segment number (n,), -1 for none; the attitude (n, 3, 3), from the body axes of the sample to those of the segment's first sample; and
    the derivative (n, 3, 4) of the rotation vector, in the axes of the sample, with respect to a bias of the rates and the delay.
    """
    gyro = delayed(gyro, delay * rate)
    n, good = len(gyro), np.asarray(np.isfinite(gyro).all(axis=1))
    step = np.where(good[1:, None] & good[:-1, None], (gyro[1:] + gyro[:-1]) / 2 / rate, 0.0)
    travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
    broken = np.concatenate([[0], np.cumsum(~(good[1:] & good[:-1]))])
    label = broken * (int(travelled[-1] / most) + 1) + (travelled / most).astype(int)
    long = np.arange(1, n) % max(int(_LONGEST * rate), 2) == 0
    start = np.flatnonzero(np.concatenate([[True], (np.diff(label) != 0) | long]))
    segment = np.repeat(np.arange(len(start)), np.diff(np.append(start, n)))
    place = np.arange(n) - start[segment]
    small = scipy.spatial.transform.Rotation.from_rotvec(step).as_matrix() if n > 1 else np.zeros((0, 3, 3))
    attitude, slope = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3, 3))
    # take one step in all segments at a time
    order = np.argsort(place, kind="stable")
    for k in np.split(order, np.flatnonzero(np.diff(place[order])) + 1)[1:]:
        attitude[k] = attitude[k - 1] @ small[k - 1]
        back = np.swapaxes(small[k - 1], 1, 2)
        slope[k] = back @ slope[k - 1] + (np.eye(3) + back) / (2 * rate)
    return np.where(good, segment, -1), attitude, np.concatenate([slope, np.where(good[:, None], gyro, 0.0)[:, :, None]], axis=2)


def centred(x: np.ndarray, member: np.ndarray) -> np.ndarray:
    """Rows minus the mean of their segment."""
    total, count = np.zeros((member.max() + 1, *x.shape[1:])), np.bincount(member)
    np.add.at(total, member, x)
    return x - (total / count.reshape(-1, *[1] * (x.ndim - 1)))[member]


class HardIron(eqx.Module):
    """Hard iron from turns, as `hard_iron_by_turning` finds it.

    Attributes
    ----------
    hard_iron : (3,) in the unit of the readings.
    covariance : (3, 3) covariance of the hard iron.
    noise : standard deviation of one axis of a reading, in its unit.
    used : number of readings that were fitted.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, hard_iron_by_turning
    >>> t = np.arange(0, 4, 0.01)
    >>> still, one = 0 * t, 1 + 0 * t
    >>> yaw, roll = (body_field(np.stack(angles, 1), 50.0) for angles in ((t, still, still), (still, still, t)))
    >>> gyro = np.concatenate([np.stack([still, still, one], 1), [[np.nan] * 3], np.stack([one, still, still], 1)])
    >>> found = hard_iron_by_turning(np.concatenate([yaw, yaw[:1], roll]) + [5.0, -3.0, 8.0], gyro, 100.0)
    >>> print(found.hard_iron.round(2), found.covariance.shape)
    [ 5. -3.  8.] (3, 3)
    """

    hard_iron: AnyArray
    covariance: AnyArray
    noise: float
    used: int


@host_float64
def hard_iron_by_turning(m: Any, gyro: Any, rate: float | int, *, soft_iron: Any = None, fastest: float | int = 0.3) -> HardIron:
    r"""Hard iron alone, from turns with known rates.

    In a constant field, :math:`\dot m = -\omega \times (m - b)` for a sensor without soft iron, which is linear in b. Here the equation
    is integrated over segments of 2 rad. After rotation to the first axes of the segment, readings differ by the rotated offset only,

    .. math:: R_k C^{-1}(m_k - b) = h \quad\text{for all } k \text{ of a segment.}

    Parameters
    ----------
    m : (n, 3) readings.
    gyro : (n, 3) rates at the same times, rad/s.
    rate : readings per second.
    soft_iron : (3, 3) known soft iron; None means no soft iron.
    fastest : rate in rad/s that a segment must exceed at least once; other segments are left out.

    Returns
    -------
    HardIron

    Raises
    ------
    DataError
        If the shapes differ, or all turns are about one axis, which does not determine the hard iron along that axis.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, hard_iron_by_turning
    >>> t = np.arange(0, 4, 0.01)
    >>> still, one = 0 * t, 1 + 0 * t
    >>> yaw = body_field(np.stack([t, still, still], 1), 50.0)           # 1 rad/s about z
    >>> roll = body_field(np.stack([still, still, t], 1), 50.0)          # and then about x
    >>> gyro = np.concatenate([np.stack([still, still, one], 1), [[np.nan] * 3], np.stack([one, still, still], 1)])
    >>> m = np.concatenate([yaw, yaw[:1], roll]) + [5.0, -3.0, 8.0]
    >>> print(hard_iron_by_turning(m, gyro, 100.0).hard_iron.round(2))
    [ 5. -3.  8.]

    References
    ----------
    G. Troni and L. L. Whitcomb, IEEE Trans. Control Syst. Technol. 28 (2020) 1415 (the differential form).
    """
    m = array(m, "readings")
    gyro = like(gyro, m, "rates")
    if not rate > 0:
        raise DataError("The gyroscope is integrated: give `rate`, the readings per second.")
    matrix = np.eye(3) if soft_iron is None else np.linalg.inv(np.asarray(soft_iron, dtype=float))
    segment, attitude, _ = attitudes_in_segments(gyro, float(rate), SEGMENT)
    moving = np.unique(segment[(np.linalg.norm(gyro, axis=1) > fastest) & (segment >= 0)])
    kept = np.isin(segment, moving) & np.isfinite(m).all(axis=1)
    if kept.sum() < 5:
        raise DataError(f"{int(kept.sum())} readings were taken while turning faster than {fastest:g} rad/s; turn the sensor.")
    member = np.unique(segment[kept], return_inverse=True)[1]
    columns = attitude[kept] @ matrix
    values = centred(np.einsum("nij,nj->ni", columns, m[kept]), member).ravel()
    columns = centred(columns, member).reshape(-1, 3)
    size = np.linalg.svd(columns, compute_uv=False) / np.sqrt(len(values))
    if size[-1] < 1e-3:
        raise DataError("The turns are about one axis and leave the hard iron along it open; turn the sensor about a second axis.")
    offset = np.linalg.lstsq(columns, values, rcond=None)[0]
    free = max(len(values) - 3 * (member.max() + 1) - 3, 1)
    variance = float(np.sum((values - columns @ offset) ** 2) / free)
    return HardIron(offset, variance * information(columns).covariance, float(np.sqrt(variance)), int(kept.sum()))
