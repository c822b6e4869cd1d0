"""`jit` and `filter_jit`: compiled in half the time on a CPU.

Most of a first call is compilation, and most of that is XLA's newer generator of fused loops. The older one gives the same numbers at the
same speed. Options for one program leave the user's own settings and programs alone.
"""

import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax

from ._precision import is_traced

_QUICK: dict[str, Any] = {"xla_cpu_use_fusion_emitters": False, "xla_cpu_parallel_codegen_split_count": 1}


@functools.cache
def _known() -> bool:
    """Whether programs run on a CPU, and this version of XLA has the options; a later one may not."""
    if jax.default_backend() != "cpu":
        return False
    try:
        jax.jit(lambda: 0, compiler_options=_QUICK).lower().compile()
    except jax.errors.JaxRuntimeError:
        return False
    return True


def _compiled(make: Callable[..., Any], function: Callable[..., Any] | None, options: dict[str, Any]) -> Any:
    if function is None:
        return lambda function: _compiled(make, function, options)
    further = options.pop("compiler_options", {})
    plain, quick = make(function, **options), make(function, **options, compiler_options=_QUICK | further)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        # inside another program the options of that program hold, and jax refuses others
        return (plain if is_traced(args, kwargs) or not _known() else quick)(*args, **kwargs)

    return call


def jit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`jax.jit` with the quick compiler; `options` are those of `jax.jit`.

    Examples
    --------
    >>> import jax
    >>> from jaxcal._compile import jit
    >>> double = jit(lambda x: 2 * x)
    >>> print(double(3.0), jax.jit(double)(3.0))
    6.0 6.0
    """
    return _compiled(jax.jit, function, options)


def filter_jit(function: Callable[..., Any] | None = None, **options: Any) -> Any:
    """`equinox.filter_jit` with the quick compiler.

    Examples
    --------
    >>> from jaxcal._compile import filter_jit
    >>> print(filter_jit(lambda x, name: 2 * x)(3.0, "twice"))
    6.0
    """
    return _compiled(eqx.filter_jit, function, options)
