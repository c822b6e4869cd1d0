"""Attitudes by another estimator, such as the filter of a flight controller, as an aid of the fit."""

from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._types import AnyArray


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
    dip : known inclination of the field in rad; None to estimate it.

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
    quaternion: Any
    dip: float | int | None = None

    def __check_init__(self) -> None:
        if np.ndim(self.quaternion) != 2 or np.shape(self.quaternion)[1] != 4:
            raise DataError(
                f"The attitudes have shape {np.shape(self.quaternion)}; expected quaternions (n, 4), w first.", code="bad_shape"
            )

    @property
    def accel(self) -> AnyArray:
        """(n, 3) unit vectors upwards in body axes: the direction of the specific force if the vehicle were at rest."""
        w, x, y, z = np.asarray(self.quaternion, float).T
        return -np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w**2 - x**2 - y**2 + z**2], axis=1) + 0.0
