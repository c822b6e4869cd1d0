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
    octave : base-2 logarithm of the cluster size. used : which cluster sizes take part.
    """

    v: Float[Array, " clusters"]
    columns: Float[Array, "clusters p"]
    tensor: Float[Array, "p p clusters clusters"]
    share: Float[Array, " clusters"]
    octave: Float[Array, " clusters"]
    used: Bool[Array, " clusters"]

    def covariance(self, theta: Float[Array, " p"]) -> Float[Array, "clusters clusters"]:
        """C(theta); gaps leave fewer differences, unused cluster sizes become independent of the rest."""
        loss = jnp.sqrt(self.share)
        c = covariance(self.tensor, theta) * loss[:, None] * loss[None, :]
        return jnp.where(self.used[:, None] & self.used[None, :], c, jnp.diag(jnp.where(self.used, 0.0, 1.0)))

    def without(self, index, value) -> "Curve":
        """The curve left when coefficient `index` is held at `value`: its part is taken out, its column is zero."""
        gone = jnp.arange(self.columns.shape[1]) == index
        return eqx.tree_at(lambda c: c.v, self.only(~gone), self.v - self.columns[:, index] * value)

    def only(self, terms) -> "Curve":
        """The curve with the columns of the other terms zero, which keeps their coefficients at zero."""
        return eqx.tree_at(lambda c: c.columns, self, jnp.where(terms[None, :], self.columns, 0.0))


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


def estimate(curve: Curve, independent, *, extra=0.0) -> Estimate:
    """The fit, with the covariance G (A'D C D A) G, D = 1/diag C, G = (A' D A)^-1, of the `independent` columns, and its chi-square."""
    theta, step = weighted(curve)
    c = curve.covariance(theta)
    inverse = jnp.where(curve.used, 1.0 / jnp.diagonal(c), 0.0)
    columns = curve.only(independent).columns
    rows = columns * inverse[:, None]
    gram = columns.T @ rows
    scale = jnp.sqrt(jnp.diagonal(gram))
    scale = jnp.where(scale > 0.0, scale, 1.0)
    # scaled to unit diagonal: columns differ by many powers of ten, and one held at zero is set apart
    apart = jnp.diag(jnp.where(jnp.diagonal(gram) > 0.0, 0.0, 1.0))
    g = jnp.linalg.inv(gram / scale[:, None] / scale[None, :] + apart) / scale[:, None] / scale[None, :]
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


def limits(curve: Curve, admitted, theta, spread, two_sided, one_sided) -> Limits:
    """Where `drop` reaches the levels `two_sided` and `one_sided`: inversion of the test of each value of each coefficient.

    A lower end is 0 where zero cannot be excluded. Upper ends are sought outwards from theta in doubling steps of `spread`,
    then by bisection, all of them together. Row i of `admitted` tells which coefficients are free while the i-th is tested.
    """
    p = admitted.shape[0]
    index = jnp.tile(jnp.arange(p), 3)
    inside, reach = theta[index], jnp.maximum(spread, 1e-9 * jnp.max(theta))[index]
    level = jnp.concatenate([jnp.full(2 * p, two_sided), jnp.full(p, one_sided)])
    below = jnp.arange(3 * p) < p

    def search(state, k):
        inside, outside, found = state
        outward = inside + reach * jnp.exp2(k - 1.0)
        value = jnp.where(found, 0.5 * (inside + outside), outward)
        value = jnp.where(below & (k == 0), 0.0, value)
        rise = jax.vmap(lambda i, t: drop(curve.only(admitted[i]), i, t))(index, value)
        within = rise <= level
        # a lower search that finds zero inside stays there: both ends become zero
        inside = jnp.where(within, value, inside)
        outside = jnp.where(within, outside, value)
        return (inside, outside, found | ~within), rise[:p]

    start = (inside, jnp.zeros_like(inside), below)
    (inside, outside, found), rises = jax.lax.scan(search, start, jnp.arange(_SEARCH, dtype=theta.dtype))
    ends = jnp.where(found, 0.5 * (inside + outside), jnp.inf)
    return Limits(ends[:p], ends[p : 2 * p], ends[2 * p :], rises[0])


class Banded(eqx.Module):
    """The fit in the band where the model holds.

    theta : squared coefficients of the terms. covariance : theirs. limits : their limits. used : cluster sizes in the band.
    cut : whether short cluster times were left out. holds : whether the model holds. goodness : p value of the chi-square.
    inflation : factor on the covariance and on every level, above 1 where the curve scatters more than the noise model says.
    step : last step of the weights. modelled, edf : variance of the fitted terms, and its degrees of freedom.
    """

    theta: Float[Array, " p"]
    covariance: Float[Array, "p p"]
    limits: Limits
    used: Bool[Array, " clusters"]
    cut: Bool[Array, ""]
    holds: Bool[Array, ""]
    goodness: Float[Array, ""]
    inflation: Float[Array, ""]
    step: Float[Array, ""]
    modelled: Float[Array, " clusters"]
    edf: Float[Array, " clusters"]


#: misfit of the deviation that does not count against a model, and the chance of a worse chi-square at which a band is refused
_TOLERANCE = 0.0025
_REFUSED = 0.001
#: chance below which the intervals are widened to the scatter seen
_WIDENED = 0.01


#: octaves left out beyond the first cluster time at which the model passes, for there it only just does
_MARGIN = 1.0


def fit_band(curve: Curve, short, automatic, two_sided, one_sided) -> Banded:
    r"""Fit the curve from the shortest cluster time on from which the model holds; all of it unless `automatic`.

    Filters and output averaging in a sensor spoil short cluster times, so these are left out one by one until the chi-square
    of the rest, with a misfit of 0.25 % of the deviation allowed, is no worse than one in a thousand; then an octave more.
    What a filter of white noise, or a line of the spectrum, leaves at cluster times well above its own is N^2/tau + c/tau^2
    with c of either sign. So with a cut band a tail of that slope, the last column, is fitted beside the terms; it takes the
    place of those that only `short` cluster times show (Q), which are then not estimated.

    Parameters
    ----------
    curve : the curve; its last column is that of the tail, of negative sign.
    short : (p,) which terms only short cluster times show.
    automatic : whether to choose the band.
    two_sided, one_sided : rise of the chi-square at the ends of intervals and at upper limits.
    """
    p = len(short)
    size = jnp.sum(curve.used)
    last = jnp.maximum(size - p - 5, 0)  # the latest start that leaves enough to fit
    ranked = jnp.sort(jnp.where(curve.used, curve.octave, jnp.inf))
    is_tail = jnp.arange(p + 1) == p

    def fitted(curve, start, cut):
        part = eqx.tree_at(lambda c: c.used, curve, curve.used & (curve.octave >= start)).only(~is_tail | cut)
        found = estimate(part, ~jnp.append(short & cut, False), extra=(2.0 * _TOLERANCE * part.v) ** 2)
        freedom = (jnp.sum(part.used) - jnp.sum(found.theta > 0.0)).astype(curve.v.dtype)
        allowed = jax.scipy.stats.chi2.sf(found.chi2, freedom)
        return part, found, freedom, allowed

    fixed = jax.lax.stop_gradient(curve)  # neither the choice of the band nor the interval carries a derivative
    candidates = jnp.arange(max(len(curve.v) - p - 5, 1))
    chances = jax.lax.map(lambda first: fitted(fixed, ranked[first], first > 0)[-1], candidates)
    possible = (candidates <= last) & ((candidates == 0) | automatic)
    chances = jnp.where(possible & jnp.isfinite(chances), chances, -1.0)
    enough = chances >= _REFUSED
    holds = jnp.any(enough)
    first = jnp.where(holds, jnp.argmax(enough), jnp.argmax(chances))
    cut = first > 0
    start = jnp.where(cut, jnp.minimum(ranked[first] + _MARGIN, ranked[last]), ranked[0])
    part, found, freedom, _ = fitted(curve, start, cut)

    strict = chi_square(part, found.theta)
    goodness = jax.scipy.stats.chi2.sf(strict, freedom)
    inflation = jnp.where(goodness < _WIDENED, jnp.maximum(strict / freedom, 1.0), 1.0)
    reported = ~(short & cut)
    theta = jnp.where(reported, found.theta[:p], 0.0)
    spread = jnp.where(reported[:, None] & reported[None, :], found.covariance[:p, :p], 0.0) * inflation
    # a short term is tested without the tail, which has its slope and no sign and would leave it without a limit
    own = jnp.arange(p)[:, None] == jnp.arange(p + 1)[None, :]
    others = jnp.append(reported, False)[None, :]
    admitted = jnp.where(reported[:, None], ~is_tail[None, :] | cut, own | others)
    reach = jnp.sqrt(jnp.where(reported, jnp.diagonal(found.covariance)[:p], found.covariance[p, p]))
    still, middle, reach, widened = jax.lax.stop_gradient((part, theta, reach, inflation))
    alone, _ = weighted(still.only(~is_tail))
    ends = limits(still, admitted, jnp.where(reported, middle, alone[:p]), reach, two_sided * widened, one_sided * widened)
    ends = eqx.tree_at(
        lambda e: (e.low, e.significance),
        ends,
        (jnp.where(reported, ends.low, 0.0), jnp.where(reported, ends.significance / widened, 0.0)),
    )
    modelled = curve.columns[:, :p] @ theta
    variance = jnp.diagonal(part.covariance(jnp.append(theta, 0.0)))
    edf = 2.0 * modelled**2 / jnp.where(part.used & (variance > 0.0), variance, 1.0)
    return Banded(theta, spread, ends, part.used, cut, holds, goodness, inflation, found.step, modelled, edf)
