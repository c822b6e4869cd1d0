"""Parameters of flight controllers: PX4 (QGroundControl) and ArduPilot (Mission Planner, MAVProxy), written and read back.

https://docs.px4.io/main/en/advanced_config/sensor_thermal_calibration.html
https://ardupilot.org/copter/docs/common-imutempcal.html
"""

import re
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.polynomial import polynomial

from .._answer import Finding
from .._errors import DataError, ExportError
from .._message import Message
from .._types import AnyArray
from .._units import factor
from ..calibration import Calibration, Thermal, polynomials
from ..imu import Triad
from ..magnetometer import MagModel
from ._findings import FINDINGS
from ._models import cubics, diagonal, dropped_of_gyro, gyro_bias, inverse, symmetric, symmetric_of, triads, upper_of
from ._options import Product, finite, plain

_AXES = "XYZ"
_GAUSS, _MILLIGAUSS = (factor(unit, "mag") for unit in ("G", "mG"))
_MILLIONTH = 1e-6  # of the unit of a thermal coefficient
#: instances of a sensor that the firmware has
_PX4, _IMUS, _COMPASSES = 4, 5, 3
_REFERENCE = 35.0  # degC: the firmware of ArduPilot expands every polynomial about this temperature
_LEAST_RANGE = 10.0  # degC
_PX4_FACTS = ("units: accelerometer m/s^2, gyroscope rad/s, magnetometer gauss; temperature degC; scale factors 1",)
_ARDUPILOT_FACTS = (
    "units: accelerometer m/s^2, gyroscope rad/s, compass milligauss; thermal terms 1e-6 of these per degC, degC^2, degC^3",
)
Rows = dict[str, float | int]


def write_px4(calibrations: Sequence[Calibration], options: Any) -> Product:
    """Write one instance of each sensor for every calibration, beginning with `options.instance`."""
    rows, found = _instances("PX4", _px4_rows, calibrations, options)
    lines = [f"1\t1\t{name}\t{plain(value)}\t{6 if isinstance(value, int) else 9}" for name, value in rows]
    head = ("# Sensor calibration written by jaxcal", "#", "# Vehicle-Id Component-Id Name Value Type")
    return Product("\n".join((*head, *lines)) + "\n", found, _PX4_FACTS)


def write_ardupilot(calibrations: Sequence[Calibration], options: Any) -> Product:
    """Write one instance of each sensor for every calibration, beginning with `options.instance`; ArduPilot counts from 1."""
    rows, found = _instances("ArduPilot", _ardupilot_rows, calibrations, options)
    lines = [f"{name},{plain(value)}" for name, value in rows]
    return Product("\n".join(("# Sensor calibration written by jaxcal", *lines)) + "\n", found, _ARDUPILOT_FACTS)


def _instances(
    tool: str, rows_of: Callable[..., Rows], calibrations: Sequence[Calibration], options: Any
) -> tuple[list[tuple[str, float | int]], list[Finding]]:
    rows: Rows = {}
    said: list[Finding] = []
    for instance, calibration in enumerate(calibrations, options.instance):
        found = rows_of(calibration, instance, options, said)
        if not found:
            raise ExportError(f"the calibration holds no imu, magnetometer or temperature for {tool}'s parameters", code="no_part")
        rows |= found
    return sorted(rows.items()), said


