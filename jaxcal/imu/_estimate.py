"""The joint fit: start, rounds in which the sizes of the errors are found, and its covariance."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
import scipy.stats

from ..fitting import Fit, Huber, covariance, solve
from ._gravity import EARTH_RATE
from ._joint import ImuParameters, Joint, Poses, attitudes, joint_residuals, parts
from ._linear import least_squares
from ._norms import AccelParameters, GyroParameters, Norms, norm_residuals
from ._recording import Recording
from ._result import flattened
from ._scales import excess, mean_variance, tangents, whitening
from ._turns import Segments

#: step to go, of the statistical uncertainty, at which a fit is done
RTOL = 1e-4
_FIRST_TURN = 0.02  # rad, before the turns have told their own size
_ROUNDS = 3
_DRIFT_LEVEL = 0.01


class Means(eqx.Module):
    """Means over k still intervals: readings (k, 3), middle (s from the middle of the record), duration (s)."""

    accel: np.ndarray
    gyro: np.ndarray
    time: np.ndarray
    duration: np.ndarray


class Options(eqx.Module):
    """What the joint fit may do; noise as (N, B) of both sensors in SI."""

    gravity: float
    g_sensitivity: bool
    diagonal: bool
    robust: bool
    accel_noise: tuple[float, float]
    gyro_noise: tuple[float, float]
    latitude: float | None


class Estimate(eqx.Module):
    """A joint fit, its data and the sizes of its errors: norm (m/s^2), turn (rad), rest (rad/s)."""

    fit: Fit
    data: Joint
    sigma: np.ndarray
    pieces: tuple[Any, ...]
    free_drift: bool


def means_of(recording: Recording, start: np.ndarray, stop: np.ndarray) -> Means:
    """Means over whole intervals."""
    accel = np.array([recording.accel[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])
    gyro = accel * 0 if recording.gyro is None else np.array([recording.gyro[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])
    first, last = recording.time[start], recording.time[stop - 1]
    return Means(accel, gyro, (first + last) / 2 - recording.time[-1] / 2, (stop - start) / recording.rate)


def padded(x: np.ndarray, slots: int) -> np.ndarray:
    """The first row repeated up to so many rows."""
    return np.concatenate([x, np.repeat(x[:1], slots - len(x), axis=0)])


def weights(count: int, slots: int) -> np.ndarray:
    """One for each of `count`, zero for padding."""
    return (np.arange(slots) < count).astype(float)


def fit_norms(
    mean: np.ndarray, weight: np.ndarray, begin: AccelParameters, gravity: float, diagonal: bool, robust: float | None = None
) -> Fit:
    """Nine (or six) parameters of the accelerometer from padded means; with `robust`, their standard deviation, by Huber's loss."""
    free = AccelParameters(not diagonal, True, True)
    data = Norms(mean, weight, gravity, 1.0 if robust is None else robust)
    return solve(norm_residuals, begin, data, free=free, loss=None if robust is None else Huber())


@jax.jit
def _described(p: ImuParameters, data: Joint) -> tuple[Any, ...]:
    return *parts(p, data), attitudes(p, data)


def describe(p: ImuParameters, data: Joint) -> tuple[np.ndarray, ...]:
    """Norms, turns, rests, verticals and the rotation of every segment, as NumPy arrays."""
    p, data = jax.tree.map(jnp.asarray, (p, data))
    return tuple(np.asarray(piece) for piece in _described(p, data))


