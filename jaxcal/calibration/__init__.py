"""Everything known about one device."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._calibration import Calibration as Calibration
    from ._difference import Difference as Difference, PartDifference as PartDifference, difference as difference
    from ._find import find as find
    from ._noise import DeviceNoise as DeviceNoise, SensorNoise as SensorNoise
    from ._parts import Imu as Imu, Part as Part
    from ._provenance import provenance as provenance
    from ._thermal import Thermal as Thermal, polynomials as polynomials

install(
    __name__,
    {
        "_calibration": "Calibration", "_difference": "Difference PartDifference difference", "_find": "find",
        "_noise": "DeviceNoise SensorNoise", "_parts": "Imu Part", "_provenance": "provenance", "_thermal": "Thermal polynomials",
    },
)  # fmt: skip
