"""Method "whittle": the channels of sensors in, a `NoiseFit` for each out. All channels are fitted at once.

1. Each record is transformed (`Observed`). 2. Its bins are fitted, for all channels together (`solve`). 3. Changes of the mean are looked
for in the axes of each sensor, for all sensors together, and the channels of those that have some are fitted again. 4. The curve and the
evenness in time of each record are measured. 5. Errors, limits and the rival follow, for all channels together.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from .._errors import DataError, FitError
from .._frozen import made, replaced
from .._message import Message
from .._types import AnyArray
from . import _findings
from ._changes import Changes, Sensor, find_changes, lowest_of
from ._compare import likeliest_time
from ._errors import doubted, widening
from ._likelihood import information, inverse
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


def fit_axes(records: Sequence[Record], asked: Asked) -> list[NoiseFit]:
    """Fit the channels of sensors, all of one length and with equally many axes, by the likelihood of their samples.

    Each channel has coefficients of its own. What changes the mean is looked for in all channels of a sensor together, also across each
    stretch of samples that was set aside.
    """
    sought, ramps = ([term for term in asked.terms if kind(term)] for kind in (is_sought, lambda term: isinstance(term, Ramp)))
    base = tuple(term for term in asked.terms if term not in (*ramps, *sought))
    if not base or len(sought) > 1:
        raise DataError(
            f"terms {tuple(one.name for one in asked.terms)!r}: a ramp, and one Gauss-Markov process without correlation time, are fitted "
            "beside other terms; add N"
        )
    observed = [Observed(y, 1.0 / asked.rate, name) for one in records for y, name in zip(one.channels, one.names, strict=True)]
    sensors = [one.sensor for one in records for _ in one.channels]
    if ramps:  # a regressor beside the other terms
        line = Regressors(np.arange(len(observed[0].y))[None, :] / asked.rate)
        observed = [one.beside(line) for one in observed]
    solved = solve(observed, base, asked.band)
    if sought:  # each with a correlation time of its own
        found = []
        for i, one in enumerate(observed):
            own, terms = _with_process(one, solved.of([i]), base, asked)
            found += _results([one], own, terms, sensors[i : i + 1], [Changes()], asked)
        return found
    changes = [Changes()] * len(observed) if ramps else _with_changes(observed, solved, records, base, asked)
    return _results(observed, solved, asked.terms, sensors, changes, asked)


def _with_process(observed: Observed, plain: Solved, base: tuple[Term, ...], asked: Asked) -> tuple[Solved, tuple[Term, ...]]:
    """The fit of a channel with the Gauss-Markov process asked for, at its likeliest correlation time, and the terms."""
    time = likeliest_time(plain, 1.0 / asked.rate, asked.duration)
    terms = tuple(GaussMarkov(time=time, name=term.name) if is_sought(term) else term for term in asked.terms)
    process = tuple(term for term, sought in zip(terms, asked.terms, strict=True) if is_sought(sought))
    return solve([observed], (*base, *process), asked.band), terms


def _with_changes(
    observed: list[Observed], solved: Solved, records: Sequence[Record], base: tuple[Term, ...], asked: Asked
) -> list[Changes]:
    """What changes the mean of each channel; those that something changes, and their fits, are replaced by others beside it."""
    dt, n = 1.0 / asked.rate, len(observed[0].y)
    slow, axes = np.array([name not in _FAST for name in solved.names]), len(records[0].channels)
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
        functions = [change.columns(np.arange(n) * dt).T for change in changes[i].fitted]
        count = [len(one) for one in functions]
        groups, shares = np.repeat(np.arange(len(count)), count), np.repeat(changes[i].shares, count)
        regressors = Regressors(np.concatenate(functions), groups, shares)
        for k in places[i]:
            observed[k] = observed[k].beside(regressors)
    if len(rows := places[changed].ravel()):
        solved.put(rows, solve([observed[k] for k in rows], base, asked.band, solved.of(rows)))
    return [one for one in changes for _ in range(axes)]


def _results(
    observed: list[Observed], solved: Solved, terms: tuple[Term, ...], sensors: list[str], changes: list[Changes], asked: Asked
) -> list[NoiseFit]:  # fmt: skip
    """Coefficients, intervals and findings of each channel."""
    if not (np.all(np.isfinite(solved.theta)) and np.all(np.isfinite(solved.cost))):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    dt, names, bins = observed[0].dt, solved.names, solved.bins
    curves = zip(observed, changes, solved.end, strict=True)
    begun = [asked.begin(one.drawn if changed.fitted else one.filled, end) for one, changed, end in curves]
    wider = widening(solved, dt, (one.spectrum() for one in observed))
    for i, one in enumerate(observed):
        if len(one.doubts):
            doubt = doubted(solved.of([i]), one.doubts / bins.unit[i])
            # the search holds the fast terms, which no change of the mean looks like
            wider.factor[i] += np.where([name in _FAST for name in names], 0.0, doubt)
    covariance, limits = _uncertainty(solved, wider.factor, asked.confidence)
    scale = wider.factor[:, names.index("N")] if "N" in names else np.ones(len(observed))
    rival = rival_of(solved, dt, asked.duration, levels_of(asked.confidence), scale)
    limits, doubts = _beside(limits, names, rival)
    edf = edf_of(asked.m, len(observed[0].y), bins.columns, rival.density, solved.theta, wider.factor)
    squares = _squares(observed, solved, terms, covariance, limits, asked.confidence)
    spectra, kept = _spectra(solved), tuple(term.name for term in asked.terms if not is_sought(term))
    found = []
    for i, (wait, used) in enumerate(begun):
        curve = wait()  # of a record without gaps, which has differences at all cluster sizes
        used[-1] |= not used.any()
        lines = _lines(solved, i, asked.duration)
        band = float(curve.tau[used].min()), float(curve.tau[used].max())
        fit = assemble(
            squares[0][i], squares[1][i], Limits._make(one[i] for one in squares[2]), terms, with_edf(curve, used, edf[i]),
            asked.duration, sinusoid=lines, used=used, confidence=asked.confidence, method="whittle", goodness=float(solved.goodness[i]),
            band=band, spectrum=spectra[i], events=_findings.events_of(changes[i].likely),
        )  # fmt: skip
        presence = fit.presence | dict.fromkeys(doubts[i], "hint")
        # unevenness is said of the coefficients
        said = [one for one in curve.findings if one.code != "uneven"]
        instead = changes[i].instead if presence.get("K") == "present" else None
        shortest = band[0] if solved.cut[i] and "Q" in presence else None
        said += [
            *_findings.of_model(float(solved.misfit[i]), shortest),
            *(() if solved.off[i] < SETTLED else [_findings.FINDINGS("unsettled", cost=float(np.hypot(1.0, solved.off[i])))]),
            *_findings.of_lines(lines),
            *_findings.of_changes(changes[i], observed[i].factors, observed[i].covariance, sensors[i] or "ratio", asked.duration),
            *_findings.of_widening(wider.factor[i], wider.loudest[i], names, asked.duration),
            *_findings.of_doubts(doubts[i], float(rival.apart[i]), instead),
        ]
        found.append(replaced(fit, presence=presence, findings=tuple(said), terms=kept, covariance=fit.covariance[list(kept)]))
    return found


def _uncertainty(solved: Solved, widened: AnyArray, confidence: float) -> tuple[AnyArray, Limits]:
    """Covariances of the squared coefficients (inverse Fisher information), and profile-likelihood limits, (channels, p), of those known.

    Every variance is multiplied by `widened`, (channels, p), and the likelihood ratio of its profile is divided by it.
    """
    lanes: Any = np.nonzero(solved.own)
    covariance = inverse(information(solved.bins.columns, solved.weight, solved.theta, solved.among))
    levels = (level * widened[lanes] for level in levels_of(confidence))
    found = profile_limits(solved.bins, solved.weight, (solved.theta, solved.cost, covariance), ~solved.among, lanes, *levels)
    limits = Limits._make(np.full(widened.shape, unknown) for unknown in (0.0, np.inf, np.inf, 0.0))
    for whole, part in zip(limits, found, strict=True):
        whole[lanes] = part
    root = np.sqrt(widened)
    return covariance * (root[:, :, None] * root[:, None, :]), limits._replace(significance=limits.significance / widened)


def _beside(limits: Limits, names: Sequence[str], rival: Rival) -> tuple[Limits, list[list[str]]]:
    """Limits of terms that hold under the rival too, and the terms of each channel that are hints at most: it is another spectrum."""
    slow = np.array([name in ("B", "K") for name in names])
    doubts = slow & (rival.left[:, None] == 0.0) & (limits.significance > PRESENT)
    low, high, upper = limits.low * np.where(slow, rival.left[:, None], 1.0), limits.high.copy(), limits.upper.copy()
    if rival.white is not None:
        i = names.index("N")
        low[:, i] = np.minimum(low[:, i], rival.white[:, 0])
        high[:, i], upper[:, i] = np.maximum(high[:, i], rival.white[:, 1]), np.maximum(upper[:, i], rival.white[:, 2])
    return Limits(low, high, upper, limits.significance), [[names[k] for k in np.flatnonzero(one).tolist()] for one in doubts]


def _lines(solved: Solved, i: int, duration: float) -> list[tuple[float, float]]:
    """(amplitude, frequency in Hz) of the spectral lines in the band of a channel."""
    lines = amplitudes(solved.bins.of(i), solved.lines[i] >= LINE, solved.level[i], duration)
    return [line for line in lines if line[1] <= solved.end[i]]


def _spectra(solved: Solved) -> list[FittedSpectrum]:
    """Bins of each record and the model there. Bins without an ordinate and those of spectral lines are left out."""
    bins, names = solved.bins, solved.names
    kept, used = (bins.weight > 0) & (bins.density > 0) & (solved.lines < LINE), solved.weight > 0
    level, model = bins.density * bins.unit[:, None], solved.level * bins.unit[:, None]
    return [
        made(FittedSpectrum, frequency=bins.frequency[here], density=level[i, here], model=model[i, here], edf=bins.weight[i, here],
             used=used[i, here], columns={name: bins.columns[here, k] for k, name in enumerate(names) if name != FILTER})
        for i, here in enumerate(kept)
    ]  # fmt: skip


def _squares(
    observed: list[Observed], solved: Solved, terms: tuple[Term, ...], covariance: AnyArray, limits: Limits, confidence: float
) -> tuple[AnyArray, AnyArray, Limits]:  # fmt: skip
    """Squared coefficients of each channel in SI units in the order of the terms, their covariance and limits.

    The slope of a ramp is the only factor of the mean. What the record does not determine is zero without an upper limit.
    """
    asked, own, unit = [term.name for term in terms], solved.own, solved.bins.unit[:, None]
    limits, place = limits.scaled(unit), [solved.names.index(name) if name != "R" else 0 for name in asked]
    squares, spread = (solved.theta * unit * own)[:, place], covariance * unit[:, :, None] ** 2 * (own[:, :, None] & own[:, None, :])
    spread, ends = spread[:, place][:, :, place], np.array(limits)[:, :, place]
    if "R" in asked:
        i = asked.index("R")
        slope, error = np.array([one.factors[0] for one in observed]), np.array([one.covariance[0, 0] for one in observed]) ** 0.5
        spread[:, i], spread[:, :, i] = 0.0, 0.0
        squares[:, i], spread[:, i, i] = slope**2, (2.0 * slope * error) ** 2
        # the slope is a linear function of the record, and therefore normal
        away, (both, one) = abs(slope), (np.sqrt(level) * error for level in levels_of(confidence))
        ends[:, :, i] = np.maximum(away - both, 0.0) ** 2, (away + both) ** 2, (away + one) ** 2, (slope / error) ** 2
    return squares, spread, Limits(*ends)
