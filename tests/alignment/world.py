"""A turntable simulated with NumPy and SciPy but not jaxcal: noise over a whole test, mean readings over the rests, and raw logs."""

import numpy as np
from scipy.signal import fftconvolve
from scipy.spatial.transform import Rotation

DEG, EARTH, G = np.pi / 180, 7.292115e-5, 9.80665
LATITUDE = 35 * DEG

#: N, B, K in SI units: a gyro of 0.002 deg/sqrt(h), 0.02 deg/h, 0.1 deg/h/sqrt(h), an accelerometer of 50 micro-g sqrt(s), 10 micro-g
GYRO = np.array([0.002 * DEG / 60, 0.02 * DEG / 3600, 0.1 * DEG / 3600 / 60])
ACCEL = np.array([50e-6 * G, 10e-6 * G, 5e-7 * G])
#: factors of N, B and K for each kind of noise
NOISES = {"white": np.array([1, 0, 0]), "N+B": np.array([1, 1, 0]), "N+B+K": np.array([1, 1, 1])}
#: drifts of the gyro's bias over a test, rad/s
DRIFTS = {
    "none": lambda u: 0 * u, "linear": lambda u: 0.4 * DEG / 3600 * u, "quadratic": lambda u: 0.4 * DEG / 3600 * u**2,
    "exponential": lambda u: 0.4 * DEG / 3600 * np.exp(-4 * u), "step": lambda u: 0.3 * DEG / 3600 * (u > 0.5),
}  # fmt: skip
#: table angles in degrees, and the time at each of them in s
PLANS = {
    "4 x 120 s": ([0, 90, 180, 270], 120.0), "8 mirrored x 60 s": ([0, 90, 180, 270, 270, 180, 90, 0], 60.0),
    "4 x 600 s": ([0, 90, 180, 270], 600.0),
}  # fmt: skip
#: the order in which opposite positions are measured there and back, and all of them back again
PAIRS = [0, 180, 180, 0, 90, 270, 270, 90, 90, 270, 270, 90, 0, 180, 180, 0], 30.0
MOVE = 8.0  # s between rests


def noise(rng, coefficients, shape, dt):
    """Simulate noise with coefficients N, B and K; the last axis is time.

    Flicker is made by the filter of Kasdin (Proc. IEEE 83, 1995, 802), which starts eight record lengths earlier.
    """
    white, flicker, walk = coefficients
    n = shape[-1]
    made = white / np.sqrt(dt) * rng.normal(size=shape)
    if flicker:
        taps = np.cumprod(np.concatenate([[1.0], 1 - 0.5 / np.arange(1.0, 9 * n)]))
        made += (
            flicker
            * fftconvolve(rng.normal(size=(*shape[:-1], 9 * n)), np.broadcast_to(taps, (*shape[:-1], 9 * n)), axes=-1)[..., 8 * n : 9 * n]
        )
    if walk:
        made += walk * np.sqrt(dt) * np.cumsum(rng.normal(size=shape), axis=-1)
    return made


def vectors(attitude, angle):
    """Specific force and Earth's rate in axes that turn with the table, (..., 3).

    `attitude` has roll, pitch and azimuth of the table, `angle` the table angles, rad.
    """
    phi, theta, psi = attitude
    nav = Rotation.from_euler("ZYX", np.stack(np.broadcast_arrays(psi, theta, phi), -1))  # table axes in north, east, down
    body = nav * Rotation.from_rotvec(np.multiply.outer(angle, [0.0, 0.0, 1.0]))
    return body.inv().apply([0.0, 0.0, -G]), body.inv().apply([EARTH * np.cos(LATITUDE), 0.0, -EARTH * np.sin(LATITUDE)])


def tables(rng, runs, plan, kind, attitude, bias=(1e-3, 2e-7), dt=1.0):
    """Simulate `runs` tests: table angles, start times, dwell, and mean readings of accelerometer and gyro at the rests, (runs, n)."""
    angles, dwell = PLANS[plan]
    angle = np.array(angles) * DEG
    start = np.arange(len(angle)) * (dwell + MOVE)
    count, step = round(dwell / dt), round((dwell + MOVE) / dt)
    force, rate = (vector[:, 0] for vector in vectors(attitude, angle))
    means = []
    for ideal, offset, coefficients in ((force, bias[0], ACCEL), (rate, bias[1], GYRO)):
        samples = noise(rng, coefficients * NOISES[kind], (runs, step * len(angle)), dt)
        means.append(ideal + offset + samples.reshape(runs, len(angle), step)[:, :, :count].mean(axis=2))
    return angle, start, dwell, *means


