"""`level`: roll and pitch from an accelerometer on the turntable, by five methods."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ._equation import WEAK, root_of
from ._frames import GRAVITY, distance, wrap
from ._positions import Readings, check_gravity, harmonics, mean_at, need
from ._verdict import Verdict, decided, sentence, verdict_name

LEVEL_METHODS = ("four_point_x", "least_squares_x", "four_point_y", "least_squares_y", "bias_and_scale")
_QUARTER = np.pi / 2
_WANTED: dict[str, list[tuple[str, float]]] = {
    "four_point_x": [("x", 0.0), ("x", _QUARTER), ("x", np.pi), ("x", 3 * _QUARTER)],
    "four_point_y": [("y", 0.0), ("y", _QUARTER), ("y", np.pi), ("y", 3 * _QUARTER)],
    "bias_and_scale": [("x", 0.0), ("x", _QUARTER), ("x", np.pi), ("z", 0.0)],
}
_SINGULAR = 1e-6


class Level(eqx.Module):
    """Roll and pitch.

    Attributes
    ----------
    phi, theta : roll and pitch, rad; phi is None where it is not determined.
    phi_roots : both rolls that the readings allow, sorted, or the one of "bias_and_scale".
    covariance : (2, 2) of (phi, theta), rad^2; zero where the noise is not known.
    bias : offset of the readings, m/s^2 (it includes MA_2 f_z); scale, scale_approx : scale factor S and its linear approximation
        of the paper's equation (34); None where the method gives none.
    excess : by how much a sine exceeds 1 in standard deviations; 0 where none does, infinite where the noise is not known.
    verdict : item of `Verdict`.
    method : its name.
    """

    phi: Any
    theta: Any
    phi_roots: Any
    covariance: Any
    bias: Any
    scale: Any
    scale_approx: Any
    excess: Any
    verdict: Any
    method: str = eqx.field(static=True)

    @property
    def std(self) -> Any:
        """(2,) standard deviations of phi and theta, rad."""
        return np.sqrt(np.diag(self.covariance)) if isinstance(self.covariance, np.ndarray) else jnp.sqrt(jnp.diagonal(self.covariance))

    @property
    def reason(self) -> str:
        """What the verdict means here (host only)."""
        by = f" (by {float(self.excess):.2g} standard deviations)" if 0 < float(self.excess) < np.inf else ""
        return sentence(self.verdict, self.method) + by


@host_float64
def level(
    readings: Readings,
    *,
    method: str = "four_point_x",
    gravity: Any = GRAVITY,
    hint: Any = None,
    offset: bool = True,
    both_z: bool = False,
) -> Level:
    r"""Roll and pitch of a table that stands still, from one accelerometer.

    .. math:: \sin\theta = (a_0 - a_{180})/2g,\qquad \cos\theta\sin\phi = (a_{270} - a_{90})/2g

    for "four_point_x"; "least_squares_x" fits the same two numbers and an offset to any angles; the methods of y take a sensor on
    body y; "bias_and_scale" adds a z reading, which gives scale and the whole circle of roll. The others leave phi and pi - phi open: the
    one within 90 degrees is taken, unless a z reading or the hint says otherwise. Traced, the kernels run as they are.

    Parameters
    ----------
    readings : with an accelerometer, at the positions of the method (all x or y positions for least squares).
    method : "four_point_x", "least_squares_x", "four_point_y", "least_squares_y" or "bias_and_scale".
    gravity : local gravity, m/s^2.
    hint : rough roll, rad.
    offset : whether least squares fits the bias; without it two angles suffice, and an unbalanced set does not cancel the bias.
    both_z : whether "bias_and_scale" takes a reading with mounting "-z" as well, which frees it of the misalignment MA_1.

    Returns
    -------
    Level
        With both roots, the covariance from the readings' noise, and a verdict. Traced, phi is 0 where it is not determined.

    Raises
    ------
    DataError
        For an unknown method, a missing position (named), or no accelerometer.

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
        raise DataError(f"There is no levelling method {method!r}; known are {', '.join(map(repr, LEVEL_METHODS))}.")
    check_gravity(gravity)
    need(readings, "accel", _WANTED.get(method, []) + [("-z", 0.0)] * (both_z and method == "bias_and_scale"), method)
    mounting = "y" if method.endswith("y") else "x"
    if method.startswith("least") and not is_traced(readings) and mounting not in readings.positions.mounting:
        raise DataError(f"Method {method!r} needs accelerometer readings with mounting {mounting!r}, and there are none.")
    dtype = jnp.asarray(readings.accel).dtype
    hint = None if hint is None else jnp.asarray(hint, dtype=dtype)
    found = _levelled(readings, method, jnp.asarray(gravity, dtype=dtype), hint, offset, both_z)
    return found if is_traced(found) else _trimmed(found)


