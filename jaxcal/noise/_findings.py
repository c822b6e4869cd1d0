"""What a noise fit has to say: one table of findings, and how they follow from the fit.

The cost of a finding is the factor by which it makes the error of N larger, or its interval wider; it is below 1 for B and K alone.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from .._answer import CAUTION, NOTE, Finding, Kind, Quantity, table
from ..allan import Deviation
from ._alternatives import Alternative, Alternatives
from ._causes import Cause
from ._stationarity import PARTS, Level, Unevenness
from ._terms import PowerLaw

_LEAVE_OUT = "Leave that part of the log out."
_WITH_OPTIONS = "Leave that part out with --start or --stop."
FINDINGS = table(
    # about the samples
    spikes=Kind(NOTE, "{count} single outliers were replaced by the mean of their neighbours."),
    tails=Kind(
        CAUTION, "{share:.2g} % of the samples are outliers, so the interval of N is too narrow.", "Fit the core with {option.robust:True}."
    ),
    jumps=Kind(CAUTION, "{count} sudden steps, the first at {at:.4g} s, count as slow noise.", _LEAVE_OUT, terminal=_WITH_OPTIONS),
    coarse=Kind(
        CAUTION, "Readings come in steps of {step:.3g}, over twice the noise: no coefficient is reliable.",
        "Record with a finer resolution.",
    ),
    rounding=Kind(NOTE, "Rounding makes {share:.0f} % of N squared; the sensor itself is quieter."),
    gaps=Kind(NOTE, "{share:.2g} % of the samples are missing; the fit uses the others."),
    stretch=Kind(NOTE, "Used: samples {start} to {stop}, the longest stretch without gaps."),
    # about the fit
    lines=Kind(NOTE, "Spectral lines at {frequencies} Hz are sinusoids of the model, and no part of the coefficients."),
    band=Kind(NOTE, "Cluster times below {shortest:.3g} s are left out because the model does not hold there, so Q is not known."),
    misfit=Kind(
        CAUTION, "The record scatters {ratio:.2g} times as much as the model allows, so the intervals are not reliable.",
        "Look at the report for vibration, drift or steps.",
    ),
    wider=Kind(NOTE, "The record scatters more than the model allows; the intervals are {factor:.2g} times as wide for it."),
    unsettled=Kind(CAUTION, "The fit did not converge.", "Fit fewer terms ({option.terms:QNB}) or other cluster times ({option.band})."),
    no_intervals=Kind(CAUTION, "Method {method} gives no intervals and no limits.", "Fit with {option.method:whittle}."),
    heavy=Kind(NOTE, "The white noise has heavy tails: {law}. N is that of {of}."),
    correlated=Kind(NOTE, "White noise of axes {pair} is correlated: {rho:.2f} (between {low:.2f} and {high:.2f})."),
    # about slow changes
    step=Kind(
        CAUTION, "Steps at {times} s, of up to {size:.2g}, are fitted beside the noise; B and K are of the rest.",
        "Find what moved or switched.",
    ),
    ramp=Kind(NOTE, "A drift of {size:.2g} over the record is fitted beside the noise."),
    warm_up=Kind(
        CAUTION, "A warm-up of {size:.2g}, with a time constant of {time:.2g} s, is fitted beside the noise; B and K are of the rest.",
        "Leave out the first {trim:.3g} s.", terminal="Leave it out with --start {trim:.3g}.",
    ),
    sinusoid=Kind(NOTE, "A sinusoid of {size:.2g} at {frequency:.3g} Hz is fitted beside the noise; look for a heater or a fan."),
    temperature=Kind(NOTE, "The readings follow the temperature, by {size:.2g} per degree, which is fitted beside the noise."),
    other_noise=Kind(
        CAUTION, "The slow noise is rather {model} than B and K{shares}, which are of the rest.", "A filter needs the whole model."
    ),
    rival=Kind(NOTE, "The slow noise may be {model} in place of B and K{shares}; intervals and hints allow for it."),
    uneven=Kind(
        CAUTION, "The {what} is uneven: {share:.0f} % of it falls between {start:.6g} and {stop:.6g} s; intervals are {factor:.2g} times "
        "as wide for it.", "Look there for a knock or a draught.",
    ),
    level=Kind(
        CAUTION, "The white noise changes: N is {least:.2g} to {most:.2g} times the value given, largest from {start:.6g} to {stop:.6g} s.",
        _LEAVE_OUT, terminal=_WITH_OPTIONS,
    ),
)  # fmt: skip
#: chance of a worse misfit below which a note says how much wider the intervals are
_DEPARTS = 0.01
#: share of a model in the mean below which it is not named
_TOLD = 0.01
#: net gain in twice the log likelihood that another model reaches in one of a hundred records of B and K
_CHANCE = 6.63
_SLOW = 0.5  # cost of what concerns B and K alone
_MOST_LINES = 4  # frequencies that one sentence names


def of_model(holds: bool, goodness: float, inflation: float, shortest: float | None) -> list[Finding]:
    """Whether the model describes the record, and the `shortest` cluster time of the fit if it leaves shorter ones out."""
    found = []
    if not holds:
        found.append(FINDINGS("misfit", cost=inflation, ratio=inflation))
    elif inflation > 1.0 and goodness < _DEPARTS:
        found.append(FINDINGS("wider", cost=inflation, factor=float(np.sqrt(inflation))))
    if shortest is not None:
        found.append(FINDINGS("band", cost=_SLOW, shortest=shortest))
    return found


def of_record(y: Any, lines: Sequence[tuple[float, float]]) -> list[Finding]:
    """Missing samples, and the (amplitude, frequency) of spectral lines."""
    lost, found = 100.0 * float(np.isnan(y).mean()), []
    if lost:
        found.append(FINDINGS("gaps", cost=lost / 100.0, share=lost))
    if lines:
        shown = ", ".join(f"{frequency:.3g}" for _, frequency in lines[:_MOST_LINES]) + " and more" * (len(lines) > _MOST_LINES)
        found.append(FINDINGS("lines", cost=_SLOW, frequencies=shown))
    return found


def of_curve(curve: Deviation) -> list[Finding]:
    """Missing samples, by the largest share of differences at a cluster time that they touch."""
    lost = 100.0 * float(np.max(curve.skipped / (curve.skipped + curve.count)))
    return [FINDINGS("gaps", cost=lost / 100.0, share=lost)] if lost else []


def of_causes(causes: Sequence[Cause], factors: Any, covariance: Any, unit: str) -> list[Finding]:
    """Causes other than noise that were fitted; `factors` and `covariance` are of all columns of all causes, in `unit`."""
    found, steps, first = [], [], 0
    for cause in causes:
        columns = slice(first, first + (2 if cause.family == "sinusoid" else 1))
        size = float(np.hypot.reduce(factors[columns]))
        error = float(np.sqrt(factors[columns] @ covariance[columns, columns] @ factors[columns])) / size if size else np.inf
        first, known = columns.stop, Quantity(size, unit)
        if cause.family == "step":
            steps.append((float(cause.at), size, error))
        elif cause.family == "warm-up":
            trim = cause.at * max(float(np.log(size / error)), 1.0)
            found.append(FINDINGS("warm_up", cost=_SLOW, size=known, time=float(cause.at), trim=trim))
        else:
            found.append(FINDINGS(cause.family, cost=_SLOW, size=known, frequency=float(cause.at)))
    if steps:
        times, size = ", ".join(f"{at:.4g}" for at, *_ in sorted(steps)), max(size for _, size, _ in steps)
        found.append(FINDINGS("step", cost=_SLOW, times=times, size=Quantity(size, unit), steps=sorted(steps)))
    return found


def of_alternatives(found: Alternatives, doubts: Iterable[Alternative]) -> list[Finding]:
    """Other models that explain the slow noise better than B and K, or about as well."""
    if found.admitted:
        one = found.admitted
        return [FINDINGS("other_noise", cost=_SLOW, model=described(one), shares=_share(found, one))]
    rivals = [*doubts, *([found.rival] if found.rival is not None and found.rival.net > _CHANCE else [one for one, _ in found.shares])]
    return [FINDINGS("rival", cost=_SLOW, model=described(one), shares=_share(found, one)) for one in rivals[:1]]


def _share(found: Alternatives, one: Alternative) -> str:
    """Share of a model in the result, if the result is a mean of several."""
    share = next((share for other, share in found.shares if other is one), 0.0) if found.undecided else 0.0
    return f" (share {100 * share:.0f} %)" if share > _TOLD else ""


def described(one: Alternative) -> str:
    """An alternative in words."""
    if isinstance(one.terms[0], PowerLaw):
        return f"noise of exponent {one.terms[0].exponent:.2g}"
    times = [f"{getattr(term, 'time'):.2g}" for term in one.terms]  # noqa: B009
    listed = f"{', '.join(times[:-1])} and {times[-1]}" if len(times) > 1 else times[0]
    return f"{'a Gauss-Markov process' if len(times) == 1 else 'Gauss-Markov processes'} of {listed} s"


def of_parts(levels: Sequence[Level], uneven: dict[str, Unevenness], duration: float, dt: float) -> list[Finding]:
    """White noise of several levels, and coefficients whose evidence comes mainly from one part of the record."""
    found = []
    if levels:
        largest, ratios = max(levels, key=lambda part: part.ratio), [part.ratio for part in levels]
        ends = {"start": largest.start * dt, "stop": largest.stop * dt, "ratios": ratios}
        found.append(FINDINGS("level", cost=max(ratios), least=min(ratios), most=max(ratios), **ends))
    for what, terms, severity in (("slow wandering", "BK", NOTE), ("white noise", "N", CAUTION)):
        if told := [uneven[term] for term in terms if term in uneven]:
            worst, factor = min(told, key=lambda one: one.chance), float(np.sqrt(max([1.0, *(one.factor for one in told)])))
            start, stop = (duration * edge / PARTS for edge in (worst.part, worst.part + 1))
            found.append(
                FINDINGS(
                    "uneven", cost=factor, severity=severity, what=what, share=100 * worst.share, start=start, stop=stop, factor=factor
                )
            )
    return found


def events_of(
    causes: Sequence[Cause], levels: Sequence[Level], uneven: dict[str, Unevenness], duration: float, dt: float
) -> tuple[tuple[float, float, str], ...]:
    """(start in s, stop in s, words) for what acts in one part of the record only, to be marked in a drawing of it."""
    found = [(float(one.at), float(one.at), "step") for one in causes if one.family == "step"]
    found += [(0.0, float(one.at), "warm-up") for one in causes if one.family == "warm-up"]
    found += [(part.start * dt, part.stop * dt, f"N times {part.ratio:.3g}") for part in levels]
    for what, terms in (("slow wandering", "BK"), ("white noise", "N")):
        for one in [uneven[term] for term in terms if term in uneven][:1]:
            found.append((duration * one.part / PARTS, duration * (one.part + 1) / PARTS, f"strong {what}"))
    return tuple(found)
