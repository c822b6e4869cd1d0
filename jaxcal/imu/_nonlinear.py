"""`Nonlinear`: a triad with optional nonlinear terms; `with_terms` adds them by name."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import array_module, host_float64
from .._types import AnyArray, Held, Numbers
from ._model import Imu, Triad

_ROUNDS = 4  # iterations of the fixed point: the error is then 1e-10 of the reading for a term of 1 % of the reading
#: time-dependent terms of the accelerometer's bias, which are fields of `Imu`
_IN_TIME = {"accel.drift": "accel_drift", "accel.warm_up": "accel_warm_up", "accel.creep": "accel_creep"}
TERMS = (*(f"{sensor}.{field}" for sensor in ("accel", "gyro") for field in ("quadratic", "cubic", "asymmetry")), *_IN_TIME)


class Nonlinear(Triad):
    r"""A triad with nonlinear terms.

    .. math:: y = M x + b + G a + q x^2 + c x^3 + s |x|

    Powers apply to each component. A term that is None is absent and is not fitted.

    Attributes
    ----------
    quadratic : (3,) q, reading per SI unit squared; or None.
    cubic : (3,) c, reading per SI unit cubed; or None.
    asymmetry : (3,) s, reading per SI unit: half the difference between the scales for positive and negative inputs; or None.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Nonlinear
    >>> bent = Nonlinear(np.eye(3), np.zeros(3), quadratic=np.array([3e-4, 0.0, 0.0]))
    >>> print(bent.measure(np.array([9.81, 0.0, 0.0])).round(4), bent.correct(bent.measure(np.array([9.81, 0.0, 0.0]))).round(8))
    [9.8389 0.     0.    ] [9.81 0.   0.  ]

    References
    ----------
    IEEE Std 1293-1998, model equation (K2, K3, asymmetry); IEEE Std 952-1997 and 517-1974 for gyroscopes.
    """

    quadratic: Held | None = None
    cubic: Held | None = None
    asymmetry: Held | None = None

    @host_float64
    def measure(self, x: Numbers, accel: Numbers | None = None) -> AnyArray:
        """Compute the readings; see `Triad.measure`."""
        return super().measure(x, accel) + self._bent(x)

    @host_float64
    def correct(self, y: Numbers, accel: Numbers | None = None) -> AnyArray:
        """Correct readings by a fixed-point iteration; see `Triad.correct`."""
        x = super().correct(y, accel)
        for _ in range(_ROUNDS):
            x = super().correct(y - self._bent(x), accel)
        return x

    def _bent(self, x: Any) -> Any:
        xp = array_module(self, x)
        x = xp.asarray(x)
        total = xp.zeros_like(x)
        for coefficient, power in ((self.quadratic, x**2), (self.cubic, x**3), (self.asymmetry, xp.abs(x))):
            if coefficient is not None:
                total = total + xp.broadcast_to(xp.asarray(coefficient), x.shape) * power
        return total


def with_terms(model: Imu, terms: Iterable[str]) -> Imu:
    """Add terms to a model, with initial values of zero.

    Parameters
    ----------
    model : `Imu` of plain `Triad`s or of `Nonlinear`.
    terms : names such as "accel.quadratic" or "gyro.cubic"; `TERMS` lists all.

    Returns
    -------
    Imu

    Raises
    ------
    DataError
        If a name is unknown, the model lacks the sensor, or the sensor is of a class of your own.
    """
    for term in terms:
        if term not in TERMS:
            raise DataError(f"There is no term {term!r}; known are {', '.join(TERMS)}, or 'auto' for what the log asks for.", code="term")
        sensor, field = term.split(".")
        held = getattr(model, "gyro" if term in _IN_TIME else sensor)  # the turns tell a term in time from a tilt
        if held is None:
            raise DataError(f"The term {term} needs a sensor that the log does not have.", code="term")
        if term in _IN_TIME:
            model = dataclasses.replace(model, **{_IN_TIME[term]: np.zeros(3)})
            continue
        if type(held) is Triad:
            held = Nonlinear(held.matrix, held.bias, held.g_sensitivity)
        if not isinstance(held, Nonlinear):
            raise DataError(f"The term {term} cannot be added to a {type(held).__name__}; add it to your own class, or leave out model=.")
        if getattr(held, field) is None:
            held = dataclasses.replace(held, **{field: np.zeros(3)})
        model = eqx.tree_at(lambda one, sensor=sensor: getattr(one, sensor), model, held)
    return model
