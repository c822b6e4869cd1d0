"""`Record` and `Asked`: what a fit is made of and what it is asked for, checked once, where they come in; and findings of these checks."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .._answer import Finding, Quantity
from .._arrays import transposed
from .._errors import DataError
from .._quality import checked_rate, checked_record, refuse_infinite
from ..allan import Deviation
from ..allan._deviation import begin
from ..allan._kinds import find_kind
from ..evidence import bursts
from ..evidence._findings import percent
from ..evidence._values import common_step, first_known
from ._findings import FINDINGS
from ._model import BUILT_IN, checked_terms
from ._sections import QUOTED
from ._terms import Term, is_sought

_AXES = 3  # most channels that are axes of one sensor, which a knock or a warm-up changes together
METHODS = ("whittle", "gls", "log", "slope")
#: number of cluster sizes of a curve; neighbouring values are so strongly correlated that more would add no information
_CLUSTERS = 25
_ALIKE, _FREQUENCIES = 1e-6, 64  # relative difference of two densities that no record shows; number of frequencies compared


@dataclasses.dataclass
class Record:
    """The channels of one sensor, after checks.

    Parameters
    ----------
    y : (n,) or (n, channels) samples; NaN where one is missing.
    names : of the channels.
    temperature : (n,) at the samples; None if it is not known.
    aside : stretches of samples (first, last) to leave out; None if they are to be found.

    Attributes
    ----------
    channels : list of (n,) samples. traced : whether they are traced; only their shape is known then. found : whether what is set aside
        was found here, and was not said elsewhere.
    """

    y: Any
    names: tuple[str, ...] = ()
    temperature: Any = None
    aside: Sequence[tuple[int, int]] | None = None

    def __post_init__(self):
        y = checked_record(self.y)
        self.traced = not isinstance(y, np.ndarray)
        self.found = self.aside is None
        # samples of a channel beside one another: each step on every sixteenth number of a table takes several times as long
        self.channels = list(y.T if self.traced else transposed(y)) if y.ndim == 2 else [y]
        self.names = self.names or (tuple(f"channel {i}" for i in range(y.shape[1])) if y.ndim == 2 else ("",))

    @property
    def sensor(self) -> str:
        """The sensor, if the channels are axes of a known one."""
        return self.names[0].partition("_")[0] if "_" in self.names[0] else ""

    def sensors(self) -> list["Record"]:
        """The record, or one for each channel if it has more of them than a sensor has axes."""
        if len(self.names) <= _AXES or self.traced:
            return [self]
        return [Record(x, (name,), self.temperature, self.aside) for name, x in zip(self.names, self.channels, strict=True)]

    def set_aside(self, rate: float) -> None:
        """Refuse channels that hold no noise, and leave out the stretches in which the sensor is not at rest."""
        for name, x in zip(self.names, self.channels, strict=True):
            low, high = np.fmin.reduce(x), np.fmax.reduce(x)
            if np.isinf(low) or np.isinf(high):
                refuse_infinite(x, name or "the record")
            if low == high:
                why = "Check that the sensor was running and that its resolution is finer than its noise; leave a dead channel out"
                raise DataError(f"every sample is equal: there is no noise to characterise. {why}").of(name)
        y = np.array(self.channels, dtype=float) if len(self.channels) > 1 else np.asarray(self.channels[0], dtype=float)[None]
        self.aside = bursts(y.T, rate) if self.aside is None else self.aside
        y = y.copy() if len(self.aside) else y
        for first, last in self.aside:
            y[:, first:last] = np.nan
        self.channels = list(y)


class Asked(NamedTuple):
    """What a fit is asked for: options of `fit` after checks, cluster sizes, which of them it may use, and the record's length in s."""

    rate: float
    method: str
    terms: tuple[Term, ...]
    confidence: float
    band: Any
    m: np.ndarray
    inside: np.ndarray
    duration: float

    def begin(self, y: Any, end: float | None = None) -> tuple[Callable[[], Deviation], np.ndarray]:
        """Start the Allan deviation of a channel: a function that waits for it, and which cluster sizes the fit may use.

        A fit that gives all of them its own degrees of freedom, up to a frequency `end`, is not told of uneven noise.
        """
        used = self.inside & (self.m / self.rate >= (0.5 / (end or np.inf)) * (1 - 1e-9))
        return begin(y, self.rate, find_kind("oadev"), self.m, self.confidence, None, uneven=not end or not used.all()), used


