"""Covariance, rank and what is confounded, from a whitened Jacobian."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._precision import array_module
from .._types import AnyArray
from ._frames import EARTH_RATE

_RANK = 1e-9
_HIDDEN = 1e-6


class Knowledge(eqx.Module):
    """What the rows of a Jacobian tell of the parameters.

    covariance : (p, p) with the priors; rows of parameters that are held are zero, diagonal entries of those nothing determines infinite.
    rank : of the data alone. hidden : (p,) free parameters with a part in the data's null space. lost : those that the priors do not
    save either.
    """

    covariance: AnyArray
    rank: Any
    rank_with_priors: Any
    hidden: AnyArray
    lost: AnyArray


def sizes_of(names: tuple[str, ...], gravity: Any, positions: Any) -> AnyArray:
    """(p,) size of a change of every parameter that counts as one: rad, g, the Earth's rate, either over the duration, one."""
    xp = array_module(gravity, positions)
    duration = (positions.start + positions.dwell).max() - positions.start.min()
    sizes = {"b_a": gravity, "b_g": EARTH_RATE, "b_a_rate": gravity / duration, "b_g_rate": EARTH_RATE / duration}
    return xp.stack([xp.asarray(sizes.get(name, 1.0)) for name in names])


def know(jacobian: AnyArray, rows: int, free: np.ndarray, sizes: AnyArray) -> Knowledge:
    """From the Jacobian of the readings, its first `rows` rows, and of the priors; differentiable where every parameter is determined."""
    xp, p = array_module(jacobian, sizes), len(free)
    scaled = xp.where(free[None, :], jacobian * sizes[None, :], 0)
    still = scaled if xp is np else jax.lax.stop_gradient(scaled)
    rank, seen, _, _ = _decompose(still[:rows])
    whole, saved, null, column = _decompose(still)
    # rows along the null space, which is orthogonal to all others, make the matrix regular and change nothing else
    triangle = xp.linalg.qr(xp.concatenate([scaled / column[None, :], null]), mode="r")
    root = xp.linalg.solve(triangle, xp.eye(p, dtype=triangle.dtype))
    covariance = (root @ root.T - null.T @ null) * (sizes / column)[:, None] * (sizes / column)[None, :]
    lost = free & ~saved
    known = free & saved
    infinite = xp.eye(p, dtype=bool) & lost[:, None]
    covariance = xp.where(infinite, xp.inf, xp.where(known[:, None] & known[None, :], covariance, 0))
    return Knowledge(covariance, rank, whole, free & ~seen, lost)


def _decompose(matrix: AnyArray) -> tuple[Any, AnyArray, AnyArray, AnyArray]:
    """Rank, which parameters are determined, the null space with zeros for the other directions, and the lengths of the columns.

    A column below 1e-9 of the largest is not normalised: its rounding would pass as information.
    """
    xp = array_module(matrix)
    column = xp.sqrt(xp.sum(matrix**2, axis=0))
    largest = xp.max(column)
    column = xp.where(column > _RANK * largest, column, xp.where(largest > 0, largest, 1))
    # the factor R of the rows has their singular values, and is small
    _, s, v = xp.linalg.svd(xp.linalg.qr(matrix / column[None, :], mode="r"), full_matrices=False)
    kept = s > _RANK * xp.max(s)
    seen = 1 - xp.sum(xp.where(kept[:, None], v, 0) ** 2, axis=0) < _HIDDEN**2
    return xp.sum(kept), seen, xp.where(kept[:, None], 0, v), column
