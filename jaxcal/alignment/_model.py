"""`Turntable`: every reading of both sensors as a function of attitude, sensor errors and latitude."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._errors import DataError
from .._precision import array_module
from .._types import AnyArray
from ._frames import EARTH_RATE, GRAVITY, table_from_nav
from ._positions import Sensor, as_positions


class Geometry(eqx.Module):
    """What the readings at n positions need of the table, computed once: both true vectors are linear in the axes of the table.

    Attributes
    ----------
    time : (n,) middle of the dwell, s, counted from the middle of the test.
    axes : (n, 3, 3) sensitive axis and two cross axes in table axes; the mean over a sector shortens their turning part.
    force : (n, 3) specific force along them that the table's motion gives, m/s^2. coriolis : (n, 3, 3) m/s, times the Earth's rate.
    rate : (n, 3) angular rate along them that the table's motion gives, rad/s.
    gravity : m/s^2.
    """

    time: AnyArray
    axes: AnyArray
    force: AnyArray
    coriolis: AnyArray
    rate: AnyArray
    gravity: Any


def geometry(positions: Any, gravity: Any = GRAVITY, lever_arm: Any = 0.0) -> Geometry:
    """Geometry of `Positions`, of table angles in rad, or of any object with the arrays of `Positions`; itself where it is one."""
    if isinstance(positions, Geometry):
        return positions
    places = positions if hasattr(positions, "axes") else as_positions(positions)
    xp = array_module(places, gravity, lever_arm)
    angle, rate, width, axes = (xp.asarray(value) for value in (places.angle, places.rate, places.width, places.axes))
    # the mean of a first harmonic over a sector
    half = xp.where(width != 0, width, 1) / 2
    part = xp.where(width != 0, xp.sin(half) / half, 1)
    c, s, zero = part * xp.cos(angle), part * xp.sin(angle), xp.zeros_like(angle)
    body = xp.stack([xp.stack([c, s, zero], -1), xp.stack([-s, c, zero], -1), xp.stack([zero, zero, zero + 1], -1)], 1)
    motion = xp.stack([-lever_arm * rate**2, lever_arm * places.acceleration, zero], -1)
    # 2 w x [0, l omega, 0] = 2 l omega [-w_z, 0, w_x]
    coriolis = 2 * (lever_arm * rate)[:, None, None] * xp.stack([-body[:, 2], 0 * body[:, 1], body[:, 0]], 1)
    along = lambda vectors: (axes * vectors[:, None, :]).sum(-1)  # noqa: E731
    turning = xp.stack([zero, zero, zero + rate], -1)
    return Geometry(xp.asarray(places.time), axes @ body, along(motion), axes @ coriolis, along(turning), gravity)


class Turntable(eqx.Module):
    r"""A turntable with one accelerometer and one gyro: attitude, sensor errors and latitude.

    .. math:: m = (1 + s)\,u\cdot v + MA_1 v_1\cdot v + MA_2 v_2\cdot v + b + \dot b\,t,\qquad
        f = a_{rel} + 2\omega_E \times v_{rel} - g,\quad \omega = \omega_E + \omega_{table}

    u is the sensitive axis, v_1 and v_2 the cross axes. The fields are the parameters that `fit` estimates. A subclass with one more
    number, whose `measure` uses it, is fitted, reported and drawn as well (``fit(readings, latitude, model=Mine(), free=...)``).

    Attributes
    ----------
    phi, theta, psi : roll, pitch and azimuth of the table, rad.
    b_a, s_a, b_g, s_g : bias and scale error of the accelerometer (m/s^2) and of the gyro (rad/s).
    ma_a_xy, ma_a_xz, ma_g_xy, ma_g_xz : misalignments towards the first and the second cross axis, rad.
    b_a_rate, b_g_rate : drift of the biases per second about the middle of the test.
    latitude : rad, north positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Turntable
    >>> accel, gyro = Turntable(theta=np.pi / 6).measure(np.deg2rad([0.0, 90.0, 180.0]))
    >>> print(accel.round(3) + 0.0)
    [ 4.903  0.    -4.903]

    References
    ----------
    The north-finding paper's equations (16), (18), (22), (23) and (36) to (39), in corrected form.
    """

    phi: Any = 0.0
    theta: Any = 0.0
    psi: Any = 0.0
    b_a: Any = 0.0
    s_a: Any = 0.0
    b_g: Any = 0.0
    s_g: Any = 0.0
    ma_a_xy: Any = 0.0
    ma_a_xz: Any = 0.0
    ma_g_xy: Any = 0.0
    ma_g_xz: Any = 0.0
    b_a_rate: Any = 0.0
    b_g_rate: Any = 0.0
    latitude: Any = 0.0

    @property
    def matrix(self) -> AnyArray:
        """C_TN, (3, 3): from north, east, down to table axes."""
        return table_from_nav(self.phi, self.theta, self.psi)

    @property
    def earth_rate(self) -> AnyArray:
        """(3,) the Earth's rate in table axes over its size, C_TN [cos lat, 0, -sin lat]."""
        xp, matrix = array_module(self), self.matrix
        return matrix[:, 0] * xp.cos(self.latitude) - matrix[:, 2] * xp.sin(self.latitude)

    def truth(self, positions: Any, *, gravity: Any = GRAVITY, lever_arm: Any = 0.0) -> tuple[AnyArray, AnyArray]:
        """Specific force (n, 3), m/s^2, and angular rate (n, 3), rad/s, along the sensitive and the two cross axes; see `measure`."""
        places = geometry(positions, gravity, lever_arm)
        down, earth = self.matrix[:, 2], EARTH_RATE * self.earth_rate
        force = places.force + places.coriolis @ earth - places.gravity * (places.axes @ down)
        return force, places.rate + places.axes @ earth

    def measure(self, positions: Any, *, gravity: Any = GRAVITY, lever_arm: Any = 0.0) -> tuple[AnyArray, AnyArray]:
        """Readings of the accelerometer (n,), m/s^2, and of the gyro (n,), rad/s, without noise.

        Parameters
        ----------
        positions : `Positions`, table angles in rad, or the `places` of a `Table`, which hold gravity and lever arm themselves.
        gravity : m/s^2.
        lever_arm : distance of the sensors from the table's axis along body x, m.
        """
        places = geometry(positions, gravity, lever_arm)
        xp, (force, rate) = array_module(self, places), self.truth(places)
        accel = force @ xp.stack([xp.asarray(1 + self.s_a), xp.asarray(self.ma_a_xy), xp.asarray(self.ma_a_xz)])
        gyro = rate @ xp.stack([xp.asarray(1 + self.s_g), xp.asarray(self.ma_g_xy), xp.asarray(self.ma_g_xz)])
        return accel + self.b_a + self.b_a_rate * places.time, gyro + self.b_g + self.b_g_rate * places.time

    def correct(self, accel: Any, gyro: Any, positions: Any, *, gravity: Any = GRAVITY, lever_arm: Any = 0.0) -> tuple[AnyArray, AnyArray]:
        """What sensors without errors would have read: the readings less what bias, drift, scale and misalignment add at this attitude."""
        places = geometry(positions, gravity, lever_arm)
        errors = (own - true[:, 0] for own, true in zip(self.measure(places), self.truth(places), strict=True))
        return tuple(reading - error for reading, error in zip((accel, gyro), errors, strict=True))  # type: ignore[return-value]


