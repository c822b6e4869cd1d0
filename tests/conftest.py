"""Settings of all tests: strict JAX, optional type checks, a common cache of compiled programs, and the folder of reference data."""

import contextlib
import dataclasses
import functools
import gc
import importlib.metadata
import os
import pathlib
import shutil
import tempfile

# Compilation takes nine tenths of a run, and a large part of it is optimisation. Without optimisation, with the older generator of fused
# loops and with one object file for each program, compilation takes less than half the time. XLA_FLAGS= in the environment restores full
# optimisation. jaxlib 0.11 has the newer generator alone, and a flag that it does not know ends the process.
os.environ.setdefault(
    "XLA_FLAGS",
    "--xla_backend_optimization_level=0 --xla_llvm_disable_expensive_passes=true --xla_cpu_parallel_codegen_split_count=1"
    + (" --xla_cpu_use_fusion_emitters=false" if importlib.metadata.version("jaxlib") < "0.11" else ""),
)
# Without bytecode each of a hundred processes that the tests start compiles the package anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# If two processes use two threads each for linear algebra, they wait for one another, and thermal fits take four times as long.
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

# Each process, and each command, worker and notebook that it starts, would compile many of the same programs. A common cache folder saves
# a twelfth of the run. Tests that count compilations also count programs found in the cache.
_CACHE = None
if "JAX_COMPILATION_CACHE_DIR" not in os.environ:  # a process that another one starts uses the folder of that one
    _CACHE = tempfile.mkdtemp(prefix="jaxcal-tests-")
    limits = {"jax_persistent_cache_min_compile_time_secs": 0.0, "jax_persistent_cache_min_entry_size_bytes": -1}
    for name, value in {"jax_compilation_cache_dir": _CACHE, **limits}.items():
        os.environ[name.upper()] = str(value)
        jax.config.update(name, value)


def pytest_unconfigure():
    """Remove the cache of this run; only the process that made it does this."""
    if _CACHE is not None:
        shutil.rmtree(_CACHE, ignore_errors=True)


_by_jaxtyping = jaxtyping.jaxtyped


def _checked(fn=None, *, typechecker):
    """Check types and shapes at each call, as `jaxtyping.jaxtyped` does, but in a tenth of its time.

    `jaxtyped` binds the arguments and calls two of its own functions around every function, even one without annotations. This takes half
    the time of a test that calls the package in a loop. Here beartype checks arguments and result in one call. Two cases are left to
    `jaxtyped`: functions defined inside a function, which are created again at each call, and annotations given as strings.
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
        push_shape_memo({})  # stores the sizes of named axes for this call
        try:
            return inner(*args, **kwargs)
        finally:
            pop_shape_memo()

    call.checked = True
    return call


jaxtyping.jaxtyped = _checked  # the import hook of --jaxtyping-packages will apply it to the package, which is imported later


#: number of memory maps of a process above which compiled programs are released; Linux allows 65,530, beyond which the compiler crashes
_MOST_MAPS = 30_000


@pytest.fixture(autouse=True, scope="module")
def _programs_let_go():
    """Release compiled programs when a process has too many memory maps.

    Every compiled program needs some; a process that runs half of all tests would exceed the limit.
    """
    yield
    maps = pathlib.Path("/proc/self/maps")
    if maps.exists() and maps.read_bytes().count(b"\n") > _MOST_MAPS:
        jax.clear_caches()
        gc.collect()


def pytest_collection_finish():
    """Exclude all objects that exist now from garbage collection, which would search a million of them again and again, and search less."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(100_000, 20, 100)


@pytest.fixture(params=["float64", "float32"])
def precision(request):
    """Run the test twice, with JAX in float64 and in its default float32."""
    with jax.enable_x64(request.param == "float64"):
        yield request.param


@pytest.fixture(scope="session")
def refuses():
    """Context in which an error of jaxcal with this code must be raised; it gives the `pytest.raises` record."""

    @contextlib.contextmanager
    def expect(code, kind=None):
        from jaxcal import JaxcalError

        with pytest.raises(kind or JaxcalError) as caught:
            yield caught
        assert caught.value.code == code, f"{caught.value.code!r} instead of {code!r}: {caught.value}"

    return expect


@pytest.fixture(scope="session")
def doubts():
    """``doubts(log)``: the codes of all findings that are more than notes, in their order; guesses only on request."""

    def of(found, guesses=False):
        return [one.code for one in found.findings if one.severity and (guesses or not one.kind.guess)]

    return of


@pytest.fixture(scope="session")
def finding():
    """``finding(log, code)``: the only finding of this code."""

    def of(found, code):
        (one,) = [one for one in found.findings if one.code == code]
        return one

    return of


@pytest.fixture(scope="session")
def reference():
    """Folder with reference numbers and real logs (`JAXCAL_REFERENCE`, default ../shared)."""
    root = pathlib.Path(__file__).resolve().parents[1]
    folder = pathlib.Path(os.environ.get("JAXCAL_REFERENCE", root.parent / "shared"))
    if not (folder / "reference").is_dir():
        pytest.skip(f"no reference data at {folder}; set JAXCAL_REFERENCE to the folder that holds reference/ and data/")
    return folder
