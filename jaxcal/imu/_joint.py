"""The joint fit of a recording: rounds in which the sizes of the errors are found, and its check on data left out (host)."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy.stats

from ..fitting import AbstractLoss, Fit
from ._estimate import solved
from ._linear import least_squares
from ._model import Imu
from ._poses import Rests
from ._residuals import Pieces, Weighted, pieces, reweighted
from ._scales import excess, leverage, mean_variance
from ._triad import Triad

_FIRST_TURN = 0.02  # rad, before the turns have told their own size
_ROUNDS = 3
_DRIFT_LEVEL = 0.01


class Options(eqx.Module):
    """What the joint fit may do; noise as (N, B) of both sensors in SI."""

    gravity: float
    convention: str
    g_sensitivity: bool
    misalignment: bool
    loss: AbstractLoss | None
    accel_noise: tuple[float, float]
    gyro_noise: tuple[float, float]
    latitude: float | None


class Joint(eqx.Module):
    """A joint fit, its data, residuals in physical units, and the sizes of its errors: norm (m/s^2), turn (rad), rest (rad/s)."""

    fit: Fit
    data: Weighted
    found: Pieces
    sigma: np.ndarray


def described(model: Imu, data: Weighted) -> Pieces:
    """Residuals in physical units, as NumPy arrays."""
    return jax.tree.map(np.asarray, pieces(model, data))


def rest_start(rests: Rests, force: np.ndarray, with_force: bool, earth: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Bias and g-sensitivity by least squares on the still rates, and whether the bias drifts (F test at 1 %)."""
    columns = [np.ones((len(force), 1))] + ([force] if with_force else [])
    x, y = np.concatenate(columns, axis=1), rests.gyro - earth
    found = least_squares(x, y)
    longer = least_squares(np.concatenate([x, rests.time[:, None]], axis=1), y)
    freedom = 3 * (len(x) - x.shape[1] - 1)
    less, more = np.sum(longer.residual**2), np.sum(found.residual**2)
    drifts = freedom > 6 and less > 0 and scipy.stats.f.sf((more - less) / 3 / (less / freedom), 3, freedom) < _DRIFT_LEVEL
    return found.beta[0], found.beta[1:].T if with_force else np.zeros((3, 3)), bool(drifts)


def _paid(fit: Fit, slots: int) -> np.ndarray:
    """How many parameters each kind of residual pays for, the traces of their parts of the hat matrix: norms, turns, rests (3)."""
    hat, turns = leverage(fit), 3 * slots - 2
    return np.array([hat[:slots].sum(), hat[slots:turns].sum(), *hat[turns : turns + 3 * slots].reshape(-1, 3).sum(axis=0)])


def _sized(data: Weighted, found: Pieces, rests: Rests, options: Options, gyro: Triad, paid: np.ndarray) -> tuple[Weighted, np.ndarray]:
    """The same data with errors as large as the residuals say, and these sizes; `paid` as from `_paid`."""
    turns: Any = data.turns
    count, valid = len(rests.accel), np.isfinite(turns.sigma)
    base = mean_variance(options.accel_noise, rests.duration)
    variance = base + excess(found.norm[:count], base, paid[0])

    scale = np.abs(np.diag(gyro.matrix))
    still = mean_variance(options.gyro_noise, rests.duration)[:, None] * scale**2
    rest: Any = found.rest
    still = still + np.array([excess(rest[:count, axis], still[:, axis], paid[2 + axis]) for axis in range(3)])

    across = np.einsum("sij,si->sj", data.tangent, found.turned)[valid]
    white = options.gyro_noise[0] ** 2 * turns.dt.sum(axis=1)[valid]
    upright = np.concatenate([variance, np.zeros(rests.slots - count)]) / options.gravity**2
    around = (upright[:-1] + upright[1:])[valid]
    # a turn without an error of its own would make the covariance singular where poses are shared
    turn = np.maximum(white + excess(across, np.repeat((white + around)[:, None], 2, axis=1), paid[1]), 1e-3 * around)
    sigma = np.full(len(valid), np.inf)
    sigma[valid] = np.sqrt(turn)
    sizes = np.sqrt([np.mean(variance), np.mean(turn + around), np.mean(still / scale**2)])
    return dataclasses.replace(
        data, poses=rests.poses(np.sqrt(variance), np.sqrt(still)), turns=dataclasses.replace(turns, sigma=sigma)
    ), sizes


def refitted(start: Imu, data: Weighted, options: Options) -> Fit:
    """One fit with the errors as they stand in the data."""
    return solved(start, data, options.convention, options.misalignment, options.g_sensitivity, options.loss)


def joint_fit(start: Imu, data: Weighted, rests: Rests, options: Options, paid: int) -> Joint:
    """Fit, find the sizes of the errors, and fit again; `paid` is the number of parameters of the accelerometer."""
    found = described(start, data)
    data = dataclasses.replace(data, tangent=found.tangent)
    # still rates and norms are in order from the start; turns are not
    per_axis = 1 + 3 * options.g_sensitivity + (start.drift is not None)
    turns: Any = data.turns
    data = _sized(data, found, rests, options, start.gyro, np.array([paid, 9, per_axis, per_axis, per_axis]))[0]
    data = dataclasses.replace(data, whiten=np.diag(np.repeat(np.isfinite(turns.sigma), 2) / _FIRST_TURN))
    fit = refitted(start, data, options)
    sizes = np.zeros(3)
    for _ in range(_ROUNDS - 1):
        found = described(fit.model, data)
        data, sizes = _sized(data, found, rests, options, fit.model.gyro, _paid(fit, rests.slots))
        data = jax.tree.map(np.asarray, reweighted(fit.model, data, found))
        fit = refitted(fit.model, data, options)
    return Joint(fit, data, described(fit.model, data), sizes)


def held_out(joint: Joint, options: Options) -> np.ndarray:
    """Root mean square of norms and of turns' components, fitted on even poses and turns and seen on odd ones, and the reverse."""
    squares: list[list[np.ndarray]] = [[], []]
    data, turns = joint.data, joint.data.turns
    assert turns is not None
    known, valid, whiten = np.isfinite(data.poses.sigma), np.isfinite(turns.sigma), np.asarray(data.whiten)
    even = np.arange(len(known)) % 2 == 0
    for inside in (even, ~even):
        if np.sum(known[inside]) < 9 or np.sum(valid[inside[:-1]]) < 6:
            return np.full(2, np.nan)
        keep = np.repeat(inside[:-1], 2)
        sigma = np.where(inside, data.poses.sigma, np.inf)
        still = np.where(inside[:, None], data.poses.gyro_sigma, np.inf)
        half = dataclasses.replace(
            data, poses=dataclasses.replace(data.poses, sigma=sigma, gyro_sigma=still),
            whiten=np.where(keep[:, None] & keep[None, :], whiten, 0.0),
        )  # fmt: skip
        found = described(refitted(joint.fit.model, half, options).model, data)
        squares[0].append(found.norm[~inside & known] ** 2)
        squares[1].append(np.asarray(found.turned)[~inside[:-1] & valid] ** 2)
    return np.array([np.sqrt(np.mean(np.concatenate(part))) for part in squares])
