"""`Deviation`: a time-domain statistic with its uncertainty."""

import dataclasses
import functools
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._answer import Curve, Finding, Number
from .._answer._curves import SENSORS, Curved, Curves, Labelled, at_decades, labelled
from .._types import AnyArray
from ._kinds import Kind
from ._uncertainty._edf import interval_factors


class Deviation(Curved):
    """A time-domain deviation at several cluster sizes, with chi-square intervals.

    The first axis of every array is the cluster size; arrays of a record with channels have a second axis.

    Attributes
    ----------
    tau : (clusters,) cluster time in s.
    m : (clusters,) cluster size in samples.
    deviation : (clusters,) or (clusters, channels), in the unit of the record (tdev, mtie, tierms: that unit times s).
    lower, upper : limits of the interval at level `confidence`, same shape and unit as `deviation`.
    edf : equivalent degrees of freedom of the variance, same shape; fewer where the noise is uneven in time.
    count : number of differences averaged, same shape; less than the full number if gaps were left out.
    alpha : noise type identified at each cluster size (2 white phase or quantisation, 1 flicker phase, 0 white rate, -1 flicker rate, -2
        random walk of rate), same shape. With fewer than 30 averages, edf and limits use the redder of this type and the last one
        identified before.
    kind : name of the statistic.
    rate : sampling rate in Hz.
    confidence : level of the interval.
    skipped : number of differences left out because they touch a gap, same shape as `count`.
    findings : on cluster sizes or parts of the record that were left out.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> found = jaxcal.allan.deviation(y, 100.0, m=[1, 10])
    >>> print(found)
    Deviation: good: oadev from 0.01 to 0.1 s
    <BLANKLINE>
    oadev
    at 0.01 s   unit   0.974 ± 0.048
    at 0.1 s    unit   0.317 ± 0.038
    floor       unit   < 0.36
    floor at    s      0.1
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
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    _figure, _value = ("allan", False), "deviation"

    @property
    def headline(self) -> str:
        """Statistic and range of cluster times."""
        return f"{self.kind} from {np.min(self.tau):.4g} to {np.max(self.tau):.4g} s"

    @property
    def unit_of_phase(self) -> bool:
        """Whether the deviation is in the unit of the record times s."""
        return self.kind in ("tdev", "mtie", "tierms")

    @property
    def _title(self) -> str:
        return self.kind

    def _quantity(self, name: str) -> str:
        sensor, phase = name.partition("_")[0], self.unit_of_phase
        if sensor == "clock":
            return "time" if phase else "ratio"
        return f"{'Q' if phase else 'B'}.{sensor}" if sensor in SENSORS else "unit s" if phase else "unit"

    def _numbers(self, name: str) -> Labelled:
        """The deviation with its 95 % interval at powers of ten of the cluster time, and the floor of the curve."""
        order, quantity, prefix = np.argsort(self.tau, kind="stable"), self._quantity(name), f"{name}." * bool(name)
        curves = (self.tau, self.deviation, self.lower, self.upper)
        tau, value, low, high = (np.asarray(curve, dtype=float)[order] for curve in curves)
        if self.confidence != 0.95:
            low, high = (value * factor for factor in interval_factors(np.asarray(self.edf)[order], 0.95))
        known = {
            x: Number(f"{prefix}{self.kind}({x:g} s)", middle, least, most, quantity)
            for x, (middle, least, most) in at_decades(tau, value, low, high).items()
        }
        main, more = labelled(known, "at {:g} s")
        if np.isfinite(high).any():
            # where the upper limit is lowest, so that a poorly known end of the curve is no floor
            i = int(np.nanargmin(high))
            # unless the curve rises again, the floor is below all that was measured
            rises = bool(np.any(low[i + 1 :] > value[i]))
            main["floor"] = Number(f"{prefix}floor", value[i], low[i], high[i], quantity, "estimated" if rises else "limit")
            main["floor at"] = Number(f"{prefix}floor_tau", tau[i], quantity="time")
        return main, more

    def _drawn(self, name: str) -> Curve:
        known = {"tau": "time"} | dict.fromkeys(("deviation", "lower", "upper"), self._quantity(name))
        names = ("tau", "m", "deviation", "lower", "upper", "edf", "count", "alpha", "skipped")
        columns = {column: (known.get(column, "ratio"), getattr(self, column)) for column in names}
        return Curve(name or "curve", f"{self.kind} of {name}" if name else self.kind, columns)


class Deviations(Curves[Deviation]):
    """Deviations of the channels of a log: channel -> `Deviation`. The sensor that a name begins with tells the unit.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal((10_000, 2))
    >>> found = jaxcal.allan.deviation(1e-4 * y, 100.0)
    >>> print(jaxcal.allan.Deviations({"gyro_x": found.channel(0), "gyro_y": found.channel(1)}))
    Deviations: good: 2 channels, oadev from 0.01 to 50 s
    <BLANKLINE>
    gyroscope           x             y
    at 1 s      deg/h   2.23 ± 0.26   2.02 ± 0.23
    at 10 s     deg/h   0.63 ± 0.28   0.62 ± 0.28
    floor       deg/h   < 0.89        < 0.51
    floor at    s       27.21         31.68
    """

    _figure = ("allan", False)


Deviation._several = Deviations


def assembled(kind: Kind, rate: float, m, deviation, factors, count, alpha, skipped, confidence: float, findings, flat: bool) -> Deviation:
    """The result from arrays (clusters, channels), with a single channel if `flat`; `factors` are edf and factors of the limits.

    It is built from its tree structure, in a tenth of the time of `__init__`, which would be a large part of a call with a short record.
    """
    edf, low, high = factors
    arrays = (deviation, deviation * low, deviation * high, edf, count, alpha, skipped)
    arrays = [array[:, 0] for array in arrays] if flat else arrays
    return jax.tree.unflatten(_structure(kind.name, rate, confidence, findings), [m / rate, m, *arrays])


@functools.lru_cache(maxsize=256)
def _structure(kind: str, rate: float, confidence: float, findings: tuple[Finding, ...]) -> Any:
    names = [field.name for field in dataclasses.fields(Deviation) if not field.metadata.get("static")]
    return jax.tree.structure(
        Deviation(**dict.fromkeys(names, np.zeros(0)), kind=kind, rate=rate, confidence=confidence, findings=findings)
    )
