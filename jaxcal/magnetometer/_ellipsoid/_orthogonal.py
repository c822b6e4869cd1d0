"""Iterative fits of scaled readings with the package's solver: orthogonal distances, curvature corrected, penalised."""

import contextlib
import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._compile import filter_jit
from ..._precision import array_module, is_traced
from ..._types import AnyArray
from ...fitting import Fit, covariance, identifiability, information, solve
from ._algebraic import NotEllipsoid, start, traced_start, triangle
from ._kinds import COUNT, PLANAR, basis_of, parameters_of, shape_and_centre, upper_and_centre
from ._residuals import Penalty, Readings, half_log_det, orthogonal, penalised
from ._shape import Found, entries_of, filled, radius_of

CURVED = 0.02  # noise over radius above which the curvature term matters
ROUNDS, SETTLED = 3, 3e-3  # number of fits with the curvature term, and the relative change of the noise that ends them
PRECISE = 1e-8  # remaining step, relative to the statistical uncertainty
#: singular value, with columns of unit length, below which a parameter is not determined; condition number that costs half of the digits
_LOST, _SINGULAR = 1e-12, 1e8
_IDLE, _FAR = 0.1, 1.0  # standard errors: a penalty that moves a fit by less is omitted; by more, the fit without it may have diverged


def padded(u: np.ndarray, kind: str, noise2: float = 0.0, penalty: Penalty | None = None) -> Readings:
    """Readings padded to a power of two with zero weights, so that logs of any length share a compiled program."""
    return Readings(filled(u, u[:1]), filled(np.ones(len(u))), np.float64(noise2), basis_of(kind), penalty)


