"""`Turntable` predicts every reading from attitude, sensor errors and latitude; `Table` holds readings and priors as data."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import padded as long, power_of_two
from .._errors import DataError
from .._frozen import Model
from .._precision import array_module
from .._types import AnyArray, Leaf, Real
from ..noise import Noise
from ._noise import Sensor, covariance_of, joined, weight_of
from ._positions import EARTH_RATE, GRAVITY, Geometry, Places, Positions, Readings, geometry, table_from_nav

_SMALLEST_PAD = 16


class Turntable(Model):
    r"""A turntable with one accelerometer and one gyro: attitude, sensor errors and latitude.

    .. math:: m = (1 + s)\,u\cdot v + MA_1 v_1\cdot v + MA_2 v_2\cdot v + b + \dot b\,t,\qquad
        f = a_{rel} + 2\omega_E \times v_{rel} - g,\quad \omega = \omega_E + \omega_{table}

    u is the sensitive axis, v_1 and v_2 are the cross axes. The fields are the parameters that `fit` can estimate. To add a parameter,
    write a subclass with a further number that its `measure` uses (``fit(readings, latitude, model=Mine(), free=...)``).

    Attributes
    ----------
    phi, theta, psi : roll, pitch and azimuth of the table, rad.
    b_a, s_a, b_g, s_g : bias and scale error of the accelerometer (m/s^2) and of the gyro (rad/s).
    ma_a_xy, ma_a_xz, ma_g_xy, ma_g_xz : misalignments towards the first and the second cross axis, rad.
    b_a_rate, b_g_rate : drift of the biases per second; b_a and b_g refer to the middle of the test.
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

    phi: Leaf = 0.0
    theta: Leaf = 0.0
    psi: Leaf = 0.0
    b_a: Leaf = 0.0
    s_a: Leaf = 0.0
    b_g: Leaf = 0.0
    s_g: Leaf = 0.0
    ma_a_xy: Leaf = 0.0
    ma_a_xz: Leaf = 0.0
    ma_g_xy: Leaf = 0.0
    ma_g_xz: Leaf = 0.0
    b_a_rate: Leaf = 0.0
    b_g_rate: Leaf = 0.0
    latitude: Leaf = 0.0

    @property
    def matrix(self) -> AnyArray:
        """Rotation matrix C_TN, (3, 3), from north, east, down to table axes."""
        return table_from_nav(self.phi, self.theta, self.psi)

    @property
    def earth_rate(self) -> AnyArray:
        """(3,) unit vector of the Earth's rate in table axes, C_TN [cos lat, 0, -sin lat]."""
        return self._earth_rate(self.matrix)

    def _earth_rate(self, matrix: AnyArray) -> AnyArray:
        xp = array_module(self)
        return matrix @ xp.stack([xp.cos(self.latitude), 0 * self.latitude, -xp.sin(self.latitude)])

    def truth(self, positions: Places, *, gravity: Real = GRAVITY, lever_arm: Real = 0.0) -> tuple[AnyArray, AnyArray]:
        """True specific force (n, 3), m/s^2, and angular rate (n, 3), rad/s, along the sensitive and two cross axes; see `measure`."""
        places, matrix = geometry(positions, gravity, lever_arm), self.matrix
        earth = EARTH_RATE * self._earth_rate(matrix)
        force = places.force + places.coriolis @ earth - places.gravity * places.axes @ matrix[:, 2]
        return force, places.rate + places.axes @ earth

    def measure(self, positions: Places, *, gravity: Real = GRAVITY, lever_arm: Real = 0.0) -> tuple[AnyArray, AnyArray]:
        """Compute the noise-free readings of the accelerometer (n,), m/s^2, and of the gyro (n,), rad/s.

        Parameters
        ----------
        positions : `Positions`, table angles in rad, or the `places` of a `Table`, which already include gravity and lever arm.
        gravity : m/s^2.
        lever_arm : distance of the sensors from the table's axis along body x, m.
        """
        places = geometry(positions, gravity, lever_arm)
        xp, (force, rate) = array_module(self, places), self.truth(places)
        accel = force @ xp.stack([xp.asarray(1 + self.s_a), xp.asarray(self.ma_a_xy), xp.asarray(self.ma_a_xz)])
        gyro = rate @ xp.stack([xp.asarray(1 + self.s_g), xp.asarray(self.ma_g_xy), xp.asarray(self.ma_g_xz)])
        accel = accel + self.b_a + self.b_a_rate * places.time
        return accel, gyro + self.b_g + self.b_g_rate * places.time


