"""`residuals` of a thermal model, and the fit of a curve whose form is given: pure functions, also under `jit`, `vmap` and `grad`."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import array_module
from ..fitting import Fit, solve
from ._bins import FINE, Bins, binned
from ._curves import AbstractCurve, Chebyshev, common
from ._hysteresis import lagged, played
from ._linear import table_bins, table_curve
from ._model import ThermalModel
from ._result import TemperatureFit

#: leaves that are not fitted: where a curve is scaled or joined
_HELD = ("low", "high", "nodes")


def residuals(model: Any, data: Bins) -> Any:
    r"""Residuals of a thermal model: means over bins of temperature, in units of their standard deviation.

    .. math:: r_j = \sqrt{c_j}\,(f(T_j) - b_j)/\sigma

    Pure, and usable under `jit`, `vmap`, `grad` and in `jaxcal.fitting.solve`.

    Parameters
    ----------
    model : `ThermalModel`, or any `AbstractCurve`.
    data : `Bins`: mean temperatures that the sensor felt T, degC, means b, counts c; `error` is sigma.

    Returns
    -------
    (bins,)

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Bins, Chebyshev, residuals
    >>> bins = Bins(np.array([20.0, 40.0]), np.array([1.0, 2.0]), np.array([4.0, 1.0]))
    >>> print(residuals(Chebyshev(np.array([1.5]), 20.0, 40.0), bins))
    [ 1.  -0.5]
    """
    xp = array_module(model, data)
    t, b, count, error = common(xp, data.t, data.b, data.count, data.error)
    value = model.curve.value(xp.clip(t, model.low, model.high)) if isinstance(model, ThermalModel) else model.value(t)
    return xp.sqrt(count) * (value - b) / error


def fitted(curve: AbstractCurve, bins: Bins) -> Fit:
    """The curve of least squares that has the form of the one given, which is where the search begins."""

    def free(path: Any, leaf: Any) -> Any:
        return jax.tree_util.keystr(path[-1:], simple=True) not in _HELD

    leaves = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float) if isinstance(leaf, (int, float)) else leaf, curve)
    return solve(residuals, leaves, bins, free=jax.tree_util.tree_map_with_path(free, leaves))


def traced(temperature: Any, bias: Any, model: Any, degree: int | None, time: Any, lag: Any, play: Any) -> TemperatureFit:
    """The fit of a form that the arguments fix, for a record that needs no cleaning."""
    known = isinstance(model, AbstractCurve) or model in ("polynomial", "table")
    if not known or isinstance(lag, str) or isinstance(play, str):
        raise DataError(
            f"model={model!r} with lag={lag!r} and play={play!r} decides on the host and cannot be traced; give model='polynomial' with a "
            "degree, 'table' or a curve, and lag and play as numbers"
        )
    if model == "polynomial" and degree is None:
        raise DataError("the degree is chosen on the host, which cannot be traced; give degree=")
    t, b = common(jnp, temperature, bias)
    if t.ndim != 1 or t.shape != b.shape:
        raise DataError(f"temperature has shape {t.shape} and bias {b.shape}; expected both (n,)")
    # NumPy's temperatures stay NumPy's: with them the number of bins is known
    t = t if isinstance(temperature, jax.Array) else np.asarray(temperature, dtype=t.dtype)
    if time is not None:
        steps = jnp.diff(common(jnp, time, t)[0])
        t = lagged(t, jnp.concatenate([steps[:1], steps]), lag)
    t = played(t, play)
    low, high, bins = t.min(), t.max(), binned(t, b, FINE)
    if model == "table":
        curve = table_curve(table_bins(t, b))
    else:
        curve = fitted(Chebyshev(jnp.zeros((degree or 0) + 1, dtype=b.dtype), low, high) if model == "polynomial" else model, bins).model
    residual = bins.b - curve.value(bins.t)
    return TemperatureFit(
        model=ThermalModel(curve, low, high, lag, play), degree=degree, coefficients=None, coefficient_error=None, steps=(), parameters={},
        rms=jnp.sqrt(jnp.sum(bins.count * residual**2) / jnp.sum(bins.count)), worst=None, worst_at=None, grid=None, error=None,
        bins=bins, residual=residual, thermometer=None, candidates=(), kind=model if isinstance(model, str) else type(model).__name__,
        held_out="", confidence=0.95, warnings=(), notes=(),
    )  # fmt: skip
