"""Checks, averaging to about a second and cleaning of the data for a fit; means in bins of temperature."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._arrays import namespace
from .._errors import DataError
from .._precision import is_traced
from .._types import AnyArray

FINE, COARSE = 0.1, 0.25  # degC: width of bins for curves and for tables
_SECOND = 1.0  # s over which readings are averaged
_WINDOW, _OUTLIER = 21, 6.0  # Hampel filter: window in samples, and limit of outliers in robust standard deviations
_LEAST_RANGE, _LEAST_BINS, _LEAST_SAMPLES = 2.0, 10, 3
_TURN = 0.1  # share of the range by which the temperature must return to end a ramp


class Bins(eqx.Module):
    """Means in bins of temperature.

    Attributes
    ----------
    t, b, count : mean temperature, degC, mean bias and number of samples, all (bins,), in order of temperature.
    error : standard deviation of one sample; 1 if unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import binned
    >>> found = binned(np.array([20.0, 20.04, 20.3]), np.array([1.0, 3.0, 5.0]))
    >>> print(found.count, found.b)
    [2. 1.] [2. 5.]
    """

    t: AnyArray
    b: AnyArray
    count: AnyArray
    error: Any = 1.0


def binned(t: AnyArray, b: AnyArray, width: float = FINE, low: Any = None) -> Bins:
    """Average temperature and bias in bins of `width` degC from `low` (default: the lowest temperature); empty bins are left out.

    If the temperatures are traced, there are as many bins as samples; the unused bins at the end are copies of the last filled bin with
    count 0.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import binned
    >>> print(binned(np.array([20.0, 20.04, 20.3]), np.array([1.0, 3.0, 5.0])).b)
    [2. 5.]
    """
    place = number(t, width, t.min() if low is None else low)
    if not isinstance(place, jax.core.Tracer) and not isinstance(b, jax.core.Tracer):
        count = np.bincount(place)
        there = count > 0
        return Bins(np.bincount(place, t)[there] / count[there], np.bincount(place, b)[there] / count[there], count[there].astype(float))
    known = not isinstance(place, jax.core.Tracer)
    label = np.unique(place, return_inverse=True)[1] if known else jnp.unique(place, return_inverse=True, size=t.size)[1]
    size = int(label.max()) + 1 if known else t.size
    count, *totals = (jax.ops.segment_sum(jnp.asarray(values), label, num_segments=size) for values in (jnp.ones_like(b), t, b))
    last = jnp.minimum(jnp.arange(size), jnp.sum(count > 0) - 1)
    mean_t, mean_b = ((total / jnp.maximum(count, 1))[last] for total in totals)
    return Bins(mean_t, mean_b, count)


def number(t: AnyArray, width: float, low: Any) -> AnyArray:
    """Index of the bin of each temperature."""
    # a temperature on an edge belongs to the upper bin in spite of rounding
    xp = namespace(t)
    return xp.maximum(xp.floor((t - low) / width + 1e-9), 0).astype(int)


class Record(eqx.Module):
    """`t` (degC), `b`, `time` (s, or None) and `ramp` (index of the ramp), all (n,) in time order; warnings and notes of the checks."""

    t: AnyArray
    b: AnyArray
    time: AnyArray | None
    ramp: AnyArray
    warnings: tuple[str, ...] = eqx.field(static=True)
    notes: tuple[str, ...] = eqx.field(static=True)

    @property
    def noise(self) -> float:
        """Standard deviation of the thermometer's white noise, degC, from third differences."""
        third = np.diff(self.t, 3)
        return float(1.4826 * np.median(np.abs(third - np.median(third))) / np.sqrt(20.0)) if len(third) > 10 else 0.0


def record(temperature: Any, bias: Any, time: Any) -> Record:
    """Check, average and clean the data; `DataError` if lengths differ, data are too few, or the temperature hardly changes."""
    if is_traced(temperature, bias, time):
        raise DataError("`fit` decides on the host and cannot be traced; differentiate the model's `curve.value` instead")
    t, b = numbers(temperature, "temperature"), numbers(bias, "bias")
    stamps = None if time is None else numbers(time, "time")
    for name, values in (("bias", b), ("time", stamps)):
        if values is not None and len(values) != len(t):
            raise DataError(
                f"{name} has {len(values)} samples and temperature {len(t)}; give one temperature per sample (interpolate the thermometer)"
            )
    if not len(t):
        raise DataError("the arrays are empty; give the temperatures and the readings of a sensor at rest")
    warnings, notes = [], []
    keep = np.isfinite(t) & np.isfinite(b) & (True if stamps is None else np.isfinite(stamps))
    if not keep.any():
        raise DataError("there is no sample in which temperature and bias are both numbers; all of one of them are NaN")
    if not keep.all():
        lost = len(keep) - np.count_nonzero(keep)
        warnings.append(f"{lost} of {len(keep)} samples ({100 * lost / len(keep):.2g} %) are not numbers and were left out")
    t, b, stamps = t[keep], b[keep], None if stamps is None else stamps[keep]
    if stamps is not None:
        if (np.diff(stamps) <= 0).any():
            raise DataError("time must increase from sample to sample; sort the record by its time")
        t, b, stamps = _averaged(t, b, stamps, notes)
    t, b, stamps = _cleaned(t, b, stamps, notes)
    _check(t, stamps, warnings)
    ramp = ramps(t)
    if len(np.unique(ramp)) == 1:
        word = "rose" if t[-1] > t[0] else "fell"
        warnings.append(
            f"the temperature only {word}, so that an effect of time (warm-up, drift) counts as one of temperature, and hysteresis cannot "
            "be seen; record a second ramp, or the way back to the first temperature"
        )
    return Record(t, b, stamps, ramp, tuple(warnings), tuple(notes))