class Triads(Turntable):
    r"""A turntable with a full IMU: each axis has its own bias, and the z axes need not be parallel to the table's axis.

    .. math:: m_z = f_z + MA_{zx} f_x + MA_{zy} f_y + b_z

    Scale errors and the other misalignments are common to all axes, so correct the readings with the calibration of the IMU first. If the
    x and y axes are not perpendicular to the table's axis, this adds a constant, which is part of their biases. The mountings of the rows
    are "x", "y" and "fixed z".

    Attributes
    ----------
    b_a_y, b_a_z, b_g_y, b_g_z : biases of the y and z axes; b_a and b_g are the biases of the x axes.
    ma_a_zx, ma_a_zy, ma_g_zx, ma_g_zy : misalignments of the z axes towards x and y, rad.

    Examples
    --------
    >>> from jaxcal.alignment import Positions
    >>> from jaxcal.alignment._model import Triads
    >>> accel, _ = Triads(b_a_y=0.5).measure(Positions([0.0, 0.0, 0.0], ("x", "y", "fixed z")))
    >>> print(accel.round(3) + 0.0)
    [ 0.     0.5   -9.807]

    References
    ----------
    See `Turntable`.
    """

    b_a_y: Any = 0.0
    b_a_z: Any = 0.0
    b_g_y: Any = 0.0
    b_g_z: Any = 0.0
    ma_a_zx: Any = 0.0
    ma_a_zy: Any = 0.0
    ma_g_zx: Any = 0.0
    ma_g_zy: Any = 0.0

    def measure(self, positions: Places, *, gravity: Real = GRAVITY, lever_arm: Real = 0.0) -> tuple[AnyArray, AnyArray]:
        """Compute the noise-free readings as `Turntable.measure` does, with the bias of each axis and the misalignment of the z axes."""
        places = geometry(positions, gravity, lever_arm)
        xp, readings, truth = array_module(self, places), super().measure(places), self.truth(places)
        accel = self.b_a, self.b_a_y, self.b_a_z, self.ma_a_zx, self.ma_a_zy
        errors = accel, (self.b_g, self.b_g_y, self.b_g_z, self.ma_g_zx, self.ma_g_zy)
        made = []
        for reading, true, (x, y, z, towards_x, towards_y) in zip(readings, truth, errors, strict=True):
            # the cross axes of a sensor on z are x and y
            vertical = z - x + towards_x * true[:, 1] + towards_y * true[:, 2]
            made.append(reading + xp.where(places.channel == 1, y - x, xp.where(places.channel == 2, vertical, 0)))
        return made[0], made[1]


NAMES = tuple(field.name for field in dataclasses.fields(Turntable))
ANGLES = ("phi", "theta", "psi")


def names_of(model: Any) -> tuple[str, ...]:
    """Names of the parameters of a model, in the order of its fields."""
    found = [(jax.tree_util.keystr(path, simple=True, separator="."), leaf) for path, leaf in jax.tree_util.tree_leaves_with_path(model)]
    other = [name for name, leaf in found if np.shape(leaf)]
    if not isinstance(model, Turntable) or other:
        what = f"{other[0]} is an array" if other else f"it is {type(model).__name__}"
        raise DataError(f"A model is a `Turntable` or a subclass with one field for each number, but {what}.", code="model")
    return tuple(name for name, _ in found)


