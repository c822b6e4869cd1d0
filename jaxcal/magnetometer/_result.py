"""`MagFit`, a calibration with its uncertainty and what to know about it; `check`, how well it does on other readings."""

from typing import Any, ClassVar

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Grid, Number, Result, Section, by_axis, listed
from .._errors import DataError
from .._precision import host_float64
from .._special import NORMAL95, student_quantile
from .._types import AnyArray, Samples
from ..fitting import Estimate
from ._aids import vectors, verticals
from ._field import HEADINGS, STEEPEST, Coverage, coverage, heading
from ._findings import FINDINGS
from ._judge import distance_slopes, heading_uncertainty, needed, outliers
from ._model import MagModel, changes_of
from ._quadric import EXACT, unit
from ._surface import between

_NINETEEN = 2.1  # actual over stated error that 95.4 % of 800 simulated logs stayed below
_TILTS = (10, 20, 45)  # degrees: a gust, a turn, and the steepest turn of an ordinary flight
_LARGEST = 30.0  # degrees: a larger predicted error only says that the heading is open, because it comes from first derivatives
_PARAMETERS = 3.0  # approximate degrees of freedom of a heading error: the hard iron dominates it


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
    down : (3,) axis that points down at level, used for `heading_error`, in the axes of the corrected field: the mean vertical of an
        accelerometer, or the axis about which the sensor turned. None for a sensor turned through all attitudes; the error then is the
        mean over all axes.
    alignment : `Alignment` with the given accelerometer, gyroscope or headings; `model` includes its rotation. None otherwise.
    check : `Check` of readings that were held back from the fit, or of those with a known heading; None otherwise.
    findings : what to know. The verdict is "not judged" under `jit`, `vmap` and `grad`.

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
    down: Any = None
    alignment: Any = None
    check: "Check | None" = None
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())
    #: numbers of the fit for its tables; "corrected": all readings; "usual": median of each condition of a model object
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
    def coverage(self) -> Coverage | None:
        """`Coverage` of the corrected readings; None without a model, and under `jit`, `vmap` and `grad`."""
        y = self._about.get("corrected")
        return None if y is None else coverage(y[np.any(y != 0.0, axis=1)])

    @property
    def outliers(self) -> np.ndarray:
        """Indices of readings more than four robust standard deviations off."""
        return outliers(np.asarray(self.residual) / float(self.field)) if len(self.residual) else np.zeros(0, dtype=int)

    @property
    def needed(self) -> np.ndarray:
        """(3, 3) unit vectors, in the corrected field's axes, in which further readings would help most; (0, 3) if unknown."""
        return needed(self.model, float(self.field), self.kind, np.asarray(self.estimate.matrix))

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
        errors = heading_uncertainty(self, np.deg2rad(degrees))
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
        found = {tilt: np.sqrt(np.mean(heading_uncertainty(self, yaw, tilt=np.deg2rad(tilt)) ** 2)) for tilt in tilts}
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


