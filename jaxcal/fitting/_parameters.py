"""Parameters of a model as one named vector, and back."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import FitError
from .._types import Array


def is_float(leaf: Any) -> bool:
    """Whether a leaf is a parameter: a Python float or a floating-point array."""
    return isinstance(leaf, float) or (hasattr(leaf, "dtype") and jnp.issubdtype(leaf.dtype, jnp.floating))


def to_floats(tree: Any, dtype: Any) -> Any:
    """Cast floating leaves (Python floats as well) to one dtype, and leave the rest alone; what is not of JAX becomes an array of NumPy.

    A compiled program takes arrays of NumPy as they are, in a tenth of the time that it takes to make arrays of JAX from them.
    """

    def cast(leaf: Any) -> Any:
        if not is_float(leaf) or (not isinstance(leaf, float) and leaf.dtype == dtype):
            return leaf
        return (jnp if isinstance(leaf, jax.Array) else np).asarray(leaf, dtype=dtype)

    return jax.tree.map(cast, tree)


def common_dtype(*trees: Any) -> Any:
    """Widest floating dtype among the arrays, or JAX's default where there are only Python numbers."""
    found = [leaf.dtype for leaf in jax.tree.leaves(trees) if hasattr(leaf, "dtype") and is_float(leaf)]
    return jax.dtypes.canonicalize_dtype(np.result_type(*found)) if found else jnp.zeros(()).dtype


def names_of(model: Any) -> list[str]:
    """One name per entry of every floating leaf, e.g. `bias[2]` or `matrix[0,1]`."""
    names = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(model):
        if not eqx.is_inexact_array(leaf):
            continue
        base = jax.tree_util.keystr(path, simple=True, separator=".") or "parameter"
        entries = np.ndindex(leaf.shape) if leaf.ndim else [()]
        names += [base + (f"[{','.join(map(str, entry))}]" if entry else "") for entry in entries]
    return names


def spread(spec: Any, model: Any, what: str) -> np.ndarray | Array:
    """One value per entry of the floating leaves of a model, from a number, or from a tree like `model` or a prefix of it."""
    xp = jnp if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(spec)) else np

    def fill(value: Any, part: Any) -> list:
        # for a number from a number `broadcast_to` would take most of the time
        return [xp.ravel(value if np.shape(value) == leaf.shape else xp.broadcast_to(value, leaf.shape)) for leaf in jax.tree.leaves(part)]

    try:
        parts = jax.tree.leaves(jax.tree.map(fill, spec, eqx.filter(model, eqx.is_inexact_array)))
    except ValueError as error:
        raise FitError(f"{what} is not shaped like the start; give one value, or a tree of values like the start.") from error
    return xp.concatenate(parts)


def vector_of(model: Any) -> tuple[Array, Callable[[Array], Any]]:
    """All floating leaves as one vector, and the function that puts a vector back."""
    parameters, rest = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = jax.flatten_util.ravel_pytree(parameters)
    return vector, lambda x: eqx.combine(unravel(x), rest)
