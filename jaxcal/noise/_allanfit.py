r"""Fit of the noise terms to an Allan variance curve: pure functions of the curve, for `jit`, `vmap` and `grad`.

The exact Allan variances of the terms are the columns of A, so that E v = A theta with theta the squared coefficients, and
the covariance of v is C(theta) = sum_ij theta_i theta_j T_ij (`covariance_tensor`). Everything here is linear algebra on these.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._solve import nonnegative
from .._types import Array, Bool, Float
from ._covariance import covariance

_ITERATIONS = 48
_SEARCH = 44


class Curve(eqx.Module):
    """An Allan variance curve with what its fit needs.

    v : measured variances. columns : A. tensor : T. share : full count over count of differences, 1 without gaps.
    used : which cluster sizes take part.
    """

    v: Float[Array, " clusters"]
    columns: Float[Array, "clusters p"]
    tensor: Float[Array, "p p clusters clusters"]
    share: Float[Array, " clusters"]
    used: Bool[Array, " clusters"]

    def covariance(self, theta: Float[Array, " p"]) -> Float[Array, "clusters clusters"]:
        """C(theta); gaps leave fewer differences, unused cluster sizes become independent of the rest."""
        loss = jnp.sqrt(self.share)
        c = covariance(self.tensor, theta) * loss[:, None] * loss[None, :]
        return jnp.where(self.used[:, None] & self.used[None, :], c, jnp.diag(jnp.where(self.used, 0.0, 1.0)))

    def without(self, index, value) -> "Curve":
        """The curve left when coefficient `index` is held at `value`: its part is taken out, its column is zero."""
        gone = jnp.arange(self.columns.shape[1]) == index
        v = self.v - self.columns[:, index] * value
        return eqx.tree_at(lambda c: (c.v, c.columns), self, (v, jnp.where(gone[None, :], 0.0, self.columns)))


class Estimate(eqx.Module):
    """Squared coefficients, their covariance (sandwich), the chi-square of the curve, and the last step (relative)."""

    theta: Float[Array, " p"]
    covariance: Float[Array, "p p"]
    chi2: Float[Array, ""]
    step: Float[Array, ""]


def weighted(curve: Curve, start=None, *, held=None, iterations: int = _ITERATIONS):
    """Non-negative least squares with weights 2 (A theta)^2 / edf = diag C(theta), iterated; returns theta and last step.

    `held` is (index, value) of a coefficient that is not free.
    """
    free = curve if held is None else curve.without(*held)
    unit = 0.0 if held is None else jnp.where(jnp.arange(curve.columns.shape[1]) == held[0], held[1], 0.0)

    def solve(inverse):
        inverse = jnp.where(curve.used, inverse, 0.0)
        rows = free.columns * inverse[:, None]
        return nonnegative(free.columns.T @ rows, rows.T @ free.v).value + unit

    def step(theta, k):
        variance = jnp.diagonal(curve.covariance(theta))
        new = solve(1.0 / jnp.where(variance > 0.0, variance, curve.v**2))
        new = jnp.where(k < 6, new, 0.5 * (new + theta))
        reached = curve.columns @ new
        return new, jnp.max(jnp.where(curve.used, jnp.abs(curve.columns @ theta - reached) / jnp.where(reached > 0, reached, 1.0), 0.0))

    first = solve(1.0 / jnp.where(curve.used, curve.v, 1.0) ** 2) if start is None else start
    theta, steps = jax.lax.scan(step, first, jnp.arange(iterations))
    return theta, steps[-1]


def whitened(curve: Curve, at: Float[Array, " p"], extra=0.0):
    """A and v of unit covariance, with C taken at theta = `at` (plus independent variances `extra`), zero where unused."""
    c = curve.covariance(at) + jnp.diag(jnp.where(curve.used, extra, 0.0))
    scale = jnp.sqrt(jnp.diagonal(c))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    correlation = c / scale[:, None] / scale[None, :] + 1e-8 * jnp.eye(len(scale), dtype=c.dtype)
    factor = jnp.linalg.cholesky(correlation)
    rows = jnp.concatenate([curve.columns, curve.v[:, None]], axis=1) / scale[:, None]
    rows = jax.scipy.linalg.solve_triangular(factor, jnp.where(curve.used[:, None], rows, 0.0), lower=True)
    return rows[:, :-1], rows[:, -1]


def chi_square(curve: Curve, at, *, held=None, extra=0.0):
    """Least (v - A theta)' C^-1 (v - A theta) over theta >= 0, with C at theta = `at`."""
    a, b = whitened(curve, at, extra)
    if held is not None:
        b = b - a[:, held[0]] * held[1]
        a = jnp.where((jnp.arange(a.shape[1]) == held[0])[None, :], 0.0, a)
    return nonnegative(a.T @ a, a.T @ b).cost + b @ b


def estimate(curve: Curve, *, extra=0.0) -> Estimate:
    """The fit, with the covariance G (A'D C D A) G, D = 1/diag C, G = (A' D A)^-1, and its chi-square."""
    theta, step = weighted(curve)
    c = curve.covariance(theta)
    inverse = jnp.where(curve.used, 1.0 / jnp.diagonal(c), 0.0)
    rows = curve.columns * inverse[:, None]
    gram = curve.columns.T @ rows
    scale = jnp.sqrt(jnp.diagonal(gram))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    # scaled to unit diagonal: columns differ by many powers of ten
    g = jnp.linalg.inv(gram / scale[:, None] / scale[None, :]) / scale[:, None] / scale[None, :]
    spread = g @ (rows.T @ c @ rows) @ g
    return Estimate(theta, spread, chi_square(curve, theta, extra=extra), step)


