"""Method "whittle": the channels of a sensor in, a `NoiseFit` for each out."""

from typing import NamedTuple

import numpy as np

from .._errors import DataError, FitError
from .._frozen import replaced
from .._message import Message
from .._types import AnyArray
from . import _findings
from ._changes import Axis, Changes, find_changes, lowest_of
from ._compare import likeliest_time
from ._errors import Widening, doubted, widening
from ._likelihood import density, information, inverse
from ._limits import PRESENT, Limits, levels_of, profile_limits
from ._measured import edf_of
from ._observed import Observed, Regressors
from ._ordinates import LINE, amplitudes
from ._record import Asked, Record
from ._result import FittedSpectrum, NoiseFit, assemble, with_edf
from ._rival import Rival, rival_of
from ._solve import FILTER, SETTLED, Solved, solve
from ._terms import GaussMarkov, Ramp, Term, is_sought

_FAST = ("Q", "N", FILTER)  # terms that high frequencies determine, at which nothing else looks like them


class Described(NamedTuple):
    """A record under a model of its noise.

    observed : its likelihood, with changes of the mean as regressors. solved : the fit. terms : those asked for, with the correlation time
    of a process that was sought. changes : those of the mean.
    """

    observed: Observed
    solved: Solved
    terms: tuple[Term, ...]
    changes: Changes = Changes()


