r"""Whittle likelihood of binned ordinates, on the host and in a trace.

Ordinates are nearly independent and exponential about the model's density S = X theta, theta the squared coefficients, so

.. math:: \mathrm{NLL}(\theta) = \frac12\sum_b \nu_b\,[\ln S_b + P_b/S_b]

with P_b the mean of nu_b ordinates (P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram). It is
minimised as the sum of squared deviance residuals (`jaxcal.noise._minimise`); the information is its expected one.
"""

from typing import Any

import numpy as np

from ._minimise import Minima, minimise, namespace
from ._ordinates import Bins

_FAINT = 0.01  # share of its even part with which a column begins in one of the starts


def density(columns: Any, theta: Any) -> Any:
    """S, positive everywhere."""
    s = columns @ theta
    return namespace(s).maximum(s, np.finfo(s.dtype).tiny ** 0.5)


def information(bins: Bins, theta: Any) -> Any:
    """Expected (Fisher) information of the squared coefficients, F = 1/2 sum nu X X' / S^2."""
    rows = bins.columns * (namespace(bins, theta).sqrt(0.5 * bins.weight) / density(bins.columns, theta))[:, None]
    return rows.T @ rows


def flat_start(bins: Bins) -> Any:
    """Initial guess: every column carries the same share of the ordinates; zero for a column of zeros or of negative sign."""
    xp = namespace(bins)
    positive = (bins.weight > 0)[:, None] & (bins.columns > 0)
    count = xp.sum(positive, axis=0).astype(bins.density.dtype)
    ordinate = xp.maximum(bins.density, np.finfo(bins.density.dtype).tiny ** 0.5)
    logs = xp.where(positive, xp.log(ordinate[:, None] / xp.where(positive, bins.columns, 1.0)), 0.0)
    there = count > 0
    level = xp.exp(xp.sum(logs, axis=0) / xp.where(there, count, 1.0))
    return xp.where(there, level / xp.maximum(xp.sum(there).astype(count.dtype), 1.0), 0.0)


def several_starts(bins: Bins) -> Any:
    """(1 + p, p) initial guesses: all columns alike, and each in turn faint, for the likelihood has local minima."""
    p = bins.columns.shape[1]
    return flat_start(bins)[None, :] * np.concatenate([np.ones((1, p)), 1.0 - (1.0 - _FAINT) * np.eye(p)]).astype(bins.density.dtype)


def lower_of(columns: Any) -> Any:
    """(p,) bounds: the coefficient of a column of negative sign, which is that of a nuisance, may have either sign."""
    xp = namespace(columns)
    return xp.where(xp.any(columns < 0, axis=tuple(range(columns.ndim - 1))), -np.inf, 0.0)


def fit_from(bins: Bins, starts: Any, weights: Any = None) -> Minima:
    """The minimum reached from each start, (lanes, p); with `weights`, (lanes, bins), each lane has its own."""
    return minimise(bins.columns, bins.density, bins.weight if weights is None else weights, starts, lower=lower_of(bins.columns))
