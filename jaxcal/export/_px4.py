"""PX4's parameters for QGroundControl: https://docs.px4.io/main/en/advanced_config/sensor_thermal_calibration.html."""

from collections.abc import Sequence

from .._errors import ExportError
from ..calibration import Calibration
from ._matrices import diagonal, dropped_of_gyro, symmetric, triads
from ._options import Options, Product
from ._text import plain
from ._thermal import Cubics, cubics, device_id, gyro_bias

_GAUSS = 1e-4  # T
_AXES = "XYZ"
_MOST = 4
_FACTS = ("units: accelerometer m/s^2, gyroscope rad/s, magnetometer gauss; temperature degC; scale factors 1",)


def px4(calibrations: Sequence[Calibration], options: Options) -> Product:
    """One instance of each sensor for every calibration, from `options.instance` on."""
    rows: dict[str, float | int] = {}
    warnings: list[str] = []
    for i, calibration in enumerate(calibrations, options.instance):
        if i >= _MOST:
            raise ExportError(f"PX4 has instances 0 to {_MOST - 1} of a sensor; instance {i} is one too many")
        rows |= _rows(calibration, i, warnings)
    lines = [f"1\t1\t{name}\t{plain(value)}\t{6 if isinstance(value, int) else 9}" for name, value in sorted(rows.items())]
    head = ("# Sensor calibration written by jaxcal", "#", "# Vehicle-Id Component-Id Name Value Type")
    return Product("\n".join((*head, *lines)) + "\n", tuple(warnings), _FACTS)


def _rows(calibration: Calibration, i: int, warnings: list[str]) -> dict[str, float | int]:
    rows: dict[str, float | int] = {}
    parts = triads(calibration)
    if "accel" in parts:
        scale, bias = diagonal(calibration, warnings), parts["accel"].bias
        if min(scale) < 0.1 or max(scale) > 3:
            warnings.append("accelerometer: scale factor outside 0.1 to 3, which the firmware does not take; were the readings in m/s^2?")
        rows[f"CAL_ACC{i}_ID"] = device_id(calibration, "px4", "accel_id")
        rows |= _named(f"CAL_ACC{i}_{{}}OFF", bias) | _named(f"CAL_ACC{i}_{{}}SCALE", scale)
    bias = gyro_bias(calibration)
    if bias is not None:
        rows[f"CAL_GYRO{i}_ID"] = device_id(calibration, "px4", "gyro_id")
        rows |= _named(f"CAL_GYRO{i}_{{}}OFF", bias)
        warnings += dropped_of_gyro(calibration)
    if calibration.magnetometer is not None:
        shape = symmetric(calibration, f"CAL_MAG{i}_ROT", warnings)
        rows[f"CAL_MAG{i}_ID"] = device_id(calibration, "px4", "mag_id")
        rows |= _named(f"CAL_MAG{i}_{{}}OFF", calibration.magnetometer.model.hard_iron / _GAUSS)
        rows |= _named(f"CAL_MAG{i}_{{}}SCALE", shape.diagonal()) | _named(f"CAL_MAG{i}_{{}}ODIAG", (shape[0, 1], shape[0, 2], shape[1, 2]))
    for sensor, letter in (("accel", "A"), ("gyro", "G")):
        found = cubics(calibration, sensor, None, warnings)
        if found is not None:
            rows |= _thermal(found, letter, i, device_id(calibration, "px4", f"{sensor}_id"))
            if sensor == "accel" and "accel" not in parts:
                warnings.append("accelerometer: no bias is known to go with the thermal model; calibrate on the vehicle after loading this")
    if not rows:
        raise ExportError("the calibration holds no imu, magnetometer or temperature, of which PX4's parameters could be made")
    if any(name.startswith("TC_") for name in rows):
        warnings.append("TC_A_ENABLE and TC_G_ENABLE are read at the start of the vehicle: restart it after loading this")
    return rows


def _named(pattern: str, values) -> dict[str, float | int]:
    return {pattern.format(axis): float(value) for axis, value in zip(_AXES, values, strict=True)}


def _thermal(found: Cubics, letter: str, i: int, number: int) -> dict[str, float | int]:
    """The constant stays in CAL_*OFF: to switch the thermal model off must not move the bias at the reference."""
    start = f"TC_{letter}{i}"
    rows: dict[str, float | int] = {
        f"TC_{letter}_ENABLE": 1, f"{start}_ID": number, f"{start}_TMIN": found.minimum, f"{start}_TMAX": found.maximum,
        f"{start}_TREF": found.reference,
    }  # fmt: skip
    for axis in range(3):
        rows[f"{start}_X0_{axis}"] = 0.0
        rows |= {f"{start}_X{power + 1}_{axis}": float(found.powers[axis, power]) for power in range(3)}
    return rows
