r"""Prior of the smoothness of a curve: a Gaussian process with Matern covariance of smoothness 7/2.

.. math:: k(d) = \sigma^2 (1 + s + \tfrac{2}{5} s^2 + \tfrac{1}{15} s^3) e^{-s},\qquad s = \sqrt 7\, d/\ell

Its curves are three times differentiable and equally rough over the whole range. The process is expressed in coefficients of Chebyshev
polynomials: their covariance is the double Chebyshev series of the kernel. Its Cholesky factor is a smooth function of the length, which
a spline interpolates.
"""

import functools
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used
from numpy.polynomial import chebyshev

from .._types import AnyArray

#: limits of the length in half ranges; shorter lengths need a higher degree, longer ones are all alike
SHORTEST, LONGEST = 0.1, 3.0
#: degree of the series, and numbers of nodes and lengths of its table
DEGREE, _NODES, _LENGTHS = 40, 96, 41


def factor(log_length: float) -> tuple[AnyArray, AnyArray]:
    """Factor F (DEGREE, DEGREE) of the covariance F F' of the coefficients from 1 for sigma = 1, and dF/d log_length.

    Coefficient 1, the slope, is independent of the others, because it has no prior.
    """
    table = _table()
    return table(log_length), table(log_length, 1)


@functools.cache
def _table() -> Any:
    nodes = np.cos(np.pi * (np.arange(_NODES) + 0.5) / _NODES)
    series = 2 / _NODES * chebyshev.chebvander(nodes, DEGREE).T[1:]
    logs = np.linspace(np.log(SHORTEST), np.log(LONGEST), _LENGTHS)
    factors = np.zeros((_LENGTHS, DEGREE, DEGREE))
    for made, length in zip(factors, np.exp(logs), strict=True):
        s = np.sqrt(7.0) * np.abs(nodes[:, None] - nodes) / length
        covariance = series @ ((1 + s + 2 / 5 * s**2 + s**3 / 15) * np.exp(-s)) @ series.T
        made[0, 0] = np.sqrt(covariance[0, 0])
        made[1:, 1:] = np.linalg.cholesky(covariance[1:, 1:])
    return scipy.interpolate.CubicSpline(logs, factors)
