r"""Whittle likelihood of binned ordinates, on the host and in a trace.

Ordinates are nearly independent. Each, divided by the model's density S = X theta with theta the squared coefficients, follows a
chi-square law of one degree of freedom, so that the negative log-likelihood is

.. math:: \mathrm{NLL}(\theta) = \frac12\sum_b \nu_b\,[\ln S_b + P_b/S_b]

with P_b the mean of nu_b ordinates (P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram). It is
minimised as half the sum of squares of the deviance residuals of a gamma law,

.. math:: r_b = \sqrt{\nu_b}\,\mathrm{sign}(\rho_b - 1)\sqrt{\rho_b - 1 - \ln\rho_b},\qquad \rho = P/S

which equals the negative log-likelihood minus its value at S = P. The Fisher information is the expected one.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._types import AnyArray, Array
from ..fitting import solve
from ._ordinates import Bins

_FAINT = 0.01  # in several starts one column begins with this fraction of an equal share
FINE = 1.5e-8  # remaining step, in standard errors, at which a search in a trace ends
#: scoring: most steps, shortest part of a step, gain in log likelihood at which it ends, share of an ordinate below which the density
#: counts as this share; least squares: roundings added to the diagonal, which keep equations of nearly equal columns solvable, and the
#: slope of a coefficient at zero, over the largest, that is rounding
_STEPS, _SHORTEST, _GAINED, _DARK, _FLAT, _RIDGE = 50, 1e-3, 1e-4, 1e-9, 64.0, 1e-10


class Minima(NamedTuple):
    """Per lane: coefficients (lanes, p), half the sum of squares at the minimum, and whether the solver converged to a minimum."""

    theta: AnyArray
    cost: Any
    settled: Any


def _root(ratio: Array) -> Array:
    """sign(z) sqrt(z - ln(1 + z)) with z = ratio - 1."""
    z = ratio - 1.0
    small = jnp.abs(z) < 1e-2
    # two `where`: near zero, where the root has no derivative, the series replaces it, and the gradient must not see the root
    far = jnp.where(small, 1.0, z)
    near = jnp.where(small, z, 0.0)
    series = 1.0 - near * (2 / 3 - near * (1 / 2 - near * (2 / 5 - near * (1 / 3 - near * (2 / 7 - near / 4)))))
    return jnp.where(small, near * jnp.sqrt(series / 2.0), jnp.sign(far) * jnp.sqrt(far - jnp.log(1.0 + far)))


@jax.custom_jvp
def _deviance(ratio: Array) -> Array:
    """`_root`, whose slope is computed once, and not once for each coefficient."""
    return _root(ratio)


@_deviance.defjvp
def _(primals: tuple[Array], tangents: tuple[Array]) -> tuple[Array, Array]:
    value, slope = jax.jvp(_root, primals, (jnp.ones_like(primals[0]),))
    return value, slope * tangents[0]


def _deviances(theta: Array, data: tuple[Array, Array]) -> Array:
    columns, (root, target, base) = data
    model = columns @ theta + base
    tiny = jnp.finfo(model.dtype).tiny ** 0.5
    return root * _deviance(jnp.maximum(target, tiny) / jnp.maximum(model, tiny))


def _minimum(shared: Any, lane: tuple[Array, Array, Array, Array]) -> Minima:
    columns, others, start, lower = lane
    fit = solve(_deviances, start, (columns, others), bounds=(lower, np.inf), rtol=shared)
    return Minima(fit.parameters, fit.cost, fit.flat)


def minimise(columns: Any, target: Any, weight: Any, start: Any, *, rtol: float = FINE) -> Minima:
    """Minimise from every row of `start`, (lanes, p), over non-negative coefficients, in a trace; differentiable except for `start`.

    `columns`, (rows, p), are the model per unit of each coefficient. A column with negative values belongs to a nuisance parameter, whose
    coefficient may have either sign. Rows of zero weight are ignored. A search ends when the remaining step is below `rtol` standard
    errors.
    """
    root = jnp.sqrt(weight * jnp.ones_like(target))
    used = root > 0
    lower = jnp.where(jnp.any(columns < 0, axis=0), -np.inf, 0.0).astype(root.dtype)
    columns = jnp.where(used[:, None], columns, 0.0)
    others = jnp.stack([root, jnp.where(used, target, 1.0), jnp.where(used, 0.0, 1.0)])
    # one at a time: under vmap a branch on data would evaluate both sides and their derivatives
    return jax.lax.map(lambda one: _minimum(rtol, (columns, others, one, lower)), start)


def density(columns: Any, theta: Any) -> Any:
    """Density S of the model, kept above zero."""
    s = columns @ theta
    return namespace(s).maximum(s, np.finfo(s.dtype).tiny ** 0.5)


def information(bins: Bins, theta: Any) -> Any:
    """Expected Fisher information of the squared coefficients, F = 1/2 sum nu X X' / S^2."""
    rows = bins.columns * (namespace(bins, theta).sqrt(0.5 * bins.weight) / density(bins.columns, theta))[:, None]
    return rows.T @ rows


