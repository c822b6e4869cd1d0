"""Iterative fits of scaled readings, orthogonal and radial, with robust losses, through the package's one solver."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._types import AnyArray, Array
from ..fitting import AbstractLoss, Cauchy, Fit, Huber, Tukey, covariance, solve
from ._efficiency import Penalty
from ._residuals import Readings, orthogonal, radial
from ._start import COUNT, basis_of, padded_length, parameters_of, robust_start, start

LOSSES: dict[str, AbstractLoss] = {"huber": Huber(), "cauchy": Cauchy(), "tukey": Tukey()}
_ROUNDS = 5
_PRECISE = 1e-5  # step to go, relative to the statistical uncertainty


class Found(eqx.Module):
    """An ellipsoid in scaled readings: shape and centre, (9, 9) covariance of its parameters, noise, distances and weights.

    noise2 : the variance whose curvature term was taken off the distances.
    penalty : weight of the penalty on directions in a corner, zero where it had no part; pull : how far it moved the fit, in
        standard errors of what the readings alone say. discord : of the field that the readings alone give and the known one.
    """

    parameters: np.ndarray
    shape: np.ndarray
    centre: np.ndarray
    covariance: np.ndarray
    noise: float
    distance: np.ndarray
    weight: np.ndarray
    converged: bool
    kind: str = eqx.field(static=True)
    message: str = eqx.field(static=True, default="")
    noise2: float = 0.0
    penalty: float = 0.0
    pull: float = 0.0
    discord: float = 0.0


def padded(u: np.ndarray, kind: str, scale: float = 1.0, noise2: float = 0.0, penalty: Penalty | None = None) -> Readings:
    """Readings filled up to a power of two with weight zero, so that logs of any length share a compiled program."""
    size = padded_length(len(u))
    full = np.concatenate([u, np.repeat(u[:1], size - len(u), axis=0)])
    weight = (np.arange(size) < len(u)).astype(float)
    return Readings(full, weight, np.float64(scale), np.float64(noise2), basis_of(kind), penalty)


def bounds_of(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Idle parameters are held at zero: so all kinds share one program."""
    idle = np.arange(9) >= COUNT[kind]
    return np.where(idle, 0.0, -np.inf), np.where(idle, 0.0, np.inf)


class Solved(eqx.Module):
    """A fit of the readings with what is asked of every one."""

    fit: Fit
    usable: Array
    covariance: AnyArray


@functools.partial(jax.jit, static_argnames=("function", "loss"))
def attempt(function: Callable, start: AnyArray, data: Readings, bounds: tuple[AnyArray, AnyArray], loss: str | None) -> Solved:
    """A fit, its covariance and whether it converged as one program: a fit of some hundred readings takes less than to call them.

    Several rows of `start` are tried, and the best is kept. Residuals beyond those of the readings, of penalty and prior, move the fit
    and are then left out: covariance and weights are those of the readings.
    """
    begin, starts = (start, None) if start.ndim == 1 else (start[0], start)
    fit = solve(function, begin, data, loss=None if loss is None else LOSSES[loss], bounds=bounds, starts=starts, rtol=_PRECISE)
    own = lambda f: (f.residuals, f.jacobian, f.weights, f.curvature)  # noqa: E731
    fit = eqx.tree_at(own, fit, tuple(x[: len(data.u)] for x in own(fit)))
    return Solved(eqx.tree_at(lambda f: f.problem, fit, None), fit.usable, covariance(fit, scaled=True))


def flat(u: np.ndarray, kind: str, loss: str | None = None, cost: str = "orthogonal", begin: np.ndarray | None = None) -> Found:
    """The same without the curvature term: enough to compare models, which all have a radius to take up its mean."""
    if begin is None:
        begin = parameters_of(kind, *(start if loss is None else robust_start)(u, kind))
    function = radial if cost == "radial" else orthogonal
    if loss is None:
        solved, scale = attempt(function, begin, padded(u, kind), bounds_of(kind), None), 1.0
    else:
        solved, scale = _robust(function, begin, u, kind, loss)
    if cost == "radial":
        # its own J'J is not the information of the readings
        found = described(np.asarray(solved.fit.parameters), u, kind)
        news = (bool(solved.usable), np.asarray(solved.fit.weights)[: len(u)])
        return eqx.tree_at(lambda f: (f.converged, f.weight), found, news)
    return described_by(solved, scale, len(u), kind)


