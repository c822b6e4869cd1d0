"""Inertial sensors and magnetometer in a calibration: the models, with their uncertainty and verdicts."""

import dataclasses
import inspect
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used
from jaxtyping import Float

from .._errors import DataError
from .._types import AnyArray
from .._units import BEYOND, si_unit
from ..device import DeviceFit
from ..fitting import Estimate
from ..imu import ImuFit, Nonlinear, RateTest, ThermalTriad, Triad
from ..magnetometer import MagFit, MagModel
from ._codec import check_finite, checked_unit, document_of, numbers, required, structured, wrong

M = TypeVar("M", bound=eqx.Module)
_CONDITION = 1e10  # of a matrix; above it the inverse is rounding errors
#: unit of a magnetometer that was calibrated in its own steps
COUNTS = "counts"
_SHAPES = {"matrix": (3, 3), "bias": (3,), "g_sensitivity": (3, 3), "soft_iron": (3, 3), "hard_iron": (3,)}
SENSORS = ("accel", "gyro")
#: files name the classes of models; those of jaxcal must be known before a file is read
KNOWN = (Triad, Nonlinear, ThermalTriad, MagModel)


class Part(eqx.Module, Generic[M]):
    """The model of a sensor, with its uncertainty and verdict.

    Attributes
    ----------
    model : a `Triad` or `MagModel`, or a subclass with more fields.
    unit : SI unit of the readings; for a magnetometer also "counts".
    estimate : the fitted parameters by name ("matrix[0,1]", "bias[2]", "field") with their covariance; None if it is not known.
    field : for a magnetometer, the magnitude of the corrected field in its unit; None if unknown.
    verdict, verdict_reason : verdict on the fit, and its reason; None without a fit. For an IMU, `Imu` holds them for both sensors.
    currents : for a magnetometer, name -> (3,) field per unit of a current; None if none was fitted.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> device = jaxcal.Calibration(magnetometer=jaxcal.magnetometer.MagModel(np.eye(3), np.array([1e-5, 0.0, 0.0])))
    >>> device.magnetometer.unit, device.magnetometer.model.hard_iron.tolist()
    ('T', [1e-05, 0.0, 0.0])
    """

    model: M
    unit: str
    field: float | None = None
    estimate: Estimate | None = None
    verdict: str | None = None
    verdict_reason: str | None = None
    currents: dict[str, AnyArray] | None = None

    @property
    def base(self) -> type:
        """The jaxcal class of the model, or the one that it derives from."""
        return MagModel if isinstance(self.model, MagModel) else Triad

    @property
    def parameters(self) -> dict[str, float]:
        """Numbers of the model by name: "matrix[0,1]", "bias[2]", and the fields of a subclass by their names."""
        found = {}
        for name, value in _leaves(document_of(self.model, self.base, "model")):
            values = np.asarray(value, dtype=float)
            for entry in np.ndindex(values.shape):
                found[name + (f"[{','.join(map(str, entry))}]" if entry else "")] = float(values[entry])
        return found

    @property
    def further(self) -> list[str]:
        """Names of the parameters that only a subclass has."""
        return [name for name in self.parameters if name.partition("[")[0] not in _SHAPES]

    def spread(self, names: Iterable[str]) -> AnyArray | None:
        """Covariance of the named parameters in the given order; None if one is not known or not finite."""
        wanted = list(names)
        if self.estimate is None or not all(name in self.estimate for name in wanted):
            return None
        found = self.estimate.covariance[wanted].array
        return found if np.isfinite(np.asarray(found)).all() else None

    def correct(self, y: AnyArray, conditions: dict[str, Callable[[], Any]], what: str) -> AnyArray:
        """Readings without the sensor's errors. The model receives those of the `conditions` that its `correct` accepts.

        Raises
        ------
        DataError
            If the model needs a condition that the log does not have, or fails.
        """
        name, taken = type(self.model).__name__, list(inspect.signature(self.model.correct).parameters.values())[1:]  # type: ignore[attr-defined]
        open_ended = any(one.kind is one.VAR_KEYWORD for one in taken) and type(self.model) is not self.base
        for one in taken:
            if one.name not in conditions and one.default is one.empty and one.kind is not one.VAR_KEYWORD:
                raise DataError(f"the model {name} of {what} needs {one.name}, which this log does not have", code="condition")
        given, named = {}, [one.name for one in taken]
        for key, value in conditions.items():
            try:
                given |= {key: value()} if open_ended or key in named else {}
            except DataError:  # open-ended arguments take what the log has
                if key in named:
                    raise
        try:
            return np.asarray(self.model.correct(y, **given))  # type: ignore[attr-defined]
        except (TypeError, ValueError) as error:
            raise DataError(f"the model {name} of {what} does not correct this log: {error}", code="model") from error

    def to_document(self) -> dict[str, Any]:
        """The stored form, in which the fields of the model stand beside the others."""
        sensor = next((name for name in SENSORS if si_unit(name) == self.unit), "mag")
        fields = document_of(self.model, self.base, sensor)
        if sensor == "accel" and not np.any(fields["g_sensitivity"]):
            del fields["g_sensitivity"]
        known: dict[str, Any] = {"field": self.field} if sensor == "mag" else {}
        known["covariance"] = None if self.estimate is None else _stored(self.estimate)
        known |= {name: getattr(self, name) for name in ("verdict", "verdict_reason") if getattr(self, name) is not None}
        known |= {"currents": self.currents} if self.currents else {}
        if twice := set(fields) & {"unit", *known}:
            raise DataError(f"the field {min(twice)!r} of {type(self.model).__name__} is one of the file itself; rename it", code="field")
        return {"unit": self.unit, **fields, **known}


