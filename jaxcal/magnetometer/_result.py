"""`MagFit`: a magnetometer calibration with what is known about it."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np

from .._results import NORMAL95, Result, Row
from .._types import AnyArray
from ._model import MagModel


class MagFit(Result):
    """Hard and soft iron with their uncertainty, the heading error to expect, and a verdict.

    A fit of norms cannot see a rotation common to all readings: without an `alignment`, `model` is the one with a symmetric soft
    iron, and `heading_error` is that of the hard iron and of the symmetric part alone.

    Attributes
    ----------
    model : `MagModel`; None where the readings allow none.
    covariance : (9, 9) of A_xx, A_xy, A_yy, A_xz, A_yz, A_zz and the hard iron, in the units of the readings (see `names`), where
        (m - b)'A(m - b) = 1 is the ellipsoid; with what a model that was chosen may leave out. Methods other than "ml": the least that
        readings of this noise allow. In a plane (5, 5).
    heading_error : (2,) predicted rms error of the heading in rad, at level and at 20 degrees of tilt, for the dip `inclination`,
        readings without noise and a true vertical. For methods other than "ml" and "consistent" it includes the distance from "ml".
    coverage : `Coverage` of the corrected readings; None without a model.
    residual : (n,) orthogonal distance of each reading to the ellipsoid, in the unit of the readings, positive outside.
    noise : standard deviation of one axis of a reading, in its unit.
    verdict : "good", "weak" or "refused".
    reason : one sentence or more.
    field : norm of the corrected field: as given, or the cube root of the product of the ellipsoid's semi-axes.
    outliers : indices of readings more than four robust standard deviations off, or weighted below one half.
    used : number of readings that were fitted: all, or of a long log as many as there are directions to tell apart.
    needed : (3, 3) unit vectors, in the corrected field's axes, in which further readings would help most.
    condition : condition number of the fit on the unit sphere; 3 for even coverage, above 1000 the data hardly determine the model.
    inclination : dip of the field used for `heading_error`, rad.
    plane : (3, 3) for a planar fit: unit vectors of the plane, and its normal last. None otherwise.
    alignment : `Alignment` with the accelerometer, gyroscope or headings that were given; its rotation is in `model`. None otherwise.
    warnings : sentences.
    names : of the parameters of `covariance`.
    field_error : relative standard deviation with which the given field took part in the fit; None where it only scales.
    penalty : weight of the penalty on directions in a corner of the sphere; zero where the readings alone decided.
    joint : whether norms and the other sensor were fitted together; then `heading_error` has what ellipsoid and rotation have in common.
    method, kind : name of the method; "sphere", "diagonal", "symmetric", or in a plane "circle" and "ellipse".
    """

    model: MagModel | None
    covariance: AnyArray
    heading_error: AnyArray
    coverage: Any
    residual: AnyArray
    noise: float
    field: float
    outliers: AnyArray
    used: int
    needed: AnyArray
    condition: float
    inclination: float
    plane: Any
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    method: str = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    alignment: Any = None
    penalty: float = 0.0
    field_error: float | None = None
    joint: bool = eqx.field(static=True, default=False)

    def _rows(self) -> list[Row]:
        if self.model is None:
            return []
        hard, half = np.asarray(self.model.hard_iron), NORMAL95 * self.hard_iron_error
        rows = [Row(f"hard iron {axis}", b, b - h, b + h, "unit") for axis, b, h in zip("xyz", hard, half, strict=True)]
        soft = np.asarray(self.model.soft_iron)
        rows += [Row(f"soft iron {a}{b}", soft[i, j]) for i, a in enumerate("xyz") for j, b in enumerate("xyz")]
        known = getattr(self, "interval", {})
        for field in dataclasses.fields(self.model)[2:]:  # those of a subclass
            values = np.asarray(getattr(self.model, field.name))
            for entry in np.ndindex(values.shape) if np.issubdtype(values.dtype, np.floating) else ():
                name = field.name + (f"[{','.join(map(str, entry))}]" if entry else "")
                rows.append(Row(name, values[entry], *known.get(name, (np.nan, np.nan))))
        return [*rows, Row("field", self.field, unit="unit"), Row("noise of a reading", self.noise, unit="unit")]

    @property
    def hard_iron_error(self) -> np.ndarray:
        """(3,) standard deviation of the hard iron, in the unit of the readings; infinite along a plane's normal."""
        if len(self.covariance) == 9:
            return np.sqrt(np.diag(self.covariance)[6:])
        if self.plane is None or not np.isfinite(self.covariance).all():
            return np.full(3, np.inf)
        basis = np.asarray(self.plane)[:2]
        spread = np.sqrt(np.einsum("ik,ij,jk->k", basis, self.covariance[3:, 3:], basis))
        return np.where(np.abs(self.plane[2]) > 1e-6, np.inf, spread)
