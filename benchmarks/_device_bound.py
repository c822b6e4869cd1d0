"""The Cramer-Rao bound of one recording by hand, for every parameter of a `DeviceModel`.

The unknowns are the parameters, the attitude at every sample, and the place. The gyroscope drives the attitude. The place is a Matern
process of order 5/2, which is Markov with its first two derivatives; it has the variance and the corner frequency that
`jaxcal.device.simulate` gave it, so that the prior is the true one. The simulator leaves out what lies above 20 corner frequencies, which
samples of the acceleration would fold down to where the accelerometer is read best; so a reading is taken as the mean acceleration since
the last one, whose density has zeros at all multiples of the rate. (`cut` computes what knowing the cut itself would tell of the
accelerometer where the attitude is known: 1 to 5 % smaller standard errors.) The place has an unknown centre, and the attitude at the
beginning is unknown. Rests are known as such: there the clock of the motion stands still, and the gyroscope reads its bias. So this is
the variance that no unbiased estimator can undercut which knows noise, spectrum and rests. Real estimators know less.

It is computed by a Kalman filter over the nuisance states alone, through which the sensitivity of all readings to each parameter runs as
one column (de Jong, Biometrika 75, 1988): the information is the sum of the whitened innovations of these columns. NumPy alone; nothing
of the estimator. The sensitivities are analytic and taken at the true motion. `dense` does the same with finite differences of a
nonlinear model and one covariance matrix of all readings, for short recordings.

    python benchmarks/_device_bound.py          the figures of several motions, and the check against `dense`
    python benchmarks/_device_bound.py 8        the same with 8 recordings each; one takes 2 s
"""

import dataclasses
import sys

import numpy as np
from scipy.linalg import cho_factor, cho_solve, expm, solve_continuous_lyapunov, solve_triangular, toeplitz

UPPER = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)]
PARTS = {
    "accel matrix": slice(0, 6), "accel bias": slice(6, 9), "gyro matrix": slice(9, 18), "gyro bias": slice(18, 21),
    "soft iron": slice(21, 30), "hard iron": slice(30, 33), "dip": slice(33, 34), "gyro delay": slice(34, 35),
    "mag delay": slice(35, 36),
}  # fmt: skip
COUNT, FIELD = 36, slice(36, 37)


