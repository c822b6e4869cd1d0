"""Method "whittle": one channel in, one `NoiseFit` out."""

import dataclasses
from typing import NamedTuple

import numpy as np

from .._errors import DataError, FitError
from .._types import AnyArray
from ..allan import Deviation
from ..spectrum._average import log_groups
from . import _messages
from ._covariance import covariance_tensor
from ._likelihood import density
from ._limits import Limits, levels_of
from ._ordinates import Bins, amplitudes, bins_of, find_lines, stretches
from ._result import NoiseFit, assemble, with_edf
from ._spectral import FILTER, Fitted, attempt, fit_bins, fit_whole, groups_of, scan, uncertainty, without
from ._stationarity import ORDINATES, Unevenness, follows, unevenness, unevenness_of_level
from ._terms import Filter, GaussMarkov, Ramp, Term

_MOST = 0.8  # share of the record that a stretch must have to stand for it
_SHORTEST = 256  # samples of a stretch in parts of which coefficients are compared


class Solved(NamedTuple):
    """A record's bins, which of them lines occupy, and the fit; `columns` are the terms of its columns."""

    bins: Bins
    taken: AnyArray
    fitted: Fitted
    columns: tuple[Term, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(term.name for term in self.columns)

    @property
    def end(self) -> float:
        """Highest frequency of the band in Hz, infinite where the band was not cut."""
        bins = self.fitted.bins
        return float(np.max(np.where(bins.weight > 0, bins.frequency, 0.0))) if bool(self.fitted.cut) else np.inf

    def share(self, term: str, n: int, dt: float):
        """Share of a term in the density at the ordinates of the longest stretch, of n samples, up to the end of the band, 0 in lines.

        And the density.
        """
        bins, index = self.fitted.bins, self.names.index(term)
        count = log_groups(n - 1, keep_tail=True)[1]  # the bins are those of the longest stretch
        there = bins.frequency <= min(self.end, 0.5 / dt)
        model = bins.columns[there] @ self.fitted.theta
        part = np.where(bins.weight[there] > 0, bins.columns[0, index] * self.fitted.theta[index] / model, 0.0)
        return np.repeat(part, count[there]), np.repeat(model * self.bins.unit, count[there])


class Lowest(NamedTuple):
    """The longest gap-free stretch of a record, where it is most of it; its first ordinates per squared coefficient, and in all."""

    part: slice
    columns: AnyArray
    density: AnyArray

    def follows(self, y, regressor, dt: float) -> tuple[float, float]:
        """Coefficient of a regressor in the record and its standard error, infinite where it has gaps."""
        y, regressor = y[self.part], regressor[self.part]
        return follows(y, regressor, self.density, dt) if np.all(np.isfinite(regressor)) else (0.0, np.inf)


def fit_record(
    y, curve: Deviation, terms: tuple[Term, ...], band: tuple[float, float] | None, confidence: float, temperature=None
) -> NoiseFit:
    """Fit one channel, (n,) with NaN for gaps, by its likelihood; its overlapped Allan deviation `curve` serves the plot.

    A Gauss-Markov process without correlation time is given that of the highest likelihood. `band` are cluster times in s, None to
    find them; whether the record follows a `temperature`, (n,), is told.
    """
    dt, n = 1.0 / curve.rate, len(y)
    asked = tuple(term.name for term in terms)
    ramps, sought = (tuple(term for term in terms if kind(term)) for kind in (_is_ramp, _is_sought))
    base = tuple(term for term in terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError(
            f"terms {asked!r}: a ramp, and one Gauss-Markov process without correlation time, are fitted beside other terms; add N"
        )
    solved = _solve(y, dt, base, band)
    lowest = _lowest(y, solved, dt)
    line = slope, error = lowest.follows(y, np.arange(n) * dt, dt) if lowest else (0.0, np.inf)
    if ramps and abs(slope) > _messages.RAMP * error:
        y = y - slope * dt * np.arange(n)
        solved = _solve(y, dt, base, band)
        lowest = _lowest(y, solved, dt)
    warm = lowest.follows(y, temperature, dt) if lowest and temperature is not None else (0.0, np.inf)
    time, beside, instead = scan(solved.fitted, dt, n * dt, np.array([float(name == "B") for name in solved.names]))
    if sought:
        solved = _solve(y, dt, (*base, GaussMarkov(time=float(time[np.argmax(beside)]), name=sought[0].name)), band)
        terms = tuple(solved.columns[-2] if term in sought else term for term in terms)
        lowest = _lowest(y, solved, dt)
    names = solved.names
    uneven = _uneven(y, solved, lowest, dt)
    widened = np.array([max(uneven[name].factor, 1.0) if name in uneven else 1.0 for name in names])
    covariance, limits, factor = uncertainty(solved.fitted, widened, *levels_of(confidence), names)
    if not np.all(np.isfinite(solved.fitted.theta)):
        raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    lines = amplitudes(solved.bins, solved.taken, density(solved.bins.columns, solved.fitted.theta), n * dt)
    lines = [found for found in lines if found[1] <= solved.end]
    used = _used(curve, solved, band)
    fit = assemble(
        *_squares(solved, covariance, limits, asked, line, confidence), terms, curve, n * dt, sinusoid=lines, used=used,
        decides={name: float(factor[names.index(name)]) * n * dt for name in asked if name in names}, confidence=confidence,
        goodness=float(solved.fitted.goodness), method="whittle", band=(float(curve.tau[used].min()), float(curve.tau[used].max())),
    )  # fmt: skip
    left_out = _messages.of_octaves(curve, used, np.sqrt(np.asarray(fit.noise.avar(curve.tau, dt=dt))), band is None)
    inflation, notes, process = float(solved.fitted.inflation), (), []
    if not sought:
        process, notes = _messages.of_process(time, beside, instead, fit.verdict.get("B"))
    where, how = "any band" if band is None else "the band asked for", f"the spectrum scatters {inflation:.1f} times as much as it may"
    unsettled = "the search for the largest likelihood did not converge; fit fewer terms or another band"
    warnings = (
        *curve.warnings,
        *_messages.of_model(fit, "spectrum", bool(solved.fitted.holds), where, how, inflation, bool(solved.fitted.cut)),
        *(() if bool(solved.fitted.settled) else (unsettled,)),
        *_messages.of_record(y, dt, lines, 0.0 if ramps else abs(slope / error), abs(warm[0] / warm[1])),
        *process,
        *_messages.of_unevenness(uneven, n * dt),
    )
    if "markov" in asked:
        # beside the terms proper: `terms` and `covariance` are of these alone
        kept, notes = [i for i, name in enumerate(asked) if name != "markov"], (*notes, _messages.of_markov(fit))
        fit = dataclasses.replace(fit, terms=tuple(asked[i] for i in kept), covariance=fit.covariance[np.ix_(kept, kept)])
    curve = with_edf(curve, used, _model_edf(curve, fit, base, n))
    return dataclasses.replace(fit, deviation=curve, left_out=left_out, warnings=warnings, notes=notes)


def fit_traced(y, rate: float, terms: tuple[Term, ...], band: tuple[float, float] | None, confidence: float) -> NoiseFit:
    """The same for a traced record: no checks, no choice of the band, no lines; differentiable."""
    if any(_is_ramp(term) or _is_sought(term) for term in terms):
        raise DataError("a traced record is fitted without R and markov; these are found by a search, which cannot be traced")
    bins, duration = _inside(bins_of(y, 1.0 / rate, terms), band), y.shape[0] / rate
    fitted = fit_whole(bins, groups_of(bins.weight, y.shape[0] - 1))
    covariance, limits, _ = uncertainty(fitted, np.ones(len(terms)), *levels_of(confidence), tuple(term.name for term in terms))
    return assemble(
        fitted.theta * bins.unit, covariance * bins.unit**2, limits.scaled(bins.unit), terms, None, duration, goodness=fitted.goodness,
        confidence=confidence, method="whittle", used=None, band=(1.0 / rate, duration / 2.0) if band is None else band,
    )  # fmt: skip


def _inside(bins: Bins, band) -> Bins:
    """The bins with weight only in the band: cluster time tau stands for the frequency 1/(2 tau)."""
    if band is None:
        return bins
    within = (bins.frequency >= 0.5 / band[1] * (1 - 1e-9)) & (bins.frequency <= 0.5 / band[0] * (1 + 1e-9))
    return bins._replace(weight=bins.weight * within)


def _is_ramp(term: Term) -> bool:
    return isinstance(term, Ramp)


def _is_sought(term: Term) -> bool:
    """Whether it is a Gauss-Markov process whose correlation time is looked for."""
    return isinstance(term, GaussMarkov) and term.time is None


def _solve(y, dt: float, columns: tuple[Term, ...], band) -> Solved:
    columns = (*columns, Filter())
    whole = bins_of(y, dt, columns)
    bins = _inside(whole, band)
    count = int(np.sum(bins.weight > 0))
    if count <= len(columns):
        raise DataError(
            f"{count} frequency bins are left for {len(columns)} terms; record longer without gaps, widen band=, or ask for fewer terms"
        )
    names = tuple(term.name for term in columns)
    group = groups_of(whole.weight, int(np.sum(whole.weight)))
    plain = without(bins, names, FILTER)
    first = attempt(plain, group)
    taken = find_lines(bins, density(plain.columns, first.theta))
    clear = bins._replace(weight=np.where(taken, 0.0, bins.weight))
    return Solved(bins, taken, fit_bins(clear, group, band is None, names, None if taken.any() else first), columns)


def _lowest(y, solved: Solved, dt: float) -> Lowest | None:
    part = stretches(y)[0]
    n = part.stop - part.start
    if n < _MOST * len(y):
        return None
    k = np.arange(1, min(ORDINATES, n - 1) + 1)
    columns = np.stack([term.ordinates(k, n, dt) for term in solved.columns], axis=1)
    return Lowest(part, columns, columns @ solved.fitted.theta * solved.bins.unit)


def _uneven(y, solved: Solved, lowest: Lowest | None, dt: float) -> dict[str, Unevenness]:
    """How uneven in time B and K are, where either is, and N; not looked at where no gap-free stretch is most of the record."""
    if lowest is None or len(y := y[lowest.part]) < _SHORTEST:
        return {}
    names = solved.names
    found = {term: unevenness(y, lowest.columns[:, names.index(term)], lowest.density, dt) for term in ("B", "K") if term in names}
    found = found if any(term.told for term in found.values()) else {}
    share, level = solved.share("N", len(y), dt) if "N" in names else (np.zeros(1), np.ones(1))
    if np.any(share > 0.0) and (white := unevenness_of_level(y, share, level, dt)).told:
        found["N"] = white
    return found


def _squares(solved: Solved, covariance, limits: Limits, asked: tuple[str, ...], line: tuple[float, float], confidence: float):
    """Squared coefficients in SI in the order of the terms asked for, their covariance and limits.

    The ramp is among them, from the `line` (slope, error); Q is not estimated where its octaves are left out.
    """
    p, names, unit = len(asked), solved.names, float(solved.bins.unit)
    own = [i for i, name in enumerate(names) if name != FILTER]
    where = [asked.index(names[i]) for i in own]
    squares, spread, ends = np.zeros(p), np.zeros((p, p)), np.zeros((len(limits), p))
    squares[where], spread[np.ix_(where, where)] = solved.fitted.theta[own] * unit, covariance[np.ix_(own, own)] * unit**2
    ends[:, where] = limits.scaled(unit)
    if "R" in asked:
        i, (slope, error) = asked.index("R"), line
        squares[i], spread[i, i] = slope**2, (2.0 * slope * error) ** 2
        # a straight line is linear in the record: the slope is normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels_of(confidence))
        ends[:, i] = max(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2, (slope / error) ** 2
    if "Q" in asked and bool(solved.fitted.cut):
        i = asked.index("Q")
        squares[i] = spread[i] = spread[:, i] = ends[[0, 3], i] = 0.0
    return squares, spread, Limits(*ends)


def _used(curve: Deviation, solved: Solved, band) -> np.ndarray:
    """Cluster sizes that the band stands for; at least the longest."""
    used = np.asarray(curve.tau) >= (0.5 / solved.end) * (1 - 1e-9)
    if band is not None:
        used &= (curve.tau >= band[0] * (1 - 1e-9)) & (curve.tau <= band[1] * (1 + 1e-9))
    if not used.any():
        used[-1] = True
    return used


def _model_edf(curve: Deviation, fit: NoiseFit, terms: tuple[Term, ...], n: int):
    """Degrees of freedom of the curve under the fitted terms."""
    dt, squares = 1.0 / curve.rate, np.array([float(np.asarray(fit.noise.coefficient(term.name))) ** 2 for term in terms])
    tensor = np.diagonal(covariance_tensor(n, tuple(int(m) for m in curve.m), dt, terms), axis1=2, axis2=3)
    variance = np.einsum("i,ijm,j->m", squares, tensor, squares)
    modelled = squares @ np.stack([np.asarray(term.avar(curve.tau, dt)) for term in terms])
    return 2.0 * modelled**2 / np.where(variance > 0.0, variance, np.inf)