def with_values(model: Any, values: Any) -> Any:
    """The model with new values, given in the order of `names_of`."""
    return jax.tree.unflatten(jax.tree.structure(model), list(values))


def turntable(attitude: Any, latitude: Any, accel: Sensor, gyro: Sensor) -> Turntable:
    """Make a `Turntable` from attitude, latitude and the errors of both sensors."""
    (phi, theta, psi), (a1, a2), (g1, g2) = attitude, accel.misalignment, gyro.misalignment
    return Turntable(
        phi, theta, psi, accel.bias, accel.scale_error, gyro.bias, gyro.scale_error, a1, a2, g1, g2, accel.bias_rate, gyro.bias_rate,
        latitude=latitude,
    )  # fmt: skip


class Table(eqx.Module):
    """Readings with their weights, and priors: the data of `residuals`. `tabulate` makes one.

    Attributes
    ----------
    places : `Geometry` of the positions, padded so that one compiled program serves position lists of different lengths.
    readings : (2, n) of the accelerometer, m/s^2, and of the gyro, rad/s.
    weight : (2 n,) reciprocal standard deviations, zero if not measured; or (2 n, 2 n) inverse Cholesky factor of the covariance, if the
        noise is not white, or errors of the table angles correlate the two sensors.
    prior, certainty : (p,) prior means and reciprocal standard deviations in the order of the model's parameters, zero for a parameter
        without prior; None for no priors.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Readings
    >>> from jaxcal.alignment._model import tabulate
    >>> table = tabulate(Readings(np.zeros(1), accel=np.array([2e-3]), accel_noise=1e-3))
    >>> print(float(table.readings[0, 0]), float(table.weight[0]), table.measured[1].any())
    0.002 1000.0 False
    """

    places: Geometry
    readings: AnyArray
    weight: AnyArray
    prior: Any = None
    certainty: Any = None

    @property
    def measured(self) -> AnyArray:
        """(2, n) flags of the rows that the accelerometer and the gyro measured."""
        return (self.weight if self.weight.ndim == 1 else self.weight.diagonal()).reshape(2, -1) > 0


def residuals(model: Turntable, data: Table | Readings) -> Any:
    r"""Compute the residuals of a turntable model in units of their standard deviation: accelerometer, gyro, priors.

    .. math:: r = \left(W_a (\hat a - a),\; W_g (\hat w - w),\; (x - x_0)/\sigma_0\right)

    The function is pure and works under `jit`, `vmap`, `grad` and in `jaxcal.fitting.solve`.

    Parameters
    ----------
    model : `Turntable` or a subclass.
    data : `Table`, or `Readings` with their noise.

    Returns
    -------
    (2 n,), or (2 n + p,) with priors on p parameters; n is the number of positions, padded to a power of two.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Readings, Turntable, residuals
    >>> readings = Readings(np.zeros(1), accel=np.array([1e-3]), accel_noise=1e-3)
    >>> print(residuals(Turntable(), readings)[0].round(6))
    -1.0

    References
    ----------
    See `fit`.
    """
    table = tabulate(data) if isinstance(data, Readings) else data
    made = model.measure(table.places)
    xp = array_module(made, table)
    off = xp.concatenate(made) - table.readings.reshape(-1)
    off = table.weight * off if table.weight.ndim == 1 else table.weight @ off
    if table.prior is None:
        return off
    return xp.concatenate([off, table.certainty * (xp.stack([xp.asarray(leaf) for leaf in jax.tree.leaves(model)]) - table.prior)])


def padded(positions: Positions) -> Positions:
    """Positions up to the next power of two, with copies of the first one, which are never measured."""
    length, xp = power_of_two(len(positions), _SMALLEST_PAD), array_module(positions)
    pad = lambda value: long(xp.asarray(value), length)  # noqa: E731
    kept = {name: pad(getattr(positions, name)) for name in ("rate", "acceleration", "width")}
    mounting = positions.mounting + positions.mounting[:1] * (length - len(positions))
    return Positions(pad(positions.angle), mounting, pad(positions.dwell), pad(positions.start), **kept)