def inverse(matrix: Any) -> Any:
    """Inverse of a positive semidefinite (p, p) matrix whose rows may differ by many powers of ten; rows of zeros stay zero."""
    xp = namespace(matrix)
    diagonal = xp.diagonal(matrix)
    there = diagonal > 0.0
    scale = xp.sqrt(xp.where(there, diagonal, 1.0))
    unit = matrix / scale[:, None] / scale[None, :] + xp.diag(xp.where(there, 0.0, 1.0))
    return xp.where(there[:, None] & there[None, :], xp.linalg.inv(unit) / scale[:, None] / scale[None, :], 0.0)


def flat_start(bins: Bins) -> Any:
    """Initial guess: every column explains an equal share of the ordinates; zero for columns without a positive value."""
    xp = namespace(bins)
    positive = (bins.weight > 0)[:, None] & (bins.columns > 0)
    count = xp.sum(positive, axis=0).astype(bins.density.dtype)
    ordinate = xp.maximum(bins.density, np.finfo(bins.density.dtype).tiny ** 0.5)
    logs = xp.where(positive, xp.log(ordinate[:, None] / xp.where(positive, bins.columns, 1.0)), 0.0)
    there = count > 0
    level = xp.exp(xp.sum(logs, axis=0) / xp.where(there, count, 1.0))
    return xp.where(there, level / xp.maximum(xp.sum(there).astype(count.dtype), 1.0), 0.0)


def several_starts(bins: Bins) -> Any:
    """(1 + p, p) initial guesses, needed because the likelihood has local minima: equal shares, then each column in turn made faint.

    On the host, columns whose initial guess is zero are not made faint, so that there are fewer guesses.
    """
    p, flat = bins.columns.shape[1], flat_start(bins)
    several = np.concatenate([np.ones((1, p)), 1.0 - (1.0 - _FAINT) * np.eye(p)]).astype(bins.density.dtype)
    return flat[None, :] * (several if namespace(bins) is jnp else several[np.append(True, flat > 0.0)])


def scoring(columns: Any, target: Any, weight: Any, start: Any, base: Any = None, *, enough: float = _GAINED) -> tuple[Any, float]:
    """Non-negative coefficients of highest likelihood, on the host, and the cost as in `Minima`; it ends when a step gains `enough`.

    Each step is a non-negative least squares fit with the weights nu/S^2, whose fixed points are those of the likelihood (Fisher scoring).
    A column with negative values belongs to a coefficient of either sign. `base` is a density that is always there.
    """
    used = weight > 0
    base = np.zeros(np.sum(used)) if base is None else base[used]
    x, p, weight = columns[used], np.maximum(target[used], np.finfo(float).tiny ** 0.25), weight[used]
    scale = np.maximum(np.abs(x).max(axis=0), np.finfo(float).tiny)
    x, free, theta = x / scale, np.any(x < 0, axis=0), start * scale

    def cost_of(theta: Any) -> tuple[Any, float]:
        s = np.maximum(x @ theta + base, _DARK * p)
        ratio = p / s
        return s, 0.5 * float(np.sum(weight * (ratio - 1.0 - np.log(ratio))))

    s, cost = cost_of(theta)
    active = (theta > 0) | free
    for _ in range(_STEPS):
        root = np.sqrt(weight) / s
        rows = x * root[:, None]
        wanted, active = nonnegative(rows.T @ rows, rows.T @ ((p - base) * root), free, active)
        step = 1.0
        trial, (s, new) = wanted, cost_of(wanted)
        while new > cost and step > _SHORTEST:
            step *= 0.5
            trial = theta + step * (wanted - theta)
            s, new = cost_of(trial)
        if new > cost:
            break
        gained, theta, cost = cost - new, trial, new
        if gained < enough:
            break
    return theta / scale, cost


def nonnegative(gram: Any, target: Any, free: Any, active: Any) -> tuple[Any, Any]:
    """Least squares from normal equations with coefficients at or above zero, unless `free`; and which are above zero.

    The active-set method of C. L. Lawson and R. J. Hanson, Solving Least Squares Problems, 1974, from a first active set.
    """
    theta, active = np.zeros(len(gram)), active.copy()
    gram, size = gram.copy(), gram.diagonal()
    gram.flat[:: len(gram) + 1] += _FLAT * np.finfo(float).eps * size + np.finfo(float).tiny
    root, enough = np.sqrt(gram.diagonal()), _RIDGE * float(np.abs(target).max())
    for _ in range(3 * len(gram)):
        where = np.flatnonzero(active)
        wanted = np.zeros(len(gram))
        wanted[where] = np.linalg.solve(gram[np.ix_(where, where)], target[where])
        below = active & ~free & (wanted <= 0.0)
        if below.any():
            # as far as the first coefficient that reaches zero; from zero the step has no length, and the worst one leaves
            reach = theta[below] / np.where(theta[below] > wanted[below], theta[below] - wanted[below], 1.0)
            step = float(reach.min())
            theta = theta + step * (wanted - theta)
            leaving = np.flatnonzero(below)[reach <= step]
            active[leaving], theta[leaving] = False, 0.0
            continue
        theta = wanted
        slope = np.where(active, -np.inf, (target - gram @ theta) / root)
        best = int(np.argmax(slope))
        if not slope[best] > enough:
            break
        active[best] = True
    return np.maximum(theta, np.where(free, -np.inf, 0.0)), active
