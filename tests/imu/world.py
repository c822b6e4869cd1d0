"""Simulated recordings of a hand-turned IMU that use NumPy and SciPy but not jaxcal, with effects that jaxcal's model does not contain.

A case is a name in `CASES` with options of `record`. The truth is the linear part of both sensors in the frame of the convention
"upper", in which `multi_position` reports its result.
"""

import numpy as np
from scipy.spatial.transform import Rotation

RATE, GRAVITY = 100.0, 9.81
NOISE_ACCEL, NOISE_GYRO = 1.5e-3, 1e-4  # m/s/sqrt(s), rad/sqrt(s)
DEGREE = np.pi / 180

#: name of each case: options of `record`
CASES = {
    "base": {},
    "9 poses": {"poses": 9},
    "12 poses": {"poses": 12},
    "hemisphere": {"hemisphere": True},
    "tremor": {"tremor": 1e-3},
    "hand drift": {"drift": 0.3 * DEGREE},
    "wide drift": {"drift": 1.5 * DEGREE, "tremor": 4e-3, "initial": 3.0},
    "vibration": {"vibration": 0.15},
    "quadratic": {"quadratic": 3e-3 / 9.81},
    "asymmetry": {"asymmetry": 2e-3},
    "quadratic, 12": {"quadratic": 3e-3 / 9.81, "poses": 12},
    "asymmetry, 12": {"asymmetry": 2e-3, "poses": 12},
    "gyro cubic": {"cubic": 0.005 / (250 * DEGREE) ** 2},
    "lever arm": {"lever": 0.05},
    "offset 20 ms": {"offset": 0.02},
    "saturation": {"saturation": 100 * DEGREE},
    "jitter": {"jitter": 0.6},
    "missing 0.2 %": {"missing": 0.002},
    "missing 2 %": {"missing": 0.02},
    "missing 10 %": {"missing": 0.1},
    "warm-up": {"warm_up": 0.05},
    "creep 0.1 %": {"creep": 1e-3},
    "creep 0.5 %": {"creep": 5e-3},
    "hysteresis": {"hysteresis": 1.2e-3 * GRAVITY},
    "creep 0.05 %, 12": {"creep": 5e-4, "poses": 12},
    "jump": {"jump": (3e-3 * GRAVITY, 0.05 * DEGREE)},
    "gyro drift": {"gyro_drift": 0.1 * DEGREE},
}


def _matrices(rng):
    """Draw sensors with scale errors of 1 %, misalignment of half a degree, biases, and a g-sensitivity of 20 deg/h/(m/s^2)."""
    accel = np.eye(3) + np.triu(rng.normal(size=(3, 3)) * np.where(np.eye(3), 0.01, 0.008))
    gyro = np.eye(3) + rng.normal(size=(3, 3)) * np.where(np.eye(3), 0.01, 0.008)
    return accel, 0.1 * rng.normal(size=3), gyro, 0.01 * rng.normal(size=3), 1e-4 * rng.normal(size=(3, 3))


def _directions(rng, poses, hemisphere):
    """Upward directions of the poses: faces, edges and corners in random order, each off by several degrees."""
    grid = np.array([p for p in np.ndindex(3, 3, 3) if p != (1, 1, 1)]) - 1.0
    grid = grid[np.argsort(np.abs(grid).sum(axis=1), kind="stable")]
    if hemisphere:
        grid = grid[grid[:, 2] >= 0]
    up = grid[np.arange(poses) % len(grid)]
    up = up / np.linalg.norm(up, axis=1, keepdims=True) + 0.15 * rng.normal(size=(poses, 3))
    return rng.permutation(up / np.linalg.norm(up, axis=1, keepdims=True))


def _smooth(rng, count, dt, low, high):
    """Draw smooth random motion of unit variance between two frequencies with the discrete Fourier transform, (count, 3)."""
    frequency = np.fft.rfftfreq(count, dt)
    spectrum = np.fft.rfft(rng.normal(size=(count, 3)), axis=0)
    path = np.fft.irfft(np.where(((frequency >= low) & (frequency <= high))[:, None], spectrum, 0), count, axis=0)
    return path / np.std(path)


