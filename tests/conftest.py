"""Strict JAX settings for every test, and the way to numbers recorded by others."""

import os
import pathlib

# Nine tenths of a run is compilation, and much of that optimisation, which makes the same programs faster: a run takes a quarter less
# without it. Commands that tests start as processes are optimised; so is everything with XLA_FLAGS= in the environment.
os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true")

import jax
import matplotlib
import pytest

matplotlib.use("Agg")
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")


@pytest.fixture(params=["float64", "float32"])
def precision(request):
    """Run the test twice: with the user's JAX in float64 and in its default float32."""
    with jax.enable_x64(request.param == "float64"):
        yield request.param


@pytest.fixture(scope="session")
def reference():
    """Folder with numbers and logs recorded by others (`JAXCAL_REFERENCE`, default ../shared)."""
    root = pathlib.Path(__file__).resolve().parents[1]
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", root.parent / "shared"))
    if not (folder / "reference").is_dir():
        pytest.skip(f"no reference data at {folder}; set JAXCAL_REFERENCE to the folder that holds reference/ and data/")
    return folder
