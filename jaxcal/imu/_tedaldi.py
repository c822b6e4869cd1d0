"""The two-step fit of imu_tk, with its thresholds, weights, integrator and frozen bias: for comparison, and to reproduce its results."""

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from ..fitting import Outcome, solve
from ._estimate import Options, padded, spread
from ._joint import ImuParameters
from ._norms import AccelParameters, GyroParameters, Norms, norm_residuals
from ._observe import observability
from ._recording import Recording
from ._result import ImuFit
from ._start import explanation, scanned_scale
from ._threshold import Choice
from ._triad import Triad
from ._turns import Segments, Turns, segments_of, turn_residuals
from ._verdict import Judgement, judge

_FREE = GyroParameters(True, True, False, False)


@jax.jit
def _turned(p: Any, data: Any) -> Any:
    return turn_residuals(p, data)


def tedaldi(
    record: Recording, choice: Choice, options: Options, convention: str, least: Any, raw: bool, initial: Any, held_out: bool
) -> ImuFit:
    """Norms of the first samples of every interval, then the turns by Runge-Kutta steps, verticals and bias fixed."""
    assert record.gyro is not None
    start, stop = choice.still.start, choice.still.stop
    accel = choice.fits[choice.still.multiple]
    each = max(round(float(least) * record.rate), 2)
    count = len(start)
    slots = len(np.asarray(accel.residuals)) // each
    p = accel.model
    matrix = np.asarray(p.correction())
    force = np.array([((record.accel[i:j] - np.asarray(p.bias)) @ matrix.T).mean(axis=0) for i, j in zip(start, stop, strict=True)])
    vertical = force / np.linalg.norm(force, axis=1, keepdims=True)
    last = stop[0] if initial is None else round(float(initial) * record.rate) + 1
    bias = record.gyro[:last].mean(axis=0)
    segments = segments_of(record.time, record.gyro, record.accel, start, stop, slots)
    verticals = padded(vertical, slots)
    scale = scanned_scale(bias, verticals, segments) if raw else 1.0
    begin = GyroParameters(np.zeros(6), np.full(3, scale), bias, np.zeros((3, 3)))
    gyro = solve(turn_residuals, begin, Turns(segments, verticals), free=_FREE)
    seen = observability(vertical, options.diagonal)

    model = ImuParameters(p, gyro.model, np.zeros(3), np.zeros(2))
    fixed = GyroParameters(False, False, False, False)
    off = AccelParameters(False, False, False)
    by_sample = np.concatenate([np.repeat(np.arange(count), each), np.full((slots - count) * each, -1)])
    by_turn = np.repeat(np.arange(slots), 3)
    values, plain, robust = _both(
        (accel, ImuParameters(AccelParameters(True, True, True), fixed, False, False), by_sample),
        (gyro, ImuParameters(off, _FREE, False, False), by_turn), model, convention,
    )  # fmt: skip
    valid = segments.weight > 0
    turned = np.asarray(gyro.residuals).reshape(slots, 3)[valid]
    turns = len(turned)
    freedom = np.concatenate([np.full(12, count - 9), np.full(21, 2 * turns - 9)]).astype(float)
    half = scipy.stats.t.ppf(0.975, np.maximum(freedom, 1)) * np.sqrt(np.maximum(np.diag(plain), 0))
    norm = np.asarray(accel.residuals)[: count * each].reshape(count, each).mean(axis=1)
    angle = np.linalg.norm(turned, axis=1)
    low = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    sigma = np.array([np.sqrt(2 * float(accel.cost) / (count * each - 9)), np.sqrt(2 * float(gyro.cost) / max(2 * turns - 9, 1)), np.nan])
    judged = judge(gyro, values, plain, seen, count, turns, angle, low, sigma, options, True, list(choice.warnings))
    if judged.verdict == "refused" and (why := explanation(bias, verticals, segments, scale)):
        judged = Judgement(judged.verdict, f"{judged.reason} {why}", judged.warnings)
    outside = _held_out(record, start, each, slots, p, gyro.model, segments, options) if held_out else np.full(2, np.nan)
    return ImuFit(
        accel=Triad(values[:9].reshape(3, 3), values[9:12]), gyro=Triad(values[12:21].reshape(3, 3), values[21:24]), covariance=plain,
        interval=np.stack([values - half, values + half], axis=1), robust_covariance=robust, degrees_of_freedom=freedom, residual_norm=norm,
        residual_turn=angle, residual_rest=np.zeros((0, 3)), sigma=sigma, down_weighted=low,
        cost=np.array([float(accel.cost), float(gyro.cost)]), held_out=outside, still=choice.still, thresholds=choice.table,
        observability=seen, drift=np.zeros(3), rate=record.rate, gravity=options.gravity, temperature=record.temperature,
        verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings, convention=convention, method="imu_tk",
    )  # fmt: skip


def _both(first: tuple, second: tuple, model: ImuParameters, convention: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters, and the covariances of two separate fits put together."""
    total = []
    values = np.zeros(33)
    for fit, free, clusters in (first, second):
        whole = dataclasses.replace(fit, model=model)
        known = bool(fit.outcome != Outcome.unidentifiable)
        values, plain, robust = spread(whole, free, convention, clusters if known else None)
        total.append((plain, np.full_like(plain, np.inf) if robust is None else robust))
    return values, total[0][0] + total[1][0], total[0][1] + total[1][1]


def _held_out(
    record: Recording, start: np.ndarray, each: int, slots: int, p: Any, gyro: Any, segments: Segments, options: Options
) -> np.ndarray:
    """As for the joint fit: rms of norms and of turns' components that the fit did not see."""
    count = len(start)
    sample = padded(np.concatenate([record.accel[i : i + each] for i in start]), slots * each)
    stop = start + each
    mean = np.array([record.accel[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])
    inside_all, squares = np.arange(slots) % 2, ([], [])
    for parity in (0, 1):
        keep = (inside_all == parity) & (np.arange(slots) < count)
        if keep.sum() < 9:
            return np.full(2, np.nan)
        fit = solve(
            norm_residuals,
            p,
            Norms(sample, np.repeat(keep.astype(float), each), options.gravity, 1.0),
            free=AccelParameters(True, True, True),
        )
        matrix, bias = np.asarray(fit.model.correction()), np.asarray(fit.model.bias)
        force = (mean - bias) @ matrix.T
        squares[0].append((options.gravity - np.linalg.norm(force, axis=1))[~keep[:count]] ** 2)
        vertical = padded(force / np.linalg.norm(force, axis=1, keepdims=True), slots)
        part = dataclasses.replace(segments, weight=np.where(inside_all == parity, segments.weight, 0.0))
        turn = solve(turn_residuals, gyro, Turns(part, vertical), free=_FREE)
        data = jax.tree.map(jnp.asarray, Turns(segments, vertical))
        turned = np.asarray(_turned(turn.model, data))
        squares[1].append(turned[(inside_all != parity) & (segments.weight > 0)] ** 2)
    return np.array([np.sqrt(np.mean(np.concatenate(part))) for part in squares])
