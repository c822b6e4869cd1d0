"""ArduPilot's parameters for Mission Planner and MAVProxy: https://ardupilot.org/copter/docs/common-imutempcal.html."""

from .._errors import ExportError
from ..calibration import Calibration
from ._matrices import diagonal, dropped_of_gyro, symmetric
from ._options import Options
from ._thermal import cubics, device_id

_MILLIGAUSS = 1e-7  # T
_REFERENCE = 35.0  # degC about which the firmware expands every polynomial
_LEAST_RANGE = 10.0  # degC
_AXES = "XYZ"


def ardupilot(calibration: Calibration, options: Options) -> tuple[str, tuple[str, ...]]:
    """Text of the file, and warnings."""
    warnings: list[str] = []
    rows: dict[str, float | int] = {}
    imu, section = calibration.imu or {}, calibration.temperature
    if "accel" in imu:
        scale, bias = diagonal(calibration, warnings), imu["accel"]["bias"]
        if max(abs(bias)) > 3.5 or min(scale) < 0.8 or max(scale) > 1.2:
            warnings.append("accelerometer: bias above 3.5 m/s^2 or scale factor outside 0.8 to 1.2, which the firmware does not take")
        rows["INS_ACC_ID"] = device_id(calibration, "ardupilot", "accel_id")
        rows |= _named("INS_ACCOFFS_{}", bias) | _named("INS_ACCSCAL_{}", scale)
    if "gyro" in imu:
        warnings += [*dropped_of_gyro(calibration), "gyroscope: bias not written, for the firmware learns it at every start"]
    if calibration.magnetometer is not None:
        shape = symmetric(calibration, "COMPASS_ORIENT", warnings)
        rows |= {"COMPASS_DEV_ID": device_id(calibration, "ardupilot", "compass_id"), "COMPASS_SCALE": 1}
        rows |= _named("COMPASS_OFS_{}", -calibration.magnetometer["hard_iron"] / _MILLIGAUSS)
        rows |= _named("COMPASS_DIA_{}", shape.diagonal()) | _named("COMPASS_ODI_{}", (shape[0, 1], shape[0, 2], shape[1, 2]))
    thermal = {letter: cubics(calibration, sensor, _REFERENCE, warnings) for letter, sensor in (("ACC", "accel"), ("GYR", "gyro"))}
    if section is not None and any(found is not None for found in thermal.values()):
        low, high = section["minimum"], section["maximum"]
        if high - low < _LEAST_RANGE:
            raise ExportError(
                f"the thermal model covers {low:.2f} to {high:.2f} degC; ArduPilot needs at least {_LEAST_RANGE:g} degC: calibrate over a "
                "wider range"
            )
        # the firmware's default of -300 degC would be clipped to TMIN, and shift the bias
        rows |= {"INS_ACC1_CALTEMP": section["reference"], "INS_TCAL1_ENABLE": 1, "INS_TCAL1_TMIN": low, "INS_TCAL1_TMAX": high}
        for letter, found in thermal.items():
            for power in range(3):
                values = (0.0,) * 3 if found is None else found.powers[:, power] * 1e6
                rows |= _named(f"INS_TCAL1_{letter}{power + 1}_{{}}", values)
        if "accel" not in imu and thermal["ACC"] is not None:
            warnings.append("accelerometer: no bias is known to go with the thermal model; calibrate on the vehicle after loading this")
    if not rows:
        raise ExportError("the calibration holds no imu, magnetometer or temperature, of which ArduPilot's parameters could be made")
    lines = [f"{name},{value:.9g}" for name, value in sorted(rows.items())]
    return "\n".join(("# Sensor calibration written by jaxcal", *lines)) + "\n", tuple(warnings)


def _named(pattern: str, values) -> dict[str, float | int]:
    return {pattern.format(axis): float(value) for axis, value in zip(_AXES, values, strict=True)}