def _px4_rows(calibration: Calibration, i: int, options: Any, said: list[Finding]) -> Rows:
    if i >= _PX4:
        raise ExportError(f"PX4 has instances 0 to {_PX4 - 1} of a sensor; instance {i} is one too many", code="instance")
    rows: Rows = {}
    parts = triads(calibration)
    if "accel" in parts:
        scale, bias = diagonal(calibration, said), parts["accel"].bias
        if min(scale) < 0.1 or max(scale) > 3:
            said.append(FINDINGS("out_of_range", "accel", what="scale factor, outside 0.1 to 3"))
        rows[f"CAL_ACC{i}_ID"] = _device_id(calibration, "px4", "accel_id")
        rows |= _named(f"CAL_ACC{i}_{{}}OFF", bias) | _named(f"CAL_ACC{i}_{{}}SCALE", scale)
    bias = gyro_bias(calibration)
    if bias is not None:
        rows[f"CAL_GYRO{i}_ID"] = _device_id(calibration, "px4", "gyro_id")
        rows |= _named(f"CAL_GYRO{i}_{{}}OFF", bias)
        said += dropped_of_gyro(calibration)
    if calibration.magnetometer is not None:
        shape = symmetric(calibration, f"CAL_MAG{i}_ROT", said)
        rows[f"CAL_MAG{i}_ID"] = _device_id(calibration, "px4", "mag_id")
        rows |= _named(f"CAL_MAG{i}_{{}}OFF", calibration.magnetometer.model.hard_iron / _GAUSS)
        rows |= _named(f"CAL_MAG{i}_{{}}SCALE", shape.diagonal()) | _named(f"CAL_MAG{i}_{{}}ODIAG", upper_of(shape))
    section: Any = calibration.temperature
    for sensor, letter in (("accel", "A"), ("gyro", "G")):
        powers = cubics(calibration, sensor, None, said)
        if powers is None:
            continue
        # keep the constant in CAL_*OFF, so that switching off the thermal model does not change the bias at the reference
        start = f"TC_{letter}{i}"
        rows |= {
            f"TC_{letter}_ENABLE": 1, f"{start}_ID": _device_id(calibration, "px4", f"{sensor}_id"), f"{start}_TMIN": section.minimum,
            f"{start}_TMAX": section.maximum, f"{start}_TREF": section.reference,
        }  # fmt: skip
        rows |= {f"{start}_X{k}_{axis}": float(value) for axis in range(3) for k, value in enumerate((0.0, *powers[axis]))}
        if sensor == "accel" and "accel" not in parts:
            said.append(FINDINGS("no_bias", "accel"))
    if any(name.startswith("TC_") for name in rows):
        said.append(FINDINGS("restart"))
    return rows


def _ardupilot_names(i: int) -> dict[str, str]:
    """Name patterns of the parameters of instance `i`, counted from 1; {} stands for the axis."""
    number = "" if i == 1 else str(i)
    accel, gyro = (f"INS_{word}{number}" if i < 4 else f"INS{i}_{word}" for word in ("ACC", "GYR"))
    holds = (f"INS_{word}{i}_CALTEMP" if i < 4 else f"INS{i}_{word}_CALTEMP" for word in ("ACC", "GYR"))
    return {
        "accel_id": f"{accel}_ID", "accel_offset": f"{accel}OFFS_{{}}", "accel_scale": f"{accel}SCAL_{{}}",
        "gyro_offset": f"{gyro}OFFS_{{}}", **dict(zip(("accel_temperature", "gyro_temperature"), holds, strict=True)),
        "thermal": f"INS_TCAL{i}_" if i < 4 else f"INS{i}_TCAL_",
        "compass_id": f"COMPASS_DEV_ID{number}", "compass_scale": f"COMPASS_SCALE{number}", "compass_offset": f"COMPASS_OFS{number}_{{}}",
        "compass_diagonal": f"COMPASS_DIA{number}_{{}}", "compass_rest": f"COMPASS_ODI{number}_{{}}",
    }  # fmt: skip


