"""What a sensor's errors cost: attitude, heading, velocity and position over time by cause, and the noise to write for a filter."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._motion import Motion as Motion
    from ._propagate import increments as increments, propagate as propagate
    from ._result import Budget as Budget, requirement as requirement
    from ._sensors import array as array

install(__name__, {"_motion": "Motion", "_propagate": "increments propagate", "_result": "Budget requirement", "_sensors": "array"})
