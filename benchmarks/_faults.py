"""Magnetometer logs with errors that the fit does not model, simulated without jaxcal; and the quality of the fit on them.

A log has six hundred readings of a sensor turned by hand: rates wander with a correlation time of 25 readings, 0.12 rad per reading in
each axis. White noise is 1 % of the field unless the case differs. The true hard iron is that of the mean state during the log, for a drift
and for a current too. Conditions are recorded for the case "current", but not for "current unrecorded". The share of an error is judged
for each of the three axes that may point down.
"""

import numpy as np
import scipy.signal
from scipy.spatial.transform import Rotation

SOFT = np.array([[1.1, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]])
HARD = np.array([0.3, -0.2, 0.4])
DIP = np.deg2rad(57.0)
COUNT = 600
#: rotations of the axes: each of the three axes points down in one of them
TURNS = [np.roll(np.eye(3), axis, axis=0) for axis in range(3)]
_HEADINGS = np.arange(24) * np.pi / 12

#: (case, size) -> the finding that the fit should have
CASES = {
    ("white", 0.005): None, ("white", 0.01): None, ("white", 0.05): None,
    ("AR(1)", 0.8): "correlated", ("AR(1)", 0.9): "correlated", ("AR(1)", 0.97): "correlated",
    ("drift", 0.02): "correlated", ("drift", 0.05): "correlated", ("drift", 0.1): "correlated",
    ("field", 0.02): "correlated", ("field", 0.05): "correlated",
    ("current", 0.05): "follows", ("current", 0.1): "follows",
    ("current unrecorded", 0.05): "correlated", ("current unrecorded", 0.1): "correlated",
    ("low-pass", 3): "averaged", ("quadratic", 0.02): "bent", ("clipping", 0.02): "clipped",
}  # fmt: skip


def wander(factor, count, columns, rng):
    """AR(1) series with variance one, (count, columns)."""
    noise = rng.normal(size=(count, columns)) * np.sqrt(1 - factor**2)
    noise[0] /= np.sqrt(1 - factor**2)
    return scipy.signal.lfilter([1], [1, -factor], noise, axis=0)


def turned(count, rng, speed, finer=1):
    """True field in body axes, (count, 3), of magnitude one."""
    rates = speed / finer * wander(np.exp(-1 / (25 * finer)), count * finer, 3, rng)
    attitude, found = Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), []
    for step in Rotation.from_rotvec(rates).as_matrix():
        attitude = attitude @ step
        found.append(attitude)
    return np.array([np.cos(DIP), 0.0, np.sin(DIP)]) @ np.array(found)


def simulate(case, seed, count=COUNT):
    """Readings (count, 3), and the recorded conditions."""
    return simulated(case, seed, count)[:2]


def simulated(case, seed, count=COUNT):
    """Readings (count, 3), the recorded conditions, and the mean hard iron."""
    (name, size), rng = case, np.random.default_rng([seed, sum(map(ord, case[0])), round(1000 * case[1])])
    averaged = name == "low-pass"
    field = turned(count, rng, 0.25 if averaged else 0.12, 3 if averaged else 1)
    way = rng.normal(size=3)
    way /= np.linalg.norm(way)
    if name == "field":
        smooth = scipy.signal.lfilter(np.ones(20) / 20, 1, wander(np.exp(-0.01), count, 1, rng), axis=0)
        field = field * (1 + size * smooth)
    m, conditions, hard = field @ SOFT.T + HARD, {}, HARD
    if averaged:
        m = scipy.signal.lfilter(np.ones(3 * size) / (3 * size), 1, m, axis=0)[::3]
        m[:size] = m[size]
    if name == "drift":
        m, hard = m + size * np.linspace(0, 1, count)[:, None] * way, HARD + size * way / 2
    if name == "quadratic":
        m = m + size * m**2 * rng.choice([-1, 1], 3)
    if name.startswith("current"):
        current = np.repeat(rng.uniform(0, 1, count // 20 + 1), 20)[:count]
        m, hard = m + size * current[:, None] * way, HARD + size * current.mean() * way
        conditions = {"current": current} if name == "current" else {}
    noise = 0.02 * wander(size, count, 3, rng) if name == "AR(1)" else (size if name == "white" else 0.01) * rng.normal(size=(count, 3))
    m = m + noise
    if name == "clipping":
        m[:, 0] = np.minimum(m[:, 0], np.quantile(m[:, 0], 1 - size))
    return m, conditions, hard


def random_log(seed, tilt=(5.0, 180.0), noise=(0.001, 0.2), count=(5, 3000)):
    """Readings (n, 3) of a random sensor at all headings and at tilts up to an angle in degrees; noise over field and n are log-uniform."""
    rng = np.random.default_rng([7, seed])
    n, spread = (np.exp(rng.uniform(*np.log(limits))) for limits in (count, noise))
    dip, most = rng.uniform(-1.3, 1.3), np.deg2rad(rng.uniform(*tilt))
    angles = rng.uniform(0, 2 * np.pi, int(n)), np.arccos(rng.uniform(np.cos(most), 1, int(n))), rng.uniform(0, 2 * np.pi, int(n))
    first, lean, last = (Rotation.from_rotvec(angle[:, None] * axis) for angle, axis in zip(angles, np.eye(3)[[2, 1, 2]], strict=True))
    field = (first * lean * last).inv().apply([np.cos(dip), 0.0, np.sin(dip)])
    soft = np.eye(3) + 0.1 * rng.normal(size=(3, 3))
    return field @ (soft + soft.T) / 2 + rng.normal(size=3) + spread * rng.normal(size=field.shape)


def level_field():
    """Field of magnitude one at 24 level headings, (24, 3)."""
    return np.stack([np.cos(_HEADINGS) * np.cos(DIP), -np.sin(_HEADINGS) * np.cos(DIP), np.full(24, np.sin(DIP))], axis=1)


def heading_error(model, hard=HARD, turn=TURNS[0]):
    """Root mean square error of the level headings, in rad, for readings without noise; `turn` exchanges the axes of the sensor."""
    y = (level_field() @ turn @ SOFT.T + hard - model.hard_iron) @ np.linalg.inv(model.soft_iron).T @ turn.T
    off = np.arctan2(-y[:, 1], y[:, 0]) - _HEADINGS
    return np.sqrt(np.mean(np.angle(np.exp(1j * off)) ** 2))


def tried(fit, case, runs, first=0):
    """For each fit and axis down: good, true heading error in degrees, true over stated, cause named, share of truths in intervals."""
    rows = []
    for seed in range(first, first + runs):
        m, conditions, hard = simulated(case, seed)
        found = fit(m, conditions=conditions)
        inside = [one.low < truth < one.high for one, truth in zip(found.estimate.select("hard_iron*").numbers(), hard, strict=True)]
        for turn in TURNS:
            error = heading_error(found.model, hard, turn)
            rows.append(
                (found.verdict == "good", np.rad2deg(error), error / found.heading_error[0], CASES[case] in found.codes, np.mean(inside))
            )
    return np.array(rows, dtype=float)
