"""`check`: a calibration on readings that it has not seen, or on readings with known headings."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy.special

from .._errors import DataError
from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray
from ._design._heading_error import distance_slopes
from ._ellipsoid._shape import Frame, ellipsoid_of_model, unit
from ._field import heading
from ._result import MagFit
from ._rotation._align import still
from ._rotation._turning import array, like

_MOST = 36  # headings that are listed one by one; more are put into sectors
_SECTORS = 12
_PARAMETERS = 3.0  # degrees of freedom of a heading error, nearly: the hard iron dominates it
_LEAST = 1e-9


class Check(Result):
    """How a calibration does on readings.

    Attributes
    ----------
    norm, expected_norm : rms of the corrected norm over the field, less one: found, and expected from noise and calibration error.
    heading, expected_heading : rms heading error in rad: found, and expected. NaN without known headings.
    dip : (2,) mean and standard deviation of the dip in rad; NaN without an accelerometer.
    count : number of readings.
    table : (k, 5) a row for each known heading, or for each sector of 30 degrees: heading in rad, number of readings, mean heading error
        and standard deviation in rad, rms of the norm.
    verdict : "good", or "weak" where an error is larger than expected beyond chance of 5 %.
    reason : a sentence.
    warnings : none.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, check, scenario
    >>> m = body_field(scenario("all"), 50.0) + 0.1 * np.random.default_rng(0).normal(size=(360, 3))
    >>> found = check(jaxcal.magnetometer.fit(m[::2]), m[1::2])
    >>> found.verdict, found.count
    ('good', 180)
    """

    norm: float
    expected_norm: float
    heading: float
    expected_heading: float
    dip: AnyArray
    count: int
    table: AnyArray
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())

    def _rows(self) -> list[Row]:
        return [
            Row("norm", 100 * self.norm, unit="%"),
            Row("norm, expected", 100 * self.expected_norm, unit="%"),
            Row("heading", np.rad2deg(self.heading), unit="deg"),
            Row("heading, expected", np.rad2deg(self.expected_heading), unit="deg"),
        ]


@host_float64
def check(found: MagFit, m: Any, *, accel: Any = None, headings: Any = None) -> Check:
    r"""Errors of a calibration on readings that were held back from it, beside the errors that it predicts.

    The norm of a corrected reading, over the field, has the variance

    .. math:: \frac{\sigma^2}{H^2} |C^{-T} \hat y|^2 + r\,\mathrm{Cov}\,r^T

    with the slopes r of the norm by shape and hard iron. A heading has that of the calibration, and that of the reading's own noise.

    Parameters
    ----------
    found : a fit with a model that is not planar.
    m : (n, 3) readings that `found` has not seen, in its unit.
    accel : (n, 3) specific force at rest, in the axes of the corrected field; for the dip, and for headings of a sensor that is not level.
    headings : (n,) known magnetic headings in rad; NaN where there is none.

    Returns
    -------
    Check

    Raises
    ------
    DataError
        If the fit has no model, or shapes differ.

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
    First-order propagation; the limit is the 95 % quantile of Fisher's law.
    """
    if found.model is None or found.plane is not None or len(found.values):
        raise DataError("A check needs a fit of norms with a model that is not planar.")
    m = array(m, "readings")
    if not len(m) or not np.isfinite(m).all():
        raise DataError(f"A check needs readings that are finite numbers; got {len(m)}.")
    shape, centre = ellipsoid_of_model(found.model, Frame(np.zeros(3), 1.0), found.field)
    correction = np.linalg.inv(np.asarray(found.model.soft_iron))
    z = m - centre
    y = z @ correction.T
    size = np.linalg.norm(y, axis=1)
    off = size / found.field - 1
    # the slope of the norm is that of the distance, times the length of A z
    rows = distance_slopes(shape, z) * np.linalg.norm(z @ shape, axis=1)[:, None]
    known = np.asarray(found.covariance)
    by_noise = (found.noise / found.field) ** 2 * np.sum((unit(y) @ correction) ** 2, axis=1)
    expected = float(np.sqrt(np.mean(by_noise + np.sum(rows @ known * rows, axis=1))))
    up = np.tile([0.0, 0.0, -1.0], (len(m), 1)) if accel is None else like(accel, m, "specific force")
    rest = np.ones(len(m), dtype=bool) if accel is None else still(up)
    up = np.where(rest[:, None], unit(np.where(rest[:, None], up, 1.0)), [0.0, 0.0, -1.0])
    below = -np.sum(unit(y) * up, axis=1)
    level = np.sqrt(np.maximum(1 - below**2, 0.0))
    dips = np.arcsin(np.clip(below, -1, 1))[rest]
    dip = np.full(2, np.nan) if accel is None or not len(dips) else np.array([dips.mean(), dips.std()])
    there, error, of = np.zeros(len(m), dtype=bool), np.full(len(m), np.nan), np.full(len(m), np.nan)
    if headings is not None:
        of = np.asarray(headings, dtype=float)
        if of.shape != (len(m),):
            raise DataError(f"The headings have shape {of.shape}; give one for each of {len(m)} readings, NaN where none is known.")
    if headings is not None or accel is not None:
        steep = level < 0.18
        measured = np.full(len(m), np.nan)
        measured[~steep & rest] = np.asarray(heading(y[~steep & rest], 9.81 * up[~steep & rest]))
        error = np.angle(np.exp(1j * (measured - of)))
        there = np.isfinite(error)
        of = of if headings is not None else measured
    rms = float(np.sqrt(np.mean(error[there] ** 2))) if there.any() else float("nan")
    told = float("nan")
    if there.any():
        own = np.mean((found.noise / found.field / level[there]) ** 2)
        told = float(np.hypot(found.heading_error[0 if np.all(np.abs(up[there, :2]) < 0.1) else 1], np.sqrt(own)))
    freedom = found.blocks - 1 if found.blocks else max(found.used - 9, 1)
    most = float(np.sqrt(scipy.special.fdtri(_PARAMETERS, freedom, 0.95)))
    norm = float(np.sqrt(np.mean(off**2)))
    said = [f"The norm of {len(m)} readings is off by {100 * norm:.2g} % rms; {100 * expected:.2g} % are expected."]
    if there.any():
        said.append(f"Headings are off by {np.rad2deg(rms):.2g} degrees rms; {np.rad2deg(told):.2g} are expected.")
    wrong = norm > max(most * expected, _LEAST) or (there.any() and rms > max(most * told, _LEAST))
    if wrong:
        said.append("That is more than chance: the calibration, the readings or the known headings have an error that is not counted.")
    return Check(
        norm, expected, rms, told, dip, len(m), _table(of, error, off), "weak" if wrong else "good", " ".join(said)
    )  # fmt: skip


def _table(of: np.ndarray, error: np.ndarray, off: np.ndarray) -> np.ndarray:
    """A row for each heading, or for each sector."""
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
