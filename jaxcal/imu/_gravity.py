"""`gravity` where a calibration is made, and the Earth's rate."""

from typing import Any

import jax.numpy as jnp

from .._precision import host_float64
from .._types import AnyArray

#: rad/s, WGS 84
EARTH_RATE = 7.292115e-5


@host_float64
def gravity(latitude: Any, height: Any = 0.0) -> AnyArray:
    r"""Normal gravity of WGS 84.

    .. math:: g = g_e\frac{1 + k\sin^2\varphi}{\sqrt{1 - e^2\sin^2\varphi}} - 3.086\cdot10^{-6}\,h

    Parameters
    ----------
    latitude : rad.
    height : m above the ellipsoid.

    Returns
    -------
    m/s^2; the true value differs by up to 1e-3 m/s^2 (anomalies).

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import gravity
    >>> print(f"{gravity(np.deg2rad(45.0)):.5f}")
    9.80620

    References
    ----------
    NIMA TR8350.2, Department of Defense World Geodetic System 1984, equation 4-1, and the free-air gradient.
    """
    square = jnp.sin(jnp.asarray(latitude, dtype=jnp.result_type(float))) ** 2
    return 9.7803253359 * (1 + 0.00193185265241 * square) / jnp.sqrt(1 - 0.00669437999014 * square) - 3.086e-6 * height
