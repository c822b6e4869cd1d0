"""`level`: roll and pitch from an accelerometer on the turntable, by five methods."""

import dataclasses
import math
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Finding, Number, Result, Section, listed
from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._special import NORMAL95
from .._types import Array, Held, Leaf, Real
from ._closed import WEAK, root_of
from ._findings import OUTCOMES, decided, findings_of
from ._positions import GRAVITY, METHODS, SMALL, Readings, check_gravity, distance, harmonics, means_at, need, wanted, wrap

LEVEL_METHODS = tuple(METHODS["accel"])


class Level(Result):
    """Roll and pitch.

    Attributes
    ----------
    phi, theta : roll and pitch, rad; None if not determined.
    phi_roots : both rolls that are consistent with the readings, sorted; a single roll for "bias_and_scale".
    covariance : (2, 2) covariance of (phi, theta), rad^2; zero if the noise is unknown.
    bias : offset of the readings, m/s^2 (it includes MA_2 f_z). scale, scale_approx : scale factor S and its linear approximation
        from the paper's equation (34). Each is None if the method does not give it.
    method : name of the method.
    outcome : number of the outcome, for traced results, which have no findings: 0 if all is well.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import level, simulate
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6)
    >>> found = level(readings)
    >>> print(np.rad2deg(found.phi_roots).round(3))
    [  2. 178.]
    """

    phi: Leaf | None
    theta: Leaf | None
    phi_roots: Held
    covariance: Held
    bias: Leaf | None
    scale: Leaf | None
    scale_approx: Leaf | None
    outcome: Leaf
    method: str = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def std(self) -> Any:
        """(2,) standard deviations of phi and theta, rad."""
        return np.sqrt(np.diag(self.covariance)) if isinstance(self.covariance, np.ndarray) else jnp.sqrt(jnp.diagonal(self.covariance))

    @property
    def headline(self) -> str:
        """Roll and pitch."""
        said = [f"{label} {math.degrees(x):.6g} deg" for label, x in (("roll", self.phi), ("pitch", self.theta)) if x is not None]
        return ", ".join(said) or "no level"

    def sections(self) -> list[Section]:
        """Roll and pitch with their intervals, and the bias."""
        if np.ndim(self.outcome):  # vectorised
            return []
        both = zip((("phi", "roll", self.phi), ("theta", "pitch", self.theta)), NORMAL95 * np.asarray(self.std), strict=True)
        rows = [
            (label, Number(name, float(x), float(x) - half, float(x) + half, "angle")) for (name, label, x), half in both if x is not None
        ]
        rows += [] if self.bias is None else [("bias", Number("bias", float(self.bias), quantity="accel"))]
        rows += [] if self.scale is None else [("scale factor", Number("scale", float(self.scale)))]
        return [listed("level", f"level by {self.method}", rows)]


