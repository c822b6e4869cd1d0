"""The shape matrix of an ellipsoid: its entries and their covariance, its symmetric root, and the model that it stands for."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._precision import array_module, is_traced
from .._model import MagModel
from ._algebraic import Frame
from ._orthogonal import Found
from ._start import PLANAR, PLANAR_ROWS, basis_of

NAMES = ("A_xx", "A_xy", "A_yy", "A_xz", "A_yz", "A_zz", "b_x", "b_y", "b_z")
PLANAR_NAMES = ("A_11", "A_12", "A_22", "b_1", "b_2")
ENTRIES = ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))
#: the symmetric matrices of which each entry is the coefficient
_UNIT = np.array([[[float((p, q) in ((j, k), (k, j))) for q in range(3)] for p in range(3)] for j, k in ENTRIES])


def _slopes(parameters: Any, basis: np.ndarray) -> Any:
    """Derivative of (A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) with respect to the parameters: dA = dU'U + U'dU."""
    xp = array_module(parameters)
    change, upper = basis[:9].T.reshape(9, 3, 3), (basis[:9] @ parameters).reshape(3, 3)
    half = upper.T @ change
    j, k = np.transpose(ENTRIES)
    return xp.concatenate([(half + xp.swapaxes(half, 1, 2))[:, j, k].T, xp.asarray(basis[9:])])


def entries_of(found: Found) -> np.ndarray:
    """(A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b), (9,), in scaled units."""
    j, k = np.transpose(ENTRIES)
    return np.concatenate([found.shape[j, k], found.centre])


def covariance_of(found: Found, frame: Frame, bias: np.ndarray | None = None) -> Any:
    """Covariance of the shape's entries and the centre in the units of the readings: (9, 9), or (5, 5) in a plane.

    bias : (9,) of them in scaled units; its square is added.
    """
    xp = array_module(found, frame)
    rows = np.arange(9) if found.kind not in PLANAR else np.array(PLANAR_ROWS)
    unit = xp.where(rows < 6, frame.scale**-2, frame.scale)
    slopes = _slopes(found.parameters, basis_of(found.kind))[rows] * unit[:, None]
    off = np.zeros(len(rows)) if bias is None else bias[rows] * unit
    # infinity times zero is no number: an open parameter leaves all of it open
    known = xp.isfinite(found.covariance).all()
    return xp.where(known, slopes @ xp.where(known, found.covariance, 0.0) @ slopes.T + xp.outer(off, off), xp.inf)


def root(shape: Any) -> Any:
    """Symmetric positive square root."""
    return _traced_root(shape) if is_traced(shape) else _root(shape, np)


def _root(shape: Any, xp: Any) -> Any:
    values, vectors = xp.linalg.eigh(shape)
    return (vectors * xp.sqrt(values)[None, :]) @ vectors.T


@jax.custom_jvp
def _traced_root(shape: Any) -> Any:
    return _root(shape, jnp)


@_traced_root.defjvp
def _(primals: Any, tangents: Any) -> Any:
    matrix = _traced_root(*primals)
    return matrix, _root_change(matrix, tangents[0].reshape(9, 1)).reshape(3, 3)


def _root_change(matrix: Any, change: Any) -> Any:
    """DS for the columns dA, from S dS + dS S = dA: unlike derivatives of eigenvectors it is finite where eigenvalues are equal."""
    xp = array_module(matrix)
    one = xp.eye(3, dtype=matrix.dtype)
    return xp.linalg.solve(xp.kron(matrix, one) + xp.kron(one, matrix), change)


def root_slopes(shape: Any) -> Any:
    """Derivative of the symmetric root with respect to the six entries, (6, 3, 3)."""
    return _root_change(root(shape), _UNIT.reshape(6, 9).T).T.reshape(6, 3, 3)


def radius_of(shape: Any) -> Any:
    """Cube root of the product of the semi-axes."""
    return array_module(shape).linalg.det(shape) ** (-1 / 6)


def model_of(shape: Any, centre: Any, frame: Frame, size: Any) -> MagModel:
    """The model with a symmetric soft iron, for a field of norm `size` in scaled units."""
    return MagModel(array_module(shape).linalg.inv(root(shape) * size), frame.centre + frame.scale * centre)
