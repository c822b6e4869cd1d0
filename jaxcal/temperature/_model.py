"""`ThermalModel`: the bias of one channel as a function of temperature, and the correction of readings."""

import warnings
from typing import Any

import numpy as np

from .._errors import DataError
from .._frozen import Model
from .._precision import array_module, host_float64, is_traced
from .._types import AnyArray, Leaf, Numbers, Real
from ._curves import AbstractCurve, common
from ._hysteresis import felt, rate_of, steps_of
from ._record import FINE


class ClampWarning(UserWarning):
    """Warning that temperatures outside the range of a model were replaced by its nearest end.

    Examples
    --------
    >>> import warnings
    >>> import numpy as np
    >>> from jaxcal.temperature import Chebyshev, ClampWarning, ThermalModel
    >>> model = ThermalModel(Chebyshev(np.array([1.0, 0.5]), 20.0, 40.0), 20.0, 40.0)
    >>> with warnings.catch_warnings():
    ...     warnings.simplefilter("ignore", ClampWarning)
    ...     print(model.bias_at(np.array([50.0])))
    [1.5]
    """


class ThermalModel(Model):
    r"""Bias of one channel as a function of temperature, with the hysteresis of the sensor.

    .. math:: b = f(T_e) + c\,L_{\tau'}(\dot T),\qquad T_e = \mathrm{clip}(P_h(L_\tau(T)), T_{lo}, T_{hi})

    The model never extrapolates: outside the range of its data it keeps the value at the end of the range, and warns.

    Attributes
    ----------
    curve : f, a `Chebyshev`, `Steps`, `Piecewise` or another `AbstractCurve`.
    low, high : ends of the range, degC.
    lag : tau, time constant in s with which the sensor follows the thermometer; 0 for no lag.
    play : h, half-width in degC of the backlash; 0 for no backlash.
    rate : c, bias per rate of change of the temperature, in the unit of the bias per degC/s; 0 for no such term.
    rate_lag : tau', time constant in s of a lag of the rate term; 0 for no lag. :math:`L_{\tau'}(\dot T) = (T - L_{\tau'} T)/\tau'` is
        proportional to the difference from a second thermometer with this lag.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Chebyshev, ThermalModel
    >>> model = ThermalModel(Chebyshev(np.array([1.0, 0.5]), 20.0, 40.0), 20.0, 40.0)
    >>> print(model.bias_at(np.array([20.0, 30.0, 40.0])))
    [0.5 1.  1.5]
    >>> print(model.correct(np.array([2.0, 2.0]), np.array([30.0, 40.0])))
    [1.  0.5]

    References
    ----------
    The thesis, equations (5.3) to (5.5), where the curve is a polynomial.
    """

    curve: AbstractCurve
    low: Leaf
    high: Leaf
    lag: Leaf = 0.0
    play: Leaf = 0.0
    rate: Leaf = 0.0
    rate_lag: Leaf = 0.0

    @host_float64
    def bias_at(self, temperature: Numbers) -> AnyArray:
        """Compute the bias f(T) at steady temperatures.

        Parameters
        ----------
        temperature : (n,) or one, degC.

        Returns
        -------
        (n,) or (), in the unit of the channel. A `ClampWarning` reports temperatures outside the range.
        """
        return self._value(temperature)

    @host_float64
    def measure(self, x: Numbers, temperature: Numbers, *, time: Numbers | None = None, rate: Real | None = None) -> AnyArray:
        """Compute the readings of a true input, x + b(T); the inverse of `correct`, with its parameters."""
        x, value = self._at(x, temperature, time, rate)
        return x + value

    @host_float64
    def correct(self, y: Numbers, temperature: Numbers, *, time: Numbers | None = None, rate: Real | None = None) -> AnyArray:
        """Correct readings: y - b(T).

        Parameters
        ----------
        y : (n,) readings in time order.
        temperature : (n,) degC.
        time : (n,) s, or `rate` in Hz; required if the model has a lag or a rate term.

        Returns
        -------
        (n,) in the unit of the channel. A `ClampWarning` reports temperatures outside the range.

        Raises
        ------
        DataError
            If the lengths differ, or the model has a lag or a rate term and the times are unknown.
        """
        y, value = self._at(y, temperature, time, rate)
        return y - value

    def _at(self, y: Numbers, temperature: Numbers, time: Numbers | None, rate: Real | None) -> tuple[Any, Any]:
        """Readings and bias of every sample, in one dtype."""
        if np.shape(y) != np.shape(temperature) or np.ndim(temperature) != 1 or not np.size(temperature):
            raise DataError(f"y has shape {np.shape(y)} and temperature {np.shape(temperature)}; give one temperature per reading")
        xp = array_module(self, y, temperature)
        t, y = common(xp, temperature, y)
        if not is_traced(t) and not np.isfinite(t).all():
            raise DataError(f"{np.count_nonzero(~np.isfinite(t))} temperatures are not finite; interpolate the thermometer first")
        t, further = self.effective(t, time=time, rate=rate)
        return y, self._value(t) + further

    def effective(self, temperature: Numbers, *, time: Numbers | None = None, rate: Real | None = None) -> tuple[Any, Any]:
        """Temperature at the sensor (not clipped), and bias due to the rate of change."""
        moves = is_traced(self.rate) or self.rate != 0
        steps = _steps(temperature, time, rate) if moves or is_traced(self.lag) or self.lag > 0 else None
        change = rate_of(temperature, steps, self.rate_lag) if moves else 0.0
        return felt(temperature, self.lag, self.play, steps), self.rate * change

    def _value(self, t: Any) -> Any:
        xp = array_module(self, t)
        t, low, high = common(xp, t, self.low, self.high)
        if not is_traced(self, t):
            outside = np.mean((t < low) | (t > high))
            if np.min(t) < low - FINE or np.max(t) > high + FINE:  # closer ones may be noise of the thermometer
                said = f"{100 * outside:.3g} % of the temperatures ({np.min(t):.2f} to {np.max(t):.2f} degC) are outside the range of "
                said += f"the model, {low:.2f} to {high:.2f} degC; the value at its end is used. Calibrate over a wider range"
                warnings.warn(said, ClampWarning, stacklevel=5)
        return self.curve.value(xp.clip(t, low, high))


def _steps(t: Any, time: Any, rate: Any) -> Any:
    """Time step before each sample, s."""
    if rate is not None:
        return 1.0 / rate
    if time is None:
        raise DataError("the model has a lag or a rate, for which the times count: give time= (s) or rate= (Hz)")
    if np.shape(time) != np.shape(t) or np.shape(time)[0] < 2:
        raise DataError(f"time has shape {np.shape(time)}; expected {np.shape(t)}, at least 2; for single samples give rate= (Hz)")
    steps = steps_of(time)
    if not is_traced(steps) and not (steps > 0).all():
        raise DataError("time must increase from sample to sample")
    return steps
