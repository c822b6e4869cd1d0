"""Iterative fits of scaled readings, orthogonal and radial, with robust losses, through the package's one solver."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from ..._errors import DataError
from ..._precision import is_traced
from ..._types import AnyArray
from ...fitting import AbstractLoss, Cauchy, Fit, Huber, Tukey, covariance, solve
from ._algebraic import triangle
from ._penalty import Penalty
from ._residuals import Readings, orthogonal, radial, shape_and_centre
from ._start import COUNT, PLANAR, basis_of, padded_length, parameters_of, robust_start, start, traced_start

LOSSES: dict[str, AbstractLoss] = {"huber": Huber(), "cauchy": Cauchy(), "tukey": Tukey()}
CURVED = 0.02  # noise over radius above which the curvature term is worth a fit
ROUNDS, SETTLED = 3, 3e-3  # of fits with the curvature term, and the change of the noise that ends them
_ROBUST_ROUNDS = 5
_PRECISE = 1e-8  # step to go, relative to the statistical uncertainty
_SINGULAR = 1e12


class Found(eqx.Module):
    """An ellipsoid in scaled readings: shape and centre, (9, 9) covariance of its parameters, noise, distances and weights.

    noise2 : the variance whose curvature term was taken off the distances.
    penalty : weight of the penalty on directions in a corner, zero where it had no part; bias : how far it moved the fit, in
        standard errors of what the readings alone say. conflict : of the field that the readings alone give and the known one.
    """

    parameters: AnyArray
    shape: AnyArray
    centre: AnyArray
    covariance: AnyArray
    noise: Any
    distance: AnyArray
    weight: AnyArray
    converged: Any
    kind: str = eqx.field(static=True)
    message: str = eqx.field(static=True, default="")
    noise2: Any = 0.0
    penalty: float = 0.0
    bias: float = 0.0
    conflict: float = 0.0


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


def attempt(function: Callable, start: AnyArray, data: Readings, kind: str, loss: AbstractLoss | None = None) -> Fit:
    """Fit; several rows of `start` are tried, and the best is kept.

    Residuals beyond those of the readings, of penalty and prior, move the fit and are then dropped: covariance and weights are
    those of the readings.
    """
    begin, starts = (start, None) if start.ndim == 1 else (start[0], start)
    fit = solve(function, begin, data, loss=loss, bounds=bounds_of(kind), starts=starts, rtol=_PRECISE)
    if fit.residuals.size == len(data.u):
        return fit
    own = {name: getattr(fit, name)[: len(data.u)] for name in ("residuals", "jacobian", "weights", "curvature")}
    return dataclasses.replace(fit, **own)


def flat(u: np.ndarray, kind: str, loss: AbstractLoss | None = None, cost: str = "orthogonal", begin: Any = None) -> Found:
    """The fit without the curvature term: enough to compare models, which all have a radius to take up its mean."""
    if begin is None:
        begin = parameters_of(kind, *(start if loss is None else robust_start)(u, kind))
    function = radial if cost == "radial" else orthogonal
    if loss is None:
        fit, scale = attempt(function, begin, padded(u, kind), kind), 1.0
    else:
        fit, scale = _robust(function, begin, u, kind, loss)
    if cost == "radial":
        # its own J'J is not the information of the readings
        found = described(np.asarray(fit.parameters), u, kind)
        return eqx.tree_at(lambda f: (f.converged, f.weight), found, (bool(fit.usable), np.asarray(fit.weights)[: len(u)]))
    return described_by(fit, scale, len(u), kind)


def described_by(fit: Fit, scale: float, count: int, kind: str, noise2: Any = 0.0) -> Found:
    """What a solution says of the ellipsoid; infinite covariance where the readings alone do not determine it."""
    traced = is_traced(fit.parameters)
    xp = jnp if traced else np
    parameters, residuals, matrix = (xp.asarray(x) for x in (fit.parameters, fit.residuals, covariance(fit, scaled=True)))
    if fit.robust:
        noise = scale * _spread(residuals, count, COUNT[kind])
    else:
        noise = scale * xp.sqrt(xp.sum(residuals**2) / max(count - COUNT[kind], 1))
    return Found(
        parameters,
        *shape_and_centre(parameters, basis_of(kind)),
        xp.where(xp.isfinite(matrix).all(), matrix, xp.inf),
        noise,
        scale * residuals[:count],
        xp.asarray(fit.weights)[:count],
        fit.usable if traced else bool(fit.usable),
        kind,
        "" if traced or fit.usable else fit.message,
        noise2,
    )


def curvature_variance(found: Found) -> Any:
    """Variance whose curvature term counts, zero where the noise is too small for it, or so large that there is no surface.

    Readings in a plane have no noise across it, so of the two curvatures one does.
    """
    xp = jnp if is_traced(found) else np
    radius = xp.linalg.det(found.shape) ** (-1 / 6)
    curved = (0.5 * radius > found.noise) & (found.noise > CURVED * radius)
    return xp.where(curved, (0.5 if found.kind in PLANAR else 1.0) * found.noise**2, 0.0)


def estimate(u: Any, kind: str) -> Found:
    """Maximum likelihood of scaled readings as one pure function: runs under `jit`, `vmap` and `grad`, and judges nothing.

    The rounds are those of `flat` and of the fits with the curvature term, each decision in them an expression.
    """
    basis, weight, one = jnp.asarray(basis_of(kind), dtype=u.dtype), jnp.ones(len(u), dtype=u.dtype), jnp.ones((), u.dtype)

    def again(carry: tuple, _: None) -> tuple:
        begin, noise2, last, settled = carry
        fit = attempt(orthogonal, begin, Readings(u, weight, one, noise2, basis), kind)
        found = described_by(fit, 1.0, len(u), kind, noise2)
        after = curvature_variance(found)
        settled = settled | (after == 0) | (jnp.abs(found.noise - last) < SETTLED * last)
        return (found.parameters, jnp.where(settled, noise2, after), found.noise, settled), found

    zero = jnp.zeros((), u.dtype)
    begin = (jax.lax.stop_gradient(traced_start(jax.lax.stop_gradient(u), kind)), zero, zero, jnp.asarray(False))
    return jax.tree.map(lambda x: x[-1], jax.lax.scan(again, begin, None, length=ROUNDS + 1)[1])


def _spread(residuals, count: int, free: int) -> float:
    """Robust standard deviation of the residuals of the readings (not of the padding)."""
    size = 1.4826 * float(np.median(np.abs(np.asarray(residuals)[:count])))
    return size * float(np.sqrt(count / max(count - free, 1)))


def _robust(function: Callable, begin: np.ndarray, u: np.ndarray, kind: str, loss: AbstractLoss) -> tuple[Fit, float]:
    """Fit and scale by turns, from a start of high breakdown point; Tukey's loss, which has many minima, could start nowhere else."""
    count, free = len(u), COUNT[kind]
    scale = max(_spread(_linearised(function, begin, padded(u, kind))[0], count, free), 1e-13)
    for _ in range(_ROBUST_ROUNDS):
        fit = attempt(function, begin, padded(u, kind, scale), kind, loss)
        begin, last = np.asarray(fit.parameters), scale
        scale = max(_spread(fit.residuals, count, free) * scale, 1e-13)
        if abs(scale - last) < 1e-3 * last:
            break
    return fit, last  # type: ignore[possibly-unbound]


