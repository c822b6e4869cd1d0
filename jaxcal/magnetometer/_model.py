"""`MagModel`: converts a true field to readings, and readings to fields."""

import functools
from types import ModuleType

import jax
import numpy as np

from .._errors import DataError
from .._frozen import Model
from .._precision import array_module, host_float64, is_traced
from .._types import Any, AnyArray, Held, Samples

_UNDONE = 1e-6  # relative error of a reading after `correct` and `measure`: far below the noise of any sensor


class MagModel(Model):
    r"""Soft iron and hard iron of a magnetometer.

    .. math:: m = C h + b

    Attributes
    ----------
    soft_iron : (3, 3) distortion C: reading per field. The identity matrix means no distortion.
    hard_iron : (3,) offset b, in the unit of the readings.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> model = jaxcal.magnetometer.MagModel(np.diag([1.1, 1.0, 0.9]), np.array([3e-6, -1e-6, 0.0]))
    >>> reading = model.measure(np.array([20e-6, 0.0, 40e-6]))
    >>> print((1e6 * reading).round(3), (1e6 * model.correct(reading)).round(3))
    [25. -1. 36.] [20.  0. 40.]

    References
    ----------
    The magnetometer paper's equations (1) to (5), as one matrix and one vector.
    """

    soft_iron: Held
    hard_iron: Held

    def __init_subclass__(cls, **options: Any) -> None:
        """Make `measure` and `correct` of a subclass run in float64 on the host, as they do here."""
        super().__init_subclass__(**options)
        for name in ("measure", "correct"):
            if name in vars(cls):
                setattr(cls, name, host_float64(_undoing(vars(cls)[name]) if name == "correct" else vars(cls)[name]))

    @host_float64
    def measure(self, h: Samples) -> AnyArray:
        """Readings C h + b in the true fields `h` (3,) or (n, 3), in the unit of the hard iron."""
        xp, (field, matrix, offset) = _same_dtype(h, self.soft_iron, self.hard_iron)
        return field @ matrix.T + xp.broadcast_to(offset, field.shape)

    @host_float64
    def correct(self, m: Samples) -> AnyArray:
        """Fields C^-1 (m - b) that belong to the readings `m` (3,) or (n, 3), in the same unit, because C has no unit."""
        xp, (reading, matrix, offset) = _same_dtype(m, self.soft_iron, self.hard_iron)
        return (reading - xp.broadcast_to(offset, reading.shape)) @ xp.linalg.inv(matrix).T

    def then(self, second: "MagModel") -> "MagModel":
        """One model that combines this calibration with a `second` one, made from readings that this one had corrected.

        C = C1 C2 and b = b1 + C1 b2. `measure` undoes a correction: m = C y + b.

        Examples
        --------
        >>> import numpy as np
        >>> from jaxcal.magnetometer import MagModel
        >>> first, second = MagModel(np.diag([2.0, 1.0, 1.0]), np.ones(3)), MagModel(np.eye(3), np.array([0.5, 0.0, 0.0]))
        >>> both, m = first.then(second), np.array([4.0, 3.0, 2.0])
        >>> print(both.correct(m), second.correct(first.correct(m)))
        [1. 2. 1.] [1. 2. 1.]
        """
        _, (first, other, start, shift) = _same_dtype(self.soft_iron, second.soft_iron, self.hard_iron, second.hard_iron)
        return MagModel(first @ other, start + first @ shift)


def _undoing(correct: Any) -> Any:
    """A `correct` that is refused where `measure` does not give the readings back."""

    @functools.wraps(correct)
    def checked(model: Any, m: Any, *args: Any, **conditions: Any) -> Any:
        h = correct(model, m, *args, **conditions)
        if not is_traced(model, m, h):
            again, size = (
                np.asarray(model.measure(h, *args, **conditions)),
                np.sqrt(np.nansum((np.asarray(m) - np.asarray(model.hard_iron)) ** 2)),
            )
            if np.nansum((again - m) ** 2) > (_UNDONE * size) ** 2:
                raise DataError(f"`correct` of {type(model).__name__} must be the inverse of its `measure`.", code="no_inverse")
        return h

    return checked


def _same_dtype(*values: Any) -> tuple[ModuleType, list[Any]]:
    """`numpy`, or `jax.numpy` if something is traced; and the values as its arrays, of the widest floating type among them."""
    xp = array_module(values)
    kind = np.result_type(*(value.dtype if hasattr(value, "dtype") else np.dtype(float) for value in values), np.float32)
    return xp, [xp.asarray(value, dtype=kind if xp is np else jax.dtypes.canonicalize_dtype(kind)) for value in values]
