"""`Problem`: residuals, start, bounds and options of one fit, checked on the host; its parameters as one vector with names."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._errors import FitError
from .._precision import array_module, is_traced
from .._types import AnyArray, Array

_STATIC = {"static": True}


def is_float(leaf: Any) -> bool:
    """Whether a leaf is a parameter: a Python float or a floating-point array."""
    dtype = getattr(leaf, "dtype", None)
    return isinstance(leaf, float) or getattr(dtype, "kind", "") == "f" or (dtype is not None and jnp.issubdtype(dtype, jnp.floating))


def to_floats(tree: Any, dtype: Any) -> Any:
    """Cast floating leaves (Python floats as well) to one dtype, and leave all others alone; leaves not of JAX become NumPy arrays.

    A compiled program accepts NumPy arrays directly, in a tenth of the time that it takes to make JAX arrays from them.
    """

    def cast(leaf: Any) -> Any:
        if not is_float(leaf) or (not isinstance(leaf, float) and leaf.dtype == dtype):
            return leaf
        return namespace(leaf, concrete=True).asarray(leaf, dtype=dtype)

    return jax.tree.map(cast, tree)


def common_dtype(*trees: Any) -> Any:
    """Widest floating dtype among the arrays, or JAX's default if there are only Python numbers."""
    found = [leaf.dtype for leaf in jax.tree.leaves(trees) if hasattr(leaf, "dtype") and is_float(leaf)]
    return jax.dtypes.canonicalize_dtype(np.result_type(*found)) if found else jnp.zeros(()).dtype


def names_of(model: Any) -> list[str]:
    """One name per entry of every floating array leaf, e.g. `bias[2]` or `matrix[0,1]`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting._problem import names_of
    >>> names_of({"bias": np.zeros(2), "scale": 1.0})
    ['bias[0]', 'bias[1]']
    """
    names = []
    for path, leaf in jax.tree_util.tree_leaves_with_path(model):
        if not eqx.is_inexact_array(leaf):
            continue
        base = jax.tree_util.keystr(path, simple=True, separator=".") or "parameter"
        entries = np.ndindex(leaf.shape) if leaf.ndim else [()]
        names += [base + (f"[{','.join(map(str, entry))}]" if entry else "") for entry in entries]
    return names


def spread(spec: Any, model: Any, what: str) -> np.ndarray | Array:
    """One value per entry of the floating leaves of a model; `spec` is a number, or a tree like `model` or a prefix of it."""
    xp = namespace(spec)

    def fill(value: Any, part: Any) -> list:
        # a shortcut for equal shapes, because `broadcast_to` would take most of the time
        return [xp.ravel(value if np.shape(value) == leaf.shape else xp.broadcast_to(value, leaf.shape)) for leaf in jax.tree.leaves(part)]

    try:
        parts = jax.tree.leaves(jax.tree.map(fill, spec, eqx.filter(model, eqx.is_inexact_array)))
    except ValueError as error:
        raise FitError(f"{what} is not shaped like the start; give one value, or a tree like the start.", code="shape") from error
    return xp.concatenate(parts)


