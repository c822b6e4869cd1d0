"""Stretches of a recording without readings."""

import dataclasses
from collections.abc import Mapping

import numpy as np

from .._answer import Finding
from .._arrays import runs
from .._log_findings import LOG
from .._own_time import far_apart
from .._quality import all_finite
from .._types import AnyArray

#: a sensor present in a smaller share of the samples is slow, not full of gaps
_SPARSE = 0.5


@dataclasses.dataclass(frozen=True)
class Gap:
    """A stretch of missing samples: `start` (s, of the first missing sample), `length` (s), number of lost `samples`."""

    start: float
    length: float
    samples: int


def gaps_of(sensors: dict[str, np.ndarray], offset: Mapping[str, AnyArray], rate: float, found: list[Finding]) -> tuple[Gap, ...]:
    """Stretches in which a sensor is missing; adds a finding on them, and one for each sensor slower than the log.

    A sensor with stamps of its own is missing between two readings only if these are more than 1.5 times as far apart as usual.
    """
    absent = {name: np.any(np.isnan(values), axis=1) for name, values in sensors.items() if not all_finite(values)}
    if not absent:
        return ()
    lost = np.logical_and.reduce(list(absent.values())) if len(absent) == len(sensors) else np.zeros(len(next(iter(absent.values()))), bool)
    rows = len(lost) - np.count_nonzero(lost)
    missing = lost
    for name, gone in absent.items():
        present = (len(gone) - np.count_nonzero(gone)) / rows if rows else 0.0
        if present < _SPARSE:
            found.append(LOG("sparse", name, percent=100 * present, rate=present * rate))
        else:
            missing = missing | (far_apart(gone, np.asarray(offset[name]) * rate) if name in offset else gone)
    if not missing.any():
        return ()
    starts, stops = runs(missing)
    lengths = stops - starts
    gaps = tuple(Gap(start / rate, length / rate, length) for start, length in zip(starts.tolist(), lengths.tolist(), strict=True))
    longest = max(gaps, key=lambda gap: gap.samples)
    facts = {"count": int(lengths.sum()), "total": len(missing), "gaps": len(gaps), "longest": longest.length, "at": longest.start}
    found.append(LOG("gaps", **facts))
    return gaps
