"""`azimuth`: find north with a gyro on the turntable, by eight closed-form methods."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np

from .._answer import Finding, Number, Result, Section, cell_text, listed
from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._special import NORMAL95
from .._types import Held, Leaf, Numbers, Real
from ._closed import Closed, bias_and_scale, four_point, maximum, opposed, quadrature, scale_first, single_reading, triad
from ._findings import OUTCOMES, decided, findings_of, has_number
from ._level import Level
from ._positions import EARTH_RATE, POLE, SMALL, Readings, check_latitude, distance, harmonics, means_at, need, taken, wanted, wrap

_FORMS = (opposed, quadrature, four_point, single_reading, maximum, bias_and_scale, scale_first, triad)
_KERNELS = {one.__name__: one for one in _FORMS}
AZIMUTH_METHODS = tuple(_KERNELS)


class Azimuth(Result):
    """Azimuth of the table's x axis, from north towards east.

    Attributes
    ----------
    psi : the chosen root, rad, in (-pi, pi]; None if there is no root or no information to choose one.
    std : first-order standard deviation of psi from the noise of the readings and of the level, rad; zero if neither is known.
    roots, root_std : all roots, sorted, and their standard deviations. real : in traced results, which of the padded roots are real.
    bias : gyro bias, rad/s (it includes MA_2 w_z); None if the method does not give one.
    scale : scale factor S of each root. scale_approx : its linear approximation (equations 66, 71).
    latitude, latitude_std : estimate of "triad", rad. rho : amplitude divided by the Earth's rate, from "maximum".
    method : name of the method.
    outcome : number of the outcome, for traced results, which have no findings: 0 if all is well, see `answered`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import azimuth, simulate
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6)
    >>> found = azimuth(readings, np.deg2rad([2.0, -1.0]), 0.6, method="opposed")
    >>> print(found.psi, np.rad2deg(found.roots).round(3))
    None [-40.  40.]
    >>> found.reason[:55]
    'no azimuth Several roots fit the readings and nothing d'
    """

    psi: Leaf | None
    std: Leaf | None
    roots: Held
    root_std: Held
    real: Held
    bias: Leaf | None
    scale: Leaf | None
    scale_approx: Leaf | None
    latitude: Leaf | None
    latitude_std: Leaf | None
    rho: Leaf | None
    outcome: Leaf
    method: str = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def answered(self) -> Any:
        """Whether there is an azimuth; an array for vectorised results."""
        return has_number(self.outcome)

    @property
    def headline(self) -> str:
        """The azimuth with half of its 95 % interval."""
        return "no azimuth" if self.psi is None else f"azimuth {cell_text(_angle('psi', self.psi, self.std))} deg"

    def sections(self) -> list[Section]:
        """The azimuth and all roots."""
        if np.ndim(self.outcome):  # vectorised
            return []
        chosen = [] if self.psi is None else [("azimuth", _angle("psi", self.psi, self.std))]
        roots = [(f"root {i + 1}", _angle(f"root[{i}]", *pair)) for i, pair in enumerate(zip(self.roots, self.root_std, strict=True))]
        return [listed("azimuth", f"azimuth by {self.method}", [*chosen, *roots])]


def _angle(name: str, value: Any, std: Any) -> Number:
    """An angle with its interval by the normal distribution."""
    reach = NORMAL95 * float(std)
    return Number(name, float(value), float(value) - reach, float(value) + reach, "angle")


@host_float64
def azimuth(
    readings: Readings,
    level: "Level | Numbers",
    latitude: Real,
    *,
    method: str = "four_point",
    hint: Real | None = None,
    angle: Real | None = None,
) -> Azimuth:
    r"""Compute the azimuth of a table at rest from the readings of one gyro, the level and the latitude.

    .. math:: \psi = \operatorname{atan2}\big((u_1\sin\theta\sin\phi - u_2)/\cos\phi,\; u_1\big)

    This is the formula of "four_point", with :math:`u_1 = ((w_0 - w_{180})/2 - \sin\theta\sin\lambda)/(\cos\theta\cos\lambda)` and
    :math:`u_2 = ((w_{90} - w_{270})/2 + \cos\theta\sin\phi\sin\lambda)/\cos\lambda`, where w are rates divided by the Earth's rate. The
    other methods solve :math:`a\sin\psi + b\cos\psi = c` and may have several roots. To avoid the choice of a method, use `fit`. Under
    JAX tracing the same formulas run without checks of the values.

    Parameters
    ----------
    readings : gyro readings at the positions that the method needs ("maximum" uses all x positions, "single_reading" one).
    level : `Level`, or (phi, theta) in rad.
    latitude : rad, north positive.
    method : "opposed" (table angles 0 and 180 degrees), "quadrature" (90 and 270), "four_point" (0, 90, 180, 270), "bias_and_scale" or
        "scale_first" (0, 90, 180), "triad" (0, 90, 180 and a z reading), "single_reading" or "maximum".
    hint : rough azimuth, for example from a compass, rad.
    angle : table angle of "single_reading", rad; the default is that of the first x reading.

    Returns
    -------
    Azimuth
        All roots and findings. In a traced result the roots are padded (`real` marks the valid ones), and psi is 0 if none is chosen.

    Raises
    ------
    DataError
        If the method is unknown, a position is missing (the message names it), there is no gyro, or the level has no roll.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import azimuth, simulate
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6)
    >>> print(np.rad2deg(azimuth(readings, np.deg2rad([2.0, -1.0]), 0.6).psi).round(6))
    40.0
    >>> print(np.rad2deg(azimuth(readings, np.deg2rad([2.0, -1.0]), 0.6, method="opposed").roots).round(6))
    [-40.  40.]

    References
    ----------
    The north-finding paper's equations (40) to (71), in corrected form.
    """
    if method not in AZIMUTH_METHODS:
        raise DataError(f"There is no azimuth method {method!r}; known are {', '.join(map(repr, AZIMUTH_METHODS))}.", code="method")
    check_latitude(latitude)
    need(readings, "gyro", method)
    if method in ("single_reading", "maximum") and "x" not in readings.positions.mounting:
        raise DataError(f"Method {method!r} needs gyro readings with mounting 'x', and there are none.", code="no_position")
    if method == "single_reading":
        angle = readings.positions.angle[readings.positions.mounting.index("x")] if angle is None else angle
        assert angle is not None
        if not is_traced(readings, angle) and not np.any(taken(readings, "gyro", "x", float(angle))):
            raise DataError(f"There is no x reading at {np.rad2deg(float(angle)):g} degrees; give the angle of one.", code="no_position")
    dtype = jnp.asarray(readings.gyro).dtype
    phi, theta, covariance = (jnp.asarray(part, dtype=dtype) for part in _level(level, method))
    to = lambda value: None if value is None else jnp.asarray(value, dtype=dtype)  # noqa: E731
    found = _found(readings, phi, theta, covariance, to(latitude), to(hint), to(angle), method)
    return found if is_traced(found) else _trimmed(found)


def _level(level: Any, method: str) -> tuple[Any, Any, Any]:
    """Roll, pitch and their covariance."""
    if isinstance(level, Level):
        if level.theta is None or (level.phi is None and method != "opposed"):
            lacking = "roll" if level.theta is not None else "pitch"
            raise DataError(f"the level has no {lacking}: {level.reason} Only 'opposed' needs no roll", code="no_level")
        if level.phi is None:
            return 0.0, level.theta, np.diag([0.0, np.asarray(level.covariance)[1, 1]])
        return level.phi, level.theta, level.covariance
    pair = jnp.asarray(level)
    if pair.shape != (2,):
        raise DataError(f"The level has shape {pair.shape}; give a `Level`, or (phi, theta) in rad.", code="level")
    if not is_traced(level) and not np.isfinite(np.asarray(pair)).all():
        raise DataError("The level is not finite; give (phi, theta) in rad.", code="level")
    return pair[0], pair[1], jnp.zeros((2, 2), dtype=pair.dtype)


@filter_jit
def _found(readings, phi, theta, level_covariance, latitude, hint, angle, method: str) -> Azimuth:
    unit = EARTH_RATE
    # at a pole the formulas would divide by zero; the verdict reports this case
    pole = jnp.abs(latitude) > POLE
    lat = jnp.where(pole, POLE, latitude)
    missing = jnp.asarray(False)
    given = (angle,) if method == "single_reading" else ()
    if method == "maximum":
        value, variance, known = harmonics(readings, "gyro", "x", unit)
        w, variance, given = value[:2], variance[:2, :2], (value[2], known)
    else:
        w, variance, present = means_at(readings, "gyro", wanted("gyro", method) or [("x", angle)], unit)
        missing, variance = ~jnp.all(present), jnp.diag(variance)
    covariance = jax.scipy.linalg.block_diag(variance, level_covariance)
    form = _KERNELS[method](jnp.concatenate([w, phi[None], theta[None]]), covariance, lat, *given)
    return _judged(form, method, latitude, hint, pole, missing, unit, phi.dtype)


def _judged(form: Closed, method: str, latitude, hint, pole, missing, unit, dtype) -> Azimuth:
    """Sort the roots, choose one, and give a verdict."""
    found, positive = form.found, method in ("bias_and_scale", "scale_first")
    order = jnp.argsort(jnp.where(found.real, found.roots, 10.0))
    roots, std, real, merged, weak = (v[order] for v in (found.roots, found.std, found.real, found.merged, found.weak))
    scale = None if form.scale is None else form.scale[order]
    by_scale = scale if positive and scale is not None else None
    allowed = real if by_scale is None else real & (by_scale > 0)
    cost = jnp.zeros_like(roots) if by_scale is None else jnp.abs(by_scale - 1)
    best = jnp.argmin(jnp.where(allowed, cost if hint is None else distance(roots, hint), jnp.inf))
    others = allowed & (jnp.arange(roots.size) != best)
    apart = distance(roots, roots[best])
    several = jnp.any(others) & ~jnp.all(~others | (apart < 1e-4) | merged[best])
    chosen = off = jnp.asarray(False)
    undecided = several if hint is None else off
    if hint is None and by_scale is not None:
        chosen, undecided = several, several & jnp.any(others & (jnp.abs(by_scale - by_scale[best]) < SMALL))
    if form.latitude is not None:
        off = (jnp.abs(form.latitude - latitude) > 4 * form.latitude_std) & (form.latitude_std > 0)
    outcome = decided(
        (chosen, "scale_chosen"), (weak[best], "weak"), (off, "integrity"),
        (merged[best], "double_root"), (found.clipped, "clipped"), (undecided, "undecided"),
        (found.infeasible, "infeasible"), (found.degenerate, "degenerate"), (pole, "pole"), (missing, "missing"),
    )  # fmt: skip
    none = undecided | found.infeasible | found.degenerate | pole | missing
    zero = jnp.zeros((), dtype=dtype)
    return Azimuth(
        psi=jnp.where(none, zero, wrap(roots[best])), std=jnp.where(none, zero, std[best]), roots=jnp.where(real, roots, 0),
        root_std=jnp.where(real, std, 0), real=real & ~pole & ~missing, bias=None if form.bias is None else form.bias * unit,
        scale=None if scale is None else jnp.where(real, scale, 0), scale_approx=form.scale_approx, latitude=form.latitude,
        latitude_std=form.latitude_std, rho=form.rho, outcome=outcome, method=method,
    )  # fmt: skip


def _trimmed(found: Any) -> Azimuth:
    """Host result: keep only the real roots, and replace undefined numbers by None."""
    name, none = OUTCOMES[int(found.outcome)], not has_number(int(found.outcome))
    kept = np.asarray(found.real) & (not none or name == "undecided")
    one = lambda value: None if value is None else float(value)  # noqa: E731
    return dataclasses.replace(
        found, psi=None if none else float(found.psi), std=None if none else float(found.std), roots=np.asarray(found.roots)[kept],
        root_std=np.asarray(found.root_std)[kept], real=np.ones(kept.sum(), dtype=bool), bias=one(found.bias), rho=one(found.rho),
        scale=None if found.scale is None else np.asarray(found.scale)[kept], scale_approx=None if none else one(found.scale_approx),
        latitude=None if none else one(found.latitude), latitude_std=None if none else one(found.latitude_std),
        findings=findings_of(found.outcome),
    )  # fmt: skip
