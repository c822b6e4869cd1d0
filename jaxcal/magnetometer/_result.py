"""`MagFit`: a magnetometer calibration with its uncertainty, the heading error to expect, and what to know about it."""

import dataclasses
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from .._answer import Finding, Grid, Number, Result, Section, by_axis, listed
from .._frozen import made, replaced
from .._types import AnyArray
from ..fitting import Estimate
from ..fitting._serial import BLOCKS
from ._design._heading_error import heading_error
from ._ellipsoid._kinds import ENTRIES
from ._ellipsoid._shape import ellipsoid_entries
from ._findings import FINDINGS
from ._iron import iron, quantity_of
from ._judge import LIMITS, judge
from ._model import MagModel

NO_ESTIMATE = Estimate((), np.zeros(0), np.zeros((0, 0)))
_NINETEEN = 2.1  # actual over stated error that 95.4 % of 800 simulated logs stayed below
_LARGEST = 30.0  # degrees: a larger predicted error only says that the heading is open, because it comes from first derivatives


class Facts(eqx.Module):
    """What the verdict and later computations need besides the results of a `MagFit`.

    covariance : of the shape's entries and the centre in the unit of the readings, (9, 9), in a plane (5, 5), or of the leaves `own` of a
    model object. known : findings that no later step changes. given : whether the field was given. limits : heading errors in rad above
    which a fit is weak and refused. weakest : the parameters that the readings determine least, in words. parts : whether the covariance
    comes from fits without parts of the log. used : number of fitted readings. usual : median of each condition of a model object.
    penalty, field_error : of the fit. terms : name of a current -> (2, 3) field per unit and its standard deviation.
    """

    covariance: AnyArray
    used: int = 0
    given: bool = eqx.field(static=True, default=False)
    known: tuple[Finding, ...] = eqx.field(static=True, default=())
    limits: tuple[float, float] = eqx.field(static=True, default=LIMITS)
    weakest: str = eqx.field(static=True, default="")
    parts: bool = eqx.field(static=True, default=False)
    own: tuple[str, ...] = eqx.field(static=True, default=())
    usual: dict[str, Any] = eqx.field(default_factory=dict)
    penalty: float = 0.0
    field_error: float | None = None
    terms: dict[str, Any] = eqx.field(default_factory=dict)
    condition: float = np.nan


