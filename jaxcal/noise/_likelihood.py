r"""Whittle likelihood of binned ordinates, on the host and in a trace.

Ordinates are nearly independent and exponential about the model's density S = X theta, theta the squared coefficients, so

.. math:: \mathrm{NLL}(\theta) = \frac12\sum_b \nu_b\,[\ln S_b + P_b/S_b]

with P_b the mean of nu_b ordinates (P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram). It is
minimised as half the sum of squares of the deviance residuals of a gamma law,

.. math:: r_b = \sqrt{\nu_b}\,\mathrm{sign}(\rho_b - 1)\sqrt{\rho_b - 1 - \ln\rho_b},\qquad \rho = P/S

which is the negative log-likelihood less that of S = P. The information is the expected one.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np

from .._types import AnyArray, Array
from ..fitting import solve
from ._lanes import namespace, run
from ._ordinates import Bins

_FAINT = 0.01  # share of its even part with which a column begins in one of the starts
#: rows of the compiled program, which hold the bins of 7 million samples, and coefficients, of which larger problems have multiples
_ROWS, _WIDTH = 256, 6
#: step to go, in standard errors, at which a search for coefficients ends, and one for a likelihood, whose error is the square of it
_FINE, ROUGH = 1.5e-8, 1e-5


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


def _deviances(theta: Array, data: dict[str, Array]) -> Array:
    model = _model(theta, data)
    tiny = jnp.finfo(model.dtype).tiny ** 0.5
    return data["root"] * _deviance(jnp.maximum(data["target"], tiny) / jnp.maximum(model, tiny))


def _minimum(shared: Any, lane: tuple[dict[str, Array], Array, Array]) -> Minima:
    fit = solve(_deviances, lane[1], lane[0], bounds=(lane[2], np.inf), rtol=shared)
    return Minima(fit.parameters, fit.cost, fit.usable)


def minimise(columns: Any, target: Any, weight: Any, start: Any, *, base: Any = 0.0, lower: Any = 0.0, rtol: float = _FINE) -> Minima:
    """Least cost over theta >= lower of every lane; differentiable with respect to columns, target, weight and base.

    Parameters
    ----------
    columns : (rows, p) or (lanes, rows, p) model per coefficient.
    target, weight, base : (rows,) or (lanes, rows); a row of weight zero takes no part.
    start : (lanes, p) where the search begins; the model must be positive there.
    lower : one bound, (p,) or (lanes, p).
    rtol : step to go, relative to the statistical uncertainty, at which a search ends.
    """
    xp = namespace(columns, target, weight, start, base)
    lanes, p = start.shape
    root = xp.sqrt(weight * xp.ones_like(target))
    used = root > 0
    data = {"columns": xp.where(used[..., None], columns, 0.0), "base": xp.where(used, base, 1.0), "target": xp.where(used, target, 1.0)}
    data = {name: xp.broadcast_to(each, (lanes, *each.shape[-1 - (name == "columns") :])) for name, each in (data | {"root": root}).items()}
    lower = xp.broadcast_to(xp.asarray(lower, dtype=root.dtype), (lanes, p))
    if xp is jnp:
        return run(_minimum, rtol, (data, start, lower), None)
    # bins of long records alone need all rows; coefficients that are not there have no column
    tall = _ROWS if not used[..., _ROWS:].any() else root.shape[-1]
    data = {name: each[:, :tall] for name, each in data.items()}
    wide = ((0, 0), (0, -p % _WIDTH))
    lane = data | {"columns": np.pad(data["columns"], ((0, 0), *wide))}, np.pad(start, wide), np.pad(lower, wide)
    found = run(_minimum, np.asarray(rtol), lane, Minima(lane[1][0], 0.0, False))
    return found._replace(theta=found.theta[:, :p])


def density(columns: Any, theta: Any) -> Any:
    """S, positive everywhere."""
    s = columns @ theta
    return namespace(s).maximum(s, np.finfo(s.dtype).tiny ** 0.5)


def information(bins: Bins, theta: Any) -> Any:
    """Expected (Fisher) information of the squared coefficients, F = 1/2 sum nu X X' / S^2."""
    rows = bins.columns * (namespace(bins, theta).sqrt(0.5 * bins.weight) / density(bins.columns, theta))[:, None]
    return rows.T @ rows


def flat_start(bins: Bins) -> Any:
    """Initial guess: every column carries the same share of the ordinates; zero for a column of zeros or of negative sign."""
    xp = namespace(bins)
    positive = (bins.weight > 0)[:, None] & (bins.columns > 0)
    count = xp.sum(positive, axis=0).astype(bins.density.dtype)
    ordinate = xp.maximum(bins.density, np.finfo(bins.density.dtype).tiny ** 0.5)
    logs = xp.where(positive, xp.log(ordinate[:, None] / xp.where(positive, bins.columns, 1.0)), 0.0)
    there = count > 0
    level = xp.exp(xp.sum(logs, axis=0) / xp.where(there, count, 1.0))
    return xp.where(there, level / xp.maximum(xp.sum(there).astype(count.dtype), 1.0), 0.0)


def several_starts(bins: Bins) -> Any:
    """(1 + p, p) initial guesses: all columns alike, and each in turn faint, for the likelihood has local minima."""
    p = bins.columns.shape[1]
    return flat_start(bins)[None, :] * np.concatenate([np.ones((1, p)), 1.0 - (1.0 - _FAINT) * np.eye(p)]).astype(bins.density.dtype)


def lower_of(columns: Any) -> Any:
    """(p,) bounds: the coefficient of a column of negative sign, which is that of a nuisance, may have either sign."""
    xp = namespace(columns)
    return xp.where(xp.any(columns < 0, axis=tuple(range(columns.ndim - 1))), -np.inf, 0.0)


def fit_from(bins: Bins, starts: Any, weights: Any = None, **options: Any) -> Minima:
    """The minimum reached from each start, (lanes, p); with `weights`, (lanes, bins), each lane has its own."""
    weights = bins.weight if weights is None else weights
    return minimise(bins.columns, bins.density, weights, starts, lower=lower_of(bins.columns), **options)
