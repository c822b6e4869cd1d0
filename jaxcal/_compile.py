"""`filter_jit`: compile in half the time on a CPU.

Most of a first call is compilation, and most of that is XLA's newer generator of fused loops. The older generator gives the same numbers
at the same speed. The options are set for single programs, so the user's own settings and programs are not affected.
"""

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import equinox as eqx
import jax

from ._jax import QUICK, as_one_kernel, is_quick, is_traced, quickly
from ._programs import Slot, Store


@jax.tree_util.register_static
class _Fixed:
    """The part of a tree that is compiled into the program: its structure, and its leaves with None in place of each array."""

    def __init__(self, structure: Any, leaves: tuple[Any, ...]):
        self.structure, self.leaves = structure, leaves
        self._hash = hash((structure, leaves))

    def __hash__(self) -> int:
        return self._hash

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Fixed) and (self.structure, self.leaves) == (other.structure, other.leaves)

    def __reduce__(self) -> Any:
        # a structure that contains classes cannot be pickled, but a tree with that structure can
        marked = [Slot((), "", False) if leaf is None else leaf for leaf in self.leaves]
        return _fixed_of, (jax.tree.unflatten(self.structure, marked),)


def _fixed_of(tree: Any) -> _Fixed:
    leaves, structure = jax.tree.flatten(tree)
    return _Fixed(structure, tuple(None if isinstance(leaf, Slot) else leaf for leaf in leaves))


def _split(tree: Any) -> tuple[list[Any], _Fixed]:
    leaves, structure = jax.tree.flatten(tree)
    arrays = [leaf for leaf in leaves if eqx.is_array(leaf)]
    return arrays, _Fixed(structure, tuple(None if eqx.is_array(leaf) else leaf for leaf in leaves))


def _joined(arrays: list[Any], fixed: _Fixed) -> Any:
    following = iter(arrays)
    return jax.tree.unflatten(fixed.structure, [next(following) if leaf is None else leaf for leaf in fixed.leaves])


def stored_jit(function: Callable[..., Any], *, compiler_options: dict[str, Any], **options: Any) -> Any:
    """`jax.jit`, except in commands, which look for the program in their store.

    Examples
    --------
    >>> from jaxcal._compile import stored_jit
    >>> print(stored_jit(lambda x: 2 * x, compiler_options={})(3.0))
    6.0
    """
    return filter_jit(function, compiler_options, jax.jit(function, compiler_options=compiler_options, **options))


def one_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function, compiled as one piece of machine code within a program on a CPU; keyword arguments are static.

    XLA otherwise starts each operation of a loop by itself, at 0.1 us each. Use it for loops of arithmetic, slices and sums only: XLA
    cannot compile all other operations in this way.

    Examples
    --------
    >>> import jax
    >>> from jaxcal._compile import one_kernel
    >>> print(jax.jit(one_kernel(lambda x: jax.lax.fori_loop(0, 3, lambda i, x: 2 * x, x)))(1.0))
    8.0
    """

    @functools.wraps(function)
    def call(*args: Any, **fixed: Any) -> Any:
        if jax.default_backend() != "cpu":
            return function(*args, **fixed)
        found = jax.jit(functools.partial(function, **fixed))(*args)
        return as_one_kernel(found)

    return call


def filter_jit(function: Callable[..., Any], further: dict[str, Any] | None = None, direct: Callable[..., Any] | None = None) -> Any:
    """`equinox.filter_jit` with the faster compiler options, and with less overhead, for small programs that are called often.

    Arrays at any depth of the arguments are data. All other values are compiled into the program, and a new value compiles it again.
    `further` are options of the compiler; `direct` is called instead where no programs are stored.

    Examples
    --------
    >>> from jaxcal._compile import filter_jit
    >>> print(filter_jit(lambda x, name: 2 * x)(3.0, "twice"))
    6.0
    """

    def run(arrays: list[Any], fixed: _Fixed) -> tuple[list[Any], _Fixed]:
        args, kwargs = _joined(arrays, fixed)
        return _split(function(*args, **kwargs))

    run.__name__ = run.__qualname__ = function.__name__  # profiles and messages of the compiler show this name
    plain, quick = jax.jit(run), jax.jit(run, compiler_options=QUICK | (further or {}))

    def lower(arrays: list[Any], fixed: _Fixed) -> Any:
        return (quick if is_quick() else plain).lower(arrays, fixed)

    @functools.wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        if direct is not None and not _stores:
            return direct(*args, **kwargs)
        arrays, fixed = _split((args, kwargs))
        if is_traced(arrays):
            # where x64 is off, float64 of NumPy would stay float64 in the inner program; arrays and keys of JAX are right
            arrays = [x if isinstance(x, jax.Array) else x.astype(jax.dtypes.canonicalize_dtype(x.dtype)) for x in arrays]
            return _joined(*plain(arrays, fixed))
        kept = _stores and jax.default_backend() == "cpu"
        found = _stores[0].run(call, lower, arrays, fixed, functools.partial(_joined, fixed=fixed)) if kept else None
        return _joined(*(quickly(quick, plain, arrays, fixed) if found is None else found))

    return call


#: the store used by the commands
_stores: list[Store] = []


def keep_programs(folder: Path) -> None:
    """Store the programs of `filter_jit` in a folder for later processes, and use those stored there."""
    _stores[:] = [Store(folder)]
