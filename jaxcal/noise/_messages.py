"""Messages of a fit: octaves that it leaves out, warnings and notes."""

from collections.abc import Mapping, Sequence

import numpy as np

from .._arrays import runs
from ..allan import Deviation
from ._alternatives import Alternative, Alternatives
from ._causes import Cause
from ._model import Noise
from ._result import NoiseFit
from ._stationarity import PARTS, Level, Unevenness
from ._terms import PowerLaw

#: slope in standard errors above which a line in time is removed from the record, if R is among the terms
RAMP = 3.0
#: family of a cause -> its name in a sentence, and advice
_CAUSES = {
    "step": ("a step of {size} at {at:.4g} s", "find what moved or switched, and record without it"),
    "ramp": ("a straight line of {size} over the record", "add R to the terms, or wait until the sensor has settled"),
    "warm-up": (
        "a warm-up of {size} with a time constant of about {at:.3g} s",
        "after {trim:.3g} s less of it is left than its error; --start {trim:.3g} leaves that part out",
    ),
    "sinusoid": ("a sinusoid of {size} at about {at:.3g} Hz", "look for a periodic cause such as a heater or an air conditioner"),
    "temperature": ("the temperature, {size} per degree,", "correct the bias for temperature first"),
}
#: difference in twice the log-likelihood below which flicker and one Gauss-Markov process describe a record equally well
_ALIKE = 2.0
#: net gain that another model reaches in one of a hundred records of B and K
_CHANCE = 6.63
_DEPARTS = 0.01  # chance of a worse misfit below which a warning says how much wider the intervals are
_TOLD = 0.01  # share of a model in the result above which it is listed
#: difference of two estimates, in standard deviations, above which a warning is given
_APART = 3.0


def of_octaves(curve: Deviation, used, modelled, automatic: bool) -> tuple[str, ...]:
    """One sentence for each octave of cluster time that the fit leaves out, with the largest ratio of the curve to the model there."""
    octave = np.floor(np.log2(curve.m)).astype(int)
    ratio = curve.deviation / np.where(modelled > 0.0, modelled, 1.0)
    reason = "the model does not hold there" if automatic else "outside of the band asked for"
    said = []
    for number in np.unique(octave[~used]):
        these = ratio[(octave == number) & ~used]
        worst = these[np.argmax(np.abs(np.log(np.maximum(these, 1e-300))))]
        low, high = 2**number / curve.rate, 2 ** (number + 1) / curve.rate
        said.append(f"{low:.3g} to {high:.3g} s: {reason} (measured deviation {worst:.2f} times the model's)")
    return tuple(said)


def of_model(fit: NoiseFit, what: str, holds: bool, where: str, how: str, inflation: float, cut: bool, limit: str = "") -> list[str]:
    """Warnings if the model does not describe the spectrum or curve, and about terms that cannot be seen if the band was `cut`."""
    said, shortest = [], f"{float(fit.band[0]):.3g} s"
    if not holds:
        said.append(
            f"the noise model does not hold in {where} ({how}): the coefficients describe the {what} roughly, and the intervals are not "
            "to be relied on; look at the plot for vibration, temperature drift or steps"
        )
    elif inflation > 1.0 and float(fit.goodness) < _DEPARTS:
        said.append(
            f"the {what} departs from the model slightly, but by more than its noise allows (chance {float(fit.goodness):.1g}): the "
            f"intervals are widened {np.sqrt(inflation):.1f} times"
        )
    if cut and "Q" in fit.terms:
        said.append(f"Q was not fitted: it shows at cluster times below the {shortest} from which the fit starts{limit}")
    if cut and fit.verdict.get("N") == "not detected":
        said.append(f"N cannot be told from the other terms in the cluster times that are left, {shortest} and longer")
    return said


def of_curve(curve: Deviation, change: float) -> list[str]:
    """Warnings about the fit of a curve; `change` is the last change of the weights."""
    said = []
    if change > 1e-4:
        said.append(f"the weights of the fit have not settled (last change {change:.1g}); fit fewer terms or another band")
    lost = np.max(curve.skipped / (curve.skipped + curve.count))
    if lost > 0.0:
        said.append(
            f"gaps: up to {100 * lost:.2g} % of the differences at a cluster time touch a missing sample and were left out; the intervals "
            "allow for it"
        )
    return said


def of_record(y, dt: float, lines: list[tuple[float, float]]) -> list[str]:
    """Warnings about missing samples and spectral lines."""
    said, missing = [], np.isnan(y)
    if missing.any():
        starts, stops = runs(missing)
        lengths = (stops - starts) * dt
        many = f"{len(lengths)} gaps, the longest of {lengths.max():.3g} s" if len(lengths) > 1 else f"a gap of {lengths[0]:.3g} s"
        said.append(
            f"gaps: {100 * missing.mean():.2g} % of the samples are missing, in {many}; the fit uses the likelihood of the samples that "
            "are there, and the Allan deviation fills the gaps with noise of the fitted model"
        )
    if lines:
        shown = ", ".join(f"{frequency:.3g}" for _, frequency in lines[:6]) + (" and others" if len(lines) > 6 else "")
        said.append(f"spectral line{'s' if len(lines) > 1 else ''} at {shown} Hz: left out of the fit, and part of the model as sinusoids")
    return said


