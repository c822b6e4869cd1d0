"""Checks of a record that need no noise model: constant values, spikes, steps, and a resolution coarser than the noise."""

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np

from .._answer import Finding, Quantity
from .._errors import DataError
from .._precision import is_traced
from .._quality import checked_rate, refuse_other_than_samples
from ..allan import Deviation, deviation
from ._findings import FINDINGS
from ._model import BUILT_IN, checked_terms
from ._terms import GaussMarkov, Term

METHODS = ("whittle", "gls", "log", "slope")
#: number of cluster sizes of a curve; neighbouring values are so strongly correlated that more would add no information
_CLUSTERS = 25
_SPIKE = 10.0  # robust standard deviations above which a difference between two samples is a spike or a step
_MOST_SPIKES = 1e-3  # share of samples above which spikes are taken as heavy tails of the noise
#: white noise in steps of the readings below which rounding hides it (B. Widrow et al., IEEE Trans. Instrum. Meas. 45, 1996); share of
#: N^2 that rounding must have to be named, 2.5 % of N
_HIDDEN, _ROUNDED = 0.5, 0.05
_SAMPLE = 20_000  # samples from which the resolution is found
_LEVELS = 2_000  # most different values of a record whose resolution can be found
_ALIKE, _FREQUENCIES = 1e-6, 64  # relative difference of two densities that no record shows; number of frequencies compared
_SMALLEST, _LARGEST = 1e-100, 1e100  # smallest and largest range of a record whose squares keep their digits


class Asked(NamedTuple):
    """What a fit of a channel is asked for: options of `fit` after checks, the cluster sizes, and which of these the fit may use."""

    rate: float
    method: str
    terms: tuple[Term, ...]
    confidence: float
    band: Any
    robust: bool
    temperature: Any
    sensor: str
    m: np.ndarray
    inside: np.ndarray

    def deviation(self, y: Any) -> Deviation:
        """The Allan deviation of a channel at the cluster sizes."""
        return deviation(y, self.rate, m=self.m, confidence=self.confidence, alpha=0 if is_traced(y) else None)


def checked_call(
    y: Any, rate: Any, method: str, terms: Any, confidence: float, band: Any, robust: bool, temperature: Any, sensor: str
) -> Asked:
    """What is asked for, refused if the options do not suit each other or the record."""
    refuse_other_than_samples(y)
    if method not in METHODS:
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(METHODS)}", code="unknown_method")
    terms, rate = checked_terms(terms), checked_rate(rate)
    if method != "whittle" and any(isinstance(term, GaussMarkov) and term.time is None for term in terms):
        raise DataError(f'the correlation time of a Gauss-Markov process needs method "whittle"; got {method!r}', code="only_whittle")
    if robust and (is_traced(y) or method != "whittle"):
        raise DataError('a robust fit needs method "whittle", and is made outside of jit, vmap and grad', code="only_whittle")
    if not 0.0 < confidence < 1.0:
        raise DataError(f"confidence must lie between 0 and 1; got {confidence!r} (0.95 is 95 %)", code="confidence")
    samples = len(y) if np.ndim(y) else 0
    _refuse_alike(terms, samples, 1.0 / rate)
    m = clusters(samples, terms)
    return Asked(rate, method, terms, confidence, band, robust, temperature, sensor, m, inside(m / rate, band, terms))


def clusters(samples: int, terms: Sequence[Any]) -> np.ndarray:
    """Cluster sizes for a fit: about 25 log-spaced, from 1 to a quarter of the record."""
    needed = 4 * (len(terms) + 3)
    if samples < needed:
        raise DataError(
            f"{samples} sample{'s are' if samples != 1 else ' is'} too short a record to fit {len(terms)} noise terms; "
            f"record at least {needed} samples (an hour or more, for bias instability), or ask for fewer terms", code="too_short",
        )  # fmt: skip
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


def cleaned(y: Any, robust: bool) -> list["Jumps"]:
    """The channels of a record, without single outliers unless the fit is robust; a traced record as it is."""
    y = y if is_traced(y) else np.asarray(y)
    channels = list(y.T) if y.ndim == 2 else [y]
    if is_traced(y) or y.dtype.kind not in "fiu" or y.ndim not in (1, 2):
        return [Jumps(x) for x in channels]
    _refuse_extremes(y)
    return [Jumps(x) if robust else find_jumps(x) for x in channels]


def _refuse_extremes(y) -> None:
    """Raise a `DataError` if a channel is constant or its squares leave the range of numbers; y is (n,) or (n, channels)."""
    for i, x in enumerate(y.reshape(len(y), -1).T):
        known = x[~np.isnan(x)]
        span = float(np.ptp(known)) if len(known) else 1.0
        where = f"channel {i}" if y.ndim == 2 else "the record"
        if span == 0.0:
            raise DataError(
                f"{where} is constant (every sample equal): there is no noise to characterise. Check that the sensor was running and "
                "that its resolution is finer than its noise; leave a dead channel out"
            )
        if not _SMALLEST < span < _LARGEST and np.isfinite(span):
            raise DataError(
                f"{where} spans {span:.3g}: its squares leave the range of numbers. Give it in SI units (rad/s, m/s^2, T), or rescale it"
            )


