"""TheoH: the Allan deviation up to a tenth of the record, and beyond it Theo1 scaled to the Allan deviation."""

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import DataError
from ._kinds import cluster_sizes, whole_sizes
from ._result import Deviation

_SHORT = 0.1  # share of the record that the Allan deviation covers
_FEWEST = 30  # smallest number of samples for comparing the two
_JOINED = ("tau", "m", "deviation", "lower", "upper", "edf", "count", "alpha", "skipped", "bias")


def theoh(samples: int, m: Any, plain: Callable[..., Deviation]) -> Deviation:
    """The Allan deviation followed by scaled Theo1; `plain(kind=, m=)` computes one statistic of the record.

    NIST SP 1065, 5.2.16 and 5.2.17. The bias of Theo1 depends on the noise. Its factor is estimated from the record: the mean ratio of the
    Allan variance at 9 + 3 i samples to Theo1 at 12 + 4 i, which have the same cluster time.
    """
    if samples < _FEWEST:
        raise DataError(f"theoh compares Theo1 with the Allan variance: it needs at least {_FEWEST} rate samples; got {samples}")
    last = int(_SHORT * samples)
    short, long = (cluster_sizes(m, kind, samples) for kind in ("oadev", "theo1")) if isinstance(m, str) else (whole_sizes(m),) * 2
    short, long = short[short <= last], long[(0.75 if isinstance(m, str) else 1.0) * long > last]
    parts = [plain(kind="oadev", m=short)] if len(short) else []
    if len(long):
        steps = np.arange(int(samples / 6.0 - 3.0) + 1)
        allan, theo1 = (plain(kind=kind, m=sizes).deviation ** 2 for kind, sizes in (("oadev", 9 + 3 * steps), ("theo1", 12 + 4 * steps)))
        ratio = np.mean(allan / theo1, axis=0)
        found = plain(kind="theo1", m=long)
        level = np.sqrt(ratio)
        values = {name: getattr(found, name) * level for name in ("deviation", "lower", "upper")}
        parts.append(dataclasses.replace(found, **values, bias=found.bias / ratio))
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _JOINED}
    findings = tuple(dict.fromkeys(one for part in parts for one in part.findings))
    return dataclasses.replace(parts[0], **arrays, kind="theoh", findings=findings)
