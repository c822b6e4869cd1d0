"""Sensors beside the magnetometer: what they tell of the attitudes, and the fit together with them."""

from typing import Any, NamedTuple

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import FATAL, Finding, Number, Result, Section, listed
from .._arrays import axis_turns
from .._errors import DataError
from .._special import NORMAL95
from .._types import AnyArray
from ._aided import Attitudes, Known, Solution, averaged, north_of, poses, solved
from ._attitude import Attitude
from ._axes import FEWEST, Axes, axes_by_headings, axes_by_rates, axes_of, by_axes
from ._design._heading_error import TURNED
from ._ellipsoid._algebraic import NEAR_PLANAR, Frame, extents, sphere_centre, unit
from ._field import INCLINATION
from ._findings import FINDINGS
from ._turning import attitudes_in_segments

_STILL = 0.03  # relative departure of the specific force from its median above which a pose is not at rest
#: rad between verticals of one pose, ten times the scatter of an accelerometer by hand; usual steps between its readings: 1 in 10,000 of
#: those with normal noise is farther off
_POSE, _STEPS = np.deg2rad(3.0), 3.0
_DIP, _ANY_DIP, _FIELD = np.deg2rad(0.5), 0.5, 0.02  # rad, prior spread of a given dip, and of one that is not; share of a given field
#: source of a rotation -> its name for readers
NAMES = {"accel": "accelerometer", "gyro": "gyroscope", "headings": "known headings", "attitude": "attitudes",
         "": "magnitudes", "plane": "plane"}  # fmt: skip


class Alignment(Result):
    """Rotation between a magnetometer and the sensor it was fitted with.

    Attributes
    ----------
    rotation : (3, 3) Q from the axes of the other sensor to those of the field that a symmetric soft iron would give.
    covariance : (3, 3) of the rotation vector about the other sensor's axes, rad^2.
    angle : of the rotation from the nearest exchange of axes, rad.
    dip : inclination of the field, positive downwards, rad; NaN with a gyroscope.
    spread : standard deviation of a reading from where the other sensor puts it, rad.
    bias : (3,) bias of the gyroscope, rad/s; zero with other sensors.
    delay, delay_error : time by which the magnetometer lags the gyroscope in s, and its standard deviation; NaN with other sensors.
    used : number of readings, or poses, with the other sensor.
    source : "accel", "attitude", "gyro" or "headings".
    findings : a note if the turns do not show the delay. The error of the rotation is a part of the heading error, which gives the verdict.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import Accelerometer, MagModel, body_field, scenario
    >>> attitudes = scenario("all", samples=40)
    >>> field, up = body_field(attitudes, 50.0), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    >>> turned = MagModel(np.array([[1.0, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    >>> found = jaxcal.magnetometer.fit(turned.measure(field), aid=Accelerometer(up)).alignment
    >>> found.verdict, found.source, round(float(np.rad2deg(found.angle)), 2)
    ('good', 'accel', 1.15)
    """

    rotation: AnyArray
    covariance: AnyArray
    angle: float
    dip: float
    spread: float
    bias: AnyArray
    used: int
    source: str = eqx.field(static=True)
    delay: float = float("nan")
    delay_error: float = float("nan")
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The angle of the rotation, and how well it is known."""
        most = float(np.sqrt(max(np.linalg.eigvalsh(self.covariance)[-1], 0.0)))
        return f"rotated by {np.rad2deg(self.angle):.2g} deg, known to {np.rad2deg(most):.2g} deg"

    def sections(self) -> list[Section]:
        """Angle, dip, scatter, delay."""
        vector = _vector(np.asarray(self.rotation))
        along = vector / self.angle if self.angle > 1e-12 else np.full(3, 3**-0.5)
        off, late = NORMAL95 * float(np.sqrt(max(along @ self.covariance @ along, 0.0))), NORMAL95 * self.delay_error
        rows = {
            "rotation": Number("angle", self.angle, self.angle - off, self.angle + off, "angle"),
            "dip of the field": Number("dip", self.dip, quantity="angle"),
            "scatter": Number("spread", self.spread, quantity="angle"),
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
    turns : whether to rotate the axes of the magnetometer to those of the accelerometer. If False, `fit` only takes the dip from the
        accelerometer, and only if the axes agree so well that the dip of the readings at rest scatters by less than 5 degrees.

    Examples
    --------
    >>> from jaxcal.magnetometer import Accelerometer, body_field, scenario
    >>> Accelerometer(-9.81 * body_field(scenario("all", samples=40), 1.0, 1.57)).accel.shape
    (40, 3)
    """

    accel: Any
    dip: float | int | None = None
    turns: bool = eqx.field(static=True, default=True)


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


