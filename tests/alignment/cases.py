"""Convert entries of the reference file to arguments of `jaxcal.alignment`, and compare angles."""

import json

import numpy as np

from jaxcal.alignment import Positions, Readings, Sensor
from jaxcal.alignment._findings import OUTCOMES

DEG = np.pi / 180
ARW, VRW = 0.01 * DEG / 60, 50e-6 * 9.80665


def vectors(reference):
    return json.loads((reference / "reference" / "alignment_vectors.json").read_text())


def positions(rows, dwell=1.0, start=None):
    return Positions([angle * DEG for _, angle in rows], [word for word, _ in rows], dwell, start)


def sensor(errors):
    return Sensor(
        scale_error=errors["scale_error"], misalignment=np.array(errors["misalignment"]), bias=errors["bias"],
        bias_rate=errors.get("bias_rate", 0.0),
    )  # fmt: skip


def readings(data, case, kind):
    return Readings(positions(data["positions"]), np.array(case[f"accel_{kind}"]), np.array(case[f"gyro_{kind}"]))


def apart(first, second):
    """Absolute difference of two angles modulo 2 pi, rad."""
    return np.abs(np.angle(np.exp(1j * (np.asarray(first) - np.asarray(second)))))


def unmatched(expected, found):
    """Distance of every expected root from the nearest root found, of which the largest is returned, rad."""
    return max((float(np.min(apart(root, np.asarray(found)))) if len(found) else np.inf) for root in expected)


def random_attitudes(count, seed, latitudes=70.0):
    """Random attitudes whose roll, pitch and latitude are away from +-90 degrees, rad, (n, 4): phi, theta, psi, latitude."""
    rng = np.random.default_rng(seed)
    span = np.array([[-80, 80], [-80, 80], [-180, 180], [-latitudes, latitudes]]) * DEG
    return rng.uniform(span[:, 0], span[:, 1], (count, 4))


def outcome(found):
    """Code of the outcome of a method: "ok", or that of a finding."""
    code = OUTCOMES[int(found.outcome)]
    assert code == "ok" or code in found.codes
    return code