def quantities_of(sensor: str, part: Part[Any], names: Iterable[str]) -> list[str]:
    """Quantities of parameters of a part, as in the table of units; a field that only a user's class has is a plain number."""
    own = next((one for one in (*SENSORS, "mag") if si_unit(one) == part.unit), part.unit)
    known = {"bias": own, "hard_iron": own, "field": own, "g_sensitivity": "gyro/accel"}
    return [known.get(name.partition("[")[0], "ratio") for name in names]


class Imu(eqx.Module):
    """Accelerometer and gyroscope, and the verdict on the fit of both.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> device = jaxcal.Calibration(imu={"gyro": jaxcal.imu.Triad(np.eye(3), np.array([0.01, 0.0, 0.0]))})
    >>> device.imu.accel, device.imu.gyro.model.bias.tolist()
    (None, [0.01, 0.0, 0.0])
    """

    accel: Part[Triad] | None = None
    gyro: Part[Triad] | None = None
    verdict: str | None = None
    verdict_reason: str | None = None

    @property
    def parts(self) -> dict[str, Part[Triad]]:
        """Sensor -> its part, for each sensor that is present."""
        return {name: part for name in SENSORS if (part := getattr(self, name)) is not None}


def imu_of(value: Any) -> Imu | None:
    """The inertial part of a calibration, checked; from an `ImuFit`, `DeviceFit`, `RateTest`, the stored form, or `Triad`s by sensor."""
    if value is None or isinstance(value, Imu):
        return value
    if isinstance(value, ImuFit):
        return _from_imu_fit(value)
    if isinstance(value, RateTest):
        return _from_rate_test(value)
    if isinstance(value, DeviceFit):
        sensors = [sensor for sensor in SENSORS if value.verdicts[sensor] != "refused"]
        if not sensors:
            raise _refused("fit of the device", value)
        return Imu(**{sensor: _of_device(value, sensor) for sensor in sensors}, verdict=value.verdict, verdict_reason=value.reason)
    if not isinstance(value, dict):
        raise wrong(value, "a dictionary with accel, gyro, verdict, verdict_reason", "imu")
    texts = {name: structured(value.get(name), str | None, f"imu.{name}") for name in ("verdict", "verdict_reason")}
    parts = {name: _part(value[name], Triad, name, f"imu.{name}") for name in SENSORS if value.get(name) is not None}
    return Imu(**parts, **texts)


