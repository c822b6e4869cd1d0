"""`align`: the rotation that a fit of magnitudes cannot show, from the vertical, from rates, or from known headings."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from ..._answer import CAUTION, FATAL, Finding, Number, Quantity, Result, Section, listed
from ..._compile import filter_jit
from ..._errors import DataError
from ..._precision import host_float64
from ..._special import NORMAL95
from ..._types import AnyArray
from ...fitting import Fit, Gaussian, covariance, solve
from ...fitting._serial import is_white, leave_out
from .._ellipsoid._shape import filled, unit
from .._findings import FINDINGS
from .._model import MagModel
from ._residuals import dip_residuals, heading_residuals, turn_residuals
from ._turning import SEGMENT, array, attitudes_in_segments, like, permutations

_STILL = 0.03  # relative departure of the specific force from its median above which a pose is not at rest
#: standard deviations in rad above which the verdict is "weak" and "refused"
LIMITS = (np.deg2rad(1.0), np.deg2rad(5.0))
_FEWEST = 5  # poses: three angles and the dip need four
_ROUNDS, _SETTLED, _EXACT = 6, 1e-6, 1e-12  # most rounds, change that ends them (rad or s), noise of exact data
DELAY = 0.05  # s, prior standard deviation of the delay between the sensors
_OPEN = 0.5  # share of the prior: a delay with a larger error was not determined
_FAR = np.deg2rad(45.0)  # beyond which an exchange of axes is nearer
#: source of a rotation -> its name for readers
NAMES = {"accel": "accelerometer", "gyro": "gyroscope", "headings": "known headings"}
_LEVEL = 0.5  # length of the mean unit vertical: one for a sensor at level, zero for one rotated through all attitudes


class Alignment(Result):
    """Rotation between a magnetometer and the sensor it was compared with.

    Attributes
    ----------
    model : `MagModel` whose corrected field is in the axes of the other sensor; its soft iron is the given one times `rotation`.
    rotation : (3, 3) Q from the axes of the other sensor to those of the corrected field before.
    covariance : (3, 3) of the rotation vector about the other sensor's axes, rad^2.
    angle, angle_error : angle of the rotation, and its standard deviation along the rotation, rad.
    dip : inclination of the field found with the accelerometer, positive downwards, rad; NaN with other sensors.
    spread : (2,) standard deviation before and after the rotation, rad: of the dip, of the heading, or of an axis of the unit
        field while the sensor turns.
    bias : (3,) bias of the gyroscope, rad/s; zero with other sensors.
    delay, delay_error : time by which the magnetometer lags the gyroscope in s, and its standard deviation; NaN with other sensors.
    used : number of readings.
    source : "accel", "gyro" or "headings".
    findings : the verdict is "weak" if a standard deviation is above 1 degree, and "refused" above 5 degrees.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Accelerometer, MagModel, align, body_field, scenario
    >>> attitudes = scenario("all", samples=40)
    >>> field, up = body_field(attitudes, 50.0), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    >>> turned = MagModel(np.array([[1.0, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    >>> found = align(turned.measure(field), MagModel(np.eye(3), np.zeros(3)), Accelerometer(up))
    >>> found.verdict, found.source, round(float(np.rad2deg(found.angle)), 2)
    ('good', 'accel', 1.15)
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
    source: str = eqx.field(static=True)
    delay: float = float("nan")
    delay_error: float = float("nan")
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The angle of the rotation, and how well it is known."""
        most = float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1])) if np.isfinite(self.covariance).all() else np.inf
        if not most < np.pi:
            return "the rotation stays open"
        return f"rotated by {np.rad2deg(self.angle):.2g} deg, known to {np.rad2deg(most):.2g} deg"

    def sections(self) -> list[Section]:
        """Angle, dip, scatter before and after, delay."""
        off, late = NORMAL95 * self.angle_error, NORMAL95 * self.delay_error
        rows = {
            "rotation": Number("angle", self.angle, self.angle - off, self.angle + off, "angle"),
            "dip of the field": Number("dip", self.dip, quantity="angle"),
            "scatter before": Number("spread[0]", float(self.spread[0]), quantity="angle"),
            "scatter after": Number("spread[1]", float(self.spread[1]), quantity="angle"),
            "delay": Number("delay", self.delay, self.delay - late, self.delay + late, "delay"),
            "readings": Number("used", self.used),
        }
        title = f"rotation against the {NAMES[self.source]}"
        return [listed("alignment", title, [(label, one) for label, one in rows.items() if np.isfinite(one.value)])]


class Accelerometer(eqx.Module):
    """An accelerometer beside the magnetometer: at rest it shows the vertical.

    Attributes
    ----------
    accel : (n, 3) calibrated specific force in m/s^2; poses in motion (magnitude off by more than 3 %) are not used.
    dip : known inclination of the field in rad; None to estimate it.
    mounting : "near" if the axes of both sensors differ by less than 45 degrees; "any" tries the 24 ways to exchange axes first.
    turns : whether to rotate the axes of the magnetometer to those of the accelerometer. If False, `fit` only takes the dip from the
        accelerometer, and only if the axes agree so well that the dip of the readings at rest scatters by less than 5 degrees.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Accelerometer, body_field, scenario
    >>> up = -9.81 * body_field(scenario("all", samples=40), 1.0, np.pi / 2)
    >>> Accelerometer(up).accel.shape
    (40, 3)
    """

    accel: Any
    dip: float | int | None = None
    mounting: str = eqx.field(static=True, default="near")
    turns: bool = eqx.field(static=True, default=True)

    def __check_init__(self) -> None:
        if self.mounting not in ("near", "any"):
            raise DataError(f"There is no mounting {self.mounting!r}; known are 'near' and 'any'.", code="no_such_mounting")

    def _align(self, y: np.ndarray, model: MagModel) -> "Alignment":
        accel = like(self.accel, y, "specific force")
        kept = still(accel) & np.isfinite(y).all(axis=1)
        _enough(int(kept.sum()), "poses at rest")
        y, f = unit(y[kept]), unit(accel[kept])
        base = np.eye(3)
        if self.mounting == "any":
            # choose the axes for which the products scatter least about a constant
            base = min(permutations(), key=lambda p: np.std(np.sum(y * (f @ p.T), axis=1)))
        before = np.sum(y * (f @ base.T), axis=1)
        s = float(np.mean(before)) if self.dip is None else -float(np.sin(self.dip))
        data = {"y": filled(y, y[:1]), "f": filled(f, f[:1]), "weight": filled(np.ones(len(y))), "base": base}
        rotation, found, matrix, fits = _turned(dip_residuals, {"s": s}, data, {"rho": True, "s": self.dip is None})
        spread = np.array([np.std(np.arcsin(np.clip(p, -1, 1))) for p in (before, np.sum(y * (f @ rotation.T), axis=1))])
        return alignment_of(
            model, rotation, base, matrix, spread, len(y), "accel", fits[-1], dip=-float(np.arcsin(np.clip(found["s"], -1, 1)))
        )


def vertical(aid: Any, turn: Alignment | None, y: Any = None) -> tuple[float | None, np.ndarray | None]:
    """Dip, and the axis that points down at level, in the axes of the corrected field before the rotation; None if unknown.

    A sensor that tilts little has a mean vertical; one rotated through all attitudes has none. Without a rotation, the corrected readings
    y (n, 3) show the dip.
    """
    if not isinstance(aid, Accelerometer) or (turn is not None and turn.verdict == "refused"):
        return None, None
    force = array(aid.accel, "specific force")
    kept = still(force)
    up = unit(force[kept])
    mean = up.mean(axis=0) if len(up) else np.zeros(3)
    size = float(np.linalg.norm(mean))
    if turn is not None:
        return turn.dip, -np.asarray(turn.rotation) @ mean / size if size > _LEVEL else None
    dips = -np.arcsin(np.clip(np.sum(unit(y[kept]) * up, axis=1), -1, 1))
    if len(dips) < _FEWEST or np.std(dips) > LIMITS[1]:
        return None, None
    return float(np.mean(dips)), -mean / size if size > _LEVEL else None


class Gyroscope(eqx.Module):
    """A gyroscope beside the magnetometer: it shows how the field rotates in the sensor's axes.

    Attributes
    ----------
    gyro : (n, 3) rates in rad/s at the times of the readings; NaN where there is none. If each rate is a mean over the interval before
        its reading, it is the rate half an interval earlier, and the estimated delay is larger by that half. The delay of the readings
        is estimated with a prior standard deviation of 50 ms.
    rate : readings per second.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Gyroscope
    >>> Gyroscope(np.zeros((100, 3)), 50.0).rate
    50.0
    """

    gyro: Any
    rate: float | int

    def __check_init__(self) -> None:
        if self.rate is None or not self.rate > 0:
            raise DataError(f"The rates are integrated: give the readings per second, a positive `rate`; got {self.rate!r}.",
                            code="no_rate")  # fmt: skip

    def _align(self, y: np.ndarray, model: MagModel) -> "Alignment":
        gyro, size = like(self.gyro, y, "rates"), np.sqrt(np.nanmean(np.sum(y**2, axis=1)))
        base, lag, noise, first = np.eye(3), np.zeros(4), np.nan, np.nan
        for turn in range(_ROUNDS):
            segment, attitude, slope = attitudes_in_segments(gyro - lag[:3], float(self.rate), SEGMENT, lag[3])
            kept = (segment >= 0) & np.isfinite(y).all(axis=1)
            _enough(int(kept.sum()), "readings with rates")
            number, member = np.unique(segment[kept], return_inverse=True)
            count = len(member)
            rows = {"y": y[kept] / size, "attitude": attitude[kept], "slope": slope[kept], "member": member}
            data = {name: filled(x, x[:1]) for name, x in rows.items()}
            data |= {"weight": filled(np.ones(count)), "base": base, "segments": filled(np.ones(len(number)))}
            begin = {"rho": np.zeros(3), "bias": np.zeros(3), "delay": np.float64(0.0)}
            free = max(count - len(number), 1)
            if not turn:
                first = noise = np.sqrt(np.sum(np.square(_values(turn_residuals, begin, data))) / (3 * free))
            # in standard deviations, the same unit as the prior of the delay
            data["weight"] = data["weight"] / max(noise, _EXACT)
            fit = solve(turn_residuals, begin, data, priors=Gaussian("delay", -lag[3], DELAY))
            found, last = fit.model, noise
            base = base @ scipy.spatial.transform.Rotation.from_rotvec(np.array(found["rho"])).as_matrix()
            lag = lag + np.append(np.asarray(found["bias"]), np.asarray(found["delay"]))
            noise = max(noise, _EXACT) * np.sqrt(np.sum(np.square(fit.residuals)) / (3 * free))
            if turn and abs(float(found["delay"])) < _SETTLED and abs(noise - last) < 0.01 * last:
                break
        matrix = spread_of(fit)
        # the field of each segment was estimated too
        left = np.asarray(fit.degrees_of_freedom)
        matrix = matrix * left / max(left - 3 * len(number), 1)
        names = [name.partition("[")[0] for name in fit.names]
        turned = [i for i, name in enumerate(names) if name == "rho"]
        return alignment_of(
            model, base, np.eye(3), matrix[np.ix_(turned, turned)], np.array([first, noise]), count, "gyro", fit, bias=lag[:3],
            delay=(float(lag[3]), float(np.sqrt(matrix[names.index("delay"), names.index("delay")]))),
        )  # fmt: skip


class Headings(eqx.Module):
    """Known headings of the readings.

    Attributes
    ----------
    headings : (n,) headings in rad, NaN where unknown.
    accel : (n, 3) specific force, which gives the tilt; without it all readings count as level.
    declination : subtracted from the headings, rad; 0 if they are magnetic.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Headings
    >>> known = Headings(np.deg2rad([0.0, 90.0, 180.0, 270.0]), accel=np.tile([0.0, 0.0, -9.81], (4, 1)))
    >>> known.headings.shape
    (4,)
    """

    headings: Any
    accel: Any = None
    declination: float | int = 0.0

    def _align(self, y: np.ndarray, model: MagModel) -> "Alignment":
        headings = np.asarray(self.headings, dtype=float) - self.declination
        up = np.tile([0.0, 0.0, -9.81], (len(y), 1)) if self.accel is None else like(self.accel, y, "specific force")
        if headings.shape != (len(y),):
            raise DataError(f"The headings have shape {headings.shape}; give one for each of {len(y)} readings, NaN where none is known.",
                            code="heading_shape")  # fmt: skip
        kept = np.isfinite(headings) & np.isfinite(up).all(axis=1) & np.isfinite(y).all(axis=1)
        _enough(int(kept.sum()), "known headings")
        y, up, headings = y[kept], up[kept], headings[kept]
        data = {"y": filled(y, y[:1]), "f": filled(up, up[:1]), "angle": filled(headings)}
        data |= {"weight": filled(np.ones(len(y))), "base": np.eye(3)}

        def away(base: np.ndarray) -> float:
            return float(np.sqrt(np.sum(np.square(_values(heading_residuals, {"rho": np.zeros(3)}, data | {"base": base}))) / len(y)))

        # far from the truth the headings have other minima, so the 24 ways to exchange axes are tried
        base = np.eye(3) if away(np.eye(3)) < _FAR else min(permutations(), key=away)
        rotation, _, matrix, fits = _turned(heading_residuals, {}, data | {"base": base})
        spread = np.array([away(base), np.sqrt(np.sum(np.square(fits[0].residuals)) / len(y))])
        return alignment_of(model, rotation, base, matrix, spread, len(y), "headings", fits[-1])


Aid = Accelerometer | Gyroscope | Headings


@host_float64
def align(m: Any, model: MagModel, aid: Any) -> Alignment:
    r"""Rotation of a calibrated magnetometer against an accelerometer, a gyroscope, or known headings.

    With the corrected field y = C^{-1}(m - b), and Q the rotation from the axes of the other sensor:

    - `Accelerometer`, at rest: the angle between field and vertical is constant, :math:`y_i^T Q f_i / (|y_i||f_i|) = -\sin I`;
    - `Gyroscope`: the field is constant in space while the sensor turns, :math:`\dot y = -(Q\omega) \times y`, integrated over segments
      of 2 rad, with a constant bias of the rates;
    - `Headings`: :math:`\psi(Q^T y_i, f_i) = \psi_i`, for poses that are level or have an accelerometer.

    Parameters
    ----------
    m : (n, 3) readings; rows with NaN are not used.
    model : `MagModel` of a fit, to these or to other readings.
    aid : `Accelerometer`, `Gyroscope` or `Headings`, one row for each reading.

    Returns
    -------
    Alignment
        The rotation with its verdict. It is "refused" if the poses do not determine the rotation, such as level poses, which do not
        determine the rotation about the vertical.

    Raises
    ------
    DataError
        If the shapes do not match, or too few readings are left.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Accelerometer, MagModel, align, body_field, scenario
    >>> attitudes = scenario("all", samples=40)
    >>> field, up = body_field(attitudes, 50.0), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    >>> turned = MagModel(np.array([[1.0, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    >>> found = align(turned.measure(field), MagModel(np.eye(3), np.zeros(3)), Accelerometer(up))
    >>> print(found.verdict, np.rad2deg([found.angle, found.dip]).round(2))
    good [ 1.15 57.  ]

    References
    ----------
    X. Li and Z. Li, Meas. Sci. Technol. 23 (2012) 105105 (accelerometer, the dot product); Y. Wu et al., IEEE Sensors J. 18 (2018) 9015
    (gyroscope).
    """
    if not isinstance(aid, Aid):
        raise DataError(f"The aid is {type(aid).__name__}; give Accelerometer(f), Gyroscope(w, rate) or Headings(h).",
                        code="no_such_aid")  # fmt: skip
    m = array(m, "readings")
    return aid._align((m - np.asarray(model.hard_iron)) @ np.linalg.inv(np.asarray(model.soft_iron)).T, model)


def _enough(count: int, what: str) -> None:
    if count < _FEWEST:
        raise DataError(f"{count} {what} are left to align with; at least {_FEWEST} are needed.", code="few_readings")


@filter_jit
def _values(function: Callable, parameters: dict[str, Any], data: Any) -> jax.Array:
    return function(parameters, data)


def _turned(
    function: Callable, start: dict[str, Any], data: Any, free: Any = None
) -> tuple[np.ndarray, dict[str, Any], np.ndarray, list[Fit]]:
    """Rotation, other parameters, covariance of the rotation, and two fits. The second starts at the solution, so its vector is small."""
    start, fits = {"rho": np.zeros(3), **start}, []
    for _ in range(2):
        fits.append(solve(function, start, data, free=free))
        turn = scipy.spatial.transform.Rotation.from_rotvec(np.array(fits[-1].model["rho"])).as_matrix()
        start, data = {**fits[-1].model, "rho": np.zeros(3)}, {**data, "base": data["base"] @ turn}
    order = [i for i, name in enumerate(fits[-1].names) if name.startswith("rho")]
    return data["base"], start, spread_of(fits[-1])[np.ix_(order, order)], fits


def spread_of(fit: Fit) -> np.ndarray:
    """Covariance of the parameters, for white residuals; otherwise from fits without parts of the log."""
    matrix, counted = np.asarray(covariance(fit, scaled=True)), np.asarray(fit.counted)
    jacobian, residuals = np.asarray(fit.jacobian)[counted], np.asarray(fit.residuals)[counted]
    if not np.isfinite(matrix).all() or not np.std(residuals) > _EXACT or is_white(jacobian, residuals):
        return matrix
    prior = np.asarray(fit.prior_jacobian)
    known = prior.T @ prior
    inverse = np.linalg.pinv(jacobian.T @ jacobian + known, hermitian=True)
    return leave_out(jacobian, residuals, known) + inverse @ known @ inverse


def still(accel: np.ndarray) -> np.ndarray:
    """Readings whose specific force is close to gravity; its size is taken from the median, so that any unit will do."""
    size = np.linalg.norm(accel, axis=1)
    there = np.isfinite(size) & (size > 0)
    usual = np.median(size[there]) if there.any() else np.inf
    return there & (np.abs(size / usual - 1) < _STILL)


def alignment_of(model, rotation, base, matrix, spread, used, source, fit, dip=float("nan"), bias=None, delay=None) -> Alignment:
    rho = scipy.spatial.transform.Rotation.from_matrix(base.T @ rotation).as_rotvec()
    angle = float(np.linalg.norm(rho))
    along = rho / angle if angle > 1e-12 else np.full(3, 3**-0.5)
    known = bool(fit.usable) and np.isfinite(matrix).all()
    matrix = matrix if known else np.full((3, 3), np.inf)
    said = [] if known else [FINDINGS("rotation_open", sensor=NAMES[source])]
    if known:
        worst, axes = np.linalg.eigh(matrix)
        most, axis = float(np.sqrt(max(worst[-1], 0.0))), "xyz"[int(np.argmax(np.abs(axes[:, -1])))]
        if not most <= LIMITS[0]:
            severity = CAUTION if most <= LIMITS[1] else FATAL
            facts = {"sensor": NAMES[source], "error": Quantity(most, "angle"), "axis": axis}
            said.append(FINDINGS("rotation_uncertain", severity=severity, cost=most, **facts))
        if delay is not None and delay[1] > _OPEN * DELAY:
            said.append(FINDINGS("delay_open"))
    return Alignment(
        model=MagModel(np.asarray(model.soft_iron) @ rotation, np.asarray(model.hard_iron)), rotation=rotation, covariance=matrix,
        angle=angle, angle_error=float(np.sqrt(along @ matrix @ along)) if known else np.inf, dip=dip, spread=spread,
        bias=np.zeros(3) if bias is None else bias, used=used, source=source, findings=tuple(said),
        delay=float("nan") if delay is None else delay[0], delay_error=float("nan") if delay is None else delay[1],
    )  # fmt: skip
