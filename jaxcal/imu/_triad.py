"""`Triad`: what three sensing axes read, and back."""

from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._types import AnyArray

_CONDITION = 100.0


class Triad(eqx.Module):
    r"""Scale factors, misalignment, bias and g-sensitivity of an accelerometer or gyroscope triad.

    .. math:: y = M x + b + G a

    Attributes
    ----------
    matrix : (3, 3) M: reading per SI unit, I + S + N of the thesis. Without errors the unit matrix.
    bias : (3,) b, in the unit of the readings.
    g_sensitivity : (3, 3) G: reading per m/s^2 of specific force; zero for an accelerometer.

    Examples
    --------
    >>> import equinox as eqx
    >>> import numpy as np
    >>> import jaxcal
    >>> triad = jaxcal.imu.Triad(np.diag([1.01, 1.0, 0.99]), np.array([0.1, 0.0, -0.2]))
    >>> reading = triad.measure(np.array([0.0, 0.0, 10.0]))
    >>> print(reading.round(3), triad.correct(reading).round(3))
    [0.1 0.  9.7] [ 0.  0. 10.]

    A sensor with another model is a subclass with its own fields, `measure` and `correct`. `estimate` and `multi_position` fit every
    floating-point field of it, here a term of the square of the specific force:

    >>> class Quadratic(jaxcal.imu.Triad):
    ...     square: np.ndarray = eqx.field(default_factory=lambda: np.zeros(3))
    ...     def measure(self, x, accel=None):
    ...         return super().measure(x, accel) + self.square * x**2
    ...     def correct(self, y, accel=None):
    ...         x = super().correct(y, accel)
    ...         for _ in range(5):  # a fixed point: the term is small
    ...             x = super().correct(y - self.square * x**2, accel)
    ...         return x
    >>> sensor = Quadratic(np.eye(3), np.zeros(3), square=np.array([1e-4, 0.0, 2e-4]))
    >>> print(sensor.correct(sensor.measure(np.array([3.0, 0.0, 9.0]))).round(6))
    [3. 0. 9.]

    References
    ----------
    The thesis's equations (5.1) to (5.5), with M = I + S + N and a full matrix for the sensitivity to g.
    """

    matrix: Any
    bias: Any
    g_sensitivity: Any = eqx.field(default_factory=lambda: np.zeros((3, 3)))

    @host_float64
    def measure(self, x: Any, accel: Any = None) -> AnyArray:
        """Readings M x + b + G a.

        Parameters
        ----------
        x : (3,) or (n, 3) angular rate in rad/s, or specific force in m/s^2.
        accel : specific force, same shape, m/s^2; needed where there is a g-sensitivity.

        Returns
        -------
        Readings of the shape of `x`.

        Raises
        ------
        DataError
            Where there is a g-sensitivity and no `accel`, or the shapes differ.
        """
        x, accel = self._checked(x, accel)
        xp = array_module(self, x, accel)
        reading = x @ xp.asarray(self.matrix, dtype=x.dtype).T
        if accel is not None:
            reading = reading + accel @ xp.asarray(self.g_sensitivity, dtype=x.dtype).T
        return reading + xp.broadcast_to(xp.asarray(self.bias, dtype=x.dtype), x.shape)

    @host_float64
    def correct(self, y: Any, accel: Any = None) -> AnyArray:
        """What was measured, M^-1 (y - b - G a).

        Parameters
        ----------
        y : (3,) or (n, 3) readings.
        accel : specific force, same shape, m/s^2: that of the corrected accelerometer. Needed where there is a g-sensitivity.

        Returns
        -------
        rad/s or m/s^2, in the shape of `y`.

        Raises
        ------
        DataError
            Where `matrix` is singular or nearly so (condition number above 100), there is a g-sensitivity and no `accel`, or the
            shapes differ.
        """
        y, accel = self._checked(y, accel)
        if not is_traced(self.matrix):
            condition = np.linalg.cond(np.asarray(self.matrix, dtype=float))
            if not condition <= _CONDITION:
                raise DataError(
                    f"The matrix has the condition number {condition:.3g}, beyond {_CONDITION:g}: the axes do not span space. Calibrate "
                    "again, or give the right matrix."
                )
        xp = array_module(self, y, accel)
        rest = y - xp.broadcast_to(xp.asarray(self.bias, dtype=y.dtype), y.shape)
        if accel is not None:
            rest = rest - accel @ xp.asarray(self.g_sensitivity, dtype=y.dtype).T
        return rest @ inverse(xp.asarray(self.matrix, dtype=y.dtype)).T

    def _checked(self, x: Any, accel: Any) -> tuple[AnyArray, AnyArray | None]:
        """Vectors as arrays of one dtype: of NumPy where nothing is traced."""
        if accel is None and not is_traced(self.g_sensitivity) and np.any(np.asarray(self.g_sensitivity)):
            raise DataError("This triad has a g-sensitivity: give the specific force with accel=.")
        xp = array_module(self, x, accel)
        leaves = [x, self.matrix, self.bias] + ([] if accel is None else [accel])
        kind = np.result_type(*(leaf.dtype if hasattr(leaf, "dtype") else np.dtype(float) for leaf in leaves), np.float32)
        dtype = jax.dtypes.canonicalize_dtype(kind)
        x = xp.asarray(x, dtype=dtype)
        accel = None if accel is None else xp.asarray(accel, dtype=dtype)
        if x.ndim not in (1, 2) or x.shape[-1] != 3 or (accel is not None and accel.shape != x.shape):
            other = "" if accel is None else f" and accel {accel.shape}"
            raise DataError(f"The vectors have shape {x.shape}{other}; expected (3,) or (n, 3), and the same for both.")
        return x, accel


def inverse(matrix: AnyArray) -> AnyArray:
    """Inverse of a (3, 3) matrix by its cofactors, which compile in a tenth of the time of LAPACK's factors."""
    xp = array_module(matrix)
    cofactor = xp.cross(xp.roll(matrix, -1, axis=0), xp.roll(matrix, -2, axis=0))
    return cofactor.T / xp.sum(matrix[0] * cofactor[0])