def numbers(values: Any, name: str) -> AnyArray:
    """Convert values to a float64 array (n,)."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} does not hold numbers ({error}); give an array of shape (n,)") from error
    if array.ndim != 1:
        raise DataError(f"{name} has shape {array.shape}; expected (n,): one channel at a time")
    return array


def _averaged(t: AnyArray, b: AnyArray, time: AnyArray, notes: list[str]) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Average a faster record to means over one second."""
    if len(time) < 3 or np.median(np.diff(time)) > 0.6 * _SECOND:
        return t, b, time
    second = np.floor((time - time[0]) / _SECOND + 1e-9).astype(np.int64)
    count = np.bincount(second)
    there = count > 0
    notes.append(f"averaged from {len(t)} samples to {np.count_nonzero(there)} means over {_SECOND:g} s")
    mean = [np.bincount(second, values)[there] / count[there] for values in (t, b, time)]
    return mean[0], mean[1], mean[2]


def _cleaned(t: AnyArray, b: AnyArray, time: AnyArray | None, notes: list[str]) -> tuple[AnyArray, AnyArray, AnyArray | None]:
    """Remove samples far from the median of their neighbours: F. R. Hampel, J. Am. Stat. Assoc. 69 (1974) 383."""
    good = np.ones(len(t), dtype=bool)
    if len(t) > _WINDOW:
        for values in (t, b):
            window = np.lib.stride_tricks.sliding_window_view(np.pad(values, _WINDOW // 2, mode="edge"), _WINDOW)
            middle = np.median(window, axis=1)
            away = np.abs(values - middle)
            # deviations from the median of each window include the ramp, whose change must not count as an outlier
            spread = 1.4826 * np.median(np.abs(window - middle[:, None]), axis=1)
            good &= away <= _OUTLIER * np.maximum(spread, np.median(spread))
    if not good.all():
        notes.append(f"{len(good) - np.count_nonzero(good)} outliers were left out")
    return t[good], b[good], None if time is None else time[good]


def _check(t: AnyArray, time: AnyArray | None, warnings: list[str]) -> None:
    low, high = float(t.min()), float(t.max())
    if high - low < _LEAST_RANGE:
        what = f"the temperature is constant at {low:.2f} degC" if high == low else f"the temperature covers {low:.2f} to {high:.2f} degC"
        raise DataError(
            f"{what}; a thermal model needs at least {_LEAST_RANGE:g} degC. Warm the sensor or cool it while it rests, over the range in "
            "which it will be used"
        )
    count = binned(t, t).count
    if len(count) < _LEAST_BINS:
        raise DataError(
            f"the samples fill {len(count)} bins of {FINE:g} degC; at least {_LEAST_BINS} are needed: change the temperature more slowly, "
            "or use scale_factor, which takes a few temperatures"
        )
    held = float(np.median(count))
    if held < _LEAST_SAMPLES:
        speed = "" if time is None else f", {60 * np.median(np.abs(np.diff(t) / np.diff(time))):.2g} degC a minute,"
        warnings.append(
            f"the temperature changes so quickly{speed} that a bin of {FINE:g} degC holds {held:.2g} samples; {_LEAST_SAMPLES} are needed "
            "to see a jump: change it more slowly"
        )


def ramps(t: AnyArray) -> AnyArray:
    """Index of the ramp of each sample; a turning point needs a return by a tenth of the range."""
    least = max(_TURN * np.ptp(t), 0.5)
    turns, up, extreme = [], None, 0
    low = high = 0
    for k, value in enumerate(t.tolist()):
        if up is None:
            low, high = (k if value < t[low] else low), (k if value > t[high] else high)
            if t[high] - t[low] >= least:
                up, extreme = high > low, max(high, low)
                if min(high, low) > 0 and abs(t[min(high, low)] - t[0]) >= least:
                    turns.append(min(high, low))
        elif (value > t[extreme]) == up:
            extreme = k if value != t[extreme] else extreme
        elif abs(value - t[extreme]) >= least:
            turns.append(extreme)
            up, extreme = not up, k
    return np.searchsorted(turns, np.arange(len(t)), side="right")
