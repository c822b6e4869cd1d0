"""`MagFit`: a magnetometer calibration with its uncertainty, the heading error to expect, and what to know about it."""

from typing import Any, ClassVar

import equinox as eqx
import jax
import numpy as np

from .._answer import Finding, Grid, Number, Result, Section, by_axis, listed
from .._special import NORMAL95, student_quantile
from .._types import AnyArray
from .._units import BEYOND
from ..fitting import Estimate
from ._directions import HEADINGS, heading_at, needed
from ._model import MagModel
from ._quadric import PLACE, outliers
from ._surface import between

HARD = tuple(f"hard_iron[{i}]" for i, _ in enumerate(PLACE))
SOFT = tuple(f"soft_iron[{i},{j}]" for i, j in np.ndindex(*PLACE.shape))
_NINETEEN = 2.1  # actual over stated error that 95.4 % of 800 simulated logs stayed below
_TILTS = (10, 20, 45)  # degrees: a gust, a turn, and the steepest turn of an ordinary flight
_LARGEST = 30.0  # degrees: a larger predicted error only says that the heading is open, because it comes from first derivatives


def quantity_of(size: Any) -> str:
    """Quantity of readings of this size: "mag" for a field in tesla, else "counts"; "ratio" where it is traced."""
    return "ratio" if isinstance(size, jax.Array) else "mag" if size < BEYOND["mag"] else "counts"


