"""`DeviceFit`: a device from one recording, with what is known about it."""

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
    """A device from one recording by hand.

    Attributes
    ----------
    model : `DeviceModel`. A parameter that the recording does not determine has its value without errors
        there, and stands in `undetermined`.
    names : names of the p parameters that were fitted, by their path in the model.
    values : (p,) their values; NaN, and None in a file, for those that the recording does not determine.
    covariance : (p, p) of the values, infinite for those.
    interval : (p, 2) limits of the intervals of 95 %.
    degrees_of_freedom : of the size of the covariance; infinite where parts of the recording agree as their noise says.
    undetermined : names of the parameters that the recording does not determine.
    verdicts : sensor ("accel", "gyro", "magnetometer") -> "good", "weak" or "refused".
    disturbed : (start, stop) in s of stretches whose field the fit left out, or trusted less than half.
    rests : (start, stop) in s of the rests that were found.
    noise : densities of "gyro" (rad/sqrt(s)) and "accel" (m/s/sqrt(s)) that the fit took for the usual window, and the standard deviation
        of what is left of a reading of "mag", T.
    reach, speed : standard deviations of the hand's place (m) and velocity (m/s).
    held_out : sensor -> rms of what it leaves in each sixth of the recording with parameters from the other five, in its noise. At most
        about 1 where the others predict a sixth within the noise; NaN where they do not determine the parameters.
    derivatives : name of a parameter -> sensor ("accel", "gyro", "mag") -> (n, 3) derivative of its value by every reading, for the
        parameters that `fit` was asked for; zero for a missing reading. They are exact (to 1e-4; with `lever` to about 1e-2) for the
        least squares with the noise levels, weights of windows, rests, and the hand's reach and speed that were found. A fit to other
        readings finds these anew, which moved the parameters by less than 0.03 standard errors in simulations.
    disagreement : variance with which sixths of the recording disagree, over that which their noise explains.
    time : (k,) s of the ends of the windows.
    attitude : (k, 3, 3) rotation from the device to the world; velocity, place : (k, 3), m/s and m, at these times.
    residual_inertial : (k - 1, 9) what rotation, velocity and place of each window leave, in standard deviations.
    residual_field : (k - 1, 3) rms of each axis of the field that is left in each window, T.
    gravity, rate, duration : m/s^2, Hz, s.
    contribution : kind of motion ("rests", "slow turns", "fast turns") -> (p,) its share in what is known of each parameter. The shares
        of a parameter add up to one.
    verdict : "good", "weak" or "refused", that of the worst sensor.
    reason : a sentence or more. warnings : sentences.

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
        """(p,) roots of the diagonal of the covariance."""
        return np.sqrt(np.diag(self.covariance))

    def _rows(self) -> list[Row]:
        units = [_UNITS.get(name.partition("[")[0], "") for name in self.names]
        rows = zip(self.names, self.values, self.interval, units, strict=True)
        known = [Row(name, value, low, high, unit) for name, value, (low, high), unit in rows if np.isfinite(value)]
        return known + [Row(f"held_out.{sensor}", value) for sensor, value in self.held_out.items() if np.isfinite(value)]


def gauged(
    vector: np.ndarray, free: np.ndarray, names: tuple[str, ...], strength: float, field: float | None
) -> tuple[dict[str, Any], np.ndarray]:
    """Iron, hard iron and field in the unit of the readings, and the derivative (p + 1, p) of (parameters, field) by the free ones.

    Within the fit the field has the strength one, and readings are divided by `strength`. Outside of it det C = 1, or the field is given.
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
