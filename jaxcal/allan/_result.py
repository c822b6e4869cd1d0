"""`Deviation`: a time-domain statistic with its uncertainty."""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._arrays import namespace
from .._frozen import channel_of
from .._results import Row, Unjudged, columns_of, rows_of
from .._types import AnyArray
from ._kinds import Kind


class Deviation(Unjudged):
    """A time-domain deviation at several cluster sizes, with chi-square intervals.

    The first axis of every array is the cluster size; arrays of a record with channels have a second axis.

    Attributes
    ----------
    tau : (clusters,) cluster time in s.
    m : (clusters,) cluster size in samples.
    deviation : (clusters,) or (clusters, channels), in the unit of the record (tdev, ttotdev, mtie, tierms: that unit times s).
    lower, upper : limits of the interval at level `confidence`, same shape and unit as `deviation`. NaN for mtie and tierms, whose
        intervals are unknown: mtie is an extreme, and both depend on the record's mean.
    edf : equivalent degrees of freedom of the variance, same shape; NaN for mtie and tierms.
    count : number of differences averaged (windows for mtotdev, ttotdev, htotdev and mtie), same shape; less than the full number
        if gaps were left out.
    alpha : noise type identified at each cluster size (2 white phase or quantisation, 1 flicker phase, 0 white rate, -1 flicker rate, -2
        random walk of rate), same shape. With fewer than 30 averages, edf and limits use the redder of this type and the last one
        identified before.
    kind : name of the statistic.
    rate : sampling rate in Hz.
    confidence : level of the interval.
    skipped : number of differences left out because they touch a gap, same shape as `count`.
    warnings : sentences on cluster sizes or parts of the record that were left out.
    bias : factor by which the variance was divided (`bias_corrected`), same shape; ones without correction.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> found = jaxcal.allan.deviation(y, 100.0, m=[1, 10])
    >>> print(found)
    Deviation: good: No warnings.
      oadev at 0.01 s  0.974  0.928 to 1.025  unit
      oadev at 0.1 s   0.317  0.284 to 0.360  unit
    """

    tau: AnyArray
    m: AnyArray
    deviation: AnyArray
    lower: AnyArray
    upper: AnyArray
    edf: AnyArray
    count: AnyArray
    alpha: AnyArray
    skipped: AnyArray
    kind: str = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    bias: AnyArray = None  # type: ignore[assignment]  # ones by default

    def __post_init__(self) -> None:
        if self.bias is None:
            self.bias = namespace(self.deviation, concrete=True).ones_like(self.deviation)

    _figure = ("allan", False)

    def _columns(self) -> dict[str, Any]:
        return columns_of(self, ("tau", "m", "deviation", "lower", "upper", "edf", "count", "alpha", "skipped"))

    def _rows(self) -> list[Row]:
        name, unit = self.kind, "unit s" if self.unit_of_phase else "unit"
        return rows_of(self, "deviation", lambda i: f"{name} at {float(self.tau[i]):.4g} s", unit)

    @property
    def unit_of_phase(self) -> bool:
        """Whether the deviation is in the unit of the record times s."""
        return self.kind in ("tdev", "ttotdev", "mtie", "tierms")

    def channel(self, index: int) -> "Deviation":
        """The same result for one of several channels."""
        return channel_of(self, "deviation", index)


def assembled(
    kind: Kind, rate: float, m, deviation, factors, count, alpha, skipped, bias, confidence: float, warnings, flat: bool
) -> Deviation:
    """The result from arrays (clusters, channels), with a single channel if `flat`; `factors` are edf and factors of the limits.

    It is built from its tree structure, in a tenth of the time of `__init__`, which would be a large part of a call with a short record.
    """
    edf, low, high = factors
    arrays = (deviation, deviation * low, deviation * high, edf, count, alpha, skipped, bias)
    arrays = [array[:, 0] for array in arrays] if flat else arrays
    return jax.tree.unflatten(_structure(kind.name, rate, confidence, warnings), [kind.tau(m, rate), m, *arrays])


@functools.lru_cache(maxsize=256)
def _structure(kind: str, rate: float, confidence: float, warnings: tuple[str, ...]) -> Any:
    names = [field.name for field in dataclasses.fields(Deviation) if not field.metadata.get("static")]
    return jax.tree.structure(
        Deviation(**dict.fromkeys(names, np.zeros(0)), kind=kind, rate=rate, confidence=confidence, warnings=warnings)
    )