def magnetometer_of(value: Any) -> Part[MagModel] | None:
    """The magnetometer of a calibration, checked; from a `MagFit`, a `DeviceFit`, the stored form, a `MagModel`, or a `Part`."""
    if isinstance(value, DeviceFit | MagFit):
        device = isinstance(value, DeviceFit)
        if (value.verdicts["magnetometer"] if device else value.verdict) == "refused" or value.model is None:
            raise _refused("magnetometer", value)
        value = _of_device(value, "magnetometer") if device else _of_magnetometer(value)
    part = None if value is None else _part(value, MagModel, "mag", "magnetometer")
    if part is not None and part.field is not None and (np.isinf(part.field) or part.field <= 0):
        raise wrong(part.field, "the norm of the field, or None", "magnetometer.field")
    return part


def _refused(what: str, fit: Any) -> DataError:
    return DataError(f"the {what} is refused, and is no calibration: {fit.reason}", code="refused")


def _currents_of(fit: MagFit) -> dict[str, AnyArray] | None:
    """Field per unit of each current that was fitted."""
    numbers = fit.estimate.select("currents.*").numbers()
    names = dict.fromkeys(one.name.removeprefix("currents.").rpartition("[")[0] for one in numbers)
    return {name: np.array([one.value for one in numbers if one.name.startswith(f"currents.{name}[")]) for name in names} or None


def _of_magnetometer(fit: MagFit) -> Part[MagModel]:
    """The part of a fit of a magnetometer."""
    unit = si_unit("mag") if fit.field < BEYOND["mag"] else COUNTS
    known = fit.estimate.select(*(name for name in fit.estimate.names if not name.startswith("currents.")))
    return Part(fit.model, unit, float(fit.field), _fitted(known), fit.verdict, fit.reason, _currents_of(fit))  # type: ignore[arg-type]


def _fitted(estimate: Estimate) -> Estimate | None:
    """The parameters that the readings determine; None if their covariance is not known."""
    known = estimate.select(*(name for name in estimate.names if estimate.states.get(name) != "open"))
    return known if np.isfinite(np.asarray(known.matrix)).all() else None


class _Stored(eqx.Module):
    """An estimate in a file; its values stand beside it, as fields of the model. Infinite degrees of freedom are left out."""

    parameters: tuple[str, ...]
    values: Float[np.ndarray, "rows columns"]
    freedom: Float[np.ndarray, " parameters"] | None = None


def _stored(estimate: Estimate) -> _Stored:
    freedom = np.asarray(estimate.freedom)
    return _Stored(estimate.names, np.asarray(estimate.matrix), freedom if np.isfinite(freedom).all() else None)


def _estimate(value: dict[str, Any], held: dict[str, float], path: str) -> Estimate | None:
    """The estimate of a part in the form of a file, whose parameters have the values `held`."""
    stored: _Stored | None = structured(value["covariance"], _Stored | None, f"{path}.covariance")
    if stored is None:
        return None
    size, freedom = len(stored.parameters), np.inf if stored.freedom is None else stored.freedom
    if stored.values.shape != (size, size):
        shape = " rows and ".join(map(str, stored.values.shape))
        raise DataError(f"{path}.covariance.values has {shape} columns; expected {size} of each, as its parameters name", code="shape")
    if isinstance(limits := value.get("interval"), dict):  # files without degrees of freedom have the limits of 95 % intervals
        with np.errstate(divide="ignore", invalid="ignore"):
            half = np.subtract(*(np.asarray(limits[name], float) for name in ("high", "low"))) / 2
            found = scipy.special.stdtridf(0.975, half / np.sqrt(np.diag(stored.values)))
        freedom = np.where(np.isfinite(found), found, np.inf)
    return Estimate(stored.parameters, np.array([held.get(name, np.nan) for name in stored.parameters]), stored.values, freedom)


