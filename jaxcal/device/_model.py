"""`DeviceModel`: readings of the sensors of one device, in one frame and on one clock; its parameters as a vector."""

from typing import Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from .._frozen import Model
from .._precision import array_module
from .._types import AnyArray, Held, Leaf
from .._units import STANDARD_GRAVITY
from ..fitting._problem import names_of
from ..imu import Triad
from ..magnetometer import MagModel


class Kind(NamedTuple):
    """A kind of parameter: quantity of its unit, prior standard deviation, and largest standard error in a good calibration, in SI.

    The prior is far wider than the errors after a recording. A consumer MEMS unit before calibration has ten times the error of a good
    calibration; that of the hard iron is a part of the field.
    """

    quantity: str
    prior: float
    good: float = np.inf


#: field of the model -> its kind; "mag" for the unit of the magnetometer, whose priors are parts of the field
KINDS = {
    "accel.matrix": Kind("ratio", 0.1, 5e-3), "accel.bias": Kind("accel", 1.0, 5e-3 * STANDARD_GRAVITY),
    "accel.g_sensitivity": Kind("ratio", 1.0), "gyro.matrix": Kind("ratio", 0.1, 5e-3),
    "gyro.bias": Kind("gyro", 0.1, np.deg2rad(0.02)), "gyro.g_sensitivity": Kind("gyro/accel", 1e-3),
    "magnetometer.soft_iron": Kind("ratio", 0.5, 1e-2), "magnetometer.hard_iron": Kind("mag", 2.0, 5e-3), "field": Kind("mag", 1.0),
    "dip": Kind("angle", 1.0), "gyro_delay": Kind("delay", 0.03), "mag_delay": Kind("delay", 0.03), "lever": Kind("length", 0.1),
    "arm": Kind("length", 0.3), "accel_pole": Kind("s^2", 1e-3), "gyro_pole": Kind("s^2", 1e-3),
}  # fmt: skip


class DeviceModel(Model):
    r"""Accelerometer, gyroscope and magnetometer of one device.

    With the specific force f, the angular rate w and the field h in the frame of the device, at the time t:

    .. math:: y_a(t) = M_a f(t) + b_a,\quad y_g(t + d_g) = M_g w(t) + b_g + G f(t),\quad y_m(t + d_m) = C h(t) + b_m.

    The frame is that of the accelerometer: M_a is upper triangular (`convention="upper"` of `jaxcal.imu`). The matrices of the other two
    sensors are full, because they include the rotations to that frame. World axes: x to magnetic north, y to the west, z up.

    Attributes
    ----------
    accel : `Triad`, readings per m/s^2, with an upper triangular matrix.
    gyro : `Triad`, readings per rad/s, with a full matrix.
    magnetometer : `MagModel` with a full matrix: soft iron and rotation. Its fields are in the unit of the readings.
    field : strength of the Earth's field, in the unit of the readings. `fit` takes the strength for which det C = 1, unless it is given.
    dip : angle of the Earth's field below the horizontal, rad.
    gyro_delay, mag_delay : s by which the stream is later than that of the accelerometer, d_g and d_m; positive where it is late.
    lever : (2, 3) places of the accelerometer's sensing elements y and z, from that of x, in the frame of the device, m.
    arm : (3,) place of the device from the point about which the hand turned it, in the frame of the device, m. It belongs to the
        recording: no sensor reads it.
    accel_pole, gyro_pole : s^2, half of the squared time constant of a first-order low-pass before the sensor. Its delay belongs to the
        delays. `fit` has them where the recording asks for them.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.device import DeviceModel
    >>> from jaxcal.imu import Triad
    >>> from jaxcal.magnetometer import MagModel
    >>> plain = Triad(np.eye(3), np.zeros(3))
    >>> model = DeviceModel(plain, plain, MagModel(np.eye(3), np.zeros(3)), field=50e-6, dip=np.deg2rad(60.0))
    >>> print((1e6 * model.world_field).round(2))
    [ 25.    0.  -43.3]
    """

    accel: Triad
    gyro: Triad
    magnetometer: MagModel
    field: Leaf = 1.0
    dip: Leaf = 0.0
    gyro_delay: Leaf = 0.0
    mag_delay: Leaf = 0.0
    lever: Held = eqx.field(default_factory=lambda: np.zeros((2, 3)))
    arm: Held = eqx.field(default_factory=lambda: np.zeros(3))
    accel_pole: Leaf = 0.0
    gyro_pole: Leaf = 0.0

    @property
    def world_field(self) -> AnyArray:
        """(3,) field of the Earth in the world: north, west, up; in the unit of the magnetometer's readings."""
        xp = array_module(self.field, self.dip)
        return self.field * xp.stack([xp.cos(self.dip), xp.zeros(()), -xp.sin(self.dip)])


def field_of(name: str) -> str:
    """Field of the model that a parameter belongs to: the name without its entry."""
    return name.partition("[")[0]


def vector_of(model: DeviceModel) -> np.ndarray:
    """Parameters in the order of `NAMES`."""
    return np.concatenate([np.ravel(np.asarray(leaf, dtype=float)) for leaf in jax.tree.leaves(model)])


def model_of(vector: Any) -> DeviceModel:
    """The model with these parameters."""
    return jax.tree.unflatten(_STRUCTURE, [vector[AT[field]].reshape(shape) for field, shape in _SHAPES.items()])


def template() -> DeviceModel:
    """A model without errors."""
    plain = Triad(np.eye(3), np.zeros(3))
    field, zero = np.ones(()), np.zeros(())
    return DeviceModel(plain, plain, MagModel(np.eye(3), np.zeros(3)), field, zero, zero, zero, accel_pole=zero, gyro_pole=zero)


#: the parameters by name, in the order of the model's fields
NAMES = names_of(template())
#: field -> where its entries stand in a vector of parameters
AT: dict[str, slice] = {}
for _i, _name in enumerate(NAMES):
    _field = field_of(_name)
    AT[_field] = slice(AT[_field].start if _field in AT else _i, _i + 1)
_STRUCTURE = jax.tree.structure(template())
_SHAPES = dict(zip(AT, map(np.shape, jax.tree.leaves(template())), strict=True))
