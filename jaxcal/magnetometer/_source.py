"""Readings of the magnetometer from whatever the caller has."""

import os
from typing import Any

import numpy as np

from .._errors import DataError
from .._log import Log, as_log
from .._message import Message
from .._precision import is_traced, real_numbers


def field_readings(source: Any) -> tuple[Any, Any]:
    """Magnetometer readings (n, 3), from a log or anything else that `jaxcal.read` accepts by name, or an array unchanged.

    Also the specific force at the same times, if the log has it.
    """
    tabular = hasattr(source, "data_vars") or np.ndim(getattr(source, "columns", 0)) == 1
    if not (tabular or isinstance(source, Log | str | os.PathLike | dict)) or len(getattr(source, "columns", ())) == 3:
        if not is_traced(source):
            source = real_numbers(source, "the readings")
            if source.ndim != 2:
                raise DataError(f"The readings have shape {source.shape}; expected (n, 3), one row per reading.", code="bad_shape")
        return source, None
    log = as_log(source)
    if log.mag is None or log.mag.shape[1] != 3:
        raise DataError(Message("the log has no magnetometer of three axes; name its columns with {option.columns:mag=...}"), code="no_mag")
    m = log.usable("mag", keep=("clipped",))
    there = np.isfinite(m).all(axis=1)
    force = log.accel if log.accel is not None and log.accel.shape[1] == 3 else None
    return m[there], None if force is None else force[there]
