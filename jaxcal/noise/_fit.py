"""`fit`: noise coefficients of a record, and `characterise`: of every channel of a log."""

import itertools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from .._errors import DataError
from .._frozen import replaced
from .._log import LogLike, as_log
from .._message import Message
from .._precision import host_float64
from .._types import Leaf, Numbers, Samples
from ..evidence._find import ranges
from ..evidence._findings import unrest
from ..evidence._values import at_own_rate
from ._axes import findings_of_axes
from ._curvefit import fit_curves
from ._findings import FINDINGS
from ._record import Asked, Record, checked_call, findings_of_checks
from ._result import NoiseFit, NoiseFits, stacked
from ._terms import Term
from ._traced import fit_traced
from ._whittle import fit_axes

_AT_ONCE = 1 << 20  # samples fitted together, at 50 bytes each: more save no time


def fit(
    y: Samples, rate: Leaf, *, method: str = "whittle", terms: Sequence[str | Term] = ("Q", "N", "B", "K"), confidence: float = 0.95,
    band: Numbers | None = None,
) -> NoiseFit:  # fmt: skip
    r"""Noise coefficients of a static record, with intervals.

    All terms are fitted jointly, none negative, in their exact form for samples. The default method maximises the Whittle
    likelihood of the ordinates P_k of the record's DCT-II,

    .. math:: -\ell(\theta) = \frac12\sum_k \Big[\ln S_k + \frac{P_k}{S_k}\Big],\qquad
              S = \frac{Q^2}{dt}s^2 + N^2 + \frac{B^2 dt}{s} + \frac{K^2 dt^2}{s^2},\quad s = 2\sin(\pi f dt)

    which reaches the information that the record holds. Intervals are those of the profile likelihood. The other methods fit
    the overlapped Allan variance sigma^2(tau) = 3Q^2/tau^2 + N^2/tau + (2 ln2/pi)B^2 + K^2 tau/3 + R^2 tau^2/2.

    Knocks, movement and stuck readings are set aside first, in all channels together. The fit leaves out high frequencies (short cluster
    times) at which a filter or a resonance of the sensor bends the spectrum. The rest of that effect is fitted in place of Q, which has the
    same shape. Spectral lines become sinusoids of the model. What changes the mean of the channels (at an instant, a ramp, a warm-up, a
    slow sinusoid, the temperature of a log) is fitted together with the noise, as far as it is likely. If the noise is uneven in time, or
    its spectrum departs from the model, the intervals are wider. The interval of N also holds for slow noise of any other falling
    spectrum; B and K are hints at most if the record clearly has one (`compare` tells which). Each of these is among the findings of the
    result.

    Parameters
    ----------
    y : (n,) or (n, channels) samples in rad/s, m/s^2 or T. NaN marks a gap.
    rate : sampling rate in Hz.
    method : "whittle"; or, on the Allan variance, "gls" (full covariance across tau); or for comparison only, without uncertainty,
        "log" and "slope".
    terms : which of "Q", "N", "B", "K", "R" to fit, and `Term` objects of your own, whose shape parameters stay fixed. With "whittle"
        also "markov", one first-order Gauss-Markov process, whose correlation time is estimated.
    confidence : level of the intervals and upper limits.
    band : (shortest, longest) cluster time in s to fit; for "whittle" frequencies 1/(2 tau), instead of the band found.

    Returns
    -------
    NoiseFit
        Coefficients in SI units, for each channel if y has channels. The coefficients and `covariance` can be differentiated
        with respect to y; intervals have no derivative. A traced record is fitted as it is: nothing is checked or left out.

    Raises
    ------
    DataError
        If the record is constant, too short for the terms, or not finite (NaN apart), if two terms have densities of the same shape, or
        if an option is unknown.
    FitError
        If the fit did not give finite coefficients.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3, K=1e-4).simulate(100_000, rate=100.0, seed=0)
    >>> found = jaxcal.noise.fit(record, rate=100.0)
    >>> low, high = found.interval["N"]
    >>> bool(low < 1e-3 < high), found.presence["N"]
    (True, 'present')

    References
    ----------
    P. Whittle, J. R. Stat. Soc. B 15, 1953. IEEE Std 952-1997, annex C (model); Greenhall and Riley, PTTI 2003 (degrees of
    freedom). Covariance of the Allan variance: `allan_covariance`. Thresholds for a coefficient at its bound: Self
    and Liang, J. Am. Stat. Assoc. 82, 1987.
    """
    fits = _fits(y, (rate, method, terms, confidence, band))
    return stacked(fits) if np.ndim(y) == 2 else fits[0]


