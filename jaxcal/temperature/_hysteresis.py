r"""Effective temperatures of a sensor that does not follow its thermometer immediately.

Each filter is a chain of maps, x -> A x + B or x -> min(max(x, A), B), whose compositions have the same form. A record therefore needs
only log2(n) steps over whole arrays.
"""

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from .._precision import array_module, is_traced
from .._types import AnyArray, Numbers, Real
from ._curves import common

_Maps = tuple[Any, Any]
_SMOOTH, _BEGIN = 45.0, 60.0  # s: time constant of the smoothing of a rate of change, and length of the line fitted to start it


def lagged(temperature: Numbers, dt: Real, tau: Real, start: Real | None = None) -> AnyArray:
    r"""Compute the temperature of an element that follows the thermometer with a time constant.

    .. math:: x_k = x_{k-1} + (1 - e^{-\Delta t/\tau}) (T_k - x_{k-1})

    The formula is exact for every step dt if the temperature is constant during a step. (The common approximation dt/tau of the factor
    requires dt much below tau.)

    Parameters
    ----------
    temperature : (n,) readings of the thermometer, degC.
    dt : time step before each sample, s, one number or (n,).
    tau : time constant in s; 0 returns the thermometer itself.
    start : state before the first sample, degC; None uses the first sample.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature._hysteresis import lagged
    >>> print(lagged(np.array([20.0, 30.0, 30.0]), 1.0, 1.0).round(2))
    [20.   26.32 28.65]
    """
    xp = array_module(temperature, dt, tau, start)
    t, dt, tau = common(xp, temperature, dt, tau)
    # avoid a division by zero in the unused branch, because its derivative would not be finite
    keep = xp.where(tau > 0, xp.exp(-dt / xp.where(tau > 0, tau, 1)), 0)
    keep = xp.broadcast_to(keep, t.shape)
    follow = (1 - keep) * t
    first = t[0] if start is None else start
    return _scanned(xp, keep, follow, first, lambda a, b: (a[0] * b[0], b[0] * a[1] + b[1]), lambda m, x: m[0] * x + m[1])


def played(temperature: Numbers, play: Real) -> AnyArray:
    r"""Compute the temperature behind a backlash of half-width h.

    .. math:: P_k = \min(\max(P_{k-1}, T_k - h), T_k + h)

    Parameters
    ----------
    temperature : (n,) degC.
    play : h in degC; 0 returns the temperature itself.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature._hysteresis import played
    >>> print(played(np.array([20.0, 21.0, 20.5, 20.0]), 0.4))
    [20.  20.6 20.6 20.4]
    """
    xp = array_module(temperature, play)
    t, h = common(xp, temperature, play)

    def compose(a: _Maps, b: _Maps) -> _Maps:
        return xp.clip(a[0], b[0], b[1]), xp.clip(a[1], b[0], b[1])

    return _scanned(xp, t - h, t + h, t[0], compose, lambda m, x: xp.clip(x, m[0], m[1]))


def felt(temperature: Any, lag: Any, play: Any, steps: Any = None) -> AnyArray:
    """Temperature behind lag and play; `steps` is dt of `lagged`."""
    behind = lagged(temperature, steps, lag) if is_traced(lag) or lag > 0 else temperature
    return played(behind, play) if is_traced(play) or play > 0 else behind


def rate_of(temperature: Any, dt: Any, behind: Any = 0.0) -> AnyArray:
    r"""Rate of change dT/dt in degC/s behind its own lag. The filters start from a line through the first minute.

    .. math:: \dot T \approx (3 - 2 L)\,L\,\frac{T - L T}{\tau_0}\quad\text{with L the filter of `lagged` for } \tau_0 = 45\,\text{s}

    This removes the noise of the thermometer without a delay: the leading error is of the order :math:`(\tau_0\,d/dt)^2`. Behind a lag
    tau the rate is :math:`(T - L_\tau T)/\tau`, the scaled difference between two thermometers of which one lags.

    Parameters
    ----------
    temperature : (n,) degC. dt : see `lagged`. behind : tau in s.
    """
    xp = array_module(temperature, dt, behind)
    t, dt, behind = common(xp, temperature, dt, behind)
    along = xp.cumsum(xp.broadcast_to(dt, t.shape))
    inside = (along - along[0] <= _BEGIN).astype(t.dtype)
    middle = xp.sum(inside * along) / xp.sum(inside)
    centred = (along - middle) * inside
    square = xp.sum(centred**2)
    slope = xp.sum(centred * t) / xp.where(square > 0, square, 1)
    first = xp.sum(inside * t) / xp.sum(inside) - slope * (middle - along[0] + dt.ravel()[0])
    r = lagged((t - lagged(t, dt, _SMOOTH, first - slope * _SMOOTH)) / _SMOOTH, dt, _SMOOTH, slope)
    # the filter L and the difference each delay by tau_0; the factor 3 - 2 L removes both delays
    return lagged(3 * r - 2 * lagged(r, dt, _SMOOTH, slope), dt, behind, slope)


def steps_of(time: Any) -> AnyArray:
    """Time step before each sample; the step before the first sample is set to that before the second."""
    xp = array_module(time)
    steps = xp.diff(xp.asarray(time))
    return xp.concatenate([steps[:1], steps])


def _scanned(xp: Any, a: Any, b: Any, start: Any, compose: Callable[[_Maps, _Maps], _Maps], apply: Callable[[_Maps, Any], Any]) -> Any:
    """Compose every map with all earlier maps, and apply the results to the start."""
    if xp is jnp:  # a compiled loop is fast, and its program is small
        return jax.lax.scan(lambda x, maps: (apply(maps, x),) * 2, jnp.asarray(start, a.dtype), (a, b))[1]
    # W. D. Hillis and G. L. Steele, Comm. ACM 29 (1986) 1170
    step = 1
    while step < a.shape[0]:
        first, second = compose((a[:-step], b[:-step]), (a[step:], b[step:]))
        a, b = xp.concatenate([a[:step], first]), xp.concatenate([b[:step], second])
        step *= 2
    return apply((a, b), start)
