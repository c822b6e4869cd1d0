"""What a fit tells its reader: octaves left out, and warnings."""

import numpy as np

from ..allan import Deviation
from ._allanfit import Fitted as FittedCurve
from ._result import NoiseFit
from ._spectral import Fitted
from ._stationarity import PARTS, Unevenness


def sentences_of_octaves(curve: Deviation, used, modelled, automatic: bool) -> tuple[str, ...]:
    """One sentence for each octave of cluster time that the fit leaves out, with how far the curve is from the model there."""
    octave = np.floor(np.log2(curve.m)).astype(int)
    ratio = curve.deviation / np.where(modelled > 0.0, modelled, 1.0)
    said = []
    for number in np.unique(octave[~used]):
        these = (octave == number) & ~used
        worst = ratio[these][np.argmax(np.abs(np.log(np.maximum(ratio[these], 1e-300))))]
        low, high = 2**number / curve.rate, 2 ** (number + 1) / curve.rate
        reason = "the model does not hold there" if automatic else "outside of the band asked for"
        said.append(f"{low:.3g} to {high:.3g} s: {reason} (measured deviation {worst:.2f} times the model's)")
    return tuple(said)


def sentences_of_fit(
    found: FittedCurve, cut: bool, holds: bool, curve: Deviation, used, verdict: dict[str, str], automatic: bool
) -> tuple[str, ...]:
    """Warnings about the fit of one channel."""
    said = []
    shortest = curve.tau[used].min()
    if not holds:
        where = "any range of cluster times" if automatic else "the band asked for"
        said.append(
            f"the noise model does not hold in {where} (chance {float(found.goodness):.1g}): the coefficients "
            "describe the curve roughly, and the intervals are not to be relied on; look at the plot for vibration, temperature "
            "drift or steps"
        )
    elif found.inflation > 1.0:
        said.append(
            f"the curve departs from the model slightly, but by more than its noise allows (chance {float(found.goodness):.1g}): the "
            f"intervals are widened {np.sqrt(float(found.inflation)):.1f} times"
        )
    if found.step > 1e-4:
        change = float(found.step)
        said.append(f"the weights of the fit have not settled (last change {change:.1g}); fit fewer terms or another band")
    if cut and "Q" in verdict:
        said.append(
            f"Q was not fitted: it shows at cluster times below the {shortest:.3g} s from which the fit starts; its upper limit is "
            "what the rest of the curve allows"
        )
    if cut and verdict.get("N") == "not detected":
        said.append(f"N cannot be told from the other terms in the cluster times that are left, {shortest:.3g} s and longer")
    lost = curve.skipped / (curve.skipped + curve.count)
    if np.any(lost > 0.0):
        said.append(
            f"gaps: up to {100 * lost.max():.2g} % of the differences at a cluster time touch a missing sample and were left out; "
            "the intervals allow for it"
        )
    return tuple(said)


def sentences_of_spectrum(found: NoiseFit, fitted: Fitted, lines, automatic: bool) -> list[str]:
    """Warnings about the fit of one channel's spectrum."""
    said = []
    shortest = float(found.band[0])
    if not bool(fitted.holds):
        where = "any band" if automatic else "the band asked for"
        said.append(
            f"the noise model does not hold in {where} (the spectrum scatters {float(fitted.inflation):.1f} times as much as it may): "
            "the coefficients describe it roughly, and the intervals are not to be relied on; look at the plot for "
            "vibration, temperature drift or steps"
        )
    elif float(fitted.inflation) > 1.0:
        said.append(
            "the spectrum departs from the model slightly, but by more than its noise allows (chance "
            f"{float(fitted.goodness):.1g}): the intervals are widened {np.sqrt(float(fitted.inflation)):.1f} times"
        )
    if not bool(fitted.settled):
        said.append("the search for the largest likelihood did not converge; fit fewer terms or another band")
    if lines:
        shown = ", ".join(f"{frequency:.3g}" for _, frequency in lines[:6]) + (" and others" if len(lines) > 6 else "")
        said.append(f"spectral line{'s' if len(lines) > 1 else ''} at {shown} Hz: left out of the fit, and part of the model as sinusoids")
    if bool(fitted.cut) and "Q" in found.terms:
        said.append(f"Q was not fitted: it shows at cluster times below the {shortest:.3g} s from which the fit starts")
    if bool(fitted.cut) and found.verdict.get("N") == "not detected":
        said.append(f"N cannot be told from the other terms in the cluster times that are left, {shortest:.3g} s and longer")
    return said


def sentences_of_unevenness(uneven: dict[str, Unevenness], duration: float) -> list[str]:
    """Warnings where the evidence for a coefficient comes from some parts of the record more than from others."""
    said = []
    for what, found in (
        ("slow wandering", {t: uneven[t] for t in ("B", "K") if t in uneven}),
        ("white noise", {t: uneven[t] for t in "N" if t in uneven}),
    ):
        if not found:
            continue
        worst = min(found.values(), key=lambda one: one.chance)
        wider = " and ".join(f"{term} {np.sqrt(max(one.factor, 1.0)):.1f} times" for term, one in found.items())
        start, stop = (duration * edge / PARTS for edge in (worst.part, worst.part + 1))
        said.append(
            f"the {what} is uneven in time (chance {worst.chance:.1g}): {100 * worst.share:.3g} % of it falls between {start:.4g} and "
            f"{stop:.4g} s, an eighth of the record; the intervals of {wider} wider for it; look there for a knock, a draught or warming up"
        )
    return said
