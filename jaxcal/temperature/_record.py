"""Checks, averaging to about a second and cleaning of the data for a fit; means in bins of temperature."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from .._arrays import namespace
from .._errors import DataError
from .._precision import is_traced, real_numbers
from .._types import AnyArray
from ._findings import FINDINGS

FINE, COARSE = 0.1, 0.25  # degC: width of bins for curves and for tables
_WINDOW, _OUTLIER = 21, 6.0  # Hampel filter: window in samples, and limit of outliers in robust standard deviations
#: least range in degC and number of bins of a record, and samples in a bin without which a jump is not seen
_LEAST_RANGE, _LEAST_BINS, _LEAST_SAMPLES = 2.0, 10, 3


class Bins(eqx.Module):
    """Means in bins of temperature.

    Attributes
    ----------
    t, b, count : mean temperature, degC, mean bias and number of samples, all (bins,), in order of temperature.
    error : standard deviation of one sample; 1 if unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature._record import binned
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
    >>> from jaxcal.temperature._record import binned
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
    """`t` (degC), `b`, `time` (s, or None) and `ramp` (index of the ramp), all (n,) in time order; findings of the checks."""

    t: AnyArray
    b: AnyArray
    time: AnyArray | None
    ramp: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True)

    @property
    def noise(self) -> float:
        """Standard deviation of the thermometer's white noise, degC, from third differences."""
        third = np.diff(self.t, 3)
        return float(1.4826 * np.median(np.abs(third - np.median(third))) / np.sqrt(20.0)) if len(third) > 10 else 0.0


def record(temperature: Any, bias: Any, time: Any) -> Record:
    """Check, average and clean the data; `DataError` if lengths differ, data are too few, or the temperature hardly changes."""
    if is_traced(temperature, bias, time):
        raise DataError("`fit` decides on the host and cannot be traced; differentiate the model's `curve.value` instead", code="traced")
    t, b = numbers(temperature, "temperature"), numbers(bias, "bias")
    stamps = None if time is None else numbers(time, "time")
    for name, values in (("bias", b), ("time", stamps)):
        if values is not None and len(values) != len(t):
            said = f"{name} has {len(values)} samples and temperature {len(t)}; interpolate the thermometer to the samples"
            raise DataError(said, code="lengths")
    known = np.isfinite(t) & np.isfinite(b) & (True if stamps is None else np.isfinite(stamps))
    if not known.any():
        raise DataError("there is no sample in which temperature and bias are both numbers", code="no_numbers")
    t, b, stamps = t[known], b[known], None if stamps is None else stamps[known]
    if stamps is not None:
        if (np.diff(stamps) <= 0).any():
            raise DataError("time must increase from sample to sample; sort the record by its time", code="time_order")
        t, b, stamps = _averaged(t, b, stamps)
    if not b.any():
        raise DataError("the bias is zero in every sample: the channel is dead", code="constant")
    good = _usual(t, b)
    t, b, stamps = t[good], b[good], None if stamps is None else stamps[good]
    findings = _check(t)
    missing, outliers = np.count_nonzero(~known), np.count_nonzero(~good)
    if missing or outliers:
        findings.append(FINDINGS("left_out", missing=missing, total=len(known), outliers=outliers))
    ramp = ramps(t)
    if len(np.unique(ramp)) == 1:
        findings.append(FINDINGS("one_way", moved="rose" if t[-1] > t[0] else "fell"))
    return Record(t, b, stamps, ramp, tuple(findings))


def numbers(values: Any, name: str) -> AnyArray:
    """Convert values to a float64 array (n,)."""
    array = real_numbers(values, name)
    if array.ndim != 1:
        raise DataError(f"{name} has shape {array.shape}; expected (n,): one channel at a time", code="shape")
    return array


def _averaged(t: AnyArray, b: AnyArray, time: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Average a record of more than one sample a second to means over one second."""
    if len(time) < 3 or np.median(np.diff(time)) > 0.6:
        return t, b, time
    second = np.floor(time - time[0] + 1e-9).astype(np.int64)
    count = np.bincount(second)
    there = count > 0
    mean = [np.bincount(second, values)[there] / count[there] for values in (t, b, time)]
    return mean[0], mean[1], mean[2]


def _usual(t: AnyArray, b: AnyArray) -> AnyArray:
    """False for samples far from the median of their neighbours: F. R. Hampel, J. Am. Stat. Assoc. 69 (1974) 383."""
    good = np.ones(len(t), dtype=bool)
    for values in (t, b) if len(t) > _WINDOW else ():
        window = np.lib.stride_tricks.sliding_window_view(np.pad(values, _WINDOW // 2, mode="edge"), _WINDOW)
        middle = np.median(window, axis=1)
        # deviations from the median of each window include the ramp, whose change must not count as an outlier
        spread = 1.4826 * np.median(np.abs(window - middle[:, None]), axis=1)
        good &= np.abs(values - middle) <= _OUTLIER * np.maximum(spread, np.median(spread))
    return good


def _check(t: AnyArray) -> list[Finding]:
    low, high = float(t.min()), float(t.max())
    if high - low < _LEAST_RANGE:
        what = f"the temperature is constant at {low:.2f} degC" if high == low else f"the temperature covers {low:.2f} to {high:.2f} degC"
        raise DataError(f"{what}; warm or cool the resting sensor over its range of use, {_LEAST_RANGE:g} degC at least", code="range")
    count = binned(t, t).count
    if len(count) < _LEAST_BINS:
        raise DataError(f"samples fill {len(count)} bins of {FINE:g} degC, not {_LEAST_BINS}: warm or cool more slowly", code="few_bins")
    held = float(np.median(count))
    return [FINDINGS("quick", bin=FINE, held=held, needed=_LEAST_SAMPLES)] if held < _LEAST_SAMPLES else []


def ramps(t: AnyArray) -> AnyArray:
    """Index of the ramp of each sample; a turning point needs a return by a tenth of the range, and by 0.5 degC."""
    turns = [scipy.signal.find_peaks(sign * t, prominence=max(np.ptp(t) / 10, 0.5))[0] for sign in (1, -1)]
    return np.searchsorted(np.sort(np.concatenate(turns)), np.arange(len(t)), side="right")
