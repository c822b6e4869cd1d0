"""Checks of a record and of the options of a spectrum, with clear error messages."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .. import _quality as quality
from .._answer import Finding
from .._arrays import longest_run
from .._errors import DataError
from .._precision import is_traced
from .._types import Any
from ._average import GROUPS
from ._findings import FINDINGS

METHODS = ("periodogram", "welch", "dct")
_FEWEST = 4  # smallest number of samples


def check_options(method: Any, sided: Any, average: Any, confidence: Any) -> None:
    """Refuse an invalid option."""
    if method not in METHODS:
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(METHODS)}", code="method")
    if sided not in (1, 2):
        raise DataError(f"sided must be 2 (density over both signs of frequency) or 1 (over positive ones); got {sided!r}", code="sided")
    if not (average is None or isinstance(average, str)) or average not in GROUPS:
        raise DataError(f'unknown average {average!r}; expected "octave", "log" or None', code="average")
    quality.checked_confidence(confidence)


def checked_record(y: Any, rate: float) -> Any:
    """Samples (n,) or (n, channels) without gaps; a traced record is checked when it runs."""
    y = quality.checked_record(y)
    if y.shape[0] < _FEWEST:
        raise DataError(f"a spectrum needs at least {_FEWEST} samples; got {y.shape[0]}", code="too_short")
    if is_traced(y):
        y = y if y.dtype.kind == "f" else y.astype(jnp.result_type(float))
        return eqx.error_if(y, ~jnp.all(jnp.isfinite(y)), "y must be finite: a spectrum needs a record without gaps")
    columns = y if y.ndim == 2 else y[:, None]
    for index, column in enumerate(columns.T):
        name = "y" if y.ndim == 1 else f"channel {index}"
        quality.refuse_infinite(column, name, "mend them, or take a stretch without them")
        found = _unfit(columns, column, rate)
        if found is not None:
            raise DataError(found, code=found.code, subject=name)
    return y


def checked_segment(segment: Any, overlap: Any, method: str, samples: int) -> tuple[int, int]:
    """Length of Welch's segments, and the distance between their starts, in samples."""
    if method != "welch":
        if segment is not None:
            raise DataError(f'segment belongs to method="welch"; {method} takes the record as a whole', code="segment")
        return samples, samples
    if segment is None:
        segment = max(1 << max((samples // 8).bit_length() - 1, 0), min(samples, 16))
    if not isinstance(segment, (int, np.integer)) or not _FEWEST <= segment <= samples:
        raise DataError(
            f"segment must be a whole number from {_FEWEST} to {samples}, the length of the record; got {segment!r}", code="segment"
        )
    if not (isinstance(overlap, (int, float, np.number)) and 0.0 <= overlap < 1.0):
        raise DataError(f"overlap must be a part of a segment, from 0 to below 1 (0.5 is half); got {overlap!r}", code="overlap")
    return int(segment), max(int(segment) - int(segment * overlap), 1)


def _unfit(columns: np.ndarray, column: np.ndarray, rate: float) -> Finding | None:
    """Why a column has no spectrum; None if it has one."""
    gone = np.isnan(column)
    if gone.all():
        return FINDINGS("empty")
    if gone.any():
        first, last = longest_run(~np.isnan(columns).any(axis=1))
        if last - first < _FEWEST:
            return FINDINGS("scattered", missing=int(gone.sum()), longest=last - first, least=_FEWEST)
        return FINDINGS("gaps", missing=int(gone.sum()), first=first, last=last, start=first / rate, stop=last / rate)
    return FINDINGS("constant") if column.min() == column.max() else None