def motion(rng, angles, dwells, rate, move=8.0):
    """Table angle of every sample, whether the table is at rest, and the time since its last move (s)."""
    angle, still, since = [], [], []
    for k, (place, dwell) in enumerate(zip(angles, dwells, strict=True)):
        n = round(dwell * rate)
        angle.append(np.full(n, place))
        still.append(np.ones(n, bool))
        since.append(np.arange(n) / rate if k else np.full(n, np.inf))
        if k + 1 < len(angles):
            n = round(move * rng.uniform(0.7, 1.3) * rate)
            part = (np.arange(n) + 0.5) / n
            # the rate follows one minus a cosine
            angle.append(place + (angles[k + 1] - place) * (part - np.sin(2 * np.pi * part) / (2 * np.pi)))
            still.append(np.zeros(n, bool))
            since.append(np.zeros(n))
    return np.concatenate(angle), np.concatenate(still), np.concatenate(since)


def recording(
    rng, angles, dwells, kind, attitude, *, axes=1, rate=50.0, vibration=0.3, ringing=0.02, mount=(0.0, 0.0), bias=(1e-3, 2e-7), scale=1.0,
    drift=None, tilt=0.0, encoder=0.0, repeats=False,
):  # fmt: skip
    """Simulate a table log: time, table angle, accelerometer and gyro (n, axes), the samples of each rest, and ideal means over them.

    While the table moves it vibrates (m/s^2; a tenth of the number in rad/s for the gyro), and its rate leaks into the gyro's other axes
    by a misalignment of 1e-3. The sensors are 0.1 m off the axis. After a move the table rings at 7 Hz for some tenths of a second
    (m/s^2). mount: tilt of the device on the table, rad. scale: scale factor of the gyro. drift: of the gyro's bias (rad/s), as a function
    of the share of the test that has passed. tilt: of the base over the test, about a random axis (rad). encoder: standard deviation of
    the errors of the angles that are returned (rad); repeats: the same error at the same angle.
    """
    angle, still, since = motion(rng, np.asarray(angles) * DEG, dwells, rate)
    n, dt = angle.size, 1 / rate
    speed = np.gradient(angle, dt) * ~still
    share, towards = np.arange(n) / n, rng.uniform(0, 2 * np.pi)
    phi, theta = (x + tilt * f(towards) * (share - 0.5) for x, f in zip(attitude, (np.cos, np.sin), strict=False))
    resting, earth = vectors((phi, theta, attitude[2]), angle)
    turn = speed[:, None] * np.array([0.0, 0.0, 1.0])
    force = resting + 0.1 * np.stack([-(speed**2), np.gradient(speed, dt) * ~still, 0 * speed], axis=1)
    shake = (vibration * ~still)[:, None] * rng.normal(size=(n, 3))
    rock = 0.1 * np.diff(shake, axis=0, append=shake[-1:])  # differences: a vibration has no net rotation
    since = np.minimum(since, 50.0)
    ring = ringing * np.exp(-since / 0.1) * np.sin(2 * np.pi * 7 * since) * still
    swing = np.diff(ring, append=ring[-1:]) * rate / (2 * np.pi * 7)  # the ringing has no net rotation either
    tilt = Rotation.from_euler("xy", mount).inv()
    coupling = np.eye(3) + 1e-3 * np.array([[0, 1, -1], [1, 0, 1], [-1, 1, 0]])
    accel = tilt.apply(force + shake + ring[:, None])[:, :axes] + bias[0]
    # only the table's rate is coupled; coupling of the Earth's rate would be an ordinary misalignment
    gyro = scale * tilt.apply(earth + (turn + rock + 0.1 * swing[:, None]) @ coupling.T)[:, :axes] + bias[1]
    gyro = gyro + (0.0 if drift is None else drift(share)[:, None])
    noises = [noise(rng, c * NOISES[kind], (axes, n), dt).T for c in (ACCEL, GYRO)]
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(int)))
    rests = np.stack([edges[::2], edges[1::2]], axis=1)
    place = np.unique(angles, return_inverse=True)[1] if repeats else np.arange(len(rests))
    at = np.minimum(np.searchsorted(edges[1::2], np.arange(n), "right"), len(rests) - 1)
    angle = angle + encoder * rng.normal(size=len(rests))[place[at]]
    # readings of a sensor without misalignment on a table that does not ring
    clean = [tilt.apply(v)[:, :axes] + b + x for v, b, x in zip((resting, scale * earth), bias, noises, strict=True)]
    ideal = [np.array([x[i:j].mean(axis=0) for i, j in rests]) for x in clean]
    return np.arange(n) * dt, angle, accel + noises[0], gyro + noises[1], rests, ideal
