"""Thermal models as the cubic polynomials that flight controllers know."""

import equinox as eqx
import numpy as np

from .._errors import ExportError
from .._types import AnyArray
from .._units import si_unit
from ..calibration import Calibration
from ..calibration._thermal import AXES, Thermal, cubic
from ._matrices import triads

DEGREE = 3
_NARROW = 10.0  # degC
_ROUNDING = 1e-13  # of the largest term; what is smaller is left by the change of the reference


class Cubics(eqx.Module):
    """`powers` (3, 3): coefficients of d, d^2 and d^3 for each axis, d = T - reference; range and reference in degC."""

    powers: AnyArray
    reference: float
    minimum: float
    maximum: float


def cubics(calibration: Calibration, sensor: str, reference: float | None, warnings: list[str]) -> Cubics | None:
    """Thermal model of a sensor about `reference` (None: its own); None where there is none."""
    section = calibration.temperature
    if section is None:
        return None
    about = section.reference if reference is None else reference
    found = cubic(section, sensor, DEGREE, about)
    if found is None:
        return None
    coefficients, _, lost = found
    name = {"accel": "accelerometer", "gyro": "gyroscope"}[sensor]
    for axis, departure in zip(AXES, lost, strict=True):
        if departure > 0:
            jumps = ", ".join(f"{centre:.2f}" for centre in getattr(section.of(sensor)[axis].curve, "centre", ()))
            what = f"; the jump at {jumps} degC is smeared out" if jumps else ""
            warnings.append(
                f"{name} {axis}: the cubic that the format knows departs from the model by up to {departure:.3g} {si_unit(sensor)}{what}"
            )
        _without_hysteresis(section, sensor, axis, name, warnings)
    width = section.maximum - section.minimum
    if width < _NARROW:
        warnings.append(f"{name}: the thermal model covers {width:.3g} degC; outside it the flight controller keeps the value at the end")
    if not section.minimum <= section.reference <= section.maximum:
        warnings.append(
            f"{name}: {section.reference:g} degC, at which the bias holds, is outside the thermal model ({section.minimum:g} to "
            f"{section.maximum:g} degC)"
        )
    reach = np.abs(np.array([section.minimum, section.maximum]) - about).max() ** np.arange(1, DEGREE + 1)
    share = np.abs(coefficients) * reach
    coefficients = np.where(share > _ROUNDING * share.max(initial=0.0), coefficients, 0.0)
    return Cubics(coefficients, float(about), section.minimum, section.maximum)


def _without_hysteresis(section: Thermal, sensor: str, axis: str, name: str, warnings: list[str]) -> None:
    model = section.of(sensor).get(axis)
    if model is not None and (model.lag > 0 or model.play > 0):
        warnings.append(f"{name} {axis}: lag and play not written, for there is no place for them; heating and cooling will differ")


def gyro_bias(calibration: Calibration) -> AnyArray | None:
    """Bias of the gyroscope at the reference temperature, rad/s: of the imu section, or else of the thermal model."""
    parts, section = triads(calibration), calibration.temperature
    if "gyro" in parts:
        return parts["gyro"].bias
    if section is None or len(section.of("gyro")) < len(AXES) or section.powers("gyro") is not None:
        return None
    return np.array([section.constant(f"gyro_{axis}") for axis in AXES])


def device_id(calibration: Calibration, tool: str, name: str) -> int:
    """Id by which a flight controller finds a sensor.

    Raises
    ------
    ExportError
        If the calibration does not hold it.
    """
    ids = (calibration.device or {}).get(tool)
    value = ids.get(name) if isinstance(ids, dict) else None
    if not isinstance(value, int) or isinstance(value, bool) or not 0 < value < 2**31:
        raise ExportError(
            f"the {name} of the sensor is not known, and the flight controller finds its parameters by it; give it as "
            f'Calibration(device={{"name": ..., "{tool}": {{"{name}": ID}}}}), with the number that the parameter list of the vehicle shows'
        )
    return value
