"""`Imu`: the model that a calibration fits, and its parameters by name."""

from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import numpy as np

from .._precision import array_module
from .._types import AnyArray
from ..fitting import names_of
from ._triad import Triad

_TRIAD = ("accel.matrix", "accel.bias", "gyro.matrix", "gyro.bias", "gyro.g_sensitivity")


class Imu(eqx.Module):
    """Accelerometer and gyroscope of one device.

    Attributes
    ----------
    accel, gyro : `Triad`, or a subclass with its own fields, `measure` and `correct`; None for a sensor that is missing.
    drift : (3,) drift of the gyroscope's bias, readings per s; None where there is none.
    north : (2,) horizontal part of the Earth's rate in the first pose, as cosine and sine of a heading; None where the Earth's rate is
        left out.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Triad
    >>> Imu(Triad(np.eye(3), np.zeros(3))).gyro is None
    True
    """

    accel: Any
    gyro: Any = None
    drift: Any = None
    north: Any = None

    @property
    def plain(self) -> bool:
        """Whether both sensors are `Triad`s, linear in their readings, and not subclasses."""
        return all(type(sensor) in (Triad, type(None)) for sensor in (self.accel, self.gyro))


def entries(model: Imu) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters of both sensors, and their places among all floating-point leaves of the model.

    The fields of `Triad` come first, those of a subclass after them. The sensitivity of an accelerometer to specific force is none.
    """
    names = names_of(model)
    kept = [name for name in names if name.startswith(("accel.", "gyro.")) and not name.startswith("accel.g_sensitivity")]
    kept.sort(key=lambda name: not name.startswith(_TRIAD))
    return tuple(kept), np.array([names.index(name) for name in kept])


def values(model: Imu) -> Any:
    """Parameters in the order of `entries`."""
    xp = array_module(model)
    leaves = [xp.ravel(xp.asarray(leaf)) for leaf in jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))]
    return xp.concatenate(leaves)[entries(model)[1]]


def replaced(model: Imu, parameters: AnyArray) -> Imu:
    """The model with other parameters, in the order of `entries`."""
    floats, rest = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = jax.flatten_util.ravel_pytree(floats)
    return eqx.combine(unravel(vector.at[entries(model)[1]].set(parameters)), rest)


def freed(model: Imu, convention: str, misalignment: bool = True, g_sensitivity: bool = True) -> Imu:
    """Which entries are fitted: all, without those that the convention of the frame holds, in a tree of the model's form."""
    free = jax.tree.map(lambda leaf: np.ones(np.shape(leaf), dtype=bool), eqx.filter(model, eqx.is_inexact_array))
    if model.accel is not None:
        square = np.ones((3, 3), dtype=bool)
        matrix = np.eye(3, dtype=bool) if not misalignment else np.tril(square) if convention == "lower" else np.triu(square)
        free = eqx.tree_at(lambda m: (m.accel.matrix, m.accel.g_sensitivity), free, (matrix, ~square))
    if model.gyro is not None:
        free = eqx.tree_at(lambda m: m.gyro.g_sensitivity, free, np.full((3, 3), g_sensitivity))
    return free
