"""a sin(psi) + b cos(psi) = c: both roots, their standard deviations, and what to say of them."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Array
from ._frames import wrap

WEAK = np.deg2rad(10.0)
_STEEP = 50.0
_EMPTY = 1e-9
_MERGED = 1e-6


class Roots(eqx.Module):
    """Roots of one equation, or several.

    roots : in (-pi, pi]. std : standard deviation; large, not infinite, where roots merge. real : which are roots.
    degenerate, infeasible, clipped, merged, weak : flags, one for all roots, the last two one per root.
    """

    roots: Array
    std: Array
    real: Array
    degenerate: Array
    infeasible: Array
    clipped: Array
    merged: Array
    weak: Array


def root_of(square: Array) -> Array:
    """Square root, zero for what is not positive, with the derivative zero there instead of none."""
    inside = square > 0
    return jnp.where(inside, jnp.sqrt(jnp.where(inside, square, 1)), 0)


def arc_cosine(c: Array, r: Array) -> tuple[Array, Array]:
    """acos(clip(c / r)), accurate near 0 and pi, and sqrt(r^2 - c^2)."""
    inside = (r - c) * (r + c) > 0
    sine = root_of((r - c) * (r + c))
    angle = jnp.arctan2(jnp.where(inside, sine, 0), jnp.where(inside, c, 1))
    return jnp.where(inside, angle, jnp.where(c < 0, jnp.asarray(np.pi, dtype=c.dtype), 0)), sine


def solve(coefficients: Callable[[Array], Array], x: Array, covariance: Array, empty: float = _EMPTY) -> Roots:
    """Both roots of the equation whose (a, b, c) `coefficients` gives for the data `x` with their `covariance`.

    The standard deviation is that of a sin + b cos - c over its slope in psi: everything that `x` holds counts.
    """
    a, b, c = coefficients(x)
    slopes = jax.jacfwd(coefficients)(x)
    square = a**2 + b**2
    degenerate = square < empty**2
    r = jnp.sqrt(jnp.where(degenerate, 1, square))
    middle = jnp.arctan2(jnp.where(degenerate, 0, a), jnp.where(degenerate, 1, b))
    c = jnp.where(degenerate, 0, c)
    half, sine = arc_cosine(c, r)
    away = jnp.where(jnp.abs(c) > r, jnp.where(c < 0, middle + np.pi, middle), middle)
    excess = (jnp.abs(c) - r) / r
    sigma_away = _misfit(away, slopes, covariance) / r
    infeasible = (excess > jnp.maximum(5 * sigma_away, 1e-9)) & ~degenerate
    roots = jnp.stack([wrap(middle - half), wrap(middle + half)])
    sigma = jnp.stack([_misfit(root, slopes, covariance) for root in roots]) / r
    slope = sine / r
    std = sigma / jnp.maximum(slope, jnp.sqrt(jnp.maximum(sigma, 1e-300)))
    noisy = jnp.trace(covariance) > 0
    merged = slope < _MERGED
    weak = jnp.where(noisy, std > WEAK, 1 / jnp.maximum(slope * r, 1e-30) > _STEEP)
    both = jnp.ones(2, dtype=bool)
    return Roots(
        roots, std, both & ~degenerate & ~infeasible, degenerate, infeasible, (excess > 0) & ~infeasible & ~degenerate,
        both & merged, weak & ~degenerate,
    )  # fmt: skip


def _misfit(root: Array, slopes: Array, covariance: Array) -> Array:
    """Standard deviation of a sin + b cos - c at one root."""
    row = jnp.sin(root) * slopes[0] + jnp.cos(root) * slopes[1] - slopes[2]
    return root_of(row @ covariance @ row)


def joined(*parts: Roots) -> Roots:
    """The roots of several equations, any of which may have none."""
    cat = lambda name: jnp.concatenate([getattr(part, name) for part in parts])  # noqa: E731
    every = lambda name: jnp.all(jnp.stack([getattr(part, name) for part in parts]))  # noqa: E731
    some = jnp.any(jnp.stack([part.clipped for part in parts]))
    return Roots(
        cat("roots"),
        cat("std"),
        cat("real"),
        every("degenerate"),
        every("infeasible"),
        some,
        cat("merged"),
        jnp.stack([part.weak for part in parts]),
    )