def _ardupilot_rows(calibration: Calibration, instance: int, options: Any, said: list[Finding]) -> Rows:
    i, parts, section = instance + 1, triads(calibration), calibration.temperature
    names = _ardupilot_names(i)
    if i > _IMUS:
        raise ExportError(f"ArduPilot has instances 1 to {_IMUS} of an IMU; instance {i} is one too many", code="instance")
    if i > 3 and (parts or section):
        said.append(FINDINGS("recent_firmware", instance=i))
    rows: Rows = {}
    thermal = {letter: cubics(calibration, sensor, _REFERENCE, said) for letter, sensor in (("ACC", "accel"), ("GYR", "gyro"))}
    holds, moved = _where_it_holds(section, thermal)
    if "accel" in parts:
        scale, bias = diagonal(calibration, said), parts["accel"].bias + moved["ACC"]
        if max(abs(bias)) > 3.5 or min(scale) < 0.8 or max(scale) > 1.2:
            said.append(FINDINGS("out_of_range", "accel", what="bias above 3.5 m/s^2, or scale factor outside 0.8 to 1.2"))
        rows[names["accel_id"]] = _device_id(calibration, "ardupilot", "accel_id")
        rows |= _named(names["accel_offset"], bias) | _named(names["accel_scale"], scale)
    if "gyro" in parts:
        said += dropped_of_gyro(calibration)
        if options.gyro_bias:
            said.append(FINDINGS("relearnt", "gyro"))
            rows |= _named(names["gyro_offset"], parts["gyro"].bias + moved["GYR"])
        else:
            said.append(FINDINGS("estimated_by_tool", "gyro", tool="the firmware"))
    if calibration.magnetometer is not None:
        rows |= _compass(calibration, names, i, said)
    if section is not None and any(powers is not None for powers in thermal.values()):
        low, high = section.minimum, section.maximum
        if high - low < _LEAST_RANGE:
            why = f"the thermal model covers {low:.2f} to {high:.2f} degC; ArduPilot needs {_LEAST_RANGE:g} degC: calibrate over more"
            raise ExportError(why, code="narrow")
        # write CALTEMP: the firmware clips its default of -300 degC to TMIN, which would shift the bias
        start = names["thermal"]
        rows |= {names["accel_temperature"]: holds, f"{start}ENABLE": 1, f"{start}TMIN": low, f"{start}TMAX": high}
        if options.gyro_bias and "gyro" in parts:
            rows[names["gyro_temperature"]] = holds
        for letter, powers in thermal.items():
            for k, values in enumerate(np.zeros((3, 3)) if powers is None else powers.T / _MILLIONTH, 1):
                rows |= _named(f"{start}{letter}{k}_{{}}", values)
        if thermal["ACC"] is not None and "accel" not in parts:
            said.append(FINDINGS("no_bias", "accel"))
    return rows


def _where_it_holds(section: Thermal | None, thermal: dict[str, AnyArray | None]) -> tuple[float, dict[str, AnyArray]]:
    """Temperature for CALTEMP, which the firmware clips to the range, and the change of the biases from the reference to it."""
    moved: dict[str, AnyArray] = dict.fromkeys(thermal, np.zeros(3))
    if section is None:
        return _REFERENCE, moved
    holds = min(max(section.reference, section.minimum), section.maximum)
    for letter, powers in thermal.items():
        if powers is not None and holds != section.reference:
            here, there = (powers @ np.array([x, x**2, x**3]) for x in np.array([holds, section.reference]) - _REFERENCE)
            moved[letter] = here - there
    return holds, moved


def _compass(calibration: Calibration, names: dict[str, str], i: int, said: list[Finding]) -> Rows:
    mag: Any = calibration.magnetometer
    if i > _COMPASSES:
        raise ExportError(f"ArduPilot has calibrations of compasses 1 to {_COMPASSES}; compass {i} is one too many", code="instance")
    shape = symmetric(calibration, "COMPASS_ORIENT" if i == 1 else f"COMPASS_ORIENT{i}", said)
    rest = upper_of(shape)
    if min(shape.diagonal()) < 0.2 or max(shape.diagonal()) > 5 or max(map(abs, rest)) >= 1:
        said.append(FINDINGS("out_of_range", "mag", what="diagonal outside 0.2 to 5, or off-diagonal of 1 and more"))
    if "COMPASS_MOT" in str((calibration.provenance or {}).get("applied", "")):
        said.append(FINDINGS("motor_compensation", "mag"))
    rows: Rows = {names["compass_id"]: _device_id(calibration, "ardupilot", "compass_id"), names["compass_scale"]: 1}
    # the firmware adds the offset to the reading
    rows |= _named(names["compass_offset"], -mag.model.hard_iron / _MILLIGAUSS)
    return rows | _named(names["compass_diagonal"], shape.diagonal()) | _named(names["compass_rest"], rest)


