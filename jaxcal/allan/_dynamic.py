"""`dynamic`: the deviation in windows that move along the record, a surface over time and cluster time."""

from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Curve, Finding, Result, Section
from .._answer._curves import of_channel
from .._errors import DataError
from .._frozen import channel_of, replaced
from .._precision import host_float64, is_traced
from .._quality import checked_confidence, checked_rate, checked_record, refuse_infinite
from .._types import AnyArray
from ._deviation import begin
from ._findings import FINDINGS, times
from ._kinds import cluster_sizes, find_kind
from ._result import Deviation

_KINDS = ("oadev", "ohdev", "mdev", "tdev")
_SURFACES = ("deviation", "lower", "upper", "edf", "count", "alpha")


class DynamicDeviation(Result):
    """A time-domain deviation in windows along the record.

    Attributes
    ----------
    time : (windows,) centres of the windows in s, from the first sample.
    tau : (clusters,) cluster time in s.
    m : (clusters,) cluster size in samples.
    deviation : (windows, clusters) or (windows, clusters, channels), in the unit of the record (tdev: that unit times s). NaN if gaps
        leave no difference in a window, and in a channel without samples; `findings` reports both.
    lower, upper : limits of the interval at level `confidence`, same shape and unit.
    edf : equivalent degrees of freedom of the variance, same shape.
    count : number of differences averaged, same shape.
    alpha : noise type (see `Deviation`), same shape.
    kind : name of the statistic.
    rate : sampling rate in Hz.
    window : length of a window in s.
    confidence : level of the intervals.
    findings : on results that gaps prevent.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> found = jaxcal.allan.dynamic(y, 1.0, window=250.0, m=[1, 10])
    >>> found.deviation.shape, found.time[:2].tolist()
    ((7, 2), [125.0, 250.0])
    """

    time: AnyArray
    tau: AnyArray
    m: AnyArray
    deviation: AnyArray
    lower: AnyArray
    upper: AnyArray
    edf: AnyArray
    count: AnyArray
    alpha: AnyArray
    kind: str = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    window: float = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    _figure = ("dynamic", False)

    @property
    def headline(self) -> str:
        """Statistic, and number and length of the windows."""
        return f"{self.kind} in {len(self.time)} windows of {self.window:g} s"

    def sections(self) -> list[Section]:
        """The surface of each channel: one row for each window and cluster time."""
        many = self.deviation.ndim > 2
        named = {str(i): self.channel(i) for i in range(self.deviation.shape[2])} if many else {"surface": self}
        windows, clusters = self.deviation.shape[:2]
        unit = "unit s" if self.kind == "tdev" else "unit"
        places = {"time": ("time", np.repeat(self.time, clusters)), "tau": ("time", np.tile(self.tau, windows))}
        quantities = {"deviation": unit, "lower": unit, "upper": unit, "edf": "ratio", "count": "ratio", "alpha": "ratio"}
        return [
            Curve(key, self.kind, places | {name: (unit, np.ravel(getattr(one, name))) for name, unit in quantities.items()})
            for key, one in named.items()
        ]

    def channel(self, index: int) -> "DynamicDeviation":
        """The same result for one of several channels."""
        return replaced(channel_of(self, "deviation", index, axes=3), findings=of_channel(self.findings, index))


