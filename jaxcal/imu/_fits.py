"""The joint fit of a recording (host), in rounds that estimate the sizes of the errors."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from .._arrays import axis_fault, axis_turns, axis_words
from .._errors import DataError
from .._special import chi_square_tail
from .._units import factor
from ..fitting import AbstractLoss, Fit
from ..fitting._result import leverage
from ._estimate import solved
from ._findings import FINDINGS
from ._model import FITTED_LEVEL, Imu, Triad
from ._prior import Prior, complete
from ._recording import Rests
from ._residuals import Pieces, Turns, Weighted, pieces, reweighted

#: what is known of a device: a mapping by sensor, or a result or calibration that holds it
Knowledge = Mapping[str, Any] | eqx.Module | None
#: rad, assumed error of a turn in the first fit. Residuals of the start do not show it: with a range that is set wrong by 2 they are as
#: large as the turns
_FIRST_TURN = 0.02
ROUNDS = 3  # of fits: the sizes of the errors then change by less than their own uncertainty
_CLIP = 2.5  # standard deviations: beyond them a residual counts as this large


class Options(eqx.Module):
    """Options of the fit; the noise of each sensor is (N, B, K) in SI."""

    gravity: float
    convention: str
    g_sensitivity: bool
    misalignment: bool
    loss: AbstractLoss | None
    accel_noise: tuple[float, float, float]
    gyro_noise: tuple[float, float, float]
    latitude: float | None
    prior: Prior | None = None
    held: np.ndarray | None = None  # (9,) standard deviations of a prior that holds the g-sensitivity near zero

    @property
    def priors(self) -> tuple[Prior, ...]:
        """Priors for a fit. There is always one, perhaps of zeros, so that a new prior needs no new compilation."""
        return (jax.tree.map(jnp.asarray, complete(self.prior, self.held)),)


def excess(residual: np.ndarray, base: np.ndarray, parameters: Any) -> float:
    """Variance to add to `base` so that it matches the residuals, which are clipped at 2.5 standard deviations.

    Each of n residuals counts as 1 - p/n degrees of freedom, because p parameters were fitted to them.
    """
    residual, base = np.ravel(residual), np.ravel(base)
    freedom = max(len(residual) - parameters, 1.0)
    kept = float(1.0 - chi_square_tail(_CLIP**2, 3) + _CLIP**2 * chi_square_tail(_CLIP**2, 1))  # mean square of a clipped normal residual

    def surplus(extra: float) -> float:
        return float(np.sum(np.minimum(residual**2 / (base + extra), _CLIP**2)) / kept - freedom)

    top = float(np.sum(residual**2))
    floor = 1e-16 * top + 1e-300
    if surplus(floor) <= 0:
        return floor if not np.all(base > 0) else 0.0
    return float(scipy.optimize.brentq(surplus, floor, max(2 * top, 2 * floor), xtol=1e-18 * top, rtol=1e-10))  # type: ignore[arg-type]


def coefficients(noise: Any, sensor: str) -> tuple[float, float, float]:
    """White noise N, bias instability B and random walk K of a sensor, of its noisiest axis, in SI; zero if unknown.

    `noise` is {"accel": ..., "gyro": ...}, or channel -> noise as in the result of `jaxcal.noise.characterise`, or has one of these as
    its attribute `noise`.
    """

    def part(whole: Any, name: str) -> Any:
        return whole.get(name) if isinstance(whole, Mapping) else getattr(whole, name, None)

    held = noise if part(noise, "noise") is None else part(noise, "noise")
    if not (held is None or isinstance(held, Mapping) or hasattr(held, sensor)):
        raise DataError('noise must be {"accel": ..., "gyro": ...} with a Noise, or a dictionary of N and B, for each sensor', code="noise")
    axes = [one for axis in "xyz" if (one := part(held, f"{sensor}_{axis}")) is not None] or [part(held, sensor)]
    # the fit of an axis has the coefficients in its attribute `noise`
    axes = [one if part(one, "noise") is None else part(one, "noise") for one in axes]
    sizes = []
    for term in ("N", "B", "K"):
        found = [np.max(np.nan_to_num(np.asarray(value, dtype=float))) for one in axes if (value := part(one, term)) is not None]
        sizes.append(float(max(found, default=0.0)))
        if not (np.isfinite(sizes[-1]) and min(found, default=0.0) >= 0):
            raise DataError(f"noise of {sensor}: {term} is {found!r}; expected a number that is not negative", code="noise")
    return sizes[0], sizes[1], sizes[2]


def mean_variance(noise: tuple[float, float, float], rests: Rests) -> np.ndarray:
    """Variance of the means of rests: white noise N^2/t, bias instability, and the bias's random walk from the middle of the record."""
    white, flicker, walk = noise
    return white**2 / rests.duration + 2 * np.log(2) / np.pi * flicker**2 + walk**2 * np.abs(rests.time)


