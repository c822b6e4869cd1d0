"""Largest time-interval error: the greatest range of the phase within a window, by doubling tables.

ITU-T G.810, 1996, section II.5; S. Bregni, "Measurement of maximum time interval error for telecommunications clock stability
characterization", IEEE Trans. Instrum. Meas. 45, 1996. The extremes of a window of any length are those of two overlapping
windows whose length is a power of two; the tables of these are doubled on the way through the cluster sizes.
"""

import numpy as np

from ..._types import Float, Int


def ranges(
    theta: Float[np.ndarray, " points"], m: Int[np.ndarray, " clusters"], lost: Int[np.ndarray, " reach"] | None, less: int
) -> tuple[Float[np.ndarray, " clusters"], Int[np.ndarray, " clusters"]]:
    """Greatest range of m + 1 successive phase points, and the number of windows free of gaps.

    Parameters
    ----------
    theta : phase; any number where it is missing.
    m : cluster sizes, ascending.
    lost : running number of missing samples; None without gaps.
    less : 0 where `lost` counts rate samples, 1 where it counts phase points: by so many a window of points reaches further.
    """
    low = high = theta
    length = 1  # points that an entry of the tables spans
    greatest, counts = np.zeros(len(m)), np.zeros(len(m), dtype=np.int64)
    for i, size in enumerate(int(size) for size in m):
        while 2 * length <= size + 1:
            low, high = np.minimum(low[:-length], low[length:]), np.maximum(high[:-length], high[length:])
            length *= 2
        windows, back = len(theta) - size, size + 1 - length
        spread = np.maximum(high[:windows], high[back : back + windows])
        spread -= np.minimum(low[:windows], low[back : back + windows])
        if lost is not None:
            whole = lost[size + less : size + less + windows] == lost[:windows]
            spread = spread[whole]
        counts[i] = len(spread)
        greatest[i] = spread.max(initial=0.0)
    return greatest, counts