def _from_imu_fit(fit: ImuFit) -> Imu:
    if fit.verdict == "refused" or fit.accel is None:
        raise _refused("fit of the IMU", fit)
    parts = {}
    for sensor, triad in (("accel", fit.accel), ("gyro", fit.gyro)):
        if triad is not None:
            known = _fitted(fit.estimate.select(f"{sensor}.*").renamed(lambda name: name.partition(".")[2]))
            parts[sensor] = _part(Part(triad, si_unit(sensor), None, known), Triad, sensor, f"imu.{sensor}")
    return Imu(**parts, verdict=fit.verdict, verdict_reason=fit.reason)


def _of_device(fit: DeviceFit, sensor: str) -> Part[Any]:
    """A sensor's part of the fit of a whole device."""
    fitted = [name for name in fit.estimate.select(f"{sensor}.*").names if name not in fit.estimate.states]
    known = fit.estimate.select(*fitted).renamed(lambda name: name.partition(".")[2])
    short = {"magnetometer": "mag"}.get(sensor, sensor)
    field = float(fit.model.field) if short == "mag" else None
    part = Part(getattr(fit.model, sensor), si_unit(short), field, known, fit.verdicts[sensor], fit.reason)
    return _part(part, MagModel if short == "mag" else Triad, short, sensor)


def _from_rate_test(test: RateTest) -> Imu:
    if test.fit is None:
        raise _refused("rate test", test)
    part = Part(test.fit.triad, si_unit("gyro"), None, _fitted(test.fit.estimate))
    return Imu(gyro=_part(part, Triad, "gyro", "imu.gyro"), verdict=test.verdict, verdict_reason=test.reason)


def _part(value: Any, base: type, sensor: str, path: str) -> Part[Any]:
    """A sensor's part from a model or from its stored form, checked."""
    if isinstance(value, base):
        value = Part(value, si_unit(sensor))
    if not isinstance(value, Part):
        in_counts = sensor == "mag" and isinstance(value, dict) and value.get("unit") == COUNTS
        unit = COUNTS if in_counts else si_unit(sensor)
        checked_unit(value, unit, path)
        needed = {"accel": ("covariance",), "gyro": ("g_sensitivity", "covariance"), "mag": ("field", "covariance")}[sensor]
        known_shapes = {name: numbers(value[name], shape, f"{path}.{name}") for name, shape in _SHAPES.items() if name in value}
        model = structured(value | known_shapes, base, path)
        for name in needed:
            required(value, name, path, needed)
        known = {"field": float, "verdict": str, "verdict_reason": str}
        rest = {name: structured(value.get(name), kind | None, f"{path}.{name}") for name, kind in known.items()}
        fields = structured(value.get("currents"), dict[str, Any] | None, f"{path}.currents") if sensor == "mag" else None
        currents: dict[str, AnyArray] = {name: numbers(field, (3,), f"{path}.currents.{name}") for name, field in (fields or {}).items()}
        made = Part(model, unit, **rest, currents=currents or None)
        held = made.parameters | ({} if made.field is None else {"field": made.field})
        value = dataclasses.replace(made, estimate=_estimate(value, held, path))
    arrays = {}
    for name, number in _leaves(document_of(value.model, base, path)):
        check_finite(np.asarray(number, dtype=float), f"{path}.{name}")
        if name in _SHAPES:
            arrays[name] = numbers(number, _SHAPES[name], f"{path}.{name}")
        if name in ("matrix", "soft_iron") and not np.linalg.cond(arrays[name]) < _CONDITION:
            raise wrong(number, "a matrix that has an inverse", f"{path}.{name}")
    if not all(isinstance(getattr(value.model, name), np.ndarray) for name in arrays):
        value = dataclasses.replace(value, model=dataclasses.replace(value.model, **arrays))
    return value


def _leaves(fields: dict[str, Any], path: str = "") -> list[tuple[str, Any]]:
    """Numbers among the stored fields of a model, by their path."""
    found = []
    for name, value in fields.items():
        if isinstance(value, dict):
            found += _leaves(value, f"{path}{name}.")
        elif not (value is None or isinstance(value, (str, bool))):
            found.append((path + name, value))
    return found
