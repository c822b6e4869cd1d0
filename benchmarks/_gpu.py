"""The kernel on a GPU, if there is one: time, and share of the memory bandwidth that a copy reaches in the same run."""

import time

import jax
import jax.numpy as jnp
import numpy as np

from jaxcal.allan._kernels._difference_sums import direct_sums
from jaxcal.allan._kernels._phase import padded_length


def _seconds(function):
    jax.block_until_ready(function())
    times = []
    for _ in range(5):
        start = time.perf_counter()
        jax.block_until_ready(function())
        times.append(time.perf_counter() - start)
    return min(times)


def bandwidth(samples=10**7):
    """Time the overlapping Allan variance in float64 at octaves; each difference reads three times 8 bytes."""
    if jax.default_backend() != "gpu":
        print(f"no GPU: the backend is {jax.default_backend()}; nothing measured")
        return
    with jax.enable_x64(True):
        theta = jnp.cumsum(jax.random.normal(jax.random.key(0), (padded_length(samples),), dtype=jnp.float64))
        copied = _seconds(lambda: theta + 1.0)
        ceiling = 2 * theta.nbytes / copied
        m = 2 ** np.arange(int(np.log2(samples // 2)) + 1)
        count = samples - 2 * m + 1
        moved = 3 * 8 * int(count.sum())
        arguments = ((theta,), None, jnp.asarray(m), jnp.asarray(count), 0)
        seconds = _seconds(lambda: direct_sums(*arguments, order=2, strided=False, rule="none"))
        share = moved / seconds / ceiling
        print(f"{jax.devices()[0].device_kind}: {len(m)} cluster sizes of {samples} samples in {seconds:.4f} s, ", end="")
        print(f"{moved / seconds / 1e9:.0f} GB/s, {100 * share:.0f} % of a copy's {ceiling / 1e9:.0f} GB/s", flush=True)


if __name__ == "__main__":
    bandwidth()
