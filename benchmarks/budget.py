"""Error budgets against a Monte Carlo that shares nothing with the propagation: python benchmarks/budget.py [--runs 2000] [CASE ...].

The Monte Carlo integrates attitudes as quaternions, run by run, with noise from generators of its own and errors of the sensors that are
drawn for each run. The turning Earth is integrated in axes that do not turn. Prints: standard deviations of the budget over those of the
runs, share of runs inside the 95 % ellipsoid, and the same for preintegrated increments, with the budget's covariance and with the static
noise alone; then closed forms, the inverse, gradients, many sensors at once, and times. A case is rest, circle, hand, rested, aided,
earth, windows or forms; without one, all.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np
import scipy

from jaxcal.budget import Motion, increments, propagate, requirement
from jaxcal.noise import Noise

G, EARTH, RADIUS = 9.80665, 7.292115e-5, 6371e3
# a good tactical grade: with errors ten times as large, squares of the attitude error show in the 95 % ellipsoid after 60 s
GYRO, ACCEL = {"Q": 2e-7, "N": 1e-5, "B": 4e-6, "K": 4e-7}, {"Q": 2e-6, "N": 2e-4, "B": 5e-5, "K": 1e-5}
MAG = {"Q": 0.0, "N": 1e-9, "B": 2e-9, "K": 1e-10}
ERRORS = {
    "gyro.bias": 2e-5, "gyro.scale": 1e-4, "gyro.misalignment": 1e-4, "gyro.g_sensitivity": 1e-6, "accel.bias": 5e-4, "accel.scale": 5e-5,
    "accel.misalignment": 5e-5,
}  # fmt: skip
_BATCH = 500  # runs at once


def noise(random, runs, steps, dt, Q, N, B, K):
    """Samples (steps, 3, runs): quantisation and white noise; flicker (fractional differences of white noise) and a random walk."""
    before = min(16 * steps, 1 << 15)  # samples of the past of flicker
    k = np.arange(1, before)
    weights = np.concatenate([[1.0], np.cumprod((k - 0.5) / k)])
    size = scipy.fft.next_fast_len(before + steps, real=True)
    spectrum = scipy.fft.rfft(weights, size)
    white, wander = np.empty((2, steps, 3, runs))
    for run in range(runs):
        draw = lambda n: random.standard_normal((3, n))  # noqa: E731
        flicker = B * scipy.fft.irfft(scipy.fft.rfft(draw(size)) * spectrum, size)[:, -steps:]
        wander[..., run] = (flicker + K * np.sqrt(dt) * np.cumsum(draw(steps), axis=1)).T
        white[..., run] = (N / np.sqrt(dt) * draw(steps) + Q / dt * np.diff(draw(steps + 1), axis=1)).T
    return white, wander


# vectors (3, runs) and quaternions (4, runs), scalar first


def times(q, r):
    """Hamilton product."""
    (a, b, c, d), (e, f, g, h) = q, r
    parts = [a * e - b * f - c * g - d * h, a * f + b * e + c * h - d * g, a * g - b * h + c * e + d * f, a * h + b * g - c * f + d * e]
    return np.stack(parts)


def cross(u, v):
    return np.stack([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]])


def turn(v):
    """Quaternion of a rotation vector."""
    angle = np.sqrt(v[0] ** 2 + v[1] ** 2 + v[2] ** 2)
    return np.stack([np.cos(angle / 2), *(np.sinc(angle / 2 / np.pi) / 2 * v)])


def rotate(q, x):
    """R(q) x."""
    twice = 2 * cross(q[1:], x)
    return x + q[0] * twice + cross(q[1:], twice)


def back(q):
    return q * np.array([1, -1, -1, -1])[:, None]


def angles(q, reference):
    """Rotation vector from the reference to q, in the outer axes."""
    error = times(q, back(reference))
    return 2 * error[1:] * np.sign(error[:1])


def weight(p):
    return np.array([0.0, 0.0, -G])[:, None]


def navigate(start, rate, force, dt, at, *, aid=None, field=None, pull=weight, p=0.0, v=0.0):
    """Attitude, velocity and position at the steps `at`, from rate and force (steps, 3, runs) and an attitude at the start."""
    q, out, up = start, [], np.array([0.0, 0.0, 1.0])[:, None]
    p, v = (one * np.ones((3, 1)) for one in (p, v))
    for i in range(max(at)):
        half = turn(rate[i] * dt / 2)
        middle = times(q, half)
        q, seen = times(middle, half), rotate(middle, force[i])
        a = seen + pull(p + v * dt / 2)
        p = p + v * dt + a * dt**2 / 2
        v = v + a * dt
        if aid is not None:  # turn a little towards the level and the heading that accelerometer and magnetometer show
            level = cross(seen / np.linalg.norm(seen, axis=0), up * np.ones_like(seen))
            north = rotate(middle, field[i])
            q = times(turn((level + np.arctan2(north[0], north[1]) * up) * dt / aid), q)
        if i + 1 in at:
            out.append((q, v, p))
    return out


def measured(random, runs, rate, force, dt, still, errors, gyro, accel, about=(0.0, 0.0)):
    """Readings (steps, 3, runs) of a gyroscope and an accelerometer in true rate and force (steps, 3), with errors drawn for each run."""
    drawn, found = {}, []
    for name in ERRORS:
        entries, kind = errors.get(name, 0.0) * random.standard_normal((3, 3, runs)), name.partition(".")[2]
        one = np.eye(3)[:, :, None]
        drawn[name] = {"bias": entries[0], "scale": entries * one, "misalignment": entries * (1 - one)}.get(kind, entries)
    for name, own, values, known in (("gyro", gyro, rate, about[0]), ("accel", accel, force, about[1])):
        white, wander = noise(random, runs, len(values), dt, **own)
        # without a rest what wanders is known at the start; with one its mean is zero, and the gyroscope's is taken away below
        white += wander - (wander[:still].mean(axis=0) if still else wander[0])
        white += np.einsum("abr,nb->nar", drawn[f"{name}.scale"] + drawn[f"{name}.misalignment"], values - known)
        white += values[:, :, None] + drawn[f"{name}.bias"]
        if name == "gyro":
            white += np.einsum("abr,nb->nar", drawn["gyro.g_sensitivity"], force - about[1])
        found.append(white)
    return found


def monte_carlo(motion, at, runs, rest, seed, aid=None, errors=ERRORS, about=(0.0, 0.0)):
    """Errors (runs, times, 9) of simulated runs; `about`: rate and force whose errors a filter knows as biases."""
    random, dt, found = np.random.default_rng(seed), motion.step, []
    ends, steps, still = [round(one / dt) for one in at], round(max(at) / dt), round(rest / dt)
    take = np.minimum(np.arange(steps), len(motion.rate) - 1)
    rate, force, body, start = motion.rate[take], motion.force[take], motion.attitude[take], motion.start[:, None]
    field = np.swapaxes(body, 1, 2) @ (50e-6 * np.array([0.0, 0.5, -np.sqrt(0.75)]))
    truth = navigate(start, rate[..., None], force[..., None], dt, ends)
    level = rotate(back(start), np.array([0.0, 0.0, G])[:, None])[:, 0]
    rate, force = (np.concatenate([np.tile(x, (still, 1)), y]) for x, y in ((np.zeros(3), rate), (level, force)))
    for first in range(0, runs, _BATCH):
        count, begin, compass = min(_BATCH, runs - first), start, None
        gyro, accel = measured(random, count, rate, force, dt, still, errors, GYRO, ACCEL, about)
        if still:
            gyro -= gyro[:still].mean(axis=0)
            up = rotate(begin, accel[:still].mean(axis=0))
            axis = cross(up / np.linalg.norm(up, axis=0), np.array([0.0, 0.0, 1.0])[:, None] * np.ones_like(up))
            begin = times(turn(axis), begin)
        if aid is not None:
            white, wander = noise(random, count, steps, dt, **MAG)
            compass = field[:, :, None] + white + wander - wander[:1]
        ran = navigate(begin * np.ones(count), gyro[still:], accel[still:], dt, ends, aid=aid, field=compass)
        found.append([np.concatenate([angles(q, q0), v - v0, p - p0]) for (q, v, p), (q0, v0, p0) in zip(ran, truth, strict=True)])
    return np.moveaxis(np.concatenate(found, axis=2), 2, 0)


def turning(latitude, at, runs, seed, errors, gyro, accel, dt=1.0):
    """The same at rest on a turning Earth with a central gravity, integrated in axes that do not turn."""
    random, found, ends = np.random.default_rng(seed), [], [round(one / dt) for one in at]
    s, c, w = np.sin(latitude), np.cos(latitude), EARTH * np.array([0.0, 0.0, 1.0])
    place = np.array([[0.0, 1.0, 0.0], [-s, 0.0, c], [c, 0.0, s]]).T  # from east, north and up
    r = RADIUS * place[:, 2]
    for _ in range(5):  # the plumb line: attraction and the acceleration of the turn together point along up
        swing = np.cross(w, np.cross(w, r))
        attraction = G * place[:, 2] - swing
        size = np.linalg.norm(attraction)
        r = RADIUS * attraction / size
    pull = lambda p: -size * RADIUS**2 * p / np.linalg.norm(p, axis=0) ** 3  # noqa: E731
    rate, force = (np.tile(place.T @ x, (max(ends), 1)) for x in (w, swing - pull(r)))
    start = scipy.spatial.transform.Rotation.from_matrix(place).as_quat(scalar_first=True)[:, None]
    how = {"pull": pull, "p": r[:, None], "v": np.cross(w, r)[:, None]}
    truth = navigate(start, rate[..., None], force[..., None], dt, ends, **how)
    for first in range(0, runs, _BATCH):
        count, one = min(_BATCH, runs - first), []
        measured_rate, measured_force = measured(random, count, rate, force, dt, 0, errors, gyro, accel)
        ran = navigate(start * np.ones(count), measured_rate, measured_force, dt, ends, **how)
        for t, (q, v, p), (q0, v0, p0) in zip(at, ran, truth, strict=True):
            turned = scipy.spatial.transform.Rotation.from_rotvec(w * t).as_matrix() @ place
            speed = v - v0 - cross(w[:, None] * np.ones_like(p), p - p0)
            one.append(np.concatenate([turned.T @ x for x in (angles(q, q0), speed, p - p0)]))
        found.append(one)
    return np.moveaxis(np.concatenate(found, axis=2), 2, 0)


class Path(Motion):
    """A motion with the quaternion at the edge of its first step."""

    @property
    def start(self):
        middle = scipy.spatial.transform.Rotation.from_matrix(self.attitude[0]).as_quat(scalar_first=True)
        return times(middle[:, None], turn(-self.rate[0, :, None] * self.step / 2))[:, 0]


def path(motion, step=0.01):
    """The motion in steps, with its beginning."""
    count = round(motion.duration / step)
    spread = lambda x: np.repeat(x, count, axis=0) if len(x) == 1 else x  # noqa: E731
    return Path(step, spread(motion.attitude), spread(motion.rate), spread(motion.force), motion.name)


def show(name, told, errors, at):
    """Print how the budget compares with the runs."""
    axes = 3 if told.aided else 9
    covariance, errors = told.covariance[:, :axes, :axes], errors[..., :axes]
    ratio = covariance.diagonal(axis1=1, axis2=2) ** 0.5 / np.mean(errors**2, axis=0) ** 0.5
    square = np.einsum("rka,kab,rkb->rk", errors, np.linalg.inv(covariance), errors)
    inside = np.mean(square < scipy.stats.chi2.ppf(0.95, axes), axis=0)
    # the sensors' mean over axes has less scatter than one axis
    groups = [np.sqrt(np.mean(ratio[:, i : i + 3] ** 2, axis=1)) for i in range(0, axes, 3)]
    words = "  ".join(f"{t:g} s: " + " ".join(f"{g[k]:.3f}" for g in groups) + f", {100 * inside[k]:.1f} %" for k, t in enumerate(at))
    print(f"{name:26} {words}; single axes {ratio.min():.3f} to {ratio.max():.3f}", flush=True)


def compare(name, motion, runs, rest, seed, aid=None):
    """A motion of a minute."""
    at, sensors = [1.0, 10.0, 60.0], {"gyro": Noise(**GYRO), "accel": Noise(**ACCEL)} | ({} if aid is None else {"mag": Noise(**MAG)})
    told = propagate(sensors, motion, at=at, rest=rest, errors=ERRORS, aid=aid)
    show(name, told, monte_carlo(path(motion), at, runs, rest, seed, aid), at)


def earth(runs):
    """An hour at rest at 40 degrees; errors so small that squares of the attitude error, or of the height over the radius, do not show."""
    at, latitude, size = [60.0, 600.0, 3600.0], np.deg2rad(40.0), {"gyro": 0.002, "accel": 0.01}
    gyro, accel = ({term: size[name] * value for term, value in one.items()} for name, one in (("gyro", GYRO), ("accel", ACCEL)))
    errors = {name: size[name.partition(".")[0]] * value for name, value in ERRORS.items()}
    ran = turning(latitude, at, runs, 11, errors, gyro, accel)
    for name, place in (("on a turning Earth", latitude), ("budget of a flat one", None)):
        sensors = {"gyro": Noise(**gyro), "accel": Noise(**accel)}
        show(name, propagate(sensors, Motion.rest(at[-1]), at=at, errors=errors, latitude=place, rate=1.0), ran, at)


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


def forms():
    """Closed forms, the inverse, gradients, many sensors at once, and CPU times."""
    t, rest, dip = 100.0, 60.0, 1.0
    r = rest / t
    flicker = t * np.sqrt((1 + r) / (np.pi * r) * ((1 + r) * np.log(1 + r) - r * np.log(r)))
    laws = {
        "N": (Noise(N=1e-5), "heading", 1e-5 * t**0.5, {}), "K": (Noise(K=1e-6), "heading", 1e-6 * (t**3 / 3) ** 0.5, {}),
        "flicker": (Noise(B=1e-6), "heading", 1e-6 * flicker, {"rest": rest}),
        "position from N": (Noise(N=1e-5), "position", 1e-5 * G * (2 * t**5 / 20) ** 0.5, {}),
        "tilt to heading": ({}, "heading", 1e-3 / G * np.tan(dip), {"errors": {"accel.bias": [1e-3, 0, 0]}, "aid": 2.0, "dip": dip}),
    }  # fmt: skip
    for name, (sensors, group, law, how) in laws.items():
        print(f"{name}: {propagate(sensors, Motion.rest(t), at=[t], **how).std(group)[-1] / law - 1:.1e} from its closed form")
    sensors, motion = {"gyro": Noise(N=1e-4, B=2e-5, K=1e-6), "accel": Noise(N=1e-3, B=2e-4, K=1e-5)}, Motion.hand(60.0)
    found = propagate(sensors, motion, errors=ERRORS)
    limit = 3 * float(found.std("position")[-1])
    larger = {**sensors, "gyro": Noise(N=1e-4 * float(requirement(found, after=60.0, position=limit)["gyro N"][0]), B=2e-5, K=1e-6)}
    print(f"inverse beside forward: {propagate(larger, motion, errors=ERRORS).std('position')[-1] / limit - 1:.1e}")
    with jax.enable_x64(True):
        heading = lambda n: propagate({"gyro": Noise(N=n, B=2e-5)}, Motion.rest(60.0), at=[60.0]).std("heading")[-1]  # noqa: E731
        slope, step = jax.grad(heading)(1e-4), (heading(1.001e-4) - heading(0.999e-4)) / 2e-7
        print(f"gradient beside differences: {float(slope / step) - 1:.1e}")
        many = jax.vmap(heading)
        many(jnp.linspace(1e-5, 1e-3, 1000)).block_until_ready()
        begun = time.process_time()
        many(jnp.linspace(1e-5, 1e-3, 1000)).block_until_ready()
        print(f"1,000 sensors in one call: {1000 * (time.process_time() - begun):.1f} ms")
    for motion, aid in ((Motion.rest(3600.0), None), (Motion.hand(3600.0), None), (Motion.hand(3600.0), 5.0)):
        took = []
        for _ in range(4):
            begun = time.process_time()
            propagate(sensors, motion, errors=ERRORS, aid=aid)
            took.append(time.process_time() - begun)
        print(f"3,600 s, {motion.name}, aid {aid}: {took[0]:.2f} s of CPU, then {min(took[1:]):.2f} to {max(took[1:]):.2f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("cases", nargs="*")
    asked = parser.parse_args()
    runs, motions = asked.runs, (Motion.rest(60.0), Motion.circle(60.0), Motion.hand(60.0))
    cases = {one.name: lambda one=one, seed=seed: compare(one.name, one, runs, 0.0, seed) for seed, one in enumerate(motions)}
    cases["rested"] = lambda: [compare(f"{one.name}, 30 s at rest before", one, runs, 30.0, seed) for seed, one in enumerate(motions)]
    cases["aided"] = lambda: compare("hand, aided with 5 s", Motion.hand(60.0, shake=0.0), runs, 0.0, 7, aid=5.0)
    cases |= {"earth": lambda: earth(runs), "windows": lambda: windows(runs), "forms": forms}
    print(f"budget over {runs} runs: attitude, velocity, position, and the share inside the 95 % ellipsoid")
    for name in asked.cases or cases:
        cases[name]()


if __name__ == "__main__":
    main()
