"""`scale_factor`: a scale factor from calibrations at several temperatures."""

from typing import Any

import numpy as np
from numpy.polynomial import chebyshev

from .._errors import DataError
from .._precision import host_float64
from ._bins import Bins
from ._curves import Chebyshev
from ._linear import bic, monomials, scaled
from ._model import ThermalModel
from ._record import numbers
from ._result import Candidate, TemperatureFit

_HIGHEST = 3


@host_float64
def scale_factor(temperature: Any, scale: Any, *, error: Any = None, degree: int | None = None, confidence: float = 0.95) -> TemperatureFit:
    r"""Scale factor against temperature, from calibrations (multi-position, rate table) at a few temperatures.

    .. math:: s(T) = \sum_i q_i C_i(u),\qquad \hat x = y / s(T)

    The entries of a misalignment matrix are fitted in the same way, one at a time.

    Parameters
    ----------
    temperature : (n,) degC of each calibration, at least three different ones.
    scale : (n,) scale factors.
    error : their standard errors, one or (n,); None takes them from the residuals, which needs n above degree + 1.
    degree : of the polynomial; None chooses 0 to 3 by BIC, fewer where there are few temperatures.
    confidence : level of the intervals.

    Returns
    -------
    TemperatureFit whose `model.correct` divides by the scale factor.

    Raises
    ------
    DataError
        If there are too few temperatures for the degree, or a number is not finite.

    Examples
    --------
    >>> import jaxcal
    >>> found = jaxcal.temperature.scale_factor([0.0, 20.0, 40.0, 60.0], [1.000, 1.004, 1.008, 1.012], error=1e-5)
    >>> found.degree, float(found.coefficients[1].round(6))
    (1, 0.0002)

    References
    ----------
    The thesis, section 5.2: scale factor and misalignment depend on temperature as the bias does.
    """
    t, s = numbers(temperature, "temperature"), numbers(scale, "scale")
    if len(t) != len(s):
        raise DataError(f"temperature has {len(t)} values and scale {len(s)}; give one temperature per calibration")
    if not (np.isfinite(t).all() and np.isfinite(s).all()):
        raise DataError("a temperature or a scale factor is not a number; leave that calibration out")
    different = len(np.unique(t))
    if different < 3:
        raise DataError(f"there are {different} different temperatures; calibrate at three or more, over the range of use")
    sigma = None if error is None else np.broadcast_to(np.asarray(error, dtype=float), s.shape)
    if sigma is not None and not (np.isfinite(sigma).all() and (sigma > 0).all()):
        raise DataError("error must be standard errors above 0, one or as many as scale factors")
    order, low, high = np.argsort(t, kind="stable"), float(t.min()), float(t.max())
    t, s = t[order], s[order]
    weight = np.ones(len(s)) if sigma is None else 1 / sigma[order]
    most = min(_HIGHEST, different - 2) if degree is None else degree
    if not 0 <= most <= different - 1 or (sigma is None and most > len(s) - 2):
        raise DataError(f"degree={degree} needs more than the {len(s)} calibrations given (at {different} temperatures)")
    design = chebyshev.chebvander(scaled(t, low, high), most) * weight[:, None]
    fits = []
    for one in range(most + 1) if degree is None else [degree]:
        q = np.linalg.lstsq(design[:, : one + 1], s * weight, rcond=None)[0]
        rss = float(np.sum((s * weight - design[:, : one + 1] @ q) ** 2))
        # with known errors the sum of squares itself is minus twice the log likelihood
        fits.append((bic(rss, len(s), one + 1) if sigma is None else rss + (one + 1) * np.log(len(s)), one, q, rss))
    best = min(fits, key=lambda found: found[0])
    _, chosen, q, rss = best
    curve = Chebyshev(q, low, high)
    spread = rss / max(len(s) - chosen - 1, 1) if sigma is None else 1.0
    covariance = spread * np.linalg.inv(design[:, : chosen + 1].T @ design[:, : chosen + 1])
    change = np.stack([monomials(Chebyshev(unit, low, high)) for unit in np.eye(chosen + 1)], axis=1)
    grid = np.linspace(low, high, 101)
    rows = chebyshev.chebvander(scaled(grid, low, high), chosen)
    residual = s - np.asarray(curve.value(t))
    worst = int(np.argmax(np.abs(residual)))
    return TemperatureFit(
        model=ThermalModel(curve, low, high, scale=True), degree=chosen, coefficients=monomials(curve),
        coefficient_error=np.sqrt(np.diag(change @ covariance @ change.T)), steps=(), parameters={},
        rms=float(np.sqrt(np.mean(residual**2))),
        worst=float(np.abs(residual[worst])), worst_at=float(t[worst]), grid=grid,
        error=np.sqrt(np.einsum("ij,jk,ik->i", rows, covariance, rows)), bins=Bins(t, s, np.ones(len(s))), residual=residual,
        thermometer=0.0, kind="polynomial", held_out="", confidence=float(confidence), warnings=(), notes=(),
        candidates=tuple(Candidate(f"polynomial {one}", value, 0.0, one == chosen) for value, one, _, _ in fits) if degree is None else (),
    )  # fmt: skip
