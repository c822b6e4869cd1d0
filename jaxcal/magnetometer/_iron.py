"""`Estimate` of hard and soft iron from the covariance of the surface that was fitted, by the delta method."""

import functools
from typing import Any

import numpy as np

from .._precision import array_module, is_traced
from .._units import STRONGEST_FIELD
from ..fitting import Estimate
from ._ellipsoid._kinds import ENTRIES
from ._ellipsoid._shape import root, root_slopes
from ._model import MagModel

HARD = tuple(f"hard_iron[{i}]" for i in range(3))
SOFT = tuple(f"soft_iron[{i},{j}]" for i in range(3) for j in range(3))
_ALONG = 1e-9  # a component of the plane's normal below which an axis lies in the plane: rounding
#: change of a symmetric matrix with each of its entries xx, xy, xz, yy, yz, zz
UPPER = np.zeros((6, 3, 3))
UPPER[range(6), *np.triu_indices(3)] = UPPER[range(6), *np.triu_indices(3)[::-1]] = 1.0
#: change of a rotation with each entry of its vector
_TURNS = np.cross(np.eye(3), np.eye(3)[:, None]).swapaxes(1, 2)


def quantity_of(field: Any) -> str:
    """Quantity of the readings: "mag" for a field in tesla, else "counts"; "ratio" where it is traced."""
    return "ratio" if is_traced(field) else "mag" if field < STRONGEST_FIELD else "counts"


def iron(
    model: MagModel, field: Any, covariance: Any, freedom: float | int, *, given: bool, plane: Any = None, own: tuple[str, ...] = (),
    rotation: Any = None, terms: dict[str, Any] | None = None,
) -> Estimate:  # fmt: skip
    """Hard iron, soft iron, further fields of a model, fields of currents, and the field, with their covariance.

    Parameters
    ----------
    model, field : of the fit, with any rotation in the soft iron.
    covariance : of the shape's entries and the centre, (9, 9), or (5, 5) in a plane; of the leaves `own` of a model object.
    freedom : degrees of freedom of the standard errors.
    given : whether the field was given; otherwise it is the mean semi-axis.
    plane : (3, 3) two unit vectors in the plane of the readings, and its normal.
    own : names of the fitted leaves of a model object, the six entries of its symmetric soft iron first.
    rotation : (3, 3) covariance of the rotation in the soft iron; None without one.
    terms : name of a current -> (2, 3) field per unit, and its standard deviation.
    """
    xp = array_module(model, field, covariance)
    soft, further = xp.asarray(model.soft_iron), [name for name in own if name.partition("[")[0] not in ("soft_iron", "hard_iron")]
    if own:
        left, _, right = xp.linalg.svd(soft)
        order = [own.index(name) for name in (*HARD, *own[:6], *further)]
        by_soft = xp.reshape(xp.asarray(UPPER, dtype=soft.dtype) @ (left @ right), (6, 9)).T
        one = functools.partial(xp.eye, dtype=soft.dtype)
        slopes = _blocks(xp, one(3), by_soft, one(len(further)), one(1, 0))
        covariance = covariance[np.ix_(order, order)]
    else:
        slopes = iron_slopes(soft, field, given, plane)
    known = xp.isfinite(covariance).all()
    matrix = slopes @ xp.where(known, covariance, 0.0) @ slopes.T
    if rotation is not None:
        turned = np.zeros((len(slopes), 3))
        turned[3:12] = (np.asarray(soft) @ _TURNS).reshape(3, 9).T
        matrix = matrix + turned @ rotation @ turned.T
    matrix = xp.where(known, matrix, xp.inf)
    values = [xp.asarray(model.hard_iron), soft.ravel(), *(_leaf(model, name) for name in further), xp.ravel(xp.asarray(field))]
    names = (*HARD, *SOFT, *further, "field")
    quantity = quantity_of(field)
    known_quantities = {"hard_iron": quantity, "field": quantity}
    for name, (value, error) in (terms or {}).items():
        values.append(np.asarray(value))
        names += tuple(f"currents.{name}[{i}]" for i in range(3))
        known_quantities[f"currents.{name}"] = quantity
        matrix = np.block([[matrix, np.zeros((len(matrix), 3))], [np.zeros((3, len(matrix))), np.diag(np.square(error))]])
    states = {name: "held" for name in ("field",) if given or own}
    if plane is not None and not is_traced(plane):
        across = np.abs(plane[2]) > _ALONG
        states |= {name: "open" for name, out in zip(HARD, across, strict=True) if out}
        states |= {name: "open" for name, out in zip(SOFT, np.outer(across, across).ravel(), strict=True) if out}
    return Estimate(names, xp.concatenate(values), matrix, freedom, states, known_quantities)


def _leaf(model: MagModel, name: str) -> Any:
    """The value of a named leaf of a model, such as "slope[2]" or "curve.knots[1]", as (1,)."""
    path, _, place = name.partition("[")
    value: Any = model
    for part in path.split("."):
        value = getattr(value, part)
    xp = array_module(value)
    return xp.ravel(xp.asarray(value)[tuple(int(i) for i in place.rstrip("]").split(","))] if place else xp.asarray(value))


def _blocks(xp: Any, *blocks: Any) -> Any:
    """A block-diagonal matrix; the last block may have rows without columns."""
    width = sum(block.shape[1] for block in blocks)
    rows, start = [], 0
    for block in blocks:
        empty = [xp.zeros((len(block), n), dtype=block.dtype) for n in (start, width - start - block.shape[1])]
        rows.append(xp.concatenate([empty[0], block, empty[1]], axis=1))
        start += block.shape[1]
    return xp.concatenate(rows)


def iron_slopes(soft: Any, field: Any, given: bool, plane: Any = None) -> Any:
    """Derivative (13, p) of hard iron, soft iron and field with respect to the entries of the shape and the centre.

    With the shape A = C^-T C^-1 / H^2 and its root, C = A^(-1/2) Q / H for a rotation Q, which does not change.
    """
    xp, count = array_module(soft, field), 6 if plane is None else 3
    change = np.zeros((count, 3, 3))
    rows, columns = (place[:count] for place in ENTRIES)
    change[range(count), rows, columns] = change[range(count), columns, rows] = 1.0
    basis = xp.eye(3, dtype=soft.dtype) if plane is None else plane[:2]
    change = xp.asarray(change, dtype=soft.dtype)
    if plane is not None:
        change = plane.T @ change @ plane
    whole = xp.linalg.inv(soft) / field
    shape = whole.T @ whole
    inverse = xp.linalg.inv(root(shape))
    roots = xp.einsum("pe,eij->pij", change[:, *ENTRIES], root_slopes(shape))
    # C = R^-1 Q / H, so that dC = -R^-1 dR C
    by_shape = -inverse @ roots @ soft
    by_field = xp.zeros(count, dtype=soft.dtype)
    if not given:
        size = -xp.einsum("ij,pji->p", xp.linalg.inv(shape), change) / (6 if plane is None else 4)
        by_shape = by_shape - size[:, None, None] * soft[None]
        by_field = size * field
    width = count + len(basis)
    hard = xp.concatenate([xp.zeros((3, count), dtype=soft.dtype), basis.T], axis=1)
    rest = xp.zeros((10, width - count), dtype=soft.dtype)
    return xp.concatenate([hard, xp.concatenate([xp.concatenate([by_shape.reshape(count, 9).T, by_field[None]]), rest], axis=1)])