def bounds_of(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Bounds that hold unused parameters at zero, so that all kinds share one program."""
    idle = np.arange(9) >= COUNT[kind]
    return np.where(idle, 0.0, -np.inf), np.where(idle, 0.0, np.inf)


def attempt(function: Callable, start: AnyArray, data: Readings, kind: str) -> Fit:
    """Best fit from the rows of `start`, without the residuals of penalty and prior: its covariance is that of the readings."""
    begin, starts = (start, None) if start.ndim == 1 else (start[0], start)
    fit = solve(function, begin, data, bounds=bounds_of(kind), starts=starts, rtol=PRECISE)
    if fit.residuals.size == len(data.u):
        return fit
    own = {name: getattr(fit, name)[: len(data.u)] for name in ("residuals", "jacobian", "weights", "curvature")}
    return dataclasses.replace(fit, **own)


def flat(u: np.ndarray, kind: str, begin: Any = None) -> Found:
    """The fit without the curvature term. It suffices to compare models, because the radius of each absorbs the mean of that term."""
    if begin is None:
        begin = parameters_of(kind, *start(u, kind))
    return described_by(attempt(orthogonal, begin, padded(u, kind), kind), len(u), kind)


def described_by(fit: Fit, count: int, kind: str, noise2: Any = 0.0) -> Found:
    """The ellipsoid that a solution describes; its covariance is infinite if the readings alone do not determine it."""
    traced = is_traced(fit.parameters)
    xp = jnp if traced else np
    parameters, residuals, matrix = (xp.asarray(x) for x in (fit.parameters, fit.residuals, covariance(fit, scaled=True)))
    noise = xp.sqrt(xp.sum(residuals**2) / max(count - COUNT[kind], 1))
    return Found(
        parameters, *shape_and_centre(parameters, basis_of(kind)), xp.where(xp.isfinite(matrix).all(), matrix, xp.inf), noise,
        residuals[:count], fit.usable if traced else bool(fit.usable), kind, noise2,
    )  # fmt: skip


def curvature_variance(found: Found) -> Any:
    """Variance for the curvature term; zero if the noise is too small to matter, or so large that there is no surface."""
    xp, radius = array_module(found), radius_of(found.shape)
    curved = (0.5 * radius > found.noise) & (found.noise > CURVED * radius)
    # readings in a plane have no noise across it, so only one of the two curvatures counts
    return xp.where(curved, (0.5 if found.kind in PLANAR else 1.0) * found.noise**2, 0.0)


def estimate(u: Any, kind: str) -> Found:
    """Maximum likelihood of scaled readings as one pure function: `flat` and the rounds of `refined`, without branches."""
    basis, weight = jnp.asarray(basis_of(kind), dtype=u.dtype), jnp.ones(len(u), dtype=u.dtype)

    def again(carry: tuple, _: None) -> tuple:
        begin, noise2, last, settled = carry
        fit = attempt(orthogonal, begin, Readings(u, weight, noise2, basis), kind)
        found = described_by(fit, len(u), kind, noise2)
        after = curvature_variance(found)
        settled = settled | (after == 0) | (jnp.abs(found.noise - last) < SETTLED * last)
        return (found.parameters, jnp.where(settled, noise2, after), found.noise, settled), found

    zero = jnp.zeros((), u.dtype)
    begin = (jax.lax.stop_gradient(traced_start(jax.lax.stop_gradient(u), kind)), zero, zero, jnp.asarray(False))
    return jax.tree.map(lambda x: x[-1], jax.lax.scan(again, begin, None, length=ROUNDS + 1)[1])


@filter_jit
def _linearised(function: Callable, parameters: Any, data: Readings) -> tuple[Any, Any]:
    return function(parameters, data), jax.jacfwd(function)(parameters, data)


def described(parameters: AnyArray, u: np.ndarray, kind: str) -> Found:
    """An ellipsoid that another method found, with the smallest covariance that the readings allow there (Cramer-Rao bound)."""
    residuals, jacobian = (np.asarray(x)[: len(u)] for x in _linearised(orthogonal, parameters, padded(u, kind)))
    noise = float(np.sqrt(np.sum(residuals**2) / max(len(u) - COUNT[kind], 1)))
    known = information(triangle(jacobian), held=np.arange(9) >= COUNT[kind], tolerance=_LOST)
    bound = noise**2 * known.covariance if known.rank == COUNT[kind] else np.full((9, 9), np.inf)
    return Found(parameters, *shape_and_centre(parameters, basis_of(kind)), bound, noise, residuals, True, kind)


def refined(found: Found, u: np.ndarray, penalty: float = 0.0) -> Found:
    """The fit with the curvature term where noise matters, and with the penalty where that matters."""
    bias = _step(found, u, penalty)[1] if penalty else 0.0
    if found.converged and bias < _IDLE:
        penalty = 0.0
    if penalty:
        return _penalised(found, u, penalty, bias)
    last = np.inf
    for _ in range(ROUNDS):
        noise2 = float(curvature_variance(found))
        if not noise2 or abs(found.noise - last) < SETTLED * last:
            break
        fit = attempt(orthogonal, found.parameters, padded(u, found.kind, noise2), found.kind)
        last, found = found.noise, described_by(fit, len(u), found.kind, noise2)
    return found


def left_out(fits: dict[str, Found], chosen: Found, u: np.ndarray, penalty: float) -> np.ndarray:
    """Bias (9,) of the chosen model due to the terms that it leaves out, as far as the largest model shows it.

    A lack of evidence for these terms must not make the fit more certain. The step to the largest model is this bias plus noise, and noise
    contributes one per parameter to the likelihood ratio (positive-part James and Stein).
    """
    largest = next(iter(fits.values()))
    more = COUNT[largest.kind] - COUNT[chosen.kind]
    if not more:
        return np.zeros(9)
    if penalty and not (largest.converged and _step(largest, u, penalty)[1] < _IDLE):
        largest = refined(largest, u, penalty)
    if not np.isfinite(largest.covariance).all():
        return np.zeros(9)  # the verdict reports that the largest model could not be tried
    gain = float(np.sum(chosen.distance**2) - np.sum(largest.distance**2)) / max(largest.noise, 1e-300) ** 2
    return np.sqrt(max(1 - more / max(gain, 1e-300), 0.0)) * (entries_of(largest) - entries_of(chosen))


def _step(found: Found, u: np.ndarray, penalty: float) -> tuple[Any, float]:
    """Shift of a fit by the penalty, to first order: in the parameters, and in standard errors of the readings alone."""
    if not np.isfinite(found.covariance).all():
        return np.zeros(9), np.inf
    upper, centre = upper_and_centre(found.parameters, basis_of(found.kind))
    form = Penalty.of(found.kind, found.noise, penalty)
    _, by_upper, by_z = half_log_det(upper, u - centre, np.ones(len(u)), form.basis, form.idle)
    slope = basis_of(found.kind).T @ np.concatenate([by_upper.ravel(), -by_z.sum(axis=0)])
    step = penalty * found.covariance @ slope
    return step, float(np.sqrt(max(penalty * slope @ step, 0.0)))


def _penalised(found: Found, u: np.ndarray, penalty: float, bias: float) -> Found:
    """The fit with the penalty; it also starts from a sphere if the fit without it may have diverged."""
    # the noise comes from the fit without the penalty, whose degrees of freedom are known
    noise, begin = max(found.noise, 1e-12), [found.parameters]
    if not found.converged or bias > _FAR:
        with contextlib.suppress(NotEllipsoid):  # in that case one start must suffice
            begin.append(parameters_of(found.kind, *start(u, "circle" if found.kind in PLANAR else "sphere")))
    noise2 = float(curvature_variance(found))
    data = padded(u, found.kind, noise2, Penalty.of(found.kind, noise, penalty))
    fit = attempt(penalised, np.array(begin), data, found.kind)
    found = described_by(fit, len(u), found.kind, noise2)
    # the penalty gives a solution even if the readings have none, and the solver does not report that
    known = identifiability(fit).condition < _SINGULAR
    covariance = found.covariance * (noise / max(found.noise, 1e-300)) ** 2 if known else np.full((9, 9), np.inf)
    found = dataclasses.replace(found, noise=noise, covariance=covariance, penalty=penalty)
    # the shift by the penalty is a bias of known size, so it is part of the uncertainty
    step, bias = _step(found, u, penalty)
    return dataclasses.replace(found, covariance=found.covariance + np.outer(step, step), bias=bias)
