"""What a user may choose about a file."""

import math
from typing import Any

import equinox as eqx

from .._errors import ExportError

#: what filters call a term of the noise -> sensor -> its SI unit there
UNITS = {
    "density": {"gyro": "rad/s/sqrt(Hz)", "accel": "m/s^2/sqrt(Hz)"},
    "random_walk": {"gyro": "rad/s^2/sqrt(Hz)", "accel": "m/s^3/sqrt(Hz)"},
}
SENSORS = ("gyro", "accel")


class Options(eqx.Module):
    """Choices that the formats share; see `jaxcal.export.write`."""

    topic: str
    axis: str
    inflate: float | int
    density: Any
    random_walk: Any

    def __check_init__(self):
        if self.axis not in ("worst", "rms"):
            raise ExportError(f'axis={self.axis!r}: expected "worst" (the largest of the three axes) or "rms" (their root mean square)')
        if not is_positive(self.inflate):
            raise ExportError(f"inflate={self.inflate!r}: expected a number above 0 by which the noise is multiplied")
        for quantity in UNITS:
            asked = getattr(self, quantity)
            for sensor, value in (asked if isinstance(asked, dict) else dict.fromkeys(SENSORS, asked)).items():
                if sensor not in SENSORS:
                    raise ExportError(f"{quantity} names {sensor!r}; expected {' or '.join(SENSORS)}")
                if value not in (None, "upper_limit") and not is_positive(value):
                    raise ExportError(
                        f'{quantity}={value!r}: expected "upper_limit", a number above 0, or one of these for each sensor as '
                        '{"gyro": ..., "accel": ...}'
                    )


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number above 0."""
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value) and value > 0
