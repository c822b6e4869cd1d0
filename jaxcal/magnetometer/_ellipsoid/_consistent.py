"""Adjusted least squares: the algebraic fit without its noise bias, the noise variance unknown (host, NumPy)."""

import itertools

import numpy as np
import scipy.optimize

from ._algebraic import NOT_ELLIPSOID, NotEllipsoid, ellipsoid_of, monomials

#: exponents (x, y, z) of the ten monomials
_EXPONENTS = ((2, 0, 0), (1, 1, 0), (0, 2, 0), (1, 0, 1), (0, 1, 1), (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0))
#: Hermite coefficients: t_e(x) = sum of c * s2^k x^(e - 2k) over (k, c)
_HERMITE = (((0, 1.0),), ((0, 1.0),), ((0, 1.0), (1, -1.0)), ((0, 1.0), (1, -3.0)), ((0, 1.0), (1, -6.0), (2, 3.0)))
_LARGEST = 0.6  # noise, in units of the readings' rms radius, beyond which there is nothing to fit


def _tables() -> tuple[list[tuple[int, ...]], np.ndarray]:
    """The 35 moments, and the (3, 10, 10, 35) coefficients of Psi = Psi0 + s2 Psi1 + s2^2 Psi2 in them."""
    orders = [e for e in itertools.product(range(5), repeat=3) if sum(e) <= 4]
    where = {e: i for i, e in enumerate(orders)}
    table = np.zeros((3, 10, 10, len(orders)))
    for (j, first), (k, second) in itertools.product(enumerate(_EXPONENTS), repeat=2):
        total = tuple(a + b for a, b in zip(first, second, strict=True))
        for terms in itertools.product(*(_HERMITE[e] for e in total)):
            power = sum(k for k, _ in terms)
            moment = tuple(e - 2 * k for e, (k, _) in zip(total, terms, strict=True))
            table[power, j, k, where[moment]] += np.prod([c for _, c in terms])
    return orders, table


ORDERS, _TABLE = _tables()
_PRODUCTS = [tuple(a + b for a, b in zip(*pair, strict=True)) for pair in itertools.product(_EXPONENTS, repeat=2)]
#: where each moment stands among the products of the ten monomials
_PLACES = [_PRODUCTS.index(order) for order in ORDERS]


def adjusted(u: np.ndarray) -> np.ndarray:
    """Psi0, Psi1 and Psi2 of centred and scaled readings, per reading, (3, 10, 10)."""
    # a product of two monomials is one of up to fourth order, and all of those are such products
    columns = np.concatenate(monomials(u), axis=1)
    return psi_of((columns.T @ columns).ravel()[_PLACES] / len(u))


def psi_of(moments: np.ndarray) -> np.ndarray:
    """Psi0, Psi1 and Psi2 from the mean moments in the order of `ORDERS`, (3, 10, 10)."""
    return _TABLE @ moments


def consistent(u: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Shape matrix, centre and noise (units of u) at the smallest noise that makes Psi singular.

    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177; V. Renaudin, M. H. Afzal and G. Lachapelle,
    J. Sensors 2010, 967245.
    """
    return null_of(adjusted(u))


def null_of(psi: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """The same from Psi0, Psi1 and Psi2."""

    def least(s2: float) -> float:
        return float(np.linalg.eigvalsh(psi[0] + s2 * (psi[1] + s2 * psi[2]))[0])

    s2 = 0.0
    if least(0.0) > 1e-14:  # else the readings are exact
        low, high = 0.0, 0.02**2
        while least(high) > 0:
            low, high = high, 1.69 * high
            if high > _LARGEST**2:
                raise NotEllipsoid(NOT_ELLIPSOID.format("quadric hidden in noise"))
        s2 = float(scipy.optimize.brentq(least, low, high, xtol=1e-16))  # type: ignore[arg-type]
    theta = np.linalg.eigh(psi[0] + s2 * (psi[1] + s2 * psi[2]))[1][:, 0]
    return *ellipsoid_of(theta), float(np.sqrt(s2))