NAMES = tuple(field.name for field in dataclasses.fields(Turntable))
#: parameter -> its unit; a parameter of a subclass has none here
UNITS = dict(zip(NAMES, ("rad",) * 3 + ("m/s^2", "", "rad/s", "") + ("rad",) * 4 + ("m/s^3", "rad/s^2", "rad"), strict=True))
ANGLES = NAMES[:3]


def names_of(model: Any) -> tuple[str, ...]:
    """Names of the parameters of a model, in order."""
    found = [(jax.tree_util.keystr(path, simple=True, separator="."), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(model)]
    other = [name for name, leaf in found if np.shape(leaf)]
    if not isinstance(model, Turntable) or other:
        what = f"{other[0]} is an array" if other else f"it is {type(model).__name__}"
        raise DataError(f"A model is a `Turntable` or a subclass with numbers as fields, but {what}; give one field for each number.")
    return tuple(name for name, _ in found)


def with_values(model: Any, values: Any) -> Any:
    """The model with other values, in the order of `names_of`."""
    return jax.tree.unflatten(jax.tree.structure(model), list(values))


def turntable(attitude: Any, latitude: Any, accel: Sensor, gyro: Sensor) -> Turntable:
    """The model of two sensors on a table."""
    (a1, a2), (g1, g2) = accel.misalignment, gyro.misalignment
    errors = (accel.bias, accel.scale_error, gyro.bias, gyro.scale_error, a1, a2, g1, g2, accel.bias_rate, gyro.bias_rate)
    return with_values(Turntable(), [*attitude, *errors, latitude])
