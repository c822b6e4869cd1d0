"""The reference file as arguments, and comparisons of angles."""

import json

import numpy as np

from jaxcal.alignment import Positions, Readings, Sensor

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
    """Size of the angle between, rad."""
    return np.abs(np.angle(np.exp(1j * (np.asarray(first) - np.asarray(second)))))


def unmatched(expected, found):
    """Largest distance of an expected root from the nearest found one."""
    return max((float(np.min(apart(root, np.asarray(found)))) if len(found) else np.inf) for root in expected)


def random_attitudes(count, seed, latitudes=70.0):
    """Attitudes with |phi|, |theta| and latitude away from the poles of their own, rad, (n, 4): phi, theta, psi, latitude."""
    rng = np.random.default_rng(seed)
    span = np.array([[-80, 80], [-80, 80], [-180, 180], [-latitudes, latitudes]]) * DEG
    return rng.uniform(span[:, 0], span[:, 1], (count, 4))
