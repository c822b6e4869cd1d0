"""`check`: how well a calibration does on readings that it has not seen, or on readings with known headings."""

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._answer._sections import Grid
from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Samples
from ._aids import like, still, vectors
from ._directions import HEADINGS, distance_slopes
from ._field import STEEPEST, heading
from ._findings import FINDINGS
from ._quadric import EXACT, unit
from ._result import MagFit

_PARAMETERS = 3.0  # approximate degrees of freedom of a heading error: the hard iron dominates it


class Check(Result):
    """Errors of a calibration on readings, beside the errors to expect.

    Attributes
    ----------
    norm, expected_norm : rms of (magnitude of the corrected reading / field - 1): found, and expected from noise and calibration error.
    heading, expected_heading : rms heading error in rad: found, and expected. NaN without known headings.
    dip : (2,) mean and standard deviation of the dip in rad; NaN without an accelerometer.
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
    dip: AnyArray
    count: int
    table: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The error of the readings held back, and the expected one."""
        if np.isfinite(self.heading):
            return f"headings off by {np.rad2deg(self.heading):.2g} deg rms, {np.rad2deg(self.expected_heading):.2g} deg expected"
        return f"magnitudes off by {100 * self.norm:.2g} % rms, {100 * self.expected_norm:.2g} % expected"

    def sections(self) -> list[Section]:
        """Errors beside the expected ones, and the errors by heading."""
        rows = {
            "readings held back": Number("count", self.count), "their magnitudes are off by": Number("norm", 100 * self.norm, quantity="%"),
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
        columns = ("readings", "error (rad)", "scatter (rad)", "magnitude")
        return [
            listed("check", "check", [(label, one) for label, one in rows.items() if np.isfinite(one.value)]),
            Grid("by_heading", "residuals by heading", columns, tuple(cells), detail=True),
        ]


@host_float64
def check(found: MagFit, m: Samples, *, accel: Samples | None = None, headings: Samples | None = None) -> Check:
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
    if found.model is None or found.kind == "planar" or "usual" in found._about:
        raise DataError("A check needs a fit with a model that is not planar, and no model object.", code="no_model")
    m = vectors(m, "readings")
    if not len(m) or not np.isfinite(m).all():
        raise DataError(f"A check needs readings that are finite numbers; got {len(m)}.", code="not_finite")
    inverse, field = np.linalg.inv(np.asarray(found.model.soft_iron)), float(found.field)
    y = (m - np.asarray(found.model.hard_iron)) @ inverse.T
    off, push = np.linalg.norm(y, axis=1) / field - 1, np.linalg.norm(unit(y) @ inverse, axis=1)
    # the slope of the magnitude is that of the distance times the length of the surface's normal, C^-T y
    rows, known = distance_slopes(found.model, field, unit(y)) * push[:, None] / field, np.asarray(found.estimate.matrix)[:13, :13]
    variance = (found.noise / field * push) ** 2 + np.sum((rows @ known) * rows, axis=1)
    norm, expected = float(np.sqrt(np.mean(off**2))), float(np.sqrt(np.mean(variance))) if np.isfinite(known).all() else np.inf
    up = np.tile([0.0, 0.0, -1.0], (len(m), 1)) if accel is None else like(accel, len(m), "specific force")
    rest = np.ones(len(m), dtype=bool) if accel is None else still(up)
    up = unit(np.where(rest[:, None], up, [0.0, 0.0, -1.0]))
    below = np.clip(-np.sum(unit(y) * up, axis=1), -1, 1)
    dips, level = np.arcsin(below[rest]), np.sqrt(1 - below**2)
    dip = np.full(2, np.nan) if accel is None or not len(dips) else np.array([dips.mean(), dips.std()])
    measured = np.full(len(m), np.nan)
    if headings is not None or accel is not None:
        flat = rest & (level > STEEPEST)
        measured[flat] = np.asarray(heading(y[flat], 9.81 * up[flat]))
    of = measured if headings is None else np.asarray(headings, dtype=float)
    if of.shape != (len(m),):
        raise DataError(f"The headings have shape {of.shape}; give one for each of {len(m)} readings, NaN where none is known.",
                        code="rows_differ")  # fmt: skip
    error = np.angle(np.exp(1j * (measured - of))) if headings is not None else np.full(len(m), np.nan)
    there, rms, told = np.isfinite(error), float("nan"), float("nan")
    if there.any():
        rms = float(np.sqrt(np.mean(error[there] ** 2)))
        by_calibration = found.heading_error[0 if accel is None else 1]
        told = float(np.hypot(by_calibration, np.sqrt(np.mean((found.noise / field / level[there]) ** 2))))
    most = float(np.sqrt(scipy.special.fdtri(_PARAMETERS, float(found.estimate.freedom[0]), 0.95)))
    wrong = norm > max(most * expected, EXACT) or rms > max(most * told, EXACT)  # the second is false without known headings
    said = (FINDINGS("check", count=len(m)),) if wrong else ()
    return Check(norm, expected, rms, told, dip, len(m), _table(of, error, off), said)


def _table(of: np.ndarray, error: np.ndarray, off: np.ndarray) -> np.ndarray:
    """One row for each sector with readings."""
    there, sectors = np.isfinite(of), HEADINGS[::2]
    sector, rows = np.round(of[there] / sectors[1]) % len(sectors), []
    for one in np.unique(sector):
        here = sector == one
        turned = error[there][here]
        rows.append((sectors[int(one)], np.sum(here), np.mean(turned), np.std(turned), np.sqrt(np.mean(off[there][here] ** 2))))
    return np.array(rows, dtype=float).reshape(-1, 5)