@eqx.filter_jit
def _linear_terms(function: Callable, parameters: Any, data: Readings) -> tuple[Any, Any]:
    return function(parameters, data), jax.jacfwd(function)(parameters, data)


def _linearised(function: Callable, parameters: AnyArray, data: Readings) -> tuple[Any, Any]:
    return _linear_terms(function, *jax.tree.map(jnp.asarray, (parameters, data)))


def described(parameters: AnyArray, u: np.ndarray, kind: str) -> Found:
    """An ellipsoid that another method found, with the covariance that the readings allow there (the Cramer-Rao bound)."""
    residuals, jacobian = (np.asarray(x)[: len(u)] for x in _linearised(orthogonal, parameters, padded(u, kind)))
    noise = float(np.sqrt(np.sum(residuals**2) / max(len(u) - COUNT[kind], 1)))
    bound = noise**2 * inverse_information(jacobian, np.arange(9) < COUNT[kind])
    return Found(parameters, *shape_and_centre(parameters, basis_of(kind)), bound, noise, residuals, np.ones(len(u)), True, kind)


def inverse_information(jacobian: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Inverse of J'J, zero for parameters that are held; infinite where the rows do not determine all others to half the digits."""
    column = np.linalg.norm(jacobian[:, free], axis=0)
    factor = triangle(jacobian[:, free] / np.where(column > 0, column, 1))
    inverse = np.zeros((jacobian.shape[1],) * 2)
    if len(factor) < free.sum() or not np.linalg.cond(factor) < _SINGULAR:
        return np.full_like(inverse, np.inf)
    root = np.linalg.inv(factor) / column[:, None]
    inverse[np.ix_(free, free)] = root @ root.T
    return inverse


def loss_of(loss: Any) -> AbstractLoss | None:
    """The loss, by its name or as an object."""
    if loss is None or isinstance(loss, AbstractLoss):
        return loss
    if isinstance(loss, str) and loss in LOSSES:
        return LOSSES[loss]
    known = ", ".join(repr(name) for name in LOSSES)
    raise DataError(f"There is no loss {loss!r}; known are None (least squares), {known}, and the losses of jaxcal.fitting.")
