"""What a noise fit has to say: one table of findings, and how they follow from the fit.

The cost of a finding is the factor by which it makes the error of N larger, or its interval wider; it is below 1 for B and K alone.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._answer import CAUTION, NOTE, Finding, Kind, Quantity, table
from ._changes import Change, Changes
from ._errors import Widening
from ._rival import Rival

_LEAVE_OUT = "Leave that part of the log out."
_WITH_OPTIONS = "Leave that part out with --start or --stop."
FINDINGS = table(
    # about the samples
    set_aside=Kind(
        NOTE, "Not at rest for {length:.3g} s ({share:.2g} %), from {first:.4g} s on: knocks, movement, stuck readings, left out."
    ),
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
        CAUTION, "The spectrum departs from the model {ratio:.2g} times as much as chance explains; intervals are wider for it.",
        "Look at the report for vibration or drift.",
    ),
    unsettled=Kind(CAUTION, "The fit did not converge.", "Fit fewer terms ({option.terms:QNB}) or other cluster times ({option.band})."),
    no_intervals=Kind(CAUTION, "Method {method} gives no intervals and no limits.", "Fit with {option.method:whittle}."),
    correlated=Kind(NOTE, "White noise of axes {pair} is correlated: {rho:.2f} (between {low:.2f} and {high:.2f})."),
    # about slow changes
    step=Kind(
        CAUTION, "The mean changes at {times} s, by up to {size:.2g}; this is fitted beside the noise, and B and K are of the rest.",
        "Find what moved or switched.",
    ),
    ramp=Kind(NOTE, "A drift of {size:.2g} over the record is fitted beside the noise."),
    warm_up=Kind(
        CAUTION, "A warm-up of {size:.2g}, with a time constant of {time:.2g} s, is fitted beside the noise; B and K are of the rest.",
        "Leave out the first {trim:.3g} s.", terminal="Leave it out with --start {trim:.3g}.",
    ),
    sinusoid=Kind(NOTE, "A sinusoid of {size:.2g} at {frequency:.3g} Hz is fitted beside the noise; look for a heater or a fan."),
    temperature=Kind(NOTE, "The readings follow the temperature, by {size:.2g} per degree, which is fitted beside the noise."),
    rival=Kind(
        NOTE, "The slow noise has another spectrum than {terms}, by a factor of {factor:.2g}: {terms} is a hint.",
        "noise.compare(y, rate) shows which.", terminal="See which with --compare.",
    ),
    instead=Kind(
        NOTE, "K is a hint: {change} of the mean describes the record about as well.", "Record longer, at a steady temperature.",
    ),
    uneven=Kind(
        CAUTION, "The {what} is uneven in time, largest between {start:.6g} and {stop:.6g} s; intervals are {factor:.2g} times as wide "
        "for it.", "Look there for a knock or a draught.",
    ),
)  # fmt: skip
#: relative error of the size of a change from which an axis shows it; factor on an interval from which it is worth a sentence; ratio of the
#: misfit of the spectrum to its expectation above which the model does not hold
_SHOWN, _UNEVEN, _TOO_WIDE = 0.33, 2.0, 4.0
#: cost of what concerns B and K alone; frequencies that one sentence names
_SLOW, _MOST_LINES = 0.5, 4


def of_model(misfit: float, shortest: float | None) -> list[Finding]:
    """Whether the model describes the record, and the `shortest` cluster time of the fit if it leaves shorter ones out."""
    found = [FINDINGS("misfit", cost=misfit, ratio=misfit)] if misfit > _TOO_WIDE else []
    return found if shortest is None else [*found, FINDINGS("band", cost=_SLOW, shortest=shortest)]


def of_lines(lines: Sequence[tuple[float, float]]) -> list[Finding]:
    """The (amplitude, frequency) of spectral lines."""
    if not lines:
        return []
    shown = ", ".join(f"{frequency:.3g}" for _, frequency in lines[:_MOST_LINES]) + " and more" * (len(lines) > _MOST_LINES)
    return [FINDINGS("lines", cost=_SLOW, frequencies=shown)]


def of_changes(changes: Sequence[Change], factors: Any, covariance: Any, unit: str) -> list[Finding]:
    """Changes of the mean that were fitted; `factors` and `covariance` are of all columns of all changes, in `unit`.

    An axis is silent about a change of other axes that it does not show itself.
    """
    found, steps, first = [], [], 0
    for change in changes:
        columns = slice(first, first + (2 if change.family == "sinusoid" else 1))
        size = float(np.hypot.reduce(factors[columns]))
        error = float(np.sqrt(factors[columns] @ covariance[columns, columns] @ factors[columns])) / size if size else np.inf
        first, known = columns.stop, Quantity(size, unit)
        if error > _SHOWN * size:
            continue
        if change.family == "step":
            steps.append((change.at, size, error))
        elif change.family == "warm_up":
            trim = change.at * max(float(np.log(size / error)), 1.0)
            found.append(FINDINGS("warm_up", cost=_SLOW, size=known, time=change.at, trim=trim))
        elif change.family != "shift":  # part of what was set aside
            found.append(FINDINGS(change.family, cost=_SLOW, size=known, frequency=change.at))
    if steps:
        times, size = ", ".join(f"{at:.4g}" for at, *_ in sorted(steps)), max(size for _, size, _ in steps)
        found.append(FINDINGS("step", cost=_SLOW, times=times, size=Quantity(size, unit), steps=sorted(steps)))
    return found


def of_doubts(doubts: Sequence[str], rival: Rival, changes: Changes) -> list[Finding]:
    """Why terms are hints at most."""
    if not doubts:
        return []
    if rival.other:
        return [FINDINGS("rival", cost=_SLOW, terms=" and ".join(doubts), factor=float(np.exp(rival.apart)))]
    what = {"step": "a change", "warm_up": "a warm-up", "sinusoid": "a sinusoid", "ramp": "a drift", "temperature": "the temperature"}
    return [FINDINGS("instead", cost=_SLOW, change=what[changes.instead.family])] if changes.instead else []


def of_widening(wider: Widening, names: Sequence[str], duration: float) -> list[Finding]:
    """The coefficient whose evidence is most uneven in time, white noise before slow noise."""
    for what, terms, severity in (("white noise", "N", CAUTION), ("slow noise", "BK", NOTE)):
        told = [(wider.factor[i], part) for i, part in enumerate(wider.loudest) if names[i] in terms and part is not None]
        factor, part = max(told, key=lambda one: one[0], default=(1.0, (0.0, 1.0)))
        if factor > _UNEVEN**2:
            start, stop, factor = part[0] * duration, part[1] * duration, float(np.sqrt(factor))
            return [FINDINGS("uneven", cost=factor, severity=severity, what=what, start=start, stop=stop, factor=factor)]
    return []


def events_of(changes: Sequence[Change]) -> tuple[tuple[float, float, str], ...]:
    """(start in s, stop in s, words) for what acts in one part of the record only, to be marked in a drawing of it."""
    found = [(one.at, one.at + one.time, "step") for one in changes if one.family == "step"]
    return tuple(sorted(found + [(0.0, one.at, "warm-up") for one in changes if one.family == "warm_up"]))
