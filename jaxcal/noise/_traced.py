r"""The fit of a traced record: as it is, without checks, a choice of the band, or spectral lines; the result can be differentiated.

The likelihood is that of `_likelihood`, minimised as half the sum of squares of the deviance residuals of a gamma law,

.. math:: r_b = \sqrt{\nu_b}\,\mathrm{sign}(\rho_b - 1)\sqrt{\rho_b - 1 - \ln\rho_b},\qquad \rho = P/S

No derivative goes through the search: it is that of the root of the score (implicit function theorem).
"""

import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._types import AnyArray, Array
from ..fitting import solve
from ..fitting._implicit import implicit
from ._likelihood import FAINT, Limits, levels_of
from ._observed import bins_of
from ._record import Asked
from ._result import NoiseFit, assemble
from ._solve import inside
from ._terms import Ramp, Term, is_sought

_FINE = 1.5e-8  # remaining step, in standard errors, at which the search ends


def fit_traced(y: Array, asked: Asked) -> NoiseFit:
    """Fit a record (n,) without gaps."""
    rate, terms, band, confidence = asked.rate, asked.terms, asked.band, asked.confidence
    if any(isinstance(term, Ramp) or is_sought(term) for term in terms):
        raise DataError("a traced record is fitted without R and markov; these are found by a search, which cannot be traced")
    duration, band = y.shape[0] / rate, None if band is None else tuple(map(float, band))
    theta, covariance, limits = _fitted(y, rate, terms, confidence, band)
    return assemble(
        theta, covariance, limits, terms, None, duration, goodness=np.nan, confidence=confidence, method="whittle", used=None,
        band=(1.0 / rate, duration / 2.0) if band is None else band, xp=jnp,
    )  # fmt: skip


# compiled as a whole: outside of `jax.jit`, a derivative would compile its operations one by one
@functools.partial(jax.jit, static_argnums=(1, 2, 3, 4))
def _fitted(y: Array, rate: float, terms: tuple[Term, ...], confidence: float, band: Any) -> tuple[Array, Array, Limits]:
    """Squared coefficients, their covariance and limits."""
    bins = inside(bins_of(y, 1.0 / rate, terms), band)
    used = bins.weight > 0
    theta, _ = implicit(_likeliest, _score, bins.density[used], jnp.asarray(bins.columns[used]), jnp.asarray(bins.weight[used]))
    model = bins.columns @ theta
    rows = bins.columns * (jnp.sqrt(0.5 * bins.weight) / model)[:, None]
    scale = jnp.linalg.norm(rows, axis=0)
    unit = rows / scale[None, :]
    covariance = jnp.linalg.inv(unit.T @ unit) / jnp.outer(scale, scale)
    error, middle = jax.lax.stop_gradient((jnp.sqrt(jnp.diagonal(covariance)) * bins.unit, theta * bins.unit))
    both, one = (error * level**0.5 for level in levels_of(confidence))
    limits = Limits(jnp.maximum(middle - both, 0.0), middle + both, middle + one, (middle / error) ** 2)
    return theta * bins.unit, covariance * bins.unit**2, limits


def _likeliest(target: Array, columns: Array, weight: Array) -> tuple[Array, tuple]:
    """Non-negative coefficients of highest likelihood, from several starts; see `_likelihood.several_starts`."""
    least, p = np.finfo(target.dtype).tiny ** 0.5, columns.shape[1]
    equal = jnp.exp(jnp.mean(jnp.log(jnp.maximum(target, least)[:, None] / columns), axis=0)) / p
    several = np.concatenate([np.ones((1, p)), 1.0 - (1.0 - FAINT) * np.eye(p)]).astype(target.dtype)

    def search(start: Array) -> tuple[AnyArray, AnyArray]:
        fit = solve(_deviances, start, (columns, (jnp.sqrt(weight), target)), bounds=(0.0, np.inf), rtol=_FINE)
        return fit.parameters, fit.cost

    theta, cost = jax.lax.map(search, equal[None, :] * several)
    return theta[jnp.argmin(cost)], ()


def _score(theta: Array, _: Any, target: Array, columns: Array, weight: Array) -> Array:
    """Zero at the highest likelihood; a coefficient at its bound stays there."""
    model = columns @ theta
    return jnp.where(theta > 0.0, (weight / model * (target / model - 1.0)) @ columns, theta)


def _root(ratio: Array) -> Array:
    """sign(z) sqrt(z - ln(1 + z)) with z = ratio - 1."""
    z = ratio - 1.0
    small = jnp.abs(z) < 1e-2
    # two `where`: near zero, where the root has no derivative, the series replaces it, and the gradient must not see the root
    far = jnp.where(small, 1.0, z)
    near = jnp.where(small, z, 0.0)
    series = 1.0 - near * (2 / 3 - near * (1 / 2 - near * (2 / 5 - near * (1 / 3 - near * (2 / 7 - near / 4)))))
    return jnp.where(small, near * jnp.sqrt(series / 2.0), jnp.sign(far) * jnp.sqrt(far - jnp.log(1.0 + far)))


def _deviances(theta: Array, data: tuple[Any, tuple[Any, Array]]) -> Array:
    columns, (root, target) = data
    tiny = jnp.finfo(target.dtype).tiny ** 0.5
    return root * _root(jnp.maximum(target, tiny) / jnp.maximum(columns @ theta, tiny))
