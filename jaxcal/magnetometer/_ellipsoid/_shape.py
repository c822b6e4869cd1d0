"""Ellipsoids {b + S h : |h| = 1} of scaled readings: result of a fit, the model, and its covariance."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._arrays import power_of_two
from ..._precision import array_module, is_traced
from ..._types import AnyArray
from .._model import MagModel
from ._kinds import basis_of

_SMALLEST_PAD = 64  # rows of the shortest program
#: singular value of the centred readings over their size, 0.58 for a full sphere, below which they lie near a plane
NEAR_PLANAR = 0.05


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Centring and scaling of readings, u = (m - centre) / scale."""

    centre: AnyArray
    scale: Any

    @staticmethod
    def of(m: AnyArray) -> "Frame":
        centre = m.mean(axis=0)
        return Frame(centre, ((m - centre[None, :]) ** 2).sum(axis=1).mean() ** 0.5)

    def scaled(self, m: Any) -> Any:
        return (m - self.centre[None, :]) / self.scale


# A fit makes and reads many of these. As Equinox modules they took a tenth of its time.
@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True, eq=False)
class Found:
    """An ellipsoid in scaled readings: S and centre, (9, 9) covariance of its parameters, noise, and distances.

    noise2 : variance for the curvature term, which was subtracted from the distances.
    """

    parameters: AnyArray
    soft: AnyArray
    centre: AnyArray
    covariance: AnyArray
    noise: Any
    distance: AnyArray
    converged: Any
    kind: str = dataclasses.field(metadata={"static": True})
    noise2: Any = 0.0

    @property
    def spread(self) -> Any:
        """Covariance (12, 12) of the entries of S and the centre; infinite if one parameter is not determined."""
        return between(basis_of(self.kind), self.covariance)


def between(slopes: Any, covariance: Any) -> Any:
    """Covariance J C J'; infinite if C is: infinity times zero is NaN."""
    xp = array_module(slopes, covariance)
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


def filled(values: np.ndarray, row: Any = 0.0) -> np.ndarray:
    """The array, padded with copies of `row` to a power of two, so that logs of any length share a compiled program."""
    rest = np.zeros_like(values, shape=(power_of_two(len(values), _SMALLEST_PAD) - len(values), *values.shape[1:]))
    return np.concatenate([values, rest + np.asarray(row, dtype=values.dtype)])


def unit(v: np.ndarray) -> np.ndarray:
    """Rows scaled to length one."""
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)


def soft_of(shape: Any) -> Any:
    """S of the surface x'Ax = 1: the inverse of the symmetric root of A."""
    xp = jnp if is_traced(shape) else np
    values, vectors = xp.linalg.eigh(shape)
    # rounding may make an eigenvalue negative if the ellipsoid diverged
    return (vectors / xp.sqrt(xp.maximum(values, xp.finfo(values.dtype).eps * xp.abs(values[-1])))[None, :]) @ vectors.T


def shape_of_soft(soft: np.ndarray) -> np.ndarray:
    """A of S (host only)."""
    inverse = np.linalg.inv(soft)
    return inverse.T @ inverse


def radius_of(soft: Any) -> Any:
    """Geometric mean of all semi-axes."""
    xp = array_module(soft)
    return xp.cbrt(xp.abs(xp.linalg.det(soft)))


def directions_of(found: Found, u: np.ndarray) -> np.ndarray:
    """Unit vectors of the corrected readings."""
    return unit((u - found.centre) @ np.linalg.inv(found.soft))


def model_of(soft: Any, centre: Any, frame: Frame, size: Any) -> MagModel:
    """The model for a field of magnitude `size` in scaled units."""
    return MagModel(soft / size, frame.centre + frame.scale * centre)


def iron_slopes(whole: Any, field: Any, given: bool) -> Any:
    """Derivative (13, 12) of hard iron, soft iron and field by the whole matrix C H and the hard iron; H = det(C H)^(1/3) unless given."""
    xp = array_module(whole, field)
    by_field = xp.zeros(9, dtype=whole.dtype) if given else field / 3 * xp.linalg.inv(whole).T.ravel()
    by_soft = xp.concatenate([xp.eye(9, dtype=whole.dtype) / field - xp.outer(whole.ravel(), by_field) / field**2, by_field[None]])
    hard = xp.eye(3, 12, 9, dtype=whole.dtype)
    return xp.concatenate([hard, xp.concatenate([by_soft, xp.zeros((10, 3), dtype=whole.dtype)], axis=1)])
