"""Method "whittle": the channels of sensors in, a `NoiseFit` for each out. All channels are fitted at once.

1. Each record is transformed (`Observed`). 2. Its bins are fitted, for all channels together (`solve`). 3. Changes of the mean are looked
for in the axes of each sensor, for all sensors together, and the channels of those that have some are fitted again. 4. The curve and the
evenness in time of each record are measured. 5. Errors, limits and the rival follow, for all channels together.
"""

from collections.abc import Sequence

import numpy as np

from .._errors import DataError, FitError
from .._message import Message
from . import _findings
from ._certainty import certainty
from ._changes import Changes, Sensor, find_changes, lowest_of
from ._compare import likeliest_time
from ._likelihood import PRESENT, Limits
from ._observed import Observed, Regressors
from ._record import Asked, Record
from ._result import NoiseFit, assemble, spectra_of, with_edf
from ._solve import FAST, SETTLED, Solved, amplitudes, solve
from ._terms import GaussMarkov, Ramp, Term, is_sought

#: largest density over the smallest, up to which a change, or a step, is a hundredth of the noise in the ordinates beyond `_SMOOTH`
_TALLEST = (1e10, 1e5)


def fit_axes(records: Sequence[Record], asked: Asked) -> list[NoiseFit]:
    """Fit the channels of sensors, all of one length and with equally many axes, by the likelihood of their samples.

    Each channel has coefficients of its own. What changes the mean is looked for in all channels of a sensor together, also across each
    stretch of samples that was set aside.
    """
    sought, ramps = [one for one in asked.terms if is_sought(one)], [one for one in asked.terms if isinstance(one, Ramp)]
    base = tuple(term for term in asked.terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError("a ramp, and one Gauss-Markov process without correlation time, are fitted beside other terms; add N")
    channels = [(y, name, one) for one in records for y, name in zip(one.channels, one.names, strict=True)]
    observed = [Observed(y, 1.0 / asked.rate, name) for y, name, _ in channels]
    if ramps:  # a regressor beside the other terms
        line = Regressors([lambda times: times[:, None]], len(observed[0].y), 1.0 / asked.rate)
        observed = [one.beside(line) for one in observed]
    solved = solve(observed, base, asked.band)
    if sought:  # each channel with a process of its own correlation time
        found = []
        for i, (y, name, one) in enumerate(channels):
            time = likeliest_time(solved.of([i]), 1.0 / asked.rate, asked.duration)
            terms = tuple(GaussMarkov(time=time, name=term.name) if is_sought(term) else term for term in asked.terms)
            found += fit_axes([Record(y, (name,), one.temperature, one.aside)], asked._replace(terms=terms))
        return found
    changes = [Changes()] * len(observed) if ramps else _changes_of(observed, solved, records, base, asked)
    if not (np.all(np.isfinite(solved.theta)) and np.all(np.isfinite(solved.cost))):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    curves = zip(observed, changes, solved.end, strict=True)
    begun = [asked.begin(one.drawn if changed.fitted else one.filled, end) for one, changed, end in curves]
    known, spectra = certainty(solved, observed, asked.terms, asked.m, asked.confidence), spectra_of(solved)
    found = []
    for i, (wait, used) in enumerate(begun):
        curve, own = wait(), observed[i]  # of a record without gaps, which has differences at all cluster sizes
        used[-1] |= not used.any()
        lines, limits = amplitudes(solved, i, asked.duration), Limits._make(one[i] for one in known.limits)
        walk = any(term.name == "K" and rise > PRESENT for term, rise in zip(asked.terms, limits.significance, strict=True))
        band = float(curve.tau[used].min()), float(curve.tau[used].max())
        said = [
            *(one for one in curve.findings if one.code != "uneven"),  # unevenness is said of the coefficients
            *_findings.of_model(float(solved.misfit[i]), band[0] if solved.cut[i] and "Q" in solved.names else None),
            *(() if solved.off[i] < SETTLED else [_findings.FINDINGS("unsettled", cost=float(np.hypot(1.0, solved.off[i])))]),
            *_findings.of_lines(lines),
            *_findings.of_changes(changes[i], own.factors, own.covariance, channels[i][2].sensor or "ratio", asked.duration),
            *_findings.of_widening(known.widened[i], known.loudest[i], solved.names, asked.duration),
            *_findings.of_doubts(known.hints[i], float(known.apart[i]), changes[i].instead if walk else None),
        ]
        found.append(assemble(
            known.squares[i], known.covariance[i], limits, asked.terms, with_edf(curve, used, known.edf[i]), asked.duration,
            sinusoid=lines, hints=known.hints[i], used=used, confidence=asked.confidence, method="whittle", spectrum=spectra[i], band=band,
            goodness=float(solved.goodness[i]), events=_findings.events_of(changes[i].likely), findings=tuple(said),
        ))  # fmt: skip
    return found


def _changes_of(observed: list[Observed], solved: Solved, records: Sequence[Record], base: tuple[Term, ...], asked: Asked) -> list[Changes]:
    """What changes the mean of each channel; those that something changes, and their fits, are replaced by others beside it."""
    dt, n = 1.0 / asked.rate, len(observed[0].y)
    slow, axes = np.array([name not in FAST for name in solved.names]), len(records[0].channels)
    walk = np.array([name == "K" for name in solved.names])[slow]
    theta = (solved.theta * solved.bins.unit[:, None]).reshape(len(records), axes, -1)
    places, sensors = np.arange(len(observed)).reshape(-1, axes), []
    for record, own, rows in zip(records, theta, places, strict=True):
        warmth = record.temperature
        known = warmth is not None and np.all(np.isfinite(warmth)) and np.ptp(warmth) > 0.0
        joints = [0.5 * (first + last) * dt for first, last in record.aside or ()]
        sensors.append(Sensor([observed[i].drawn for i in rows], own, joints, np.asarray(warmth, dtype=float) if known else None))
    changes = find_changes(sensors, lowest_of(n, dt, solved.columns), slow, walk, dt)
    changed = [i for i, one in enumerate(changes) if one.fitted]
    for i in changed:
        fitted, heights, levels = changes[i].fitted, solved.bins.density[places[i]], solved.of(places[i]).level
        steps = any(one.time == 0.0 and one.family != "temperature" for one in fitted)
        smooth = bool(heights.max() < _TALLEST[steps] * levels.min())
        regressors = Regressors([one.columns for one in fitted], n, dt, changes[i].shares, smooth)
        for k in places[i]:
            observed[k] = observed[k].beside(regressors)
    if len(rows := places[changed].ravel()):
        solved.put(rows, solve([observed[k] for k in rows], base, asked.band, solved.of(rows)))
    return [one for one in changes for _ in range(axes)]
