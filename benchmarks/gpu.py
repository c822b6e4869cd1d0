"""Three jobs for a graphics card, each in one call of one program: time, agreement with NumPy or with the truth, and the card's name.

    python benchmarks/gpu.py                            1e9 samples, 10,000 noise fits of 2^17, 100,000 ellipsoid fits of 360 readings
    python benchmarks/gpu.py --part 0.001               a thousandth of it
    JAX_PLATFORMS=cpu python benchmarks/gpu.py --part 0.01   the same on the processor

Records are made on the device, so no time of these is that of a cable; "from the host" is the ordinary call with an array of NumPy.
"""

import argparse
import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxcal import allan, magnetometer, noise

RATE, N, K = 100.0, 1e-3, 1e-4
SAMPLES, RECORDS, SESSIONS = 10**9, 10_000, 100_000
LENGTH, READINGS = 2**17, 360
AT_ONCE = 1000  # records of a step: 1 GB, and about ten times as much beside it
SOFT = np.array([[1.1, 0.06, -0.04], [0.06, 0.92, 0.05], [-0.04, 0.05, 1.0]])
HARD = np.array([8.0, -5.0, 3.0])
FIELD, ERROR = 47.0, 0.3  # uT


def clocked(call):
    """Result of the second call, and seconds of the first (with compilation) and of the second."""
    seconds = []
    for _ in range(2):
        begin = time.perf_counter()
        found = jax.block_until_ready(call())
        seconds.append(time.perf_counter() - begin)
    return found, *seconds


def say(job, first, second, note):
    print(f"{job:52s} first {first:7.2f} s  then {second:8.3f} s  {note}", flush=True)


def record(key, samples):
    white, walk = jax.random.split(key)
    slow = jnp.cumsum(jax.random.normal(walk, (samples,))) * (K / RATE**0.5)
    return N * RATE**0.5 * jax.random.normal(white, (samples,)) + slow


def long_record(samples):
    """oadev at octaves, on the device and from the host; the differences that the formula has, and their bytes if each is read alone."""
    m = 2 ** np.arange(int(np.log2(samples // 4)) + 1)
    y = jax.block_until_ready(jax.jit(record, static_argnums=1)(jax.random.key(0), samples))
    on_device = jax.jit(lambda y: allan.deviation(y, RATE, m=m, alpha=0).deviation)
    inside, first, second = clocked(lambda: on_device(y))
    moved = 3 * 8 * float(np.sum(samples + 1 - 2 * m))
    say(f"oadev, {samples:.3g} samples, {len(m)} octaves, on the device", first, second, f"{moved / second / 1e9:.0f} GB/s of differences")
    held = np.asarray(y)
    del y
    outside, first, second = clocked(lambda: allan.deviation(held, RATE, m=m).deviation)
    theta = np.concatenate([[0.0], np.cumsum(held - held.mean())])
    some = m[:: max(1, len(m) // 4)]
    known = np.array([np.sqrt(np.mean((theta[2 * i :] - 2 * theta[i:-i] + theta[: -2 * i]) ** 2) / 2) / i for i in some])
    worst = [float(np.max(np.abs(np.asarray(found)[np.searchsorted(m, some)] / known - 1))) for found in (inside, outside)]
    say("  the same from the host, with types and intervals", first, second, f"from NumPy: {worst[0]:.1e}, {worst[1]:.1e} at most")


def noise_fits(records):
    """Fits of white noise and rate random walk, made and fitted in one program."""

    def one(key):
        found = noise.fit(record(key, LENGTH), RATE, terms=("N", "K"))
        return jnp.stack([jnp.asarray(found.noise.N), jnp.asarray(found.noise.K)])

    every = jax.jit(lambda keys: jax.lax.map(one, keys, batch_size=min(AT_ONCE, records)))
    keys = jax.random.split(jax.random.key(1), records)
    found, first, second = clocked(lambda: every(keys))
    spread = np.std(np.asarray(found), axis=0) / [N, K]
    off = np.mean(np.asarray(found), axis=0) / [N, K] - 1
    each = ", ".join(f"{'NK'[i]} off by {100 * off[i]:.3f} % on average, one by {100 * spread[i]:.2f}" for i in (0, 1))
    say(f"{records} noise fits of 2^17", first, second, f"{1e3 * second / records:.3f} ms each; {each}")


def ellipsoid_fits(sessions):
    """Fits of a symmetric soft iron to readings in all directions, all at once."""

    def readings(key):
        way, error = jax.random.split(key)
        u = jax.random.normal(way, (READINGS, 3))
        u = u / jnp.linalg.norm(u, axis=1, keepdims=True)
        return FIELD * u @ SOFT + HARD + ERROR * jax.random.normal(error, u.shape)

    every = jax.jit(jax.vmap(lambda key: magnetometer.fit(readings(key), model="symmetric").model.hard_iron))
    keys = jax.random.split(jax.random.key(2), sessions)
    found, first, second = clocked(lambda: every(keys))
    off = np.asarray(found) - HARD
    note = f"{1e6 * second / sessions:.2f} us each; hard iron off by {np.sqrt(np.mean(off**2)):.4f} uT rms, {np.abs(off).max():.3f} at most"
    say(f"{sessions} ellipsoid fits of {READINGS} readings", first, second, note)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--part", type=float, default=1.0)
    parser.add_argument("jobs", nargs="*", default=["long", "noise", "ellipsoid"])
    asked = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    print(f"{jax.devices()[0].device_kind} ({jax.default_backend()}), jax {jax.__version__}", flush=True)
    jobs = {"long": (long_record, SAMPLES), "noise": (noise_fits, RECORDS), "ellipsoid": (ellipsoid_fits, SESSIONS)}
    for name in asked.jobs:
        job, size = jobs[name]
        job(max(10, int(asked.part * size)))


if __name__ == "__main__":
    main()
