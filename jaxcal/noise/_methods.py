"""The methods that fit an Allan deviation curve, by name, and the cluster sizes each needs."""

import functools

import numpy as np

from .._errors import DataError
from .._types import Any
from . import _display
from ._joint import fit_jointly

#: cluster sizes of the fit: the curve is so strongly correlated that more would add nothing
_CLUSTERS = 25

#: name -> function of (curve, samples, terms, inside, automatic, confidence)
CURVES = {method: functools.partial(fit_jointly, method=method) for method in ("gls", "edf", "wavelet")} | {
    "unweighted": _display.fit_unweighted,
    "log": _display.fit_log,
    "slope": _display.fit_slope,
}


def clusters(method: str, samples: int, terms: tuple[Any, ...]) -> np.ndarray:
    """Cluster sizes for a fit: powers of two for "wavelet", else about 25 log-spaced, from 1 to a quarter of the record.

    Raises
    ------
    DataError
        If the record is too short to fit so many terms.

    Examples
    --------
    >>> from jaxcal.noise._methods import clusters
    >>> clusters("wavelet", 1000, ("N", "B", "K"))
    array([  1,   2,   4,   8,  16,  32,  64, 128])
    """
    fewest = len(terms) + 3
    needed = 4 * (2 ** (fewest - 1) if method == "wavelet" else fewest)
    if samples < needed:
        hint = ", another method" if method == "wavelet" and samples >= 4 * fewest else ""
        raise DataError(
            f"{samples} sample{'s are' if samples != 1 else ' is'} too short a record to fit {len(terms)} noise terms; "
            f"record at least {needed} samples (an hour or more, for bias instability){hint}, or ask for fewer terms"
        )
    if method == "wavelet":
        return 2 ** np.arange((samples // 4).bit_length())
    return np.unique(np.round(np.logspace(0.0, np.log10(samples // 4), _CLUSTERS)).astype(np.int64))
