"""What `jaxcal.evidence` finds: false alarms of each detector on records of noise alone, and knocks, put-downs and lifts that it must find.

    python benchmarks/evidence.py [RECORDS]

Records are made here, in the frequency domain, by code that shares nothing with the detectors.
"""

import collections
import sys
import time

import numpy as np

from jaxcal.evidence import bursts, find

ROUNDING = {"float": 0.0, "fine": 0.1, "sd": 1.0, "coarse": 2.0, "hidden": 10.0}  # step of the values, in standard deviations of the noise
AXES = np.array([0.6, -0.3, 0.74])  # direction of every event


def noise(rng, samples: int, rate: float, corner_b: float = 0.01, corner_k: float = 0.001, n: float = 1.0, q: float = 0.0) -> np.ndarray:
    """Record (samples, 3) of white noise n, flicker and random walk that reach it at two corner frequencies (Hz), and quantisation."""
    long = 2 * samples  # half of a period, so that the ends are independent
    f = np.fft.rfftfreq(long, 1 / rate)
    f[0] = f[1]
    root = n * np.sqrt((1 + corner_b / f + (corner_k / f) ** 2) * rate * long / 2)
    draws = rng.normal(size=(3, len(f))) + 1j * rng.normal(size=(3, len(f)))
    record = np.fft.irfft(draws * root, long)[:, :samples].T
    return record + q * n * np.sqrt(rate) * np.diff(rng.uniform(-1, 1, size=(samples + 1, 3)), axis=0)


def clean(seed: int, most: int = 1_000_000) -> tuple[np.ndarray, float, str]:
    """A record without any event: 10 min to 3 h, 10 to 400 Hz, rounded or not."""
    rng = np.random.default_rng(seed)
    seconds, rate = rng.choice([600, 1800, 3600, 10800]), float(rng.choice([10, 50, 100, 200, 400]))
    samples = int(min(seconds * rate, most))
    q, kind = rng.choice([0.0, 0.3]), str(rng.choice(list(ROUNDING)))
    y = noise(rng, samples, rate, 10 ** rng.uniform(-3, -0.5), 10 ** rng.uniform(-3.5, -1.5), 1.0, q)
    step = ROUNDING[kind] * np.sqrt(rate)
    return (np.round((y + rng.uniform(-0.5, 0.5) * step) / step) * step if step else y), rate, kind


def half_sine(t: np.ndarray, start: float, height: float, length: float) -> np.ndarray:
    """A knock."""
    return np.where((t >= start) & (t < start + length), height * np.sin(np.pi * (t - start) / length), 0.0)


def put_down(t: np.ndarray, height: float = 0.5, decay: float = 0.8, frequency: float = 2.0) -> np.ndarray:
    """Swinging of a sensor that was put down at the start."""
    return height * np.exp(-t / decay) * np.sin(2 * np.pi * frequency * t)


def disturbed(seed: int, height: float, length: float, where: str, rate: float = 100.0, seconds: float = 600.0, n: float = 1.4e-4):
    """A record of a gyroscope with knocks at the start, middle or end, or twice: rate, readings, and (start, stop) of each knock in s."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    y = noise(rng, len(t), rate, n=n)
    last = seconds - length - 0.3
    starts = {"start": [0.2], "middle": [seconds / 2], "end": [last], "twice": [seconds / 3, 2 * seconds / 3]}[where]
    for start in starts:
        y += half_sine(t, start, height, length)[:, None] * AXES
    return rate, y, [(start, start + length) for start in starts]


def main() -> None:
    records = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    count, marked, samples = collections.Counter(), collections.Counter(), 0
    rounded = collections.Counter()
    for seed in range(records):
        y, rate, kind = clean(seed)
        found = [one for one in find({"gyro": y}, rate) if one.kind != "coarse"]
        samples += len(y)
        for name in {one.kind for one in found}:
            count[name] += 1
        for one in found:
            marked[one.kind] += one.samples
        rounded[kind] += bool(found)
    print(f"{records} records of noise alone; false alarms by kind, share of records and of samples:")
    for name in ("knock", "moving", "step", "held", "stuck", "zeroed", "clipped", "warm_up"):
        print(f"  {name:8} {100 * count[name] / records:6.2f} % {100 * marked[name] / samples:8.4f} %")
    print("  records with any, by rounding:", dict(rounded))

    print("knocks: found, named within 0.5 s, samples of the knock left in, seconds set aside beyond it (mean)")
    for height in (0.01, 0.03, 0.15, 0.5):
        for length in (0.2, 0.5, 1.0, 2.0):
            rows = []
            for i, where in enumerate(("start", "middle", "end", "twice")):
                rate, y, known = disturbed(1000 + i, height, length, where)
                ranges = [(a / rate, b / rate) for a, b in bursts(y, rate)]
                out = np.zeros(len(y), bool)
                for a, b in ranges:
                    out[round(a * rate) : round(b * rate)] = True
                for start, stop in known:
                    near = [one for one in ranges if one[0] < stop and one[1] > start]
                    inside = out[round(start * rate) : round(stop * rate)]
                    rows.append((bool(near), bool(near) and abs(near[0][0] - start) < 0.5, 1 - inside.mean(),
                                 out.sum() / rate / len(known) - inside.sum() / rate))  # fmt: skip
            print(f"  {height:5} rad/s {length:4} s:", *(f"{value:.2f}" for value in np.mean(rows, axis=0)))
    y = noise(np.random.default_rng(5), 360_000, 100.0, n=1.4e-4) + put_down(np.arange(360_000) / 100.0)[:, None] * AXES
    print("put down:", [(a / 100, b / 100) for a, b in bursts(y, 100.0)])
    y = np.random.default_rng(0).normal(size=(1_000_000, 6))
    find({"gyro": y[:100_000, :3]}, 100.0)
    began = time.perf_counter()
    bursts(y[:, :3], 100.0), bursts(y[:, 3:], 100.0)
    print(f"bursts of 6 channels of 10^6 samples: {time.perf_counter() - began:.2f} s")


if __name__ == "__main__":
    main()
