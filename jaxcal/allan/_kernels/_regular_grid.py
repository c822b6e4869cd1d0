"""Records with unevenly spaced stamps, put on the grid that the statistics need."""

import numpy as np

from ..._answer import Finding
from ..._errors import DataError
from .._findings import FINDINGS


def on_grid(y, time, rate: float) -> tuple[np.ndarray, tuple[Finding, ...]]:
    """The record in steps of 1/rate: each step is the mean of the samples nearest to it, or NaN if there are none.

    Nothing is interpolated: an empty step is a gap, whose differences are left out. `time` holds (n,) ascending stamps in s. For a
    regular recording whose stamps jitter, use `jaxcal.Log`, which counts samples.
    """
    y, time = np.asarray(y, dtype=np.float64), np.asarray(time)
    if time.dtype.kind not in "fiu" or time.shape != y.shape[:1]:
        raise DataError(f"time must hold one stamp in s for each of the {y.shape[0]} samples; got dtype {time.dtype}, shape {time.shape}")
    time = time.astype(np.float64)
    if not np.all(np.isfinite(time)):
        raise DataError(f"time has {int(np.sum(~np.isfinite(time)))} stamps that are not finite; leave these samples out")
    back = np.flatnonzero(np.diff(time) < 0)
    if len(back):
        raise DataError(f"time goes back after sample {back[0]} ({time[back[0]]:g} s to {time[back[0] + 1]:g} s); sort the samples first")
    place = np.round((time - time[0]) * rate)
    steps = place[-1] + 1
    if steps > 100 * len(time):
        raise DataError(
            f"{len(time)} samples over {time[-1] - time[0]:g} s leave most steps of 1/rate = {1 / rate:g} s empty; give the rate in Hz "
            f"at which they come, about {(len(time) - 1) / (time[-1] - time[0]):.3g}, and time in s"
        )
    place = place.astype(np.int64)
    columns = y.reshape(len(y), -1)
    out = np.empty((int(steps), columns.shape[1]))
    for column, values in zip(out.T, columns.T, strict=True):
        there = ~np.isnan(values)
        count = np.bincount(place[there], minlength=len(column))
        total = np.bincount(place[there], values[there], minlength=len(column))
        column[:] = np.where(count > 0, total / np.maximum(count, 1), np.nan)
    filled = len(np.unique(place))
    said = ()
    if filled < len(time) or filled < steps:
        averaged, empty = len(time) - filled, int(steps) - filled
        said = (FINDINGS("regridded", samples=len(time), steps=int(steps), step=1 / rate, averaged=averaged, empty=empty),)
    return out.reshape(-1, *y.shape[1:]), said
