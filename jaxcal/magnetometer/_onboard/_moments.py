"""`Moments`: what a fit needs of any number of readings, in 35 numbers."""

import math
from typing import Any

import equinox as eqx
import numpy as np

from ..._errors import DataError
from ..._types import AnyArray
from .._design._heading_error import root
from .._ellipsoid._algebraic import NotEllipsoid, ellipsoid_of
from .._ellipsoid._consistent import ORDERS, null_of, psi_of
from .._model import MagModel
from .._rotation._align import array


class MomentFit(eqx.Module):
    """A calibration from moments.

    Attributes
    ----------
    model : `MagModel`.
    field : norm of the corrected readings, in the unit of the readings.
    noise : standard deviation of one axis of a reading, in its unit.
    count : number of readings.
    """

    model: MagModel
    field: float
    noise: float
    count: int


class Moments(eqx.Module):
    r"""Sums of all products of readings up to the fourth order: a fixed memory for any number of them.

    .. math:: S_{abc} = \sum x^a y^b z^c,\quad a + b + c \le 4,\qquad (x, y, z) = (m - c_0)/s_0

    Parameters
    ----------
    centre : (3,) c0, near the middle of the readings: the first one, or the last known hard iron.
    scale : s0, near the norm of the field. Both only keep the sums small: what is fitted does not depend on them.
    sums : (35,) the sums in the order of `exponents`; None for no readings.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Moments, body_field, scenario
    >>> m = body_field(scenario("all"), 50.0) + [10.0, -20.0, 30.0]
    >>> moments = Moments(m[0], 50.0)
    >>> for part in np.array_split(m, 4):
    ...     moments = moments.update(part)
    >>> print(moments.fit().model.hard_iron.round(6), moments.count)
    [ 10. -20.  30.] 360

    References
    ----------
    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177: the consistent fit needs no more than these.
    """

    centre: AnyArray
    scale: float
    sums: AnyArray

    def __init__(self, centre: Any, scale: float | int, sums: Any = None):
        self.centre = np.asarray(centre, dtype=np.float64)
        self.scale = float(scale)
        self.sums = np.zeros(len(ORDERS)) if sums is None else np.asarray(sums, dtype=np.float64)
        if self.centre.shape != (3,) or not self.scale > 0 or self.sums.shape != (len(ORDERS),):
            raise DataError(f"Moments need a centre (3,), a positive scale and {len(ORDERS)} sums; got {self.sums.shape} sums.")

    @property
    def exponents(self) -> tuple[tuple[int, ...], ...]:
        """(a, b, c) of each sum."""
        return tuple(ORDERS)

    @property
    def count(self) -> int:
        """Number of readings."""
        return round(float(self.sums[0]))

    def update(self, m: Any) -> "Moments":
        """With the readings (n, 3) added."""
        m = array(m, "readings")
        if not np.isfinite(m).all():
            raise DataError("A reading is not finite; leave it out.")
        powers = ((m - self.centre) / self.scale)[:, :, None] ** np.arange(5)
        sums = [np.sum(powers[:, 0, a] * powers[:, 1, b] * powers[:, 2, c]) for a, b, c in ORDERS]
        return Moments(self.centre, self.scale, self.sums + np.array(sums))

    def merge(self, other: "Moments") -> "Moments":
        """With the readings of `other`, whatever its centre and scale."""
        return Moments(self.centre, self.scale, self.sums + other.moved(self.centre, self.scale).sums)

    def moved(self, centre: Any, scale: float | int) -> "Moments":
        """The same sums about another centre and scale, by the binomial formula."""
        shift = (self.centre - np.asarray(centre)) / self.scale
        where = {order: i for i, order in enumerate(ORDERS)}
        sums = np.zeros(len(ORDERS))
        for i, (a, b, c) in enumerate(ORDERS):
            for p in range(a + 1):
                for q in range(b + 1):
                    for r in range(c + 1):
                        ways = math.comb(a, p) * math.comb(b, q) * math.comb(c, r)
                        drift = shift[0] ** (a - p) * shift[1] ** (b - q) * shift[2] ** (c - r)
                        sums[i] += ways * drift * self.sums[where[p, q, r]]
            sums[i] *= (self.scale / scale) ** (a + b + c)
        return Moments(centre, scale, sums)

    def fit(self, method: str = "consistent", *, field: float | int | None = None) -> MomentFit:
        """Hard and soft iron, as `fit` gives them with these methods.

        Parameters
        ----------
        method : "consistent" (no noise bias) or "algebraic" (trace constraint).
        field : norm of the true field; None keeps the mean size of the readings.

        Raises
        ------
        DataError
            If there are fewer than 10 readings, no such method, or the moments are those of no ellipsoid.
        """
        if method not in ("consistent", "algebraic"):
            raise DataError(f"There is no method {method!r} for moments; known are 'consistent' and 'algebraic'.")
        if self.count < 10:
            raise DataError(f"There are {self.count} readings; soft iron needs at least 10.")
        where = {order: i for i, order in enumerate(ORDERS)}
        mean = np.array([self.sums[where[order]] for order in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]) / self.count
        second = sum(self.sums[where[order]] for order in ((2, 0, 0), (0, 2, 0), (0, 0, 2))) / self.count
        spread = float(np.sqrt(max(second - mean @ mean, 0.0)))
        if not spread > 1e-9:
            raise DataError("All readings are the same.")
        own = self.moved(self.centre + self.scale * mean, self.scale * spread)
        psi = psi_of(np.asarray(own.sums) / own.count)
        try:
            if method == "consistent":
                shape, centre, noise = null_of(psi)
            else:
                trace = np.zeros(10)
                trace[[0, 2, 5]] = 1.0
                theta = np.linalg.lstsq(psi[0], trace, rcond=1e-14)[0]
                shape, centre = ellipsoid_of(theta)
                # algebraic residual over the gradient's mean square
                gradient = 4 * np.mean(np.linalg.eigvalsh(shape))
                scaled = theta / (theta @ trace) * np.trace(shape)
                noise = float(np.sqrt(max(scaled @ psi[0] @ scaled, 0.0) / gradient))
        except NotEllipsoid as error:
            raise DataError(str(error)) from error
        matrix = root(shape) / own.scale
        radius = np.linalg.det(matrix) ** (-1 / 3)
        size = radius if field is None else float(field)
        model = MagModel(np.linalg.inv(matrix * size), np.asarray(own.centre) + own.scale * centre)
        return MomentFit(model, float(size), noise * own.scale, self.count)