class MagFit(Result):
    """Hard and soft iron with their uncertainty, the heading error to expect, and findings.

    Field magnitudes cannot show a rotation common to all readings. Without an `alignment`, `model` has a symmetric soft iron, and
    `heading_error` covers the errors of the hard iron and of the symmetric soft iron only.

    Attributes
    ----------
    model : `MagModel`; None if the readings determine none.
    estimate : `jaxcal.fitting.Estimate` of `hard_iron[i]`, `soft_iron[i,j]`, further fields of a model object, `currents.NAME[i]` of
        `fit_current`, and `field`, in the unit of the readings. It includes what a smaller model may leave out, the biases that the
        residuals show, and the rotation. Its five degrees of freedom say that the residuals are not white, and that the covariance comes
        from fits without parts of the log.
    heading_error : (2,) predicted rms error of the heading in rad, at level and at 20 degrees of tilt. It holds for the dip `inclination`,
        readings without noise and a true vertical. For "constrained" it includes the difference from "ml".
    field : magnitude of the corrected field: as given, or the cube root of the product of the ellipsoid's semi-axes.
    noise : standard deviation of one axis of a reading, in its unit.
    coverage : `Coverage` of the corrected readings; None without a model.
    residual : (n,) orthogonal distance of each reading to the ellipsoid, in the unit of the readings, positive outside.
    outliers : indices of readings more than four robust standard deviations off.
    needed : (3, 3) unit vectors, in the corrected field's axes, in which further readings would help most.
    inclination : dip of the field used for `heading_error`, rad: as given, from the accelerometer, or 57 degrees.
    down : (3,) axis that points down at level, used for `heading_error`, in the axes of the magnitude fit (before the rotation by
        `alignment`): the mean vertical of an accelerometer, or the axis about which the sensor turned. None for a sensor turned through
        all attitudes; the error then is the mean over all axes.
    plane : (3, 3) for a planar fit: two unit vectors in the plane, then its normal. None otherwise.
    alignment : `Alignment` with the given accelerometer, gyroscope or headings; `model` includes its rotation. None otherwise.
    check : `Check` of readings that were held back from the fit; None otherwise.
    method : name of the method; "joint" for a fit together with another sensor.
    kind : "sphere", "diagonal", "symmetric", in a plane "circle" and "ellipse", or the class of a model object.
    findings : what to know. The verdict is "not judged" under `jit`, `vmap` and `grad`, where coverage, outliers and `needed` are empty.

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
    _facts: Facts
    coverage: Any = None
    outliers: AnyArray = eqx.field(default_factory=lambda: np.zeros(0, dtype=int))
    needed: AnyArray = eqx.field(default_factory=lambda: np.zeros((0, 3)))
    down: Any = None
    plane: Any = None
    alignment: Any = None
    check: Any = None
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

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
        return f"heading error {level:.2g} deg; 19 of 20 logs: below {_NINETEEN * level:.2g} deg"

    def sections(self) -> list[Section]:
        """Correction of a reading, field and noise; then soft iron, heading error, coverage, rotation and check in detail."""
        if self.model is None:
            return []
        labels = {name: f"{name}, per unit" for name in self._facts.terms}
        quantity, numbers = quantity_of(self.field), self.estimate.numbers()
        soft = [one for one in numbers if one.name.startswith("soft_iron")]
        hard, rest = ([one for one in numbers if one not in soft and one.name.startswith("hard_iron") == first] for first in (True, False))
        noise = Number("noise", float(self.noise), quantity=quantity)
        found: list[Section] = [
            by_axis("magnetometer", "magnetometer", [*hard, *self._correction(), *rest, noise], labels,
                    note="Multiply the matrix of the correction by (reading - hard iron)."),
            by_axis("soft_iron", "soft iron, which the correction undoes", soft, detail=True),
            listed("heading", "heading error and readings", self._details(), detail=True),
        ]  # fmt: skip
        wanted = [Number(f"needed_{i + 1}[{j}]", float(value)) for i, way in enumerate(self.needed) for j, value in enumerate(way)]
        if wanted:
            names = {f"needed_{i + 1}": f"direction {i + 1}" for i in range(3)}
            found.append(by_axis("needed", "where readings help most", wanted, names, detail=True))
        if self.alignment is not None:
            found += [_within("alignment", grid)._replace(detail=True) for grid in self.alignment.sections()]
        return found if self.check is None else [*found, *(_within("check", grid) for grid in self.check.sections())]

    def _correction(self) -> list[Number]:
        """The inverse of the soft iron, which corrects a reading, with intervals: dW = -W dC W."""
        assert self.model is not None
        matrix = np.linalg.inv(np.asarray(self.model.soft_iron))
        part = self.estimate.select("soft_iron*")
        slopes = -np.einsum("ik,lj->ijkl", matrix, matrix).reshape(9, 9)
        known = np.isfinite(np.asarray(part.matrix)).all()
        names = [f"correction[{i},{j}]" for i in range(3) for j in range(3)]
        spread = slopes @ np.asarray(part.matrix) @ slopes.T if known else np.full((9, 9), np.inf)
        states = {new: part.states[old] for new, old in zip(names, part.names, strict=True) if old in part.states}
        return Estimate(names, matrix.ravel(), spread, part.freedom, states).numbers()

    def _details(self) -> list[tuple[str, Number]]:
        facts, cover = self._facts, self.coverage
        rows = {
            "at level": Number("heading_error", float(self.heading_error[0]), quantity="angle"),
            "at 20 deg of tilt": Number("heading_error_tilted", float(self.heading_error[1]), quantity="angle"),
            "dip of the field": Number("inclination", float(self.inclination), quantity="angle"),
            "readings": Number("readings", len(self.residual)), "readings fitted": Number("used", facts.used),
            "outliers": Number("outliers", len(self.outliers)), "condition number": Number("condition", float(facts.condition)),
            "weight of the penalty": Number("penalty", float(facts.penalty)),
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


def finished(found: MagFit, **changes: Any) -> MagFit:
    """The fit with some fields changed, and with the estimate and findings that follow: every path to a `MagFit` ends here."""
    found = replaced(found, **changes)
    facts, turn = found._facts, found.alignment
    if found.model is None:
        return replaced(found, findings=facts.known)
    freedom = BLOCKS - 1 if facts.parts else max(facts.used - len(facts.covariance), 1)
    rotation = None if turn is None or turn.verdict == "refused" else np.asarray(turn.covariance)
    estimate = iron(
        found.model, found.field, facts.covariance, freedom, given=facts.given, plane=found.plane, own=facts.own, rotation=rotation,
        terms=facts.terms,
    )  # fmt: skip
    return replaced(found, estimate=estimate, findings=judge(found, facts))


def unfitted(method: str, dip: float, *findings: Finding) -> MagFit:
    """A fit without a model."""
    return made(
        MagFit, model=None, estimate=NO_ESTIMATE, heading_error=np.full(2, np.inf), field=np.inf, noise=np.inf, residual=np.zeros(0),
        inclination=dip, method=method, kind="none", findings=findings, _facts=Facts(np.full((9, 9), np.inf), known=findings),
    )  # fmt: skip


def not_judged(method: str, dip: float, kind: str, facts: Facts, **told: Any) -> MagFit:
    """A traced fit."""
    facts = dataclasses.replace(facts, known=(FINDINGS("not_judged"),))
    return finished(unfitted(method, dip), kind=kind, _facts=facts, **told)


def widened(found: MagFit, by: np.ndarray, more: np.ndarray | None = None, **facts: Any) -> MagFit:
    """The fit with a further covariance `by` (9, 9) of the shape's entries and the centre, and with other `facts`.

    more : the further heading error, if it does not follow from `by`.
    """
    shape, old = np.zeros((3, 3)), np.asarray(found.heading_error)
    shape[ENTRIES] = shape[ENTRIES[::-1]] = ellipsoid_entries(found.model, found.field)[:6]  # type: ignore[arg-type]
    further = np.asarray(heading_error(shape, by, found.inclination, found.down) if more is None else more)
    error = np.hypot(old, further)
    known = dataclasses.replace(found._facts, covariance=found._facts.covariance + by, **facts)
    return finished(found, heading_error=error, _facts=known)
