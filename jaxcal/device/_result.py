"""`DeviceFit`: the calibration of a device from one recording, with its uncertainty."""

import math

import equinox as eqx
import numpy as np

from .._answer import Finding, Number, Quantity, Result, Section, by_axis, listed, verdict_of
from .._special import student_quantile
from .._types import AnyArray
from ..fitting import Estimate
from ..imu._observability import PLACES
from ._findings import SENSORS
from ._model import DeviceModel

_TITLES = {"accel": "accelerometer", "gyro": "gyroscope", "magnetometer": "magnetometer"}
#: parameters of the tables of the sensors
_PARTS = {"accel": ("accel.*", "lever*"), "gyro": ("gyro.*", "gyro_delay"), "magnetometer": ("magnetometer.*", "field", "mag_delay")}
_LABELS = {"gyro_delay": "delay", "mag_delay": "delay", "field": "Earth's field"} | dict.fromkeys(_TITLES, "left out / noise")


class DeviceFit(Result):
    """A device calibrated from one recording by hand.

    Attributes
    ----------
    model : `DeviceModel`. A parameter that the recording does not determine has the value of a sensor without errors.
    estimate : `jaxcal.fitting.Estimate` of the parameters, by their path in the model. A parameter that the recording does not determine is
        "open", one that a convention or an option fixes is "held". Without `noise`, a bias is the mean over the recording.
    disturbed : (start, stop) in s of stretches whose magnetic field the fit left out, or gave less than half of its weight.
    rests : (start, stop) in s of the detected rests.
    noise : densities of "gyro" (rad/sqrt(s)) and "accel" (m/s/sqrt(s)), medians over the windows, and the standard deviation of the
        residuals of "mag", T.
    reach, speed : standard deviations of the hand's position (m) and velocity (m/s).
    held_out : sensor -> rms residual in units of its noise, when the parameters for each sixth of the recording come from the other five.
        About 1 or less if the others predict a sixth within the noise; NaN if they do not determine the parameters.
    disagreement : variance between sixths of the recording, divided by the variance that the noise explains.
    time : (k,) s of the ends of the windows.
    attitude : (k, 3, 3) rotation from the device to the world; velocity, place : (k, 3) velocity and position, m/s and m, at these times.
    residual_inertial : (k - 1, 9) residuals of rotation, velocity and position of each window, in standard deviations.
    residual_field : (k - 1, 3) rms field residual of each axis in each window, T.
    gravity, rate, duration : m/s^2, Hz, s.

    Examples
    --------
    >>> import jaxcal
    >>> log, true, _ = jaxcal.device.simulate(60.0, 50.0, seed=1)
    >>> found = jaxcal.device.fit(log)
    >>> error = found.model.gyro.bias - true.gyro.bias
    >>> bool(abs(error).max() < 5e-4), found.estimate["gyro.bias[0]"].unit, found.verdicts["gyro"]
    (True, 'rad/s', 'good')
    """

    findings: tuple[Finding, ...] = eqx.field(static=True)
    model: DeviceModel
    estimate: Estimate
    disturbed: tuple[tuple[float, float], ...]
    rests: tuple[tuple[float, float], ...]
    noise: dict[str, float]
    reach: float
    speed: float
    disagreement: float
    held_out: dict[str, float]
    time: AnyArray
    attitude: AnyArray
    velocity: AnyArray
    place: AnyArray
    residual_inertial: AnyArray
    residual_field: AnyArray
    gravity: float
    rate: float
    duration: float

    @property
    def verdicts(self) -> dict[str, str]:
        """Sensor -> its verdict, the worst finding about it: "good", "weak" or "refused"."""
        return {sensor: verdict_of([one for one in self.findings if sensor in one.subject]) for sensor in SENSORS}

    @property
    def usable(self) -> bool:
        """Whether at least one sensor is not refused."""
        return set(self.verdicts.values()) != {"refused"}

    @property
    def headline(self) -> str:
        """How exact the sensors are, at 95 %: accelerometer at 1 g, bias of the gyroscope, and headings of a level device."""
        errors = _errors(self.estimate, self.model, self.gravity)
        known = [f"{_TITLES.get(name, name)} to {one.shown():.2g}" for name, one in errors.items() if math.isfinite(one.value)]
        return ", ".join(known) if known else "no sensor is determined"

    def sections(self) -> list[Section]:
        """Tables of the sensors; in detail, of noise and motion."""
        left = {sensor: [Number(f"held_out.{sensor}", value)] if math.isfinite(value) else [] for sensor, value in self.held_out.items()}
        tables: list[Section] = [
            by_axis(sensor, _TITLES[sensor], self.estimate.select(*parts).numbers() + left[sensor], _LABELS)
            for sensor, parts in _PARTS.items()
        ]
        unit = self.estimate.quantity("field")
        facts = [
            ("dip of the field", self.estimate["dip"]),
            ("noise of the accelerometer", Number("noise.accel", self.noise["accel"], quantity="N.accel")),
            ("noise of the gyroscope", Number("noise.gyro", self.noise["gyro"], quantity="N.gyro")),
            ("residuals of the magnetometer, rms", Number("noise.mag", self.noise["mag"], quantity=unit)),
            ("reach of the hand, rms", Number("reach", self.reach, quantity="length")),
            ("speed of the hand, rms", Number("speed", self.speed, quantity="speed")),
            ("disagreement of the sixths, variance", Number("disagreement", self.disagreement)),
        ]  # fmt: skip
        return [*tables, listed("recording", "noise and motion", facts, detail=True)]


