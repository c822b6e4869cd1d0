"""`align`: the rotation that a fit of norms cannot see, from the vertical, from rates, or from known headings."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from ..fitting import covariance, solve
from ._aided import Known, Poses, Turns, dip_residuals, heading_residuals, turn_residuals
from ._model import MagModel
from ._start import padded_length
from ._turn import attitudes_in_segments, permutations, rotation_vector, turn

_STILL = 0.03  # departure of the specific force from its median beyond which a pose is not at rest
SEGMENT = 2.0  # rad travelled in one segment: rates of a slightly wrong scale go astray with the angle
_WEAK, _REFUSED = np.deg2rad(1.0), np.deg2rad(5.0)
_FEWEST = 5
_AXES = ("x", "y", "z")


class Alignment(eqx.Module):
    """Rotation between a magnetometer and the sensor it was compared with.

    Attributes
    ----------
    model : `MagModel` whose corrected field is in the axes of the other sensor; its soft iron is the given one times `rotation`.
    rotation : (3, 3) Q from the axes of the other sensor to those of the corrected field before.
    covariance : (3, 3) of the rotation vector about the other sensor's axes, rad^2.
    angle, angle_error : of the rotation and its standard deviation along it, rad.
    dip : inclination of the field found with the accelerometer, positive downwards, rad; NaN with other sensors.
    spread : (2,) standard deviation before and after the rotation, rad: of the dip, of the heading, or of an axis of the unit
        field while the sensor turns.
    bias : (3,) bias of the gyroscope, rad/s; zero with other sensors.
    used : number of readings.
    verdict : "good", "weak" (a standard deviation above 1 degree) or "refused" (above 5).
    reason : a sentence.
    source : "accel", "gyro" or "headings".
    """

    model: MagModel
    rotation: AnyArray
    covariance: AnyArray
    angle: float
    angle_error: float
    dip: float
    spread: AnyArray
    bias: AnyArray
    used: int
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    source: str = eqx.field(static=True)


@host_float64
def align(
    m: Any,
    model: MagModel,
    *,
    accel: Any = None,
    gyro: Any = None,
    rate: float | int | None = None,
    headings: Any = None,
    declination: float | int = 0.0,
    dip: float | int | None = None,
    mounting: str = "near",
) -> Alignment:
    r"""Rotation of a calibrated magnetometer against an accelerometer, a gyroscope, or known headings.

    With the corrected field y = C^{-1}(m - b) and the other sensor's axes turned by Q:

    - accelerometer, at rest: the field makes one angle with the vertical, :math:`y_i^T Q f_i / (|y_i||f_i|) = -\sin I`;
    - gyroscope: the field stands still while the sensor turns, :math:`\dot y = -(Q\omega) \times y`, integrated over segments of
      2 rad, with a constant bias of the rates;
    - headings: :math:`\psi(Q^T y_i, f_i) = \psi_i`, for poses that are level or have an accelerometer.

    Parameters
    ----------
    m : (n, 3) readings; rows with NaN are left out.
    model : `MagModel` of a fit of the same readings, or of others.
    accel : (n, 3) specific force in m/s^2, calibrated; poses in motion (norm off by more than 3 %) are left out.
    gyro : (n, 3) rates in rad/s at the times of the readings, with `rate`, the readings per second.
    headings : (n,) known headings in rad, NaN where there is none; `accel` then gives the tilt, and without it all are level.
    declination : taken off the headings; 0 if they are magnetic.
    dip : known inclination in rad; without it the accelerometer finds it.
    mounting : "near", the axes differ by less than 45 degrees, or "any", with the accelerometer: the 24 ways to exchange axes are
        tried first.

    Returns
    -------
    Alignment
        With a verdict: "refused" where the poses do not determine the rotation, such as level ones that leave the turn about
        the vertical open.

    Raises
    ------
    DataError
        If nothing is given to align with, shapes do not match, or too few readings are left.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, align, body_field, scenario
    >>> attitudes = scenario("all", samples=40)
    >>> field, up = body_field(attitudes, 50.0), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    >>> turned = MagModel(np.array([[1.0, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    >>> found = align(turned.measure(field), MagModel(np.eye(3), np.zeros(3)), accel=up)
    >>> print(found.verdict, np.rad2deg([found.angle, found.dip]).round(2))
    good [ 1.15 57.  ]

    References
    ----------
    X. Li and Z. Li, Meas. Sci. Technol. 23 (2012) 105105 (accelerometer, the dot product); Y. Wu et al., IEEE Sensors J. 18 (2018) 9015
    (gyroscope).
    """
    m = array(m, "readings")
    y = (m - np.asarray(model.hard_iron)) @ np.linalg.inv(np.asarray(model.soft_iron)).T
    if mounting not in ("near", "any"):
        raise DataError(f"There is no mounting {mounting!r}; known are 'near' and 'any'.")
    if headings is not None:
        return _by_headings(y, model, accel, np.asarray(headings, dtype=float) - declination)
    if (accel is None) == (gyro is None):
        raise DataError("Give one of `accel`, `gyro` (with `rate`) and `headings` to align with.")
    if accel is not None:
        return _by_dip(y, model, like(accel, y, "specific force"), dip, mounting)
    if rate is None or not rate > 0:
        raise DataError("The gyroscope is integrated: give `rate`, the readings per second.")
    return _by_rates(y, model, like(gyro, y, "rates"), float(rate))


def array(values: Any, name: str) -> np.ndarray:
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise DataError(f"The {name} have shape {values.shape}; expected (n, 3), one row per reading.")
    return values


def like(values: Any, y: np.ndarray, name: str) -> np.ndarray:
    values = array(values, name)
    if len(values) != len(y):
        raise DataError(f"There are {len(y)} readings and {len(values)} rows of {name}; give one for each reading.")
    return values


def _padded(values: np.ndarray) -> np.ndarray:
    size = padded_length(len(values))
    return np.concatenate([values, np.repeat(values[:1], size - len(values), axis=0)])


def _weight(count: int) -> np.ndarray:
    full = np.zeros(padded_length(count))
    full[:count] = 1.0
    return full


def unit(v: np.ndarray) -> np.ndarray:
    return v / np.linalg.norm(v, axis=1, keepdims=True)


def _enough(count: int, what: str) -> None:
    if count < _FEWEST:
        raise DataError(f"{count} {what} are left to align with; at least {_FEWEST} are needed, in attitudes that differ.")


@eqx.filter_jit
def _compiled(function, parameters, data):
    return function(parameters, data)


def _values(function, parameters, data) -> np.ndarray:
    return np.asarray(_compiled(function, *jax.tree.map(jnp.asarray, (parameters, data))))


def still(accel: np.ndarray) -> np.ndarray:
    """Readings whose specific force has the size of gravity: the median, so that its unit does not matter."""
    size = np.linalg.norm(accel, axis=1)
    there = np.isfinite(size) & (size > 0)
    usual = np.median(size[there]) if there.any() else np.inf
    return there & (np.abs(size / usual - 1) < _STILL)


def _by_dip(y, model, accel, dip, mounting) -> Alignment:
    kept = still(accel) & np.isfinite(y).all(axis=1)
    _enough(int(kept.sum()), "poses at rest")
    y, f = unit(y[kept]), unit(accel[kept])
    base = np.eye(3)
    if mounting == "any":
        # the best constant: about it the products scatter least
        base = min(permutations(), key=lambda p: np.std(np.sum(y * (f @ p.T), axis=1)))
    before = np.sum(y * (f @ base.T), axis=1)
    s = float(np.mean(before)) if dip is None else -float(np.sin(dip))
    rotation, fit = base, None
    for _ in range(2):  # the second time from the solution, so that the covariance is that of a turn about it
        data = Poses(_padded(y), _padded(f), _weight(len(y)), rotation)
        fit = solve(dip_residuals, {"rho": np.zeros(3), "s": s}, data, free={"rho": True, "s": dip is None})
        rotation, s = rotation @ np.asarray(turn(fit.model["rho"])), float(fit.model["s"])
    spread = np.array([np.std(np.arcsin(np.clip(p, -1, 1))) for p in (before, np.sum(y * (f @ rotation.T), axis=1))])
    names = list(fit.names)  # type: ignore[union-attr]
    order = [i for i, name in enumerate(names) if "rho" in name]
    matrix = np.asarray(covariance(fit, scaled=True))[np.ix_(order, order)]  # type: ignore[arg-type]
    return alignment_of(model, rotation, base, matrix, spread, len(y), "accel", fit, dip=-float(np.arcsin(np.clip(s, -1, 1))))


def _by_headings(y, model, accel, headings) -> Alignment:
    up = np.tile([0.0, 0.0, -9.81], (len(y), 1)) if accel is None else like(accel, y, "specific force")
    if headings.shape != (len(y),):
        raise DataError(f"The headings have shape {headings.shape}; give one for each of {len(y)} readings, NaN where none is known.")
    kept = np.isfinite(headings) & np.isfinite(up).all(axis=1) & np.isfinite(y).all(axis=1)
    _enough(int(kept.sum()), "known headings")
    y, up, headings = y[kept], up[kept], headings[kept]
    rotation, fit, spread = np.eye(3), None, []
    for _ in range(2):
        data = Known(_padded(y), _padded(up), _padded(headings), _weight(len(y)), rotation)
        start = {"rho": np.zeros(3)}
        fit = solve(heading_residuals, start, data)
        spread.append(np.sqrt(np.mean(_values(heading_residuals, start, data)[: len(y)] ** 2)))
        rotation = rotation @ np.asarray(turn(jnp.asarray(fit.model["rho"])))
    return alignment_of(model, rotation, np.eye(3), np.asarray(covariance(fit, scaled=True)), np.array(spread), len(y), "headings", fit)  # type: ignore[arg-type]


def _by_rates(y, model, gyro, rate) -> Alignment:
    segment, attitude, slope = attitudes_in_segments(gyro, rate, SEGMENT)
    size = np.sqrt(np.nanmean(np.sum(y**2, axis=1)))
    kept = (segment >= 0) & np.isfinite(y).all(axis=1)
    _enough(int(kept.sum()), "readings with rates")
    number, member = np.unique(segment[kept], return_inverse=True)
    y, attitude, slope, count = y[kept] / size, attitude[kept], slope[kept], len(y[kept])
    rotation, bias, fit, spread = np.eye(3), np.zeros(3), None, []
    for _ in range(2):
        data = Turns(
            _padded(y), _padded(attitude), _padded(slope), _padded(member), _weight(count), rotation, np.ones(len(_weight(len(number))))
        )
        begin = {"rho": np.zeros(3), "bias": bias}
        fit = solve(turn_residuals, begin, data)
        spread.append(np.sqrt(np.sum(_values(turn_residuals, begin, data) ** 2) / (3 * max(count - len(number), 1))))
        rotation, bias = rotation @ np.asarray(turn(fit.model["rho"])), np.asarray(fit.model["bias"])
    # each segment's field was estimated too
    free = np.asarray(fit.degrees_of_freedom)  # type: ignore[union-attr]
    matrix = np.asarray(covariance(fit, scaled=True)) * free / max(free - 3 * len(number), 1)  # type: ignore[arg-type]
    order = [i for i, name in enumerate(fit.names) if "rho" in name]  # type: ignore[union-attr]
    return alignment_of(model, rotation, np.eye(3), matrix[np.ix_(order, order)], np.array(spread), count, "gyro", fit, bias=bias)


def alignment_of(model, rotation, base, matrix, spread, used, source, fit, dip=float("nan"), bias=None) -> Alignment:
    rho = rotation_vector(base.T @ rotation)
    angle = float(np.linalg.norm(rho))
    along = rho / angle if angle > 1e-12 else np.full(3, 3**-0.5)
    known = bool(fit.usable) and np.isfinite(matrix).all()
    worst, ways = np.linalg.eigh(matrix if known else np.eye(3))
    most = float(np.sqrt(max(worst[-1], 0.0))) if known else np.inf
    axis = _AXES[int(np.argmax(np.abs(ways[:, -1])))]
    if not known:
        verdict, reason = "refused", f"The attitudes do not determine the rotation: {fit.message} Tilt the sensor about two axes."
    else:
        verdict = "good" if most <= _WEAK else "weak" if most <= _REFUSED else "refused"
        degrees = np.rad2deg([angle, most])
        reason = f"The rotation is {degrees[0]:.2g} degrees; it is least certain about {axis}, by {degrees[1]:.2g} degrees."
    return Alignment(
        model=MagModel(np.asarray(model.soft_iron) @ rotation, np.asarray(model.hard_iron)),
        rotation=rotation,
        covariance=matrix if known else np.full((3, 3), np.inf),
        angle=angle,
        angle_error=float(np.sqrt(along @ matrix @ along)) if known else np.inf,
        dip=dip,
        spread=spread,
        bias=np.zeros(3) if bias is None else bias,
        used=used,
        verdict=verdict,
        reason=reason,
        source=source,
    )  # fmt: skip
