"""Calibration on a small processor: `Admission` selects readings that add information; `Moments` sums them up and fits from 35 sums."""

import itertools
import math
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._types import AnyArray
from ._ellipsoid._algebraic import ORDERS, PSI, NotEllipsoid, ellipsoid_of, null_of
from ._ellipsoid._shape import Frame, model_of, radius_of
from ._model import MagModel
from ._rotation._turning import array

CELLS, MOST, APART = 96, 32, 0.05  # cells, readings in each, and share of the field between two readings


def _finite(m: Any) -> np.ndarray:
    m = array(m, "readings")
    if not np.isfinite(m).all():
        raise DataError("A reading is not finite; leave it out.")
    return m


class Admission(eqx.Module):
    r"""Select readings that are new and come from all directions alike, in a fixed amount of memory.

    A device at rest sends the same reading a thousand times, and sums over all of them would know that direction only. The direction of
    m - c0 falls into one of 96 cells, 4 x 4 on each face of a cube. A reading is admitted if its cell has admitted fewer than 32 readings
    and the reading is at least 0.05 s0 away from the last one that the cell admitted.

    Parameters
    ----------
    centre : (3,) c0 in the unit of the readings: the last known hard iron, or a first guess whose error is smaller than the field.
    scale : s0, magnitude of the field in the unit of the readings.
    count : (96,) number of readings admitted in each cell; None means none.
    last : (96, 3) last reading admitted in each cell, in the unit of the readings.

    Raises
    ------
    DataError
        If the centre is not (3,) numbers or the scale is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import Admission, Moments, body_field, scenario
    >>> m = np.concatenate([np.tile([0.0, 0.0, 50.0], (5000, 1)), body_field(scenario("all"), 50.0)])
    >>> admission, new = Admission(np.zeros(3), 50.0).admit(m)
    >>> print(new[:5000].sum(), Moments(np.zeros(3), 50.0).update(m[new]).fit().model.hard_iron.round(6) + 0.0)
    1 [0. 0. 0.]

    References
    ----------
    The rule is that of ArduPilot's compass calibrator (a least distance between samples), with a limit in each direction; the cells
    need no trigonometry on a small processor. `jaxcal.export.write(..., format="c", accumulator=True)` writes the same in C.
    """

    centre: AnyArray
    scale: float
    count: AnyArray
    last: AnyArray

    def __init__(self, centre: Any, scale: float | int, count: Any = None, last: Any = None):
        self.centre = np.asarray(centre, dtype=np.float64)
        self.scale = float(scale)
        self.count = np.zeros(CELLS, dtype=int) if count is None else np.asarray(count, dtype=int)
        self.last = np.zeros((CELLS, 3)) if last is None else np.asarray(last, dtype=np.float64)
        if self.centre.shape != (3,) or not np.isfinite(self.centre).all() or not 0 < self.scale < np.inf:
            raise DataError(f"Admission needs a centre (3,) and a positive scale; got {self.centre.tolist()} and {self.scale:g}.")
        if self.count.shape != (CELLS,) or self.last.shape != (CELLS, 3):
            raise DataError(f"Admission has {CELLS} cells; got counts {self.count.shape} and last readings {self.last.shape}.")

    def admit(self, m: Any) -> tuple["Admission", np.ndarray]:
        """The state after the readings (n, 3) in their order, and whether each was admitted, (n,) booleans."""
        m = _finite(m)
        count, last = self.count.copy(), self.last.copy()
        least, kept = (APART * self.scale) ** 2, np.zeros(len(m), dtype=bool)
        for i, (cell, reading) in enumerate(zip(self.cells(m), m, strict=True)):
            if count[cell] < MOST and (count[cell] == 0 or np.sum((reading - last[cell]) ** 2) >= least):
                count[cell] += 1
                last[cell] = reading
                kept[i] = True
        return Admission(self.centre, self.scale, count, last), kept

    def cells(self, m: Any) -> np.ndarray:
        """Cell of each reading (n, 3), as (n,). With it, `count` shows in which directions readings are still wanted.

        The number is 32 times the axis of the largest entry of m - c0, plus 16 if that is negative, plus the place on the 4 x 4 grid.
        """
        z = array(m, "readings") - self.centre
        axis = np.argmax(np.abs(z), axis=1)
        row = np.arange(len(z))
        most = z[row, axis]
        size = np.where(most == 0, 1, np.abs(most))
        place = [np.clip(np.floor(2 * (z[row, (axis + k) % 3] / size + 1)).astype(int), 0, 3) for k in (1, 2)]
        return 32 * axis + 16 * (most < 0) + 4 * place[0] + place[1]


