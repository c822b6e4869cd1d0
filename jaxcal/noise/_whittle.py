"""Method "whittle": one channel in, one `NoiseFit` out."""

import dataclasses
from typing import NamedTuple

import numpy as np

from .._errors import DataError, FitError
from .._types import AnyArray
from ..allan import Deviation, deviation
from ..spectrum._average import log_groups
from . import _messages, _rivals as rivals
from ._alternatives import Alternatives, find_alternatives, likeliest_time, widening
from ._causes import find_causes
from ._covariance import covariance_tensor
from ._likelihood import density
from ._limits import Limits, levels_of
from ._observed import Observed
from ._ordinates import Bins, amplitudes, bins_of, find_lines
from ._result import FittedSpectrum, NoiseFit, assemble, with_edf, without_terms
from ._spectral import FILTER, Fitted, attempt, fit_bins, fit_whole, groups_of, uncertainty, without
from ._stationarity import ORDINATES, Level, Unevenness, follows, levels_of_white, unevenness, unevenness_of_level
from ._tails import Tails, tamed
from ._terms import Filter, GaussMarkov, Ramp, Term

_SHORTEST = 256  # samples of a record in parts of which coefficients are compared
_ROUNDS, _SETTLED = 30, 2e-3  # of the likelihood of observed samples, and the relative change of the density that ends them
_ROUGH, _MANY = 2, 100.0  # first rounds, which trust no model above groups of so many ordinates
_MENDED = 0.5  # share of the misfit in the whole band that others than B and K must explain to be tried there
#: likelihood ratio above which what stands in place of B and K is not chance: records of the model reached 15 at most
_SURE = 30.0
_FAST = ("Q", "N", FILTER)  # terms that are known from frequencies at which nothing passes for them


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
    """The first ordinates of a record per squared coefficient, and in all."""

    columns: AnyArray
    density: AnyArray