def _device_id(calibration: Calibration, tool: str, name: str) -> int:
    """Id by which a flight controller identifies a sensor."""
    ids = (calibration.device or {}).get(tool)
    value = ids.get(name) if isinstance(ids, dict) else None
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value < 2**31:
        how = Message(f'Calibration(device={{{{"{tool}": {{{{"{name}": ID}}}}}}}})', terminal=f"--ids {name.removesuffix('_id')}=ID")
        said = "the {name} of the sensor, which the parameters name, is not known; give it as the vehicle lists it: {how}"
        raise ExportError(Message(said, name=name, how=how), code="no_id")
    if tool == "ardupilot" and value != int(np.float32(value)):
        raise ExportError(f"ardupilot.{name} is {value}, which float32, as parameters travel, does not hold", code="no_part")
    return value


def _named(pattern: str, values: Any) -> Rows:
    return {pattern.format(axis): float(value) for axis, value in zip(_AXES, values, strict=True)}


def read_px4(text: str, options: dict[str, Any]) -> Calibration:
    """Read one instance of each sensor. A disabled thermal model is left out; the constant of an enabled one is added to the bias."""
    values: dict[str, float] = {}
    for line in _lines(text):
        row = line.split("\t")
        if len(row) != 5:
            raise DataError(f"the line {' '.join(row)!r:.80} has {len(row)} fields; expected five between tabs", code="unreadable")
        values[row[2].strip()] = finite(row[3], row[2])
    i = options["instance"]
    imu: dict[str, Triad] = {}
    ids: dict[str, float | None] = {}
    thermal: dict[str, Any] = {}
    for sensor, letter, start in (("accel", "A", f"CAL_ACC{i}"), ("gyro", "G", f"CAL_GYRO{i}")):
        model, constant = _px4_thermal(values, letter, i)
        if model is not None:
            thermal[sensor] = model
        if f"{start}_XOFF" in values:
            bias = _three(values, f"{start}_{{}}OFF") + constant
            imu[sensor] = _triad(_three(values, f"{start}_{{}}SCALE") if sensor == "accel" else np.ones(3), bias)
        ids[f"{sensor}_id"] = values.get(f"{start}_ID", values.get(f"TC_{letter}{i}_ID"))
    mag, start = None, f"CAL_MAG{i}"
    if f"{start}_XOFF" in values:
        correction = symmetric_of(_three(values, f"{start}_{{}}SCALE"), _three(values, f"{start}_{{}}ODIAG"))
        mag = MagModel(inverse(correction), _three(values, f"{start}_{{}}OFF") * _GAUSS)
        ids["mag_id"] = values.get(f"{start}_ID")
    return _calibration("px4", i, imu, mag, _joined(thermal), ids)


def _px4_thermal(values: dict[str, float], letter: str, i: int) -> tuple[dict[str, Any] | None, AnyArray]:
    start = f"TC_{letter}{i}"
    if values.get(f"TC_{letter}_ENABLE", 0) != 1 or f"{start}_TREF" not in values:
        return None, np.zeros(3)
    powers = np.array([[values.get(f"{start}_X{power}_{axis}", 0.0) for power in range(4)] for axis in range(3)])
    limits = {name: _of(values, f"{start}_{key}") for name, key in (("reference", "TREF"), ("minimum", "TMIN"), ("maximum", "TMAX"))}
    return {"powers": powers[:, 1:], **limits}, powers[:, 0]


