"""What a fit is asked: its readings, its options, and the sensors beside the magnetometer with what they tell of the attitudes."""

from collections import namedtuple
from typing import ClassVar, NamedTuple

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._arrays import axis_turns
from .._errors import DataError
from .._special import NORMAL95
from .._types import Any, AnyArray, Held
from ._quadric import unit

_STILL = 0.03  # relative departure of the specific force from its median above which a pose is not at rest

#: source of a rotation -> its name for readers
NAMES = {"accel": "accelerometer", "gyro": "gyroscope", "headings": "known headings", "attitude": "attitudes",
         "": "magnitudes", "plane": "plane"}  # fmt: skip


class Alignment(Result):
    """Rotation between a magnetometer and the sensor it was fitted with.

    Attributes
    ----------
    rotation : (3, 3) Q from the axes of the other sensor to those of the field that a symmetric soft iron would give.
    covariance : (3, 3) of the rotation vector about the other sensor's axes, rad^2.
    dip : inclination of the field, positive downwards, rad; NaN with a gyroscope.
    spread : standard deviation of a reading from where the other sensor puts it, rad.
    bias : (3,) bias of the gyroscope, rad/s; zero with other sensors.
    delay, delay_error : time by which the magnetometer lags the gyroscope in s, and its standard deviation; NaN with other sensors.
    used : number of readings, or poses, with the other sensor.
    source : "accel", "attitude", "gyro" or "headings".

    The error of the rotation is a part of the heading error, which gives the verdict of the fit.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import Accelerometer, MagModel, body_field, scenario
    >>> attitudes = scenario("all", samples=40)
    >>> field, up = body_field(attitudes, 50.0), -9.81 * body_field(attitudes, 1.0, np.pi / 2)
    >>> turned = MagModel(np.array([[1.0, -0.02, 0.0], [0.02, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.zeros(3))
    >>> found = jaxcal.magnetometer.fit(turned.measure(field), aid=Accelerometer(up)).alignment
    >>> found.source, round(float(np.rad2deg(found.angle)), 2)
    ('accel', 1.15)
    """

    findings: ClassVar[tuple[Finding, ...]] = ()  # they are those of the fit
    rotation: AnyArray
    covariance: AnyArray
    dip: float
    spread: float
    bias: AnyArray
    used: int
    source: str = eqx.field(static=True)
    delay: float = float("nan")
    delay_error: float = float("nan")

    @property
    def headline(self) -> str:
        """The angle of the rotation, and how well it is known."""
        return f"rotated by {np.rad2deg(self.angle):.2g} deg, known to {np.rad2deg(np.linalg.norm(self.covariance, 2) ** 0.5):.2g} deg"

    @property
    def vector(self) -> np.ndarray:
        """(3,) rotation vector from the nearest exchange of axes, rad."""
        base = max(axis_turns(), key=lambda one: np.trace(one.T @ np.asarray(self.rotation)))
        return scipy.spatial.transform.Rotation.from_matrix(base.T @ np.asarray(self.rotation)).as_rotvec()

    @property
    def angle(self) -> float:
        """Angle of the rotation from the nearest exchange of axes, rad."""
        return float(np.linalg.norm(self.vector))

    def sections(self) -> list[Section]:
        """Angle, dip, scatter, delay."""
        along = self.vector / self.angle if self.angle > 1e-12 else np.full(3, 3**-0.5)
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
    turns : whether to rotate the axes of the magnetometer to those of the accelerometer. If False, `fit` only takes the dip from the
        accelerometer, and only if the axes agree so well that the dip of the readings at rest scatters by less than 5 degrees.

    Examples
    --------
    >>> from jaxcal.magnetometer import Accelerometer, body_field, scenario
    >>> Accelerometer(-9.81 * body_field(scenario("all", samples=40), 1.0, 1.57)).accel.shape
    (40, 3)
    """

    accel: Held
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

    gyro: Held
    rate: float | int

    def __check_init__(self) -> None:
        if self.rate is None or not self.rate > 0:
            raise DataError(f"The rates are integrated: give the readings per second, a positive `rate`; got {self.rate!r}.",
                            code="no_rate")  # fmt: skip


class Headings(eqx.Module):
    """Known headings of the readings.

    Attributes
    ----------
    headings : (n,) magnetic headings in rad, NaN where unknown.
    accel : (n, 3) specific force, which gives the tilt; without it all readings count as level.
    error : standard deviation of what all headings are off by together, rad. Errors from one to the next are found from the readings.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Headings
    >>> known = Headings(np.deg2rad([0.0, 90.0, 180.0, 270.0]), accel=np.tile([0.0, 0.0, -9.81], (4, 1)))
    >>> known.headings.shape
    (4,)
    """

    headings: Held
    accel: Held | None = None
    error: float | int = 0.0


class Attitude(eqx.Module):
    r"""Attitudes at the times of the readings: they show the vertical while the vehicle turns and accelerates.

    The field keeps its direction in the world, so that its angle with the vertical is constant, for any heading:

    .. math:: u_i \cdot C^{-1} (m_i - b) = -\sin I

    with the upward vertical u in body axes and the dip I. Banked circles then show all of C. The headings of the attitudes are not used:
    a filter that has them from the compass under test would confirm its errors, and any other has an offset and a drift. Errors of the
    vertical may be correlated along the log; the stated error comes from fits without parts of the log, and allows for it.

    Attributes
    ----------
    quaternion : (n, 4) w, x, y, z, from body axes (forward, right, down) to a frame whose z axis points down (north, east, down); NaN where
        unknown. `jaxcal.io.flight(path).at(log)` has those of a flight log.

    Raises
    ------
    DataError
        Code "bad_shape" if the quaternions are not (n, 4).

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Attitude
    >>> Attitude(np.array([[1.0, 0.0, 0.0, 0.0]])).accel.tolist()
    [[0.0, 0.0, -1.0]]
    """

    turns: ClassVar[bool] = True  # the fit rotates the axes of the magnetometer to those of the body, as `Accelerometer.turns`
    quaternion: Held

    def __check_init__(self) -> None:
        if np.ndim(self.quaternion) != 2 or np.shape(self.quaternion)[1] != 4:
            raise DataError(f"The attitudes have shape {np.shape(self.quaternion)}; expected (n, 4), w first.", code="bad_shape")

    @property
    def accel(self) -> AnyArray:
        """(n, 3) unit vectors upwards in body axes: the direction of the specific force if the vehicle were at rest."""
        w, x, y, z = np.asarray(self.quaternion, float).T
        return -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w**2 - x**2 - y**2 + z**2], axis=1) + 0.0


class Attitudes(
    namedtuple("Attitudes", "source up heading gyro rate rows rotated off", defaults=("", *3 * [None], 0.0, None, True, np.inf))
):
    """What is known of the attitude of each of n readings: any of these, in the axes of one sensor.

    source : key of `NAMES`. up : (n, 3) unit vectors, NaN where unknown. heading : (n,) rad, NaN where unknown. gyro, rate, rows : rates
    (k, 3) in rad/s at all samples of a log, the samples per second, and the sample of each reading. rotated : whether C may have a rotation
    that these show. off : spread of what all headings are off by, infinite for nothing.
    """


class Asked(NamedTuple):
    """Readings and options of a fit, checked.

    Attributes
    ----------
    m : (n, 3) readings; NaN in some rows beside rates, which are integrated over all of them. there : numbers of the rows with a reading.
    method, model : as for `fit`. traced : whether the fit is in a trace; nothing is chosen then.
    norm, field_error, dip : magnitude of the field and its relative error, or None, and its dip. known : whether the dip was given.
    at : what the aid tells. turns : whether the fit turns the axes to its, which the accelerometer of a log does not.
    currents, conditions : name -> numbers at the times of the readings. parts : of a model object (see `parts_of`), or None.
    """

    m: np.ndarray
    there: np.ndarray
    method: str
    model: Any
    norm: float | None
    field_error: float | None
    dip: float
    known: bool
    at: Attitudes
    turns: bool
    currents: dict[str, np.ndarray]
    conditions: dict[str, np.ndarray]
    parts: Any = None
    traced: bool = False

    @property
    def sign(self) -> float:
        """Sign of the dip at the place; zero if it is not known."""
        return float(np.sign(self.dip)) if self.known else 0.0


def vectors(values: Any, name: str) -> np.ndarray:
    """Vectors (n, 3), checked."""
    values = np.asarray(values, dtype=float)
    if values.ndim != 2 or values.shape[1] != 3:
        raise DataError(f"The {name} have shape {values.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    return values


def verticals(accel: Any) -> np.ndarray:
    """Unit vectors that point up, (n, 3), NaN where the specific force is not close to gravity, whose size is its median in any unit."""
    force = vectors(accel, "specific force")
    size = np.linalg.norm(force, axis=1)
    there = np.isfinite(size) & (size > 0)
    usual = np.median(size[there]) if there.any() else np.inf
    return np.where((there & (np.abs(size / usual - 1) < _STILL))[:, None], unit(force), np.nan)


def told(aid: Any) -> Attitudes:
    """What an aid tells of the attitudes of all readings of a log."""
    if aid is None:
        return Attitudes(rotated=False)
    if isinstance(aid, Gyroscope):
        return Attitudes("gyro", gyro=vectors(aid.gyro, "rates"), rate=float(aid.rate))
    if isinstance(aid, Accelerometer | Attitude):
        return Attitudes("accel" if isinstance(aid, Accelerometer) else "attitude", verticals(aid.accel))
    if not isinstance(aid, Headings):
        raise DataError(f"The aid is {type(aid).__name__}; give an Accelerometer, Attitude, Gyroscope or Headings.", code="no_such_aid")
    heading, level = np.ravel(np.asarray(aid.headings, dtype=float)), aid.accel is None
    up = np.where(np.isfinite(heading)[:, None], [0.0, 0.0, -1.0], np.nan) if level else verticals(aid.accel)
    return Attitudes("headings", up, heading, rotated=not level, off=float(aid.error) or np.inf)
