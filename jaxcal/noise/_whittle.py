"""Method "whittle": one channel in, one `NoiseFit` out."""

import dataclasses

import equinox as eqx
import numpy as np

from .._errors import DataError, FitError
from .._types import AnyArray
from ..allan import Deviation
from ._assemble import assemble, with_edf
from ._covariance import covariance_tensor
from ._drift import follows
from ._likelihood import density
from ._limits import Limits, levels_of
from ._lines import amplitudes, find_lines
from ._markov import PRESENT, Scan, scan, times
from ._model import noise_of
from ._ordinates import Bins, bins_of, stretches
from ._result import NoiseFit
from ._sentences import sentences_of_octaves, sentences_of_spectrum, sentences_of_unevenness
from ._spectral import FILTER, Fitted, attempt, fit_bins, fit_whole, groups_of, uncertainty, without
from ._stationarity import ORDINATES, Unevenness, unevenness, unevenness_of_level
from ._terms import Filter, GaussMarkov, Ramp, Term

_RAMP, _TEMPERATURE = 3.0, 4.0  # standard errors above which a record follows a line in time, and its temperature
_ALIKE = 2.0  # likelihood ratio within which flicker and one Gauss-Markov process are alike
_MOST = 0.8  # share of the record that a stretch must have to stand for it
_SHORTEST_STRETCH = 256


