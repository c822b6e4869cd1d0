"""`MagModel`: what a magnetometer reads in a given field, and back."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._precision import host_float64
from .._types import Any, AnyArray


class MagModel(eqx.Module):
    r"""Soft iron and hard iron of a magnetometer.

    .. math:: m = C h + b

    Attributes
    ----------
    soft_iron : (3, 3) distortion C: reading per field. Without distortion the unit matrix.
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

    soft_iron: Any
    hard_iron: Any

    @host_float64
    def measure(self, h: Any) -> AnyArray:
        """Readings C h + b in the true fields `h` (3,) or (n, 3), in the unit of the hard iron."""
        h, matrix, offset = _same_dtype(h, self.soft_iron, self.hard_iron)
        product = jnp.einsum("ij,...j->...i", matrix, h)
        return product + jnp.broadcast_to(offset, product.shape)

    @host_float64
    def correct(self, m: Any) -> AnyArray:
        """Fields C^-1 (m - b) that belong to the readings `m` (3,) or (n, 3), in their unit (that of C is a pure number)."""
        m, matrix, offset = _same_dtype(m, self.soft_iron, self.hard_iron)
        return jnp.einsum("ij,...j->...i", jnp.linalg.inv(matrix), m - jnp.broadcast_to(offset, m.shape))


def _same_dtype(*values: Any) -> list[jax.Array]:
    """Arrays of the widest floating type among them."""
    kind = np.result_type(*(value.dtype if hasattr(value, "dtype") else np.dtype(float) for value in values), np.float32)
    return [jnp.asarray(value, dtype=jax.dtypes.canonicalize_dtype(kind)) for value in values]
