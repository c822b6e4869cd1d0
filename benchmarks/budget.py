"""Error budgets against a Monte Carlo that shares nothing with the propagation: python benchmarks/budget.py [--runs 500].

The Monte Carlo integrates attitudes as quaternions, run by run, with noise from generators of its own and errors of the sensors that are
drawn for each run. Prints: standard deviations of the budget over those of the runs, share of runs inside the 95 % ellipsoid, and the
same for preintegrated increments, with the budget's covariance and with the static noise alone.
"""

import argparse
import time

import numpy as np
import scipy

from jaxcal.budget import Motion, increments, propagate
from jaxcal.noise import Noise

G = 9.80665
# a good tactical grade: with errors ten times as large, squares of the attitude error show in the 95 % ellipsoid after 60 s
GYRO, ACCEL = {"Q": 2e-7, "N": 1e-5, "B": 4e-6, "K": 4e-7}, {"Q": 2e-6, "N": 2e-4, "B": 5e-5, "K": 1e-5}
MAG = {"Q": 0.0, "N": 1e-9, "B": 2e-9, "K": 1e-10}
ERRORS = {
    "gyro.bias": 2e-5, "gyro.scale": 1e-4, "gyro.misalignment": 1e-4, "gyro.g_sensitivity": 1e-6, "accel.bias": 5e-4, "accel.scale": 5e-5,
    "accel.misalignment": 5e-5,
}  # fmt: skip
_BEFORE = 1 << 15  # samples before the record, so that flicker has a past


def noise(random, shape, steps, dt, Q, N, B, K):
    """Samples (steps, *shape) of quantisation, white noise, flicker (fractional differences of white noise) and a random walk from zero."""
    draw = lambda n: random.standard_normal((*shape, n))  # noqa: E731
    k = np.arange(1, _BEFORE + steps)
    weights = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    flicker = B * scipy.signal.fftconvolve(draw(_BEFORE + steps), weights.reshape((1,) * len(shape) + (-1,)), axes=-1)
    wander = flicker[..., _BEFORE : _BEFORE + steps] + K * np.sqrt(dt) * np.cumsum(draw(steps), axis=-1)
    white = N / np.sqrt(dt) * draw(steps) + Q / dt * np.diff(draw(steps + 1), axis=-1)
    return (np.moveaxis(one, -1, 0) for one in (white, wander))


def times(q, r):
    """Hamilton product, scalar first."""
    a, b = q[..., :1], r[..., :1]
    u, v = q[..., 1:], r[..., 1:]
    return np.concatenate([a * b - np.sum(u * v, axis=-1, keepdims=True), a * v + b * u + np.cross(u, v)], axis=-1)


def turn(v):
    """Quaternion of a rotation vector."""
    angle = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), np.sinc(angle / 2 / np.pi) / 2 * v], axis=-1)


def rotate(q, x):
    """R(q) x."""
    twice = 2 * np.cross(q[..., 1:], x)
    return x + q[..., :1] * twice + np.cross(q[..., 1:], twice)


def angles(q, reference):
    """Rotation vector from the reference to q, in the outer axes."""
    error = times(q, reference * np.array([1, -1, -1, -1]))
    return 2 * error[..., 1:] * np.sign(error[..., :1])


def navigate(start, rate, force, dt, at, aid=None, field=None, world=None):
    """Attitude, velocity and position at the steps `at`, from rate and force (steps, ..., 3) and an attitude at the start."""
    q, v, p, out = start, np.zeros_like(rate[0]), np.zeros_like(rate[0]), []
    up = np.array([0.0, 0.0, 1.0])
    for i in range(max(at)):
        middle = times(q, turn(rate[i] * dt / 2))
        q = times(q, turn(rate[i] * dt))
        a = rotate(middle, force[i]) - G * up
        p = p + v * dt + a * dt**2 / 2
        v = v + a * dt
        if aid is not None:  # turn a little towards the level and the heading that accelerometer and magnetometer show
            seen = rotate(middle, force[i])
            level = np.cross(seen / np.linalg.norm(seen, axis=-1, keepdims=True), up)
            north = rotate(middle, field[i])
            east = np.arctan2(north[..., :1], north[..., 1:2])
            q = times(turn((level + east * up) * dt / aid), q)
        if i + 1 in at:
            out.append((q, v, p))
    return out


