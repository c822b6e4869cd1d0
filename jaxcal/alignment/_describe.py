"""Covariance, rank and what is confounded, from a whitened Jacobian."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp

from .._types import Array
from ._frames import EARTH_RATE
from ._model import COUNT, INDEX

_RANK = 1e-9
_HIDDEN = 1e-6


class Knowledge(eqx.Module):
    """What the rows of a Jacobian tell of the parameters.

    covariance : (14, 14) with the priors; rows of parameters that are held are zero, diagonal entries of those nothing determines infinite.
    rank : of the data alone. hidden : (14,) free parameters with a part in the data's null space. lost : those that the priors do not
    save either. singular_values : (14,) of the data's Jacobian with unit columns.
    """

    covariance: Array
    rank: Array
    rank_with_priors: Array
    hidden: Array
    lost: Array
    singular_values: Array


def physical(gravity: Array, duration: Array, dtype: Any) -> Array:
    """(14,) size of a unit change of every parameter: rad, g, the Earth's rate, one."""
    sizes = jnp.ones(COUNT, dtype=dtype)
    sizes = sizes.at[INDEX["b_a"]].set(gravity).at[INDEX["b_g"]].set(EARTH_RATE)
    return sizes.at[INDEX["b_a_rate"]].set(gravity / duration).at[INDEX["b_g_rate"]].set(EARTH_RATE / duration)


def know(jacobian: Array, free: Array, sizes: Array) -> Knowledge:
    """From the rows of data and priors; the last 14 rows are those of the priors."""
    scaled = jnp.where(free[None, :], jacobian * sizes[None, :], 0)
    data = scaled[:-COUNT]
    s, seen, _ = _decompose(data, jnp.linalg.norm(data, axis=0))
    hidden = free & ~seen
    whole, saved, root = _decompose(scaled, jnp.linalg.norm(scaled, axis=0))
    covariance = (root @ root.T) * sizes[:, None] * sizes[None, :]
    lost = free & ~saved
    none = lost[:, None] | lost[None, :]
    covariance = jnp.where(none, jnp.where(jnp.eye(COUNT, dtype=bool) & lost[:, None], jnp.inf, 0), covariance)
    return Knowledge(covariance, jnp.sum(s > 0), jnp.sum(whole > 0), hidden, lost, s)


def _decompose(matrix: Array, column: Array) -> tuple[Array, Array, Array]:
    """Singular values with unit columns (zero where they count as none), which parameters are determined, a root of the covariance.

    A column below 1e-9 of the largest is not normalised: its rounding would pass as information.
    """
    largest = jnp.max(column)
    real = column > _RANK * largest
    column = jnp.where(real, column, jnp.where(largest > 0, largest, 1))
    # the factor R of the rows has their singular values, and is small
    _, s, v = jnp.linalg.svd(jnp.linalg.qr(matrix / column[None, :], mode="r"), full_matrices=False)
    kept = s > _RANK * jnp.max(s)
    span = jnp.where(kept[:, None], v, 0)
    shown = 1 - jnp.sum(span**2, axis=0) < _HIDDEN**2
    root = span.T * jnp.where(kept, 1 / jnp.where(kept, s, 1), 0)[None, :] / column[:, None]
    return jnp.where(kept, s, 0), shown, root
