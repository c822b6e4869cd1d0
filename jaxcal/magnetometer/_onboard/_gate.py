"""`Admission`: which readings of a stream are worth adding to `Moments`."""

from typing import Any

import equinox as eqx
import numpy as np

from ..._errors import DataError
from ..._types import AnyArray
from .._rotation._align import array

CELLS, MOST, APART = 96, 32, 0.05


class Admission(eqx.Module):
    r"""Readings that are new, and from all directions alike, in a fixed memory.

    A device that lies still sends the same reading a thousand times, and sums that take them all know that direction alone. The
    direction of m - c0 falls into one of 96 cells, 4 x 4 on each face of a cube. A reading is admitted where its cell has
    admitted fewer than 32, and is at least 0.05 s0 from the last that the cell admitted.

    Parameters
    ----------
    centre : (3,) c0 in the unit of the readings, the last known hard iron; or a first guess, off by less than the field.
    scale : s0, norm of the field in the unit of the readings.
    count : (96,) readings admitted in each cell; None for none.
    last : (96, 3) the last of them, in the unit of the readings.

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
    need no trigonometry on a small processor. `jaxcal.export.write(..., format="c", accumulator=True)` has the same in C.
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
        """The state after the readings (n, 3), in their order, and which of them are admitted, (n,) booleans."""
        m = array(m, "readings")
        if not np.isfinite(m).all():
            raise DataError("A reading is not finite; leave it out.")
        count, last = self.count.copy(), self.last.copy()
        least, kept = (APART * self.scale) ** 2, np.zeros(len(m), dtype=bool)
        for i, (cell, reading) in enumerate(zip(self.cells(m), m, strict=True)):
            if count[cell] < MOST and (count[cell] == 0 or np.sum((reading - last[cell]) ** 2) >= least):
                count[cell] += 1
                last[cell] = reading
                kept[i] = True
        return Admission(self.centre, self.scale, count, last), kept

    def cells(self, m: Any) -> np.ndarray:
        """Cell of each reading (n, 3), (n,): `count` by these shows in which directions readings are still wanted.

        32 times the axis along which m - c0 is largest, 16 more where it is negative there, and 4 x 4 on that face of the cube.
        """
        z = array(m, "readings") - self.centre
        axis = np.argmax(np.abs(z), axis=1)
        row = np.arange(len(z))
        most = z[row, axis]
        size = np.where(most == 0, 1, np.abs(most))
        place = [np.clip(np.floor(2 * (z[row, (axis + k) % 3] / size + 1)).astype(int), 0, 3) for k in (1, 2)]
        return 32 * axis + 16 * (most < 0) + 4 * place[0] + place[1]
