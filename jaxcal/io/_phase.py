"""Convert time integrals (angles, velocities, phase) to rates."""

import numpy as np

from .._errors import DataError
from .._message import Message
from ._findings import READ
from ._table import Signals


def differentiate(signals: Signals) -> None:
    """Convert integrals to rates y_k = (x_(k+1) - x_k) / tau_0 at the time of x_k; missing over a step longer than 1.5 periods."""
    wrong = [name for name in ("mag", "temperature") if name in signals.sensors]
    if wrong:
        said = "{option.data:phase} is for angles and velocities, and there is {wrong} too; leave them out with {option.columns}"
        raise DataError(Message(said, wrong=" and ".join(wrong)), code="phase")
    time, period = signals.time, None if signals.rate is None else 1.0 / signals.rate
    across = np.zeros(0, np.int64)
    if time is not None:
        steps = np.diff(time) / np.timedelta64(1, "s") if time.dtype.kind == "M" else np.diff(time)
        good = steps[np.isfinite(steps) & (steps > 0)]
        if not len(good) or np.any(steps <= 0):
            said = Message("{option.data:phase} needs time stamps that rise from sample to sample; sort the file by time")
            raise DataError(said, code="phase")
        period = float(np.mean(good[good < 1.5 * float(np.median(good))]))
        across = np.flatnonzero(~(steps < 1.5 * period))
        signals.time = time[:-1]
    for name, values in signals.sensors.items():
        signals.sensors[name] = np.diff(values, axis=0) / period
        signals.sensors[name][across] = np.nan
    signals.findings.append(READ("phase"))
