"""Findings that several packages make, so that they say the same thing everywhere."""

from collections.abc import Mapping

from ._findings import CAUTION, Finding, Kind, Table

#: gravity was neither given nor computed from a latitude; fact: gravity. A package may make it a NOTE where its result is less exact
GRAVITY_ASSUMED = Kind(
    CAUTION, "Gravity was taken as {gravity:.6g}. It differs by up to 0.3 % between places, and the accelerometer's scale with it.",
    "Give {option.gravity}; jaxcal.imu.gravity(latitude) computes it.", guess=True, terminal="Give {option.latitude}, or {option.gravity}.",
)  # fmt: skip
#: a scale factor that no sensor in its right range and unit has; fact: scale
WRONG_RANGE = Kind(
    CAUTION, "The scale is {scale:.3g}: the range of the sensor, or the unit of its column, is wrong.", "Check the range that was set.",
    limits=(0.1,),  # from 1, beyond twice its error: data sheets allow 3 % (MPU-6050) and less; a wrong range is off by 2
)  # fmt: skip


def wrong_ranges(findings: Table, known: Mapping[str, tuple[float, float]]) -> list[Finding]:
    """A finding `range` for each axis whose scale is far from 1; `known` has value and standard error of parameters by name."""
    said = []
    for sensor, (i, axis) in ((sensor, axis) for sensor in ("accel", "gyro") for axis in enumerate("xyz")):
        scale, error = known.get(f"{sensor}.matrix[{i},{i}]", (1.0, 0.0))
        said += findings.over("range", abs(scale - 1) - 2 * error, f"{sensor}_{axis}", scale=scale)
    return said
