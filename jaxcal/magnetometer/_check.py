"""`check`: how well a calibration does on readings that it has not seen, or on readings with known headings."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._answer._sections import Grid
from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from ._aids import array, like, still
from ._design._heading_error import distance_slopes
from ._ellipsoid._shape import unit
from ._field import heading
from ._findings import FINDINGS
from ._result import MagFit

_MOST, _SECTORS = 36, 12  # most headings that are listed one by one; more are grouped into sectors of 30 degrees
_PARAMETERS = 3.0  # approximate degrees of freedom of a heading error: the hard iron dominates it
_LEAST = 1e-9  # below which an error is rounding
_STEEP, _LEVEL = 0.18, 0.1  # least horizontal share of the field for a heading; largest horizontal share of gravity at level


class Check(Result):
    """Errors of a calibration on readings, beside the errors to expect.

    Attributes
    ----------
    norm, expected_norm : rms of (magnitude of the corrected reading / field - 1): found, and expected from noise and calibration error.
    heading, expected_heading : rms heading error in rad: found, and expected. NaN without known headings.
    dip : (2,) mean and standard deviation of the dip in rad; NaN without an accelerometer.
    count : number of readings.
    table : (k, 5) one row for each known heading, or for each sector of 30 degrees: heading in rad, number of readings, mean heading error
        and its standard deviation in rad, rms of the magnitude error.
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
        names, quantities = ("readings", "error", "scatter", "norm"), ("ratio", "angle", "angle", "ratio")
        cells = [
            (f"at {np.rad2deg(row[0]):.0f} deg", tuple(
                Number(f"at[{i}].{name}", float(x), quantity=quantity) for name, x, quantity in zip(names, row[1:], quantities, strict=True)
            ))
            for i, row in enumerate(np.asarray(self.table))
        ]  # fmt: skip
        columns = ("readings", "error (rad)", "scatter (rad)", "magnitude")
        return [
            listed("check", "check", [(label, one) for label, one in rows.items() if np.isfinite(one.value)]),
            Grid("by_heading", "residuals by heading", columns, tuple(cells), detail=True),
        ]


@host_float64
def check(found: MagFit, m: Any, *, accel: Any = None, headings: Any = None) -> Check:
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
    m = array(m, "readings")
    if not len(m) or not np.isfinite(m).all():
        raise DataError(f"A check needs readings that are finite numbers; got {len(m)}.", code="not_finite")
    y = (m - np.asarray(found.model.hard_iron)) @ np.linalg.inv(np.asarray(found.model.soft_iron)).T
    off = np.linalg.norm(y, axis=1) / found.field - 1
    norm, expected = float(np.sqrt(np.mean(off**2))), _expected_norm(found, m, y)
    up = np.tile([0.0, 0.0, -1.0], (len(m), 1)) if accel is None else like(accel, len(m), "specific force")
    rest = np.ones(len(m), dtype=bool) if accel is None else still(up)
    up = unit(np.where(rest[:, None], up, [0.0, 0.0, -1.0]))
    below = np.clip(-np.sum(unit(y) * up, axis=1), -1, 1)
    dips, level = np.arcsin(below[rest]), np.sqrt(1 - below**2)
    dip = np.full(2, np.nan) if accel is None or not len(dips) else np.array([dips.mean(), dips.std()])
    of, measured = np.full(len(m), np.nan), np.full(len(m), np.nan)
    if headings is not None or accel is not None:
        flat = rest & (level > _STEEP)
        measured[flat] = np.asarray(heading(y[flat], 9.81 * up[flat]))
        of = measured
    if headings is not None:
        of = np.asarray(headings, dtype=float)
        if of.shape != (len(m),):
            raise DataError(f"The headings have shape {of.shape}; give one for each of {len(m)} readings, NaN where none is known.",
                            code="heading_shape")  # fmt: skip
    error = np.angle(np.exp(1j * (measured - of))) if headings is not None else np.full(len(m), np.nan)
    there, rms, told = np.isfinite(error), float("nan"), float("nan")
    if there.any():
        rms = float(np.sqrt(np.mean(error[there] ** 2)))
        by_calibration = found.heading_error[0 if np.abs(up[there, :2]).max() < _LEVEL else 1]
        told = float(np.hypot(by_calibration, np.sqrt(np.mean((found.noise / found.field / level[there]) ** 2))))
    most = float(np.sqrt(scipy.special.fdtri(_PARAMETERS, float(found.estimate.freedom[0]), 0.95)))
    wrong = norm > max(most * expected, _LEAST) or rms > max(most * told, _LEAST)  # the second is false without known headings
    said = (FINDINGS("check", count=len(m)),) if wrong else ()
    return Check(norm, expected, rms, told, dip, len(m), _table(of, error, off), said)


def _expected_norm(found: MagFit, m: np.ndarray, y: np.ndarray) -> float:
    """Rms error of the magnitude over the field that noise and calibration error explain."""
    known = np.asarray(found.estimate.matrix)[:13, :13]
    if not np.isfinite(known).all():
        return float("inf")
    # the slope of the magnitude is the slope of the distance times the length of the surface's normal, C^-T y
    normal = np.linalg.norm(unit(y) @ np.linalg.inv(np.asarray(found.model.soft_iron)), axis=1) / float(found.field)  # type: ignore[union-attr]
    rows = distance_slopes(found.model, float(found.field), unit(y)) * normal[:, None]
    push = unit(y) @ np.linalg.inv(np.asarray(found.model.soft_iron))  # type: ignore[union-attr]
    by_noise = (found.noise / found.field) ** 2 * np.sum(push**2, axis=1)
    return float(np.sqrt(np.mean(by_noise + np.sum(rows @ known * rows, axis=1))))


def _table(of: np.ndarray, error: np.ndarray, off: np.ndarray) -> np.ndarray:
    """One row for each heading, or for each sector."""
    there = np.isfinite(of)
    degrees = np.round(np.rad2deg(of[there])) % 360
    if len(np.unique(degrees)) > _MOST:
        degrees = np.round(degrees * _SECTORS / 360) % _SECTORS * (360 / _SECTORS)
    rows = []
    for one in np.unique(degrees):
        here = degrees == one
        turned = error[there][here]
        scatter = float(np.std(turned)) if np.isfinite(turned).all() else float("nan")
        mean = float(np.mean(turned)) if np.isfinite(turned).all() else float("nan")
        rows.append((np.deg2rad(one), np.sum(here), mean, scatter, np.sqrt(np.mean(off[there][here] ** 2))))
    return np.array(rows, dtype=float).reshape(-1, 5)