def read_ardupilot(text: str, options: dict[str, Any]) -> Calibration:
    """Read one instance of each sensor; the compass bias is minus its offset, and the thermal models refer to CALTEMP."""
    values: dict[str, float] = {}
    for line in _lines(text):
        parts = [part for part in re.split(r"[ ,\t]+", line.strip()) if part]
        if len(parts) != 2:
            raise DataError(f"the line {line!r:.80} has {len(parts)} items; expected a name and a value", code="unreadable")
        values[parts[0]] = finite(parts[1], parts[0])
    names = _ardupilot_names(options["instance"] + 1)
    imu: dict[str, Triad] = {}
    for sensor in ("accel", "gyro"):
        if names[f"{sensor}_offset"].format("X") in values:
            scale = _three(values, names["accel_scale"]) if sensor == "accel" else np.ones(3)
            imu[sensor] = _triad(scale, _three(values, names[f"{sensor}_offset"]))
    ids = {"accel_id": values.get(names["accel_id"])}
    mag = None
    if names["compass_offset"].format("X") in values:
        # the firmware ignores a scale of 0
        scale = values.get(names["compass_scale"], 1.0) or 1.0
        correction = scale * symmetric_of(_three(values, names["compass_diagonal"]), _three(values, names["compass_rest"]))
        mag = MagModel(inverse(correction), -_three(values, names["compass_offset"]) * _MILLIGAUSS)
        ids["compass_id"] = values.get(names["compass_id"])
    return _calibration("ardupilot", options["instance"], imu, mag, _ardupilot_thermal(values, names), ids)


def _ardupilot_thermal(values: dict[str, float], names: dict[str, str]) -> Thermal | None:
    start = names["thermal"]
    if values.get(f"{start}ENABLE", 0) != 1:
        return None
    low, high = _of(values, f"{start}TMIN"), _of(values, f"{start}TMAX")
    holds = min(max(values.get(names["accel_temperature"], low), low), high)
    sensors = {}
    for sensor, letter in (("accel", "ACC"), ("gyro", "GYR")):
        powers = np.array([[values.get(f"{start}{letter}{power}_{axis}", 0.0) for power in (1, 2, 3)] for axis in _AXES])
        if np.any(powers):
            sensors[sensor] = _about(powers * _MILLIONTH, _REFERENCE, holds)
    return polynomials(holds, low, high, **sensors)


def _joined(thermal: dict[str, Any]) -> Thermal | None:
    """Join the models of two sensors into one section: the reference of the first, and the common range."""
    if not thermal:
        return None
    models = thermal.values()
    reference = next(iter(models))["reference"]
    sensors = {sensor: _about(model["powers"], model["reference"], reference) for sensor, model in thermal.items()}
    return polynomials(reference, max(model["minimum"] for model in models), min(model["maximum"] for model in models), **sensors)


def _about(powers: AnyArray, old: float, new: float) -> AnyArray:
    """Convert coefficients of the powers of T - old, from 1 on, to those of T - new; the constant belongs to the bias."""
    if old == new:
        return powers
    shift = polynomial.Polynomial([new - old, 1.0])
    found = [polynomial.Polynomial([0.0, *row])(shift).coef for row in powers]
    return np.stack([np.pad(row, (0, powers.shape[1] + 1 - len(row)))[1:] for row in found])


def _lines(text: str) -> list[str]:
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


def _triad(scale: AnyArray, bias: AnyArray) -> Triad:
    if not np.all(scale):
        raise DataError("a scale factor of the accelerometer is 0", code="unreadable")
    return Triad(np.diag(1 / scale), bias)


def _calibration(
    tool: str, i: int, imu: dict[str, Triad], mag: MagModel | None, thermal: Thermal | None, ids: dict[str, float | None]
) -> Calibration:
    if not imu and mag is None and thermal is None:
        raise DataError(f"the file has no calibration of instance {i} of any sensor", code="unreadable")
    known = {name: int(value) for name, value in ids.items() if value is not None and value == int(value) and value > 0}
    return Calibration(imu=imu or None, magnetometer=mag, temperature=thermal, device={tool: known} if known else None)


def _three(values: dict[str, float], pattern: str) -> AnyArray:
    return np.array([_of(values, pattern.format(axis)) for axis in _AXES])


def _of(values: dict[str, float], name: str) -> float:
    if name not in values:
        raise DataError(f"{name} is missing, though others of its group are there", code="unreadable")
    return values[name]