def of_causes(causes: Sequence[Cause], factors, covariance) -> list[str]:
    """Warnings about causes other than noise that were removed. `factors` and `covariance` belong to all columns of all causes."""
    said, first = [], 0
    for cause in causes:
        size, error = factors[first], float(np.sqrt(covariance[first, first]))
        if cause.family == "sinusoid":
            pair = slice(first, first + 2)
            size = float(np.hypot(*factors[pair]))
            error = float(np.sqrt(factors[pair] @ covariance[pair, pair] @ factors[pair])) / size
        first += 2 if cause.family == "sinusoid" else 1
        what, advice = _CAUSES[cause.family]
        if cause.family == "warm-up":
            advice = advice.format(trim=cause.at * max(float(np.log(abs(size) / error)), 1.0))
        said.append(
            f"{what.format(size=f'{size:.3g} +- {error:.2g}', at=cause.at)} explains the slow changes of the record better than noise "
            f"(likelihood ratio {cause.gain:.0f}): it is fitted together with the noise, and B and K stand for what remains; {advice}"
        )
    return said


def events_of_causes(causes: Sequence[Cause]) -> list[tuple[float, float, str]]:
    """(start in s, stop in s, word) for causes other than noise that act at a certain time, and not throughout the record."""
    found = []
    for cause in causes:
        if cause.family == "step":
            found.append((float(cause.at), float(cause.at), "step"))
        elif cause.family == "warm-up":
            found.append((0.0, float(cause.at), "warm-up"))
    return found


def events_of_parts(
    levels: Sequence[Level], uneven: dict[str, Unevenness], duration: float, dt: float
) -> list[tuple[float, float, str]]:  # fmt: skip
    """(start in s, stop in s, words) for parts of a record whose noise differs from that of the others."""
    found = [(part.start * dt, part.stop * dt, f"N times {part.ratio:.3g}") for part in levels]
    for what, terms in (("slow wandering", "BK"), ("white noise", "N")):
        if told := [uneven[term] for term in terms if term in uneven]:
            worst = min(told, key=lambda one: one.chance)
            found.append((duration * worst.part / PARTS, duration * (worst.part + 1) / PARTS, f"strong {what}"))
    return found


def of_alternatives(found: Alternatives, doubts: Mapping[str, Alternative], fit: NoiseFit) -> tuple[list[str], tuple[str, ...]]:
    """Warnings and notes about other models that explain the slow noise as well as B and K, or better."""
    said, notes = [], []
    if found.admitted:
        one, others = found.admitted, found.listed[1:]
        what, where = _described(one, fit, dict(found.shares)[one]), "beside" if one.family == "process beside" else "in place of"
        alike = [other for other in others if other.net > one.net - 2.0 * _ALIKE]
        named = [f"{_described(other)}{_beside(other)}" for other in alike]
        other = f"; {', or '.join(named)}, explains it nearly as well, and this record cannot tell which it is" if alike else ""
        kept = "" if found.undecided else ": the model has it now, and B and K stand for what remains"
        said.append(
            f"{what} {where} B and K explain{'s' if len(one.terms) == 1 else ''} the spectrum better than these alone (likelihood "
            f"ratio {one.gain:.1f}){kept}{other}{_shared(found, one)}"
        )
    elif found.rival is not None and found.rival.net > _CHANCE:
        one = found.rival
        said.append(
            f"{_described(one)} in place of B and K would explain the spectrum better (likelihood ratio {one.gain:.1f}), but not by so "
            f"much that B and K are excluded: the interval of N holds for both{_shared(found, one)}"
        )
    elif found.shares:
        one = found.shares[0][0]
        notes.append(
            f"{_described(one)}{_beside(one) or ' in place of B and K'} may explain the spectrum better, or its gain may be chance "
            f"(likelihood ratio {one.gain:.1f}){_shared(found, one)}"
        )
    if one := doubts.get("K"):
        behind = (found.admitted.net if found.admitted else 0.0) - one.net
        than = f"twice its log likelihood is {abs(behind):.1f} {'lower' if behind > 0.0 else 'higher'}"
        notes.append(f"K is a hint at most: {_described(one)} without K explains the record nearly as well ({than})")
    if one := doubts.get("B"):
        notes.append(f"B is a hint at most: B or {_described(one)}, this record cannot tell them apart")
    if not found.admitted and "B" not in doubts and fit.verdict.get("B") == "present":
        for one in found.listed:
            if one.family == "one process" and one.gain > -_ALIKE:
                notes.append(f"B or {_described(one)}: this record cannot tell them apart")
    return said, tuple(notes)