@host_float64
def level(
    readings: Readings, *, method: str = "four_point_x", gravity: Real = GRAVITY, hint: Real | None = None, both_z: bool = False
) -> Level:
    r"""Compute roll and pitch of a table at rest from the readings of one accelerometer.

    .. math:: \sin\theta = (a_0 - a_{180})/2g,\qquad \cos\theta\sin\phi = (a_{270} - a_{90})/2g

    These are the formulas of "four_point_x". "least_squares_x" fits the same two numbers and an offset to any angles; the y methods use
    a sensor along body y. "bias_and_scale" adds a z reading, which gives the scale and an unambiguous roll. The other methods cannot
    distinguish phi from pi - phi: they choose the roll within 90 degrees, unless a z reading or `hint` gives the other one. Under JAX
    tracing the same formulas run without checks of the values.

    Parameters
    ----------
    readings : accelerometer readings at the positions that the method needs (least squares uses all x or y positions).
    method : "four_point_x", "least_squares_x", "four_point_y", "least_squares_y" or "bias_and_scale".
    gravity : local gravity, m/s^2.
    hint : rough roll, rad.
    both_z : whether "bias_and_scale" also uses a reading with mounting "-z", which removes the effect of the misalignment MA_1.

    Returns
    -------
    Level
        Both roots, the covariance from the readings' noise, and findings. In a traced result phi is 0 if it is not determined.

    Raises
    ------
    DataError
        If the method is unknown, a position is missing (the message names it), or there is no accelerometer.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import level, simulate
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6)
    >>> found = level(readings)
    >>> print(np.rad2deg([found.phi, found.theta]).round(6))
    [ 2. -1.]

    References
    ----------
    The north-finding paper's equations (19) to (34), in corrected form.
    """
    if method not in LEVEL_METHODS:
        raise DataError(f"There is no levelling method {method!r}; known are {', '.join(map(repr, LEVEL_METHODS))}.", code="method")
    check_gravity(gravity)
    need(readings, "accel", method, (("-z", 0.0),) if both_z and method == "bias_and_scale" else ())
    mounting = "y" if method.endswith("y") else "x"
    if method.startswith("least") and not is_traced(readings) and mounting not in readings.positions.mounting:
        raise DataError(f"Method {method!r} needs accelerometer readings with mounting {mounting!r}.", code="no_position")
    dtype = jnp.asarray(readings.accel).dtype
    hint = None if hint is None else jnp.asarray(hint, dtype=dtype)
    found = _levelled(readings, method, jnp.asarray(gravity, dtype=dtype), hint, both_z)
    return found if is_traced(found) else _trimmed(found)


def _trimmed(found: Any) -> Level:
    """Host result: replace undefined numbers by None."""
    name = OUTCOMES[int(found.outcome)]
    gone = name in ("degenerate", "missing") or (name == "clipped" and np.cos(float(found.theta)) < SMALL)
    whole = gone and (not np.isfinite(float(found.theta)) or name == "missing" or bool(np.asarray(found.covariance)[1, 1] < 0))
    covariance = np.asarray(found.covariance)
    one = lambda value: None if value is None else float(value)  # noqa: E731
    return dataclasses.replace(
        found, phi=None if gone else float(found.phi), theta=None if whole else float(found.theta), bias=one(found.bias),
        phi_roots=np.zeros(0) if gone else np.asarray(found.phi_roots),
        covariance=np.where(covariance < 0, np.inf, covariance) if whole else covariance,
        scale=None if gone else one(found.scale), scale_approx=None if gone else one(found.scale_approx),
        findings=findings_of(found.outcome),
    )  # fmt: skip


@filter_jit
def _levelled(readings: Readings, method: str, gravity: Array, hint: Array | None, both_z: bool) -> Level:
    if method == "bias_and_scale":
        return _with_z(readings, gravity, both_z)
    as_array = lambda rows: jnp.asarray(rows, dtype=jnp.asarray(readings.accel).dtype)  # noqa: E731
    if method.startswith("least"):
        value, covariance, determined = harmonics(readings, "accel", method[-1], gravity)
        bias = value[2] * gravity
        value, covariance = value[:2], covariance[:2, :2]
    else:
        a, variance, present = means_at(readings, "accel", wanted("accel", method), gravity)
        half = as_array([[0.5, 0.0, -0.5, 0.0], [0.0, 0.5, 0.0, -0.5]])
        value, covariance = half @ a, (half * variance[None, :]) @ half.T
        bias, determined = jnp.mean(a) * gravity, jnp.all(present)
    # x: a = g (st cos - q sin) + b; y: a = -g (q cos + st sin) + b
    turn = as_array([[1.0, 0.0], [0.0, -1.0]] if method[-1] == "x" else [[0.0, -1.0], [-1.0, 0.0]])
    (sine, product), covariance = turn @ value, turn @ covariance @ turn.T
    # -f_z / g from the z readings; 0 without z readings
    (plus, minus), _, (up, over) = means_at(readings, "accel", [("z", 0.0), ("-z", 0.0)], gravity)
    down = jnp.where(up & over, (minus - plus) / 2, jnp.where(up, bias / gravity - plus, jnp.where(over, minus - bias / gravity, 0)))
    return _from_plane(sine, product, covariance, bias, determined, down, hint, method)