class MagFit(Result):
    """Hard and soft iron with their uncertainty, the heading error to expect, and findings.

    Field magnitudes cannot show a rotation common to all readings. Without an `alignment`, `model` has a symmetric soft iron, and
    `heading_error` covers the errors of the hard iron and of the symmetric soft iron only.

    Attributes
    ----------
    model : `MagModel`; None if the readings determine none.
    estimate : `jaxcal.fitting.Estimate` of `hard_iron[i]`, `soft_iron[i,j]`, `field`, further fields of a model object, and the fields
        of currents `currents.NAME[i]`, in the unit of the readings. It includes what a smaller model may leave out, what the residuals
        follow, and the rotation. Five degrees of freedom say that the residuals are not white, and that the covariance comes from fits
        without parts of the log.
    heading_error : (2,) predicted rms error of the heading in rad, at level and at 20 degrees of tilt. It holds for the dip `inclination`,
        readings without noise and a true vertical. For "constrained" it includes the difference from "ml".
    field : magnitude of the corrected field: as given, or the cube root of the product of the ellipsoid's semi-axes.
    noise : standard deviation of one axis of a reading, in its unit.
    residual : (n,) distance of each reading to the ellipsoid, in the unit of the readings, positive outside.
    inclination : dip of the field used for `heading_error`, rad: as given, from the accelerometer, or 57 degrees.
    method : name of the method; "joint" for a fit together with another sensor or with currents.
    kind : "sphere", "diagonal", "symmetric", "planar" for readings in a plane, "full" with another sensor, or the class of a model object.
    coverage : `Coverage` of the corrected readings; None without a model.
    down : (3,) axis that points down at level, used for `heading_error`, in the axes of the corrected field: the mean vertical of an
        accelerometer, or the axis about which the sensor turned. None for a sensor turned through all attitudes; the error then is the
        mean over all axes.
    alignment : `Alignment` with the given accelerometer, gyroscope or headings; `model` includes its rotation. None otherwise.
    check : `Check` of readings that were held back from the fit; None otherwise.
    findings : what to know. The verdict is "not judged" under `jit`, `vmap` and `grad`, where coverage is None.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, fit, scenario
    >>> found = fit(body_field(scenario("all"), 50e-6))
    >>> found.verdict, found.kind, f"{found.field:.1e} T"
    ('good', 'sphere', '5.0e-05 T')
    """

    model: MagModel | None
    estimate: Estimate
    heading_error: AnyArray
    field: float | AnyArray
    noise: float | AnyArray
    residual: AnyArray
    inclination: float
    method: str = eqx.field(static=True)
    kind: str = eqx.field(static=True)
    coverage: Any = None
    down: Any = None
    alignment: Any = None
    check: Any = None
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())
    #: numbers of the fit for its tables, and "usual": median of each condition of a model object
    _about: dict[str, Any] = eqx.field(default_factory=dict)

    _figure: ClassVar = ("sphere", True)

    @property
    def verdict(self) -> Any:
        """The worst severity of the findings: "good", "weak" or "refused"; "not judged" for a traced fit."""
        return "not judged" if "not_judged" in self.codes else super().verdict

    @property
    def headline(self) -> str:
        """The heading error to expect, in degrees."""
        if self.model is None:
            return "no calibration"
        level = float(np.rad2deg(self.heading_error[0]))
        if not level < _LARGEST:
            return "the heading stays open"
        return f"heading error {level:.2g} deg; 19 of 20 logs: below {np.rad2deg(self.heading_limit):.2g} deg"

    @property
    def heading_limit(self) -> float:
        """Level heading error in rad that 19 of 20 logs stay below; wider where few white readings leave the noise uncertain itself."""
        few = 1.0 if "correlated" in self.codes else student_quantile(self.estimate.freedom[0], 0.975) / NORMAL95
        return float(_NINETEEN * few * self.heading_error[0])

    @property
    def outliers(self) -> np.ndarray:
        """Indices of readings more than four robust standard deviations off."""
        return outliers(np.asarray(self.residual) / float(self.field)) if len(self.residual) else np.zeros(0, dtype=int)

    @property
    def needed(self) -> np.ndarray:
        """(3, 3) unit vectors, in the corrected field's axes, in which further readings would help most; (0, 3) if unknown."""
        return (
            np.zeros((0, 3)) if self.model is None else needed(self.model, float(self.field), self.kind, np.asarray(self.estimate.matrix))
        )

    def sections(self) -> list[Section]:
        """What corrects a reading, field and noise; then soft iron, heading error, coverage, rotation and check in detail."""
        if self.model is None:
            return []
        quantity, numbers = self.estimate.quantity("field"), self.estimate.numbers()
        soft = [one for one in numbers if one.name.startswith("soft_iron")]
        hard, rest = ([one for one in numbers if one not in soft and one.name.startswith("hard_iron") == first] for first in (True, False))
        currents = {one.name.removeprefix("currents.").rpartition("[")[0] for one in rest if one.name.startswith("currents.")}
        labels = {name: f"{name}, per unit" for name in currents}
        noise, shown = Number("noise", float(self.noise), quantity=quantity), [*hard, *self._correction(), *rest]
        if not np.rad2deg(self.heading_error[0]) < _LARGEST:  # where the heading stays open, no number of the model is known
            shown = [one._replace(state="open") for one in shown]
        found: list[Section] = [
            by_axis("magnetometer", "magnetometer", [*shown, noise], labels,
                    note="corrected = A (reading - b), with the correction A and the hard iron b."),
            by_axis("soft_iron", "soft iron, which the correction undoes", soft, detail=True),
            listed("heading", "heading error and readings", self._details(), detail=True),
        ]  # fmt: skip
        if self.kind in ("planar", "full"):
            found.append(self.card())
        if self.alignment is not None:
            found += [_within("alignment", grid)._replace(detail=True) for grid in self.alignment.sections()]
        return found if self.check is None else [*found, *(_within("check", grid) for grid in self.check.sections())]

    def card(self, step: int = 30) -> Grid:
        """The deviation card: standard deviation of level headings, for every `step` degrees of heading."""
        degrees = np.arange(0, 360, step)
        errors = heading_at(self, np.deg2rad(degrees))
        rows = [(f"{degree:03d} deg", (Number(f"card[{degree}]", float(error), quantity="angle"),))
                for degree, error in zip(degrees.tolist(), errors, strict=True)]  # fmt: skip
        return Grid("card", "deviation card: error of the heading", ("error",), tuple(rows), detail=True)

    def _correction(self) -> list[Number]:
        """The inverse of the soft iron, which corrects a reading, with intervals: dW = -W dC W."""
        assert self.model is not None
        matrix = np.linalg.inv(np.asarray(self.model.soft_iron))
        part = self.estimate.select("soft_iron*")
        slopes = -np.einsum("ik,lj->ijkl", matrix, matrix).reshape(9, 9)
        names = [f"correction[{i},{j}]" for i in range(3) for j in range(3)]
        return Estimate(names, matrix.ravel(), between(slopes, np.asarray(part.matrix)), part.freedom).numbers()

    def _tilted(self) -> dict[str, Number]:
        """What a tilt does to the heading: its error where the vehicle is tilted; a plane has none."""
        tilts, yaw = (_TILTS if np.isfinite(self.heading_error[1]) else ()), HEADINGS
        found = {tilt: np.sqrt(np.mean(heading_at(self, yaw, tilt=np.deg2rad(tilt)) ** 2)) for tilt in tilts}
        return {f"at {tilt} deg of tilt": Number(f"heading_error_{tilt}", float(one), quantity="angle") for tilt, one in found.items()}

    def _details(self) -> list[tuple[str, Number]]:
        about, cover = self._about, self.coverage
        rows = {
            "at level": Number("heading_error", float(self.heading_error[0]), quantity="angle"),
            **self._tilted(),
            "dip of the field": Number("inclination", float(self.inclination), quantity="angle"),
            "readings": Number("readings", len(self.residual)), "readings fitted": Number("used", about.get("used", np.nan)),
            "outliers": Number("outliers", len(self.outliers)), "condition number": Number("condition", about.get("condition", np.nan)),
        }  # fmt: skip
        if cover is not None:
            rows["directions seen"] = Number("coverage.occupied", 100 * cover.occupied, quantity="%")
            rows["largest gap"] = Number("coverage.largest_gap", cover.largest_gap, quantity="angle")
        return [(label, one) for label, one in rows.items() if np.isfinite(one.value)]


def _within(name: str, grid: Any) -> Grid:
    """The table of a part of the fit, with the part's name before those of its numbers."""
    rows = tuple(
        (label, tuple(cell._replace(name=f"{name}.{cell.name}") if isinstance(cell, Number) else cell for cell in cells))
        for label, cells in grid.rows
    )
    return grid._replace(rows=rows)
