r"""The one compiled program of the noise fits: small problems with non-negative parameters, solved one after another.

Every fit of noise coefficients is a problem for `jaxcal.fitting`: a target t_k, a model S = X theta + base, and residuals

.. math:: r_k = \sqrt{w_k}\,\mathrm{sign}(\rho_k - 1)\sqrt{\rho_k - 1 - \ln\rho_k},\qquad \rho = t/S

for the Whittle likelihood (the deviance residuals of a gamma law: half their sum of squares is the negative log-likelihood less
that of S = t), or r = sqrt(w) (S - t) for a whitened Allan variance. Attempts, bands, correlation times and profiles are lanes of
one batch. On the host batches are filled up to one shape, so that one compilation serves every fit; the loops around them are
NumPy. In a trace the same functions run in `jax.numpy`.
"""

from collections.abc import Callable
from types import ModuleType
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._compile import jit
from .._types import AnyArray, Array
from ..fitting import solve

#: problems, rows and coefficients of the compiled program; larger problems take multiples of the last two, curves these few rows
_LANES, _ROWS, _WIDTH, _FEW = 16, 384, 8, 32


def namespace(*trees: Any) -> ModuleType:
    """`jax.numpy` where a leaf is traced, otherwise `numpy`: cheaper than `array_module`, which also asks for a trace in progress."""
    leaves = jax.tree.leaves(trees)
    return jnp if any(isinstance(leaf, Tracer) for leaf in leaves) else np


class Minima(NamedTuple):
    """Per lane: coefficients (lanes, p), half the sum of squares at the minimum, and whether the solver ended at one."""

    theta: AnyArray
    cost: AnyArray
    settled: AnyArray


def _deviance(ratio: Array) -> Array:
    """sign(z) sqrt(z - ln(1 + z)), z = ratio - 1."""
    z = ratio - 1.0
    small = jnp.abs(z) < 1e-2
    # double where: the root has no derivative at zero, where the series takes over
    far = jnp.where(small, 1.0, z)
    near = jnp.where(small, z, 0.0)
    series = 1.0 - near * (2 / 3 - near * (1 / 2 - near * (2 / 5 - near * (1 / 3 - near * (2 / 7 - near / 4)))))
    return jnp.where(small, near * jnp.sqrt(series / 2.0), jnp.sign(far) * jnp.sqrt(far - jnp.log1p(far)))


def _model(theta: Array, data: dict[str, Array]) -> Array:
    return data["columns"] @ theta + data["base"]


def _differences(theta: Array, data: dict[str, Array]) -> Array:
    return data["root"] * (_model(theta, data) - data["target"])


def _deviances(theta: Array, data: dict[str, Array]) -> Array:
    model = _model(theta, data)
    tiny = jnp.finfo(model.dtype).tiny ** 0.5
    return data["root"] * _deviance(jnp.maximum(data["target"], tiny) / jnp.maximum(model, tiny))


def _either(theta: Array, data: dict[str, Array]) -> Array:
    return jax.lax.cond(data["linear"], _differences, _deviances, theta, data)


def _one(residuals: Callable[[Array, Any], Array], data: dict[str, Array], start: Array, lower: Array) -> tuple[Any, Any, Any]:
    fit = solve(residuals, start, data, bounds=(lower, np.inf))
    return fit.parameters, fit.cost, fit.usable


@jit
def _first(lanes: dict[str, Array], start: Array, lower: Array, linear: Array, count: Array) -> tuple[Array, Array, Array]:
    """The first `count` of the lanes; the others cost nothing."""

    def body(k, found):
        one = _one(_either, jax.tree.map(lambda leaf: leaf[k], lanes) | {"linear": linear}, start[k], lower[k])
        return jax.tree.map(lambda all_, new: all_.at[k].set(new), found, one)

    none = jnp.zeros(len(start), dtype=start.dtype)
    return jax.lax.fori_loop(0, count, body, (jnp.zeros_like(start), none, none > 0))


