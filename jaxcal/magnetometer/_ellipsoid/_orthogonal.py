"""Iterative fits of scaled readings with the package's solver: orthogonal distances, curvature corrected."""

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from ..._precision import is_traced
from ..._types import AnyArray
from ...fitting import Fit, covariance, information, solve
from ._algebraic import host_start, traced_start
from ._kinds import COUNT, basis_of, soft_and_centre
from ._residuals import Readings, orthogonal
from ._shape import Found, filled, radius_of, unit

CURVED = 0.02  # noise over radius above which the curvature term matters
ROUNDS, SETTLED = 3, 3e-3  # number of fits with the curvature term, and the relative change of the noise that ends them
PRECISE = 1e-8  # remaining step, relative to the statistical uncertainty


def padded(u: np.ndarray, kind: str, noise2: float = 0.0) -> Readings:
    """Readings padded to a power of two with zero weights, so that logs of any length share a compiled program."""
    return Readings(filled(u, u[:1]), filled(np.ones(len(u))), np.float64(noise2), basis_of(kind))


def _attempt(begin: AnyArray, data: Readings, kind: str) -> Fit:
    """The fit from a start; bounds hold unused parameters at zero, so that all kinds share one program."""
    idle = np.arange(9) >= COUNT[kind]
    return solve(orthogonal, begin, data, bounds=(np.where(idle, 0.0, -np.inf), np.where(idle, 0.0, np.inf)), rtol=PRECISE)


def flat(u: np.ndarray, kind: str, begin: Any = None) -> Found:
    """The fit without the curvature term. It suffices to compare models, because the radius of each absorbs the mean of that term."""
    begin = host_start(u, kind) if begin is None else begin
    return _described_by(_attempt(begin, padded(u, kind), kind), len(u), kind)


def _described_by(fit: Fit, count: int, kind: str, noise2: Any = 0.0) -> Found:
    """The ellipsoid that a solution describes; its covariance is infinite if the readings do not determine it."""
    traced = is_traced(fit.parameters)
    xp = jnp if traced else np
    parameters, residuals, matrix = (xp.asarray(x) for x in (fit.parameters, fit.residuals, covariance(fit, scaled=True)))
    noise = xp.sqrt(xp.sum(residuals**2) / max(count - COUNT[kind], 1))
    return Found(
        parameters, *soft_and_centre(parameters, basis_of(kind)), xp.where(xp.isfinite(matrix).all(), matrix, xp.inf), noise,
        residuals[:count], fit.usable if traced else bool(fit.usable), kind, noise2,
    )  # fmt: skip


def curvature_variance(noise: Any, radius: Any) -> Any:
    """Variance for the curvature term; zero if the noise is too small to matter, or so large that there is no surface."""
    xp = jnp if is_traced(noise, radius) else np
    return xp.where((0.5 * radius > noise) & (noise > CURVED * radius), noise**2, 0.0)


def settled(found: Any, again: Callable[[Any, Any], Any], radius: Callable[[Any], Any]) -> Any:
    """A fit with the curvature term where noise matters: `again(found, noise2)` until the noise settles, or a few times in a trace."""

    def step(carry: tuple, _: None) -> tuple:
        found, noise2, last, done = carry
        after = curvature_variance(found.noise, radius(found))
        done = done | (after == 0) | (jnp.abs(found.noise - last) < SETTLED * last)
        noise2 = jnp.where(done, noise2, after)
        return (again(found, noise2), noise2, found.noise, done), None

    if is_traced(found.noise):
        zero = jnp.zeros_like(found.noise)
        return jax.lax.scan(step, (found, zero, zero, jnp.asarray(False)), None, length=ROUNDS)[0][0]
    last = np.inf
    for _ in range(ROUNDS):
        noise2 = float(curvature_variance(found.noise, radius(found)))
        if not noise2 or abs(found.noise - last) < SETTLED * last:
            break
        last, found = found.noise, again(found, noise2)
    return found