def vector_of(model: Any) -> tuple[Array, Callable[[Array], Any]]:
    """All floating leaves as one vector, and the function that rebuilds the model from a vector."""
    parameters, rest = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = jax.flatten_util.ravel_pytree(parameters)
    return vector, lambda x: eqx.combine(unravel(x), rest)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Problem:
    """Everything that defines one fit. Arrays are data, so that new values never recompile; all other fields are static.

    It is not an Equinox module, because making one would take a tenth of a small fit. Data may have any type while JAX maps over them.

    Attributes
    ----------
    start, data, loss, priors : as given to `solve`, in one dtype. lower, upper : (p,) bounds of the free parameters.
    starts : (k, p) or None. keep : (n,) False for residuals that a refit leaves out, or None.
    free : positions of the free parameters among all parameters of the model.
    """

    start: Any
    data: Any
    lower: Any
    upper: Any
    starts: Any
    loss: Any
    priors: Any
    keep: Any
    rtol: Any
    residuals: Callable = dataclasses.field(metadata=_STATIC)
    free: tuple[int, ...] = dataclasses.field(metadata=_STATIC)
    names: tuple[str, ...] = dataclasses.field(metadata=_STATIC)
    max_steps: int = dataclasses.field(metadata=_STATIC)

    def values(self) -> Array:
        """Free parameters of the start."""
        return vector_of(self.start)[0][jnp.asarray(self.free)]

    def model(self, x: Array) -> Any:
        """Model with the free parameters `x`; all others keep the values of the start."""
        vector, put = vector_of(self.start)
        # use a gather, which compiles faster than a scatter and its derivatives
        place = x.size + np.arange(vector.size)
        place[list(self.free)] = np.arange(x.size)
        return put(x if len(self.free) == vector.size else jnp.concatenate([x, vector])[place])

    def residual(self, x: Array) -> tuple[Array, Array]:
        """Residuals of the data and of the priors, one vector each. Their shape is checked here, at no cost once compiled."""
        model = self.model(x)
        r = self.residuals(model, self.data)
        if not (isinstance(r, (jnp.ndarray, np.ndarray)) and jnp.issubdtype(r.dtype, jnp.floating)):
            raise FitError(f"The residual function returned {type(r).__name__}; it must return one array of floats.", code="residuals")
        prior = jnp.concatenate([jnp.ravel(one.residuals(model)) for one in self.priors] + [jnp.zeros(0, dtype=r.dtype)])
        if r.size + prior.size < x.size:
            said = f"{r.size + prior.size} residuals cannot determine {x.size} parameters ({', '.join(self.names)})"
            raise FitError(f"{said}; add data, or hold parameters fixed with `free`.", code="few_residuals")
        return jnp.ravel(r) if self.keep is None else jnp.where(self.keep, jnp.ravel(r), 0), prior


def define(residuals, start, data, *, free=None, bounds=None, loss=None, priors=(), starts=None, max_steps=128, rtol=None) -> Problem:
    """Convert the arguments of `solve` to one form and dtype."""
    dtype = common_dtype(start, data)
    priors = (priors,) if hasattr(priors, "residuals") else tuple(priors)
    start, data, loss, priors = (to_floats(tree, dtype) for tree in (start, data, loss, priors))
    names = names_of(start)
    index = np.arange(len(names)) if free is None else np.flatnonzero(spread(free, start, "`free`"))
    if not index.size:
        raise FitError("There is nothing to fit: the start has no float, or `free` holds every one fixed.", code="nothing_free")

    def chosen(spec: Any, what: str) -> AnyArray:
        return spread(spec, start, what)[index].astype(dtype)

    low, high = (-np.inf, np.inf) if bounds is None else bounds
    return Problem(
        start=start, data=data, lower=chosen(low, "The lower bound"), upper=chosen(high, "The upper bound"),
        starts=None if starts is None else _rows(to_floats(starts, dtype))[:, index], loss=loss, priors=priors, keep=None,
        rtol=float(jnp.finfo(dtype).eps) ** 0.5 if rtol is None else rtol, residuals=residuals, free=tuple(index.tolist()),
        names=tuple(names[i] for i in index), max_steps=max_steps,
    )  # fmt: skip


def _rows(starts: Any) -> AnyArray:
    """The starts as rows, one vector per start."""
    leaves = [leaf.reshape(len(leaf), -1) for leaf in jax.tree.leaves(starts) if eqx.is_inexact_array(leaf)]
    return array_module(leaves).concatenate(leaves, axis=1)


def check(problem: Problem) -> None:
    """Refuse a start that cannot work, and name the parameter (host only)."""
    if is_traced(problem):
        return
    one = [np.ravel(leaf) for leaf in jax.tree.leaves(problem.start) if eqx.is_inexact_array(leaf)]
    values = np.concatenate(one)[None, list(problem.free)] if problem.starts is None else np.asarray(problem.starts)
    lower, upper = problem.lower, problem.upper
    good = np.isfinite(values) & (lower <= values) & (values <= upper)
    for i in np.flatnonzero(~good.all(axis=0)):
        name, value, bounds = problem.names[i], values[:, i].tolist(), f"[{lower[i]:g}, {upper[i]:g}]"
        if not np.isfinite(value).all():
            raise FitError(f"The start has {name} = {value}; give a finite number.", code="start")
        if not lower[i] <= upper[i]:
            raise FitError(f"The bounds of {name} are {bounds}; the lower one must not exceed the upper.", code="bounds")
        raise FitError(f"The bounds {bounds} exclude the start {name} = {value}; move it or widen the bounds.", code="outside")