def checked_call(record: Record, rate: Any, method: str, terms: Any, confidence: float, band: Any) -> Asked:
    """What is asked for, refused if the options do not suit each other or the record."""
    if method not in METHODS:
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(METHODS)}", code="unknown_method")
    terms, rate = checked_terms(terms), checked_rate(rate)
    if method != "whittle" and (record.traced or any(is_sought(term) for term in terms)):
        what = "a traced record" if record.traced else "the correlation time of a Gauss-Markov process"
        raise DataError(f'{what} needs method "whittle"; got {method!r}', code="only_whittle")
    if not 0.0 < confidence < 1.0:
        raise DataError(f"confidence must lie between 0 and 1; got {confidence!r} (0.95 is 95 %)", code="confidence")
    samples = len(record.channels[0])
    _refuse_alike(terms, samples, 1.0 / rate)
    m = clusters(samples, terms)
    if method == "whittle":  # the others are fitted to the curve, whose cluster sizes are their own
        quoted = np.round(np.array(QUOTED) * rate).astype(np.int64)
        m = np.union1d(m, quoted[(quoted >= 1) & (quoted <= samples // 4)])
    return Asked(rate, method, terms, confidence, band, m, inside(m / rate, band, terms), samples / rate)


def clusters(samples: int, terms: Sequence[Any]) -> np.ndarray:
    """Cluster sizes for a fit: about 25 log-spaced, from 1 to a quarter of the record."""
    needed = 4 * (len(terms) + 3)
    if samples < needed:
        more = f"record {needed} or more (an hour or more, for bias instability), or ask for fewer terms"
        raise DataError(
            f"a record of {samples} sample{'s' * (samples != 1)} is too short to fit {len(terms)} noise terms; {more}", code="too_short"
        )
    return np.unique(np.round(np.logspace(0.0, np.log10(samples // 4), _CLUSTERS)).astype(np.int64))


def inside(tau: np.ndarray, band: Any, terms: Sequence[Any]) -> np.ndarray:
    """Whether each cluster time lies in the band asked for."""
    if band is None:
        return np.ones(len(tau), dtype=bool)
    try:
        low, high = (float(edge) for edge in band)
    except (TypeError, ValueError):
        raise DataError(f"band must be (shortest, longest) cluster time in s; got {band!r}", code="band") from None
    within = (tau >= low * (1 - 1e-9)) & (tau <= high * (1 + 1e-9))
    if within.sum() <= len(terms):
        raise DataError(
            f"the band {low:g} s to {high:g} s holds {within.sum()} cluster times, too few for {len(terms)} terms; "
            f"widen it (the record has {tau[0]:g} s to {tau[-1]:g} s) or ask for fewer terms", code="band",
        )  # fmt: skip
    return within


def _refuse_alike(terms: tuple[Term, ...], samples: int, dt: float) -> None:
    """Raise a `DataError` if the densities of two terms have the same shape at all frequencies of a record of so many samples."""
    if all(term.name in BUILT_IN for term in terms):
        return
    f = np.geomspace(0.5 / (samples * dt), 0.5 / dt, _FREQUENCIES)
    with jax.ensure_compile_time_eval():
        shapes = {term.name: np.asarray(term.psd(f, dt)) for term in terms if not is_sought(term)}
    for (one, a), (other, b) in itertools.combinations(shapes.items(), 2):
        if np.all(a > 0.0) and np.all(b > 0.0) and np.ptp(np.log(a / b)) < _ALIKE:
            raise DataError(
                f"the terms {one} and {other} have densities of the same shape in this record, so it cannot tell them apart; leave one out"
            )


def findings_of_checks(y: Any, record: Record, asked: Asked, fit: Any) -> list[Finding]:
    """What was set aside or is missing, and the resolution, where it matters beside the noise."""
    found, aside, n_squared = [], list(record.aside or ()), float(np.asarray(fit.noise.N)) ** 2
    lost = sum(last - first for first, last in aside)
    if lost and record.found:
        share, first = lost / len(y), aside[0][0] / asked.rate
        found += FINDINGS.over("set_aside", share, length=lost / asked.rate, share=percent(share), first=first)
    if gone := int(np.count_nonzero(np.isnan(y))) - lost:
        found.append(FINDINGS("gaps", cost=gone / len(y), share=percent(gone / len(y))))
    steps = np.diff(first_known(y))
    step, white = common_step(np.abs(steps)), float(np.std(steps)) / np.sqrt(2.0)
    share = step**2 / asked.rate / 12.0 / n_squared if n_squared > 0.0 else 0.0
    coarse = FINDINGS.over("coarse", step / white if white else np.inf * step, step=Quantity(step, record.sensor or "ratio"))
    return [*found, *(coarse or FINDINGS.over("rounding", share, share=100 * min(share, 1.0)))]