def _refuse_alike(terms: tuple[Term, ...], samples: int, dt: float) -> None:
    """Raise a `DataError` if the densities of two terms have the same shape at all frequencies of a record of so many samples."""
    if all(term.name in BUILT_IN for term in terms):
        return
    f = np.geomspace(0.5 / (samples * dt), 0.5 / dt, _FREQUENCIES)
    with jax.ensure_compile_time_eval():
        shapes = {term.name: np.asarray(term.psd(f, dt)) for term in terms if not (isinstance(term, GaussMarkov) and term.time is None)}
    for (one, a), (other, b) in itertools.combinations(shapes.items(), 2):
        if np.all(a > 0.0) and np.all(b > 0.0) and np.ptp(np.log(a / b)) < _ALIKE:
            raise DataError(
                f"the terms {one} and {other} have densities of the same shape in this record, so it cannot tell them apart; leave one out"
            )


class Jumps(NamedTuple):
    """Spikes and steps of a record.

    y : record without spikes. spikes : their number. heavy : whether they are too many to be errors; they are then left in y. steps :
    samples at which a new level starts.
    """

    y: np.ndarray
    spikes: int = 0
    heavy: bool = False
    steps: tuple[int, ...] = ()


def find_jumps(y) -> Jumps:
    """Replace spikes by the mean of their neighbours, and find steps, which stay in the record.

    A difference between neighbouring samples is large if it exceeds 10 robust standard deviations of all differences. A sample between
    two large differences of opposite signs is a spike; every other large difference is a step. If more than one sample in a thousand is
    a spike, the noise has heavy tails and nothing is changed.
    """
    difference = np.diff(y)
    known = np.isfinite(difference)
    finite = difference if known.all() else difference[known]
    spread = 1.4826 * float(np.median(np.abs(finite[:: max(len(finite) // 20_000, 1)]))) if len(finite) >= 8 else 0.0
    large = np.abs(difference) > _SPIKE * spread
    if not spread > 0.0 or not large.any():
        return Jumps(y)
    found = np.flatnonzero(large[1:] & large[:-1] & (difference[1:] * difference[:-1] < 0.0)) + 1
    if len(found) > _MOST_SPIKES * len(y):
        return Jumps(y, len(found), True)
    large[found - 1] = large[found] = False
    if len(found):
        y = y.copy()
        y[found] = 0.5 * (y[found - 1] + y[found + 1])
    return Jumps(y, len(found), False, tuple((np.flatnonzero(large) + 1).tolist()))


def resolution(y) -> tuple[float, float]:
    """Resolution of a record, 0 if its values form no grid, and the standard deviation of its white noise."""
    y = y[: _SAMPLE + 1]
    y = y[np.isfinite(y)]
    values = np.unique(y[: 2 * _LEVELS])
    values = values if len(values) > _LEVELS else np.unique(y)
    white = float(np.std(np.diff(y))) / np.sqrt(2.0)
    if not 2 <= len(values) <= _LEVELS:
        return 0.0, white
    steps = np.diff(values)
    least = float(steps[steps > 1e-9 * np.abs(values).max()].min())
    multiple = steps / least
    on_grid = np.abs(multiple - np.round(multiple)) < 0.02 * np.maximum(multiple, 1.0)
    return (least if on_grid.mean() > 0.95 else 0.0), white


def findings_of_checks(jumps: Jumps, asked: Asked, n_squared: float) -> list[Finding]:
    """Steps, outliers and resolution of a record. `n_squared` is N^2 of the fit."""
    dt, sensor = 1.0 / asked.rate, asked.sensor
    found, many, (step, white) = [], jumps.spikes, resolution(jumps.y)
    if jumps.steps:
        found.append(FINDINGS("jumps", cost=1.0, count=len(jumps.steps), at=jumps.steps[0] * dt))
    if jumps.heavy:
        found.append(FINDINGS("tails", cost=2.0, share=100 * many / len(jumps.y)))
    elif many:
        found.append(FINDINGS("spikes", count=many))
    share = step**2 * dt / 12.0 / n_squared if n_squared > 0.0 else 0.0
    if white < _HIDDEN * step:
        found.append(FINDINGS("coarse", cost=step / white if white else np.inf, step=Quantity(step, sensor or "ratio")))
    elif share > _ROUNDED:
        found.append(FINDINGS("rounding", cost=share, share=100 * min(share, 1.0)))
    return found