def parameters(model):
    """(37,) values in the order of `PARTS`, and the field, with a soft iron of determinant 1."""
    soft_iron = np.asarray(model.magnetometer.soft_iron)
    size = np.cbrt(np.linalg.det(soft_iron))
    matrix = np.asarray(model.accel.matrix)
    return np.concatenate(
        [
            [matrix[i] for i in UPPER], model.accel.bias, np.ravel(model.gyro.matrix), model.gyro.bias, np.ravel(soft_iron) / size,
            model.magnetometer.hard_iron, [model.dip, model.gyro_delay, model.mag_delay, model.field * size],
        ]
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Setting:
    """What the bound takes as known: white noise, the place's prior, and Markov noise as (sensor, deviation, time constant)."""

    accel: float = 120e-6 * 9.80665
    gyro: float = np.deg2rad(0.007)
    mag: float | None = 0.005
    reach: float = 0.25
    corner: float = 0.3
    markov: tuple = ()


def skew(v):
    out = np.zeros((*v.shape[:-1], 3, 3))
    out[..., [2, 0, 1], [1, 2, 0]] = v
    return out - out.swapaxes(-1, -2)


def _place(setting):
    """Drift matrix and stationary covariance of (place, its first and second derivative) by the clock, along one axis."""
    rate = 2 * np.pi * setting.corner
    drift = np.array([[0, 1, 0], [0, 0, 1], [-(rate**3), -3 * rate**2, -3 * rate]])
    drive = np.zeros((3, 3))
    drive[2, 2] = 16 / 3 * setting.reach**2 * rate**5
    return drift, solve_continuous_lyapunov(drift, -drive)


def _sensitivities(true, model):
    """Change of the rate, and of the readings of accelerometer and magnetometer, by each parameter: (n, 3, 36) each."""
    n = len(true.time)
    rate, accel, mag = np.zeros((3, n, 3, COUNT))
    inverse = np.linalg.inv(model.gyro.matrix)
    field = np.einsum("nji,j->ni", true.attitude, model.world_field)
    tilt = float(model.field) * np.array([-np.sin(model.dip), 0.0, -np.cos(model.dip)])
    soft = np.asarray(model.magnetometer.soft_iron)
    for column, (i, j) in enumerate(UPPER):
        accel[:, i, column] = true.force[:, j]
    accel[:, :, PARTS["accel bias"]] = np.eye(3)
    for i in range(3):
        for j in range(3):
            rate[:, :, 9 + 3 * i + j] = -inverse[:, i] * true.rate[:, j, None]
            mag[:, i, 21 + 3 * i + j] = field[:, j]
    rate[:, :, PARTS["gyro bias"]] = -inverse
    rate[:, :, 34] = true.angular_acceleration
    mag[:, :, PARTS["hard iron"]] = np.eye(3)
    mag[:, :, 33] = np.einsum("nji,j->ni", true.attitude, tilt) @ soft.T
    mag[:, :, 35] = np.cross(true.rate, field) @ soft.T
    return rate, accel, mag, field


def information(true, model, setting):
    """(39, 39) information on the 36 parameters and the attitude at the beginning, rad.

    The centre of the place changes no reading, so it is no column.
    """
    n, dt, width = len(true.time), true.time[1] - true.time[0], COUNT + 3
    rate, accel, mag, field = _sensitivities(true, model)
    reading, pace = true.clock.T[:2]
    drift, stationary = _place(setting)
    matrix_a, inverse_g, soft = np.asarray(model.accel.matrix), np.linalg.inv(model.gyro.matrix), np.asarray(model.magnetometer.soft_iron)

    # states: attitude; place, its derivatives by the clock, and the first of these one sample ago; then three for each Markov noise
    noises = [(sensor, sd, np.exp(-dt / tau), slice(15 + 3 * i, 18 + 3 * i)) for i, (sensor, sd, tau) in enumerate(setting.markov)]
    size = 15 + 3 * len(noises)
    covariance = np.zeros((size, size))
    covariance[3:12, 3:12] = np.kron(stationary, np.eye(3))
    for _, sd, _, at in noises:
        covariance[at, at] = sd**2 * np.eye(3)
    columns = np.zeros((size, width))
    columns[:3, COUNT:] = np.eye(3)
    world = np.einsum("ij,nkj->nik", matrix_a, true.attitude)
    measured, direct = np.zeros((n, 6, size)), np.zeros((n, 6, width))
    measured[:, :3, :3] = matrix_a @ skew(true.force)
    measured[1:, :3, 6:9] = (pace[1:] / dt)[:, None, None] * world[1:]
    measured[1:, :3, 12:15] = -(pace[:-1] / dt)[:, None, None] * world[1:]
    measured[:, 3:, :3] = soft @ skew(field)
    direct[:, :3, :COUNT], direct[:, 3:, :COUNT] = accel, mag
    bias = np.zeros((3, size))
    transition, driven = np.eye(size), np.zeros((size, size))
    for sensor, sd, decay, at in noises:
        transition[at, at], driven[at, at] = decay * np.eye(3), (1 - decay**2) * sd**2 * np.eye(3)
        if sensor == "gyro":
            bias[:, at] = np.eye(3)
        else:
            measured[:, : 3 if sensor == "accel" else 6, at][:, -3:] = np.eye(3)
    rows = 3 if setting.mag is None else 6
    spread = np.repeat([setting.accel**2 / dt, 1.0 if setting.mag is None else (setting.mag * float(model.field)) ** 2], 3)[:rows]
    turned, steps = np.einsum("nji,njk->nik", true.attitude[1:], true.attitude[:-1]), np.diff(reading)
    still = (pace[:-1] == 0) & (pace[1:] == 0)
    offset = np.zeros((3, width))
    offset[:, PARTS["gyro bias"]] = np.eye(3)
    wandering = dt * setting.gyro**2 * inverse_g @ inverse_g.T
    kept = {}
    total = np.zeros((width, width))

    def update(h, d, variance):
        nonlocal covariance, columns, total
        ph = covariance @ h.T
        factor = np.linalg.cholesky(h @ ph + np.diag(variance))
        w = solve_triangular(factor, np.concatenate([d + h @ columns, ph.T], axis=1), lower=True, check_finite=False)
        innovation, gain = w[:, :width], w[:, width:].T
        total += innovation.T @ innovation
        covariance = covariance - gain @ gain.T
        columns = columns - gain @ innovation

    for k in range(n):
        first = 0 if k else 3  # the first reading of the accelerometer has no step before it
        update(measured[k, first:rows], direct[k, first:rows], spread[first:])
        if k == n - 1:
            return total
        key = round(steps[k], 9)
        if key not in kept:
            phi = expm(drift * steps[k])
            step = np.zeros((4, 4))
            step[:3, :3], step[3, 1] = phi, 1.0
            kept[key] = np.kron(step, np.eye(3)), np.kron(stationary - phi @ stationary @ phi.T, np.eye(3))
        transition[3:15, 3:15], driven[3:12, 3:12] = kept[key]
        if still[k]:
            # the attitude stands, and the gyroscope measures its bias
            update(bias, offset, np.full(3, setting.gyro**2 / dt))
            transition[:3, :3], transition[:3, 15:], driven[:3, :3] = np.eye(3), 0.0, 0.0
        else:
            transition[:3, :3], transition[:3, 15:], driven[:3, :3] = turned[k], -dt * inverse_g @ bias[:, 15:], wandering
        covariance = transition @ covariance @ transition.T + driven
        columns = transition @ columns
        if not still[k]:
            # both rates are in the axes at the end of the step. Otherwise a rotation that gyroscope and magnetometer share would turn
            # the attitude, and the bound would know this rotation without the accelerometer
            columns[:3, :COUNT] += dt * (turned[k] @ rate[k] + rate[k + 1]) / 2
    raise AssertionError


def dense(true, model, setting):
    """The same information from finite differences of a nonlinear model, and one covariance matrix of all readings; no rests."""
    n, dt = len(true.time), true.time[1] - true.time[0]
    start = parameters(model)

    def triangle(values):
        matrix = np.zeros((3, 3))
        for value, place in zip(values, UPPER, strict=True):
            matrix[place] = value
        return matrix

    # the readings of the gyroscope are data: they give the rates of which the attitude is the product
    gyro = true.rate @ np.asarray(model.gyro.matrix).T + np.asarray(model.gyro.bias)
    slope = true.angular_acceleration @ np.asarray(model.gyro.matrix).T

    def readings(theta, tilt, errors, force):
        """Both sensors, with the error of each integrated step of the rate, and the acceleration that is added in the world."""
        late = theta[34] - start[34]
        rates = np.linalg.solve(theta[9:18].reshape(3, 3), (gyro + slope * late - theta[18:21]).T).T
        nominal = np.linalg.solve(np.asarray(model.gyro.matrix), (gyro - np.asarray(model.gyro.bias)).T).T
        # departures from the true attitude, as rotations after it
        depart, out = rotation(tilt), np.zeros((n, 6))
        change = rates - nominal
        for k in range(n):
            body = true.attitude[k] @ depart
            specific = body.T @ (true.acceleration[k] + force[k] + [0.0, 0.0, 9.80665])
            shifted = body @ rotation(-true.rate[k] * (theta[35] - start[35]))
            outside = model.field * np.array([np.cos(theta[33]), 0.0, -np.sin(theta[33])])
            out[k, :3] = triangle(theta[:6]) @ specific + theta[6:9]
            out[k, 3:] = theta[21:30].reshape(3, 3) @ (shifted.T @ outside) + theta[30:33]
            if k < n - 1:
                step = true.attitude[k].T @ true.attitude[k + 1]
                depart = step.T @ depart @ step @ rotation((step.T @ change[k] + change[k + 1]) / 2 * dt + errors[k])
        return out.ravel()

    scale = np.cbrt(np.linalg.det(np.asarray(model.magnetometer.soft_iron)))
    base = start[:COUNT].copy()
    base[21:30] *= scale
    zeros = np.zeros((n, 3))

    def slopes(function, count, step):
        def unit(i):
            return step * (np.arange(count) == i)

        return np.stack([(function(unit(i)) - function(-unit(i))) / (2 * step) for i in range(count)], axis=1)

    sizes = np.where(np.arange(COUNT) < 30, 1e-4, 1e-4)
    sizes[PARTS["hard iron"]] = 1e-4 * float(model.field)
    by_theta = slopes(lambda u: readings(base + u * sizes, np.zeros(3), zeros, zeros), COUNT, 1.0) / sizes
    by_tilt = slopes(lambda u: readings(base, u, zeros, zeros), 3, 1e-5)
    by_error = slopes(lambda u: readings(base, np.zeros(3), u.reshape(n, 3), zeros), 3 * n, 1e-5)
    by_force = slopes(lambda u: readings(base, np.zeros(3), zeros, u.reshape(n, 3)), 3 * n, 1e-3)
    drift, stationary = _place(setting)
    # covariance of the mean accelerations of steps, from that of the velocity
    speed = np.array([(expm(drift * dt * i) @ stationary)[1, 1] for i in range(n + 1)])
    apart = np.concatenate([[2 * (speed[0] - speed[1])], 2 * speed[1:n] - speed[: n - 1] - speed[2:]]) / dt**2
    index = np.abs(np.arange(n)[:, None] - np.arange(n))
    inverse = np.linalg.inv(model.gyro.matrix)
    cover = by_error @ np.kron(np.eye(n), setting.gyro**2 * dt * inverse @ inverse.T) @ by_error.T
    cover += by_force @ np.kron(apart[index], np.eye(3)) @ by_force.T
    cover += np.diag(np.tile(np.repeat([setting.accel**2 / dt, (setting.mag * float(model.field)) ** 2], 3), n))
    jacobian = np.concatenate([by_theta, by_tilt], axis=1)[3:]
    return jacobian.T @ np.linalg.solve(cover[3:, 3:], jacobian)


def shared(true, model, setting):
    """(4,) information on rotations and a delay that gyroscope and magnetometer share, as a part of that on each sensor's own.

    Only the accelerometer can show what they share, so without it this is the error of the numerical integration.
    """
    total = information(true, model, dataclasses.replace(setting, accel=1e6))
    begin = slice(COUNT, None)
    total = total[:COUNT, :COUNT] - total[:COUNT, begin] @ np.linalg.solve(total[begin, begin], total[begin, :COUNT])
    turns = np.zeros((2, 4, COUNT))
    for axis in range(3):
        turn = skew(np.eye(3)[axis])
        turns[0, axis, PARTS["gyro matrix"]] = np.ravel(model.gyro.matrix @ turn)
        turns[1, axis, PARTS["soft iron"]] = np.ravel(model.magnetometer.soft_iron @ turn)
    turns[0, 3, 34] = turns[1, 3, 35] = 1.0
    both, alone = (np.einsum("ip,pq,iq->i", v, total, v) for v in (turns.sum(axis=0), turns[0]))
    return both / alone


def cut(true, model, setting):
    """(9,) standard errors of the accelerometer where the attitude is known, from the density up to 20 corner frequencies, densely."""
    n, dt = len(true.time), true.time[1] - true.time[0]
    rate = 2 * np.pi * setting.corner
    omega = np.linspace(0, 20 * rate, 20001)
    density = omega**4 * 16 / 3 * setting.reach**2 * rate**5 / (rate**2 + omega**2) ** 3
    cover = np.array([np.trapezoid(density * np.cos(omega * dt * i), omega) / np.pi for i in range(n)])
    factor = cho_factor(toeplitz(cover) + setting.accel**2 / dt * np.eye(n))
    inverse = np.linalg.inv(model.accel.matrix)
    columns = [np.einsum("nab,b,n->na", true.attitude, inverse[:, i], true.force[:, j]) for i, j in UPPER]
    columns = np.concatenate([np.stack(columns, axis=-1), true.attitude @ inverse], axis=-1)
    total = sum(columns[:, k].T @ cho_solve(factor, columns[:, k]) for k in range(3))
    return np.sqrt(np.diag(np.linalg.inv(total)))


def rotation(vector):
    """Rotation matrix of a rotation vector."""
    return expm(skew(np.asarray(vector)))


def covariance_of(total, model):
    """(37, 37) covariance of `parameters`, where a direction without information has an infinite variance.

    The attitude at the beginning has a prior of 10 rad, which counts only where nothing shows the heading.
    """
    total = total.copy()
    total[COUNT:, COUNT:] += np.eye(3) / 10.0**2
    scale = 1 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    values, vectors = np.linalg.eigh(total * scale[:, None] * scale)
    blind = values < 1e-11
    part = scale[:, None] * vectors
    inverse = (part[:, ~blind] / values[~blind]) @ part[:, ~blind].T
    lost = (np.abs(vectors[:, blind]) > 1e-4).any(axis=1)[:COUNT]
    # from the gauge of a known field to that of a soft iron of determinant 1
    soft = np.asarray(model.magnetometer.soft_iron)
    size = np.cbrt(np.linalg.det(soft))
    gauge = np.zeros((COUNT + 1, COUNT))
    gauge[:COUNT] = np.eye(COUNT)
    trace = np.linalg.inv(soft).T.ravel() / 3
    gauge[PARTS["soft iron"], PARTS["soft iron"]] = (np.eye(9) - np.outer(soft.ravel(), trace)) / size
    gauge[COUNT, PARTS["soft iron"]] = float(model.field) * size * trace
    found = gauge @ inverse[:COUNT, :COUNT] @ gauge.T
    hidden = np.abs(gauge[:, lost]).max(axis=1, initial=0.0) > 1e-6
    found[hidden, hidden] = np.inf
    return found


def figures(deviation, model):
    """The figures by which the issue states a bound: root mean squares over axes, in units that a user knows."""
    accel, gyro = deviation[PARTS["accel matrix"]], deviation[PARTS["gyro matrix"]]
    diagonal = [UPPER.index((i, i)) for i in range(3)]

    def rms(x):
        return float(np.sqrt(np.mean(np.square(x))))

    return {
        "accel bias, mg": rms(deviation[PARTS["accel bias"]]) / 9.80665e-3,
        "accel scale, %": 100 * rms(accel[diagonal]),
        "accel misalignment, deg": np.rad2deg(rms(np.delete(accel, diagonal))),
        "gyro bias, deg/h": 3600 * np.rad2deg(rms(deviation[PARTS["gyro bias"]])),
        "gyro scale, %": 100 * rms(gyro[::4]),
        "gyro misalignment, deg": np.rad2deg(rms(np.delete(gyro, [0, 4, 8]))),
        "hard iron, % of field": 100 * rms(deviation[PARTS["hard iron"]]) / float(model.field),
        "soft iron, %": 100 * rms(deviation[PARTS["soft iron"]][::4]),
        "soft iron and rotation, deg": np.rad2deg(rms(np.delete(deviation[PARTS["soft iron"]], [0, 4, 8]))),
        "dip, deg": np.rad2deg(rms(deviation[PARTS["dip"]])),
        "gyro delay, ms": 1e3 * rms(deviation[PARTS["gyro delay"]]),
        "mag delay, ms": 1e3 * rms(deviation[PARTS["mag delay"]]),
    }


def table(cases, seeds):
    """Print the bound's figures, the root mean square over recordings, a column for each case: name -> (motion, setting)."""
    import jaxcal

    found = {}
    for name, (motion, setting) in cases.items():
        each = []
        for seed in range(seeds):
            _, model, true = jaxcal.device.simulate(seed=seed, **motion)
            deviation = np.sqrt(np.diag(covariance_of(information(true, model, setting), model)))
            each.append(list(figures(deviation, model).values()))
        found[name] = np.sqrt(np.mean(np.square(each), axis=0))
        print(name, dict(zip(figures(deviation, model), np.round(found[name], 5).tolist(), strict=True)), flush=True)
    names = list(figures(deviation, model))
    print("\n| | " + " | ".join(found) + " |\n|---|" + "---|" * len(found))
    for i, name in enumerate(names):
        print(f"| {name} | " + " | ".join(f"{column[i]:.2g}" for column in found.values()) + " |")


if __name__ == "__main__":
    import jaxcal

    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 4
    _, device, path = jaxcal.device.simulate(8.0, 10.0, seed=1)
    ours, whole = information(path, device, Setting()), dense(path, device, Setting())
    unit = 1 / np.sqrt(np.diag(whole))
    print(f"filter against one dense matrix, 80 samples: {np.abs((ours - whole) * unit[:, None] * unit).max():.1e} of the information")
    _, device, path = jaxcal.device.simulate(seed=1, swing=2.0)
    part = shared(path, device, Setting()).max()
    print(f"without accelerometer, on what the other sensors share: {part:.1e} of the information on one's own")
    _, device, path = jaxcal.device.simulate(90.0, 20.0, seed=3, tremor=0.0)
    known = information(path, device, dataclasses.replace(Setting(), gyro=1e-7))[:9, :9]
    ratio = np.sqrt(np.diag(np.linalg.inv(known))) / cut(path, device, Setting())
    print(f"standard errors over those of the cut density, attitude known: {ratio.min():.3f} to {ratio.max():.3f}")
    table(
        {
            "180 s of free motion": ({}, Setting()),
            "without magnetometer": ({}, Setting(mag=None)),
            "24 rests of 4 s": ({"rests": 24}, Setting()),
            "8 rests of 4 s": ({"rests": 8}, Setting()),
            "swing 2 rad/s": ({"swing": 2.0}, Setting()),
            "reach 0.5 m": ({"reach": 0.5}, Setting(reach=0.5)),
            "reach 0.1 m": ({"reach": 0.1}, Setting(reach=0.1)),
        },
        seeds,
    )