def described_by(solved: Solved, scale: float, count: int, kind: str, noise2: float = 0.0) -> Found:
    """What a solution says of the ellipsoid; infinite covariance where the readings alone do not determine it."""
    fit, usable = solved.fit, bool(solved.usable)
    parameters, residuals, covariance = np.asarray(fit.parameters), np.asarray(fit.residuals), np.asarray(solved.covariance)
    return Found(
        parameters,
        *ellipsoid(parameters, kind),
        covariance if np.isfinite(covariance).all() else np.full_like(covariance, np.inf),
        _sigma(residuals, fit.robust, scale, count, kind),
        scale * residuals[:count],
        np.asarray(fit.weights)[:count],
        usable,
        kind,
        "" if usable else fit.message,
        noise2,
    )


def upper_of(parameters: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """U and the centre (`upper_and_centre` in NumPy, which has nothing to dispatch)."""
    full = basis_of(kind) @ parameters
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = full[:6]
    return upper, full[6:]


def ellipsoid(parameters: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre."""
    upper, centre = upper_of(parameters, kind)
    return upper.T @ upper, centre


def _spread(residuals, count: int, free: int) -> float:
    """Robust standard deviation of the residuals of the readings (not of the padding)."""
    size = 1.4826 * float(np.median(np.abs(np.asarray(residuals)[:count])))
    return size * float(np.sqrt(count / max(count - free, 1)))


def _robust(function, begin, u, kind, loss) -> tuple[Solved, float]:
    """Fit and scale by turns, from a start of high breakdown point; Tukey's loss, which has many minima, could start nowhere else."""
    count, free = len(u), COUNT[kind]
    scale = max(_spread(_residuals(function, jnp.asarray(begin), _jax(padded(u, kind))), count, free), 1e-13)
    for _ in range(_ROUNDS):
        solved = attempt(function, begin, padded(u, kind, scale), bounds_of(kind), loss)
        begin, last = np.asarray(solved.fit.parameters), scale
        scale = max(_spread(solved.fit.residuals, count, free) * scale, 1e-13)
        if abs(scale - last) < 1e-3 * last:
            break
    return solved, last  # type: ignore[possibly-unbound]


@eqx.filter_jit
def _residuals(function, parameters, data):
    return function(parameters, data)


def _jax(tree):
    return jax.tree.map(jnp.asarray, tree)


def _sigma(residuals: np.ndarray, robust: bool, scale: float, count: int, kind: str) -> float:
    """Noise of a reading: of all readings, or with a robust loss of most of them."""
    if robust:
        return scale * _spread(residuals, count, COUNT[kind])
    return scale * float(np.sqrt(np.sum(residuals**2) / max(count - COUNT[kind], 1)))


@jax.jit
def _linearised(parameters, data):
    return orthogonal(parameters, data), jax.jacfwd(orthogonal)(parameters, data)


def described(parameters: np.ndarray, u: np.ndarray, kind: str) -> Found:
    """An ellipsoid that another method found, with the covariance that the readings allow there (the Cramer-Rao bound)."""
    free = COUNT[kind]
    distance, jacobian = (np.asarray(x)[: len(u)] for x in _linearised(jnp.asarray(parameters), _jax(padded(u, kind))))
    noise = float(np.sqrt(np.sum(distance**2) / max(len(u) - free, 1)))
    jacobian = jacobian[:, :free]
    column = np.linalg.norm(jacobian, axis=0)
    bound = np.zeros((9, 9))
    triangle = np.linalg.qr(jacobian / np.where(column > 0, column, 1), mode="r")
    if len(u) < free or np.linalg.cond(triangle) > 1e12:
        bound[:free, :free] = np.inf
    else:
        inverse = np.linalg.inv(triangle) / column[:, None]
        bound[:free, :free] = noise**2 * inverse @ inverse.T
    return Found(parameters, *ellipsoid(parameters, kind), bound, noise, distance, np.ones(len(u)), True, kind)


def loss_name(loss: str | None) -> str | None:
    """The loss, checked."""
    if loss is None or (isinstance(loss, str) and loss in LOSSES):
        return loss
    raise DataError(f"There is no loss {loss!r}; known are None (least squares), {', '.join(repr(name) for name in LOSSES)}.")
