"""Strict JAX settings for every test, checked types where asked for, one cache of compiled programs, and numbers recorded by others."""

import dataclasses
import functools
import gc
import os
import pathlib
import shutil
import tempfile

# Nine tenths of a run is compilation, and much of that optimisation, which makes the same programs faster. Without it, with the older
# generator of fused loops and with one object file for each program, compilation takes less than half the time. Everything is optimised
# with XLA_FLAGS= in the environment.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true "
    "--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1",
)
# Two processes whose linear algebra takes two threads each wait for one another: thermal fits take four times as long.
os.environ.setdefault("OMP_NUM_THREADS", "1")
import beartype
import jax
import jaxtyping
import matplotlib
import pytest
from jaxtyping._storage import pop_shape_memo, push_shape_memo

matplotlib.use("Agg")
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")

# Many programs are compiled more than once: by each process, and by the commands, workers and notebooks they start. One folder for all of
# them saves a twelfth of a run. What counts compilations counts programs that are found there too.
_CACHE = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # processes find the folder of the one that started them
    _CACHE = tempfile.mkdtemp(prefix="jaxcal-tests-")
    limits = {"jax_persistent_cache_min_compile_time_secs": 0.01, "jax_persistent_cache_min_entry_size_bytes": -1}
    for name, value in {"jax_compilation_cache_dir": _CACHE, **limits}.items():
        os.environ[name.upper()] = str(value)
        jax.config.update(name, value)


def pytest_unconfigure():
    """Remove the cache of this run, in the process that made it."""
    if _CACHE is not None:
        shutil.rmtree(_CACHE, ignore_errors=True)


_by_jaxtyping = jaxtyping.jaxtyped


def _checked(fn=None, *, typechecker):
    """Check types and shapes at each call, as `jaxtyping.jaxtyped` does, in a tenth of its time.

    `jaxtyped` binds the arguments and calls two functions of its own around every function, also where nothing is annotated. That is half
    of a test that calls the package in a loop. Here beartype checks arguments and result in one call. `jaxtyped` checks what is left: a
    function inside of a function, which is made anew at each call, and annotations that name a class before it is there.
    """
    if fn is None:
        return functools.partial(_checked, typechecker=typechecker)
    if isinstance(fn, type):
        if dataclasses.is_dataclass(fn) and not hasattr(fn.__init__, "checked"):
            fn.__init__ = _checked(fn.__init__, typechecker=typechecker)
        return fn
    if not fn.__annotations__:
        return fn
    if "<locals>" in fn.__qualname__ or any(isinstance(hint, str) for hint in fn.__annotations__.values()):
        return _by_jaxtyping(fn, typechecker=typechecker)
    inner = beartype.beartype(fn)

    @functools.wraps(fn)
    def call(*args, **kwargs):
        push_shape_memo({})  # the sizes that the names of axes have in this call
        try:
            return inner(*args, **kwargs)
        finally:
            pop_shape_memo()

    call.checked = True
    return call


jaxtyping.jaxtyped = _checked  # the import hook of --jaxtyping-packages applies it to the package, which is not imported yet


#: memory maps of a process beyond which compiled programs are let go; Linux allows 65,530, and a compiler that gets no more of them crashes
_MOST_MAPS = 30_000


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go():
    """Every program compiled holds memory maps: a process that runs half of all tests would have more than it may."""
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > _MOST_MAPS:
        jax.clear_caches()
        gc.collect()


def pytest_collection_finish():
    """What is loaded by now stays: the collector of cycles need not look through a million of its objects again and again."""
    gc.collect()
    gc.freeze()


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
