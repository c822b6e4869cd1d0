"""Checks of a record and its rate, and missing values."""

import os
from typing import Any

import jax.numpy as jnp
import numpy as np

from ._answer import Finding
from ._errors import DataError
from ._log_findings import LOG
from ._message import Message
from ._precision import LARGEST, is_traced, real_numbers
from ._units import BEYOND, si_unit


def checked_rate(rate: Any) -> float:
    """The sampling rate as a positive number, in Hz."""
    try:
        value = float(rate)
    except (TypeError, ValueError, OverflowError):
        raise DataError(f"rate must be a number in Hz; got {rate!r:.40}", code="rate") from None
    if not 1 / LARGEST < value < LARGEST:
        raise DataError(f"rate must be positive and finite, in Hz; got {value!r}", code="rate")
    return value


def checked_confidence(confidence: Any) -> Any:
    """The level of an interval, checked."""
    if not 0.0 < confidence < 1.0:
        raise DataError(f"confidence must lie between 0 and 1; got {confidence!r} (0.95 is 95 %)", code="confidence")
    return confidence


def checked_whole(name: str, value: Any, least: int) -> int:
    """An option that is a count, checked."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise DataError(f"{name} must be a whole number, at least {least}; got {value!r}", code="whole")
    return int(value)


def refuse_infinite(column: np.ndarray, name: str, cure: str = "replace them by NaN to mark a gap") -> None:
    """Refuse infinite samples, which are neither values nor gaps."""
    infinite = np.flatnonzero(np.isinf(column))
    if len(infinite):
        raise DataError(f"{name} has {len(infinite)} infinite values, the first at sample {infinite[0]}; {cure}", code="record")


def refuse_other_than_samples(y: Any) -> None:
    """Refuse objects that only contain samples (the name of a file, a log, a dictionary, a dataset), and tell what to give instead."""
    how = "give one sensor and its rate, such as log.gyro and log.rate; jaxcal.noise.characterise takes a whole log"
    if isinstance(y, str | os.PathLike):
        raise DataError(f"y is the name of a file; read it with log = jaxcal.read({os.fspath(y)!r}), and {how}", code="record")
    if hasattr(y, "channels") and hasattr(y, "gyro"):
        raise DataError(f"y is a Log; {how}", code="record")
    if isinstance(y, dict) or hasattr(y, "data_vars"):
        raise DataError(
            f"y is a {type(y).__name__} of several arrays; give one of them, (n,) or (n, channels), and its rate", code="record"
        )


def checked_record(y: Any) -> Any:
    """Samples (n,) or (n, channels): a JAX array if traced, otherwise NumPy in float64. The caller must handle NaN and infinity."""
    refuse_other_than_samples(y)
    traced = is_traced(y)
    y = jnp.asarray(y) if traced else real_numbers(y, "y")
    if y.ndim not in (1, 2) or 0 in y.shape:
        raise DataError(f"y must be (n,) or (n, channels), time first, and not empty; got shape {y.shape}", code="record")
    if not traced and y.ndim == 2 and y.shape[1] > 16 * y.shape[0]:
        raise DataError(
            f"y has {y.shape[1]} channels of {y.shape[0]} samples; time is the first axis, so transpose it (y.T)", code="record"
        )
    return y


def all_finite(values: np.ndarray) -> bool:
    """Whether every value is finite. A finite sum already proves it, in a quarter of the time of checking each value."""
    with np.errstate(over="ignore", invalid="ignore"):
        return bool(np.isfinite(values.sum()) or np.isfinite(values).all())


def mark_missing(sensor: str, names: list[str], values: np.ndarray, found: list[Finding]) -> np.ndarray:
    """Turn infinite values into missing ones (NaN), and refuse a channel without any finite value."""
    if all_finite(values):
        return values
    infinite = np.isinf(values)
    if infinite.any():
        found.append(LOG("infinite", sensor, count=np.count_nonzero(infinite)))
        values = np.where(infinite, np.nan, values)
    empty = [name for name, column in zip(names, values.T, strict=True) if np.isnan(column).all()]
    if empty:
        said = "{names}: no finite value in {count} samples; check the column, or leave the sensor out with {option.columns}"
        raise DataError(Message(said, names=", ".join(empty), count=len(values)), code="no_values")
    return values


def shown_unit(quantity: str, values: np.ndarray) -> str:
    """Unit to print beside readings: the SI unit, or "counts" if the values are larger than the range of any sensor.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._quality import shown_unit
    >>> shown_unit("mag", np.array([47e-6])), shown_unit("mag", np.array([310.0]))
    ('T', 'counts')
    """
    most = BEYOND.get(quantity, np.inf)
    return "counts" if np.fmax.reduce(np.abs(values), axis=None, initial=0.0) > most else si_unit(quantity)