class MomentFit(eqx.Module):
    """A calibration from moments.

    Attributes
    ----------
    model : `MagModel`.
    field : magnitude of the corrected readings, in the unit of the readings.
    noise : standard deviation of one axis of a reading, in its unit.
    count : number of readings.

    Examples
    --------
    >>> from jaxcal.magnetometer import Moments, body_field, scenario
    >>> m = body_field(scenario("all"), 50.0) + [10.0, -20.0, 30.0]
    >>> found = Moments(m[0], 50.0).update(m).fit()
    >>> print(found.model.hard_iron.round(6), found.count)
    [ 10. -20.  30.] 360
    """

    model: MagModel
    field: float
    noise: float
    count: int


class Moments(eqx.Module):
    r"""Sums of all products of readings up to the fourth order; they need the same memory for any number of readings.

    .. math:: S_{abc} = \sum x^a y^b z^c,\quad a + b + c \le 4,\qquad (x, y, z) = (m - c_0)/s_0

    Parameters
    ----------
    centre : (3,) c0, near the middle of the readings: the first one, or the last known hard iron.
    scale : s0, near the magnitude of the field. Centre and scale only keep the sums small; the fit does not depend on them.
    sums : (35,) the sums in the order of `exponents`; None means no readings.

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
    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177: the consistent fit needs only these sums.
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
        """The moments with the readings (n, 3) added."""
        m = _finite(m)
        powers = ((m - self.centre) / self.scale)[:, :, None] ** np.arange(5)
        sums = [np.sum(powers[:, 0, a] * powers[:, 1, b] * powers[:, 2, c]) for a, b, c in ORDERS]
        return Moments(self.centre, self.scale, self.sums + np.array(sums))

    def merge(self, other: "Moments") -> "Moments":
        """The moments with those of `other` added, which may have another centre and scale."""
        return Moments(self.centre, self.scale, self.sums + other.moved(self.centre, self.scale).sums)

    def moved(self, centre: Any, scale: float | int) -> "Moments":
        """The same sums about another centre and scale, by the binomial formula."""
        shift = (self.centre - np.asarray(centre)) / self.scale
        total, sums = dict(zip(ORDERS, self.sums, strict=True)), []
        for order in ORDERS:
            parts = [
                math.prod(math.comb(a, p) * d ** (a - p) for a, p, d in zip(order, part, shift, strict=True)) * total[part]
                for part in itertools.product(*(range(a + 1) for a in order))
            ]
            sums.append(sum(parts) * (self.scale / scale) ** sum(order))
        return Moments(centre, scale, sums)

    def fit(self, method: str = "consistent", *, field: float | int | None = None) -> MomentFit:
        """Hard and soft iron from the moments, the same as `fit` finds with these methods.

        Parameters
        ----------
        method : "consistent" (no noise bias) or "algebraic" (trace constraint).
        field : magnitude of the true field; None keeps the mean size of the readings.

        Raises
        ------
        DataError
            If there are fewer than 10 readings, there is no such method, or the moments belong to no ellipsoid.
        """
        if method not in ("consistent", "algebraic"):
            raise DataError(f"There is no method {method!r} for moments; known are 'consistent' and 'algebraic'.")
        if self.count < 10:
            raise DataError(f"There are {self.count} readings; soft iron needs at least 10.")
        total = dict(zip(ORDERS, self.sums / self.count, strict=True))
        mean = np.array([total[1, 0, 0], total[0, 1, 0], total[0, 0, 1]])
        second = total[2, 0, 0] + total[0, 2, 0] + total[0, 0, 2]
        spread = float(np.sqrt(max(second - mean @ mean, 0.0)))
        if not spread > 1e-9:
            raise DataError("All readings are the same.")
        own = self.moved(self.centre + self.scale * mean, self.scale * spread)
        psi = PSI @ (np.asarray(own.sums) / own.count)
        try:
            if method == "consistent":
                shape, centre, noise = null_of(psi)
            else:
                trace = np.zeros(10)
                trace[[0, 2, 5]] = 1.0
                theta = np.linalg.lstsq(psi[0], trace, rcond=1e-14)[0]
                shape, centre = ellipsoid_of(theta)
                # rms algebraic residual divided by the root mean square gradient
                gradient = 4 * np.mean(np.linalg.eigvalsh(shape))
                scaled = theta / (theta @ trace) * np.trace(shape)
                noise = float(np.sqrt(max(scaled @ psi[0] @ scaled, 0.0) / gradient))
        except NotEllipsoid as error:
            raise DataError(str(error)) from error
        size = radius_of(shape) if field is None else float(field) / own.scale
        model = model_of(shape, centre, Frame(own.centre, own.scale), size)
        return MomentFit(model, float(size * own.scale), noise * own.scale, self.count)