def nominal_start(model: Triad, mean: np.ndarray, gravity: float) -> Triad:
    """Initial model for an accelerometer in an unknown unit: scale and bias from the extremes of the means, no misalignment."""
    low, high = mean.min(axis=0), mean.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-3 * np.abs(high - low).max())
    # an axis that was never vertical does not show its full range; take it from the other axes
    half = np.maximum(half, 0.7 * half.max())
    return eqx.tree_at(lambda t: (t.matrix, t.bias), model, (np.diag(half / gravity), (low + high) / 2))


def turn_costs(matrices: np.ndarray, bias: np.ndarray, vertical: np.ndarray, turns: Turns) -> np.ndarray:
    """Mean square of the residuals of the turns for each matrix from readings to rad/s; coarse, with a quarter of the steps of a turn."""
    middle = (turns.gyro[:, :-1] + turns.gyro[:, 1:]) / 2 - bias
    steps = (middle * turns.dt[..., None]).reshape(len(middle), -1, 4, 3).sum(axis=2)
    valid = np.isfinite(turns.sigma)
    costs = []
    for matrix in matrices:
        turn = scipy.spatial.transform.Rotation.from_rotvec((steps @ matrix.T).reshape(-1, 3)).as_matrix().reshape(*steps.shape, 3)
        while turn.shape[1] > 1:
            turn = turn[:, ::2] @ turn[:, 1::2]
        predicted = np.einsum("sji,sj->si", turn[:, 0], vertical[:-1])
        costs.append(np.mean(np.sum((predicted - vertical[1:])[valid] ** 2, axis=1)))
    return np.array(costs)


