"""`MagFit`: a magnetometer calibration with what is known about it."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
import scipy.stats

from .._results import NORMAL95, Result, Row
from .._types import AnyArray
from ._ellipsoid._shape import NAMES
from ._model import MagModel

NOT_JUDGED = "The fit was traced: nothing was chosen and nothing is judged. Call `fit` outside of jit, vmap and grad for a verdict."


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
    verdict : "good", "weak" or "refused"; "not judged" under `jit`, `vmap` and `grad`, where coverage, outliers, `needed` and
        `condition` are left empty.
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
    values : of the parameters in `names`; `parameters` and `interval` have them by name.
    method, kind : name of the method; "sphere", "diagonal", "symmetric", or in a plane "circle" and "ellipse".
    """

    model: MagModel | None
    covariance: AnyArray
    heading_error: AnyArray
    coverage: Any
    residual: AnyArray
    noise: float | AnyArray
    field: float | AnyArray
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
    values: AnyArray = eqx.field(default_factory=lambda: np.zeros(0))

    @property
    def parameters(self) -> dict[str, float]:
        """Value of each parameter by its name, in the units of the readings."""
        values = np.asarray(self.values)
        if self.model is not None and not len(values):
            matrix, hard = np.linalg.inv(np.asarray(self.model.soft_iron)) / self.field, np.asarray(self.model.hard_iron)
            shape, basis = matrix.T @ matrix, np.eye(3) if self.plane is None else np.asarray(self.plane)[:2]
            shape, j = basis @ shape @ basis.T, [(0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2)][: 6 if self.plane is None else 3]
            values = np.concatenate([shape[tuple(np.transpose(j))], basis @ hard])
        return dict(zip(self.names, values.tolist(), strict=True)) if len(values) else {}

    @property
    def interval(self) -> dict[str, tuple[float, float]]:
        """95 % interval of each parameter by its name: (low, high), by Student's t."""
        if self.model is None:
            return {}
        half = scipy.stats.t.ppf(0.975, max(self.used - len(self.names), 1)) * np.sqrt(np.diag(self.covariance))
        return {name: (value - h, value + h) for (name, value), h in zip(self.parameters.items(), half.tolist(), strict=True)}

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
        if self.plane is None and self.names and "hard_iron[0]" in self.names:
            first = self.names.index("hard_iron[0]")
            return np.sqrt(np.diag(self.covariance)[first : first + 3])
        if len(self.covariance) == 9:
            return np.sqrt(np.diag(self.covariance)[6:])
        if self.plane is None or not np.isfinite(self.covariance).all():
            return np.full(3, np.inf)
        basis = np.asarray(self.plane)[:2]
        spread = np.sqrt(np.einsum("ik,ij,jk->k", basis, self.covariance[3:, 3:], basis))
        return np.where(np.abs(self.plane[2]) > 1e-6, np.inf, spread)


def refusal(method: str, dip: float, reason: str) -> MagFit:
    """A fit without a model."""
    return MagFit(
        model=None, covariance=np.full((9, 9), np.inf), heading_error=np.full(2, np.inf), coverage=None, residual=np.zeros(0), noise=np.inf,
        field=np.inf, outliers=np.zeros(0, dtype=int), used=0, needed=np.zeros((0, 3)), condition=np.inf, inclination=dip, plane=None,
        verdict="refused", reason=reason, warnings=(), names=NAMES, method=method, kind="none",
    )  # fmt: skip