def _beside(one: Alternative) -> str:
    return " beside B and K" * (one.family == "process beside")


def _shared(found: Alternatives, named: Alternative) -> str:
    """The shares of the models of which the coefficients are means, if there are several; the sentence before names one of them."""
    if not found.undecided:
        return ""
    shares, rest = found.shares, 1.0 - sum(share for _, share in found.shares)
    again = "it" if len(named.terms) == 1 else "them"
    each = [f"{100 * share:.0f} % with {again if one is named else _described(one)}" for one, share in shares if share > _TOLD]
    each += [f"{100 * rest:.0f} % with B and K alone"] * (rest > _TOLD)
    return f". The record does not decide, so coefficients and intervals are means of the fits: {', '.join(each)}"


def _described(one: Alternative, fit: NoiseFit | None = None, share: float = 1.0) -> str:
    """Describe an alternative in words; with its strength, if a fit is given whose model contains a `share` of it."""
    if isinstance(one.terms[0], PowerLaw):
        return f"noise of exponent {one.terms[0].exponent:.2g} (flicker has 1, a random walk 2)"
    if fit is None:
        each = [f"{term.time:.2g} s" for term in one.terms]  # type: ignore[attr-defined]
    else:
        own = fit.noise.markov[: len(one.terms)]
        each = [f"{time:.2g} s (standard deviation {float(strength) * np.sqrt(time / 2.0 / share):.3g})" for strength, time in own]
    if len(each) == 1:
        return f"one Gauss-Markov process of correlation time {each[0]}"
    return f"{'two' if len(each) == 2 else 'three'} Gauss-Markov processes of correlation times {', '.join(each[:-1])} and {each[-1]}"


def of_markov(fit: NoiseFit) -> str:
    """A note about the Gauss-Markov process that was fitted."""
    ((strength, time),) = fit.noise.markov
    sigma = float(np.asarray(strength)) * np.sqrt(time / 2.0)
    return f"Gauss-Markov process of correlation time {time:.2g} s: {fit.verdict['markov']}, standard deviation {sigma:.3g} (SI units)"


def of_unevenness(uneven: dict[str, Unevenness], duration: float) -> list[str]:
    """Warnings if the evidence for a coefficient comes mainly from some parts of the record."""
    said = []
    for what, terms in (("slow wandering", "BK"), ("white noise", "N")):
        found = {term: uneven[term] for term in terms if term in uneven}
        if not found:
            continue
        worst = min(found.values(), key=lambda one: one.chance)
        factors = {term: f"{np.sqrt(max(one.factor, 1.0)):.1f}" for term, one in found.items()}
        wider = " and ".join(f"of {term} {factor} times" for term, factor in factors.items() if factor != "1.0")
        wider = f"this makes the intervals {wider} as wide" if wider else "the intervals grow by less than 5 % for it"
        start, stop = (duration * edge / PARTS for edge in (worst.part, worst.part + 1))
        said.append(
            f"the {what} is uneven in time (chance {worst.chance:.1g}): {100 * worst.share:.3g} % of it falls between {start:.4g} and "
            f"{stop:.4g} s, an eighth of the record; {wider}; look there for a knock, a draught or warming up"
        )
    return said


def of_levels(levels: Sequence[Level], n: float, dt: float) -> list[str]:
    """A warning if the white noise has several levels; `n` is the coefficient N of the whole record."""
    if not levels:
        return []
    each = ", ".join(
        f"{part.ratio * n:.4g} +- {part.ratio * n * part.error:.1g} from {part.start * dt:.4g} to {part.stop * dt:.4g} s" for part in levels
    )
    return [f"the level of the white noise changes: N is {each} (SI units); the N of the whole record is their root mean square"]


def of_difference(fit: NoiseFit, other: Noise, errors: dict[str, float]) -> list[str]:
    """Warnings if generalised least squares gives a different coefficient; `errors` are standard errors of its squared coefficients.

    Two efficient estimates from one record should differ by less than their standard deviations. The difference of the squared
    coefficients is compared with the larger of the two. Terms that the fit does not detect or did not estimate are skipped.
    """
    said = []
    for term, error in errors.items():
        index = fit.terms.index(term)
        own = float(np.sqrt(fit.covariance[index, index]))
        if fit.verdict[term] == "not detected" or own <= 0.0:
            continue
        first, second = (float(np.asarray(noise.coefficient(term))) for noise in (fit.noise, other))
        apart = abs(first**2 - second**2) / max(own, error)
        if apart > _APART:
            said.append(
                f"{term} is {first:.3g} by method {fit.method} and {second:.3g} by generalised least squares (SI units), {apart:.1f} "
                "standard deviations apart: the noise model does not describe this record, or the data were filtered; look at the plot"
            )
    return said