def _radius(found: Found) -> Any:
    return radius_of(found.soft)


def refined(found: Found, u: np.ndarray) -> Found:
    """The fit with the curvature term where noise matters."""
    return settled(found, lambda found, noise2: _described_by(
        _attempt(found.parameters, padded(u, found.kind, noise2), found.kind), len(u), found.kind, noise2), _radius)  # fmt: skip


def estimate(u: Any, kind: str) -> Found:
    """Maximum likelihood of scaled readings as one pure function: `flat` and `refined` without a choice on the host."""
    basis, weight = jnp.asarray(basis_of(kind), dtype=u.dtype), jnp.ones(len(u), dtype=u.dtype)

    def at(begin: Any, noise2: Any) -> Found:
        return _described_by(_attempt(begin, Readings(u, weight, noise2, basis), kind), len(u), kind, noise2)

    begin = jax.lax.stop_gradient(traced_start(jax.lax.stop_gradient(u), kind))
    return settled(at(begin, jnp.zeros((), u.dtype)), lambda found, noise2: at(found.parameters, noise2), _radius)


_distance = jax.jit(orthogonal)


def distances(found: Found, u: np.ndarray) -> np.ndarray:
    """Distance of readings to an ellipsoid that was fitted to others."""
    data = jax.tree.map(jnp.asarray, padded(u, found.kind, found.noise2))
    return np.asarray(_distance(jnp.asarray(found.parameters), data))[: len(u)]


def rows_of(soft: Any, centre: Any, distance: Any, u: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivative (n, 12) of the distances by S and the centre, unit normals, and readings relative to the centre.

    They are taken at the nearest points of the ellipsoid, so that the readings' own noise does not enter.
    """
    inverse, z = np.linalg.inv(soft), u - centre
    z = z - distance[:, None] * unit(z @ inverse @ inverse)
    h = z @ inverse
    normal = unit(h @ inverse)
    return -np.concatenate([(normal[:, :, None] * h[:, None, :]).reshape(-1, 9), normal], axis=1), normal, z


def described(parameters: AnyArray, u: np.ndarray, kind: str) -> Found:
    """An ellipsoid that another method found, with the smallest covariance that the readings allow there (Cramer-Rao bound)."""
    none = np.full((9, 9), np.inf)
    found = Found(parameters, *soft_and_centre(parameters, basis_of(kind)), none, 0.0, np.zeros(len(u)), True, kind)
    found = dataclasses.replace(found, distance=distances(found, u))
    noise = float(np.sqrt(np.sum(found.distance**2) / max(len(u) - COUNT[kind], 1)))
    rows = rows_of(found.soft, found.centre, found.distance, u)[0] @ basis_of(kind)
    known = information(np.asarray(np.linalg.qr(rows, mode="r")), held=np.arange(9) >= COUNT[kind])
    bound = noise**2 * known.covariance if known.rank == COUNT[kind] else none
    return dataclasses.replace(found, noise=noise, covariance=bound)


def left_out(fits: dict[str, Found], chosen: Found) -> np.ndarray:
    """Bias (12,) of S and centre of the chosen model due to the terms that it leaves out, as far as the largest model shows it.

    A lack of evidence for these terms must not make the fit more certain. The step to the largest model is this bias plus noise, and noise
    contributes one per parameter to the likelihood ratio (positive-part James and Stein).
    """
    largest = next(iter(fits.values()))
    more = COUNT[largest.kind] - COUNT[chosen.kind]
    if not more or not np.isfinite(largest.covariance).all():
        return np.zeros(12)  # the verdict reports that the largest model could not be tried
    gain = float(np.sum(chosen.distance**2) - np.sum(largest.distance**2)) / max(largest.noise, 1e-300) ** 2
    step = basis_of(largest.kind) @ largest.parameters - basis_of(chosen.kind) @ chosen.parameters
    return np.sqrt(max(1 - more / max(gain, 1e-300), 0.0)) * step
