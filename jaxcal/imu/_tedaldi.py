"""The two-step fit of imu_tk, with its thresholds, weights, integrator and frozen bias: for comparison, and to reproduce its results."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._types import Array
from ..fitting import Fit, covariance, solve
from ._estimate import framed, placed, sandwich, solved
from ._integrate import attitude
from ._joint import Options
from ._model import Imu, entries, freed, values
from ._observe import observability
from ._poses import padded, turns_of
from ._recording import Recording
from ._residuals import Turns, arrays
from ._result import ImuFit, intervals
from ._start import explanation, scanned_scale
from ._threshold import Choice, norms
from ._triad import Triad, inverse
from ._verdict import Judgement, judge


class Fixed(eqx.Module):
    """What imu_tk's fit of the gyroscope is given: turns, and the vertical (k, 3) of every pose, fixed."""

    turns: Turns
    vertical: Any


@filter_jit
def turn_residuals(model: Imu, data: Fixed) -> Array:
    """R' u_before - u_after, three components for every turn, by Runge-Kutta steps: the residual of imu_tk."""
    gyro, turns = model.gyro, data.turns
    matrix = inverse(gyro.matrix)
    column = jnp.concatenate([turns.gyro, jnp.ones_like(turns.gyro[..., :1])], axis=-1)
    rotation = attitude(jnp.concatenate([matrix, -(matrix @ gyro.bias)[:, None]], axis=1), column, turns.dt, "runge_kutta")
    return (jnp.einsum("sji,sj->si", rotation, data.vertical[:-1]) - data.vertical[1:]) / turns.sigma[:, None]


def gyro_fit(gyro: Triad, turns: Turns, vertical: np.ndarray) -> Fit:
    """The gyroscope's matrix, its bias held."""
    model = Imu(None, gyro)
    free = eqx.tree_at(lambda m: m.gyro.bias, freed(model, "upper", g_sensitivity=False), np.zeros(3, dtype=bool))
    return solve(turn_residuals, model, Fixed(turns, vertical), free=free)


def tedaldi(record: Recording, choice: Choice, options: Options, least: Any, raw: bool, initial: Any, held_out: bool) -> ImuFit:
    """Norms of the first samples of every interval, then the turns by Runge-Kutta steps, verticals and bias fixed."""
    assert record.gyro is not None
    start, stop = choice.still.start, choice.still.stop
    fit = choice.fits[choice.still.multiple]
    each = max(round(float(least) * record.rate), 2)
    count, slots = len(start), len(np.asarray(fit.residuals)) // each
    vertical = _verticals(record, fit, start, stop)
    last = stop[0] if initial is None else round(float(initial) * record.rate) + 1
    bias = record.gyro[:last].mean(axis=0)
    turns, up = turns_of(record, start, stop, slots), padded(vertical, slots)
    scale = scanned_scale(bias, up, turns) if raw else 1.0
    gyro = gyro_fit(Triad(np.eye(3) / scale, bias), turns, up)
    seen = observability(vertical, not options.misalignment)

    model = Imu(fit.model.accel, gyro.model.gyro)
    names = entries(model)[0]
    by_sample = np.concatenate([np.repeat(np.arange(count), each), np.full((slots - count) * each, -1)])
    by_turn = np.repeat(np.arange(slots - 1), 3)
    plain, robust = np.zeros((33, 33)), np.zeros((33, 33))
    for part, clusters in ((fit, by_sample), (gyro, by_turn)):
        plain = plain + np.asarray(placed(part.names, covariance(part, scaled=True), names))
        robust = robust + placed(part.names, sandwich(part, clusters), names)
    model, (plain, robust) = framed(model, options.convention, plain, robust)
    model, plain, robust = jax.tree.map(np.asarray, (model, plain, robust))
    at = values(model)
    valid = np.isfinite(turns.sigma)
    turned = np.asarray(gyro.residuals).reshape(-1, 3)[valid]
    freedom = np.concatenate([np.full(12, count - 9), np.full(21, 2 * len(turned) - 9)]).astype(float)
    norm = np.asarray(fit.residuals)[: count * each].reshape(count, each).mean(axis=1)
    angle = np.linalg.norm(turned, axis=1)
    left = max(2 * len(turned) - 9, 1)
    sigma = np.array([np.sqrt(2 * float(fit.cost) / (count * each - 9)), np.sqrt(2 * float(gyro.cost) / left), np.nan])
    low = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    judged = judge(gyro, at, plain, seen, count, len(turned), angle, low, sigma, options, True, list(choice.warnings))
    if judged.verdict == "refused" and (why := explanation(bias, up, turns, scale)):
        judged = Judgement(judged.verdict, f"{judged.reason} {why}", judged.warnings)
    outside = _held_out(record, start, each, slots, fit.model, gyro.model.gyro, turns, options) if held_out else np.full(2, np.nan)
    return ImuFit(
        accel=model.accel, gyro=model.gyro, covariance=plain, interval=intervals(at, plain, freedom), robust_covariance=robust,
        degrees_of_freedom=freedom, residual_norm=norm, residual_turn=angle, sigma=sigma, cost=np.array([fit.cost, gyro.cost], dtype=float),
        held_out=outside, still=choice.still, thresholds=choice.table, observability=seen, rate=record.rate, gravity=options.gravity,
        temperature=record.temperature, verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings,
        convention=options.convention, method="imu_tk",
    )  # fmt: skip


def _verticals(record: Recording, fit: Fit, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """Direction of the mean corrected specific force of every interval."""
    accel = jax.tree.map(np.asarray, fit.model.accel)
    force = accel.correct(np.array([record.accel[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)]))
    return force / np.linalg.norm(force, axis=1, keepdims=True)


def _held_out(
    record: Recording, start: np.ndarray, each: int, slots: int, model: Imu, gyro: Triad, turns: Turns, options: Options
) -> np.ndarray:
    """As for the joint fit: rms of norms and of turns' components that the fit did not see."""
    count = len(start)
    data = norms(np.concatenate([record.accel[i : i + each] for i in start]), slots * each, options.gravity)
    mean = np.array([record.accel[i : i + each].mean(axis=0) for i in start])
    even, valid, squares = np.arange(slots) % 2 == 0, np.isfinite(turns.sigma), ([], [])
    for inside in (even, ~even):
        if inside[:count].sum() < 9:
            return np.full(2, np.nan)
        poses = eqx.tree_at(lambda p: p.sigma, data.poses, np.where(np.repeat(inside, each), data.poses.sigma, np.inf))
        fit = solved(model, eqx.tree_at(lambda d: d.poses, data, poses), rtol=None)
        force = np.asarray(jax.tree.map(np.asarray, fit.model.accel).correct(mean))
        squares[0].append((options.gravity - np.linalg.norm(force, axis=1))[~inside[:count]] ** 2)
        up = padded(_verticals(record, fit, start, start + each), slots)
        part = eqx.tree_at(lambda t: t.sigma, turns, np.where(inside[:-1], turns.sigma, np.inf))
        turned = np.asarray(turn_residuals(*arrays((gyro_fit(gyro, part, up).model, Fixed(turns, up)))))
        squares[1].append(turned[~inside[:-1] & valid] ** 2)
    return np.array([np.sqrt(np.mean(np.concatenate(part))) for part in squares])