def drop(curve: Curve, index, value):
    """Rise of the chi-square when coefficient `index` (squared) is held at `value`, C taken at the fit so restricted."""
    held = (index, value)
    at, _ = weighted(curve, held=held, iterations=8)
    return jnp.maximum(chi_square(curve, at, held=held) - chi_square(curve, at), 0.0)


class Limits(eqx.Module):
    """Per term: interval ends, one-sided upper limit (squared coefficients), and `drop` at zero."""

    low: Float[Array, " p"]
    high: Float[Array, " p"]
    upper: Float[Array, " p"]
    significance: Float[Array, " p"]


def limits(curve: Curve, theta, spread, two_sided, one_sided) -> Limits:
    """Where `drop` reaches the levels `two_sided` and `one_sided`: inversion of the test of each value of each coefficient.

    A lower end is 0 where zero cannot be excluded. Upper ends are sought outwards from theta in doubling steps of `spread`,
    then by bisection, all of them together.
    """
    p = len(theta)
    index = jnp.tile(jnp.arange(p), 3)
    inside, reach = theta[index], jnp.maximum(spread, 1e-9 * jnp.max(theta))[index]
    level = jnp.concatenate([jnp.full(2 * p, two_sided), jnp.full(p, one_sided)])
    below = jnp.arange(3 * p) < p

    def search(state, k):
        inside, outside, found = state
        outward = inside + reach * 2.0 ** (k - 1)
        value = jnp.where(found, 0.5 * (inside + outside), outward)
        value = jnp.where(below & (k == 0), 0.0, value)
        rise = jax.vmap(lambda i, t: drop(curve, i, t))(index, value)
        within = rise <= level
        # a lower search that finds zero inside stays there: both ends become zero
        inside = jnp.where(within, value, inside)
        outside = jnp.where(within, outside, value)
        return (inside, outside, found | ~within), rise[:p]

    start = (inside, jnp.zeros_like(inside), below)
    (inside, outside, found), rises = jax.lax.scan(search, start, jnp.arange(_SEARCH))
    ends = jnp.where(found, 0.5 * (inside + outside), jnp.inf)
    return Limits(ends[:p], ends[p : 2 * p], ends[2 * p :], rises[0])


class Banded(eqx.Module):
    """The fit in the band where the model holds.

    used : cluster sizes in the band. holds : whether the model holds there. goodness : p value of the chi-square.
    inflation : factor on the covariance and on every level, above 1 where the curve scatters more than the noise model says.
    """

    estimate: Estimate
    limits: Limits
    used: Bool[Array, " clusters"]
    holds: Bool[Array, ""]
    goodness: Float[Array, ""]
    inflation: Float[Array, ""]
    modelled: Float[Array, " clusters"]
    edf: Float[Array, " clusters"]


#: misfit of the deviation that does not count against a model, and the chance of a worse chi-square at which a band is refused
_TOLERANCE = 0.0025
_REFUSED = 0.001
#: chance below which the intervals are widened to the scatter seen
_WIDENED = 0.01


def fit_band(curve: Curve, automatic, two_sided, one_sided) -> Banded:
    """Fit the curve from the shortest cluster time on from which the model holds; all of it unless `automatic`.

    Filters and output averaging in a sensor spoil short cluster times, so these are left out one by one until the chi-square
    of the rest, with a misfit of 0.25 % of the deviation allowed, is no worse than one in a thousand.
    """
    p = curve.columns.shape[1]
    size = jnp.sum(curve.used)
    order = jnp.cumsum(curve.used) - 1  # rank of each used cluster size

    def fitted(first):
        part = eqx.tree_at(lambda c: c.used, curve, curve.used & (order >= first))
        found = estimate(part, extra=(2.0 * _TOLERANCE * part.v) ** 2)
        freedom = jnp.sum(part.used) - jnp.sum(found.theta > 0.0)
        allowed = jax.scipy.stats.chi2.sf(found.chi2, freedom)
        strict = chi_square(part, found.theta)
        return part, found, strict, freedom, allowed

    candidates = jnp.arange(max(len(curve.v) - p - 4, 1))
    chances = jax.lax.map(lambda first: fitted(first)[-1], candidates)
    possible = (candidates <= jnp.maximum(size - p - 4, 0)) & ((candidates == 0) | automatic)
    chances = jnp.where(possible & jnp.isfinite(chances), chances, -1.0)
    enough = chances >= _REFUSED
    holds = jnp.any(enough)
    part, found, strict, freedom, _ = fitted(jnp.where(holds, jnp.argmax(enough), jnp.argmax(chances)))

    goodness = jax.scipy.stats.chi2.sf(strict, freedom)
    inflation = jnp.where(goodness < _WIDENED, jnp.maximum(strict / freedom, 1.0), 1.0)
    spread = found.covariance * inflation
    ends = limits(part, found.theta, jnp.sqrt(jnp.diagonal(spread)), two_sided * inflation, one_sided * inflation)
    found = eqx.tree_at(lambda e: e.covariance, found, spread)
    ends = eqx.tree_at(lambda e: e.significance, ends, ends.significance / inflation)
    modelled = curve.columns @ found.theta
    variance = jnp.diagonal(part.covariance(found.theta))
    edf = 2.0 * modelled**2 / jnp.where(part.used, variance, 1.0)
    return Banded(found, jax.lax.stop_gradient(ends), part.used, holds, goodness, inflation, modelled, edf)
