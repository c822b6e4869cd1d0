"""All that jaxcal uses of JAX beyond its documented interface. If a new version of JAX breaks something, mend it here.

`tests/test_jax.py` has one test for each function, which says what to do when it fails. Everything else in jaxcal uses `jax`,
`jax.numpy` and the documented parts of `jax.core`, `jax.extend` and `jax.experimental` alone.
"""

import contextlib
import functools
import math
import sys
from collections.abc import Iterator
from typing import Any

import jax
import numpy as np
from jax.core import Tracer
from jax.extend.core import get_opaque_trace_state

#: Options of XLA for single programs on a CPU. QUICK: the older generator of fused loops, which jaxlib 0.11 no longer has, compiles in 0.55
#: of the time of the newer one of 0.10, and its programs give the same numbers at the same speed. WIDE: a quarter faster on cores with such
#: vectors. ROUGH: for programs that take longer to compile than to run. ONE_THREAD: a flag for a process that has one core to itself.
_OLDER = {"xla_cpu_use_fusion_emitters": False} if jax.__version__ < "0.11" else {}
QUICK: dict[str, Any] = {"xla_cpu_parallel_codegen_split_count": 1, **_OLDER}
WIDE: dict[str, Any] = {"xla_cpu_prefer_vector_width": "512"}
ROUGH: dict[str, Any] = {"xla_backend_optimization_level": 0}
ONE_THREAD = "--xla_cpu_multi_thread_eigen=false"

#: the latest state of JAX that was seen without a trace: comparing it takes half a microsecond, placing a constant 30
_untraced: Any = None


def is_traced(*trees: Any) -> bool:
    """Whether any leaf is a tracer, or a trace is in progress."""
    for leaf in jax.tree_util.tree_leaves(trees):
        if isinstance(leaf, Tracer):
            return True
    global _untraced
    here = get_opaque_trace_state()
    if here == _untraced:
        return False
    traced = isinstance(jax.device_put(np.float32(0)), Tracer)
    if not traced:
        _untraced = here
    return traced


def has_started() -> bool:
    """Whether JAX has computed anything in this process, without starting it."""
    return bool(getattr(sys.modules.get("jax._src.xla_bridge"), "_backends", None))


def setting(name: str) -> Any:
    """Value of one setting of JAX."""
    return getattr(jax.config, name)


def settings() -> list[tuple[str, str]]:
    """All settings of JAX on which a program may depend; those of its cache have no influence on it."""
    return sorted((name, repr(value)) for name, value in jax.config.values.items() if "cache" not in name)


@functools.cache
def is_quick() -> bool:
    """Whether programs run on a CPU, and this version of XLA has the options `QUICK`, which a later version may drop."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=QUICK).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def quickly(quick: Any, plain: Any, *data: Any) -> Any:
    """What a program with the options `QUICK` gives; the one without them, where XLA refuses these, which is asked only then."""
    if jax.default_backend() != "cpu" or (is_quick.cache_info().currsize and not is_quick()):
        return plain(*data)
    try:
        return quick(*data)
    except jax.errors.JaxRuntimeError:
        if is_quick():
            raise
        return plain(*data)


def as_one_kernel(result: Any) -> Any:
    """Mark the result of a `jax.jit` inside a program: XLA on a CPU then makes one piece of machine code of what computes it."""
    from jax.experimental.xla_metadata import set_xla_metadata

    return set_xla_metadata(result, xla_cpu_small_call="true", inlineable="false")


@contextlib.contextmanager
def no_entry() -> Iterator[None]:
    """Compile without leaving an entry in JAX's own cache.

    A program that JAX has loaded from its cache cannot be stored again: the file lacks its functions, and calls of what is read from it
    fail. Each program of the store would meet its entry there as soon as its name changes, with a new version of jaxcal.
    """
    limit = "jax_persistent_cache_min_compile_time_secs"
    before = setting(limit)
    jax.config.update(limit, math.inf)
    try:
        yield
    finally:
        jax.config.update(limit, before)


def stored(compiled: Any) -> bytes:
    """A compiled program as bytes."""
    from jax.experimental.serialize_executable import serialize

    return serialize(compiled)[0]


def restored(code: bytes, taken: Any, given: Any) -> Any:
    """The program in these bytes, with the structures of its arguments, (args, {}), and of its result."""
    from jax.experimental.serialize_executable import deserialize_and_load

    if b"lapack" in code:  # its routines are loaded when a program is traced; to trace one takes 0.07 s
        from jaxlib import lapack

        lapack.prepare_lapack_call("getrf", np.dtype(np.float64))
    return deserialize_and_load(code, taken, given)