def fit_axes(record: Record, asked: Asked) -> list[NoiseFit]:
    """Fit the channels of a sensor by the likelihood of their samples.

    Each channel has coefficients of its own. What changes the mean is looked for in all channels together, also across each stretch of
    samples that was set aside.
    """
    sought, ramps = ([term for term in asked.terms if kind(term)] for kind in (is_sought, lambda term: isinstance(term, Ramp)))
    base = tuple(term for term in asked.terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError(
            f"terms {tuple(one.name for one in asked.terms)!r}: a ramp, and one Gauss-Markov process without correlation time, are fitted "
            "beside other terms; add N"
        )
    found = []
    for y, name in zip(record.channels, record.names, strict=True):
        try:
            observed = Observed(y, 1.0 / asked.rate)
            if ramps:  # a regressor beside the other terms
                observed = observed.beside(Regressors(np.arange(len(y))[None, :] / asked.rate))
            found.append(Described(observed, solve(observed, base, asked.band), asked.terms))
        except DataError as error:
            raise error.of(name) from None
    if sought:
        found = [_with_process(one, base, asked.band) for one in found]
    elif not ramps:
        found = _with_changes(found, base, asked, record)
    return [_result(one, asked, record.sensor) for one in found]


def _with_process(plain: Described, base: tuple[Term, ...], band) -> Described:
    """The record with the Gauss-Markov process asked for, at its likeliest correlation time."""
    dt = plain.observed.dt
    time = likeliest_time(plain.solved.fitted, dt, len(plain.observed.y) * dt)
    terms = tuple(GaussMarkov(time=time, name=term.name) if is_sought(term) else term for term in plain.terms)
    process = tuple(term for term, asked in zip(terms, plain.terms, strict=True) if is_sought(asked))
    return plain._replace(solved=solve(plain.observed, (*base, *process), band), terms=terms)


def _with_changes(plain: list[Described], base: tuple[Term, ...], asked: Asked, record: Record) -> list[Described]:
    """The records with what changes their mean, if anything does."""
    dt, n = 1.0 / asked.rate, len(record.channels[0])
    slow = np.array([name not in _FAST for name in plain[0].solved.names])
    walk = np.array([name == "K" for name in plain[0].solved.names])[slow]
    columns = lowest_of(n, dt, plain[0].solved.columns)
    axes = [Axis(one.observed.drawn, columns, one.solved.fitted.theta * one.solved.bins.unit, slow, walk) for one in plain]
    joints = [0.5 * (first + last) * dt for first, last in record.aside or ()]
    warmth = record.temperature
    known = warmth is not None and np.all(np.isfinite(warmth)) and np.ptp(warmth) > 0.0
    changes = find_changes(axes, dt, joints, np.asarray(warmth, dtype=float) if known else None)
    if not changes.fitted:
        return [one._replace(changes=changes) for one in plain]
    functions = [change.columns(np.arange(n) * dt).T for change in changes.fitted]
    count = [len(one) for one in functions]
    regressors = Regressors(np.concatenate(functions), np.repeat(np.arange(len(count)), count), np.repeat(changes.shares, count))
    found = []
    for one in plain:
        observed = one.observed.beside(regressors)
        found.append(one._replace(observed=observed, solved=solve(observed, base, asked.band, one.solved), changes=changes))
    return found


def _result(model: Described, asked: Asked, sensor: str) -> NoiseFit:
    """Coefficients, intervals and findings of a channel."""
    observed, solved = model.observed, model.solved
    fitted, names, dt = solved.fitted, solved.names, observed.dt
    if not (np.all(np.isfinite(fitted.theta)) and np.isfinite(fitted.cost)):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    wait, used = asked.begin(observed.drawn if model.changes.fitted else observed.filled, solved.end)
    duration, unit = len(observed.y) * dt, float(solved.bins.unit)
    wider = widening(fitted.bins, unit / dt, fitted.theta, names, observed.spectrum())
    if len(observed.doubts):
        doubt = doubted(fitted.bins, fitted.theta, observed.doubts / unit)
        # the search holds the fast terms, which no change of the mean looks like
        wider = wider._replace(factor=wider.factor + np.where([name in _FAST for name in names], 0.0, doubt))
    covariance, limits = _uncertainty(solved, wider.factor, asked.confidence)
    scale = float(wider.factor[names.index("N")]) if "N" in names else 1.0
    rival = rival_of(fitted, names, dt, duration, levels_of(asked.confidence), scale)
    limits, doubts = _beside(limits, [names[i] for i in solved.own], rival)
    curve = wait()
    used = used[np.isin(asked.m, curve.m)]
    used[-1] |= not used.any()
    fit = assemble(
        *_squares(solved, covariance, limits, model.terms, observed, asked.confidence), model.terms, curve, duration,
        sinusoid=_lines(model), used=used, confidence=asked.confidence, method="whittle", goodness=fitted.goodness,
        band=(float(curve.tau[used].min()), float(curve.tau[used].max())),
    )  # fmt: skip
    curve = with_edf(curve, used, edf_of(curve, len(observed.y), fitted.bins, rival.density, fitted.theta, wider.factor))
    fit = replaced(fit, presence=fit.presence | dict.fromkeys(doubts, "hint"), deviation=curve, spectrum=_fitted_spectrum(solved))
    fit = replaced(fit, findings=_said(fit, model, wider, rival, doubts, sensor), events=_findings.events_of(model.changes.likely))
    kept = tuple(term.name for term in asked.terms if not is_sought(term))
    return replaced(fit, terms=kept, covariance=fit.covariance[list(kept)])


def _uncertainty(solved: Solved, widened: AnyArray, confidence: float) -> tuple[AnyArray, Limits]:
    """Covariance of the squared coefficients (inverse Fisher information), and profile-likelihood limits of those that are known.

    Every variance is multiplied by `widened`, (p,), and the likelihood ratio of its profile is divided by it.
    """
    fitted, own = solved.fitted, solved.own
    covariance = inverse(information(fitted.bins, fitted.theta))
    levels = (level * widened[own] for level in levels_of(confidence))
    limits = profile_limits(fitted.bins, fitted.theta, fitted.cost, covariance, own, *levels)
    return covariance * np.sqrt(np.outer(widened, widened)), limits._replace(significance=limits.significance / widened[own])


def _beside(limits: Limits, own: list[str], rival: Rival) -> tuple[Limits, list[str]]:
    """Limits of terms that hold under the rival too, and the terms that are hints at most, because it is another spectrum."""
    low, high, upper = rival.white or (np.inf, 0.0, 0.0)
    white, slow = (np.array([name in some for name in own]) for some in (("N",), ("B", "K")))
    doubts = [name for name, rise in zip(own, limits.significance * slow, strict=True) if rival.left == 0.0 and rise > PRESENT]
    low = np.where(white, np.minimum(limits.low, low), limits.low * np.where(slow, rival.left, 1.0))
    high, upper = (np.where(white, np.maximum(one, other), one) for one, other in ((limits.high, high), (limits.upper, upper)))
    return Limits(low, high, upper, limits.significance), doubts


def _said(fit: NoiseFit, model: Described, wider: Widening, rival: Rival, doubts: list[str], sensor: str) -> tuple:
    """What to know about a channel."""
    observed, fitted = model.observed, model.solved.fitted
    duration = len(observed.y) * observed.dt
    shortest = float(fit.band[0]) if fitted.cut and "Q" in fit.terms else None
    return (
        *(one for one in getattr(fit.deviation, "findings", ()) if one.code != "uneven"),  # said of the coefficients
        *_findings.of_model(fitted.misfit, shortest),
        *(() if model.solved.off < SETTLED else [_findings.FINDINGS("unsettled", cost=float(np.hypot(1.0, model.solved.off)))]),
        *_findings.of_lines(_lines(model)),
        *_findings.of_changes(model.changes, observed.factors, observed.covariance, sensor or "ratio", duration),
        *_findings.of_widening(wider, model.solved.names, duration),
        *_findings.of_doubts(doubts, rival, model.changes.instead if fit.presence.get("K") == "present" else None),
    )


def _lines(model: Described) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of the spectral lines in the band."""
    solved = model.solved
    lines = amplitudes(
        solved.bins, solved.lines >= LINE, density(solved.bins.columns, solved.fitted.theta), len(model.observed.y) * model.observed.dt
    )
    return [line for line in lines if line[1] <= solved.end]


def _fitted_spectrum(solved: Solved) -> FittedSpectrum:
    """Bins of the record and the model there. Bins without an ordinate and those of spectral lines are left out."""
    bins = solved.bins
    kept = (bins.weight > 0) & (bins.density > 0) & (solved.lines < LINE)
    model = density(solved.fitted.bins.columns, solved.fitted.theta)
    used = solved.fitted.bins.weight > 0
    frequency, level, model, edf, used = (
        np.asarray(values)[kept] for values in (bins.frequency, bins.density * bins.unit, model * bins.unit, bins.weight, used)
    )
    columns = {name: np.asarray(bins.columns)[kept, i] for i, name in enumerate(solved.names) if name != FILTER}
    return FittedSpectrum(frequency=frequency, density=level, model=model, edf=edf, used=used, columns=columns)


def _squares(solved: Solved, covariance, limits: Limits, terms: tuple[Term, ...], observed: Observed, confidence: float):
    """Squared coefficients in SI units in the order of `terms`, their covariance and limits.

    The slope of a ramp is the only factor of the mean. What the record does not determine is zero without an upper limit.
    """
    asked = [term.name for term in terms]
    p, names, unit = len(asked), solved.names, float(solved.bins.unit)
    own = solved.own
    where = [asked.index(names[i]) for i in own]
    squares, spread = np.zeros(p), np.zeros((p, p))
    ends = np.repeat([[0.0], [np.inf], [np.inf], [0.0]], p, axis=1)
    squares[where], spread[np.ix_(where, where)] = solved.fitted.theta[own] * unit, covariance[np.ix_(own, own)] * unit**2
    ends[:, where] = limits.scaled(unit)
    if "R" in asked:
        i, slope, error = asked.index("R"), float(observed.factors[0]), float(observed.covariance[0, 0]) ** 0.5
        squares[i], spread[i, i] = slope**2, (2.0 * slope * error) ** 2
        # the slope is a linear function of the record, and therefore normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels_of(confidence))
        ends[:, i] = max(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2, (slope / error) ** 2
    return squares, spread, Limits(*ends)
