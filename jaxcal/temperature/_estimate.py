"""Fits of a given form: `residuals` and their fit, pure functions that also run under `jit`, `vmap` and `grad`."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Message
from .._errors import DataError
from .._precision import array_module
from ..fitting import Fit, solve
from ._curves import AbstractCurve, Chebyshev, common
from ._hysteresis import lagged, played, steps_of
from ._linear import table_curve
from ._model import ThermalModel
from ._record import COARSE, FINE, Bins, binned
from ._result import TemperatureFit

#: fields that are not fitted: the scaling range and the nodes of a curve
_HELD = ("low", "high", "nodes")


def residuals(model: ThermalModel | AbstractCurve, data: Bins) -> Any:
    r"""Compute the residuals of a thermal model on bins of temperature, in units of their standard deviation.

    .. math:: r_j = \sqrt{c_j}\,(f(T_j) - b_j)/\sigma

    The function is pure and works under `jit`, `vmap`, `grad` and in `jaxcal.fitting.solve`.

    Parameters
    ----------
    model : `ThermalModel`, or any `AbstractCurve`.
    data : `Bins` with mean temperatures T at the sensor, degC, mean biases b, counts c, and `error` sigma.

    Returns
    -------
    (bins,)

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Chebyshev, residuals
    >>> from jaxcal.temperature._record import Bins
    >>> bins = Bins(np.array([20.0, 40.0]), np.array([1.0, 2.0]), np.array([4.0, 1.0]))
    >>> print(residuals(Chebyshev(np.array([1.5]), 20.0, 40.0), bins))
    [ 1.  -0.5]
    """
    xp = array_module(model, data)
    t, b, count, error = common(xp, data.t, data.b, data.count, data.error)
    value = model.curve.value(xp.clip(t, model.low, model.high)) if isinstance(model, ThermalModel) else model.value(t)
    return xp.sqrt(count) * (value - b) / error


def fitted(curve: AbstractCurve, bins: Bins) -> Fit:
    """Least-squares fit of a curve; the search begins at the given curve."""
    leaves = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float) if isinstance(leaf, (int, float)) else leaf, curve)
    free = jax.tree_util.tree_map_with_path(lambda path, _: jax.tree_util.keystr(path[-1:], simple=True) not in _HELD, leaves)
    return solve(residuals, leaves, bins, free=free)


def traced(temperature: Any, bias: Any, model: Any, degree: int | None, time: Any, lag: Any, play: Any, unit: str) -> TemperatureFit:
    """Traceable fit of a fully specified form, for a record that needs no cleaning."""
    known = isinstance(model, AbstractCurve) or model == "table" or (model == "polynomial" and degree is not None)
    if not known or isinstance(lag, str) or isinstance(play, str):
        said = "this model decides on the host and cannot be traced; give {option.model:polynomial} with {option.degree}, "
        raise DataError(Message(said + "{option.model:table} or a curve, and {option.lag} and {option.play} as numbers"), code="traced")
    t, b = common(jnp, temperature, bias)
    if t.ndim != 1 or t.shape != b.shape:
        raise DataError(f"temperature has shape {t.shape} and bias {b.shape}; expected both (n,)", code="shape")
    # keep NumPy temperatures in NumPy, because the number of bins is then known
    t = t if isinstance(temperature, jax.Array) else np.asarray(temperature, dtype=t.dtype)
    t = played(t if time is None else lagged(t, steps_of(common(jnp, time, t)[0]), lag), play)
    low, high, bins = t.min(), t.max(), binned(t, b, FINE)
    if model == "table":
        curve = table_curve(binned(t, b, COARSE))
    else:
        curve = fitted(Chebyshev(jnp.zeros((degree or 0) + 1, dtype=b.dtype), low, high) if model == "polynomial" else model, bins).model
    residual = bins.b - curve.value(bins.t)
    rms = jnp.sqrt(jnp.sum(bins.count * residual**2) / jnp.sum(bins.count))
    kind = model if isinstance(model, str) else type(model).__name__
    return TemperatureFit(ThermalModel(curve, low, high, lag, play), bins, residual, rms, kind, unit, degree)
