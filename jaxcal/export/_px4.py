"""PX4's parameters for QGroundControl: https://docs.px4.io/main/en/advanced_config/sensor_thermal_calibration.html."""

from .._errors import ExportError
from ..calibration import Calibration
from ._matrices import diagonal, dropped_of_gyro, symmetric
from ._options import Options
from ._thermal import Cubics, cubics, device_id, gyro_bias

_GAUSS = 1e-4  # T
_AXES = "XYZ"


def px4(calibration: Calibration, options: Options) -> tuple[str, tuple[str, ...]]:
    """Text of the file, and warnings."""
    warnings: list[str] = []
    rows: dict[str, float | int] = {}
    imu = calibration.imu or {}
    if "accel" in imu:
        rows["CAL_ACC0_ID"] = device_id(calibration, "px4", "accel_id")
        rows |= _named("CAL_ACC0_{}OFF", imu["accel"]["bias"]) | _named("CAL_ACC0_{}SCALE", diagonal(calibration, warnings))
    bias = gyro_bias(calibration)
    if bias is not None:
        rows["CAL_GYRO0_ID"] = device_id(calibration, "px4", "gyro_id")
        rows |= _named("CAL_GYRO0_{}OFF", bias)
        warnings += dropped_of_gyro(calibration)
    if calibration.magnetometer is not None:
        shape = symmetric(calibration, "CAL_MAG0_ROT", warnings)
        rows["CAL_MAG0_ID"] = device_id(calibration, "px4", "mag_id")
        rows |= _named("CAL_MAG0_{}OFF", calibration.magnetometer["hard_iron"] / _GAUSS)
        rows |= _named("CAL_MAG0_{}SCALE", shape.diagonal()) | _named("CAL_MAG0_{}ODIAG", (shape[0, 1], shape[0, 2], shape[1, 2]))
    for sensor, letter in (("accel", "A"), ("gyro", "G")):
        found = cubics(calibration, sensor, None, warnings)
        if found is not None:
            rows |= _thermal(found, letter, device_id(calibration, "px4", f"{sensor}_id"))
            if sensor == "accel" and "accel" not in imu:
                warnings.append("accelerometer: no bias is known to go with the thermal model; calibrate on the vehicle after loading this")
    if not rows:
        raise ExportError("the calibration holds no imu, magnetometer or temperature, of which PX4's parameters could be made")
    lines = [f"1\t1\t{name}\t{value:.9g}\t{6 if isinstance(value, int) else 9}" for name, value in sorted(rows.items())]
    head = ("# Sensor calibration written by jaxcal", "#", "# Vehicle-Id Component-Id Name Value Type")
    return "\n".join((*head, *lines)) + "\n", tuple(warnings)


def _named(pattern: str, values) -> dict[str, float | int]:
    return {pattern.format(axis): float(value) for axis, value in zip(_AXES, values, strict=True)}


def _thermal(found: Cubics, letter: str, number: int) -> dict[str, float | int]:
    """The constant stays in CAL_*OFF: to switch the thermal model off must not move the bias at the reference."""
    rows: dict[str, float | int] = {
        f"TC_{letter}_ENABLE": 1, f"TC_{letter}0_ID": number, f"TC_{letter}0_TMIN": found.minimum, f"TC_{letter}0_TMAX": found.maximum,
        f"TC_{letter}0_TREF": found.reference,
    }  # fmt: skip
    for axis in range(3):
        rows[f"TC_{letter}0_X0_{axis}"] = 0.0
        rows |= {f"TC_{letter}0_X{power + 1}_{axis}": float(found.powers[axis, power]) for power in range(3)}
    return rows
