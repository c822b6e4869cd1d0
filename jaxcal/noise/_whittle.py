"""Method "whittle": one channel in, one `NoiseFit` out."""

from typing import NamedTuple

import numpy as np

from .._errors import DataError, FitError
from .._frozen import replaced
from .._message import Message
from .._precision import is_traced
from .._types import AnyArray
from ..allan import Deviation, deviation
from . import _findings, _rivals as rivals
from ._alternatives import Alternative, Alternatives, likeliest_time, widening
from ._causes import Cause, find_causes
from ._checks import Asked
from ._covariance import covariance_tensor
from ._likelihood import density
from ._limits import Limits, levels_of
from ._observed import Observed, without_gaps
from ._ordinates import amplitudes, bins_of
from ._result import FittedSpectrum, NoiseFit, assemble, with_edf, without_terms
from ._solve import Lowest, Solved, inside, lowest_of, solve, solve_alternatives, spectrum_of
from ._spectral import FILTER, fit_whole, groups_of, uncertainty
from ._stationarity import Level, Unevenness, follows, levels_of_white, unevenness, unevenness_of_level
from ._tails import Tails, tamed
from ._terms import GaussMarkov, Ramp, Term

#: slope in standard errors above which a line in time is removed from the record, if R is among the terms
_RAMP = 3.0
_SHORTEST = 256  # number of samples from which the fit compares coefficients in parts of a record
#: likelihood ratio above which a model in place of B and K is no chance: in records of noise of B and K it reached 15 at most
_SURE = 30.0
_NO_SHARE = 1e-9  # share of a model that is only rounding
_FAST = ("Q", "N", FILTER)  # terms that high frequencies determine, at which nothing else looks like them


class Parts(NamedTuple):
    """The terms asked for: all, those of a fixed shape, ramps, and Gauss-Markov processes without a correlation time."""

    asked: tuple[Term, ...]
    base: tuple[Term, ...]
    ramps: tuple[Term, ...]
    sought: tuple[Term, ...]


class Described(NamedTuple):
    """A record under a model of its noise.

    observed : its likelihood, with the causes as regressors. solved : the fit. terms : those asked for, and `extra`, those that the fit
    added. lowest : the first ordinates under the fit. line : slope of the record and its standard error. causes : what changes the mean.
    """

    observed: Observed
    solved: Solved
    terms: tuple[Term, ...]
    extra: tuple[Term, ...]
    lowest: Lowest
    line: tuple[float, float]
    causes: tuple[Cause, ...]


class Judged(NamedTuple):
    """Covariance and limits of squared coefficients, length factors that decide on them, doubtful terms, and what is uneven in time."""

    covariance: AnyArray
    limits: Limits
    decides: AnyArray
    doubts: dict[str, Alternative]
    uneven: dict[str, Unevenness]
    levels: list[Level]


class Tried(NamedTuple):
    """A model that has a share in the result; `alternative` is None for B and K alone."""

    alternative: Alternative | None
    share: float
    model: Described
    judged: Judged


def fit_channel(y, asked: Asked) -> NoiseFit:
    """Fit one channel, (n,) with NaN where a sample is missing, by the likelihood of its samples.

    The curve for the plot is computed again if samples are missing, or causes or tails are taken out: straight lines fill gaps until then.
    """
    if is_traced(y):
        return _fit_traced(y, asked)
    curve = asked.deviation(without_gaps(y))
    terms, band, confidence, temperature, robust = asked.terms, asked.band, asked.confidence, asked.temperature, asked.robust
    parts, dt = _parts(terms), 1.0 / curve.rate
    tails = tamed(y, dt, lambda x: spectrum_of(solve(Observed(x, dt), parts.base, band))) if robust else Tails(y, "", 1.0)
    plain = _without_causes(tails.y, dt, parts, band, temperature)
    plain, model, found = _with_process(plain, parts, band) if parts.sought else _with_alternatives(plain, parts, band)
    if not (np.all(np.isfinite(model.solved.fitted.theta)) and np.isfinite(model.solved.fitted.cost)):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    judged = _judged(plain, model, found, parts, tails.factor, band, confidence)
    doubts = rivals.doubted(judged.limits, model.solved.names, found.doubts())
    if found.undecided:
        model, judged, found = _averaged(plain, model, judged, found, parts, tails.factor, band, confidence)
    judged = judged._replace(limits=rivals.reaching_zero(judged.limits, model.solved.names, doubts), doubts=doubts)
    if tails.law or not model.observed.complete:
        curve = deviation(model.observed.drawn, curve.rate, m=curve.m, confidence=confidence)
    fit = _assembled(curve, plain, model, judged, parts, band, confidence)
    return _with_findings(fit, model, judged, found, parts, tails, asked.sensor)