def record(
    seed, *, poses=24, hemisphere=False, tremor=0.0, drift=0.0, vibration=0.0, quadratic=0.0, asymmetry=0.0, cubic=0.0, lever=0.0,
    offset=0.0, saturation=None, jitter=0.0, missing=0.0, warm_up=0.0, initial=20.0, device=None, arms=None, sway=0.0,
    creep=0.0, hysteresis=0.0, jump=None, gyro_drift=0.0,
):  # fmt: skip
    """Simulate one recording: stamps (s), accelerometer, gyroscope, and the truth (33 parameters).

    tremor, drift: motion of the hand (rad) at 9 Hz and below 0.5 Hz, in poses and turns but not in the initial rest. vibration: m/s^2 at
    23 Hz in every other pose. quadratic: reading per (m/s^2)^2. asymmetry: relative difference of the scale by sign. cubic: per
    (rad/s)^2. lever: length of the lever arm, m. offset: delay of the gyroscope, s. jitter: of the sampling instants, in periods; the
    stamps do not show it. missing: share of samples lost. warm_up: change of the accelerometer's bias, m/s^2, with a time constant of
    60 s. arms: position of each axis of the accelerometer, (3, 3), m. sway: linear acceleration of the hand during the turns, m/s^2.
    creep: share of a change of the force that the reading follows with a time constant of 15 s. hysteresis: play of the reading, m/s^2.
    jump: of both biases after pose 12, m/s^2 and rad/s. gyro_drift: change of the gyroscope's bias along the log, rad/s; the truth is that
    of the middle.
    """
    rng = np.random.default_rng([seed, 20])
    matrix, bias, gyro_matrix, gyro_bias, sensitivity = _matrices(rng if device is None else np.random.default_rng([device, 21]))
    up = _directions(rng, poses, hemisphere)
    fine = 4  # samples of the motion per sample of the sensors
    dt = 1 / (RATE * fine)
    held, labels, attitude = [], [], Rotation.align_vectors([[0.0, 0, 1]], [up[0]])[0] * Rotation.identity()
    for k in range(poses):
        still = initial if k == 0 else rng.uniform(2.5, 4.0)
        count = round(still / dt)
        held.append(np.repeat(attitude.as_matrix()[None], count, axis=0))
        labels.append(np.full(count, k))
        if k + 1 < poses:
            # turn to a random attitude with the next direction up, along a path that is not a rotation about a single axis
            goal = Rotation.from_rotvec([0, 0, rng.uniform(-1.5, 1.5)]) * Rotation.align_vectors([[0.0, 0, 1]], [up[k + 1]])[0]
            relative = (attitude.inv() * goal).as_rotvec()
            angle = np.linalg.norm(relative)
            count = round(max(angle / (90 * DEGREE), 1.0) * rng.uniform(0.9, 1.6) / dt)
            x = (np.arange(count) + 0.5) / count
            part, wave = x**3 * (10 - 15 * x + 6 * x**2), np.sin(np.pi * x) ** 3
            aside = np.cross(relative, rng.normal(size=3))
            aside *= 0.2 / max(np.linalg.norm(aside), 1e-9)
            way = attitude * Rotation.from_rotvec(part[:, None] * relative) * Rotation.from_rotvec(wave[:, None] * aside)
            held.append(way.as_matrix())
            labels.append(np.full(count, -1))
            attitude = attitude * Rotation.from_rotvec(relative)
    body, label = Rotation.from_matrix(np.concatenate(held)), np.concatenate(labels)
    count = len(label)
    time = np.arange(count) * dt
    by_hand = np.clip((time - initial) / 0.5, 0, 1)[:, None]
    if tremor:
        body = body * Rotation.from_rotvec(by_hand * tremor * _smooth(rng, count, dt, 8.0, 10.0))
    if drift:
        body = body * Rotation.from_rotvec(by_hand * drift * _smooth(rng, count, dt, 0.05, 0.5))
    rate = np.concatenate([[[0, 0, 0]], (body[:-1].inv() * body[1:]).as_rotvec() / dt])
    change = np.gradient(rate, dt, axis=0)
    arm = lever * np.array([0.8, -0.5, 0.3])
    force = body.inv().apply([0.0, 0.0, GRAVITY]) + np.cross(change, arm) + np.cross(rate, np.cross(rate, arm))
    if arms is not None:
        places = np.asarray(arms)[:, None, :] + np.zeros((1, count, 1))
        force = force + np.stack([(np.cross(change, r) + np.cross(rate, np.cross(rate, r)))[:, i] for i, r in enumerate(places)], axis=1)
    if sway:
        force = force + np.where((label < 0)[:, None], body.inv().apply(sway * _smooth(rng, count, dt, 0.3, 3.0)), 0)
    if vibration:
        shaken = (label >= 0) & (label % 2 == 1)
        force = force + np.where(shaken[:, None], vibration * np.sin(2 * np.pi * 23.3 * time)[:, None] * rng.normal(size=3), 0)
    # sampling instants
    number = int(count / fine) - 8
    due = np.arange(number) / RATE
    taken = due + jitter * rng.uniform(-0.5, 0.5, number) / RATE + 4 / RATE
    index = np.clip(np.round(taken / dt).astype(int), 0, count - 1)
    late = np.clip(np.round((taken - offset) / dt).astype(int), 0, count - 1)
    f, w, f_late = force[index], rate[late], force[late]
    if creep:
        share, held = 1 - np.exp(-1 / (15.0 * RATE)), f[0]
        for k, now in enumerate(f.copy()):
            held = held + share * (now - held)
            f[k] = now + creep * (held - now)
    if hysteresis:
        held = f[0]
        for k, now in enumerate(f.copy()):
            held = np.clip(held, now - hysteresis, now + hysteresis)
            f[k] = held
    accel = f @ matrix.T + bias + quadratic * f**2 + asymmetry * np.abs(f) + (warm_up * np.exp(-due / 60.0))[:, None]
    gyro = (w + cubic * w**3) @ gyro_matrix.T + gyro_bias + f_late @ sensitivity.T
    gyro = gyro + gyro_drift * (due / due[-1] - 0.5)[:, None] * np.array([1.0, -0.7, 0.4])
    if jump is not None:
        after = (due > due[np.flatnonzero(label[index] == 12)[-1]])[:, None]
        accel, gyro = accel + after * jump[0] * np.array([0.8, -0.5, 0.6]), gyro + after * jump[1] * np.array([0.5, 0.8, -0.6])
    accel = accel + NOISE_ACCEL * np.sqrt(RATE) * rng.normal(size=accel.shape)
    gyro = gyro + NOISE_GYRO * np.sqrt(RATE) * rng.normal(size=gyro.shape)
    if saturation:
        gyro = np.clip(gyro, -saturation, saturation)
    kept = rng.uniform(size=number) >= missing
    truth = np.concatenate([matrix.ravel(), bias, gyro_matrix.ravel(), gyro_bias, sensitivity.ravel()])
    return due[kept], accel[kept], gyro[kept], truth


