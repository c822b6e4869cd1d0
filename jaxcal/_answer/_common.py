"""Findings that several packages make, so that they say the same thing everywhere."""

from ._findings import CAUTION, Kind

#: gravity was neither given nor computed from a latitude; fact: gravity. A package may make it a NOTE where its result is less exact
GRAVITY_ASSUMED = Kind(
    CAUTION, "Gravity was taken as {gravity:.6g}. It differs by up to 0.3 % between places, and the accelerometer's scale with it.",
    "Give {option.gravity}; jaxcal.imu.gravity(latitude) computes it.", guess=True, terminal="Give {option.latitude}, or {option.gravity}.",
)  # fmt: skip
