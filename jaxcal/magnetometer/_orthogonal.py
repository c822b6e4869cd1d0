"""Iterative fits of scaled readings, orthogonal and radial, with robust losses, through the package's one solver."""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._solve import AbstractLoss, Cauchy, Fit, Huber, Tukey, covariance, solve
from .._types import AnyArray, Array
from ._residuals import Readings, orthogonal, radial
from ._start import COUNT, PLANAR, basis_of, parameters_of, robust_start, start

LOSSES: dict[str, AbstractLoss] = {"huber": Huber(), "cauchy": Cauchy(), "tukey": Tukey()}
CURVED = 0.02  # noise over radius above which the curvature term is worth a fit
_ROUNDS = 5
_PRECISE = 1e-5  # step to go, relative to the statistical uncertainty
_LEVELLINGS, _SETTLED = 3, 3e-3
_SMALLEST_PAD = 64


class Found(eqx.Module):
    """An ellipsoid in scaled readings: shape and centre, (9, 9) covariance of its parameters, noise, distances and weights.

    noise2 : the variance whose curvature term was taken off the distances.
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


def padded(u: np.ndarray, kind: str, scale: float = 1.0, noise2: float = 0.0) -> Readings:
    """Readings filled up to a power of two with weight zero, so that logs of any length share a compiled program."""
    size = max(_SMALLEST_PAD, 1 << (len(u) - 1).bit_length())
    full = np.concatenate([u, np.repeat(u[:1], size - len(u), axis=0)])
    weight = (np.arange(size) < len(u)).astype(float)
    return Readings(full, weight, np.float64(scale), np.float64(noise2), basis_of(kind))


def bounds_of(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Idle parameters are held at zero: so all kinds share one program."""
    idle = np.arange(9) >= COUNT[kind]
    return np.where(idle, 0.0, -np.inf), np.where(idle, 0.0, np.inf)


class _Solved(eqx.Module):
    """A fit with what is asked of every one."""

    fit: Fit
    usable: Array
    covariance: Array


@functools.partial(jax.jit, static_argnames=("function", "loss"))
def _solved(function: Callable, start: AnyArray, data: Readings, bounds: tuple[AnyArray, AnyArray], loss: str | None) -> _Solved:
    """A fit, its covariance and whether it converged as one program: a fit of some hundred readings takes less than to call them."""
    fit = solve(function, start, data, loss=None if loss is None else LOSSES[loss], bounds=bounds, rtol=_PRECISE)
    return _Solved(eqx.tree_at(lambda f: f.problem, fit, None), fit.usable, covariance(fit, scaled=True))


def geometric(u: np.ndarray, kind: str, loss: str | None = None, cost: str = "orthogonal") -> Found:
    """Least squares of orthogonal (or radial) distances, from the best algebraic start."""
    found = flat(u, kind, loss, cost)
    return found if cost == "radial" else levelled(found, u, loss)


def flat(u: np.ndarray, kind: str, loss: str | None = None, cost: str = "orthogonal", begin: np.ndarray | None = None) -> Found:
    """The same without the curvature term: enough to compare models, which all have a radius to take up its mean."""
    if begin is None:
        begin = parameters_of(kind, *(start if loss is None else robust_start)(u, kind))
    function = radial if cost == "radial" else orthogonal
    if loss is None:
        solved, scale = _solved(function, begin, padded(u, kind), bounds_of(kind), None), 1.0
    else:
        solved, scale = _robust(function, begin, u, kind, loss)
    if cost == "radial":
        # its own J'J is not the information of the readings
        found = described(np.asarray(solved.fit.parameters), u, kind)
        news = (bool(solved.usable), np.asarray(solved.fit.weights)[: len(u)])
        return eqx.tree_at(lambda f: (f.converged, f.weight), found, news)
    return _found(solved, scale, len(u), kind)


def levelled(found: Found, u: np.ndarray, loss: str | None = None) -> Found:
    """The fit with sigma^2 times the mean curvature taken off, where the noise is large enough to matter."""
    radius = float(np.linalg.det(found.shape)) ** (-1 / 6)
    if not 0.5 * radius > found.noise > CURVED * radius:
        return found
    # readings in a plane have no noise across it: of the two principal curvatures one counts
    share = 0.5 if found.kind in PLANAR else 1.0
    scale = 1.0 if loss is None else found.noise
    for _ in range(_LEVELLINGS):
        noise2 = share * found.noise**2
        solved = _solved(orthogonal, found.parameters, padded(u, found.kind, scale, noise2), bounds_of(found.kind), loss)
        last, found = found.noise, _found(solved, scale, len(u), found.kind, noise2)
        if abs(found.noise - last) < _SETTLED * last:
            break
    return found


def _found(solved: _Solved, scale: float, count: int, kind: str, noise2: float = 0.0) -> Found:
    fit, usable = solved.fit, bool(solved.usable)
    parameters, residuals = np.asarray(fit.parameters), np.asarray(fit.residuals)
    return Found(
        parameters,
        *ellipsoid(parameters, kind),
        np.asarray(solved.covariance),
        _sigma(residuals, fit.robust, scale, count, kind),
        scale * residuals[:count],
        np.asarray(fit.weights)[:count],
        usable,
        kind,
        "" if usable else fit.message,
        noise2,
    )


def ellipsoid(parameters: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre (`shape_and_centre` in NumPy, which has nothing to dispatch)."""
    full = basis_of(kind) @ parameters
    upper = np.zeros((3, 3))
    upper[np.triu_indices(3)] = full[:6]
    return upper.T @ upper, full[6:]


def _spread(residuals, count: int, free: int) -> float:
    """Robust standard deviation of the residuals of the readings (not of the padding)."""
    size = 1.4826 * float(np.median(np.abs(np.asarray(residuals)[:count])))
    return size * float(np.sqrt(count / max(count - free, 1)))


def _robust(function, begin, u, kind, loss) -> tuple[_Solved, float]:
    """Fit and scale by turns, from a start of high breakdown point; Tukey's loss, which has many minima, could start nowhere else."""
    count, free = len(u), COUNT[kind]
    scale = max(_spread(_residuals(function, jnp.asarray(begin), _jax(padded(u, kind))), count, free), 1e-13)
    for _ in range(_ROUNDS):
        solved = _solved(function, begin, padded(u, kind, scale), bounds_of(kind), loss)
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