#: groups of parameters whose coverage is counted separately
GROUPS = {"accel matrix": slice(0, 9), "accel bias": slice(9, 12), "gyro matrix": slice(12, 21), "gyro bias": slice(21, 24),
          "g-sensitivity": slice(24, 33)}  # fmt: skip


def six_faces(seed, *, level=1 * DEGREE, mounting=0.0, misalignment=0.004, noise=NOISE_ACCEL, still=5.0, repeats=1):
    """Simulate a block laid on its six faces: accelerometer, first and last sample of each face, and the truth (12 parameters).

    level: error of the level of each face (rad, about both horizontal axes); mounting: rotation of the sensor in the block;
    misalignment: of its axes. Between the faces the block is turned within a second.
    """
    rng = np.random.default_rng([seed, 22])
    matrix = (np.eye(3) + np.diag(0.01 * rng.normal(size=3)) + misalignment * rng.normal(size=(3, 3)) * (1 - np.eye(3))) @ (
        Rotation.from_rotvec(mounting * rng.normal(size=3)).as_matrix()
    )
    bias, count, force = 0.1 * rng.normal(size=3), round(still * RATE), []
    for face in list(np.kron(np.eye(3), [[1.0], [-1.0]])) * repeats:
        held = GRAVITY * Rotation.from_rotvec(level * rng.normal(size=3)).apply(face)
        turning = np.linspace(0, np.pi, int(RATE))[:, None]
        other = GRAVITY * np.cross(face, rng.normal(size=3))
        force += [np.tile(held, (count, 1)), held * np.cos(turning) + other * np.sin(turning)]
    force = np.concatenate(force)
    accel = force @ matrix.T + bias + noise * np.sqrt(RATE) * rng.normal(size=force.shape)
    start = np.arange(6 * repeats) * (count + int(RATE))
    return accel, np.stack([start, start + count], axis=1), np.concatenate([matrix.ravel(), bias])