def _from_plane(sine, product, covariance, bias, determined, down, hint, method) -> Level:
    """Roll and pitch from sin(theta) and cos(theta) sin(phi)."""
    one = jnp.ones_like(sine)
    over_theta = jnp.abs(sine) - 1
    st = jnp.clip(sine, -1, 1)
    ct = root_of((1 - st) * (1 + st))
    theta = jnp.arctan2(st, ct)
    undefined = ct < SMALL
    ratio = product / jnp.where(undefined, 1, ct)
    over_phi = jnp.where(undefined, -one, jnp.abs(ratio) - 1)
    sf = jnp.clip(ratio, -1, 1)
    cf = root_of((1 - sf) * (1 + sf))
    near = jnp.where(undefined, 0, jnp.arctan2(sf, cf))
    roots = jnp.sort(jnp.stack([near, wrap(np.pi - near)]))
    far = distance(roots, hint) if hint is not None else jnp.where(down != 0, jnp.sign(down) * -jnp.cos(roots), -jnp.cos(roots))
    phi = roots[jnp.argmin(far)]

    # derivative of the angles by the two sines; a clipped or double root has none, so use that of a point nearby
    scale = jnp.maximum(ct, SMALL)
    by = jnp.stack([jnp.stack([sf * st / scale, one]), jnp.stack([one, jnp.zeros_like(one)])])
    raw = by @ covariance @ by.T / jnp.outer(jnp.stack([scale, scale]), jnp.stack([scale, scale]))
    floor = jnp.maximum(cf, jnp.sqrt(jnp.sqrt(jnp.maximum(raw[0, 0], 1e-24))))
    lean = jnp.stack([jnp.sign(jnp.cos(phi)) / floor, one])
    angle_covariance = raw * jnp.outer(lean, lean)
    clipped = jnp.maximum(over_theta, over_phi) > 8 * jnp.finfo(sine.dtype).eps  # by more than rounding
    # with fewer angles than unknowns even the pitch is unknown; a negative variance marks this case for `_trimmed`
    unknown = "degenerate" if method.startswith("least") else "missing"
    outcome = decided(
        (angle_covariance[0, 0] > WEAK**2, "weak"), (cf < SMALL, "double_root"), (undefined, "degenerate"),
        (clipped, "clipped"), (~determined, unknown),
    )  # fmt: skip
    angle_covariance = jnp.where(determined, angle_covariance, -jnp.eye(2, dtype=angle_covariance.dtype))
    return Level(phi, theta, roots, angle_covariance, bias, None, None, outcome, method)


def _with_z(readings: Readings, gravity: Array, both: bool) -> Level:
    """The method "bias_and_scale", whose angles depend on neither bias nor scale."""
    x, variance, present = means_at(readings, "accel", [*wanted("accel", "bias_and_scale"), ("-z", 0.0)], gravity)

    def parts(x: Array) -> Array:
        b = (x[0] + x[2]) / 2
        return jnp.stack([x[0] - b, x[1] - b, (x[3] - x[4]) / 2 if both else x[3] - b])

    def angles(x: Array) -> Array:
        a1, a2, a3 = parts(x)
        square = a2**2 + a3**2
        some = square > 0
        # with the x axis vertical, the roll has neither a value nor a derivative
        second, third = jnp.where(some, -a2, 0), jnp.where(some, -a3, 1)
        return jnp.stack([jnp.arctan2(second, third), jnp.arctan2(a1, root_of(square))])

    a = parts(x)
    phi, theta = angles(x)
    slopes = jax.jacfwd(angles)(x)
    angle_covariance = (slopes * variance[None, :]) @ slopes.T
    alpha = a @ a
    scale = jnp.sqrt(alpha)
    outcome = decided(
        (angle_covariance[0, 0] > WEAK**2, "weak"), (jnp.hypot(a[1], a[2]) < SMALL * scale, "degenerate"),
        (scale < 0.01, "infeasible"), (~jnp.all(present[: 5 if both else 4]), "missing"),
    )  # fmt: skip
    bias = (x[0] + x[2]) / 2 * gravity
    return Level(phi, theta, phi[None], angle_covariance, bias, scale, 1 + (alpha - 1) / 2, outcome, "bias_and_scale")
