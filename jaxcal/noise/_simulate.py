"""Samples of a noise model: the sum of what its terms generate, each in its own file under `_terms`."""

import math

import numpy as np

from .._errors import DataError
from .._types import Any
from ._terms import Term


def samples(parts: list[tuple[str, Any, Term]], n: int, dt: float, random: np.random.Generator) -> np.ndarray:
    """(n,) samples of terms of one channel, given as (name, coefficient, term)."""
    x = np.zeros(n)
    for _, coefficient, term in parts:
        if coefficient:
            x += float(coefficient) * term.simulate(n, dt, random)
    return x


def checked_sampling(n: Any, rate: Any) -> tuple[int, float]:
    """The number of samples and the sampling interval, once these are in order."""
    if not (isinstance(n, (int, np.integer)) and n >= 1):
        raise DataError(f"n must be a positive whole number of samples; got {n!r}")
    if not (isinstance(rate, (int, float, np.number)) and 0.0 < float(rate) < math.inf):
        raise DataError(f"rate must be positive and finite, in Hz; got {rate!r}")
    return int(n), 1.0 / float(rate)


def checked_resolution(resolution: Any, channels: int) -> np.ndarray:
    """The step of the output, once it is in order."""
    try:
        step = np.asarray(resolution, dtype=float)
    except (TypeError, ValueError):
        step = np.asarray(math.nan)
    if not (np.all(np.isfinite(step)) and np.all(step > 0)) or (step.ndim and step.shape != (channels,)):
        raise DataError(
            f"resolution must be the positive step of the output, or one for each of the {channels} channel"
            f"{'s' if channels > 1 else ''}; got {resolution!r}"
        )
    return step