def rest_start(means: Means, force: np.ndarray, with_force: bool, earth: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Bias and g-sensitivity by least squares on the still rates, and whether the bias drifts (F test at 1 %)."""
    columns = [np.ones((len(force), 1))] + ([force] if with_force else [])
    x = np.concatenate(columns, axis=1)
    y = means.gyro - earth
    found = least_squares(x, y)
    longer = least_squares(np.concatenate([x, means.time[:, None]], axis=1), y)
    freedom = 3 * (len(x) - x.shape[1] - 1)
    less, more = np.sum(longer.residual**2), np.sum(found.residual**2)
    drifts = freedom > 6 and less > 0 and scipy.stats.f.sf((more - less) / 3 / (less / freedom), 3, freedom) < _DRIFT_LEVEL
    bias, force_part = found.beta[0], found.beta[1:].T if with_force else np.zeros((3, 3))
    return bias, force_part, bool(drifts)


def joint_data(
    recording: Recording, means: Means, segments: Segments, accel: AccelParameters, bias: np.ndarray, options: Options, slots: int
) -> Joint:
    """Everything but the sizes of the errors, which are those of the first round."""
    poses = Poses(padded(means.accel, slots), padded(means.gyro, slots), weights(len(means.accel), slots), padded(means.time, slots))
    force = (poses.accel - np.asarray(accel.bias)) @ np.asarray(accel.correction()).T
    up = force / np.linalg.norm(force, axis=1, keepdims=True)
    latitude = options.latitude
    earth = None if latitude is None else EARTH_RATE * np.array([np.sin(latitude), np.cos(latitude)])
    return Joint(
        poses=poses, segments=segments, origin=np.concatenate([bias, np.asarray(accel.bias)]), gravity=options.gravity,
        sigma_norm=np.ones(slots), sigma_rest=np.ones((slots, 3)), tangent=tangents(up[segments.second]),
        whiten=np.eye(2 * len(segments.first)) * np.repeat(segments.weight, 2) / _FIRST_TURN,
        time=(segments.weight * np.asarray(means.time)[np.minimum(segments.first, len(means.time) - 2)]), earth=earth,
        sigma_north=np.full(2, np.sqrt(0.5)),
    )  # fmt: skip


def shares(fit: Fit, slots: int) -> np.ndarray:
    """How many parameters each kind of residual pays for, the traces of their parts of the hat matrix: norms, turns, rests (3)."""
    jacobian = np.asarray(fit.jacobian) * np.sqrt(np.asarray(fit.weights))[:, None]
    size = np.linalg.norm(jacobian, axis=0)
    leverage = np.sum(np.linalg.qr(jacobian / np.where(size > 0, size, 1))[0] ** 2, axis=1)
    return np.array(
        [leverage[:slots].sum(), leverage[slots : 3 * slots].sum(), *leverage[3 * slots : 6 * slots].reshape(-1, 3).sum(axis=0)]
    )


def sized(
    data: Joint, pieces: tuple[Any, ...], means: Means, options: Options, p: ImuParameters, paid: np.ndarray
) -> tuple[Joint, np.ndarray]:
    """The same data with errors as large as the residuals say, and these sizes; `paid` as from `shares`."""
    norm, turned, rest, _, rotation = pieces
    scale = 1 / np.abs(np.asarray(p.gyro.scale))
    slots, count = len(norm), len(means.accel)
    kept = np.flatnonzero(np.asarray(data.poses.weight) > 0)
    valid = np.asarray(data.segments.weight) > 0
    base = np.full(slots, 0.0)
    base[:count] = mean_variance(options.accel_noise, means.duration)
    add = excess(norm[kept], base[kept], paid[0])
    variance = base + add
    upright = variance / options.gravity**2

    still = np.zeros((slots, 3))
    still[:count] = mean_variance(options.gyro_noise, means.duration)[:, None] * scale**2
    more = np.array([excess(rest[kept, axis], still[kept, axis], paid[2 + axis]) for axis in range(3)])
    still = still + more[None, :]

    across = np.einsum("sij,si->sj", data.tangent, turned)
    white = options.gyro_noise[0] ** 2 * np.asarray(data.segments.duration)
    first = np.asarray(data.segments.first)
    around = upright[first] + upright[np.asarray(data.segments.second)]
    extra = excess(across[valid], np.repeat((white + around)[valid][:, None], 2, axis=1), paid[1])
    # a turn without an error of its own would make the covariance singular where poses are shared
    turn = np.maximum(white + extra, 1e-3 * around)
    whiten = whitening(turn, upright, np.asarray(data.tangent), rotation, first, valid)
    sizes = np.array([np.sqrt(np.mean(variance[kept])), np.sqrt(np.mean((turn + around)[valid])), np.sqrt(np.mean(still[kept] / scale**2))])
    out = np.asarray(data.poses.weight) <= 0
    return dataclasses.replace(
        data, sigma_norm=np.where(out, 1.0, np.sqrt(np.where(out, 1.0, variance))),
        sigma_rest=np.where(out[:, None], 1.0, np.sqrt(np.where(out[:, None], 1.0, still))), whiten=whiten,
    ), sizes  # fmt: skip


def free_of(options: Options, drift: bool) -> ImuParameters:
    """Which parameters are fitted."""
    return ImuParameters(
        AccelParameters(not options.diagonal, True, True),
        GyroParameters(True, True, True, options.g_sensitivity),
        drift,
        options.latitude is not None,
    )


def refitted(begin: ImuParameters, data: Joint, options: Options, drift: bool) -> Fit:
    """One fit with the errors as they stand in the data."""
    return solve(joint_residuals, begin, data, free=free_of(options, drift), loss=Huber() if options.robust else None, rtol=RTOL)


def joint_fit(begin: ImuParameters, data: Joint, means: Means, options: Options, drift: bool, rounds: int = _ROUNDS) -> Estimate:
    """Fit, find the sizes of the errors, and fit again."""
    pieces = describe(begin, data)
    # still rates and norms are in order from the start; turns are not
    per_axis = 1 + 3 * options.g_sensitivity + drift
    norms, _ = sized(data, pieces, means, options, begin, np.array([6 if options.diagonal else 9, 9, per_axis, per_axis, per_axis]))
    data = dataclasses.replace(norms, whiten=data.whiten)
    sizes = np.zeros(3)
    fit = None
    for turn in range(rounds):
        fit = refitted(begin, data, options, drift)
        begin = fit.model
        if turn + 1 < rounds:
            data, sizes = sized(data, describe(begin, data), means, options, begin, shares(fit, len(data.poses.weight)))
    assert fit is not None
    return Estimate(fit, data, sizes, describe(begin, data), drift)


@eqx.filter_jit
def _slopes(values: Any, model: ImuParameters, convention: str) -> Any:
    _, put = jax.flatten_util.ravel_pytree(model)
    return flattened(put(values), convention), jax.jacfwd(lambda x: flattened(put(x), convention))(values)


def spread(fit: Fit, free: ImuParameters, convention: str, clusters: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """The 33 parameters, their covariance, and its sandwich form with the given clusters."""
    vector, _ = jax.flatten_util.ravel_pytree(fit.model)
    mask = np.concatenate(
        [np.ravel(np.broadcast_to(f, np.shape(leaf))) for f, leaf in zip(_flags(free, fit.model), jax.tree.leaves(fit.model), strict=True)]
    )
    values, slope = (np.asarray(x) for x in _slopes(vector, fit.model, convention))
    slope = slope[:, np.flatnonzero(mask)]
    plain = slope @ np.asarray(covariance(fit, scaled=True)) @ slope.T
    robust = None if clusters is None else slope @ sandwich(fit, clusters) @ slope.T
    return values, plain, robust


def _flags(free: Any, model: Any) -> list[Any]:
    return jax.tree.leaves(jax.tree.map(lambda flag, part: jax.tree.map(lambda _: flag, part), free, model))


def sandwich(fit: Fit, clusters: np.ndarray) -> np.ndarray:
    """Cluster-robust covariance whose clusters are freed of their own leverage, which a fit of few clusters needs.

    R. M. Bell and D. F. McCaffrey, Survey Methodology 28 (2002) 169: residuals of a cluster times (1 - H)^-1/2, H its part of the
    hat matrix; unbiased where the errors are alike.
    """
    root = np.sqrt(np.asarray(fit.weights))
    jacobian, residual = np.asarray(fit.jacobian) * root[:, None], np.asarray(fit.residuals) * root
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1)
    q, r = np.linalg.qr(jacobian / size)
    inverse = np.linalg.inv(r) / size[:, None]
    meat = np.zeros((jacobian.shape[1],) * 2)
    for label in np.unique(clusters):
        rows = np.flatnonzero((clusters == label) & np.asarray(fit.counted))
        if len(rows):
            part = q[rows]
            values, vectors = np.linalg.eigh(np.eye(len(rows)) - part @ part.T)
            score = part.T @ (vectors @ ((vectors.T @ residual[rows]) / np.sqrt(np.maximum(values, 1e-6))))
            meat += np.outer(score, score)
    return inverse @ meat @ inverse.T
