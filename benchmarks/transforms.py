"""CPU seconds of each cell of the table of `tests/test_transforms.py`, with its compilation, each in a process of its own, slowest first.

    python benchmarks/transforms.py                      all cells: a quarter of an hour of one core
    python benchmarks/transforms.py alignment "vmap"     cells whose name contains all of these words

Asked: 10 s for each cell. The first number is the call under the transform, the second the call of the plain function before it, which a
differentiated program shares nothing with.
"""

import concurrent.futures
import os
import pathlib
import subprocess
import sys

ROOT = pathlib.Path(__file__).resolve().parents[1]
ASKED = 10.0  # s
CELL = """
import sys, time
import jax, jax.numpy as jnp
jax.config.update("jax_enable_x64", True)
from tests.test_transforms import CLOSED, FITS, JACOBIANS, SLOPES, VALUES
name, transform = sys.argv[1:]
function, x, _ = (FITS | CLOSED)[name]
def clocked(call):
    begin = time.process_time()
    jax.block_until_ready(call())
    return time.process_time() - begin
if transform == "x64 off":
    with jax.enable_x64(False), jax.numpy_dtype_promotion("standard"):
        cell = clocked(lambda: jax.jit(function)(jnp.asarray(x, jnp.float32)))
elif transform == "float32":
    cell = clocked(lambda: function(x.astype("float32")))
elif transform in SLOPES:
    cell = clocked(lambda: SLOPES[transform](lambda y: jnp.sum(function(y)), jnp.asarray(x)))
else:
    how = VALUES.get(transform) or (lambda f, y: JACOBIANS[transform](f)(y))
    cell = clocked(lambda: how(function, jnp.asarray(x)))
print(cell, clocked(lambda: function(x)))
"""


def seconds(cell):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    words = [sys.executable, "-W", "ignore", "-c", CELL, *cell]
    return tuple(map(float, subprocess.run(words, cwd=ROOT, env=environment, check=True, capture_output=True, text=True).stdout.split()))


def main():
    sys.path.insert(0, str(ROOT))
    from tests.test_transforms import CELLS

    wanted = [cell for cell in CELLS if all(word in ", ".join(cell) for word in sys.argv[1:])]
    with concurrent.futures.ThreadPoolExecutor(1) as pool:
        found = sorted(zip(pool.map(seconds, wanted), wanted, strict=True), reverse=True)
    for (cell, plain), (name, transform) in found:
        print(f"{cell:6.2f} {plain:6.2f}  {name}, {transform}")
    print(f"{sum(cell > ASKED for (cell, _), _ in found)} of {len(found)} cells take more than {ASKED:g} s")


if __name__ == "__main__":
    main()
