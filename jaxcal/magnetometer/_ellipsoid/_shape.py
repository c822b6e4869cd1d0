"""Ellipsoids (x - b)'A(x - b) = 1 of scaled readings: result of a fit, covariance, symmetric root, and model."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._arrays import power_of_two
from ..._precision import array_module, is_traced
from ..._types import AnyArray
from .._model import MagModel
from ._kinds import ENTRIES, PLANAR, PLANAR_ROWS, basis_of, slopes_of

_SMALLEST_PAD = 64  # rows of the shortest program
#: singular value of the centred readings over their size, 0.58 for a full sphere, below which they lie near a plane
NEAR_PLANAR = 0.05
#: change of a symmetric matrix with each of its six entries
_ENTRY_CHANGE = np.zeros((6, 3, 3))
_ENTRY_CHANGE[range(6), *ENTRIES] = _ENTRY_CHANGE[range(6), *ENTRIES[::-1]] = 1.0


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
    """An ellipsoid in scaled readings: shape and centre, (9, 9) covariance of its parameters, noise, and distances.

    noise2 : variance for the curvature term, which was subtracted from the distances. penalty : weight of the penalty. bias : shift of the
    fit by the penalty in standard errors.
    """

    parameters: AnyArray
    shape: AnyArray
    centre: AnyArray
    covariance: AnyArray
    noise: Any
    distance: AnyArray
    converged: Any
    kind: str = dataclasses.field(metadata={"static": True})
    noise2: Any = 0.0
    penalty: Any = 0.0
    bias: Any = 0.0


def padded_length(count: int) -> int:
    """Power of two to which arrays are padded, so that logs of any length share a compiled program."""
    return power_of_two(count, _SMALLEST_PAD)


def filled(values: np.ndarray, row: Any = 0.0) -> np.ndarray:
    """The array, padded with copies of `row` to the padded length."""
    rest = np.zeros_like(values, shape=(padded_length(len(values)) - len(values), *values.shape[1:]))
    return np.concatenate([values, rest + np.asarray(row, dtype=values.dtype)])


def unit(v: np.ndarray) -> np.ndarray:
    """Rows scaled to length one."""
    return v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-300)


def entries_of(found: Found) -> np.ndarray:
    """(A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b), (9,), in scaled units."""
    return np.concatenate([found.shape[ENTRIES], found.centre])


def covariance_of(found: Found, frame: Frame, bias: np.ndarray | None = None, own: Any = None) -> Any:
    """Covariance (9, 9) of the shape's entries and the centre, (5, 5) in a plane, plus the squares of scaled biases (k, 9).

    own : covariance of the parameters in place of that of the fit.
    """
    matrix = found.covariance if own is None else own
    xp = array_module(found, frame)
    rows = np.arange(9) if found.kind not in PLANAR else np.array(PLANAR_ROWS)
    size = xp.where(rows < 6, frame.scale**-2, frame.scale)
    slopes = slopes_of(found.parameters, basis_of(found.kind))[rows] * size[:, None]
    off = np.zeros((0, len(rows))) if bias is None else bias[:, rows] * size
    # infinity times zero is NaN, so one undetermined parameter makes the whole covariance infinite
    known = xp.isfinite(matrix).all()
    return xp.where(known, slopes @ xp.where(known, matrix, 0.0) @ slopes.T + off.T @ off, xp.inf)


def root(shape: Any) -> Any:
    """Symmetric positive square root."""
    return _traced_root(shape) if is_traced(shape) else _root(shape, np)


def _root(shape: Any, xp: Any) -> Any:
    values, vectors = xp.linalg.eigh(shape)
    # rounding may make an eigenvalue negative if the ellipsoid diverged
    values = xp.maximum(values, xp.finfo(values.dtype).eps * xp.abs(values[-1]))
    return (vectors * xp.sqrt(values)[None, :]) @ vectors.T


@jax.custom_jvp
def _traced_root(shape: Any) -> Any:
    return _root(shape, jnp)


@_traced_root.defjvp
def _(primals: Any, tangents: Any) -> Any:
    matrix = _traced_root(*primals)
    return matrix, _root_change(matrix, tangents[0].reshape(9, 1)).reshape(3, 3)


def _root_change(matrix: Any, change: Any) -> Any:
    """Change dS of the root for the columns dA, from S dS + dS S = dA; finite for equal eigenvalues, unlike derivatives of eigenvectors."""
    xp = array_module(matrix)
    one = xp.eye(3, dtype=matrix.dtype)
    return xp.linalg.solve(xp.kron(matrix, one) + xp.kron(one, matrix), change)


def root_slopes(shape: Any) -> Any:
    """Derivative of the symmetric root with respect to the six entries, (6, 3, 3)."""
    return _root_change(root(shape), _ENTRY_CHANGE.reshape(6, 9).T).T.reshape(6, 3, 3)


def roots_of(shape: Any) -> tuple[Any, Any, Any]:
    """Symmetric root, its inverse, and `root_slopes`; on the host from one decomposition."""
    if is_traced(shape):
        matrix = root(shape)
        return matrix, jnp.linalg.inv(matrix), root_slopes(shape)
    values, vectors = np.linalg.eigh(shape)
    size = np.sqrt(np.maximum(values, np.finfo(float).eps * np.abs(values[-1])))
    turned = vectors.T @ _ENTRY_CHANGE @ vectors / (size[:, None] + size)
    return (vectors * size) @ vectors.T, (vectors / size) @ vectors.T, vectors @ turned @ vectors.T


def radius_of(shape: Any, planar: bool = False) -> Any:
    """Geometric mean of all semi-axes, or of those in the plane."""
    xp = array_module(shape)
    det = xp.linalg.det(shape[:2, :2] if planar else shape)
    # rounding may make the determinant zero or negative if the ellipsoid diverged
    return xp.maximum(det, xp.finfo(shape.dtype).tiny) ** (-0.25 if planar else -1 / 6)


def directions_of(found: Found, u: np.ndarray) -> np.ndarray:
    """Unit vectors of the corrected readings."""
    return unit((u - found.centre) @ root(found.shape))


def in_plane(u: Any, plane: Any) -> Any:
    """Readings in the axes of a plane, with a third coordinate of zero."""
    xp = array_module(u)
    return xp.concatenate([u @ plane[:2].T, xp.zeros((len(u), 1), u.dtype)], axis=1)


def model_of(shape: Any, centre: Any, frame: Frame, size: Any, plane: Any = None) -> MagModel:
    """The model with a symmetric soft iron, for a field of magnitude `size` in scaled units."""
    xp, matrix = array_module(shape), root(shape)
    if plane is not None:  # nothing is known across the plane: use the scale within it, and the readings' own mean
        matrix = plane[:2].T @ matrix[:2, :2] @ plane[:2] + xp.outer(plane[2], plane[2]) / radius_of(shape, True)
        centre = centre[:2] @ plane[:2]
    return MagModel(xp.linalg.inv(matrix * size), frame.centre + frame.scale * centre)


def ellipsoid_of_model(model: MagModel, frame: Frame, field: Any) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of a model for a field of this magnitude: the inverse of `model_of`, for any rotation in the soft iron."""
    inverse = np.linalg.inv(np.asarray(model.soft_iron)) * frame.scale / field
    return inverse.T @ inverse, (np.asarray(model.hard_iron) - frame.centre) / frame.scale


def ellipsoid_entries(model: MagModel, field: Any) -> np.ndarray:
    """(A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) of a model, (9,), in the unit of the readings."""
    shape, centre = ellipsoid_of_model(model, Frame(np.zeros(3), 1.0), field)
    return np.concatenate([shape[ENTRIES], centre])
