"""Convert time integrals (angles, velocities, phase) to rates."""

import numpy as np

from .._errors import DataError
from .._message import Message
from ._columns import Raw


def differentiate(sensors: Raw, time: np.ndarray | None, rate: float | int | None) -> tuple[Raw, np.ndarray | None]:
    """Rates y_k = (x_(k+1) - x_k) / tau_0 at the time of x_k, and these times; missing over a step longer than 1.5 periods."""
    wrong = [name for name in ("mag", "temperature") if name in sensors]
    if wrong:
        said = "{option.data:phase} is for angles and velocities, and there is {wrong} too; leave them out with {option.columns}"
        raise DataError(Message(said, wrong=" and ".join(wrong)), code="phase")
    period, across = 1.0 if rate is None else 1.0 / rate, np.zeros(0, np.int64)  # without a rate, the log is refused for that
    if time is not None:
        steps = np.diff(time) / np.timedelta64(1, "s") if time.dtype.kind == "M" else np.diff(time)
        good = steps[np.isfinite(steps) & (steps > 0)]
        if not len(good) or np.any(steps <= 0):
            said = Message("{option.data:phase} needs time stamps that rise from sample to sample; sort the file by time")
            raise DataError(said, code="phase")
        period = float(np.mean(good[good < 1.5 * float(np.median(good))]))
        across = np.flatnonzero(~(steps < 1.5 * period))
        time = time[:-1]
    found = {name: [np.diff(np.asarray(column, np.float64)) / period for column in columns] for name, columns in sensors.items()}
    for column in (column for columns in found.values() for column in columns):
        column[across] = np.nan
    return found, time
