"""Curves whose fit is linear in the data: polynomial and table."""

import numpy as np
from numpy.polynomial import chebyshev

from .._precision import array_module
from .._types import AnyArray
from .._units import si_unit_of
from ..fitting import Estimate
from ._curves import Chebyshev, Piecewise
from ._record import Bins


def basis(t: AnyArray, low: float, high: float, degree: int) -> AnyArray:
    """(n, degree + 1) Chebyshev polynomials of the temperature, scaled to -1 .. 1."""
    return chebyshev.chebvander(2 * (np.clip(t, low, high) - low) / (high - low) - 1, degree)


def polynomial_curve(bins: Bins, low: float, high: float, degree: int) -> Chebyshev:
    """Chebyshev series by weighted least squares."""
    weight = np.sqrt(bins.count)
    return Chebyshev(np.linalg.lstsq(basis(bins.t, low, high, degree) * weight[:, None], bins.b * weight, rcond=None)[0], low, high)


def monomials(curve: Chebyshev) -> AnyArray:
    """Convert a Chebyshev series to the coefficients a1, a2, ... of the powers of T, equation (5.3) of the thesis."""
    ends = [float(curve.low), float(curve.high)]
    found = np.polynomial.Chebyshev(np.asarray(curve.coefficients), ends).convert(kind=np.polynomial.Polynomial).coef
    return np.pad(found, (0, len(curve.coefficients) - len(found)))


def powers(curve: Chebyshev, covariance: AnyArray, quantity: str) -> Estimate:
    """`monomials` by the names a1, a2, ..., from the covariance of the Chebyshev coefficients."""
    change = np.stack([monomials(Chebyshev(unit, curve.low, curve.high)) for unit in np.eye(len(covariance))], axis=1)
    names = [f"a{i + 1}" for i in range(len(change))]
    unit = si_unit_of(quantity)
    units = {name: f"{unit}/degC^{i}" if i else unit for i, name in enumerate(names)}
    return Estimate(names, monomials(curve), change @ covariance @ change.T, quantities=units)


def table_curve(nodes: Bins) -> Piecewise:
    """Bin means with linear interpolation."""
    xp = array_module(nodes)
    step = xp.diff(nodes.t)  # zero between the copies of the last node in a padded array
    slope = xp.where(step > 0, xp.diff(nodes.b) / xp.where(step > 0, step, 1), 0)
    return Piecewise(nodes.t, xp.stack([nodes.b[:-1], slope], axis=1))
