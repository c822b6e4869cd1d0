"""`Estimate` of hard and soft iron, by the delta method from the covariance of the surface, or of the whole matrix, that was fitted."""

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


def quantity_of(field: Any) -> str:
    """Quantity of the readings: "mag" for a field in tesla, else "counts"; "ratio" where it is traced."""
    return "ratio" if is_traced(field) else "mag" if field < STRONGEST_FIELD else "counts"


def estimated(model: MagModel, field: Any, covariance: Any, freedom: float | int, further: dict[str, Any] | None = None,
              held: bool = True, plane: Any = None) -> Estimate:  # fmt: skip
    """Hard iron, soft iron, the field and `further` parameters (name -> value), in this order, with their covariance."""
    xp, quantity, further = array_module(model, field, covariance), quantity_of(field), further or {}
    known = xp.isfinite(covariance).all()
    covariance = xp.where(known, covariance, xp.inf)
    values = [
        xp.asarray(model.hard_iron),
        xp.asarray(model.soft_iron).ravel(),
        *(xp.ravel(xp.asarray(v)) for v in (field, *further.values())),
    ]
    states = {"field": "held"} if held else {}
    if plane is not None and not is_traced(plane):
        across = np.abs(plane[2]) > _ALONG
        states |= {name: "open" for name, out in zip(HARD, across, strict=True) if out}
        states |= {name: "open" for name, out in zip(SOFT, np.outer(across, across).ravel(), strict=True) if out}
    quantities = {"hard_iron": quantity, "field": quantity}
    quantities |= {name.partition("[")[0]: quantity for name in further if name.startswith("currents.")}
    return Estimate((*HARD, *SOFT, "field", *further), xp.concatenate(values), covariance, freedom, states, quantities)


def by_surface(soft: Any, field: Any, covariance: Any, given: bool, plane: Any = None) -> Any:
    """Covariance (13, 13) of hard iron, soft iron and field from that of the entries of the shape and of the centre.

    With the shape A = C^-T C^-1 / H^2 and its root, C = A^(-1/2) Q / H for a rotation Q, which does not change.
    """
    slopes = iron_slopes(soft, field, given, plane)
    xp = array_module(soft, field, covariance)
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


def iron_slopes(soft: Any, field: Any, given: bool, plane: Any = None) -> Any:
    """Derivative (13, p) of hard iron, soft iron and field with respect to the entries of the shape and the centre."""
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