def _trimmed(found: Level) -> Level:
    """A result of the host: no number where there is none."""
    name = verdict_name(found.verdict)
    gone = name in ("degenerate", "missing") or (name == "clipped" and np.cos(float(found.theta)) < _SINGULAR)
    whole = gone and (not np.isfinite(float(found.theta)) or name == "missing" or bool(np.asarray(found.covariance)[1, 1] < 0))
    covariance = np.asarray(found.covariance)
    one = lambda value: None if value is None else float(value)  # noqa: E731
    return dataclasses.replace(
        found, phi=None if gone else float(found.phi), theta=None if whole else float(found.theta), bias=one(found.bias),
        phi_roots=np.zeros(0) if gone else np.asarray(found.phi_roots), excess=float(found.excess),
        covariance=np.where(covariance < 0, np.inf, covariance) if whole else covariance,
        scale=None if gone else one(found.scale), scale_approx=None if gone else one(found.scale_approx),
    )  # fmt: skip


@filter_jit
def _levelled(readings: Readings, method: str, gravity: Array, hint: Array | None, offset: bool, both_z: bool) -> Level:
    if method == "bias_and_scale":
        return _with_z(readings, gravity, both_z)
    dtype = jnp.asarray(readings.accel).dtype
    determined = jnp.asarray(True)
    if method.startswith("least"):
        fit = harmonics(readings, "accel", method[-1], gravity, offset)
        # x: a = g (st cos - q sin) + b; y: a = -g (q cos + st sin) + b
        turn = np.array([[1.0, 0, 0], [0, -1.0, 0]]) if method[-1] == "x" else np.array([[0, -1.0, 0], [-1.0, 0, 0]])
        turn = jnp.asarray(turn, dtype=dtype)
        (sine, product), covariance = turn @ fit.value, turn @ fit.covariance @ turn.T
        bias, determined = fit.value[2] * gravity if offset else None, fit.determined
    else:
        at = [mean_at(readings, "accel", *place, gravity) for place in _WANTED[method]]
        a, variance = jnp.stack([one.value for one in at]), jnp.stack([one.variance for one in at])
        rows = [[1.0, 0, -1, 0], [0, -1, 0, 1.0]] if method[-1] == "x" else [[0, -1.0, 0, 1], [-1.0, 0, 1, 0]]
        rows = jnp.asarray(np.array(rows) / 2, dtype=dtype)
        (sine, product), covariance = rows @ a, (rows * variance[None, :]) @ rows.T
        bias, determined = jnp.mean(a) * gravity, jnp.all(jnp.stack([one.present for one in at]))
    down = _down(readings, gravity, jnp.zeros((), dtype=dtype) if bias is None else bias)
    return _from_plane(sine, product, covariance, bias, determined, down, hint, method)


def _down(readings: Readings, gravity: Array, bias: Array) -> Array:
    """-f_z / g as far as z readings tell; 0 where there are none."""
    plus, minus = (mean_at(readings, "accel", word, 0.0, gravity) for word in ("z", "-z"))
    offset = bias / gravity
    alone = jnp.where(plus.present, offset - plus.value, jnp.where(minus.present, minus.value - offset, 0))
    return jnp.where(plus.present & minus.present, (minus.value - plus.value) / 2, alone)