@host_float64
def _fits(y: Any, options: tuple[Any, ...]) -> list[NoiseFit]:
    """A fit of each channel."""
    record = Record(y)
    if not record.traced:
        return _of_sensors(record.sensors(), options)
    return [fit_traced(y, checked_call(record, *options)) for y in record.channels]


@host_float64
def _of_sensors(records: Sequence[Record], options: tuple[Any, ...]) -> list[NoiseFit]:
    """A fit of each axis of sensors, all of one length and with equally many axes, in equal parts.

    What is small is computed for all sensors of a part at once. Two threads, one for each part, take longer than one.
    """
    asked = checked_call(records[0], *options)
    samples = len(records) * len(records[0].channels) * len(records[0].channels[0])
    places = np.array_split(np.arange(len(records)), min(-(-samples // _AT_ONCE), len(records)))
    return [fit for part in places for fit in _of_part([records[i] for i in part], asked)]


def _of_part(records: Sequence[Record], asked: Asked) -> list[NoiseFit]:
    """A fit of each axis of sensors; findings of the checks come first."""
    for record in records:
        record.set_aside(asked.rate)
    fits = fit_axes(records, asked) if asked.method == "whittle" else [fit for one in records for fit in fit_curves(one, asked)]
    channels = ((y, record) for record in records for y in record.channels)
    said = [findings_of_checks(*channel, asked, one) for channel, one in zip(channels, fits, strict=True)]
    return [replaced(one, findings=(*first, *one.findings)) for one, first in zip(fits, said, strict=True)]


def characterise(
    log: LogLike, *, rate: float | None = None, method: str = "whittle", terms: Sequence[str | Term] = ("Q", "N", "B", "K"),
    confidence: float | int = 0.95, band: Numbers | None = None, progress: Callable[[int, int, str], None] | None = None,
) -> NoiseFits:  # fmt: skip
    """Noise coefficients of every gyroscope, accelerometer and magnetometer channel of a static log.

    Where the white noise of two axes of a sensor is correlated by more than 5 %, a finding says so; `correlation` gives its covariance.

    Parameters
    ----------
    log : the `Log`, or anything that `jaxcal.read` takes: a path, a data frame, a dataset, a dictionary of arrays.
    rate : sampling rate in Hz, where what is given has no times.
    method, terms, confidence, band : as in `fit`.
    progress : called as progress(done, total, channel) before the channels of sensors that are fitted together, with the first of them,
        and once at the end.

    Returns
    -------
    NoiseFits
        Channel name (gyro_x .. mag_z) -> `NoiseFit`; a notebook shows the tables of all sensors.

    Raises
    ------
    DataError
        As `fit`, naming the channel; or if the log has no sensor channel.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=[1e-4, 1e-4, 2e-4]).simulate(5000, rate=100.0, seed=0)
    >>> fits = jaxcal.noise.characterise(jaxcal.Log(None, gyro=gyro, rate=100.0))
    >>> sorted(fits)
    ['gyro_x', 'gyro_y', 'gyro_z']
    """
    log = as_log(log, rate)
    channels = log.channels()
    temperature = channels.pop("temperature", None)
    if not channels:
        raise DataError(Message("the log has no gyroscope, accelerometer or magnetometer channel; name its columns with {option.columns}"))
    dead = [name for name, x in channels.items() if np.fmin.reduce(x) == np.fmax.reduce(x)]
    if len(dead) == len(channels):
        dead = []  # the fit says why there is no answer
    alike: dict[tuple[float, int, int], list[Record]] = {}  # sensors that are fitted together
    for sensor, group in itertools.groupby(channels, lambda name: name.partition("_")[0]):
        alive = {name: name not in dead for name in group}
        if names := tuple(name for name, one in alive.items() if one):
            values, own = at_own_rate(log.usable(sensor)[:, list(alive.values())], log.rate)
            warmth = temperature if own == log.rate else None  # it is known at the samples of the log
            record = Record(values, names, warmth, ranges(log.evidence, sensor, own))
            alike.setdefault((own, *values.shape), []).append(record)
    report, found = progress or (lambda done, total, name: None), {}
    for (own, *_), records in alike.items():
        report(len(found), len(channels), records[0].names[0])
        fits = iter(_of_sensors(records, (own, method, terms, confidence, band)))
        for record in records:
            axes = dict(zip(record.names, fits, strict=False))
            said, first = findings_of_axes(np.array(record.channels).T, own, axes) if len(axes) > 1 else (), record.names[0]
            found |= axes | {first: replaced(axes[first], findings=(*axes[first].findings, *said))}
    report(len(channels), len(channels), "")
    return NoiseFits(
        {name: found[name] for name in channels if name in found}, [*unrest(log), *(FINDINGS("constant", name) for name in dead)]
    )
