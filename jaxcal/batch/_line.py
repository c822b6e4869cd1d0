"""`line`: drift and change points of a test line, with limits from the population."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Number, Result, Section, listed
from .._errors import DataError
from .._precision import host_float64
from .._special import NORMAL95
from .._types import AnyArray
from ._findings import FINDINGS
from ._population import Population

_FEWEST = 8  # recordings
#: number of random orders from which the limits come, and their seed: the same line always gives the same numbers
_ORDERS, _SEED = 2000, 24


class Line(Result):
    """Changes along a test line, as `line` finds them.

    Attributes
    ----------
    terms : names of the parameters.
    order : (n,) indices of the recordings in order of time.
    score : (n, p) distance of each recording from the middle, in that order, over the root of the summed variances of population and own
        error.
    slope, slope_error : (p,) change over the whole line, of the logarithm for noise, and its standard error.
    chance : (p,) probability that a line without a change has a slope as steep, or a change point as clear, whichever is rarer.
    drift_chance : (p,) probability that it has a slope as steep.
    change : (p,) number of recordings before the most likely change. change_size : (p,) size of that step, in the unit of `slope`.
    change_chance : (p,) probability that a line without a change has a change point as clear anywhere.
    findings : "drift" and "change": what a line without a change shows with a probability below `false_alarm`.
    false_alarm : probability, for each parameter, of finding a drift or a change point in a line without a change.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> sizes = 0.01 * 1.1 ** np.arange(8)
    >>> records = [jaxcal.noise.Noise(N=n).simulate(2000, rate=100.0, seed=i) for i, n in enumerate(sizes)]
    >>> found = jaxcal.batch.population([jaxcal.noise.fit(y, 100.0) for y in records], terms=("N",))
    >>> jaxcal.batch.line(found, range(8)).codes
    frozenset({'drift'})
    """

    terms: tuple[str, ...] = eqx.field(static=True)
    order: AnyArray
    score: AnyArray
    slope: AnyArray
    slope_error: AnyArray
    chance: AnyArray
    drift_chance: AnyArray
    change: AnyArray
    change_size: AnyArray
    change_chance: AnyArray
    false_alarm: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True)

    @property
    def headline(self) -> str:
        """The number of parameters that change."""
        count = len(self.findings)
        return f"{count} of {len(self.terms)} parameters changed" if count else "no drift and no change point"

    def sections(self) -> list[Section]:
        """The drift of each parameter over the line."""
        half = NORMAL95 * np.asarray(self.slope_error)
        pairs = zip(self.terms, np.asarray(self.slope), half, strict=True)
        return [listed("drift", "drift over the line", [(name, Number(name, x, x - h, x + h)) for name, x, h in pairs])]


@host_float64
def line(found: Population, when: Sequence[Any] | AnyArray, *, false_alarm: float = 0.05) -> Line:
    r"""Drift and change points of a test line.

    Each recording is compared with the middle of the population, in standard deviations that combine the population's and the recording's
    own error. Two statistics are computed: the weighted slope over time, and the largest weighted difference of means before and after any
    recording. Each statistic, and the rarer of the two, is compared with its values in 2,000 random orders of the same recordings. The
    limits hold for any distribution of the devices.

    Parameters
    ----------
    found : the population. Its covariates are subtracted first; only the rest is tested.
    when : time of each recording: numbers, or dates of one kind.
    false_alarm : probability of a finding in a parameter of a line without a change.

    Returns
    -------
    Line

    Raises
    ------
    DataError
        If there are fewer than eight recordings, a device has several, or the times differ in number or are all the same.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> sizes = 0.01 * 1.1 ** np.arange(8)
    >>> records = [jaxcal.noise.Noise(N=n).simulate(2000, rate=100.0, seed=i) for i, n in enumerate(sizes)]
    >>> found = jaxcal.batch.population([jaxcal.noise.fit(y, 100.0) for y in records], terms=("N",))
    >>> jaxcal.batch.line(found, range(8)).headline
    '1 of 1 parameters changed'

    References
    ----------
    E. S. Page, Biometrika 41, 1954; permutation limits: J. Antoch and M. Huskova, Stat. Probab. Lett. 53, 2001.
    """
    when = list(when)
    n = len(found.recordings)
    if len(when) != n:
        raise DataError(f"{n} recordings and {len(when)} times; give the time of each recording")
    if n < _FEWEST or len(found.devices) < n:
        raise DataError(
            f"{n} recordings of {len(found.devices)} devices: a line needs {_FEWEST} recordings at least, each of another device, for "
            "recordings of one device move together"
        )
    if not 0.0 < false_alarm < 1.0:
        raise DataError(f"false_alarm must lie between 0 and 1; got {false_alarm!r}")
    order = np.array(sorted(range(n), key=lambda i: when[i]))
    at = np.arange(n) if not np.issubdtype(np.asarray(when).dtype, np.number) else np.asarray(when, dtype=float)[order]
    if not np.ptp(at.astype(float)) > 0.0 or len(set(when)) < 2:
        raise DataError("all times are the same: there is no order; give the time of each recording")
    at = (at - at[0]) / (at[-1] - at[0])
    away = found.away[order]
    variance = found.spread**2 + found.seen_error[order] ** 2
    rng = np.random.default_rng(_SEED)
    orders = np.concatenate([np.arange(n)[None], rng.permuted(np.tile(np.arange(n), (_ORDERS, 1)), axis=1)])
    columns: dict[str, list[Any]] = {name: [] for name in ("slope", "error", "drift", "change", "size", "changed", "chance")}
    for x, weight in zip(away.T, 1.0 / variance.T, strict=True):
        y, w = x[orders], weight[orders]
        middle = np.sum(w * at, axis=1, keepdims=True) / np.sum(w, axis=1, keepdims=True)
        about = at - middle
        precision = np.sum(w * about**2, axis=1)
        slopes = np.sum(w * about * y, axis=1) / precision
        steep = np.abs(slopes) * np.sqrt(precision)
        before, sums = np.cumsum(w, axis=1)[:, :-1], np.cumsum(w * y, axis=1)
        after = np.sum(w, axis=1, keepdims=True) - before
        steps = (sums[:, -1:] - sums[:, :-1]) / after - sums[:, :-1] / before
        clear = np.abs(steps) / np.sqrt(1.0 / before + 1.0 / after)
        best = int(np.argmax(clear[0]))
        drifts, changes = _rarity(steep), _rarity(clear.max(axis=1))
        either = np.minimum(drifts, changes)
        values = (slopes[0], precision[0] ** -0.5, drifts[0], best + 1, steps[0, best], changes[0], np.mean(either <= either[0]))
        for column, value in zip(columns.values(), values, strict=True):
            column.append(value)
    slope, error, drift, change, size, changed, chance = (np.array(column) for column in columns.values())
    said = []
    percent, unit = (100.0, " %") if found.logarithm else (1.0, "")
    for i, term in enumerate(found.terms):
        if not chance[i] < false_alarm:
            continue
        if changed[i] < drift[i]:
            first = found.recordings[order[change[i]]]
            said.append(FINDINGS("change", term=term, size=percent * size[i], unit=unit, first=first, chance=chance[i]))
        else:
            said.append(FINDINGS("drift", term=term, size=percent * slope[i], unit=unit, chance=drift[i]))
    return Line(
        terms=found.terms, order=order, score=away / np.sqrt(variance), slope=slope, slope_error=error, drift_chance=drift, change=change,
        change_size=size, change_chance=changed, chance=chance, findings=tuple(said), false_alarm=false_alarm,
    )  # fmt: skip


def _rarity(values: np.ndarray) -> np.ndarray:
    """For each value, the share of values that are at least as large."""
    return 1.0 - np.searchsorted(np.sort(values), values, side="left") / len(values)