class Check(Result):
    """Errors of a calibration on readings, beside the errors to expect.

    Attributes
    ----------
    norm, expected_norm : rms of (magnitude of the corrected reading / field - 1): found, and expected from noise and calibration error.
    heading, expected_heading : rms heading error in rad: found, and expected. NaN without known headings.
    count : number of readings.
    table : (k, 5) one row for each sector of 30 degrees with readings: heading in rad, number of readings, mean heading error and its
        standard deviation in rad, rms of the magnitude error.
    findings : one if an error exceeds the expected one by more than chance (5 %) explains.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, check, scenario
    >>> m = body_field(scenario("all"), 50.0) + 0.1 * np.random.default_rng(0).normal(size=(360, 3))
    >>> seen = check(jaxcal.magnetometer.fit(m[:200]), m[200:])
    >>> seen.verdict, seen.count
    ('good', 160)
    """

    norm: float
    expected_norm: float
    heading: float
    expected_heading: float
    count: int
    table: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The error of the readings checked, and the expected one."""
        if np.isfinite(self.heading):
            return f"headings off by {np.rad2deg(self.heading):.2g} deg rms, {np.rad2deg(self.expected_heading):.2g} deg expected"
        return f"magnitudes off by {100 * self.norm:.2g} % rms, {100 * self.expected_norm:.2g} % expected"

    def sections(self) -> list[Section]:
        """Errors beside the expected ones, and the errors by heading."""
        rows = {
            "readings checked": Number("count", self.count), "their magnitudes are off by": Number("norm", 100 * self.norm, quantity="%"),
            "expected": Number("expected_norm", 100 * self.expected_norm, quantity="%"),
            "their headings are off by": Number("heading", self.heading, quantity="angle"),
            "expected ": Number("expected_heading", self.expected_heading, quantity="angle"),
        }  # fmt: skip
        units = {"readings": "ratio", "error": "angle", "scatter": "angle", "norm": "ratio"}
        cells = [
            (f"at {np.rad2deg(heading):.0f} deg", tuple(Number(f"at[{i}].{name}", float(x), quantity=units[name])
                                                        for name, x in zip(units, row, strict=True)))
            for i, (heading, *row) in enumerate(np.asarray(self.table))
        ]  # fmt: skip
        return [
            listed("check", "check", [(label, one) for label, one in rows.items() if np.isfinite(one.value)]),
            Grid("by_heading", "errors by heading", ("readings", "error (rad)", "scatter (rad)", "magnitude"), tuple(cells), detail=True),
        ]


@host_float64
def check(
    found: MagFit, m: Samples, *, accel: Samples | None = None, headings: Samples | None = None, conditions: dict[str, Any] | None = None
) -> Check:  # fmt: skip
    r"""Errors of a calibration on readings that were held back from it, beside the errors that it predicts.

    The magnitude of a corrected reading, divided by the field, has the variance

    .. math:: \frac{\sigma^2}{H^2} |C^{-T} \hat y|^2 + r\,\mathrm{Cov}\,r^T

    where r are the slopes of the magnitude with respect to shape and hard iron. The variance of a heading is the sum of the calibration's
    variance and that of the reading's own noise.

    Parameters
    ----------
    found : a fit with a model that is not planar.
    m : (n, 3) readings that `found` has not seen, in its unit.
    accel : (n, 3) specific force at rest, in the axes of the corrected field. It gives the dip, and headings of a sensor that is not level.
    headings : (n,) known magnetic headings in rad; NaN where a heading is unknown.
    conditions : what a model object takes, one row for each reading; its median in the fit where it is not given. The variance is that in
        usual conditions.

    Returns
    -------
    Check

    Raises
    ------
    DataError
        If the fit has no model, or the shapes differ.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, check, scenario
    >>> m = body_field(scenario("all"), 50.0) + 0.1 * np.random.default_rng(0).normal(size=(360, 3))
    >>> found = jaxcal.magnetometer.fit(m[::2])
    >>> print(check(found, m[1::2]).verdict)
    good

    References
    ----------
    First-order propagation; the limit is the 95 % quantile of the F distribution.
    """
    if found.model is None or found.kind == "planar":
        raise DataError("A check needs a fit with a model that is not planar.", code="no_model")
    m = vectors(m, "readings")
    if not len(m) or not np.isfinite(m).all():
        raise DataError(f"A check needs readings that are finite numbers; got {len(m)}.", code="not_finite")
    inverse, field, usual = np.linalg.inv(np.asarray(found.model.soft_iron)), float(found.field), found._about.get("usual")
    given = {name: np.broadcast_to(value, (len(m), *np.shape(value))) for name, value in (usual or {}).items()} | (conditions or {})
    y = np.asarray(found.model.correct(m, **given))
    u = unit(y)
    off, push = np.linalg.norm(y, axis=1) / field - 1, np.linalg.norm(u @ inverse, axis=1)
    # the slope of the magnitude is that of the distance times the length of the surface's normal, C^-T y
    rows = distance_slopes(found.model, field, u) * push[:, None] / field if usual is None else changes_of(found.model, field, usual, u, u)
    known = np.asarray(found.estimate.matrix)[: rows.shape[1], : rows.shape[1]]
    variance = (found.noise / field * push) ** 2 + np.sum((rows @ known) * rows, axis=1)
    norm, expected = float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(variance))) if np.isfinite(known).all() else np.inf
    up = np.tile([0.0, 0.0, -1.0], (len(m), 1)) if accel is None else verticals(accel)
    of = np.full(len(m), np.nan) if headings is None else np.asarray(headings, dtype=float)
    if up.shape != m.shape or of.shape != m.shape[:1]:
        raise DataError(f"{len(m)} readings, {len(up)} rows of specific force, {of.size} headings; give equally many.", code="rows_differ")
    level, measured = np.sqrt(1 - np.clip(np.sum(u * up, axis=1), -1, 1) ** 2), np.full(len(m), np.nan)
    if headings is not None or accel is not None:
        flat = level > STEEPEST
        measured[flat] = np.asarray(heading(y[flat], 9.81 * up[flat]))
    error = np.angle(np.exp(1j * (measured - of)))
    there, rms, told = np.isfinite(error), float("nan"), float("nan")
    if there.any():
        rms = float(np.sqrt(np.mean(error[there] ** 2)))
        told = float(np.hypot(found.heading_error[int(accel is not None)], np.sqrt(np.mean((found.noise / field / level[there]) ** 2))))
    most = float(np.sqrt(scipy.special.fdtri(_PARAMETERS, float(found.estimate.freedom[0]), 0.95)))
    wrong = norm > max(most * expected, EXACT) or rms > max(most * told, EXACT)  # the second is false without known headings
    said = (FINDINGS("check", count=len(m)),) if wrong else ()
    return Check(norm, expected, rms, told, len(m), _table(measured if headings is None else of, error, off), said)


def _table(of: np.ndarray, error: np.ndarray, off: np.ndarray) -> np.ndarray:
    """One row for each sector with readings."""
    there, sectors = np.isfinite(of), HEADINGS[::2]
    sector, rows = np.round(of[there] / sectors[1]) % len(sectors), []
    for one in np.unique(sector):
        here = sector == one
        turned = error[there][here]
        rows.append((sectors[int(one)], np.sum(here), np.mean(turned), np.std(turned), np.sqrt(np.mean(off[there][here] ** 2))))
    return np.array(rows, dtype=float).reshape(-1, 5)