def scanned_scale(bias: np.ndarray, vertical: np.ndarray, turns: Turns) -> float:
    """Scale (rad/s per reading) at which the turns fit best, on a grid that covers slow and fast turns."""
    valid = np.isfinite(turns.sigma)
    fast = float(np.quantile(np.linalg.norm(turns.gyro[valid] - bias, axis=2), 0.9))
    grid = np.geomspace(0.1, 10.0, turns.dt.shape[1] // 4) / fast  # neighbours differ by 8 %, from which the fit converges
    return float(grid[np.argmin(turn_costs(grid[:, None, None] * np.eye(3), bias, vertical, turns))])


def causes(bias: np.ndarray, vertical: np.ndarray, turns: Turns, scale: float) -> list[Finding]:
    """Another unit or order of the gyroscope's axes, if one fits the turns at least ten times better."""
    turns_ = np.concatenate([axis_turns(), -axis_turns()])
    tried = [(unit, factor(unit, "gyro"), turn) for unit in ("rad/s", "deg/s") for turn in turns_]
    costs = turn_costs(np.array([scale * size * turn for _, size, turn in tried]), bias, vertical, turns)
    unit, _, turn = tried[int(np.argmin(costs))]
    if not costs.min() < 0.1 * turn_costs(scale * np.eye(3)[None], bias, vertical, turns)[0]:
        return []
    found = [FINDINGS("gyro_unit", "gyro", unit=unit)] if unit != "rad/s" else []
    if not np.array_equal(turn, np.eye(3)):
        found.append(FINDINGS("gyro_axes", "gyro", what=axis_fault(turn.T), axes=axis_words(turn)))
    return found


class Joint(eqx.Module):
    """A joint fit, its data, and its residuals of three kinds: norm (m/s^2), turn (rad), rest (rad/s).

    sigma : (3,) their standard deviations, in these units. least : (3,) share of it that the noise of the sensors alone explains.
    """

    fit: Fit
    data: Weighted
    found: Pieces
    sigma: np.ndarray
    least: np.ndarray

    @property
    def kinds(self) -> np.ndarray:
        """Kind of each residual (0, 1, 2), without those of the heading."""
        slots = len(self.found.norm)
        return np.repeat([0, 1, 2], [slots, 2 * slots - 2, 3 * slots])[: len(self.fit.residuals)]


def rest_start(rests: Rests, force: np.ndarray, with_force: bool, earth: np.ndarray) -> tuple[np.ndarray, np.ndarray, bool]:
    """Bias and g-sensitivity by least squares on the rates at rest, and whether the bias drifts (F test at 1 %)."""
    x, y = np.concatenate([np.ones((len(force), 1)), force[:, : 3 * with_force]], axis=1), rests.gyro - earth
    beta, more = np.linalg.lstsq(x, y)[:2]
    less = np.linalg.lstsq(np.concatenate([x, rests.time[:, None]], axis=1), y)[1].sum()
    freedom = 3 * (len(x) - x.shape[1] - 1)
    drifts = freedom > 6 and less > 0 and scipy.special.fdtrc(3, freedom, (more.sum() - less) / 3 / (less / freedom)) < FITTED_LEVEL
    return beta[0], beta[1:].T if with_force else np.zeros((3, 3)), bool(drifts)


def _sized(
    data: Weighted, found: Pieces, rests: Rests, options: Options, model: Imu, paid: np.ndarray
) -> tuple[Weighted, np.ndarray, np.ndarray]:
    """Set the standard deviations of the data by the size of the residuals; return the data, the mean sizes, and what the noise
    of the sensors alone explains of each.

    `paid` (5,) is the number of parameters fitted to the magnitudes, the turns, and each axis of the rests. No standard deviation is
    below the one that the noise coefficients give or, without them, the scatter within the rests.
    """
    turns: Any = data.turns
    gyro, across_norm = model.gyro, found.vertical[: len(rests.accel)] @ np.linalg.inv(model.accel.matrix)
    count, valid = len(rests.accel), np.isfinite(turns.sigma)
    given = np.max([options.accel_noise, options.gyro_noise], axis=1) > 0
    base = mean_variance(options.accel_noise, rests) if given[0] else rests.norm_variance(across_norm)
    variance = base + excess(found.norm[:count], base, paid[0])

    scale = np.abs(np.diag(gyro.matrix))
    scatter = rests.gyro_variance()
    still = mean_variance(options.gyro_noise, rests)[:, None] * scale**2 if given[1] else scatter
    more = np.array([excess(np.asarray(found.rest)[:count, axis], still[:, axis], paid[2 + axis]) for axis in range(3)])

    across = np.einsum("sij,si->sj", data.tangent, found.turned)[valid]
    # the stillest rest shows the noise of the sensor alone; the others include motion of the hand
    density = options.gyro_noise[0] ** 2 if given[1] else np.max(np.min(scatter * rests.duration[:, None], axis=0) / scale**2)
    white = density * turns.dt.sum(axis=1)[valid]
    upright = np.stack([np.pad(one, (0, rests.slots - count)) for one in (base, variance)]) / options.gravity**2
    least, around = (upright[:, :-1] + upright[:, 1:])[:, valid]
    # neighbouring turns share a pose, so a turn without an error of its own would make the covariance singular
    turn = np.maximum(white + excess(across, np.repeat((white + around)[:, None], 2, axis=1), paid[1]), 1e-3 * around)
    sigma = np.full(len(valid), np.inf)
    sigma[valid] = np.sqrt(turn)
    sizes = np.sqrt([np.mean(variance), np.mean(turn + around), np.mean((still + more) / scale**2)])
    shares = np.sqrt([np.mean(base / variance), np.mean((white + least) / (turn + around)), np.mean(still / (still + more))])
    poses = rests.poses(np.sqrt(variance), np.sqrt(still + more))
    return dataclasses.replace(data, poses=poses, turns=dataclasses.replace(turns, sigma=sigma)), sizes, shares


def refitted(start: Imu, data: Weighted, options: Options) -> Fit:
    """Fit once, with the standard deviations of the data unchanged."""
    return solved(start, data, options.convention, options.misalignment, options.g_sensitivity, options.loss, priors=options.priors)


def joint_fit(start: Imu, data: Weighted, rests: Rests, options: Options, paid: int, near: bool = False, rounds: int = ROUNDS) -> Joint:
    """Fit, estimate the sizes of the errors, and fit again; `paid` is the number of accelerometer parameters.

    If `near`, the start is close to the solution: its residuals already show the sizes of the errors, and the first fit is skipped.
    """
    found, sizes, slots, fit = pieces(start, data), (), rests.slots, None
    data = dataclasses.replace(data, tangent=found.tangent)
    per_axis = 1 + 3 * (options.g_sensitivity and options.held is None) + (start.drift is not None)
    traces, model = np.array([paid, 9, per_axis, per_axis, per_axis]), start
    turns: Any = data.turns
    if not near:
        data = _sized(data, found, rests, options, start, traces)[0]
        data = dataclasses.replace(data, whiten=np.diag(np.repeat(np.isfinite(turns.sigma), 2) / _FIRST_TURN))
        fit = refitted(start, data, options)
    for _ in range(rounds - (not near)):
        if fit is not None:
            # each kind of residual uses as many degrees of freedom as the trace of its part of the hat matrix
            norm, turned, rest = np.split(np.asarray(leverage(fit))[: 6 * slots - 2], [slots, 3 * slots - 2])
            traces, model = np.array([norm.sum(), turned.sum(), *rest.reshape(-1, 3).sum(axis=0)]), fit.model
            found = pieces(model, data)
        data, *sizes = _sized(data, found, rests, options, model, traces)
        data = jax.tree.map(np.asarray, reweighted(model, data, found))
        fit = refitted(model, data, options)
    assert fit is not None
    return Joint(fit, data, pieces(fit.model, data), *sizes)


def left_out(joint: Joint) -> tuple[float, int]:
    """Leave-one-out mean square of the components of the turns, to first order, and the number of turns."""
    data, turns, slots = joint.data, joint.data.turns, len(joint.found.norm)
    assert turns is not None
    valid = np.isfinite(turns.sigma)
    share = np.asarray(leverage(joint.fit))[slots : 3 * slots - 2].reshape(-1, 2).mean(axis=1)
    across = np.einsum("sij,si->sj", data.tangent, joint.found.turned) / (1 - np.minimum(share, 0.9))[:, None]
    return float(np.mean(across[valid] ** 2)), int(valid.sum())


def held_out(joint: Joint, options: Options) -> tuple[np.ndarray, np.ndarray]:
    """Held-out rms of the magnitudes and of the components of the turns, by two-fold cross-validation, and the angle after each turn.

    NaN with too few of them.
    """
    data, turns = joint.data, joint.data.turns
    assert turns is not None
    known, valid, whiten = np.isfinite(data.poses.sigma), np.isfinite(turns.sigma), np.asarray(data.whiten)
    even, parts = np.arange(len(known)) % 2 == 0, []
    angle = np.full(len(valid), np.nan)
    for inside in (even, ~even):
        if np.sum(known[inside]) < 9 or np.sum(valid[inside[:-1]]) < 6:
            return np.full(2, np.nan), angle[valid]
        keep = np.repeat(inside[:-1], 2)
        sigma = np.where(inside, data.poses.sigma, np.inf)
        still = np.where(inside[:, None], data.poses.gyro_sigma, np.inf)
        half = dataclasses.replace(
            data, poses=dataclasses.replace(data.poses, sigma=sigma, gyro_sigma=still),
            whiten=np.where(keep[:, None] & keep[None, :], whiten, 0.0),
        )  # fmt: skip
        found = pieces(refitted(joint.fit.model, half, options).model, data)
        out = ~inside[:-1] & valid
        angle[out] = np.linalg.norm(found.turned[out], axis=1)
        parts.append((found.norm[~inside & known], found.turned[out]))
    return np.array([np.sqrt(np.mean(np.concatenate(kind) ** 2)) for kind in zip(*parts, strict=True)]), angle[valid]
