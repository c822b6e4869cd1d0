"""What a noise fit has to say: one table of findings, and how they follow from the fit.

The cost of a finding is the factor by which it makes the error of N larger, or its interval wider; it is 0 for B and K alone.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._answer import CAUTION, NOTE, Finding, Kind, Quantity, table
from .._log_findings import LOG
from ._changes import Change, Changes

FINDINGS = table(
    # about the samples
    set_aside=Kind(
        NOTE, "Not at rest for {length:.3g} s ({share:.2g} %), from {first:.4g} s on: knocks, movement, stuck readings, left out.",
        limits=LOG["set_aside"].limits,
    ),
    coarse=Kind(
        CAUTION, "Readings come in steps of {step:.3g}, over twice the noise: no coefficient is reliable.",
        "Record with a finer resolution.", limits=(2.0,),  # B. Widrow et al., IEEE Trans. Instrum. Meas. 45, 1996
    ),
    constant=Kind(CAUTION, "Constant in every sample: the channel is dead, and has no noise."),
    rounding=Kind(NOTE, "Rounding makes {share:.0f} % of N squared; the sensor itself is quieter.", limits=(0.05,)),  # 2.5 % of N
    gaps=Kind(NOTE, "{share:.2g} % of the samples are missing; the fit uses the others."),
    stretch=Kind(NOTE, "Used: samples {start} to {stop}, the longest stretch without gaps."),
    # about the fit
    lines=Kind(NOTE, "Spectral lines at {frequencies} Hz are sinusoids of the model, and no part of the coefficients."),
    band=Kind(NOTE, "Cluster times below {shortest:.3g} s are left out because the model does not hold there, so Q is not known."),
    misfit=Kind(
        CAUTION, "The spectrum departs from the model {ratio:.2g} times as much as chance explains; intervals are wider for it.",
        "Look at the report for vibration or drift.", limits=(4.0,),
    ),
    unsettled=Kind(CAUTION, "The fit did not converge.", "Fit fewer terms ({option.terms:QNB}) or other cluster times ({option.band})."),
    no_intervals=Kind(CAUTION, "Method {method} gives no intervals and no limits.", "Fit with {option.method:whittle}."),
    correlated=Kind(  # of a log, if the whole interval lies beyond the limit
        NOTE, "White noise of axes {pair} is correlated: {rho:.4f} (between {low:.4f} and {high:.4f}).", limits=(0.05,),
    ),
    # about slow changes
    step=Kind(
        CAUTION, "The mean changes at {times} s, by up to {size:.2g}; this is fitted beside the noise, and B and K are of the rest.",
        "Find what moved or switched.", limits=(3.0,),  # size over its error from which an axis shows a change
    ),
    ramp=Kind(NOTE, "A drift of {size:.2g} over the record is fitted beside the noise."),
    warm_up=Kind(
        CAUTION, "A warm-up of {size:.2g}, with a time constant of {time:.3g} s, is fitted beside the noise; B and K are of the rest.",
        "Leave out the first {trim:.3g} s.", terminal="Leave it out with --start {trim:.3g}.",
    ),
    sinusoid=Kind(NOTE, "A sinusoid of {size:.2g}, with a period of {time:.3g} s, is fitted beside the noise; look for a heater or a fan."),
    temperature=Kind(NOTE, "The readings follow the temperature, by {size:.2g} per degree, which is fitted beside the noise."),
    rival=Kind(
        NOTE, "The slow noise has another spectrum than that of {terms}, by a factor of {factor:.2g}; take {terms} as a hint.",
        "noise.compare(y, rate) shows which.", terminal="See which with --compare.",
    ),
    instead=Kind(
        NOTE, "K may be {change} of the mean, which describes the record at least as well.", "Record longer, at a steady temperature.",
    ),
    uneven=Kind(
        CAUTION, "The {what} is uneven in time, largest between {start:.6g} and {stop:.6g} s; intervals are {factor:.2g} times as wide "
        "for it.", "Look there for a knock or a draught.", limits=(2.0,),
    ),
)  # fmt: skip
_MOST_LINES, _DRAWN = 4, 256  # frequencies that one sentence names; points of the course of a change


def of_model(misfit: float, shortest: float | None) -> list[Finding]:
    """Whether the model describes the record, and the `shortest` cluster time of the fit if it leaves shorter ones out."""
    return FINDINGS.over("misfit", misfit, ratio=misfit) + ([] if shortest is None else [FINDINGS("band", shortest=shortest)])


def of_lines(lines: Sequence[tuple[float, float]]) -> list[Finding]:
    """The (amplitude, frequency) of spectral lines."""
    if not lines:
        return []
    shown = ", ".join(f"{frequency:.3g}" for _, frequency in lines[:_MOST_LINES]) + " and more" * (len(lines) > _MOST_LINES)
    return [FINDINGS("lines", frequencies=shown)]


def of_changes(changes: Changes, factors: Any, covariance: Any, unit: str, duration: float) -> list[Finding]:
    """Changes of the mean that were fitted; `factors` and `covariance` are of all columns of all changes, in `unit`.

    An axis is silent about a change of other axes that it does not show itself.
    """
    found, steps, first, times = [], [], 0, np.linspace(0.0, duration, _DRAWN)
    for change in changes.fitted:
        x = change.columns(times)
        columns = slice(first, first + x.shape[1])
        first, course = columns.stop, x @ factors[columns]
        largest = x[np.argmax(course)] - x[np.argmin(course)]
        largest = largest / {"sinusoid": 2.0, "temperature": np.ptp(x)}.get(change.family, 1.0)
        size, error = abs(float(largest @ factors[columns])), float(np.sqrt(largest @ covariance[columns, columns] @ largest))
        shown = change in changes.likely and size > FINDINGS["step"].limits[0] * error
        if change.family == "shift" or not shown:  # a shift is part of what was set aside
            continue
        if change.family == "step":
            steps.append((change.start, size, error))
            continue
        code = change.family
        facts: dict[str, Any] = {"time": change.time}
        if code == "warm_up":
            # one of two time constants has lasted for one when all but exp(-1) of it is over
            time, trim = (float(times[np.abs(course - course[-1]) > rest][-1]) for rest in (np.exp(-1.0) * size, error))
            code, facts = "ramp" if time > 0.5 * duration else code, {"time": time, "trim": trim}
        found.append(FINDINGS(code, size=Quantity(size, unit), **facts))
    if steps:
        at, size = ", ".join(f"{start:.4g}" for start, *_ in sorted(steps)), max(size for _, size, _ in steps)
        found.append(FINDINGS("step", times=at, size=Quantity(size, unit), steps=sorted(steps)))
    return found


def of_doubts(doubts: Sequence[str], apart: float, instead: Change | None) -> list[Finding]:
    """Why terms are hints at most, by which rms logarithm the spectrum is `apart` from theirs, and what a present K may be instead."""
    if doubts:
        return [FINDINGS("rival", terms=" and ".join(doubts), factor=float(np.exp(apart)))]
    what = {"step": "a change", "warm_up": "a warm-up or drift", "sinusoid": "a sinusoid", "temperature": "an effect of temperature"}
    return [FINDINGS("instead", change=what[instead.family])] if instead else []


def of_widening(wider: Any, loudest: Any, names: Sequence[str], duration: float) -> list[Finding]:
    """The coefficient of a channel whose evidence is most uneven in time, white noise before slow noise; see `Widening`."""
    for what, terms, severity in (("white noise", "N", CAUTION), ("slow noise", "BK", NOTE)):
        told = [(wider[i], part) for i, part in enumerate(loudest.tolist()) if names[i] in terms and part[0] == part[0]]
        factor, part = max(told, key=lambda one: one[0], default=(1.0, (0.0, 1.0)))
        start, stop, factor = part[0] * duration, part[1] * duration, float(np.sqrt(factor))
        if factor > FINDINGS["uneven"].limits[0]:
            return [FINDINGS("uneven", cost=factor, severity=severity, what=what, start=start, stop=stop, factor=factor)]
    return []


def events_of(changes: Sequence[Change]) -> tuple[tuple[float, float, str], ...]:
    """(start in s, stop in s, words) for what acts in one part of the record only, to be marked in a drawing of it."""
    words = {"step": "step", "warm_up": "warm-up"}
    inside = [one for one in changes if one.family in words and np.isfinite(one.time)]
    return tuple(sorted((one.start, one.start + one.time, words[one.family]) for one in inside))