def _errors(estimate: Estimate, model: DeviceModel, gravity: float) -> dict[str, Quantity]:
    """Half of the 95 % interval: of a corrected reading of 1 g, of the gyroscope's bias, and of the heading of a level device.

    NaN for a sensor with an open parameter.
    """
    names, freedom = estimate.names, float(np.min(estimate.freedom))
    reach = float(np.ravel(student_quantile(np.array([freedom]), 0.975))[0])
    held = np.array([estimate.states.get(name) == "held" for name in names])
    matrix = np.where(held[:, None] | held, 0.0, np.asarray(estimate.matrix))
    matrix[np.isinf(matrix)] = np.nan

    def half(slopes: list[dict[str, float]], how: str) -> float:
        rows = np.array([[slope.get(name, 0.0) for name in names] for slope in slopes])
        used = np.any(rows != 0, axis=0)
        variance = np.einsum("kp,pq,kq->k", rows[:, used], matrix[np.ix_(used, used)], rows[:, used])
        return reach * float(np.sqrt(variance.max() if how == "worst" else variance.mean()))

    faces = [{f"accel.matrix[{i},{j}]": sign * gravity, f"accel.bias[{i}]": 1.0} for i in range(3) for j in range(3) for sign in (-1, 1)]
    up = np.array([0.0, 0.0, 1.0])
    iron, level = (np.linalg.inv(np.asarray(one)) for one in (model.magnetometer.soft_iron, model.accel.matrix))
    across, down = math.cos(model.dip), math.sin(model.dip)
    slopes = []
    for north in PLACES[PLACES[:, 2] == 0]:  # eight headings of a level device
        west, h = np.cross(up, north), float(model.field) * (across * north - down * up)
        # the heading turns with the field across it, and with the tilt of the vertical
        field, tilt = -west @ iron / (float(model.field) * across), -west @ level / gravity * down / across
        slope = {f"magnetometer.soft_iron[{i},{j}]": field[i] * h[j] for i in range(3) for j in range(3)}
        slope |= {f"magnetometer.hard_iron[{i}]": field[i] for i in range(3)} | {f"accel.bias[{i}]": tilt[i] for i in range(3)}
        slopes.append(slope | {f"accel.matrix[{i},2]": tilt[i] * gravity for i in range(3)})
    biases = [{f"gyro.bias[{i}]": 1.0} for i in range(3)]
    return {
        "accel": Quantity(half(faces, "worst"), "accel"), "gyro": Quantity(half(biases, "worst"), "gyro"),
        "headings": Quantity(half(slopes, "rms"), "angle"),
    }  # fmt: skip
