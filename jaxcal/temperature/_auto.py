"""The automatic model: choice of its structure, its coefficients, and their uncertainty."""

import dataclasses
from typing import Any

import numpy as np

from .._types import AnyArray
from ..fitting import Estimate
from ._curves import Chebyshev, Steps
from ._design import FEWEST, MANY, SHARE, Design, Form, column_of, part_of, shape_slopes
from ._model import ThermalModel
from ._prior import DEGREE
from ._record import FINE, Record, number
from ._restricted import Averaged, bands
from ._structure import PRICE, Found, settled, structures, with_jumps


def design_of(records: list[Record], *, smooth: bool) -> Design:
    """Put records on a common time grid. Short gaps are interpolated; after a long gap a new record with its own level begins."""
    steps = [float(np.median(np.diff(one.time))) for one in records if one.time is not None]
    dt = min(steps) if steps else 1.0
    dt *= max(-(-sum(len(one.t) for one in records) // MANY), 1)
    parts = []
    for one in records:
        time = np.arange(len(one.t)) * dt if one.time is None else one.time
        place = np.floor((time - time[0]) / dt + 0.5).astype(np.int64)
        place, first = np.unique(place, return_inverse=True)
        t, b = (np.bincount(first, values) / np.bincount(first) for values in (one.t, one.b))
        longest = max(FEWEST, SHARE * len(t))
        for piece in np.split(np.arange(len(place)), np.flatnonzero(np.diff(place) > longest) + 1):
            grid = np.arange(int(place[piece[0]]), int(place[piece[-1]]) + 1)
            if len(grid) >= FEWEST:
                warmth, bias = (np.interp(grid, place[piece], values[piece]) for values in (t, b))
                parts.append(part_of(warmth, bias, dt, smooth=smooth))
    return Design(parts, dt)


def choose(design: Design, given: Form, searched: tuple[str, ...], thermometer: float) -> tuple[Found, bool]:
    """Choose the structure with the lowest penalised score, and tell whether lag and play could not be distinguished.

    A hysteresis smaller than the thermometer's noise is rejected.
    """
    if not searched:
        return with_jumps(design, settled(design, given)), False
    tried = structures(design, given, searched)
    seen = [one for one in tried if one is tried[0] or one.found.form.rate or _moved(design, one.found.form, given) > thermometer]
    best = min(seen, key=lambda one: one.score)
    alone = {one.name: one.score for one in tried if one.name in ("lag", "play")}
    unsure = len(alone) == 2 and best.name in alone and abs(alone["lag"] - alone["play"]) < PRICE
    found = settled(design, best.found.form, best.found.phi)
    found = with_jumps(design, dataclasses.replace(found, chances=best.found.chances))
    return found, unsure


def _moved(design: Design, form: Form, given: Form) -> float:
    away = design.filtered(form.lag, form.play) - design.filtered(given.lag, given.play)
    return float(np.sqrt(np.mean(away**2)))


def curve_of(
    design: Design, found: Found, thermometer: float, confidence: float, quantities: dict[str, str]
) -> tuple[ThermalModel, AnyArray, AnyArray, dict[str, Any]]:
    """The curve, averaged over the hyperparameters; temperatures and biases on one level; and its uncertainty, as for `TemperatureFit`."""
    form = found.form
    slopes = design.slopes(form, design.restricted(form).solved(found.phi).beta)
    restricted = design.restricted(form, slopes=slopes)
    averaged = restricted.averaged(found.phi)
    beta, covariance = averaged.beta, averaged.covariance
    count = len(form.vector)
    linear = beta[: len(beta) - count]
    form = form.at(_inside(design, form, beta[len(beta) - count :]))
    # add the effect of the thermometer's white noise, which is proportional to the slope of the curve
    at = restricted.solved(found.phi)
    whole = np.concatenate([design.columns(found.form), slopes], axis=1) / at.density[design.bands.index, None]
    gain = design.bands.restore(whole @ at.covariance)
    steep = _steepness(design, form, linear)
    covariance = covariance + (gain * (steep * thermometer)[:, None] ** 2).T @ gain
    averaged = averaged._replace(beta=linear, covariance=covariance)
    return _curve(design, form, averaged, found.chances, confidence, quantities)


def _inside(design: Design, form: Form, step: AnyArray) -> AnyArray:
    """Nonlinear parameters after the averaged step, limited to the range where the linear model is valid."""
    first = len(form.free)
    reach = np.concatenate([0.1 * form.vector[:first], *([0.3 * np.exp(jump.log_width), 0.2] for jump in form.jumps)])
    return form.vector + np.clip(step, -reach, reach)


def _steepness(design: Design, form: Form, linear: AnyArray) -> AnyArray:
    """Slope db/dT at every sample."""
    t, step = design.filtered(form.lag, form.play), 1e-3
    ends = [_static(design, form, linear, t + sign * step) for sign in (1, -1)]
    return (ends[0] - ends[1]) / (2 * step)


def _static(design: Design, form: Form, linear: AnyArray, t: AnyArray) -> AnyArray:
    """Values of series and jumps."""
    heights = linear[len(linear) - len(form.jumps) :]
    steps = (height * column_of(jump, t) for height, jump in zip(heights, form.jumps, strict=True))
    return design.chebyshev(t) @ linear[:DEGREE] + sum(steps, 0.0)


def _curve(
    design: Design, form: Form, averaged: Averaged, chances: tuple[float, ...], confidence: float, quantities: dict[str, str]
) -> tuple[ThermalModel, AnyArray, AnyArray, dict[str, Any]]:
    linear, covariance, t = averaged.beta, averaged.covariance, design.filtered(form.lag, form.play)
    low, high = float(t.min()), float(t.max())
    heights = linear[len(linear) - len(form.jumps) :]
    further = design.further(form)
    rest = design.b - design.chebyshev(t) @ linear[:DEGREE] - further @ linear[DEGREE:]
    # each record has its own level: shift all records to the mean level
    levels = np.bincount(design.record, rest) / np.bincount(design.record)
    b = design.b - levels[design.record] + levels.mean()
    curve: Any = Chebyshev(np.concatenate([[levels.mean()], linear[:DEGREE]]), design.low, design.high)
    order = sorted(range(len(form.jumps)), key=lambda i: form.jumps[i].centre)
    if order:
        shape = [(heights[i], form.jumps[i].centre, np.exp(form.jumps[i].log_width)) for i in order]
        curve = Steps(curve, *(np.array(values) for values in zip(*shape, strict=True)))
    first, after = DEGREE + form.rate, DEGREE + form.rate + len(form.jumps)
    # name -> value, place in the covariance, and derivative by the parameter there
    names = {"lag": "lag", "play": "play", "slow": "rate_lag"}
    known = {names[name]: (float(getattr(form, name)), after + i, 1.0) for i, name in enumerate(form.free)}
    if form.rate:
        known["rate"] = float(linear[DEGREE]), DEGREE, 1.0
    for j, i in enumerate(order):
        jump, place = form.jumps[i], after + len(form.free) + 2 * i
        width = float(np.exp(jump.log_width))
        known |= {f"jump.height[{j}]": (float(heights[i]), first + i, 1.0), f"jump.centre[{j}]": (jump.centre, place, 1.0),
                  f"jump.width[{j}]": (width, place + 1, width)}  # fmt: skip
    values, where, slopes = (np.array(column) for column in zip(*known.values(), strict=True)) if known else 3 * (np.zeros(0),)
    block = covariance[np.ix_(where.astype(int), where.astype(int))] * np.outer(slopes, slopes)
    estimate = Estimate(tuple(known), values, block, quantities=quantities)
    model = ThermalModel(curve, low, high, form.lag, form.play, float(linear[DEGREE]) if form.rate else 0.0, form.slow)
    place = np.unique(number(t, FINE, low), return_inverse=True)[1]
    grid = np.bincount(place, t) / np.bincount(place)
    rows, mean = _rows(design, form, linear, grid), _rows(design, form, linear, t).mean(axis=0)
    mean[DEGREE:first] = further[:, : form.rate].mean(axis=0)
    standard = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rows - mean, covariance, rows - mean), 0))
    level = (float(np.std(levels, ddof=1) * np.sqrt(1 + 1 / len(levels))), len(levels) - 1) if len(levels) > 1 else (0.0, 0)
    wander = next_variance(place, design.record, design.dt)
    after = averaged.quantile(averaged.theta @ wander + standard**2, confidence)
    facts = {"estimate": estimate, "chances": tuple(float(chances[i]) for i in order), "noise": averaged.noise, "grid": grid,
             "error": standard, "next_error": after, "level": level}  # fmt: skip
    return model, t, b, facts


