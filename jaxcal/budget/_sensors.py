"""The errors of the sensors as data: noise terms with squared coefficients, and parameters that multiply what drives them."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from .._errors import DataError
from .._types import Samples
from ..calibration import Calibration, SensorNoise
from ..calibration._thermal import AXES, Thermal
from ..imu import ThermalTriad
from ..noise import GaussMarkov, Noise
from ..noise._terms import BUILT_IN
from ._findings import FINDINGS
from ._motion import DRIVERS, PLACES
from ._response import SENSORS

_WORDS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}
_OWN = {"gyro": "rate", "accel": "force", "mag": "field"}
_EACH, _ALL = tuple(f"[{i}]" for i in range(3)), tuple(f"[{i},{k}]" for i in range(3) for k in range(3))
#: error that can be given -> its parameters, three for each axis or row
_GIVEN = {
    "bias": _EACH, "hard_iron": _EACH, "drift": _EACH, "delay": _EACH, "lever": _EACH, "g_sensitivity": _ALL, "soft_iron": _ALL,
    "scale": _ALL[::4], "misalignment": tuple(one for i, one in enumerate(_ALL) if i % 4),
}  # fmt: skip
#: vector of parameters -> what drives it; others are constant errors
_DRIVEN = {"drift": "time", "lever": "lever"}
#: errors of all sensors with a thermal model: what the thermometer is wrong by, degC, and how fast that grows, degC/s
_WARM = {"temperature": "one", "warming": "time"}


class Sensors(NamedTuple):
    """What is known of the errors of a device.

    Attributes
    ----------
    terms : (cause, place of the sensor, law, squared coefficients (3,)) of the noise.
    spread : (causes of terms, covariance of their squared coefficients (3, t, t)) of each sensor with a fit.
    causes : of the p parameters.
    shape : (p, 3, 3, k) error of each sensor and axis for each parameter and driver.
    covariance : (p, p).
    rate : Hz; 100 where it is not known.
    findings : what is missing.
    """

    terms: list[tuple[str, int, Any, Any]]
    spread: list[tuple[list[str], Any]]
    causes: list[str]
    shape: Any
    covariance: Any
    rate: float
    findings: list[Finding]

    @property
    def noise(self) -> tuple[str, ...]:
        """Causes that are noise."""
        return tuple(dict.fromkeys(cause for cause, *_ in self.terms))


def sensors_of(source: Any, errors: Mapping[str, Any] | None, temperature: float | None = None, aided: bool = False) -> Sensors:
    """The errors of a `Calibration`, a `Noise`, or noise by sensor, and standard deviations of further parameters by name.

    temperature : degC, of the device; None for that to which the calibration refers.
    """
    known = source if isinstance(source, Calibration) else Calibration()
    noise, wanted = _by_sensor(source), SENSORS if aided else SENSORS[:2]
    terms, spread, given, blocks = [], [], dict(errors or {}), []
    for sensor, held in noise.items():
        each = _terms(held)
        terms += [(f"{sensor} {name}", SENSORS.index(sensor), law, squares) for name, law, squares in each if name != "R"]
        given |= {f"{sensor}.drift": np.sqrt(squares) for name, _, squares in each if name == "R"}  # a line has a slope, and no law
        if (fitted := getattr(held, "covariance", None)) is not None:
            spread.append(([f"{sensor} {name.removesuffix('^2')}" for name in fitted.parameters], np.nan_to_num(fitted.values)))
    parts: dict[str, Any] = {} if known.imu is None else dict(known.imu.parts)
    if known.magnetometer is not None and known.magnetometer.unit == "T":
        parts["mag"] = known.magnetometer
    found: list[tuple[str, Any]] = []
    warm = [one for one in (known.temperature, *(part.model for part in parts.values())) if isinstance(one, Thermal | ThermalTriad)]
    reference: Any = warm[0].reference if warm else 0.0
    at = float(reference if temperature is None else temperature)
    for sensor, part in parts.items():
        estimate = None if part.estimate is None else part.estimate.select("matrix*", "bias*", "g_sens*", "soft_iron*", "hard_iron*")
        if estimate is not None and len(estimate.names):
            above = np.clip(at, part.model.low, part.model.high) - part.model.reference if isinstance(part.model, ThermalTriad) else 0.0
            found += [_parameter(sensor, name, _inverse(part, at), above) for name in estimate.names]
            blocks.append(np.asarray(estimate.matrix))
    for name, value in given.items():
        sensor, _, kind = name.partition(".")
        if name in _WARM:
            if not warm:
                raise DataError(f"an error of {name} needs a calibration with a thermal model", code="no_thermal")
            found.append(("temperature", _thermal(known, parts, at, float(value), name)))
            blocks.append(np.eye(1) * float(value) ** 2)
            continue
        if kind not in _GIVEN or sensor not in SENSORS or (kind.endswith("iron") and sensor != "mag"):
            raise DataError(
                f"{name} is no error of a sensor; known are {', '.join(_GIVEN)} of {', '.join(SENSORS)}, and {', '.join(_WARM)}",
                code="no_error",
            )
        field = "matrix" if kind in ("scale", "misalignment") else kind
        found += [_parameter(sensor, field + place, np.eye(3)) for place in _GIVEN[kind]]
        blocks.append(np.diag(np.broadcast_to(np.asarray(value, dtype=float), (3,)).repeat(len(_GIVEN[kind]) // 3) ** 2))
    if aided:  # an accelerometer shows the level only as far as the device does not accelerate
        found.append(("acceleration", _shape("accel", "force", np.eye(3))))
        blocks.append(np.eye(1))
    said = [FINDINGS("no_noise", sensor, sensor=_WORDS[sensor]) for sensor in wanted if sensor not in noise]
    exact = [_WORDS[sensor] for sensor in wanted if not any(cause.startswith(sensor) for cause, _ in found)]
    said += [FINDINGS("exact", what=" and ".join(exact))] if exact else []
    rate = 100.0 if known.noise is None else known.noise.rate
    covariance = scipy.linalg.block_diag(*blocks) if blocks else np.zeros((0, 0))
    return Sensors(
        terms,
        spread,
        [cause for cause, _ in found],
        np.array([shape for _, shape in found]).reshape(-1, 3, 3, sum(DRIVERS.values())),
        covariance,
        rate,
        said,
    )


def _by_sensor(source: Any) -> dict[str, Any]:
    if isinstance(source, Calibration):
        return {name: one for name in SENSORS if (one := getattr(source.noise, name, None)) is not None}
    source = {"gyro": source} if isinstance(source, Noise) else source
    if not isinstance(source, Mapping) or not set(source) <= set(SENSORS) or not all(isinstance(one, Noise) for one in source.values()):
        raise DataError(f"expected a Calibration, a Noise, or a Noise by sensor ({', '.join(SENSORS)}); got {source!r:.80}", code="sensors")
    return dict(source)


def _terms(noise: Noise | SensorNoise) -> list[tuple[str, Any, Any]]:
    """Name, law and squared coefficients (3,) of every term that is there."""
    if isinstance(noise, Noise):
        return [(name, law, value**2 * np.ones(3)) for name, value, law in noise.parts if not (isinstance(value, float) and value == 0)]
    known = [(name, law, getattr(noise, name)) for name, law in BUILT_IN.items()]
    known += [(one.term.name, one.term, one.coefficient) for one in noise.further or ()]
    for axis, pairs in enumerate(noise.markov or ()):
        known += [("markov", GaussMarkov(time=time), np.eye(3)[axis] * strength) for strength, time in pairs]
    return [(name, law, np.nan_to_num(value) ** 2) for name, law, value in known if value is not None and np.nansum(value) > 0]


def _shape(sensor: str, driver: str, matrix: Any) -> np.ndarray:
    """(3, 3, k) a matrix (3, n) times a driver, as the error of a sensor."""
    shape = np.zeros((3, 3, sum(DRIVERS.values())))
    shape[SENSORS.index(sensor)][:, PLACES[driver]] = matrix
    return shape


def _inverse(part: Any, at: float) -> np.ndarray:
    """Inverse of the matrix of a sensor, at a temperature."""
    if part is None:
        return np.eye(3)
    model = part.model
    matrix = model.at(at)[0][0] if isinstance(model, ThermalTriad) else getattr(model, "soft_iron", None)
    return np.linalg.inv(np.asarray(model.matrix if matrix is None else matrix))


def _thermal(known: Calibration, parts: dict[str, Any], at: float, size: float, kind: str) -> np.ndarray:
    """(3, 3, k) error of each sensor for one degC: the mean slope of its thermal models over `size` on both sides."""
    shape, both = np.zeros((len(SENSORS), 3, sum(DRIVERS.values()))), at + (size or 1.0) * np.array([-1.0, 1.0])
    slope = lambda ends: (ends[1] - ends[0]) / (both[1] - both[0])  # noqa: E731
    for own, sensor in zip(shape, SENSORS, strict=True):
        part: Any = parts.get(sensor)
        bias = np.zeros((3, 1))
        inverse, warm = _inverse(part, at), isinstance(getattr(part, "model", None), ThermalTriad)
        for axis, model in {} if known.temperature is None else known.temperature.of(sensor).items():
            bias[AXES.index(axis)] += slope(np.asarray(model.curve.value(np.clip(both, model.low, model.high))))
        matrix, more, cross = map(slope, part.model.at(both)) if warm else np.zeros((3, 3, 3))
        own[:, PLACES[_WARM[kind]]] = inverse @ (bias + more[:, None] if warm else bias)
        if kind == "temperature" and warm:
            own[:, PLACES[_OWN[sensor]]] = inverse @ matrix
            own[:, PLACES["force"]] += inverse @ cross
    return shape


def _parameter(sensor: str, name: str, inverse: np.ndarray, above: float = 0.0) -> tuple[str, np.ndarray]:
    """Cause and error of a parameter of y = M x + b + G f + ...: the corrected reading is wrong by M^-1 times its error.

    above : degC above the reference of its powers.
    """
    field, _, place = name.rstrip("]").partition("[")
    if field.endswith("_powers"):
        power, _, place = place.partition(",")
        shape = _parameter(sensor, f"{field.removesuffix('_powers')}[{place}]", inverse)[1]
        return f"{sensor} temperature", shape * above ** (int(power) + 1)
    row, column = (*map(int, place.split(",")), 0)[:2]
    cause = {"matrix": "scale" if row == column else "misalignment", "g_sensitivity": "g-sensitivity"}.get(field, field.replace("_", " "))
    one = np.eye(3)
    own = {"gyro": "turn", "accel": "jerk"}.get(sensor, "one"), np.diag(one[row])  # of a delay
    if field in ("matrix", "soft_iron", "g_sensitivity"):
        own = "force" if field == "g_sensitivity" else _OWN[sensor], np.outer(inverse[:, row], one[column])
    elif field != "delay":
        own = _DRIVEN.get(field, "one"), np.kron(one, one[row]) if field == "lever" else inverse[:, [row]]
    return f"{sensor} {cause}", _shape(sensor, *own)


def array(
    sensors: Sequence[Any], *, correlation: Samples = 0.0, lever: Samples | None = None
) -> tuple[dict[str, Noise], dict[str, np.ndarray], np.ndarray | None]:
    r"""What several sensors on one board give together: the mean with the weights that make its white noise least.

    .. math:: w = \frac{C^{-1} 1}{1' C^{-1} 1},\qquad C_{ij} = \rho_{ij} N_i N_j

    All other terms are independent between the sensors.

    Parameters
    ----------
    sensors : `Noise` by sensor, {"gyro": Noise, "accel": Noise}, of each device; all have the same sensors, with white noise.
    correlation : of the white noise: one number for all pairs, or (n, n) as `jaxcal.noise.correlation` gives it.
    lever : (n, 3) m, places of the accelerometers.

    Returns
    -------
    noise : `Noise` of the mean by sensor, for `propagate`.
    weights : sensor -> (n,).
    lever : (3,) m, where the mean of the accelerometers measures; None without theirs.

    Raises
    ------
    DataError
        If there is no sensor, or one has no white noise.

    Examples
    --------
    >>> from jaxcal.budget import array
    >>> from jaxcal.noise import Noise
    >>> noise, _, _ = array([{"gyro": Noise(N=2.0, K=0.2)}] * 4, correlation=0.2)
    >>> round(noise["gyro"].N, 3), round(noise["gyro"].K, 3)
    (1.265, 0.1)
    """
    every, noise, weights = [_by_sensor(one) for one in sensors], {}, {}
    if not every or not all(float(one.N) > 0 for device in every for one in device.values()):
        raise DataError("an array needs one sensor at least, and white noise N in each", code="sensors")
    for name in every[0]:
        each = {term: np.array([float(device[name].coefficient(term)) for device in every]) for term in "NQBK"}
        joint = np.where(np.eye(len(every), dtype=bool), 1.0, correlation) * np.outer(each["N"], each["N"])
        weight = np.linalg.solve(joint, np.ones(len(every)))
        weights[name] = weight = weight / weight.sum()
        known = {term: float(np.linalg.norm(weight * one)) for term, one in each.items()}
        noise[name] = Noise(**known | {"N": float(np.sqrt(weight @ joint @ weight))})
    return noise, weights, None if lever is None else weights["accel"] @ np.asarray(lever, dtype=float)
