"""Conversion of a calibration to the models of other programs: imu_tk, Kalibr, OpenVINS, PX4, ArduPilot."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from ._model import Imu, Triad, in_convention, inverse, turned_to


class ImuTk(eqx.Module):
    """Model of imu_tk (D. Tedaldi and A. Pretto): x = T K (y - B), where T has a unit diagonal and K is diagonal.

    Attributes
    ----------
    misalignment : (3, 3) T. scale : (3,) diagonal of K, SI per reading. bias : (3,) B in readings.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import ImuTk, Triad
    >>> found = ImuTk.of(Triad(np.diag([400.0, 500.0, 800.0]), np.zeros(3)))
    >>> print(found.scale)
    [0.0025  0.002   0.00125]
    """

    misalignment: Any
    scale: Any
    bias: Any

    @classmethod
    @host_float64
    def of(cls, triad: Triad) -> "ImuTk":
        """Convert an accelerometer, or a gyroscope without g-sensitivity."""
        correction = jnp.linalg.inv(jnp.asarray(triad.matrix))
        scale = jnp.diagonal(correction)
        return cls(correction / scale[None, :], scale, jnp.asarray(triad.bias))

    @host_float64
    def triad(self) -> Triad:
        """Convert back exactly: matrix (T K)^-1."""
        scale = jnp.asarray(self.scale)
        return Triad(jnp.linalg.inv(jnp.asarray(self.misalignment) * scale[None, :]), jnp.asarray(self.bias))


class Kalibr(eqx.Module):
    """Scale-misalignment model of Kalibr (J. Rehder et al., ICRA 2016).

    a = M_accel f + b_a; w = M_gyro C_gyro_i w_i + A C_gyro_i f + b_g, with both M lower triangular.

    Attributes
    ----------
    accel_matrix, gyro_matrix : (3, 3) lower triangular. rotation : (3, 3) C_gyro_i, from the accelerometer's frame to the gyroscope's.
    g_sensitivity : (3, 3) A, rad/s per m/s^2 of specific force in the gyroscope's frame. accel_bias, gyro_bias : (3,).

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Kalibr, Triad
    >>> found = Kalibr.of(Triad(np.diag([1.01, 1.0, 0.99]), np.zeros(3)), Triad(np.eye(3), np.full(3, 0.01)))
    >>> print(np.diag(found.accel_matrix).round(3), found.gyro_bias.round(3))
    [1.01 1.   0.99] [0.01 0.01 0.01]
    """

    accel_matrix: Any
    gyro_matrix: Any
    rotation: Any
    g_sensitivity: Any
    accel_bias: Any
    gyro_bias: Any

    @classmethod
    @host_float64
    def of(cls, accel: Triad, gyro: Triad) -> "Kalibr":
        """Rotate the frame so that the accelerometer's matrix is lower triangular, then factor the gyroscope's matrix into M C."""
        turned = in_convention(Imu(accel, gyro), "lower")
        correction = turned_to(inverse(turned.gyro.matrix), "lower")
        rotation = correction @ turned.gyro.matrix
        sensitivity = turned.gyro.g_sensitivity @ rotation.T
        return cls(turned.accel.matrix, inverse(correction), rotation, sensitivity, jnp.asarray(accel.bias), jnp.asarray(gyro.bias))

    @host_float64
    def triads(self) -> tuple[Triad, Triad]:
        """Accelerometer and gyroscope, in Kalibr's frame."""
        matrix, cross = (jnp.asarray(part) @ jnp.asarray(self.rotation) for part in (self.gyro_matrix, self.g_sensitivity))
        return Triad(jnp.asarray(self.accel_matrix), jnp.asarray(self.accel_bias)), Triad(matrix, jnp.asarray(self.gyro_bias), cross)