def _rows(design: Design, form: Form, linear: AnyArray, t: AnyArray) -> AnyArray:
    """Derivative of the curve at the given temperatures by all coefficients and nonlinear parameters."""
    columns = [np.zeros(len(t))] * form.rate + [column_of(jump, t) for jump in form.jumps] + [np.zeros(len(t))] * len(form.free)
    for jump, height in zip(form.jumps, linear[len(linear) - len(form.jumps) :], strict=True):
        columns += shape_slopes(jump, height, t)
    return np.column_stack([design.chebyshev(t), *columns])


def next_variance(place: AnyArray, record: AnyArray, dt: float) -> AnyArray:
    """(3, bins) variance per N^2, B^2, K^2 of the mean noise in each bin of the next cycle, relative to the mean noise of this cycle.

    After a single record, the next cycle is a repetition without a pause. With several records, the variance is relative to the mean of
    the next cycle itself, because the scatter of the level is treated separately.
    """
    several = record[-1] != record[0]
    last = place[record == record[-1]] if several else place
    n, bins = len(last), int(place.max()) + 1
    after = 0 if several else n
    held = bands((n + after,), dt)
    densities = held.columns.T[:, held.index]
    share = np.bincount(last, minlength=bins)
    variance = np.zeros((3, bins))
    for k in range(bins):  # bin by bin, because all together would need much memory
        gain = np.zeros(n + after)
        gain[after:] = (last == k) / max(share[k], 1)
        gain[:n] -= 1 / n
        variance[:, k] = densities @ held.transform(gain) ** 2
    # for bins that the last record does not reach, use the largest variance of the others
    return np.where(share > 0, variance, variance[:, share > 0].max(axis=1, keepdims=True))