@host_float64
def dynamic(
    y: Any, rate: Any, *, window: Any, step: Any = None, m: Any = "log", kind: str = "oadev", confidence: float | int = 0.95
) -> DynamicDeviation:
    r"""Dynamic Allan deviation: how the deviation at each cluster time changes along the record.

    .. math:: \sigma^2(p, m) = \frac{1}{2 m^2 (W - 2m + 1)} \sum_{k=p}^{p + W - 2m} (\theta_{k+2m} - 2\theta_{k+m} + \theta_k)^2

    for a window of W samples that begins at p: the result is `deviation` of each window alone.

    Parameters
    ----------
    y : (n,) or (n, channels) rate samples. NaN marks a gap: differences that touch it are left out and counted.
    rate : sampling rate in Hz.
    window : length of the windows in s.
    step : distance between windows in s; half a window by default.
    m : cluster sizes in samples, as for `deviation`, for the length of a window.
    kind : "oadev" (default), "ohdev", "mdev" or "tdev".
    confidence : level of the intervals, 0.95 by default.

    Returns
    -------
    DynamicDeviation
        time and tau in s, deviation and limits in the unit of y.

    Raises
    ------
    DataError
        If y is not a record of finite numbers (apart from NaN), a window or step does not suit it, or an option is unknown.

    Examples
    --------
    Noise that doubles after 200 s:

    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(40_000)
    >>> y[20_000:] *= 2.0
    >>> found = jaxcal.allan.dynamic(y, 100.0, window=100.0, m=[1, 10])
    >>> found.time.tolist()
    [50.0, 100.0, 150.0, 200.0, 250.0, 300.0, 350.0]
    >>> bool(abs(found.deviation[-1, 0] / found.deviation[0, 0] - 2) < 0.05)
    True

    References
    ----------
    L. Galleani and P. Tavella, "The dynamic Allan variance", IEEE Trans. UFFC 56, 2009.
    """
    statistic, rate = find_kind(kind), checked_rate(rate)
    if kind not in _KINDS:
        raise DataError(f"there is no dynamic {kind}; use {', '.join(_KINDS)}", code="kind")
    if is_traced(y):
        raise DataError("dynamic takes a record at hand; use jaxcal.allan.deviation inside jit or grad", code="traced")
    confidence, y = checked_confidence(confidence), checked_record(y)
    width = _in_samples("window", window, rate)
    stride = max(width // 2, 1) if step is None else _in_samples("step", step, rate)
    if width > len(y):
        said = f"the window of {width / rate:g} s is longer than the record of {len(y) / rate:g} s; choose a shorter one"
        raise DataError(said, code="window")
    sizes = cluster_sizes(m, statistic, width)
    starts = np.arange(0, len(y) - width + 1, stride)
    columns = y.reshape(len(y), -1).T
    for c, column in enumerate(columns):
        refuse_infinite(column, f"channel {c}" if y.ndim == 2 else "y")
    # all sums are started before any is waited for
    ready = [[_begun(column[a : a + width], rate, statistic, sizes, confidence) for column in columns] for a in starts.tolist()]
    surfaces = {name: np.full((len(starts), len(sizes), len(columns)), np.nan) for name in _SURFACES}
    surfaces |= {name: np.zeros((len(starts), len(sizes), len(columns)), np.int64) for name in ("count", "alpha")}
    for i, row in enumerate(ready):
        for c, wait in enumerate(row):
            found = wait()
            for name in _SURFACES if found is not None else ():
                surfaces[name][i, np.isin(sizes, found.m), c] = getattr(found, name)
    alive, count = ~np.isnan(columns).all(axis=1), surfaces["count"]
    kept = (count > 0).any(axis=(0, 2))
    if not kept.any():
        gone = int(np.isnan(columns).any(axis=0).sum())
        raise DataError(f"no window has a difference free of gaps: {gone} of {len(y)} samples are missing", code="no_difference")
    findings = [FINDINGS("empty", f"channel {c}") for c in np.flatnonzero(~alive)]
    if not kept.all():
        findings.append(FINDINGS("no_difference", tau=times(sizes[~kept] / rate)))
    empty = (count[:, kept] == 0)[:, :, alive].any(axis=(1, 2))
    if empty.any():
        findings.append(FINDINGS("gaps_in_windows", some=int(empty.sum()), windows=len(starts)))
    arrays = {name: value[:, kept] if y.ndim == 2 else value[:, kept, 0] for name, value in surfaces.items()}
    return DynamicDeviation(
        time=(starts + width / 2) / rate, tau=sizes[kept] / rate, m=sizes[kept], kind=kind, rate=rate, window=width / rate,
        confidence=confidence, findings=tuple(findings), **arrays,
    )  # fmt: skip


def _begun(samples: np.ndarray, *options: Any) -> Any:
    """A function that waits for the deviation of a window; it returns None if gaps leave no difference."""
    ready = None if np.isnan(samples).all() else begin(samples, *options, None)

    def wait() -> Deviation | None:
        try:
            return ready and ready()
        except DataError as error:
            if error.code != "no_difference":
                raise
            return None

    return wait


def _in_samples(name: str, seconds, rate: float) -> int:
    try:
        value = float(seconds)
    except (TypeError, ValueError):
        value = np.nan
    if not (np.isfinite(value) and round(value * rate) >= 1):
        raise DataError(f"{name} must be a length of time in s, at least one sample ({1 / rate:g} s); got {seconds!r}", code=name)
    return round(value * rate)
