r"""Whittle likelihood of binned ordinates: pure functions for `jit`, `vmap` and `grad`.

Ordinates are nearly independent and exponential about the model's density S = X theta, theta the squared coefficients, so

.. math:: \mathrm{NLL}(\theta) = \frac12\sum_b \nu_b\,[\ln S_b + P_b/S_b]

with P_b the mean of nu_b ordinates (P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram). Its
minimum over theta >= 0 is the fixed point of least squares with rows sqrt(nu_b)/S_b, which is Fisher scoring.
"""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._precision import array_module
from .._types import AnyArray, Array, Float
from ..fitting import nonnegative
from ._curve import inverse
from ._ordinates import Bins

_STEPS = (1.6, 1.0, 0.5, 0.2, 0.05)
_MOST = 80


class Minimum(eqx.Module):
    """Squared coefficients of the least NLL, that NLL, and the last relative step of the density."""

    theta: Float[Array, " p"]
    nll: Float[Array, ""]
    step: Float[Array, ""]


def density(bins: Bins, theta) -> AnyArray:
    """S, positive everywhere."""
    s = bins.columns @ theta
    return array_module(s).maximum(s, jnp.finfo(s.dtype).tiny ** 0.5)


def negative_log_likelihood(bins: Bins, theta) -> Array:
    """NLL(theta), without constants."""
    s = density(bins, theta)
    return 0.5 * jnp.sum(bins.weight * (jnp.log(s) + bins.density / s))


def _scored(bins: Bins, s, held) -> Array:
    """One step of Fisher scoring: non-negative least squares with weights nu/S^2; `held` is (index, value) or None."""
    rows = bins.columns * (bins.weight / s**2)[:, None]
    gram, moment = rows.T @ bins.columns, rows.T @ bins.density
    if held is None:
        return nonnegative(gram, moment).value
    index, value = held
    here = jnp.arange(gram.shape[0]) == index
    moment = jnp.where(here, 0.0, moment - gram[:, index] * value)
    gram = jnp.where(here[:, None] | here[None, :], 0.0, gram)
    return jnp.where(here, value, nonnegative(gram, moment).value)


def beginning(bins: Bins) -> Array:
    """Where the iteration starts: weights from the ordinates themselves, smoothed over eleven bins."""
    kernel = jnp.ones(11, bins.density.dtype)
    weight = jnp.convolve(bins.weight, kernel, mode="same")
    smooth = jnp.convolve(bins.weight * bins.density, kernel, mode="same") / jnp.where(weight > 0, weight, 1.0)
    return _scored(bins, jnp.where(weight > 0, smooth, 1.0), None)


def minimise(bins: Bins, start, held=None) -> Minimum:
    """Least NLL over theta >= 0, from `start`; each step is the best of several lengths, so the NLL never rises."""
    lengths = jnp.asarray(_STEPS, dtype=bins.density.dtype)
    enough = jnp.sqrt(jnp.finfo(lengths.dtype).eps)

    def body(state):
        theta, nll, _, k = state
        s = density(bins, theta)
        new = _scored(bins, s, held)
        tried = jnp.maximum(theta[None, :] + lengths[:, None] * (new - theta)[None, :], 0.0)
        values = jax.vmap(lambda t: negative_log_likelihood(bins, t))(tried)
        best = jnp.argmin(values)
        better = values[best] < nll
        change = jnp.max(jnp.where(bins.weight > 0, jnp.abs(density(bins, new) / s - 1.0), 0.0))
        theta, nll = jnp.where(better, tried[best], theta), jnp.where(better, values[best], nll)
        return theta, nll, jnp.where(better, change, jnp.minimum(change, enough)), k + 1

    def going(state):
        return (state[2] > enough) & (state[3] < _MOST)

    first = (start, negative_log_likelihood(bins, start), jnp.asarray(jnp.inf, lengths.dtype), 0)
    theta, nll, step, _ = jax.lax.while_loop(going, body, first)
    return Minimum(theta, nll, step)


def fisher(bins: Bins, theta) -> Array:
    """Fisher information of the squared coefficients, F = 1/2 sum nu X X' / S^2."""
    rows = jnp.asarray(bins.columns) * (jnp.sqrt(0.5 * bins.weight) / density(bins, theta))[:, None]
    return rows.T @ rows


def with_derivative(bins: Bins, theta) -> Array:
    """Theta at the minimum with its derivative with respect to the ordinates: one Newton step, which moves nothing."""
    theta = jnp.asarray(jax.lax.stop_gradient(theta))
    still = jax.lax.stop_gradient(bins)
    free = theta > 0
    slope = jax.grad(negative_log_likelihood, argnums=1)(bins, theta)
    curvature = jax.hessian(negative_log_likelihood, argnums=1)(still, theta)
    curvature = jnp.where(free[:, None] & free[None, :], curvature, 0.0)
    move = -inverse(curvature) @ jnp.where(free, slope, 0.0)
    return jnp.asarray(theta + (move - jax.lax.stop_gradient(move)))