def tabulate(readings: Readings, gravity: Any = GRAVITY, noise: Any = None, prior: Any = None, certainty: Any = None) -> Table:
    """Convert readings to the data of `residuals`.

    Parameters
    ----------
    readings : `Readings`.
    gravity : m/s^2.
    noise : (accelerometer, gyro) noise in the form of `Readings`; the default is that of the readings.
    prior, certainty : see `Table`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Readings, Turntable, residuals
    >>> from jaxcal.alignment._model import tabulate
    >>> table = tabulate(Readings(np.zeros(1), accel=np.array([2e-3]), accel_noise=1e-3))
    >>> print(residuals(Turntable(), table)[0].round(6))
    -2.0
    """
    xp = array_module(readings, gravity, noise, prior, certainty)
    noise = noise or [Noise(N=1.0) if own is None else own for own in (readings.accel_noise, readings.gyro_noise)]
    places, size = padded(readings.positions), len(readings.positions)
    given = [xp.full(size, xp.nan) if one is None else xp.asarray(one) for one in (readings.accel, readings.gyro)]
    dtype = given[0 if readings.accel is not None else 1].dtype
    values = xp.pad(
        xp.stack([xp.asarray(one, dtype=dtype) for one in given]), ((0, 0), (0, places.dwell.size - size)), constant_values=np.nan
    )
    here = xp.isfinite(values)
    weight = weight_of(joined([covariance_of(own, places, one) for own, one in zip(noise, here, strict=True)]), here.reshape(-1))
    return in_one_type(Table(geometry(places, gravity, readings.lever_arm), xp.where(here, values, 0), weight, prior, certainty), dtype)


def turned(model: Any, places: Positions, gravity: Any, lever_arm: Any) -> tuple[AnyArray, AnyArray]:
    """Derivative of the readings of accelerometer and gyro by the table's angle, (n,) each."""
    # readings are first harmonics of the angle: their slope is half the difference between a quarter turn on and one back
    quarters = (dataclasses.replace(places, angle=places.angle + turn * np.pi / 2) for turn in (1, -1))
    (up, right), (down, left) = (model.measure(geometry(one, gravity, lever_arm)) for one in quarters)
    return (up - down) / 2, (right - left) / 2


def with_angle_errors(table: Table, model: Any, positions: Positions, gravity: Any, lever_arm: Any) -> Table:
    """Add to the data the covariance caused by errors of the table angles, linearised at a model near the solution."""
    if not positions.doubtful:
        return table
    xp = array_module(table, model, positions, gravity, lever_arm)
    places, n = padded(positions), table.readings.shape[1]
    slope = turned(model, places, gravity, lever_arm)
    spread = xp.asarray(positions.angle_std)
    spread = xp.diag(spread**2) if spread.ndim == 1 else spread
    more = n - len(positions)
    spread = xp.pad(spread, ((0, more), (0, more)))
    here, factor = table.measured.reshape(-1), table.weight if table.weight.ndim == 2 else xp.diag(table.weight)
    rows = factor @ xp.where(here[:, None], xp.concatenate([xp.diag(one) for one in slope]), 0)
    joint = weight_of(xp.eye(2 * n, dtype=rows.dtype) + rows @ spread @ rows.T, here) @ factor
    return dataclasses.replace(table, weight=xp.asarray(joint, dtype=table.readings.dtype))


def in_one_type(tree: Any, dtype: Any) -> Any:
    """Convert every floating-point number of a tree to an array of one dtype; NumPy arrays stay NumPy arrays."""

    def cast(leaf: Any) -> Any:
        traced = isinstance(leaf, jax.Array)
        leaf = leaf if hasattr(leaf, "dtype") else np.asarray(leaf)
        return leaf if leaf.dtype == bool else (jnp if traced else np).asarray(leaf, dtype=dtype)

    return jax.tree.map(cast, tree)