def monte_carlo(motion, at, runs, rest, seed, aid=None, errors=ERRORS, about=(0.0, 0.0)):
    """Errors (runs, times, 9) of simulated runs; `about`: rate and force whose errors a filter knows as biases."""
    random, dt, found = np.random.default_rng(seed), motion.step, []
    steps = round(max(at) / dt)
    take = np.minimum(np.arange(steps), len(motion.rate) - 1)
    rate, force, body = motion.rate[take], motion.force[take], motion.attitude[take]
    start = motion.start  # quaternion at the edge of the first step
    world = 50e-6 * np.array([0.0, 0.5, -np.sqrt(0.75)])
    field = np.swapaxes(body, 1, 2) @ world
    ends = [round(one / dt) for one in at]
    truth = navigate(start, rate, force, dt, ends)
    still, before = round(rest / dt), rate[:1] * 0
    level = rotate(start * np.array([1, -1, -1, -1]), np.array([0.0, 0.0, G]))[None]
    for _ in range(max(1, runs // 100)):
        count = min(runs, 100)
        drawn = {}
        for name, size in (dict.fromkeys(ERRORS, 0.0) | errors).items():
            entries = size * random.standard_normal((count, 3, 3))
            drawn[name] = {"bias": entries[:, 0], "scale": entries * np.eye(3), "misalignment": entries * (1 - np.eye(3))}.get(
                name.partition(".")[2], entries
            )
        all_rate, all_force = (np.concatenate([np.repeat(x, still, axis=0), y]) for x, y in ((before, rate), (level, force)))
        measured = []
        for name, own, values, known in (("gyro", GYRO, all_rate, about[0]), ("accel", ACCEL, all_force, about[1])):
            white, wander = noise(random, (count, 3), len(values), dt, **own)
            if still:  # what wanders is zero in the mean over the rest for the accelerometer; the gyroscope's mean is taken away below
                wander = wander - wander[:still].mean(axis=0)
            else:
                wander = wander - wander[:1]
            matrix = drawn[f"{name}.scale"] + drawn[f"{name}.misalignment"]
            reading = values[:, None] + np.einsum("rab,nb->nra", matrix, values - known) + drawn[f"{name}.bias"] + white + wander
            if name == "gyro":
                reading = reading + np.einsum("rab,nb->nra", drawn["gyro.g_sensitivity"], all_force - about[1])
            measured.append(reading)
        gyro, accel = measured
        begin = np.broadcast_to(start, (count, 4))
        if still:
            gyro = gyro - gyro[:still].mean(axis=0)
            up = rotate(begin, accel[:still].mean(axis=0))
            up = up / np.linalg.norm(up, axis=-1, keepdims=True)
            axis = np.cross(up, [0.0, 0.0, 1.0])
            begin = times(turn(axis), begin)
        compass = None
        if aid is not None:
            white, wander = noise(random, (count, 3), steps, dt, **MAG)
            compass = field[:, None] + white + wander - wander[:1]
        runs_found = navigate(begin, gyro[still:], accel[still:], dt, ends, aid, compass)
        found.append(np.stack([np.concatenate([angles(q, q0), v - v0, p - p0], axis=-1)
                               for (q, v, p), (q0, v0, p0) in zip(runs_found, truth, strict=True)], axis=1))  # fmt: skip
    return np.concatenate(found)


class Path(Motion):
    """A motion with the quaternion at the edge of its first step."""

    @property
    def start(self):
        middle = scipy.spatial.transform.Rotation.from_matrix(self.attitude[0]).as_quat(scalar_first=True)
        return times(middle, turn(-self.rate[0] * self.step / 2))


def path(motion, step=0.01):
    """The motion in steps, with its beginning."""
    count = round(motion.duration / step)
    spread = lambda x: np.repeat(x, count, axis=0) if len(x) == 1 else x  # noqa: E731
    return Path(step, spread(motion.attitude), spread(motion.rate), spread(motion.force), motion.name)


def compare(name, motion, at, runs, rest, seed, aid=None):
    """Print how the budget compares with the runs."""
    sensors = {"gyro": Noise(**GYRO), "accel": Noise(**ACCEL)} | ({} if aid is None else {"mag": Noise(**MAG)})
    begun = time.perf_counter()
    told = propagate(sensors, motion, at=at, rest=rest, errors=ERRORS, aid=aid)
    took = time.perf_counter() - begun
    errors = monte_carlo(path(motion), at, runs, rest, seed, aid)
    axes = 3 if aid is not None else 9
    covariance, errors = told.covariance[:, :axes, :axes], errors[..., :axes]
    measured = np.mean(errors**2, axis=0) ** 0.5
    ratio = covariance.diagonal(axis1=1, axis2=2) ** 0.5 / measured
    square = np.einsum("rka,kab,rkb->rk", errors, np.linalg.inv(covariance), errors)
    inside = np.mean(square < scipy.stats.chi2.ppf(0.95, axes), axis=0)
    # the sensors' mean over axes has less scatter than one axis
    groups = [np.sqrt(np.mean(ratio[:, i : i + 3] ** 2, axis=1)) for i in range(0, axes, 3)]
    words = "  ".join(f"{t:g} s: " + " ".join(f"{g[k]:.3f}" for g in groups) + f", {100 * inside[k]:.1f} %" for k, t in enumerate(at))
    print(f"{name:26} {words}; single axes {ratio.min():.3f} to {ratio.max():.3f}; {took:.2f} s", flush=True)


def windows(runs):
    """Print the share of increments inside their 95 % region, with the covariance of the budget, and of the static noise alone."""
    motion, sensors = Motion.hand(60.0, seed=3), {"gyro": Noise(**GYRO), "accel": Noise(**ACCEL)}
    errors = {name: 5 * size for name, size in ERRORS.items() if not name.endswith("bias")}
    about = motion.rate.mean(axis=0), motion.force.mean(axis=0)
    told, static = (increments(sensors, motion, windows=[1.0, 5.0, 20.0], errors=one) for one in (errors, None))
    print(told)
    for w, size in enumerate(told.time):
        inside = []
        for place in (0, 9, 18, 27):
            first = int(np.linspace(0.0, (motion.duration - size) / motion.step, len(told.covariance[w]))[place])
            part = slice(first, first + round(size / motion.step))
            turned = motion.attitude[first].T @ motion.attitude[part]
            sub = Path(motion.step, turned, motion.rate[part], motion.force[part], "window")
            found = monte_carlo(sub, [float(size)], runs, 0.0, place, errors=errors, about=about)[:, 0]
            for one in (told, static):
                inverse = np.linalg.inv(one.covariance[w][place])
                inside.append(np.mean(np.einsum("ra,ab,rb->r", found, inverse, found) < scipy.stats.chi2.ppf(0.95, 9)))
        ours, theirs = np.reshape(inside, (-1, 2)).T * 100
        print(f"window {size:g} s, 4 places of {runs} runs: inside {ours.mean():.1f} % ({ours.min():.1f} to {ours.max():.1f}); "
              f"static noise alone {theirs.mean():.1f} %", flush=True)  # fmt: skip


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=500)
    runs = parser.parse_args().runs
    print(f"budget over {runs} runs: attitude, velocity, position, and the share inside the 95 % ellipsoid")
    times_of = [1.0, 10.0, 60.0]
    for rest in (0.0, 30.0):
        for seed, motion in enumerate((Motion.rest(60.0), Motion.circle(60.0), Motion.hand(60.0))):
            compare(f"{motion.name}, rest {rest:g} s before", motion, times_of, runs, rest, seed)
    compare("hand, aided with 5 s", Motion.hand(60.0, shake=0.0), times_of, runs, 0.0, 7, aid=5.0)
    windows(runs)


if __name__ == "__main__":
    main()
