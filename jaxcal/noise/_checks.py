"""Checks of a record that need no noise model: constant values, spikes, steps, and a resolution coarser than the noise."""

import itertools
from typing import NamedTuple

import jax
import numpy as np

from .._errors import DataError
from ._model import BUILT_IN
from ._terms import GaussMarkov, Term

_SPIKE = 10.0  # robust standard deviations above which a difference between two samples is a spike or a step
_MOST_SPIKES = 1e-3  # share of samples above which spikes are taken as heavy tails of the noise
_SAMPLE = 20_000  # samples from which the resolution is found
_LEVELS = 2_000  # most different values of a record whose resolution can be found
_ALIKE, _FREQUENCIES = 1e-6, 64  # relative difference of two densities that no record shows; number of frequencies compared
_SMALLEST, _LARGEST = 1e-100, 1e100  # smallest and largest range of a record whose squares keep their digits


def refuse_extremes(y) -> None:
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


def refuse_alike(terms: tuple[Term, ...], samples: int, dt: float) -> None:
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


def sentences_of_checks(jumps: Jumps, step: float, white: float, dt: float, n_squared: float) -> list[str]:
    """Warnings about steps, spikes and resolution. `n_squared` is N^2 of the fit."""
    said, spikes, steps = [], jumps.spikes, list(jumps.steps)
    if steps:
        many = f"{len(steps)} steps" if len(steps) > 1 else "a step"
        said.append(
            f"{many} of more than ten standard deviations of the differences between samples, the first at {steps[0] * dt:.4g} s: K "
            "takes part of it; leave out what was not at rest"
        )
    if jumps.heavy:
        said.append(
            f"{spikes} samples stand out from their neighbours by ten standard deviations, too many for single errors: the noise has heavy "
            "tails, and the interval of N is too narrow; ask for a robust fit"
        )
    elif spikes:
        said.append(
            f"{spikes} single sample{'s' if spikes > 1 else ''} stood out by ten standard deviations; set to the mean of the neighbours"
        )
    if step > 0.0 and white < 0.5 * step:
        said.append(
            f"the values come in steps of {step:.3g}, more than twice the noise ({white:.3g}): it is not seen through the rounding, and no "
            "coefficient of this record is to be relied on; use a finer resolution"
        )
    elif step > 0.0 and n_squared > 0.0 and step**2 * dt / 12.0 > 0.05 * n_squared:
        share = step**2 * dt / 12.0 / n_squared
        said.append(f"rounding to steps of {step:.3g} makes {100 * min(share, 1.0):.0f} % of N squared; the sensor itself is quieter")
    return said
