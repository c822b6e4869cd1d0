"""Ordinary flights for the calibration of compasses: banked circles and straight legs, with attitudes of a filter that err and drift.

The attitudes come from scipy's rotations and an integrated coordinated turn; nothing here is shared with the estimator.
"""

import typing

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

SPEED, GRAVITY, TAU = 15.0, 9.81, 30.0  # m/s, m/s^2, s over which the errors of the filter stay alike
DIP = np.deg2rad(63.0)
TILTS = (0.0, 10.0, 20.0, 45.0)  # degrees, of the headings that are compared


class Flight(typing.NamedTuple):
    """Times in s, readings (n, 3) of each compass in units of the field, the filter's attitudes, and the compasses' C and b."""

    time: np.ndarray
    readings: list
    attitude: Rotation
    irons: list


def flown(seed, dip=DIP, minutes=10.0, rate=5.0, banks=(15.0, 40.0), tilt=1.0, drift=2.0, tau=TAU, noise=0.005, compasses=1):
    """A flight: roll, pitch and yaw off by `tilt` degrees (Gauss-Markov), the yaw by a random walk to `drift` degrees and an offset too."""
    rng = np.random.default_rng([seed, 42])
    n, step = round(60 * minutes * rate), 1 / rate
    bank, i = np.zeros(n), 0
    while i < n:
        turn = round(rng.uniform(15, 60) * rate)
        bank[i : i + turn] = np.deg2rad(rng.uniform(*banks)) * rng.choice([-1.0, 1.0])
        i += turn + round(rng.uniform(5, 20) * rate)
    bank = np.convolve(bank, np.ones(round(3 * rate)) / round(3 * rate), "same")
    time = np.arange(n) * step
    pitch = np.deg2rad(4.0 + 3.0 * np.sin(2 * np.pi * time / 47 + rng.uniform(0, 6)))
    yaw = rng.uniform(0, 2 * np.pi) + np.cumsum(GRAVITY * np.tan(bank) / SPEED) * step
    truth = Rotation.from_euler("ZYX", np.stack([yaw, pitch, bank], axis=1))
    decay = np.exp(-step / tau)
    steps = rng.normal(size=(n, 3)) * np.sqrt(1 - decay**2)
    steps[0] = rng.normal(size=3)
    error = np.deg2rad(tilt) * lfilter([1.0], [1.0, -decay], steps, axis=0)
    error[:, 2] += np.deg2rad(drift) * (rng.normal() + np.cumsum(rng.normal(size=n)) / np.sqrt(n))
    field = truth.inv().apply([np.cos(dip), 0.0, np.sin(dip)])
    irons = [(np.eye(3) + 0.05 * rng.normal(size=(3, 3)), 0.5 * rng.normal(size=3)) for _ in range(compasses)]
    readings = [field @ soft.T + hard + noise * rng.normal(size=(n, 3)) for soft, hard in irons]
    return Flight(time, readings, Rotation.from_rotvec(error) * truth, irons)


def heading_errors(model, iron, dip=DIP, size=1.0):
    """Root mean square heading errors of a model in rad at the `TILTS`; `size` of the field in the unit of the model."""
    found, yaw = [], np.arange(24) * np.pi / 12
    for tilt in np.deg2rad(TILTS):
        ways = np.arange(8) * np.pi / 4 if tilt else np.zeros(1)
        lean = Rotation.from_rotvec(np.repeat(tilt * np.stack([np.cos(ways), np.sin(ways), 0 * ways], axis=1), 24, axis=0))
        body = Rotation.from_euler("z", np.tile(yaw, len(ways))[:, None]) * lean
        m = size * (body.inv().apply([np.cos(dip), 0.0, np.sin(dip)]) @ iron[0].T + iron[1])
        east, north = body.apply(np.linalg.solve(np.asarray(model.soft_iron), (m - np.asarray(model.hard_iron)).T).T)[:, 1::-1].T
        found.append(np.sqrt(np.mean(np.arctan2(east, north) ** 2)))
    return np.array(found)


class Dive(typing.NamedTuple):
    """Times in s, readings, the true hard iron at each, C, and the unit fields in the sensor's axes."""

    time: np.ndarray
    m: np.ndarray
    hard: np.ndarray
    soft: np.ndarray
    field: np.ndarray


def dived(seed, count=6000, hours=2.0, drift=0.01, tilt=0.5, noise=0.005, trend=False, dip=DIP):
    """A vehicle whose attitude wanders (`tilt` in rad), with a hard iron that walks by `drift` of the field in an hour, or has a trend."""
    rng, time = np.random.default_rng([seed, 43]), np.linspace(0.0, 3600 * hours, count)
    step = time[1]
    decay = np.exp(-step / 60)
    turns = lfilter([1.0], [1.0, -decay], np.sqrt(1 - decay**2) * rng.normal(size=(count, 3)), axis=0) * [0.02, tilt, tilt]
    turns[:, 0] = rng.uniform(0, 2 * np.pi) + np.cumsum(turns[:, 0]) * step
    field = Rotation.from_euler("ZYX", turns).inv().apply([np.cos(dip), 0.0, np.sin(dip)])
    change = rng.normal(size=(3, 3))
    soft = np.eye(3) + 0.05 * (change + change.T)
    walk = (
        time[:, None] / 3600 * rng.choice([-1.0, 1.0], 3)
        if trend
        else np.cumsum(np.sqrt(step / 3600) * rng.normal(size=(count, 3)), axis=0)
    )
    hard = 0.3 * rng.normal(size=3) + drift * walk
    return Dive(time, field @ soft.T + hard + noise * rng.normal(size=field.shape), hard, soft, field)


def least(dive, drift=0.01, noise=0.005):
    """Posterior bound (n,) of the rms error of an axis: Kalman filter and smoother of the linear model, with the true parameters."""
    normal = dive.field @ np.linalg.inv(dive.soft)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    q, now, before, after = drift**2 * dive.time[1] / 3600 * np.eye(3), 0.3**2 * np.eye(3), [], []
    for row in normal:
        before.append(now)
        gain = now @ row
        after.append(now - np.outer(gain, gain) / (row @ gain + noise**2))
        now = after[-1] + q
    found = [after[-1]]
    for i in range(len(normal) - 2, -1, -1):
        back = after[i] @ np.linalg.inv(before[i + 1])
        found.append(after[i] + back @ (found[-1] - before[i + 1]) @ back.T)
    return np.sqrt(np.trace(found[::-1], axis1=1, axis2=2) / 3)
