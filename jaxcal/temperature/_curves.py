"""Curves of bias as a function of temperature: Chebyshev series, series with logistic steps, piecewise cubic."""

import abc
from types import ModuleType
from typing import Any

import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._frozen import Model
from .._precision import array_module
from .._types import AnyArray, Held, Leaf, Numbers, Real


def sigmoid(t: Real, centre: Real, width: Real) -> Any:
    """Logistic step from 0 to 1."""
    at = (t - centre) / width
    return scipy.special.expit(at) if array_module(at) is np else jax.scipy.special.expit(at)


def common(xp: ModuleType, *values: Any) -> list[Any]:
    """Convert values to arrays of their widest floating-point type, at least float32; in JAX without x64, of float32."""
    kind = np.result_type(*(value.dtype if hasattr(value, "dtype") else np.dtype(float) for value in values), np.float32)
    kind = kind if xp is np else jax.dtypes.canonicalize_dtype(kind)
    return [xp.asarray(value, dtype=kind) for value in values]


class AbstractCurve(Model):
    """A bias as a function of the temperature; subclass it and implement `value` for your own curve.

    Examples
    --------
    >>> from jaxcal.temperature import AbstractCurve
    >>> class Line(AbstractCurve):
    ...     slope: float
    ...
    ...     def value(self, t):
    ...         return self.slope * (t - 25.0)
    >>> Line(2.0).value(30.0)
    10.0
    """

    @abc.abstractmethod
    def value(self, t: Numbers) -> AnyArray:
        """Compute the bias at the temperatures `t` (n,) or (), degC."""


class Chebyshev(AbstractCurve):
    r"""Series of Chebyshev polynomials.

    .. math:: b(T) = \sum_i q_i C_i(u),\qquad u = 2 (T - T_{lo})/(T_{hi} - T_{lo}) - 1

    Attributes
    ----------
    coefficients : (degree + 1,) q, in the unit of the bias.
    low, high : T_lo and T_hi, degC.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Chebyshev
    >>> line = Chebyshev(np.array([1.0, 0.5]), 20.0, 40.0)
    >>> print(line.value(np.array([20.0, 30.0, 40.0])))
    [0.5 1.  1.5]
    """

    coefficients: Held
    low: Leaf
    high: Leaf

    def value(self, t: Numbers) -> AnyArray:
        """Compute the bias by Clenshaw's recurrence, C. W. Clenshaw, Math. Comp. 9 (1955) 118."""
        xp = array_module(self, t)
        t, q, low, high = common(xp, t, self.coefficients, self.low, self.high)
        u = 2 * (t - low) / (high - low) - 1
        first, second = xp.zeros_like(u), xp.zeros_like(u)
        for i in range(q.shape[0] - 1, 0, -1):
            first, second = 2 * u * first - second + q[i], first
        return xp.asarray(u * first - second + q[0])


class Steps(AbstractCurve):
    r"""Series of Chebyshev polynomials plus logistic steps.

    .. math:: b(T) = \sum_i q_i C_i(u) + \sum_j p_j / (1 + e^{-(T - t_j)/w_j})

    Attributes
    ----------
    base : `Chebyshev`.
    height, centre, width : (steps,) p in the unit of the bias, t and w in degC.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Chebyshev, Steps
    >>> curve = Steps(Chebyshev(np.zeros(2), 20.0, 40.0), np.array([0.5]), np.array([30.0]), np.array([0.1]))
    >>> print(curve.value(np.array([25.0, 30.0, 35.0])).round(6))
    [0.   0.25 0.5 ]
    """

    base: Chebyshev
    height: Held
    centre: Held
    width: Held

    def value(self, t: Numbers) -> AnyArray:
        """Compute the sum of the series and all steps."""
        xp = array_module(self, t)
        here, height, centre, width = common(xp, t, self.height, self.centre, self.width)
        steps = (own * sigmoid(here, at, wide) for own, at, wide in zip(height, centre, width, strict=True))
        return xp.asarray(sum(steps, self.base.value(here)))


class Piecewise(AbstractCurve):
    r"""Polynomials of degree 3 or less between nodes.

    .. math:: b(T) = \sum_p c_{kp} (T - t_k)^p \quad\text{for}\quad t_k \le T < t_{k+1}

    Attributes
    ----------
    nodes : (pieces + 1,) t, degC, increasing.
    coefficients : (pieces, powers) c, lowest power first. Outside the nodes the curve keeps its first or last value.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import Piecewise
    >>> curve = Piecewise(np.array([20.0, 30.0, 40.0]), np.array([[1.0, 0.1], [2.0, -0.2]]))
    >>> print(curve.value(np.array([20.0, 25.0, 35.0])))
    [1.  1.5 1. ]
    """

    nodes: Held
    coefficients: Held

    def value(self, t: Numbers) -> AnyArray:
        """Compute the bias by Horner's rule in the piece of each temperature."""
        xp = array_module(self, t)
        t, nodes, c = common(xp, t, self.nodes, self.coefficients)
        t = xp.clip(t, nodes[0], nodes[-1])
        k = xp.clip(xp.searchsorted(nodes, t, side="right") - 1, 0, c.shape[0] - 1)
        x, total = t - nodes[k], c[k, c.shape[1] - 1]
        for power in range(c.shape[1] - 2, -1, -1):
            total = total * x + c[k, power]
        return xp.asarray(total)