def minimise(columns: Any, target: Any, weight: Any, start: Any, *, base: Any = 0.0, lower: Any = 0.0, linear: bool = False) -> Minima:
    """Least cost over theta >= lower of every lane; differentiable with respect to columns, target, weight and base.

    Parameters
    ----------
    columns : (rows, p) or (lanes, rows, p) model per coefficient.
    target, weight, base : (rows,) or (lanes, rows); a row of weight zero takes no part.
    start : (lanes, p) where the search begins; for the likelihood the model must be positive there.
    lower : one bound, (p,) or (lanes, p).
    linear : least squares of the differences instead of the deviance.
    """
    xp = namespace(columns, target, weight, start, base)
    lanes, p = start.shape
    rows = target.shape[-1]
    root = xp.sqrt(weight * xp.ones_like(target))
    used = root > 0
    given = {"columns": xp.where(used[..., None], columns, 0.0), "base": xp.where(used, base, 1.0), "target": xp.where(used, target, 1.0)}
    given["root"], lower = root, xp.broadcast_to(xp.asarray(lower, dtype=root.dtype), (lanes, p))
    if xp is jnp:
        full = {name: xp.broadcast_to(value, (lanes, *value.shape[-1 - (name == "columns") :])) for name, value in given.items()}
        # a branch on data would become a choice between both under vmap, with the derivatives of both
        return Minima(*jax.lax.map(lambda one: _one(_differences if linear else _deviances, *one), (full, start, lower)))
    # for one curve alone, as a second opinion has, a second program would cost more than it saves
    tall = _FEW if rows <= _FEW and lanes > 1 else -(-rows // _ROWS) * _ROWS
    wide = -(-p // _WIDTH) * _WIDTH
    theta, cost, settled = np.empty((lanes, p)), np.empty(lanes), np.empty(lanes, dtype=bool)
    for k in range(0, lanes, _LANES):
        count = min(lanes - k, _LANES)
        full = {"columns": np.zeros((_LANES, tall, wide)), "base": np.ones((_LANES, tall)), "target": np.ones((_LANES, tall))}
        full["root"], begun, bounds = np.zeros((_LANES, tall)), np.zeros((_LANES, wide)), np.zeros((_LANES, wide))
        for name, value in given.items():
            own = value[k : k + count] if value.ndim == full[name].ndim else value
            full[name][(slice(count), slice(rows), slice(p))[: full[name].ndim]] = own
        begun[:count, :p], bounds[:count, :p] = start[k : k + count], lower[k : k + count]
        found = [np.asarray(one)[:count] for one in _first(full, begun, bounds, np.asarray(linear), np.asarray(count))]
        theta[k : k + count], cost[k : k + count], settled[k : k + count] = found[0][:, :p], *found[1:]
    return Minima(theta, cost, settled)


def iterate(going: Callable[[Any], Any], body: Callable[[Any], Any], state: Any) -> Any:
    """A while loop: of the compiled program in a trace, of Python on the host."""
    if namespace(state) is jnp:
        return jax.lax.while_loop(going, body, state)
    while going(state):
        state = body(state)
    return state


def some(lanes: Any, function: Callable[..., Any], otherwise: Any, *arguments: Any) -> Any:
    """`function` of the arguments in the lanes named, `otherwise` in the others: on the host for the named ones alone.

    Parameters
    ----------
    lanes : (lanes,) True where wanted.
    function : of arrays with lanes first, to a tree of such arrays.
    otherwise : tree like its result.
    """

    def chosen(new, old):
        return jnp.where(lanes.reshape(-1, *(1,) * (jnp.ndim(new) - 1)), new, old)

    if namespace(lanes, otherwise, arguments) is jnp:
        return jax.tree.map(chosen, function(*arguments), otherwise)
    index = np.flatnonzero(lanes)
    if not index.size:
        return otherwise

    def scattered(new, old):
        out = np.array(old)
        out[index] = new
        return out

    return jax.tree.map(scattered, function(*(np.asarray(one)[index] for one in arguments)), otherwise)


def inverse(matrix: Any) -> Any:
    """Inverse of a positive semidefinite (p, p) matrix whose rows differ by many powers of ten; rows of zeros stay zero."""
    xp = namespace(matrix)
    diagonal = xp.diagonal(matrix)
    there = diagonal > 0.0
    scale = xp.sqrt(xp.where(there, diagonal, 1.0))
    unit = matrix / scale[:, None] / scale[None, :] + xp.diag(xp.where(there, 0.0, 1.0))
    return xp.where(there[:, None] & there[None, :], xp.linalg.inv(unit) / scale[:, None] / scale[None, :], 0.0)
