"""`DeviceFit`: the calibration of a device from one recording, with its uncertainty."""

from typing import Any

import equinox as eqx
import numpy as np

from .._results import Result, Row
from .._types import AnyArray
from ._model import DeviceModel

_UNITS = {
    "accel.bias": "m/s^2", "gyro.bias": "rad/s", "gyro.g_sensitivity": "rad/s per m/s^2", "magnetometer.hard_iron": "T", "field": "T",
    "dip": "rad", "gyro_delay": "s", "mag_delay": "s", "lever": "m",
}  # fmt: skip


class DeviceFit(Result):
    """A device calibrated from one recording by hand.

    Attributes
    ----------
    model : `DeviceModel`. A parameter that the recording does not determine has the value of a sensor without errors, and is listed in
        `undetermined`.
    names : names of the p fitted parameters, by their path in the model.
    values : (p,) their values; NaN, and None in a file, if the recording does not determine the parameter.
    covariance : (p, p) covariance of the values, with infinite variance of a parameter that is not determined.
    interval : (p, 2) limits of the 95 % intervals. Without `noise`, the interval of a bias is for its mean over the recording.
    degrees_of_freedom : of the scale of the covariance; infinite if parts of the recording agree within the noise.
    undetermined : names of the parameters that the recording does not determine.
    verdicts : sensor ("accel", "gyro", "magnetometer") -> "good", "weak" or "refused".
    disturbed : (start, stop) in s of stretches whose magnetic field the fit left out, or gave less than half of its weight.
    rests : (start, stop) in s of the detected rests.
    noise : densities of "gyro" (rad/sqrt(s)) and "accel" (m/s/sqrt(s)), medians over the windows, and the standard deviation of the
        residuals of "mag", T.
    reach, speed : standard deviations of the hand's position (m) and velocity (m/s).
    held_out : sensor -> rms residual in units of its noise, when the parameters for each sixth of the recording come from the other five.
        About 1 or less if the others predict a sixth within the noise; NaN if they do not determine the parameters.
    derivatives : name of a parameter -> sensor ("accel", "gyro", "mag") -> (n, 3) derivative of its value by every reading, for the names
        given to `fit`; zero for a missing reading. They hold noise levels, weights of windows, rests, and reach and speed of the hand
        constant. For this least-squares problem they are exact to 1e-4. A fit to other readings also updates
        what is constant here; in simulations this moved the parameters by less than 0.03 standard errors.
    disagreement : variance between sixths of the recording, divided by the variance that the noise explains.
    time : (k,) s of the ends of the windows.
    attitude : (k, 3, 3) rotation from the device to the world; velocity, place : (k, 3) velocity and position, m/s and m, at these times.
    residual_inertial : (k - 1, 9) residuals of rotation, velocity and position of each window, in standard deviations.
    residual_field : (k - 1, 3) rms field residual of each axis in each window, T.
    gravity, rate, duration : m/s^2, Hz, s.
    contribution : kind of motion ("rests", "slow turns", "fast turns") -> (p,) its share in the information on each parameter. The shares
        of a parameter add up to one.
    verdict : "good", "weak" or "refused": the verdict on the worst sensor.
    reason : one or more sentences that explain the verdict. warnings : sentences.

    Examples
    --------
    >>> import jaxcal
    >>> log, true, _ = jaxcal.device.simulate(60.0, 50.0, seed=1)
    >>> found = jaxcal.device.fit(log)
    >>> error = found.model.gyro.bias - true.gyro.bias
    >>> bool(abs(error).max() < 5e-4)
    True
    """

    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    model: DeviceModel
    names: tuple[str, ...] = eqx.field(static=True)
    values: AnyArray
    covariance: AnyArray
    interval: AnyArray
    degrees_of_freedom: float
    undetermined: tuple[str, ...] = eqx.field(static=True)
    verdicts: dict[str, str] = eqx.field(static=True)
    disturbed: tuple[tuple[float, float], ...]
    rests: tuple[tuple[float, float], ...]
    noise: dict[str, float]
    reach: float
    speed: float
    disagreement: float
    held_out: dict[str, float]
    derivatives: dict[str, dict[str, AnyArray]]
    time: AnyArray
    attitude: AnyArray
    velocity: AnyArray
    place: AnyArray
    residual_inertial: AnyArray
    residual_field: AnyArray
    gravity: float
    rate: float
    duration: float
    contribution: dict[str, AnyArray]

    @property
    def standard_error(self) -> np.ndarray:
        """(p,) standard errors: square roots of the diagonal of the covariance."""
        return np.sqrt(np.diag(self.covariance))

    def _rows(self) -> list[Row]:
        units = [_UNITS.get(name.partition("[")[0], "") for name in self.names]
        rows = zip(self.names, self.values, self.interval, units, strict=True)
        known = [Row(name, value, low, high, unit) for name, value, (low, high), unit in rows if np.isfinite(value)]
        return known + [Row(f"held_out.{sensor}", value) for sensor, value in self.held_out.items() if np.isfinite(value)]


def gauged(
    vector: np.ndarray, free: np.ndarray, names: tuple[str, ...], strength: float, field: float | None
) -> tuple[dict[str, Any], np.ndarray]:
    """Soft iron, hard iron and field in the unit of the readings, and derivative (p + 1, p) of (parameters, field) by the free parameters.

    Within the fit the field has magnitude 1, and readings are divided by `strength`. In the result det C = 1, or the field is given.
    """
    iron = vector[42:51].reshape(3, 3)
    root = np.cbrt(np.linalg.det(iron)) if field is None else field / strength
    inverse = np.linalg.inv(iron).T.ravel() / 3
    where = {name: i for i, name in enumerate(names)}
    slope = np.zeros((len(free) + 1, len(free)))
    slope[:-1] = np.eye(len(free))
    soft = [where[f"magnetometer.soft_iron[{i},{j}]"] for i in range(3) for j in range(3)]
    hard = [where[f"magnetometer.hard_iron[{i}]"] for i in range(3)]
    own = np.eye(9) / root
    if field is None:
        own -= np.outer(iron.ravel(), inverse) / root
        slope[-1, soft] = strength * root * inverse
    slope[np.ix_(soft, soft)] = own
    slope[hard, hard] = strength
    return {"soft_iron": iron / root, "hard_iron": strength * vector[51:54], "field": strength * root}, slope