class Plane(NamedTuple):
    """The axis that points down for readings that turn about it, which is all that a plane tells; and whether the user said so."""

    down: np.ndarray
    asked: bool


def array(values: Any, name: str) -> np.ndarray:
    """Vectors (n, 3), checked."""
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise DataError(f"The {name} have shape {values.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    return values


def like(values: Any, count: int, name: str) -> np.ndarray:
    """Vectors (n, 3), one for each reading."""
    values = array(values, name)
    if len(values) != count:
        raise DataError(f"There are {count} readings and {len(values)} rows of {name}; give one for each reading.", code="rows_differ")
    return values


def still(accel: np.ndarray) -> np.ndarray:
    """Readings whose specific force is close to gravity; its size is taken from the median, so that any unit will do."""
    size = np.linalg.norm(accel, axis=1)
    there = np.isfinite(size) & (size > 0)
    usual = np.median(size[there]) if there.any() else np.inf
    return there & (np.abs(size / usual - 1) < _STILL)


def verticals(accel: Any, count: int) -> np.ndarray:
    """Unit vectors that point up, (n, 3), NaN where the sensor is not at rest."""
    force = like(accel, count, "specific force")
    return np.where(still(force)[:, None], unit(force), np.nan)


def told(aid: Any, count: int) -> tuple[Attitudes, str]:
    """What an aid tells of the attitudes of all readings of a log, and its name."""
    if aid is None:
        return Attitudes(rotated=False), ""
    if isinstance(aid, Gyroscope):
        return Attitudes(gyro=like(aid.gyro, count, "rates"), rate=float(aid.rate), rows=np.arange(count)), "gyro"
    if isinstance(aid, Accelerometer | Attitude):
        return Attitudes(up=verticals(aid.accel, count)), "accel" if isinstance(aid, Accelerometer) else "attitude"
    if isinstance(aid, Plane):
        return Attitudes(up=np.tile(-aid.down, (count, 1)), rotated=False), "plane"
    if not isinstance(aid, Headings):
        raise DataError(
            f"The aid is {type(aid).__name__}; give Accelerometer(f), Attitude(q), Gyroscope(w, rate) or Headings(h).", code="no_such_aid"
        )
    heading = np.asarray(aid.headings, dtype=float) - aid.declination
    if heading.shape != (count,):
        raise DataError(f"The headings have shape {heading.shape}; give one for each of {count} readings, NaN where none is known.",
                        code="heading_shape")  # fmt: skip
    level = np.where(np.isfinite(heading)[:, None], [0.0, 0.0, -1.0], np.nan)
    return Attitudes(level if aid.accel is None else verticals(aid.accel, count), heading, rotated=aid.accel is not None), "headings"


def down_by(up: Any) -> np.ndarray | None:
    """The axis that points down at level: the mean vertical of a sensor that tilts little; None for one turned through all attitudes."""
    if up is None or not np.isfinite(up).all(axis=1).any():
        return None
    mean = np.nanmean(up, axis=0)
    size = float(np.linalg.norm(mean))
    return -mean / size if size > TURNED else None


def fitted(
    m: np.ndarray, rows: np.ndarray, at: Attitudes, source: str, first: Any, known: tuple[Any, Any, Any, Any], currents: np.ndarray | None
) -> tuple[Solution | None, Frame, Axes | None]:
    """Fit readings (n, 3) in the given rows together with an aid, from the fit `first` of magnitudes; no solution with wrong axes.

    known : field in the unit of the readings and its relative error, dip in rad, or None; and the dip of the aid.
    """
    field, field_error, dip, own = known
    dip = own if own is not None else dip
    x, frame = m[rows], Frame.of(m[rows])
    up, heading = (None if part is None else part[rows] for part in (at.up, at.heading))
    if up is not None and source != "plane":
        number = poses(x, up, heading, _POSE, _STEPS)
        x, up, currents = averaged(x, number), averaged(up, number), None if currents is None else averaged(currents, number)
        up = unit(up)
        heading = None if heading is None else averaged(heading, number)
    count = len(x) if source == "" else int(np.isfinite(up).all(axis=1).sum()) if up is not None else len(rows)
    if count < FEWEST:
        raise DataError(f"{count} readings with the {NAMES[source]} are left; at least {FEWEST} are needed.", code="few_readings")
    u = frame.scaled(x)
    at = at._replace(up=up, heading=heading, rows=rows if at.gyro is not None else None)
    model = first.model if first.verdict != "refused" else None
    if model is not None:
        matrix = np.asarray(model.soft_iron) * first.field / frame.scale
        centre = (np.asarray(model.hard_iron) - frame.centre) / frame.scale
    else:
        matrix, centre = _round(u, INCLINATION if dip is None else dip)
    y = unit((u - centre) @ np.linalg.inv(matrix).T)
    axes = _axes(y, at, INCLINATION if dip is None else dip, model is not None)
    if any(one.severity == FATAL for one in by_axes(axes, 0.0 if dip is None else float(np.sign(dip)))):
        return None, frame, axes
    base = np.eye(3) if axes is None else axes.turn
    if source == "headings":
        # they show a rotation about the vertical; nothing shows one about a level axis if there is no accelerometer
        down = down_by(up) if at.rotated else None
        at = at._replace(held=np.zeros((0, 3)) if down is None else np.eye(3) - np.outer(base @ down, base @ down))
    # the accelerometer's own dip is the start, and against it a given one would pull the fit apart
    seen = axes.dip if axes is not None and np.isfinite(axes.dip) else None
    agrees = seen is None or (dip is not None and np.sign(seen) == np.sign(dip))
    prior = Known(
        0.0 if field is None else float(np.log(field / frame.scale)),
        np.inf if field is None else _FIELD if field_error is None else float(field_error), field_error is not None,
        float(dip) if dip is not None and agrees else INCLINATION if seen is None else seen,
        _DIP if dip is not None and agrees else _ANY_DIP,
    )  # fmt: skip
    noise = first.noise / frame.scale if np.isfinite(first.noise) else 0.01
    return solved(u, at, (matrix @ base, centre), base, prior, currents, noise), frame, axes


def _axes(y: np.ndarray, at: Attitudes, dip: float, usable: bool) -> Axes | None:
    """The axes of the other sensor by what it tells of the attitudes of corrected unit fields."""
    if at.gyro is not None:
        segment, attitude, _ = (x[at.rows] for x in attitudes_in_segments(at.gyro, at.rate))
        there = segment >= 0
        return axes_by_rates(y[there], attitude[there], np.unique(segment[there], return_inverse=True)[1])
    there = np.zeros(0, dtype=bool) if at.heading is None else np.isfinite(at.heading) & np.isfinite(at.up).all(axis=1)
    if at.heading is not None and there.sum() >= FEWEST:
        return axes_by_headings(y[there], north_of(at.up[there], at.heading[there], dip))
    return axes_of(y, at.up) if at.up is not None and usable and at.rotated else None


def _round(u: np.ndarray, dip: float) -> tuple[np.ndarray, np.ndarray]:
    """Start from a sphere through scaled readings; a circle has the size of the field's horizontal part."""
    centre = sphere_centre(u)
    size = float(np.sqrt(np.mean(np.sum((u - centre) ** 2, axis=1))))
    flat = extents(u - u.mean(axis=0))
    size = size / np.cos(dip) if flat[-1] < 4 * NEAR_PLANAR * flat[0] else size
    return size * np.eye(3), centre


def alignment_of(found: Solution, source: str) -> Alignment:
    """The rotation in a solution: C = S Q with a symmetric S."""
    left, values, right = np.linalg.svd(found.matrix)
    rotation, whole = left @ right, (right.T * values) @ right
    by = [rotation.T @ step.reshape(3, 3) for step in np.eye(9)]
    turns = np.array([_turn(whole, one) for one in by]).T
    covariance = turns @ found.covariance[:9, :9] @ turns.T
    rates = source == "gyro"
    late = float(np.sqrt(found.covariance[17, 17])) if rates else float("nan")
    said = tuple(FINDINGS.over("delay_open", late))
    return Alignment(
        rotation, covariance, float(np.linalg.norm(_vector(rotation))), float("nan") if rates else float(found.parameters[13]),
        found.spread, found.parameters[14:17] if rates else np.zeros(3), int(np.sum(found.along)), source,
        float(found.parameters[17]) if rates else float("nan"), late, said,
    )  # fmt: skip


def _vector(rotation: np.ndarray) -> np.ndarray:
    """Rotation vector from the nearest exchange of axes."""
    base = max(axis_turns(), key=lambda one: np.trace(one.T @ rotation))
    return scipy.spatial.transform.Rotation.from_matrix(base.T @ rotation).as_rotvec()


def _turn(whole: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Rotation vector w that a change Q'dC = [w]x P + dP contains, for the symmetric P = (C'C)^(1/2): (tr P - P) w = its odd part."""
    odd = np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]])
    return np.linalg.solve(np.trace(whole) * np.eye(3) - whole, odd)
