"""Fits of a given form: `residuals` and their fit, pure functions that also run under `jit`, `vmap` and `grad`; `scale_factor`."""

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Message
from .._errors import DataError
from .._precision import array_module, host_float64
from ..fitting import Fit, solve
from ._curves import AbstractCurve, Chebyshev, common
from ._hysteresis import lagged, played, steps_of
from ._linear import basis, bic, powers, table_curve
from ._model import ThermalModel
from ._record import COARSE, FINE, Bins, binned, numbers
from ._result import Candidate, TemperatureFit

#: fields that are not fitted: the scaling range and the nodes of a curve
_HELD = ("low", "high", "nodes")


def residuals(model: Any, data: Bins) -> Any:
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
    """Least-squares fit of a curve; the search begins at the given curve."""

    def free(path: Any, leaf: Any) -> Any:
        return jax.tree_util.keystr(path[-1:], simple=True) not in _HELD

    leaves = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float) if isinstance(leaf, (int, float)) else leaf, curve)
    return solve(residuals, leaves, bins, free=jax.tree_util.tree_map_with_path(free, leaves))


def traced(
    temperature: Any, bias: Any, model: Any, degree: int | None, time: Any, lag: Any, play: Any, quantity: str
) -> TemperatureFit:  # fmt: skip
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
    return TemperatureFit(ThermalModel(curve, low, high, lag, play), bins, residual, rms, kind, quantity, degree)


@host_float64
def scale_factor(temperature: Any, scale: Any, *, error: Any = None, degree: int | None = None, confidence: float = 0.95) -> TemperatureFit:
    r"""Fit a scale factor as a function of temperature to calibrations (multi-position, rate table) at a few temperatures.

    .. math:: s(T) = \sum_i q_i C_i(u),\qquad \hat x = y / s(T)

    You can fit the entries of a misalignment matrix in the same way, one at a time.

    Parameters
    ----------
    temperature : (n,) degC of each calibration, at least three different temperatures.
    scale : (n,) scale factors.
    error : standard errors of the scale factors, one or (n,); None estimates them from the residuals and needs n above degree + 1.
    degree : degree of the polynomial; None chooses 0 to 3 by BIC, but at most the number of different temperatures minus 2.
    confidence : level of the intervals.

    Returns
    -------
    TemperatureFit
        Its `model.correct` divides by the scale factor.

    Raises
    ------
    DataError
        If there are too few temperatures for the degree, or a number is not finite.

    Examples
    --------
    >>> import jaxcal
    >>> found = jaxcal.temperature.scale_factor([0.0, 20.0, 40.0, 60.0], [1.000, 1.004, 1.008, 1.012], error=1e-5)
    >>> found.degree, round(found.estimate["a2"].value, 6)
    (1, 0.0002)

    References
    ----------
    The thesis, section 5.2: scale factor and misalignment depend on temperature as the bias does.
    """
    t, s = numbers(temperature, "temperature"), numbers(scale, "scale")
    if len(t) != len(s):
        raise DataError(f"temperature has {len(t)} values and scale {len(s)}; give one temperature per calibration", code="lengths")
    if not (np.isfinite(t).all() and np.isfinite(s).all()):
        raise DataError("a temperature or a scale factor is not a number; leave that calibration out", code="no_numbers")
    different = len(np.unique(t))
    if different < 3:
        said = f"there are {different} different temperatures; calibrate at three or more, over the range of use"
        raise DataError(said, code="few_temperatures")
    sigma = None if error is None else np.broadcast_to(np.asarray(error, dtype=float), s.shape)
    if sigma is not None and not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise DataError("error must be standard errors above 0, one or as many as scale factors", code="error")
    order, low, high = np.argsort(t, kind="stable"), float(t.min()), float(t.max())
    t, s = t[order], s[order]
    weight = np.ones(len(s)) if sigma is None else 1 / sigma[order]
    most = min(3, different - 2) if degree is None else degree
    if not 0 <= most <= different - 1 or (sigma is None and most > len(s) - 2):
        raise DataError(f"degree={degree} needs more than the {len(s)} calibrations given (at {different} temperatures)", code="degree")
    design = basis(t, low, high, most) * weight[:, None]
    fits = []
    for one in range(most + 1) if degree is None else [degree]:
        q = np.linalg.lstsq(design[:, : one + 1], s * weight, rcond=None)[0]
        rss = float(np.sum((s * weight - design[:, : one + 1] @ q) ** 2))
        # with known errors, the sum of squares is minus twice the log likelihood
        fits.append((bic(rss, len(s), one + 1) if sigma is None else rss + (one + 1) * np.log(len(s)), one, q, rss))
    _, chosen, q, rss = min(fits, key=lambda found: found[0])
    curve = Chebyshev(q, low, high)
    spread = rss / max(len(s) - chosen - 1, 1) if sigma is None else 1.0
    covariance = spread * np.linalg.inv(design[:, : chosen + 1].T @ design[:, : chosen + 1])
    grid = np.linspace(low, high, 101)
    rows = basis(grid, low, high, chosen)
    residual = s - np.asarray(curve.value(t))
    worst = int(np.argmax(np.abs(residual)))
    return TemperatureFit(
        ThermalModel(curve, low, high, scale=True), Bins(t, s, np.ones(len(s))), residual, float(np.sqrt(np.mean(residual**2))),
        kind="polynomial", quantity="ratio", degree=chosen, estimate=powers(curve, covariance, "ratio"),
        worst=float(np.abs(residual[worst])), worst_at=float(t[worst]), grid=grid, thermometer=0.0, confidence=float(confidence),
        error=np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows)),
        candidates=() if degree is not None else tuple(
            Candidate(f"polynomial {one}", value - fits[chosen][0], one == chosen) for value, one, _, _ in fits
        ),
    )  # fmt: skip
