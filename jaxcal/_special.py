"""Chi-square, Fisher's F and Student's t on the host without SciPy, whose special functions take a fifth of a second to load.

Commands that need no more of SciPy than a p value and an interval answer sooner. Tests compare every function here with SciPy.
"""

import math
import statistics
from typing import Any

import numpy as np

#: half of a 95 % interval in standard deviations
NORMAL95 = statistics.NormalDist().inv_cdf(0.975)
#: degrees of freedom from which the expansion of Student's quantile about the normal one is exact to 1e-12
_MANY = 500.0


def chi_square_tail(value: Any, freedom: Any) -> np.ndarray | np.float64:
    r"""Probability of a larger chi-square of k degrees of freedom, a whole number from one on, by its finite sum.

    .. math:: Q = \sum_{j<k/2} e^{-x} \frac{x^j}{\Gamma(j + 1)},\qquad x = \chi^2/2,

    with :math:`j = 0, 1, \dots` for an even k; for an odd one :math:`j = 1/2, 3/2, \dots`, and :math:`\mathrm{erfc}\sqrt x` is added.

    Examples
    --------
    >>> from jaxcal._special import chi_square_tail
    >>> print(chi_square_tail(3.84, 1).round(4))
    0.05

    References
    ----------
    NIST Digital Library of Mathematical Functions, 8.4.10 and 8.4.15.
    """
    return _each(_tail, value, freedom)


def _each(function: Any, *arguments: Any) -> Any:
    """A function of numbers for each element; `numpy.vectorize` warns where an element is not a number."""
    if all(isinstance(argument, (int, float)) for argument in arguments):
        return np.float64(function(*map(float, arguments)))
    arrays = np.broadcast_arrays(*(np.asarray(argument, dtype=float) for argument in arguments))
    found = [function(*map(float, row)) for row in zip(*map(np.ravel, arrays), strict=True)]
    return np.reshape(np.array(found, dtype=float), arrays[0].shape)[()]


def _tail(value: float, freedom: float) -> float:
    if not value >= 0:
        return math.nan
    x, k = value / 2, round(freedom)
    if x == 0 or math.isinf(x):
        return 1.0 if x == 0 else 0.0
    scale = math.log(x)
    terms = [math.exp(j * scale - x - math.lgamma(j + 1)) for j in (k % 2 / 2 + i for i in range(k // 2))]
    return min(1.0, (math.erfc(math.sqrt(x)) if k % 2 else 0.0) + math.fsum(terms))


def f_tail(ratio: Any, above: Any, below: Any) -> np.ndarray | np.float64:
    r"""Probability of a larger F of d1 (`above`) and d2 (`below`) degrees of freedom.

    .. math:: Q = I_x(d_2 / 2, d_1 / 2),\qquad x = \frac{d_2}{d_2 + d_1 F}

    Examples
    --------
    >>> from jaxcal._special import f_tail
    >>> print(f_tail(4.0, 2, 10).round(4))
    0.0529

    References
    ----------
    M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 26.6.2.
    """
    return _each(lambda f, a, b: _beta(b / (b + a * f), a * f / (b + a * f), b / 2, a / 2) if f > 0 else 1.0 - 0.0 * f, ratio, above, below)


def student_quantile(freedom: Any, probability: float) -> np.ndarray | np.float64:
    """Quantile of Student's t for a probability from 0.5 to below one; of the normal law where the degrees of freedom are infinite.

    Newton's steps from zero on the cumulative probability, which is concave there, do not overshoot. From five hundred degrees of freedom
    on the Cornish-Fisher expansion takes their place.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._special import student_quantile
    >>> print(student_quantile([1.0, 5.0, np.inf], 0.975).round(4))
    [12.7062  2.5706  1.96  ]

    References
    ----------
    M. Abramowitz and I. A. Stegun, Handbook of Mathematical Functions, 26.7.5 and 26.7.8.
    """
    return _each(lambda k: _quantile(k, 1 - probability), freedom)


def _quantile(freedom: float, tail: float) -> float:
    if not freedom > 0:
        return math.nan
    if freedom < _MANY:
        size = math.lgamma((freedom + 1) / 2) - math.lgamma(freedom / 2) - math.log(freedom * math.pi) / 2
        return _root(lambda t: _larger(t, freedom) / 2, lambda t: math.exp(size - (freedom + 1) / 2 * math.log1p(t * t / freedom)), tail)
    z = _root(lambda z: math.erfc(z / math.sqrt(2)) / 2, lambda z: math.exp(-z * z / 2) / math.sqrt(2 * math.pi), tail)
    series = (
        (z**3 + z) / 4,
        (5 * z**5 + 16 * z**3 + 3 * z) / 96,
        (3 * z**7 + 19 * z**5 + 17 * z**3 - 15 * z) / 384,
        (79 * z**9 + 776 * z**7 + 1482 * z**5 - 1920 * z**3 - 945 * z) / 92160,
    )
    return z + sum(term * freedom**-power for power, term in enumerate(series, 1))


def _root(above: Any, density: Any, tail: float) -> float:
    """Where `above` has fallen to `tail`."""
    x = 0.0
    for _ in range(200):
        step = (above(x) - tail) / density(x)
        x += step
        if abs(step) <= 1e-14 * x:
            break
    return x


def _larger(t: float, freedom: float) -> float:
    """Probability of a larger |t|: the incomplete beta function of k/2 and 1/2 at k / (k + t^2)."""
    return _beta(freedom / (freedom + t * t), t * t / (freedom + t * t), freedom / 2, 0.5)


def _beta(x: float, rest: float, a: float, b: float) -> float:
    """The regularised incomplete beta function; `rest` is 1 - x, which would lose its digits near one."""
    if x == 0 or rest == 0:
        return float(rest == 0)
    front = math.exp(a * math.log(x) + b * math.log(rest) + math.lgamma(a + b) - math.lgamma(a) - math.lgamma(b))
    # the continued fraction converges on the smaller side
    return front * _fraction(x, a, b) / a if x < (a + 1) / (a + b + 2) else 1.0 - front * _fraction(rest, b, a) / b


def _fraction(x: float, a: float, b: float) -> float:
    """Continued fraction of the incomplete beta function, 26.5.8 of Abramowitz and Stegun, by the method of Lentz."""
    tiny = 1e-300
    c, d = 1.0, 1.0 / ((1.0 - (a + b) * x / (a + 1.0)) or tiny)
    value = d
    for m in range(1, 20_000):
        for factor in (
            m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m)),
            -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1)),
        ):
            d = 1.0 / ((1.0 + factor * d) or tiny)
            c = (1.0 + factor / c) or tiny
            value *= d * c
        if abs(d * c - 1.0) < 1e-16:
            break
    return value
