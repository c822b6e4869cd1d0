"""ArduPilot's parameters for Mission Planner and MAVProxy: https://ardupilot.org/copter/docs/common-imutempcal.html."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._errors import ExportError
from .._types import AnyArray
from ..calibration import Calibration
from ._matrices import diagonal, dropped_of_gyro, symmetric, triads
from ._options import Options, Product
from ._text import plain
from ._thermal import cubics, device_id

_MILLIGAUSS = 1e-7  # T
_MILLIONTH = 1e-6
_REFERENCE = 35.0  # degC about which the firmware expands every polynomial
_LEAST_RANGE = 10.0  # degC
_AXES = "XYZ"
_IMUS, _COMPASSES = 5, 3
_LARGEST_ID = 2**24  # parameters travel as float32
_FACTS = ("units: accelerometer m/s^2, gyroscope rad/s, compass milligauss; thermal terms 1e-6 of these per degC, degC^2, degC^3",)


def ardupilot(calibrations: Sequence[Calibration], options: Options) -> Product:
    """One instance of each sensor for every calibration, from `options.instance` on; ArduPilot counts from 1."""
    rows: dict[str, float | int] = {}
    warnings: list[str] = []
    for i, calibration in enumerate(calibrations, options.instance + 1):
        rows |= _rows(calibration, i, options, warnings)
    lines = [f"{name},{plain(value)}" for name, value in sorted(rows.items())]
    return Product("\n".join(("# Sensor calibration written by jaxcal", *lines)) + "\n", tuple(warnings), _FACTS)


def names_of(i: int) -> dict[str, str]:
    """Patterns of the parameters of instance `i`, counted from 1, for each axis."""
    imu = "INS" if i < 4 else f"INS{i}"
    accel = {1: "INS_ACC", 2: "INS_ACC2", 3: "INS_ACC3"}.get(i, f"{imu}_ACC")
    gyro = {1: "INS_GYR", 2: "INS_GYR2", 3: "INS_GYR3"}.get(i, f"{imu}_GYR")
    number = "" if i == 1 else str(i)
    return {
        "accel_id": f"{accel}_ID", "accel_offset": f"{accel}OFFS_{{}}", "accel_scale": f"{accel}SCAL_{{}}",
        "accel_temperature": f"INS_ACC{i}_CALTEMP" if i < 4 else f"{imu}_ACC_CALTEMP",
        "gyro_id": f"{gyro}_ID", "gyro_offset": f"{gyro}OFFS_{{}}",
        "gyro_temperature": f"INS_GYR{i}_CALTEMP" if i < 4 else f"{imu}_GYR_CALTEMP",
        "thermal": f"INS_TCAL{i}_" if i < 4 else f"{imu}_TCAL_",
        "compass_id": f"COMPASS_DEV_ID{number}", "compass_scale": f"COMPASS_SCALE{number}", "compass_offset": f"COMPASS_OFS{number}_{{}}",
        "compass_diagonal": f"COMPASS_DIA{number}_{{}}", "compass_rest": f"COMPASS_ODI{number}_{{}}",
    }  # fmt: skip


def _rows(calibration: Calibration, i: int, options: Options, warnings: list[str]) -> dict[str, float | int]:
    names = names_of(i)
    parts, section = triads(calibration), calibration.temperature
    if i > _IMUS:
        raise ExportError(f"ArduPilot has instances 1 to {_IMUS} of an IMU; instance {i} is one too many")
    if i > 3 and (parts or section):
        warnings.append(f"instance {i} exists in recent firmware alone: compare the names with those of the vehicle")
    rows: dict[str, float | int] = {}
    thermal = {letter: cubics(calibration, sensor, _REFERENCE, warnings) for letter, sensor in (("ACC", "accel"), ("GYR", "gyro"))}
    holds, moved = _where_it_holds(calibration, thermal)
    if "accel" in parts:
        scale, bias = diagonal(calibration, warnings), parts["accel"].bias + moved["ACC"]
        if max(abs(bias)) > 3.5 or min(scale) < 0.8 or max(scale) > 1.2:
            warnings.append("accelerometer: bias above 3.5 m/s^2 or scale factor outside 0.8 to 1.2, which the firmware does not take")
        rows[names["accel_id"]] = _id(calibration, "accel_id")
        rows |= _named(names["accel_offset"], bias) | _named(names["accel_scale"], scale)
    if "gyro" in parts:
        rows |= _gyro(calibration, names, options, parts["gyro"].bias + moved["GYR"], warnings)
    if calibration.magnetometer is not None:
        rows |= _compass(calibration, names, i, warnings)
    if section is not None and any(found is not None for found in thermal.values()):
        low, high = section.minimum, section.maximum
        if high - low < _LEAST_RANGE:
            raise ExportError(
                f"the thermal model covers {low:.2f} to {high:.2f} degC; ArduPilot needs at least {_LEAST_RANGE:g} degC: calibrate over a "
                "wider range"
            )
        # the firmware's default of -300 degC would be clipped to TMIN, and shift the bias
        start = names["thermal"]
        rows |= {names["accel_temperature"]: holds, f"{start}ENABLE": 1, f"{start}TMIN": low, f"{start}TMAX": high}
        if options.gyro_bias and "gyro" in parts:
            rows[names["gyro_temperature"]] = holds
        for letter, found in thermal.items():
            for power in range(3):
                values = (0.0,) * 3 if found is None else found.powers[:, power] / _MILLIONTH
                rows |= _named(f"{start}{letter}{power + 1}_{{}}", values)
        if "accel" not in parts and thermal["ACC"] is not None:
            warnings.append("accelerometer: no bias is known to go with the thermal model; calibrate on the vehicle after loading this")
    if not rows:
        raise ExportError("the calibration holds no imu, magnetometer or temperature, of which ArduPilot's parameters could be made")
    return rows


def _where_it_holds(calibration: Calibration, thermal) -> tuple[float, dict[str, AnyArray]]:
    """Temperature for CALTEMP, which the firmware clips to the range, and how far the biases move from the reference to it."""
    section = calibration.temperature
    moved: dict[str, AnyArray] = dict.fromkeys(thermal, np.zeros(3))
    if section is None:
        return _REFERENCE, moved
    holds = min(max(section.reference, section.minimum), section.maximum)
    for letter, found in thermal.items():
        if found is not None and holds != section.reference:
            d = np.array([holds, section.reference]) - _REFERENCE
            here, there = (found.powers @ np.array([x, x**2, x**3]) for x in d)
            moved[letter] = here - there
    return holds, moved


def _gyro(calibration: Calibration, names: dict[str, str], options: Options, bias: AnyArray, warnings: list[str]) -> dict[str, float | int]:
    warnings += dropped_of_gyro(calibration)
    if not options.gyro_bias:
        warnings.append("gyroscope: bias not written, for the firmware learns it at every start")
        return {}
    warnings.append("gyroscope: the bias is learned anew at every start unless INS_GYR_CAL is 0")
    return _named(names["gyro_offset"], bias)


def _compass(calibration: Calibration, names: dict[str, str], i: int, warnings: list[str]) -> dict[str, float | int]:
    mag: Any = calibration.magnetometer
    if i > _COMPASSES:
        raise ExportError(f"ArduPilot has calibrations of compasses 1 to {_COMPASSES}; compass {i} is one too many")
    shape = symmetric(calibration, "COMPASS_ORIENT" if i == 1 else f"COMPASS_ORIENT{i}", warnings)
    rest = (shape[0, 1], shape[0, 2], shape[1, 2])
    if min(shape.diagonal()) < 0.2 or max(shape.diagonal()) > 5 or max(map(abs, rest)) >= 1:
        warnings.append("compass: diagonal outside 0.2 to 5 or off-diagonal of 1 and more, which the firmware does not take")
    if "COMPASS_MOT" in _applied(calibration):
        warnings.append("compass: the log had motor compensation on; firmware before per-motor compensation adds it inside the matrix")
    rows: dict[str, float | int] = {names["compass_id"]: _id(calibration, "compass_id"), names["compass_scale"]: 1}
    # the firmware adds the offset to the reading
    rows |= _named(names["compass_offset"], -mag.model.hard_iron / _MILLIGAUSS)
    return rows | _named(names["compass_diagonal"], shape.diagonal()) | _named(names["compass_rest"], rest)


def _applied(calibration: Calibration) -> str:
    return str((calibration.provenance or {}).get("applied", ""))


def _id(calibration: Calibration, name: str) -> int:
    value = device_id(calibration, "ardupilot", name)
    if value >= _LARGEST_ID:
        raise ExportError(f"ardupilot.{name} is {value}; ids of ArduPilot stay below {_LARGEST_ID}, for parameters travel as float32")
    return value


def _named(pattern: str, values) -> dict[str, float | int]:
    return {pattern.format(axis): float(value) for axis, value in zip(_AXES, values, strict=True)}
