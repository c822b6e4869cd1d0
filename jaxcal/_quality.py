"""Checks of a record and its rate, and findings about its values: missing, frozen, clipped, coarse, still warming up."""

import os
from typing import Any

import jax.numpy as jnp
import numpy as np

from ._answer import Finding
from ._errors import DataError
from ._log_findings import LOG
from ._message import Message
from ._precision import is_traced
from ._units import STRONGEST_FIELD, si_unit

#: number of equal vectors in a row that mark a frozen sensor
_FROZEN = 50
#: number of samples examined for the quantisation step
_LOOK = 100_000
_WARM_UP = 60.0

#: SI, beyond the range of any sensor: larger readings are counts
_LARGEST = {"mag": STRONGEST_FIELD, "accel": 4e3, "gyro": 1e3}


def checked_rate(rate: Any) -> float:
    """The sampling rate as a positive number, in Hz."""
    try:
        value = float(rate)
    except (TypeError, ValueError):
        raise DataError(f"rate must be a number in Hz; got {rate!r}", code="rate") from None
    if not (np.isfinite(value) and value > 0):
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
    y = jnp.asarray(y) if traced else np.asarray(y)
    if not traced and y.dtype.kind not in "fiu":
        raise DataError(f"y must hold real numbers; got dtype {y.dtype}", code="record")
    if y.ndim not in (1, 2) or 0 in y.shape:
        raise DataError(f"y must be (n,) or (n, channels), time first, and not empty; got shape {y.shape}", code="record")
    if not traced and y.ndim == 2 and y.shape[1] > 16 * y.shape[0]:
        raise DataError(
            f"y has {y.shape[1]} channels of {y.shape[0]} samples; time is the first axis, so transpose it (y.T)", code="record"
        )
    return y if traced else y.astype(np.float64, copy=False)


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
    most = _LARGEST.get(quantity, np.inf)
    return "counts" if np.fmax.reduce(np.abs(values), axis=None, initial=0.0) > most else si_unit(quantity)


def inspect(sensor: str, names: list[str], values: np.ndarray, rate: float, found: list[Finding]) -> np.ndarray:
    """Examine the values (n, channels) of one sensor on the grid, add findings, and return the values with frozen stretches as NaN."""
    unit = shown_unit(sensor, values)
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    if sensor != "temperature":
        constant = [(name, float(value)) for name, value, top in zip(names, low, high, strict=True) if value == top]
        if constant:
            shown = ", ".join(f"{value:.6g}" for _, value in constant)
            found.append(LOG("constant", (name for name, _ in constant), values=shown, unit=unit))
        _repeated(sensor, values[:_LOOK], rate, found)
        if len(constant) < len(names):
            values = _without_frozen(sensor, values, rate, found)
        for name, column, bottom, top in zip(names, values.T, low, high, strict=True):
            _clipping(name, column, float(bottom), float(top), unit, found)
    _resolution(names, values, unit, found)
    _transient(sensor, values, rate, unit, found)
    return values


def _repeated(sensor: str, values: np.ndarray, rate: float, found: list[Finding]) -> None:
    """Report a sensor that is sampled more slowly than the log, so that most samples repeat the one before.

    Noise below the resolution repeats values as well, but then the axes change one by one, and not all together.
    """
    changed = values[1:] != values[:-1]
    some, every = np.count_nonzero(changed.any(axis=1)), np.count_nonzero(changed.all(axis=1))
    if values.shape[1] < 3 or some < 30 or some > 0.6 * len(changed) or every < 0.7 * some:
        return
    share = (some + 1) / len(values)
    found.append(LOG("repeats", sensor, percent=100 * (1 - share), rate=rate * share))


def _without_frozen(sensor: str, values: np.ndarray, rate: float, found: list[Finding]) -> np.ndarray:
    # a run of more than 50 contains two neighbouring samples of every 25th
    coarse = values[:: _FROZEN // 2]
    if not (coarse[1:] == coarse[:-1]).all(axis=1).any():
        return values
    repeats = np.concatenate([[False], (values[1:] == values[:-1]).all(axis=1), [False]])
    edges = np.flatnonzero(repeats[1:] != repeats[:-1])
    start, stop = edges[::2], edges[1::2]
    runs = stop - start >= _FROZEN
    if not runs.any():
        return values
    start, stop = start[runs], stop[runs]
    lost = int(np.sum(stop - start))
    if len(start) > 3 and lost > 0.2 * len(values):
        distinct = len(values) - np.count_nonzero(repeats)
        found.append(LOG("slow", sensor, percent=100 * lost / len(values), run=_FROZEN, rate=distinct * rate / len(values)))
        return values
    longest = np.argmax(stop - start)
    length, at = float((stop - start)[longest] / rate), float(start[longest] / rate)
    found.append(LOG("frozen", sensor, count=len(start), run=_FROZEN, length=length, at=at, samples=lost))
    values = values.copy()
    for first, last in zip(start, stop, strict=True):
        values[first + 1 : last + 1] = np.nan
    return values


def _clipping(name: str, column: np.ndarray, low: float, high: float, unit: str, found: list[Finding]) -> None:
    """Report clipping: many samples stand at the extreme value, more than three times as many as at the next value."""
    for extreme in (low, high):
        at = np.count_nonzero(column == extreme)
        if at < 10 or low == high:
            continue
        others = column[(column != extreme) & np.isfinite(column)]
        neighbour = others.min() if extreme == low else others.max()
        # a coarse sensor at rest has few levels, and any of them may be frequent
        if abs(neighbour - extreme) < 0.05 * (high - low) and at > 3 * np.count_nonzero(column == neighbour):
            found.append(LOG("clipped", name, count=at, value=extreme, unit=unit))


def _resolution(names: list[str], values: np.ndarray, unit: str, found: list[Finding]) -> None:
    alike: dict[str, list[str]] = {}
    for name, column in zip(names, values[:_LOOK].T, strict=True):
        column = column[np.isfinite(column)]
        steps = np.abs(np.diff(column))
        steps = steps[steps > 0]
        if len(steps) < 10:
            continue
        smallest = steps.min()
        if steps.max() > 1e5 * smallest:
            continue
        counts = steps / smallest
        # multiples of one step, so few that this is no accident
        if np.abs(counts - np.round(counts)).max() < 0.01:
            alike[f"{smallest:.4g}"] = [*alike.get(f"{smallest:.4g}", []), name]
    found += [LOG("steps", of, step=float(step), unit=unit) for step, of in alike.items()]


def _transient(sensor: str, values: np.ndarray, rate: float, unit: str, found: list[Finding]) -> None:
    block = round(_WARM_UP * rate)
    if block < 1 or len(values) < 10 * block:
        return
    blocks = values[: len(values) // block * block].reshape(-1, block, values.shape[1])
    if np.isnan(blocks.sum()):
        present = np.isfinite(blocks)
        with np.errstate(invalid="ignore"):
            means = np.where(present, blocks, 0.0).sum(axis=1) / present.sum(axis=1)
        means = means[np.isfinite(means).all(axis=1)]
    else:
        means = blocks.mean(axis=1)
    if len(means) < 10:
        return
    settled = np.median(means[1:], axis=0)
    scatter = 1.4826 * np.median(np.abs(means[1:] - settled), axis=0)
    moved = np.abs(means[0] - settled)
    if np.any((moved > 6 * scatter) & (scatter > 0)):
        found.append(LOG("warm_up", sensor, length=_WARM_UP, shift=float(moved.max()), unit=unit))