def fit_record(
    y, curve: Deviation, terms: tuple[Term, ...], band: tuple[float, float] | None, confidence: float, temperature=None, robust=False
) -> NoiseFit:
    """Fit one channel, (n,) with NaN for gaps, by its likelihood; its overlapped Allan deviation `curve` serves the plot.

    Where there are gaps, or causes beside noise are taken out, the curve is formed anew of the record filled and without them. A
    Gauss-Markov process without correlation time is given that of the highest likelihood. `band` are cluster times in s, None to find
    them. `temperature`, (n,), is one of the causes. A `robust` fit is that of the core of the noise.
    """
    dt, n = 1.0 / curve.rate, len(y)
    asked = tuple(term.name for term in terms)
    ramps, sought = (tuple(term for term in terms if kind(term)) for kind in (_is_ramp, _is_sought))
    base = tuple(term for term in terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError(
            f"terms {asked!r}: a ramp, and one Gauss-Markov process without correlation time, are fitted beside other terms; add N"
        )
    tails = tamed(y, dt, lambda x: _spectrum(_solve(Observed(x, dt), base, band))) if robust else Tails(y, "", 1.0)
    y = tails.y
    t, observed, causes = np.arange(n) * dt, Observed(y, dt), ()
    solved = _solve(observed, base, band)
    lowest = _lowest(observed, solved)
    line = slope, error = follows(observed.drawn, t, lowest.density, dt)
    if ramps and abs(slope) > _messages.RAMP * error:
        y = y - slope * t
    elif not sought:
        slow = [name not in _FAST for name in solved.names]
        causes = find_causes(
            observed.drawn, lowest.columns, solved.fitted.theta * solved.bins.unit, slow, dt, _temperature_at(temperature, t)
        )
    if causes or ramps:
        columns = [cause.columns(t) for cause in causes]
        observed = Observed(y, dt, np.concatenate(columns, axis=1) if columns else None)
        solved = _solve(observed, base, band)
        lowest = _lowest(observed, solved)
    # its spectrum is close enough for the degrees of freedom of the curve
    plain, found, extra = solved, Alternatives(), ()
    if sought:
        extra = (GaussMarkov(time=likeliest_time(solved.fitted, dt, n * dt), name=sought[0].name),)
        terms = tuple(extra[0] if term in sought else term for term in terms)
        solved = _solve(observed, (*base, *extra), band)
    else:
        found, solved = _with_alternatives(observed, solved, base, band)
        extra = tuple(term for term in solved.columns if term not in (*base, *plain.columns))
        terms = (*terms, *extra)
    if extra:
        lowest = _lowest(observed, solved)
    if not (np.all(np.isfinite(solved.fitted.theta)) and np.isfinite(solved.fitted.cost)):
        raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    names = solved.names
    uneven, levels = _uneven(observed.drawn, solved, lowest, dt)
    widened = np.array([max(uneven[name].factor, 1.0) if name in uneven else 1.0 for name in names])
    if levels:  # the mean of N^2 is known as well as its parts are
        parts, squares = np.array([part.stop - part.start for part in levels]), np.array([part.ratio**2 for part in levels])
        widened[names.index("N")] = np.average(squares**2, weights=parts) / np.average(squares, weights=parts) ** 2
    widened = widened * np.array([tails.factor if name == "N" else 1.0 for name in names])
    if extra and not sought:
        widened = widened * widening(solved.fitted, solved.columns, extra, dt)
    covariance, limits, factor = uncertainty(solved.fitted, widened, *levels_of(confidence), names)
    if extra and found.admitted and found.admitted.gain < _SURE:
        other = uncertainty(plain.fitted, np.ones(len(plain.names)), *levels_of(confidence), plain.names, ("B", "K"))[1]
        limits = rivals.widest(limits, names, other.scaled(float(plain.bins.unit / solved.bins.unit)), ("B", "K"))
    rest = tuple(term for term in base if term.name not in ("B", "K"))
    if "N" in asked and (rival := rivals.competing(found, confidence)):
        other = _solve(observed, (*rest, *rival.terms), band)
        wide, unit = widening(other.fitted, other.columns, rival.terms, dt), float(other.bins.unit / solved.bins.unit)
        limits = rivals.over_models(limits, names, other.fitted, other.names, wide, unit, found, confidence)
    limits, doubts = rivals.doubted(limits, names, found.doubts())
    lines = amplitudes(solved.bins, solved.taken, density(solved.bins.columns, solved.fitted.theta), n * dt)
    lines = [found for found in lines if found[1] <= solved.end]
    if tails.law or not observed.complete:
        curve = deviation(observed.drawn, curve.rate, m=curve.m, confidence=confidence)
    used = _used(curve, solved, band)
    fit = assemble(
        *_squares(solved, covariance, limits, terms, line, confidence), terms, curve, n * dt, sinusoid=lines, used=used,
        decides={name: float(factor[names.index(name)]) * n * dt for name in asked if name in names}, confidence=confidence,
        goodness=float(solved.fitted.goodness), method="whittle", band=(float(curve.tau[used].min()), float(curve.tau[used].max())),
    )  # fmt: skip
    fit = dataclasses.replace(fit, verdict=fit.verdict | dict.fromkeys(doubts, "hint"))
    left_out = _messages.of_octaves(curve, used, np.sqrt(np.asarray(fit.noise.avar(curve.tau, dt=dt))), band is None)
    inflation = float(solved.fitted.inflation)
    told, notes = _messages.of_alternatives(found, doubts, fit)
    where, how = "any band" if band is None else "the band asked for", f"the spectrum scatters {inflation:.1f} times as much as it may"
    unsettled = "the search for the largest likelihood did not converge; fit fewer terms or another band"
    warnings = (
        *curve.warnings,
        *_messages.of_model(fit, "spectrum", bool(solved.fitted.holds), where, how, inflation, bool(solved.fitted.cut)),
        *(() if bool(solved.fitted.settled) else (unsettled,)),
        *([f"the record has heavy tails: {tails.law}"] if tails.law else ()),
        *_messages.of_record(y, dt, lines),
        *_messages.of_causes(causes, observed.factors, observed.covariance),
        *told,
        *_messages.of_levels(levels, float(np.asarray(fit.noise.coefficient("N"))) if levels else 0.0, dt),
        *_messages.of_unevenness(uneven, n * dt),
    )
    if "markov" in asked:
        notes = (*notes, _messages.of_markov(fit))
    curve = with_edf(curve, used, _model_edf(curve, plain, n))
    events = (*_messages.events_of_causes(causes), *_messages.events_of_parts(levels, uneven, n * dt, dt))
    fit = dataclasses.replace(
        fit, deviation=curve, left_out=left_out, warnings=warnings, notes=notes, spectrum=_fitted_spectrum(solved), events=events
    )
    return without_terms(fit, [term.name for term in extra], tables=not sought)


def _fitted_spectrum(solved: Solved) -> FittedSpectrum:
    """The bins of a record that hold an ordinate, beside the model; those that lines occupy are left out."""
    bins = solved.bins
    kept = (bins.weight > 0) & (bins.density > 0) & ~solved.taken
    model = density(solved.fitted.bins.columns, solved.fitted.theta)
    used = solved.fitted.bins.weight > 0
    frequency, level, model, edf, used = (
        np.asarray(values)[kept] for values in (bins.frequency, bins.density * bins.unit, model * bins.unit, bins.weight, used)
    )
    columns = {name: np.asarray(bins.columns)[kept, i] for i, name in enumerate(solved.names) if name != FILTER}
    return FittedSpectrum(frequency=frequency, density=level, model=model, edf=edf, used=used, columns=columns)


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


def _temperature_at(temperature, t):
    """Times -> (times, 1) temperature less its mean; None where it is not known or does not move."""
    if temperature is None or not np.all(np.isfinite(temperature)) or not np.ptp(temperature) > 0.0:
        return None
    return lambda when: np.interp(when, t, temperature - np.mean(temperature))[:, None]


def _solve(observed: Observed, columns: tuple[Term, ...], band) -> Solved:
    """Fit what was observed: once where it is complete, else until the density that fills the gaps is the one that is fitted."""
    columns, level = (*columns, Filter()), np.ones(1)
    solved = _solved(observed.bins(columns), columns, band, band is None and observed.complete)
    for k in range(0 if observed.complete else _ROUNDS):
        before, level = level, _level(solved, k < _ROUGH)
        if k > _ROUGH and np.max(np.abs(np.log(level / before))) < _SETTLED:
            break
        solved = _solved(observed.bins(columns, level), columns, band, band is None and k + 1 >= _ROUGH)
    return solved


def _with_alternatives(observed: Observed, solved: Solved, base: tuple[Term, ...], band) -> tuple[Alternatives, Solved]:
    """What else explains the slow noise, and the fit with it beside B and K where it is admitted.

    Where high frequencies were left out, because B and K do not describe them, others may describe the whole band.
    """
    dt, duration = observed.dt, len(observed.y) * observed.dt
    if bool(solved.fitted.cut):
        clear = solved.bins._replace(weight=np.where(solved.taken, 0.0, solved.bins.weight))
        whole = fit_bins(clear, groups_of(clear.weight, int(np.sum(clear.weight))), False, solved.names)
        found = find_alternatives(whole, solved.columns, dt, duration)
        excess = whole.alone.deviance - whole.alone.freedom
        if found.admitted and found.admitted.gain * whole.inflation > _MENDED * excess:
            wider = _solve(observed, (*base, *found.admitted.terms), band)
            if not bool(wider.fitted.cut):
                return found, wider
    found = find_alternatives(solved.fitted, solved.columns, dt, duration)
    return found, _solve(observed, (*base, *found.admitted.terms), band) if found.admitted else solved


def observed_bins(y, dt: float, terms: tuple[Term, ...]) -> Bins:
    """Bins of a record with gaps under the model of these terms that fits it, a column for each term."""
    bins = _solve(Observed(y, dt), terms, None).bins
    return bins._replace(columns=bins.columns[:, : len(terms)])


def _spectrum(solved: Solved):
    """Frequencies in Hz and the density there."""
    return solved.bins.frequency, _level(solved, False)


def _level(solved: Solved, rough: bool):
    """Density at the bins: that of the model where it was fitted, and of the ordinates themselves in lines and outside of the band.

    While gaps are filled for the first time the model may fit badly, and it is scaled to the ordinates in groups of many.
    """
    bins, model = solved.bins, density(solved.fitted.bins.columns, solved.fitted.theta)
    if rough:
        group = groups_of(bins.weight, int(bins.weight.sum()))
        count, total = (np.bincount(group, bins.weight * values) for values in (np.ones(len(model)), bins.density / model))
        model = model * np.where(count > _MANY, total / np.maximum(count, 1.0), 1.0)[group]
    own = (solved.fitted.bins.weight == 0.0) & (bins.weight > 0.0) & (bins.density > 0.0)
    return np.where(own, bins.density, model) * bins.unit


def _solved(whole: Bins, columns: tuple[Term, ...], band, automatic: bool) -> Solved:
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
    return Solved(bins, taken, fit_bins(clear, group, automatic, names, None if taken.any() else first), columns)


def _lowest(observed: Observed, solved: Solved) -> Lowest:
    n = len(observed.y)
    k = np.arange(1, min(ORDINATES, n - 1) + 1)
    columns = np.stack([term.ordinates(k, n, observed.dt) for term in solved.columns], axis=1)
    # what a filter takes is nothing at low frequencies, and its negative column must not make a density negative
    theta = np.where([name != FILTER for name in solved.names], solved.fitted.theta, 0.0)
    # without any other term the filter is all that is left, and its density vanishes here
    least = np.finfo(float).eps * np.max(density(solved.fitted.bins.columns, solved.fitted.theta))
    return Lowest(columns, np.maximum(columns @ theta, least) * solved.bins.unit)


def _uneven(y, solved: Solved, lowest: Lowest, dt: float) -> tuple[dict[str, Unevenness], list[Level]]:
    """How uneven in time B, K and N are, where any is; and the parts of the record, where N differs between some."""
    if len(y) < _SHORTEST:
        return {}, []
    names = solved.names
    found = {term: unevenness(y, lowest.columns[:, names.index(term)], lowest.density, dt) for term in ("B", "K") if term in names}
    found = found if any(term.told for term in found.values()) else {}
    share, level = solved.share("N", len(y), dt) if "N" in names else (np.zeros(1), np.ones(1))
    if np.any(share > 0.0) and (white := unevenness_of_level(y, share, level, dt)).told:
        levels = levels_of_white(y, share, level, dt)
        if len(levels) > 1:
            return found, levels
        found["N"] = white
    return found, []


def _squares(solved: Solved, covariance, limits: Limits, terms: tuple[Term, ...], line: tuple[float, float], confidence: float):
    """Squared coefficients in SI in the order of the terms asked for, their covariance and limits.

    The ramp is among them, from the `line` (slope, error); Q is not estimated where its octaves are left out.
    """
    asked = [term.name for term in terms]
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


def _model_edf(curve: Deviation, solved: Solved, n: int):
    """Degrees of freedom of the curve under the fitted terms."""
    fitted = [(float(value * solved.bins.unit), term) for value, term in zip(solved.fitted.theta, solved.columns, strict=True)]
    squares, terms = zip(*((value, term) for value, term in fitted if term.name != FILTER), strict=True)
    dt = 1.0 / curve.rate
    tensor = np.diagonal(covariance_tensor(n, tuple(int(m) for m in curve.m), dt, terms), axis1=2, axis2=3)
    variance = np.einsum("i,ijm,j->m", squares, tensor, squares)
    modelled = squares @ np.stack([np.asarray(term.avar(curve.tau, dt)) for term in terms])
    return 2.0 * modelled**2 / np.where(variance > 0.0, variance, np.inf)
