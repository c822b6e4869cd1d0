"""A device in a hand, simulated without any code of jaxcal: attitude from three angles, everything else by differences on a fine grid."""

import numpy as np
import scipy.signal
from scipy.spatial.transform import Rotation

GRAVITY, OVER = 9.80665, 10  # m/s^2; steps of the fine grid for each sample


def _signal(rng, clock, size, corner):
    """A smooth random signal of the clock, with amplitudes that fall above the corner in Hz."""
    f = np.geomspace(0.02, 6.0, 60)
    power = (1 + (f / corner) ** 2) ** -3 * f  # the lines are equally far apart on a logarithmic scale
    amplitude = size * np.sqrt(2 * power / power.sum())
    return np.cos(2 * np.pi * np.outer(clock, f) + rng.uniform(0, 2 * np.pi, len(f))) @ amplitude


def _clock(rng, time, rests, still):
    """Time that stands still in rests: its pace falls to 0 and rises again within 0.4 s."""
    pace, step = np.ones_like(time), time[1] - time[0]
    for k in range(rests):
        start = time[-1] * (k + rng.uniform(0.3, 0.6)) / rests
        pace[(time > start) & (time < start + still)] = 0.0
    window = np.hanning(round(0.4 / step))
    return np.cumsum(np.convolve(pace, window / window.sum(), "same")) * step


def _low_pass(y, hertz, step):
    """First order, by the exact step response for readings that are straight between the samples."""
    keep = np.exp(-2 * np.pi * hertz * step)
    share = (1 - keep) / (2 * np.pi * hertz * step)
    b, a = [1 - share, share - keep], [1.0, -keep]
    return scipy.signal.lfilter(b, a, y - y[0], axis=0) + y[0]


def recording(seed, duration=180.0, rate=100.0, rests=8, still=4.0, swing=0.12, reach=0.15, poles=None, noise=1.0, filtered_noise=False,
              wrong=None, plain=False):  # fmt: skip
    """Readings accel, gyro, mag (n, 3), and the truth.

    poles : sensor -> Hz of a first-order low-pass; `filtered_noise` passes the noise through it. wrong : sensor -> matrix (3, 3) that
    multiplies its readings. plain : no errors of scale and axes.
    """
    rng = np.random.default_rng([seed, 77])
    step = 1 / (rate * OVER)
    time = np.arange(-3.0, duration + 0.5, step)
    clock = _clock(rng, time, rests, still) if rests else time
    angles = np.stack([_signal(rng, clock, 2.0, swing) for _ in range(3)], axis=1)
    turns = Rotation.from_euler("ZXY", angles)
    place = np.stack([_signal(rng, clock, reach, 0.3) for _ in range(3)], axis=1)
    rate_ = (turns[:-2].inv() * turns[2:]).as_rotvec() / (2 * step)
    pull = np.diff(place, 2, axis=0) / step**2 + [0.0, 0.0, GRAVITY]
    inner = turns[1:-1].inv()
    dip = np.deg2rad(rng.uniform(40, 70))
    true = {"accel": inner.apply(pull), "gyro": rate_, "mag": inner.apply(50e-6 * np.array([np.cos(dip), 0.0, -np.sin(dip)]))}
    upper = np.eye(3) + 0.01 * np.triu(rng.normal(size=(3, 3)))
    skewed = {"accel": upper, "gyro": np.eye(3) + 0.01 * rng.normal(size=(3, 3)), "mag": np.eye(3) + 0.03 * rng.normal(size=(3, 3))}
    bias = {"accel": 0.1 * rng.normal(size=3), "gyro": 0.01 * rng.normal(size=3), "mag": 15e-6 * rng.normal(size=3)}
    sigma = {"accel": 120e-6 * 9.80665, "gyro": np.deg2rad(0.007), "mag": 0.005 * 50e-6 / np.sqrt(rate)}
    first = round(3.0 / step)
    found, truth = {}, {"dip": dip}
    for sensor, y in true.items():
        matrix = np.eye(3) if plain else skewed[sensor]
        y = y @ matrix.T + bias[sensor]
        noisy = noise * sigma[sensor] * np.sqrt(rate)
        pole = (poles or {}).get(sensor)
        if pole and filtered_noise:
            y = y + noisy * np.sqrt(OVER) * rng.normal(size=y.shape)
        y = _low_pass(y, pole, step) if pole else y
        y = y[first::OVER][: round(duration * rate)]
        if not (pole and filtered_noise):
            y = y + noisy * rng.normal(size=y.shape)
        turn = np.asarray((wrong or {}).get(sensor, np.eye(3)))
        found[sensor] = y @ turn.T
        truth |= {f"{sensor}.matrix": turn @ matrix, f"{sensor}.bias": turn @ bias[sensor]}
    return found, truth


def poses(seed, count=24, rate=100.0, wrong=((1, 0, 0), (0, 1, 0), (0, 0, 1))):
    """A session for the IMU: rests of 4 s in random attitudes, with turns of about 2 s between them; `wrong` multiplies the rates."""
    rng = np.random.default_rng([seed, 78])
    step = 1 / (rate * OVER)
    at, now, times = [Rotation.identity()], 30.0, [0.0, 30.0]
    for _ in range(count - 1):
        axis = rng.normal(size=3)
        at += [at[-1], at[-1] * Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.uniform(0.8, 2.5))]
        times += [now + (length := rng.uniform(1.5, 2.5)), now + length + 4.0]
        now = times[-1]
    at.append(at[-1])
    time = np.arange(0.0, times[-1], step)
    k = np.clip(np.searchsorted(times, time, "right") - 1, 0, len(times) - 2)
    share = np.clip((time - np.take(times, k)) / (np.take(times, k + 1) - np.take(times, k)), 0, 1)
    share = share - np.sin(2 * np.pi * share) / (2 * np.pi)  # a turn starts and ends smoothly
    whole = Rotation.concatenate(at)
    turns = whole[k] * Rotation.from_rotvec((whole[k].inv() * whole[k + 1]).as_rotvec() * share[:, None])
    rates = (turns[:-2].inv() * turns[2:]).as_rotvec() / (2 * step)
    force = turns[1:-1].inv().apply([0.0, 0.0, GRAVITY])
    accel = np.eye(3) + 0.01 * np.triu(rng.normal(size=(3, 3)))
    gyro = np.eye(3) + 0.01 * rng.normal(size=(3, 3))
    noisy = lambda y, size: y[::OVER] + size * np.sqrt(rate) * rng.normal(size=y[::OVER].shape)  # noqa: E731
    return {"accel": noisy(force @ accel.T + 0.1 * rng.normal(size=3), 120e-6 * 9.80665),
            "gyro": noisy(rates @ gyro.T + 0.01 * rng.normal(size=3), np.deg2rad(0.007)) @ np.asarray(wrong).T}  # fmt: skip