class Solved(eqx.Module):
    """A record's bins, which of them lines occupy, and the fit; `columns` are the terms of its columns."""

    bins: Bins
    taken: AnyArray
    fitted: Fitted
    columns: tuple[Term, ...] = eqx.field(static=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the columns."""
        return tuple(term.name for term in self.columns)

    @property
    def end(self) -> float:
        """Highest frequency of the band in Hz, infinite where the band was not cut."""
        if not bool(self.fitted.cut):
            return np.inf
        return float(np.max(np.where(self.fitted.bins.weight > 0, self.fitted.bins.frequency, 0.0)))

    def leading(self, n: int, dt: float):
        """The columns at the first ordinates of n samples, and their density."""
        k = np.arange(1, min(ORDINATES, n - 1) + 1)
        columns = np.stack([term.ordinates(k, n, dt) for term in self.columns], axis=1)
        return columns, columns @ self.fitted.theta * float(self.bins.unit)

    def share(self, term: str, n: int, dt: float):
        """Share of a term in the density at the ordinates of n samples up to the end of the band, 0 in lines; and the density."""
        bins, index = self.fitted.bins, self.names.index(term)
        there = np.asarray(bins.frequency) <= min(self.end, 0.5 / dt)
        frequency, columns = np.asarray(bins.frequency)[there], np.asarray(bins.columns)[there]
        model = columns @ np.asarray(self.fitted.theta)
        part = np.where(np.asarray(bins.weight)[there] > 0, columns[0, index] * float(self.fitted.theta[index]) / model, 0.0)
        # the bins lie end to end: each goes half way to the next, the last to its own end
        edges = np.sqrt(frequency[1:] * frequency[:-1]) * 2.0 * n * dt
        last = int(np.asarray(self.bins.weight)[there][-1] / 2.0 + frequency[-1] * 2.0 * n * dt)
        counts = np.diff(np.concatenate([[0], np.floor(edges), [min(max(last, 1), n - 1)]])).astype(np.int64)
        counts = np.maximum(counts, 0)
        return np.repeat(part, counts), np.repeat(model * float(self.bins.unit), counts)


def fit_record(
    y, curve: Deviation, terms: tuple[Term, ...], band: tuple[float, float] | None, confidence: float, temperature=None
) -> NoiseFit:
    """Fit one channel by its likelihood.

    Parameters
    ----------
    y : (n,) samples; NaN marks a gap.
    curve : its overlapped Allan deviation, for the plot and for cluster times left out.
    terms : the terms; a Gauss-Markov process without correlation time is given that of the highest likelihood.
    band : cluster times in s to fit, or None to find the band.
    confidence : level of the intervals.
    temperature : (n,) or None; whether the record follows it.
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
    slope, error = _follows(y, np.arange(n) * dt, solved, dt)
    ramp = abs(slope) > _RAMP * error
    if ramp and ramps:
        y = y - slope * dt * np.arange(n)
        solved = _solve(y, dt, base, band)
    warm = (0.0, np.inf) if temperature is None else _follows(y, temperature, solved, dt)
    tried = scan(solved.fitted, times(dt, n * dt), dt, np.array([float(name == "B") for name in solved.names]))
    widened = float(solved.fitted.inflation)
    tried = Scan(tried.time, tried.gain / widened, tried.instead / widened)
    time = float(tried.time[np.argmax(tried.gain)])
    if sought:
        solved = _solve(y, dt, (*base, GaussMarkov(time=time, name=sought[0].name)), band)
        terms = tuple(solved.columns[-2] if term in sought else term for term in terms)
    names = solved.names
    uneven = _uneven(y, solved, dt)
    widened = np.array([max(uneven[name].factor, 1.0) if name in uneven else 1.0 for name in names])
    covariance, limits, factor = uncertainty(solved.fitted, widened, *levels_of(confidence), names)
    decides = {name: float(factor[names.index(name)]) * n * dt for name in asked if name in names}
    theta, unit = solved.fitted.theta, float(solved.bins.unit)
    if not np.all(np.isfinite(theta)):
        raise FitError("the fit gave no finite coefficients; fit fewer terms (terms=) or other cluster times (band=)")
    theta, covariance, limits = _squares(
        theta * unit, covariance * unit**2, limits.scaled(unit), names, asked, (slope, error), bool(solved.fitted.cut), confidence
    )
    lines = amplitudes(solved.bins, solved.taken, density(solved.bins.columns, solved.fitted.theta), n * dt)
    lines = [line for line in lines if line[1] <= solved.end]
    used = _used(curve, solved, band)
    ends = float(curve.tau[used].min()), float(curve.tau[used].max())
    found = assemble(
        theta, covariance, limits, terms, n * dt, sinusoid=lines, decides=decides, goodness=float(solved.fitted.goodness),
        confidence=confidence, method="whittle", deviation=curve, used=used, left_out=(), warnings=(), band=ends,
    )  # fmt: skip
    modelled = np.asarray(found.noise.avar(curve.tau, dt=dt))
    sentences = [
        *curve.warnings,
        *_gaps(y, dt),
        *sentences_of_spectrum(found, solved.fitted, lines, band is None),
        *_drifts(ramp and not ramps, slope / error, warm[0] / warm[1]),
        *_beside(tried, bool(sought)),
        *sentences_of_unevenness(uneven, n * dt),
    ]
    notes = _instead(tried, bool(sought), found.verdict.get("B"))
    curve = with_edf(curve, used, _model_edf(curve, found, modelled, base, n))
    left_out = sentences_of_octaves(curve, used, np.sqrt(modelled), band is None)
    if "markov" in asked:
        found, notes = _apart(found), (*notes, _described(found))
    return dataclasses.replace(found, deviation=curve, left_out=left_out, warnings=tuple(sentences), notes=notes)


def fit_traced(y, rate: float, terms: tuple[Term, ...], band: tuple[float, float] | None, confidence: float) -> NoiseFit:
    """The same for a traced record: no checks, no choice of the band, no lines; differentiable."""
    if any(_is_ramp(term) or _is_sought(term) for term in terms):
        raise DataError("a traced record is fitted without R and markov; these are found by a search, which cannot be traced")
    names = tuple(term.name for term in terms)
    bins = _inside(bins_of(y, 1.0 / rate, terms), band)
    fitted = fit_whole(bins, groups_of(bins.weight, y.shape[0] - 1))
    covariance, limits, _ = uncertainty(fitted, np.ones(len(terms)), *levels_of(confidence), names)
    duration = y.shape[0] / rate
    ends = (1.0 / rate, duration / 2.0) if band is None else band
    return assemble(
        fitted.theta * bins.unit, covariance * bins.unit**2, limits.scaled(bins.unit), terms, duration, goodness=fitted.goodness,
        confidence=confidence, method="whittle", deviation=None, used=None, left_out=(), warnings=(), band=ends,
    )  # fmt: skip


def _inside(bins: Bins, band) -> Bins:
    """The bins with weight only in the band: cluster time tau stands for the frequency 1/(2 tau)."""
    if band is None:
        return bins
    within = (bins.frequency >= 0.5 / band[1] * (1 - 1e-9)) & (bins.frequency <= 0.5 / band[0] * (1 + 1e-9))
    return eqx.tree_at(lambda b: b.weight, bins, bins.weight * within)


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
    clear = eqx.tree_at(lambda b: b.weight, bins, np.where(taken, 0.0, bins.weight))
    return Solved(bins, taken, fit_bins(clear, group, band is None, names, None if taken.any() else first), columns)


def _follows(y, regressor, solved: Solved, dt: float) -> tuple[float, float]:
    """How the longest gap-free stretch follows a regressor; not told where that is less than most of the record."""
    longest = _most(y)
    if longest is None or not np.all(np.isfinite(regressor[longest])):
        return 0.0, np.inf
    return follows(y[longest], regressor[longest], solved.leading(longest.stop - longest.start, dt)[1], dt)


def _uneven(y, solved: Solved, dt: float) -> dict[str, Unevenness]:
    """How uneven in time B and K are, where either is; not looked at where no gap-free stretch is most of the record."""
    longest = _most(y)
    if longest is None or longest.stop - longest.start < _SHORTEST_STRETCH:
        return {}
    columns, density = solved.leading(longest.stop - longest.start, dt)
    names = solved.names
    found = {term: unevenness(y[longest], columns[:, names.index(term)], density, dt) for term in ("B", "K") if term in names}
    found = found if any(term.told for term in found.values()) else {}
    share, density = solved.share("N", longest.stop - longest.start, dt) if "N" in names else (np.zeros(1), np.ones(1))
    level = unevenness_of_level(y[longest], share, density, dt) if np.any(share > 0.0) else None
    return found | ({"N": level} if level is not None and level.told else {})


def _most(y) -> slice | None:
    """The longest gap-free stretch, where it is most of the record."""
    longest = stretches(y)[0]
    return longest if longest.stop - longest.start >= _MOST * len(y) else None


def _squares(theta, covariance, limits: Limits, names, terms, ramp: tuple[float, float], cut: bool, confidence: float):
    """Squared coefficients in the order of `terms`: with the ramp among them, and Q not estimated where its octaves are left out."""
    slope, error = ramp
    p = len(terms)
    own = [i for i, name in enumerate(names) if name != FILTER]
    where = [terms.index(names[i]) for i in own]
    squares, spread = np.zeros(p), np.zeros((p, p))
    ends = {name: np.zeros(p) for name in ("low", "high", "upper", "significance")}
    squares[where], spread[np.ix_(where, where)] = theta[own], covariance[np.ix_(own, own)]
    for name, values in ends.items():
        values[where] = getattr(limits, name)
    if "R" in terms:
        i = terms.index("R")
        squares[i], spread[i, i] = slope**2, (2.0 * slope * error) ** 2
        # a straight line is linear in the record: the slope is normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels_of(confidence))
        ends["low"][i], ends["high"][i], ends["upper"][i] = max(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2
        ends["significance"][i] = (slope / error) ** 2
    if cut and "Q" in terms:
        i = terms.index("Q")
        squares[i] = ends["low"][i] = ends["significance"][i] = 0.0
        spread[i, :] = spread[:, i] = 0.0
    return squares, spread, Limits(**ends)


def _used(curve: Deviation, solved: Solved, band) -> np.ndarray:
    """Cluster sizes that the band stands for; at least the longest."""
    used = np.asarray(curve.tau) >= (0.5 / solved.end) * (1 - 1e-9)
    if band is not None:
        used &= (curve.tau >= band[0] * (1 - 1e-9)) & (curve.tau <= band[1] * (1 + 1e-9))
    if not used.any():
        used[-1] = True
    return used


def _model_edf(curve: Deviation, found: NoiseFit, modelled, terms: tuple[Term, ...], n: int):
    """Degrees of freedom of the curve under the fitted terms; `modelled` is the Allan variance of all of the model."""
    values = [found.noise.coefficient(term.name) for term in terms]
    squares = np.array([float(np.asarray(value)) ** 2 for value in values])
    tensor = np.diagonal(covariance_tensor(n, tuple(int(m) for m in curve.m), 1.0 / curve.rate, terms), axis1=2, axis2=3)
    variance = np.einsum("i,ijm,j->m", squares, tensor, squares)
    if found.noise.markov or found.noise.sinusoid or "R" in found.terms:
        modelled = np.asarray(noise_of(terms, values).avar(curve.tau, dt=1.0 / curve.rate))
    return 2.0 * modelled**2 / np.where(variance > 0.0, variance, np.inf)


def _gaps(y, dt: float) -> list[str]:
    parts = [part.stop - part.start for part in stretches(y)]
    lost = 1.0 - sum(parts) / len(y)
    if lost <= 0.0:
        return []
    return [
        f"gaps: {100 * lost:.2g} % of the record is missing or in stretches too short to use; {len(parts)} stretches are left, and nothing "
        f"slower than the longest of them, {max(parts) * dt:.3g} s, is seen"
    ]


def _apart(found: NoiseFit) -> NoiseFit:
    """The fit with the process beside the terms proper: `terms` and `covariance` are of these alone."""
    kept = [i for i, term in enumerate(found.terms) if term != "markov"]
    return dataclasses.replace(found, terms=tuple(found.terms[i] for i in kept), covariance=found.covariance[np.ix_(kept, kept)])


def _described(found: NoiseFit) -> str:
    """A sentence on the Gauss-Markov process."""
    ((strength, time),) = found.noise.markov
    sigma = float(np.asarray(strength)) * np.sqrt(time / 2.0)
    return f"Gauss-Markov process of correlation time {time:.2g} s: {found.verdict['markov']}, standard deviation {sigma:.3g} (SI units)"


def _drifts(ramp: bool, slope: float, warm: float) -> list[str]:
    said = []
    if ramp:
        said.append(
            f"the record follows a straight line ({abs(slope):.1f} standard errors): B and K take part of it; add R to the terms, or "
            "remove its cause"
        )
    if abs(warm) > _TEMPERATURE:
        said.append(
            f"the record follows its temperature ({abs(warm):.1f} standard errors): correct the bias for temperature first, for B and K "
            "take part of it"
        )
    return said


def _beside(tried: Scan, fitted: bool) -> list[str]:
    best = int(np.argmax(tried.gain))
    if fitted or not tried.gain[best] > PRESENT:
        return []
    return [
        f"a Gauss-Markov process of correlation time about {tried.time[best]:.2g} s beside the other terms explains the spectrum better "
        f"(likelihood ratio {tried.gain[best]:.1f}): B and K take part of it; add markov to the terms"
    ]


def _instead(tried: Scan, fitted: bool, flicker: str | None) -> tuple[str, ...]:
    best = int(np.argmax(tried.instead))
    if fitted or flicker != "present" or tried.gain.max() > PRESENT or not tried.instead[best] > -_ALIKE:
        return ()
    return (f"B or one Gauss-Markov process of correlation time about {tried.time[best]:.2g} s: this record cannot tell them apart",)
