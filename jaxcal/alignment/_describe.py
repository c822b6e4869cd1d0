"""Covariance, rank and what is confounded, from a whitened Jacobian."""

from typing import Any

import equinox as eqx
import numpy as np

from .._precision import array_module
from .._types import AnyArray
from ..fitting import Information, information
from ._frames import EARTH_RATE

_RANK = 1e-9


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
    data, whole = (_informed(part * sizes[None, :], free) for part in (jacobian[:rows], jacobian))
    covariance = whole.covariance * sizes[:, None] * sizes[None, :]
    return Knowledge(covariance, data.rank, whole.rank, free & ~data.determined, free & ~whole.determined)


def _informed(matrix: AnyArray, free: np.ndarray) -> Information:
    """Information of the free parameters; a column below 1e-9 of the largest is rounding, and holds none."""
    xp = array_module(matrix)
    matrix = xp.where(free[None, :], matrix, 0)
    column = xp.sqrt(xp.sum(matrix**2, axis=0))
    return information(xp.where(column[None, :] > _RANK * xp.max(column), matrix, 0), held=xp.asarray(~free), tolerance=_RANK)
