"""What a record and its sampling rate must be, wherever one is handed over as an array."""

from typing import Any

import jax.numpy as jnp
import numpy as np

from ._errors import DataError
from ._precision import is_traced


def checked_rate(rate: Any) -> float:
    """The sampling rate as a positive number, in Hz."""
    try:
        value = float(rate)
    except (TypeError, ValueError):
        raise DataError(f"rate must be a number in Hz; got {rate!r}") from None
    if not (np.isfinite(value) and value > 0):
        raise DataError(f"rate must be positive and finite, in Hz; got {value!r}")
    return value


def checked_confidence(confidence: Any) -> Any:
    """The level of an interval."""
    if not 0.0 < confidence < 1.0:
        raise DataError(f"confidence must lie between 0 and 1; got {confidence!r} (0.95 is 95 %)")
    return confidence


def checked_whole(name: str, value: Any, least: int) -> int:
    """An option that counts something."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise DataError(f"{name} must be a whole number, at least {least}; got {value!r}")
    return int(value)


def refuse_infinite(column: np.ndarray, name: str, cure: str = "replace them by NaN to mark a gap") -> None:
    """Infinite samples are neither values nor gaps."""
    infinite = np.flatnonzero(np.isinf(column))
    if len(infinite):
        raise DataError(f"{name} has {len(infinite)} infinite values, the first at sample {infinite[0]}; {cure}")


def checked_record(y: Any) -> Any:
    """Samples (n,) or (n, channels), NaN and infinity left to the caller: a JAX array where traced, else NumPy in float64."""
    if is_traced(y):
        if y.ndim not in (1, 2) or 0 in y.shape:
            raise DataError(f"y must be (n,) or (n, channels), time first, and not empty; got shape {y.shape}")
        return jnp.asarray(y)
    y = np.asarray(y)
    if y.dtype.kind not in "fiu":
        raise DataError(f"y must hold real numbers; got dtype {y.dtype}")
    if y.ndim not in (1, 2) or 0 in y.shape:
        raise DataError(f"y must be (n,) or (n, channels), time first, and not empty; got shape {y.shape}")
    if y.ndim == 2 and y.shape[1] > 16 * y.shape[0]:
        raise DataError(f"y has {y.shape[1]} channels of {y.shape[0]} samples; time is the first axis, so transpose it (y.T)")
    return y.astype(np.float64, copy=False)