class OpenVins(eqx.Module):
    """Model of OpenVINS: f = R_accel Da (a - b_a); w = R_gyro Dw (w - b_g - Tg f).

    Attributes
    ----------
    accel_correction, gyro_correction : (3, 3) Da and Dw, triangular. accel_rotation, gyro_rotation : (3, 3) R_ACCtoIMU and R_GYROtoIMU.
    g_sensitivity : (3, 3) Tg. accel_bias, gyro_bias : (3,).
    model : "kalibr" (lower triangular, in the accelerometer's frame) or "rpng" (upper triangular, in the gyroscope's frame).

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import OpenVins, Triad
    >>> found = OpenVins.of(Triad(np.diag([1.25, 1.0, 0.8]), np.zeros(3)), Triad(np.eye(3), np.full(3, 0.01)))
    >>> print(np.diag(found.accel_correction).round(3), found.gyro_bias.round(3))
    [0.8  1.   1.25] [0.01 0.01 0.01]
    """

    accel_correction: Any
    gyro_correction: Any
    accel_rotation: Any
    gyro_rotation: Any
    g_sensitivity: Any
    accel_bias: Any
    gyro_bias: Any
    model: str = eqx.field(static=True)

    @classmethod
    @host_float64
    def of(cls, accel: Triad, gyro: Triad, model: str = "kalibr") -> "OpenVins":
        """Convert both triads to one of the two models."""
        if model not in ("kalibr", "rpng"):
            raise DataError(f"There is no OpenVINS model {model!r}; known are 'kalibr' and 'rpng'.")
        convention = "lower" if model == "kalibr" else "upper"
        first, second = (inverse(jnp.asarray(sensor.matrix)) for sensor in (accel, gyro))
        one, two = turned_to(first, convention), turned_to(second, convention)
        # the frame in which the leading triad needs no rotation
        frame = one @ inverse(first) if model == "kalibr" else two @ inverse(second)
        return cls(
            one, two, frame @ first @ inverse(one), frame @ second @ inverse(two), jnp.asarray(gyro.g_sensitivity) @ frame.T,
            jnp.asarray(accel.bias), jnp.asarray(gyro.bias), model,
        )  # fmt: skip

    @host_float64
    def triads(self) -> tuple[Triad, Triad]:
        """Accelerometer and gyroscope, in the frame of the model."""
        accel = inverse(jnp.asarray(self.accel_correction)) @ jnp.asarray(self.accel_rotation).T
        gyro = inverse(jnp.asarray(self.gyro_correction)) @ jnp.asarray(self.gyro_rotation).T
        cross = jnp.asarray(self.g_sensitivity)
        return Triad(accel, jnp.asarray(self.accel_bias)), Triad(gyro, jnp.asarray(self.gyro_bias), cross)


class Px4(eqx.Module):
    """Model of PX4: x = R ((y - offset) * scale), CAL_ACC*_OFF and _SCALE; PX4 has no scale for a gyroscope.

    Attributes
    ----------
    offset, scale : (3,). rotation : (3, 3) of the board. lost : (3, 3) misalignment in rad that the model cannot represent.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Px4, Triad
    >>> found = Px4.of(Triad(np.diag([1.25, 1.0, 0.8]), np.array([0.1, -0.2, 0.0])))
    >>> print(found.scale.round(3), found.offset.round(3))
    [0.8  1.   1.25] [ 0.1 -0.2  0. ]
    """

    offset: Any
    scale: Any
    rotation: Any
    lost: Any

    @classmethod
    @host_float64
    def of(cls, triad: Triad, rotation: Any = None) -> "Px4":
        """Convert a triad to offset and scale factors; `lost` is the omitted misalignment."""
        turn = jnp.eye(3) if rotation is None else jnp.asarray(rotation)
        scale, lost = _diagonal(jnp.asarray(triad.matrix) @ turn)
        return cls(jnp.asarray(triad.bias), 1 / scale, turn, lost)

    @host_float64
    def triad(self) -> Triad:
        """Convert back: matrix diag(1/scale) R', without `lost`."""
        return Triad(jnp.diag(1 / jnp.asarray(self.scale)) @ jnp.asarray(self.rotation).T, jnp.asarray(self.offset))


class ArduPilot(eqx.Module):
    """Model of ArduPilot: accelerometer x = (y - INS_ACCOFFS) * INS_ACCSCAL, gyroscope x = y - INS_GYROFFS.

    Attributes
    ----------
    offset, scale : (3,). lost : (3, 3) misalignment in rad, and scale errors of a gyroscope, that the model cannot represent.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import ArduPilot, Triad
    >>> found = ArduPilot.of(Triad(np.diag([1.25, 1.0, 0.8]), np.array([0.1, -0.2, 0.0])))
    >>> print(found.scale.round(3), found.offset.round(3))
    [0.8  1.   1.25] [ 0.1 -0.2  0. ]
    """

    offset: Any
    scale: Any
    lost: Any

    @classmethod
    @host_float64
    def of(cls, triad: Triad, sensor: str = "accel") -> "ArduPilot":
        """Convert a triad to offset and scale factors (scale one for sensor="gyro"); `lost` is the omitted part."""
        if sensor not in ("accel", "gyro"):
            raise DataError(f"There is no sensor {sensor!r}; known are 'accel' and 'gyro'.")
        matrix = jnp.asarray(triad.matrix)
        scale, lost = _diagonal(matrix)
        if sensor == "gyro":
            scale, lost = jnp.ones(3), matrix - jnp.eye(3)
        return cls(jnp.asarray(triad.bias), 1 / scale, lost)

    @host_float64
    def triad(self) -> Triad:
        """Convert back: matrix diag(1/scale), without `lost`."""
        return Triad(jnp.diag(1 / jnp.asarray(self.scale)), jnp.asarray(self.offset))


def _diagonal(matrix: Any) -> tuple[Any, Any]:
    """Split a matrix into scale factors and misalignment (rad)."""
    if np.any(np.asarray(jnp.diagonal(matrix)) <= 0):
        raise DataError("A scale factor is not positive: this format cannot say it. Turn the axes first.")
    scale = jnp.diagonal(matrix)
    return scale, matrix / scale[:, None] - jnp.eye(3)
