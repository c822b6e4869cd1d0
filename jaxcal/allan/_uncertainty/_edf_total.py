"""Equivalent degrees of freedom of the total statistics, by noise type, from record length over cluster time.

For Gaussian noise, the edf of a quadratic form v = theta' A theta is (tr A C)^2 / tr (A C A C), where C is the generalised covariance
of phase (`phase_covariance`). For totdev, mtotdev and htotdev this was evaluated for records of up to 768 samples, and put into
formulas and tables of x = T / tau; the form holds at every cluster size. The published formulas (NIST SP 1065, sections 5.2.11 to
5.2.14) agree with it for totdev at large m. Elsewhere they count too many degrees of freedom: for mtotdev and htotdev 1.2 times at
x = 8, 1.5 times at x = 3, and for all three about twice at m = 1.
"""

import numpy as np

from ..._errors import DataError
from ..._types import Any, Float
from .._kinds import Kind, find_kind
from . import _edf
from ._tables import WINDOWS

#: edf of htotdev over that of ohdev in white and flicker phase noise. Simulations gave 1.42 to 2.3 for m = 2 .. 64 and 6 to 48 cluster
#: times in the record (1000 records each); the smallest is used, so that no interval is too narrow
_OVER_OHDEV = 1.4


def degrees_of_freedom(m: Any, alpha: Any, kind: str | Kind, samples: Any) -> Float[np.ndarray, "..."]:
    """Equivalent degrees of freedom of a variance, for a record without gaps.

    Plain statistics use the "combined" algorithm of Greenhall and Riley (PTTI 2003), total statistics their quadratic forms. The variance
    times edf over its expectation is nearly chi-square with edf degrees of freedom.

    Parameters
    ----------
    m : cluster sizes in samples.
    alpha : noise types (2 white phase .. -2 random walk of rate, -4 for three-sample statistics), broadcast against m.
    kind : name of the statistic, such as "oadev".
    samples : number of rate samples of the record, broadcast against m.

    In phase noise, htotdev has 1.4 times the degrees of freedom of ohdev, or those of white rate noise if they are more. From 6 cluster
    times in the record on, these are 0 to 35 % fewer than in simulations, and far fewer below. Types beyond the last count as the last.

    Examples
    --------
    Total deviation of white rate noise: one and a half times the number of clusters in the record.

    >>> from jaxcal.allan import degrees_of_freedom
    >>> [round(float(v), 1) for v in degrees_of_freedom([10, 100, 500], 0, "totdev", 1000)]
    [148.1, 15.0, 3.0]
    """
    kind = find_kind(kind)
    if kind.family == "error":
        raise DataError(f"no distribution of {kind.name} is known, and so no degrees of freedom", code="kind")
    if not kind.contiguous:
        return _edf.degrees_of_freedom(m, alpha, kind, samples)
    lowest = -4 if kind.order == 3 else -2
    sizes, types, lengths = np.broadcast_arrays(m, np.clip(np.asarray(alpha), lowest, 2).astype(np.int64), samples)
    edf = np.ones(sizes.shape)
    formula = _totdev if kind.name == "totdev" else _windows
    shift = 0 if kind.order == 3 else 2  # row of the tables of windows is shift - alpha
    for noise in np.unique(types):
        here = types == noise
        edf[here] = formula(sizes[here].astype(np.float64), np.maximum(lengths[here], 1).astype(np.float64), int(noise), shift)
    if kind.order == 3:  # htotdev equals ohdev at m = 1; elsewhere it has more degrees of freedom, in phase noise many more
        for length in np.unique(lengths):
            here = (lengths == length) & ((sizes == 1) | (types > 0))
            plain = _edf.degrees_of_freedom(sizes[here], types[here], kind.plain, int(length))
            edf[here] = np.where(sizes[here] == 1, plain, np.maximum(edf[here], _OVER_OHDEV * plain))
    return np.asarray(np.maximum(edf, 1.0))


def _totdev(m, n, alpha: int, _):
    x = n / m
    if alpha == 2:  # 32 m^2: differences within m of an end share the end point twice
        return (6.0 * n + 8.0 * m) ** 2 / (70.0 * n + 110.0 * m + 32.0 * m**2)
    if alpha == 1:  # fitted up to n = 512
        return n / (1.339 + 0.2834 * m * np.minimum(m, 512.0) ** -0.094) / (1.0 + 0.96 / x)
    if alpha == 0:
        return 1.5 * x * m**2 / (m**2 + 1.25)
    if alpha == -1:
        return (1.17 * x - 0.22) * m**3 / (m**3 + 0.33)
    return (0.93 * x - 0.36) * m**3 / (m**3 + 0.047)


def _windows(m, n, alpha: int, shift: int):
    row = min(max(shift - alpha, 0), 4)
    x, values = np.maximum(n / m, WINDOWS["ratios"][0]), WINDOWS["edf"][row]
    slope = (values[-1] - values[-2]) / (WINDOWS["ratios"][-1] - WINDOWS["ratios"][-2])
    inside = np.interp(x, WINDOWS["ratios"], values)
    change = np.interp(np.log(m), np.log(WINDOWS["sizes"]), WINDOWS["factors"][row])
    return change * np.where(x > WINDOWS["ratios"][-1], values[-1] + slope * (x - WINDOWS["ratios"][-1]), inside)
