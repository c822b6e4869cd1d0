"""`vibration_rectification`: the bias caused by vibration, from a log on a shaker."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Grid, Message, Number, Result, Section, joined_names
from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from .._units import STANDARD_GRAVITY
from ..fitting import Estimate
from ._findings import FINDINGS

_LEAST = 12  # windows
_RANGE = 4.0  # least ratio of the vibration power in the strongest window to that in the quietest
_NAMES = {"gyro": "gyroscope", "accel": "accelerometer"}
#: sensor -> unit of data sheets, and how many of it are one reading per (m/s^2)^2
_UNITS = {"accel": ("ug/g^2", 1e6 * STANDARD_GRAVITY), "gyro": ("deg/h/g^2", STANDARD_GRAVITY**2 * 3600 * 180 / np.pi)}


class Rectification(Result):
    """Shift of the mean readings of accelerometer and gyroscope by vibration.

    Attributes
    ----------
    estimate : `jaxcal.fitting.Estimate` of "gyro_x" to "accel_z": reading per (m/s^2)^2 of mean square vibration.
    power : (k,) mean square of the vibration in every window, (m/s^2)^2, summed over the three axes.
    mean : (k, 6) mean readings of every window.
    findings : what to know about the test; the worst one gives the `verdict`.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng, level = np.random.default_rng(0), np.repeat([0.0, 5.0, 10.0, 0.0], 3000)
    >>> shaken = level[:, None] * rng.normal(size=(12000, 3)) * [0, 0, 1]
    >>> force = [0, 0, 9.81] + shaken + 1e-5 * shaken**2 + 0.01 * rng.normal(size=(12000, 3))
    >>> found = jaxcal.imu.vibration_rectification(jaxcal.Log(None, accel=force, rate=200.0))
    >>> found.estimate.names, found.verdict
    (('accel_x', 'accel_y', 'accel_z'), 'weak')
    """

    estimate: Estimate
    power: AnyArray
    mean: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def shifted(self) -> list[str]:
        """Channels whose shift exceeds its interval."""
        return [one.name for one in self.estimate.numbers() if one.low > 0 or one.high < 0]

    @property
    def headline(self) -> str:
        """The strongest vibration, and the axes that it shifts."""
        strongest = np.sqrt(np.max(self.power)) / STANDARD_GRAVITY
        return f"vibration of up to {strongest:.3g} g rms shifts {joined_names(self.shifted) or 'no axis'}"

    def sections(self) -> list[Section]:
        """The coefficient of every axis, in the units of data sheets."""
        cells = {}
        for one in self.estimate.numbers():
            sensor = one.name.partition("_")[0]
            unit, factor = _UNITS[sensor]
            value, low, high = (factor * float(x) for x in (one.value, one.low, one.high))
            cells.setdefault(_NAMES[sensor], []).append(Number(one.name, value, low, high, unit))
        return [
            Grid("rectification", "shift of the bias by vibration", tuple("xyz"), tuple((name, tuple(row)) for name, row in cells.items()))
        ]


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
    >>> print(found.estimate["accel_z"].low < 1e-5 < found.estimate["accel_z"].high)
    True

    References
    ----------
    IEEE Std 1293-1998, annex on vibration rectification; H. G. MacKinnon and H. White, J. Econometrics 29 (1985) 305 (HC3).
    """
    if getattr(log, "accel", None) is None or np.ndim(log.accel) != 2 or np.shape(log.accel)[1] != 3:
        raise DataError("The log has no accelerometer with three axes, which the vibration is measured with.", code="no_accel")
    accel = np.asarray(log.accel, dtype=float)
    gyro = np.full_like(accel, np.nan) if log.gyro is None else np.asarray(log.gyro, dtype=float)
    size = max(round(float(window) * float(log.rate)), 8)
    count = len(accel) // size
    if count < _LEAST:
        said = Message("the log has {count} windows of {window:g} s, {least} are needed; record longer, or give a shorter {option.window}",
                       count=count, window=float(window), least=_LEAST)  # fmt: skip
        raise DataError(said, code="too_short")
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
        raise DataError(
            f"{len(power)} of {count} windows of {window:g} s have samples enough, {_LEAST} are needed; record without gaps",
            code="too_short",
        )
    if not power.max() > _RANGE * power.min():
        raise DataError(
            f"the vibration hardly changes: {np.sqrt(power.min()):.3g} to {np.sqrt(power.max()):.3g} m/s^2 rms in the windows. "
            "Record the shaker at rest, at one level or more, and at rest again",
            code="steady",
        )
    time = np.linspace(-1, 1, len(power))
    columns = np.stack([np.ones_like(time), time, power / power.max()], axis=1)
    inner = np.linalg.pinv(columns.T @ columns)
    share = np.einsum("ij,jk,ik->i", columns, inner, columns)
    names, values, errors = [], [], []
    for i, name in enumerate(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"):
        if np.isfinite(mean[:, i]).all():
            beta = inner @ columns.T @ mean[:, i]
            left = (mean[:, i] - columns @ beta) / np.maximum(1 - share, 1e-3)
            names.append(name)
            values.append(beta[2] / power.max())
            errors.append(np.sqrt((inner @ (columns.T * left**2) @ columns @ inner)[2, 2]) / power.max())
    found = Rectification(Estimate(names, np.array(values), np.diag(np.square(errors)), len(power) - 3), power, mean)
    return found if found.shifted else dataclasses.replace(found, findings=(FINDINGS("no_shift"),))
