"""Shared by the tests of `jaxcal.imu`: a device, its poses, recordings, and the Cramer-Rao bound of the parameters."""

import numpy as np
from scipy.spatial.transform import Rotation

from jaxcal.imu import MEMS, simulate
from jaxcal.imu._simulate import NOISE, attitudes

ACCEL, GYRO = MEMS.accel, MEMS.gyro

RATE, STILL, TURN, POSES = 50.0, 3.0, 2.0, 24
GRAVITY = 9.81
#: upward directions of the poses, the same in every run
UP = attitudes(POSES, 0)


def recording(seed, **options):
    """Simulate a recording of the usual poses. All these recordings have the same shape, so that the fit is compiled only once."""
    return simulate(
        options.pop("poses", POSES), **({"rate": RATE, "still": STILL, "turn": TURN, "up": UP, "motion": 0, "seed": seed} | options)
    )


def rests(poses=POSES):
    """First sample of every pose of a simulated recording and the sample after its last, (poses, 2)."""
    still, turn, first = (int(seconds * RATE) for seconds in (STILL, TURN, 30.0))
    stop = first + np.arange(poses) * (still + turn)
    return np.stack([np.r_[0, stop[1:] - still], stop], axis=1)


def turned_truth(accel=ACCEL, gyro=GYRO):
    """The 33 true parameters of the simulated device in the frame of the convention "upper", computed with NumPy."""
    correction = np.linalg.inv(accel.matrix)
    upper = np.linalg.cholesky(correction.T @ correction).T
    turn = upper @ accel.matrix
    return np.concatenate(
        [np.ravel(np.linalg.inv(upper)), accel.bias, np.ravel(gyro.matrix @ turn.T), gyro.bias, np.ravel(gyro.g_sensitivity @ turn.T)]
    )


def inside(found, truth):
    """Whether each 95 % interval of an estimate contains the truth, in the order of the parameters."""
    low, high = found.estimate.intervals().T
    return (low <= truth) & (truth <= high)


def positions(triad=ACCEL, gravity=GRAVITY, *, up=None, sigma=0.0, levelling=0.0, tilt=0.0, seed=0):
    """Mean readings of an accelerometer in static positions: errors of the level of each, a tilt of all, and noise."""
    rng = np.random.default_rng(seed)
    directions = np.kron(np.eye(3), np.array([[1.0], [-1.0]])) if up is None else np.asarray(up)
    errors = levelling * rng.normal(size=directions.shape)
    turned = Rotation.from_rotvec(tilt * rng.normal(size=3)).apply(Rotation.from_rotvec(errors).apply(directions))
    return gravity * turned @ triad.matrix.T + triad.bias + sigma * rng.normal(size=directions.shape)


def _integrated(rate, dt):
    """Integrate angular rates with SciPy: the mean of neighbouring samples plus a correction for coning."""
    step = (rate[1:] + rate[:-1]) * dt / 2 + np.cross(rate[:-1], rate[1:]) * dt**2 / 12
    total = Rotation.identity()
    for part in Rotation.from_rotvec(step):
        total = total * part
    return total


def _predicted(x, clean, pieces, start, stop):
    """Convert noise-free readings with the parameters x (30) to specific forces and rates at rest and to rotations between the poses."""
    accel = np.linalg.inv(np.array([[x[0], x[1], x[2]], [0, x[3], x[4]], [0, 0, x[5]]]))
    gyro, bias, sensitivity = np.linalg.inv(x[9:18].reshape(3, 3)), x[18:21], x[21:30].reshape(3, 3)
    force = (clean[0] - x[6:9]) @ accel.T
    rate = (clean[1] - bias - force @ sensitivity.T) @ gyro.T
    return force, rate, [_integrated(rate[i:j], 1 / RATE) for i, j in pieces]


def bound(found, noise=NOISE):
    """Cramer-Rao bound of the free parameters for white noise; three angles of every pose are nuisance parameters.

    The bound does not use the residuals of the estimator: the information is that of all means at rest and of all integrated turns.
    Returns the indices of the 30 free parameters among the 33, and the bound of their covariance, (30, 30).
    """
    free = np.array([0, 1, 2, 4, 5, 8, 9, 10, 11, *range(12, 33)])
    x0 = turned_truth()[free]
    log = recording(0, noise={"accel": 0.0, "gyro": 1e-12})
    clean = np.asarray(log.accel), np.asarray(log.gyro)
    start, stop = found.still.start, found.still.stop
    pieces = [(i - 1, j) for i, j in zip(stop[:-1], start[1:], strict=True)]
    count = len(start)

    def observed(x):
        force, rate, turns = _predicted(x, clean, pieces, start, stop)
        middle = [(i + j) // 2 for i, j in zip(start, stop, strict=True)]
        return force[middle], rate[middle], turns

    force, _, turns = observed(x0)
    rows, noises = [], []
    steps = np.full(30, 1e-5)
    ends = [[observed(x0 + s * steps[i] * np.eye(30)[i]) for s in (1, -1)] for i in range(30)]
    accel, gyro = (np.linalg.inv(turned_truth()[k : k + 9].reshape(3, 3)) for k in (0, 12))
    for k in range(count):
        # the specific force depends on the parameters and on the attitude of the pose
        block = np.zeros((3, 30 + 3 * count))
        block[:, :30] = np.stack([(a[0][k] - b[0][k]) / (2e-5) for a, b in ends], axis=1)
        f = force[k]
        block[:, 30 + 3 * k : 33 + 3 * k] = np.array([[0, f[2], -f[1]], [-f[2], 0, f[0]], [f[1], -f[0], 0]])
        rows.append(block)
        duration = (stop[k] - start[k]) / RATE
        noises.append(noise["accel"] ** 2 / duration * accel @ accel.T)
        # the rate at rest is zero in every attitude
        block = np.zeros((3, 30 + 3 * count))
        block[:, :30] = np.stack([(a[1][k] - b[1][k]) / (2e-5) for a, b in ends], axis=1)
        rows.append(block)
        noises.append(noise["gyro"] ** 2 / duration * gyro @ gyro.T)
    for k, (i, j) in enumerate(pieces):
        block = np.zeros((3, 30 + 3 * count))
        block[:, :30] = np.stack(
            [((turns[k].inv() * a[2][k]).as_rotvec() - (turns[k].inv() * b[2][k]).as_rotvec()) / 2e-5 for a, b in ends], 1
        )
        # attitude errors are in the axes of each pose: those of the first pose are rotated by the turn
        block[:, 30 + 3 * k : 33 + 3 * k] = turns[k].inv().as_matrix()
        block[:, 33 + 3 * k : 36 + 3 * k] = -np.eye(3)
        rows.append(block)
        noises.append(noise["gyro"] ** 2 * (j - i - 1) / RATE * gyro @ gyro.T)
    information = sum(block.T @ np.linalg.solve(noise, block) for block, noise in zip(rows, noises, strict=True))
    scale = 1 / np.sqrt(np.diag(information))
    # the common heading cannot be observed; the pseudo-inverse leaves it out, and no parameter depends on it
    inverse = np.linalg.pinv(information * np.outer(scale, scale), rcond=1e-12, hermitian=True) * np.outer(scale, scale)
    return free, inverse[:30, :30]