def _from_plane(sine, product, covariance, bias, determined, down, hint, method) -> Level:
    """Roll and pitch from st and ct sf."""
    one = jnp.ones_like(sine)
    over_theta = jnp.abs(sine) - 1
    st = jnp.clip(sine, -1, 1)
    ct = root_of((1 - st) * (1 + st))
    theta = jnp.arctan2(st, ct)
    undefined = ct < _SINGULAR
    ratio = product / jnp.where(undefined, 1, ct)
    over_phi = jnp.where(undefined, -one, jnp.abs(ratio) - 1)
    sf = jnp.clip(ratio, -1, 1)
    cf = root_of((1 - sf) * (1 + sf))
    near = jnp.where(undefined, 0, jnp.arctan2(sf, cf))
    roots = jnp.sort(jnp.stack([near, wrap(np.pi - near)]))
    far = distance(roots, hint) if hint is not None else jnp.where(down != 0, jnp.sign(down) * -jnp.cos(roots), -jnp.cos(roots))
    phi = roots[jnp.argmin(far)]

    # derivative of the sines' arguments; a clipped or merged root has none, and takes that of its neighbourhood
    scale = jnp.maximum(ct, _SINGULAR)
    by = jnp.stack([jnp.stack([sf * st / scale, one]), jnp.stack([one, jnp.zeros_like(one)])])
    raw = by @ covariance @ by.T / jnp.outer(jnp.stack([scale, scale]), jnp.stack([scale, scale]))
    floor = jnp.maximum(cf, jnp.sqrt(jnp.sqrt(jnp.maximum(raw[0, 0], 1e-24))))
    lean = jnp.stack([jnp.sign(jnp.cos(phi)) / floor, one])
    angle_covariance = raw * jnp.outer(lean, lean)
    variance = jnp.stack([covariance[0, 0], raw[0, 0]])
    sigma = jnp.sqrt(jnp.where(variance > 0, variance, 1))
    over = jnp.stack([over_theta, over_phi])
    rounding = 8 * jnp.finfo(sine.dtype).eps
    excess = jnp.max(jnp.where(over > rounding, jnp.where(variance > 0, over / sigma, jnp.inf), 0))
    # fewer angles than unknowns: not even the pitch is known, and a negative variance says so to the host
    unknown = Verdict.degenerate if method.startswith("least") else Verdict.missing
    verdict = decided(
        (angle_covariance[0, 0] > WEAK**2, Verdict.weak), (cf < _SINGULAR, Verdict.double_root), (undefined, Verdict.degenerate),
        (excess > 0, Verdict.clipped), (~determined, unknown),
    )  # fmt: skip
    angle_covariance = jnp.where(determined, angle_covariance, -jnp.eye(2, dtype=angle_covariance.dtype))
    return Level(phi, theta, roots, angle_covariance, bias, None, None, excess, verdict, method)


def _with_z(readings: Readings, gravity: Array, both: bool) -> Level:
    """The method of bias and scale: angles that depend on neither."""
    at = [mean_at(readings, "accel", *place, gravity) for place in [*_WANTED["bias_and_scale"], ("-z", 0.0)]]
    x, variance = jnp.stack([one.value for one in at]), jnp.stack([one.variance for one in at])
    present = jnp.all(jnp.stack([one.present for one in at[: 5 if both else 4]]))

    def parts(x: Array) -> Array:
        b = (x[0] + x[2]) / 2
        return jnp.stack([x[0] - b, x[1] - b, (x[3] - x[4]) / 2 if both else x[3] - b])

    def angles(x: Array) -> Array:
        a1, a2, a3 = parts(x)
        square = a2**2 + a3**2
        some = square > 0
        # straight up or down the roll has no value and no slope
        second, third = jnp.where(some, -a2, 0), jnp.where(some, -a3, 1)
        return jnp.stack([jnp.arctan2(second, third), jnp.arctan2(a1, root_of(square))])

    a = parts(x)
    phi, theta = angles(x)
    slopes = jax.jacfwd(angles)(x)
    angle_covariance = (slopes * variance[None, :]) @ slopes.T
    alpha = a @ a
    scale = jnp.sqrt(alpha)
    verdict = decided(
        (angle_covariance[0, 0] > WEAK**2, Verdict.weak), (jnp.hypot(a[1], a[2]) < _SINGULAR * scale, Verdict.degenerate),
        (scale < 0.01, Verdict.infeasible), (~present, Verdict.missing),
    )  # fmt: skip
    zero, bias = jnp.zeros_like(scale), (x[0] + x[2]) / 2 * gravity
    return Level(phi, theta, phi[None], angle_covariance, bias, scale, 1 + (alpha - 1) / 2, zero, verdict, "bias_and_scale")
