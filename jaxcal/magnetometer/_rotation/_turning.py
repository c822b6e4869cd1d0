"""`hard_iron_by_turning`: hard iron from a few turns with a gyroscope, without readings in all directions."""

from typing import Any

import equinox as eqx
import numpy as np

from ..._errors import DataError
from ..._precision import host_float64
from ..._types import AnyArray
from ._align import SEGMENT, array, like
from ._segments import attitudes_in_segments


class HardIron(eqx.Module):
    """Hard iron from turns.

    Attributes
    ----------
    hard_iron : (3,) in the unit of the readings.
    covariance : (3, 3) of it.
    noise : standard deviation of one axis of a reading, in its unit.
    used : number of readings that were fitted.
    """

    hard_iron: AnyArray
    covariance: AnyArray
    noise: float
    used: int


@host_float64
def hard_iron_by_turning(m: Any, gyro: Any, rate: float | int, *, soft_iron: Any = None, fastest: float | int = 0.3) -> HardIron:
    r"""Hard iron alone, from turns whose rates are known.

    In a field that stands still :math:`\dot m = -\omega \times (m - b)` for a sensor without soft iron, which is linear in b. Here
    it is integrated over segments of 2 rad: the readings turned back to the segment's first axes differ by the turned offset only,

    .. math:: R_k C^{-1}(m_k - b) = h \quad\text{for all } k \text{ of a segment.}

    Parameters
    ----------
    m : (n, 3) readings.
    gyro : (n, 3) rates at the same times, rad/s.
    rate : readings per second.
    soft_iron : (3, 3) known soft iron; None for none.
    fastest : segments in which the rate never exceeds this, rad/s, are left out.

    Returns
    -------
    HardIron

    Raises
    ------
    DataError
        If shapes differ, or the turns are about one axis only, which leaves the offset along it open.

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
    number, member = np.unique(segment[kept], return_inverse=True)
    columns = attitude[kept] @ matrix
    values = np.einsum("nij,nj->ni", columns, m[kept])
    count = np.bincount(member)

    def centred(x: np.ndarray) -> np.ndarray:
        total = np.zeros((len(number), *x.shape[1:]))
        np.add.at(total, member, x)
        return x - (total / count.reshape(-1, *[1] * (x.ndim - 1)))[member]

    columns, values = centred(columns).reshape(-1, 3), centred(values).ravel()
    size = np.linalg.svd(columns, compute_uv=False) / np.sqrt(len(values))
    if size[-1] < 1e-3:
        raise DataError("The turns are about one axis and leave the hard iron along it open; turn the sensor about a second axis.")
    offset = np.linalg.lstsq(columns, values, rcond=None)[0]
    free = max(len(values) - 3 * len(number) - 3, 1)
    variance = float(np.sum((values - columns @ offset) ** 2) / free)
    return HardIron(offset, variance * np.linalg.inv(columns.T @ columns), float(np.sqrt(variance)), int(kept.sum()))
