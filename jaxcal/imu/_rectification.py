"""`vibration_rectification`: the bias caused by vibration, from a log on a shaker."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray
from .._units import STANDARD_GRAVITY

_LEAST = 12  # windows
_RANGE = 4.0  # least ratio of the vibration power in the strongest window to that in the quietest
_UNITS = {"accel": ("ug/g^2", 1e6 * STANDARD_GRAVITY), "gyro": ("deg/h/g^2", STANDARD_GRAVITY**2 * 3600 * 180 / np.pi)}


class Rectification(Result):
    """Shift of the mean readings of accelerometer and gyroscope by vibration.

    Attributes
    ----------
    coefficient : (6,) gyroscope x y z, accelerometer x y z: reading per (m/s^2)^2 of mean square vibration; NaN for a missing
        sensor.
    interval : (6, 2) limits of the 95 % confidence intervals.
    power : (k,) mean square of the vibration in every window, (m/s^2)^2, summed over the three axes.
    mean : (k, 6) mean readings of every window.
    verdict : "good", or "weak" if no axis shows a significant shift. reason, warnings : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng, level = np.random.default_rng(0), np.repeat([0.0, 5.0, 10.0, 0.0], 3000)
    >>> shaken = level[:, None] * rng.normal(size=(12000, 3)) * [0, 0, 1]
    >>> force = [0, 0, 9.81] + shaken + 1e-5 * shaken**2 + 0.01 * rng.normal(size=(12000, 3))
    >>> found = jaxcal.imu.vibration_rectification(jaxcal.Log(None, accel=force, rate=200.0))
    >>> found.coefficient.shape, found.verdict
    ((6,), 'weak')
    """

    coefficient: AnyArray
    interval: AnyArray
    power: AnyArray
    mean: AnyArray
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())

    def _rows(self) -> list[Row]:
        rows = []
        for i, (value, (low, high)) in enumerate(zip(self.coefficient, self.interval, strict=True)):
            sensor = "gyro" if i < 3 else "accel"
            unit, factor = _UNITS[sensor]
            rows.append(Row(f"{sensor} {'xyz'[i % 3]}", value * factor, low * factor, high * factor, unit))
        return [row for row in rows if np.isfinite(row.value)]


@host_float64
def vibration_rectification(log: Any, *, window: float | int = 2.0) -> Rectification:
    r"""Estimate the vibration rectification of accelerometer and gyroscope from a log on a shaker at several levels.

    The log is cut into windows. The window means, with a Hann taper, are fitted by least squares with a bias, a linear drift and a term
    proportional to the mean square of the vibration:

    .. math:: \bar y_k = b + d\,t_k + c\,P_k,\qquad P_k = \mathrm{tr}\,\mathrm{cov}(a)_k .

    The covariance (HC3) allows errors of unequal size, because the mean is less certain in a window with more vibration.

    Parameters
    ----------
    log : `jaxcal.Log` with an accelerometer in m/s^2, in one attitude: quiet, then one or more levels of vibration, then quiet again.
        Vibration above the bandwidth of the sensor's filter also shifts the bias, but the log does not show it.
    window : length of a window, s.

    Returns
    -------
    Rectification

    Raises
    ------
    DataError
        If the log has no accelerometer, is shorter than twelve windows, or its vibration hardly changes.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng = np.random.default_rng(0)
    >>> level = np.repeat([0.0, 5.0, 10.0, 0.0], 3000)
    >>> shaken = level[:, None] * rng.normal(size=(12000, 3)) * [0, 0, 1]
    >>> force = [0, 0, 9.81] + shaken + 1e-5 * shaken**2 + 0.01 * rng.normal(size=(12000, 3))
    >>> found = jaxcal.imu.vibration_rectification(jaxcal.Log(None, accel=force, rate=200.0))
    >>> print(bool(found.interval[5, 0] < 1e-5 < found.interval[5, 1]))
    True

    References
    ----------
    IEEE Std 1293-1998, annex on vibration rectification; H. G. MacKinnon and H. White, J. Econometrics 29 (1985) 305 (HC3).
    """
    if getattr(log, "accel", None) is None or np.ndim(log.accel) != 2 or np.shape(log.accel)[1] != 3:
        raise DataError("The log has no accelerometer with three axes, which the vibration is measured with.")
    accel = np.asarray(log.accel, dtype=float)
    gyro = np.full_like(accel, np.nan) if log.gyro is None else np.asarray(log.gyro, dtype=float)
    size = max(round(float(window) * float(log.rate)), 8)
    count = len(accel) // size
    if count < _LEAST:
        raise DataError(f"the log has {count} windows of {window:g} s, {_LEAST} are needed; record longer, or give a shorter window=")
    cut = np.concatenate([gyro, accel], axis=1)[: count * size].reshape(count, size, 6)
    # ignore windows with half of their samples or more missing
    there = np.isfinite(cut[..., 3:]).all(axis=2)
    cut = cut[there.sum(axis=1) * 2 > size]
    there = np.isfinite(cut)
    # taper, so that an incomplete vibration cycle at the end of a window hardly changes its mean
    weight = np.hanning(size + 2)[1:-1, None] * there
    total = np.maximum(weight.sum(axis=1), 1e-12)
    mean = np.where(there.any(axis=1), (weight * np.where(there, cut, 0)).sum(axis=1) / total, np.nan)
    power = np.sum((weight * np.where(there, cut - mean[:, None], 0) ** 2).sum(axis=1)[:, 3:] / total[:, 3:], axis=1)
    if len(power) < _LEAST:
        raise DataError(f"{len(power)} of {count} windows of {window:g} s have samples enough, {_LEAST} are needed; record without gaps")
    if not power.max() > _RANGE * power.min():
        raise DataError(
            f"the vibration hardly changes: {np.sqrt(power.min()):.3g} to {np.sqrt(power.max()):.3g} m/s^2 rms in the windows. "
            "Record the shaker at rest, at one level or more, and at rest again"
        )
    time = np.linspace(-1, 1, len(power))
    columns = np.stack([np.ones_like(time), time, power / power.max()], axis=1)
    inner = np.linalg.pinv(columns.T @ columns)
    share = np.einsum("ij,jk,ik->i", columns, inner, columns)
    coefficient, error = np.full(6, np.nan), np.full(6, np.nan)
    for i in range(6):
        if not np.isfinite(mean[:, i]).all():
            continue
        beta = inner @ columns.T @ mean[:, i]
        left = (mean[:, i] - columns @ beta) / np.maximum(1 - share, 1e-3)
        coefficient[i] = beta[2] / power.max()
        error[i] = np.sqrt((inner @ (columns.T * left**2) @ columns @ inner)[2, 2]) / power.max()
    half = scipy.special.stdtrit(len(power) - 3, 0.975) * error
    interval = np.stack([coefficient - half, coefficient + half], axis=1)
    seen = [f"{'gyro' if i < 3 else 'accel'} {'xyz'[i % 3]}" for i in range(6) if interval[i, 0] > 0 or interval[i, 1] < 0]
    text = f"Vibration of up to {np.sqrt(power.max()) / STANDARD_GRAVITY:.3g} g rms"
    reason = f"{text} shifts {', '.join(seen)}." if seen else f"{text} shifts no axis beyond its interval."
    return Rectification(coefficient, interval, power, mean, "good" if seen else "weak", reason)