def _parts(terms: tuple[Term, ...]) -> Parts:
    ramps, sought = (tuple(term for term in terms if kind(term)) for kind in (_is_ramp, _is_sought))
    base = tuple(term for term in terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError(
            f"terms {tuple(term.name for term in terms)!r}: a ramp, and one Gauss-Markov process without correlation time, are fitted "
            "beside other terms; add N"
        )
    return Parts(terms, base, ramps, sought)


def _without_causes(y, dt: float, parts: Parts, band, temperature) -> Described:
    """The record under the terms of a fixed shape, after a ramp and causes beside noise are taken out."""
    t, observed, causes = np.arange(len(y)) * dt, Observed(y, dt), ()
    solved = solve(observed, parts.base, band)
    lowest = lowest_of(observed, solved)
    line = slope, error = follows(observed.drawn, t, lowest.density, dt)
    if parts.ramps and abs(slope) > _RAMP * error:
        y = y - slope * t
    elif not parts.sought:
        slow = [name not in _FAST for name in solved.names]
        theta = solved.fitted.theta * solved.bins.unit
        causes = find_causes(observed.drawn, lowest.columns, theta, slow, dt, _temperature_at(temperature, t))
    if causes or parts.ramps:
        columns = [cause.columns(t) for cause in causes]
        observed = Observed(y, dt, np.concatenate(columns, axis=1) if columns else None)
        solved = solve(observed, parts.base, band)
        lowest = lowest_of(observed, solved)
    return Described(observed, solved, parts.asked, (), lowest, line, causes)


def _with_process(plain: Described, parts: Parts, band) -> tuple[Described, Described, Alternatives]:
    """The record without and with the Gauss-Markov process asked for, at its likeliest correlation time; and no alternatives."""
    dt, (sought,) = plain.observed.dt, parts.sought
    process = GaussMarkov(time=likeliest_time(plain.solved.fitted, dt, len(plain.observed.y) * dt), name=sought.name)
    solved = solve(plain.observed, (*parts.base, process), band)
    terms = tuple(process if term is sought else term for term in parts.asked)
    return plain, plain._replace(solved=solved, terms=terms, extra=(process,), lowest=lowest_of(plain.observed, solved)), Alternatives()


def _with_alternatives(plain: Described, parts: Parts, band) -> tuple[Described, Described, Alternatives]:
    """The record without and with another model of its slow noise beside B and K, if one is admitted; and all that were tried."""
    found, solved, alone = solve_alternatives(plain.observed, plain.solved, parts.base, band)
    return plain._replace(solved=alone), _extended(plain, solved, parts), found


def _extended(plain: Described, solved: Solved, parts: Parts) -> Described:
    """The record under a fit that may have terms beside those asked for."""
    extra = tuple(term for term in solved.columns if term not in (*parts.base, *plain.solved.columns))
    lowest = lowest_of(plain.observed, solved) if extra else plain.lowest
    return plain._replace(solved=solved, terms=(*parts.asked, *extra), extra=extra, lowest=lowest)


def _judged(
    plain: Described, model: Described, found: Alternatives, parts: Parts, factor: float, band, confidence: float
) -> Judged:  # fmt: skip
    """Uncertainty of the coefficients under the model, and under others that the record does not exclude.

    The variance of N grows by the `factor` of heavy tails.
    """
    solved, dt, level = model.solved, model.observed.dt, levels_of(confidence)
    names, unit = solved.names, solved.bins.unit
    uneven, levels = _uneven(model.observed, solved, model.lowest)
    widened = np.array([max(uneven[name].factor, 1.0) if name in uneven else 1.0 for name in names])
    if levels:  # the mean of N^2 is known as well as its parts are
        size, squares = np.array([part.stop - part.start for part in levels]), np.array([part.ratio**2 for part in levels])
        widened[names.index("N")] = np.average(squares**2, weights=size) / np.average(squares, weights=size) ** 2
    widened = widened * np.array([factor if name == "N" else 1.0 for name in names])
    if model.extra and not parts.sought:
        widened = widened * widening(solved.fitted, solved.columns, model.extra, dt)
    covariance, limits, decides = uncertainty(solved.fitted, widened, *level, names)
    if model.extra and found.admitted and found.admitted.gain < _SURE:
        other = uncertainty(plain.solved.fitted, np.ones(len(plain.solved.names)), *level, plain.solved.names, ("B", "K"))[1]
        limits = rivals.widest(limits, names, other.scaled(float(plain.solved.bins.unit / unit)), ("B", "K"))
    if "N" in names and (rival := rivals.competing(found, confidence)):
        rest = tuple(term for term in parts.base if term.name not in ("B", "K"))
        other = solve(model.observed, (*rest, *rival.terms), band, solved.lines)
        wide = widening(other.fitted, other.columns, rival.terms, dt)
        limits = rivals.over_models(limits, names, other.fitted, other.names, wide, float(other.bins.unit / unit), found, confidence)
    return Judged(covariance, limits, decides, {}, uneven, levels)


def _averaged(
    plain: Described, model: Described, judged: Judged, found: Alternatives, parts: Parts, factor: float, band, confidence: float
) -> tuple[Described, Judged, Alternatives]:  # fmt: skip
    """The mean of all models that the record does not decide between, its uncertainty, and the shares that the models have."""
    tried: list[Tried] = []
    for one, share in found.shares:
        if one is found.admitted:
            tried.append(Tried(one, share, model, judged))
            continue
        terms = one.numbered(sum(len(each.model.extra) for each in tried))
        with_it = _extended(plain, solve(plain.observed, (*parts.base, *terms), band, plain.solved.lines), parts)
        tried.append(Tried(one, share, with_it, _judged(plain, with_it, found._replace(admitted=one), parts, factor, band, confidence)))
    rest = 1.0 - sum(share for _, share in found.shares)
    if rest > _NO_SHARE:
        alone = _judged(plain, plain, found._replace(admitted=None), parts, factor, band, confidence) if found.admitted else judged
        tried.append(Tried(None, rest, plain, alone))
    # fits that explain different frequencies have no mean
    tried = [each for each in tried if bool(each.model.solved.fitted.cut) == bool(model.solved.fitted.cut)]
    total = sum(each.share for each in tried)
    tried = sorted((each._replace(share=each.share / total) for each in tried), key=lambda each: -each.share)
    found = found._replace(shares=tuple((each.alternative, each.share) for each in tried if each.alternative))
    if len(tried) == 1:
        return model, judged, found
    solved = tried[0].model.solved.with_columns([(term, each.model.solved) for each in tried[1:] for term in each.model.extra])
    estimates = []
    for each in tried:
        own = each.model.solved
        one = rivals.Estimate(own.fitted.theta, each.judged.covariance, each.judged.limits)
        estimates.append(
            one.among([solved.names.index(name) for name in own.names], len(solved.names), float(own.bins.unit / solved.bins.unit))
        )
    mean = rivals.mean_of(estimates, np.array([each.share for each in tried]), *levels_of(confidence))
    solved = solved._replace(fitted=solved.fitted._replace(theta=mean.theta))
    extra = tuple(term for each in tried for term in each.model.extra)
    decides = np.zeros(len(solved.names) - 1)
    decides[[solved.names.index(name) for name in model.solved.names[:-1]]] = judged.decides
    model = model._replace(solved=solved, terms=(*parts.asked, *extra), extra=extra)
    return model, judged._replace(covariance=mean.covariance, limits=mean.limits, decides=decides), found


def _assembled(curve: Deviation, plain: Described, model: Described, judged: Judged, parts: Parts, band, confidence: float) -> NoiseFit:
    """The result without its warnings."""
    solved, n = model.solved, len(model.observed.y)
    duration, names = n * model.observed.dt, solved.names
    used = _used(curve, solved, band)
    fit = assemble(
        *_squares(solved, judged.covariance, judged.limits, model.terms, model.line, confidence), model.terms, curve, duration,
        sinusoid=_lines(model), used=used, confidence=confidence, method="whittle",
        decides={term.name: float(judged.decides[names.index(term.name)]) * duration for term in parts.asked if term.name in names},
        goodness=float(solved.fitted.goodness), band=(float(curve.tau[used].min()), float(curve.tau[used].max())),
    )  # fmt: skip
    # the spectrum of the plain model is close enough for the degrees of freedom of the curve
    curve = with_edf(curve, used, _model_edf(curve, plain.solved, n))
    presence = fit.presence | dict.fromkeys(judged.doubts, "hint")
    return replaced(fit, presence=presence, deviation=curve, spectrum=_fitted_spectrum(solved))


def _with_findings(
    fit: NoiseFit, model: Described, judged: Judged, found: Alternatives, parts: Parts, tails: Tails, sensor: str
) -> NoiseFit:
    """The result with findings and events, and without the terms that were not asked for."""
    observed, fitted = model.observed, model.solved.fitted
    dt, duration = observed.dt, len(observed.y) * observed.dt
    shortest = float(fit.band[0]) if bool(fitted.cut) and "Q" in fit.terms else None
    findings = (
        *getattr(fit.deviation, "findings", ()),
        *_findings.of_model(bool(fitted.holds), float(fit.goodness), float(fitted.inflation), shortest),
        *(() if bool(fitted.settled) else (_findings.FINDINGS("unsettled"),)),
        *((_findings.FINDINGS("heavy", law=tails.law, of=tails.of),) if tails.law else ()),
        *_findings.of_record(observed.y, _lines(model)),
        *_findings.of_causes(model.causes, observed.factors, observed.covariance, sensor or "ratio"),
        *_findings.of_alternatives(found, judged.doubts.values()),
        *_findings.of_parts(judged.levels, judged.uneven, duration, dt),
    )
    events = _findings.events_of(model.causes, judged.levels, judged.uneven, duration, dt)
    fit = replaced(fit, findings=findings, events=events)
    return without_terms(fit, [term.name for term in model.extra], tables=not parts.sought)


def _lines(model: Described) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of the spectral lines in the band."""
    solved = model.solved
    lines = amplitudes(
        solved.bins, solved.taken, density(solved.bins.columns, solved.fitted.theta), len(model.observed.y) * model.observed.dt
    )
    return [line for line in lines if line[1] <= solved.end]


def _fitted_spectrum(solved: Solved) -> FittedSpectrum:
    """Bins of the record and the model there. Bins without an ordinate and those of spectral lines are left out."""
    bins = solved.bins
    kept = (bins.weight > 0) & (bins.density > 0) & ~solved.taken
    model = density(solved.fitted.bins.columns, solved.fitted.theta)
    used = solved.fitted.bins.weight > 0
    frequency, level, model, edf, used = (
        np.asarray(values)[kept] for values in (bins.frequency, bins.density * bins.unit, model * bins.unit, bins.weight, used)
    )
    columns = {name: np.asarray(bins.columns)[kept, i] for i, name in enumerate(solved.names) if name != FILTER}
    return FittedSpectrum(frequency=frequency, density=level, model=model, edf=edf, used=used, columns=columns)


def _fit_traced(y, asked: Asked) -> NoiseFit:
    """Fit a traced record as it is, without checks, a choice of the band or spectral lines; the result can be differentiated."""
    rate, terms, band, confidence = asked.rate, asked.terms, asked.band, asked.confidence
    if any(_is_ramp(term) or _is_sought(term) for term in terms):
        raise DataError("a traced record is fitted without R and markov; these are found by a search, which cannot be traced")
    bins, duration = inside(bins_of(y, 1.0 / rate, terms), band), y.shape[0] / rate
    fitted = fit_whole(bins, groups_of(bins.weight, y.shape[0] - 1))
    covariance, limits, _ = uncertainty(fitted, np.ones(len(terms)), *levels_of(confidence), tuple(term.name for term in terms))
    return assemble(
        fitted.theta * bins.unit, covariance * bins.unit**2, limits.scaled(bins.unit), terms, None, duration, goodness=fitted.goodness,
        confidence=confidence, method="whittle", used=None, band=(1.0 / rate, duration / 2.0) if band is None else band,
    )  # fmt: skip


def _is_ramp(term: Term) -> bool:
    return isinstance(term, Ramp)


def _is_sought(term: Term) -> bool:
    """Whether the term is a Gauss-Markov process without a correlation time."""
    return isinstance(term, GaussMarkov) and term.time is None


def _temperature_at(temperature, t):
    """Function of times that returns (times, 1) temperatures less their mean; None if the temperature is unknown or constant."""
    if temperature is None or not np.all(np.isfinite(temperature)) or not np.ptp(temperature) > 0.0:
        return None
    return lambda when: np.interp(when, t, temperature - np.mean(temperature))[:, None]


def _uneven(observed: Observed, solved: Solved, lowest: Lowest) -> tuple[dict[str, Unevenness], list[Level]]:
    """How B, K and N change during the record, if one does; and the parts of the record with their N, if N changes."""
    y, dt = observed.drawn, observed.dt
    if len(y) < _SHORTEST:
        return {}, []
    names = solved.names
    found = {term: unevenness(y, lowest.columns[:, names.index(term)], lowest.density, dt) for term in ("B", "K") if term in names}
    found = found if any(term.told for term in found.values()) else {}
    share, level = solved.share("N", len(y), dt) if "N" in names else (np.zeros(1), np.ones(1))
    if np.any(share > 0.0) and (white := unevenness_of_level(observed.spectrum(), share, level, dt)).told:
        levels = levels_of_white(observed.spectrum(), share, level, dt)
        if len(levels) > 1:
            return found, levels
        found["N"] = white
    return found, []


def _squares(solved: Solved, covariance, limits: Limits, terms: tuple[Term, ...], line: tuple[float, float], confidence: float):
    """Squared coefficients in SI units in the order of `terms`, their covariance and limits.

    The ramp comes from the `line`, (slope, error). Q is zero if the band leaves out the octaves that determine it.
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
        # the slope is a linear function of the record, and therefore normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels_of(confidence))
        ends[:, i] = max(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2, (slope / error) ** 2
    if "Q" in asked and bool(solved.fitted.cut):
        i = asked.index("Q")
        squares[i] = spread[i] = spread[:, i] = ends[[0, 3], i] = 0.0
    return squares, spread, Limits(*ends)


def _used(curve: Deviation, solved: Solved, band) -> np.ndarray:
    """Whether each cluster size lies in the band; the longest one always does if no other does."""
    used = np.asarray(curve.tau) >= (0.5 / solved.end) * (1 - 1e-9)
    if band is not None:
        used &= (curve.tau >= band[0] * (1 - 1e-9)) & (curve.tau <= band[1] * (1 + 1e-9))
    if not used.any():
        used[-1] = True
    return used


def _model_edf(curve: Deviation, solved: Solved, n: int):
    """Degrees of freedom of the Allan variance under the fitted terms."""
    fitted = [(float(value * solved.bins.unit), term) for value, term in zip(solved.fitted.theta, solved.columns, strict=True)]
    squares, terms = zip(*((value, term) for value, term in fitted if term.name != FILTER), strict=True)
    dt = 1.0 / curve.rate
    tensor = np.diagonal(covariance_tensor(n, tuple(int(m) for m in curve.m), dt, terms), axis1=2, axis2=3)
    variance = np.einsum("i,ijm,j->m", squares, tensor, squares)
    modelled = squares @ np.stack([np.asarray(term.avar(curve.tau, dt)) for term in terms])
    return 2.0 * modelled**2 / np.where(variance > 0.0, variance, np.inf)
