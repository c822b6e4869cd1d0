"""Iterative fits of scaled readings, orthogonal and radial, with robust losses, through the package's one solver."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._solve import AbstractLoss, Cauchy, Fit, Huber, Tukey, covariance, solve
from ._residuals import Ellipsoid, Readings, orthogonal, orthogonal_curved, radial
from ._start import COUNT, robust_start, start

LOSSES: dict[str, AbstractLoss] = {"huber": Huber(), "cauchy": Cauchy(), "tukey": Tukey()}
_CURVED = 0.02  # noise over radius above which the curvature term is worth a fit
_ROUNDS = 5
_SMALLEST_PAD = 64


class Found(eqx.Module):
    """An ellipsoid in scaled readings, (k, k) covariance of its parameters, noise, distances and weights per reading."""

    ellipsoid: Ellipsoid
    kind: str = eqx.field(static=True)
    covariance: np.ndarray
    noise: float
    distance: np.ndarray
    weight: np.ndarray
    converged: bool
    message: str = eqx.field(static=True)

    @property
    def shape(self) -> np.ndarray:
        return np.asarray(self.ellipsoid.shape())

    @property
    def centre(self) -> np.ndarray:
        return np.asarray(self.ellipsoid.middle())


def padded(u: np.ndarray, scale: float = 1.0, noise2: float = 0.0) -> Readings:
    """Readings filled up to a power of two with weight zero, so that logs of any length share a compiled program."""
    size = max(_SMALLEST_PAD, 1 << (len(u) - 1).bit_length())
    full = np.concatenate([u, np.repeat(u[:1], size - len(u), axis=0)])
    return Readings(full, np.r_[np.ones(len(u)), np.zeros(size - len(u))], scale, noise2)


def geometric(u: np.ndarray, kind: str, loss: str | None = None, cost: str = "orthogonal", curved: bool | None = None) -> Found:
    """Least squares of orthogonal (or radial) distances, from the best algebraic start."""
    begin = start(u, kind) if loss is None else robust_start(u, kind)
    function = radial if cost == "radial" else orthogonal
    if loss is None:
        fit = solve(function, begin, padded(u))
        scale = 1.0
    else:
        fit, scale = _robust(function, begin, u, kind, loss)
    if cost == "orthogonal" and curved is not False:
        fit, scale = _without_curvature_bias(fit, scale, u, kind, loss, bool(curved))
    return _found(fit, scale, u, kind, radial_cost=cost == "radial")


def _spread(residuals, count: int, free: int) -> float:
    """Robust standard deviation of the residuals of the readings (not of the padding)."""
    size = 1.4826 * float(np.median(np.abs(np.asarray(residuals)[:count])))
    return size * np.sqrt(count / max(count - free, 1))


def _robust(function, begin, u, kind, loss) -> tuple[Fit, float]:
    """Fit and scale by turns; Tukey's loss only from a converged Huber fit, because it has many minima."""
    count, free = len(u), COUNT[kind]
    data = padded(u)
    scale = _spread(jax.jit(function)(_jax(begin), _jax(data)), count, free)
    fit = None
    for name in ("huber", "tukey") if loss == "tukey" else (loss,):
        for _ in range(_ROUNDS):
            scale = max(scale, 1e-13)
            fit = solve(function, begin, padded(u, scale), loss=LOSSES[name])
            begin, last = fit.model, scale
            scale = _spread(fit.residuals, count, free) * scale
            if abs(scale - last) < 1e-3 * last:
                break
        scale = last  # type: ignore[possibly-unbound]
    return fit, scale  # type: ignore[return-value]


def _jax(tree):
    return jax.tree.map(jnp.asarray, tree)


def _sigma(fit: Fit, scale: float, count: int, kind: str) -> float:
    if fit.robust:
        return scale * _spread(fit.residuals, count, COUNT[kind])
    return scale * float(np.sqrt(np.sum(np.asarray(fit.residuals) ** 2) / max(count - COUNT[kind], 1)))


def _without_curvature_bias(fit, scale, u, kind, loss, always) -> tuple[Fit, float]:
    """Three rounds with sigma^2 times the mean curvature taken off, where the noise is large enough to matter."""
    radius = float(np.linalg.det(np.asarray(fit.model.shape()))) ** (-1 / 6)
    sigma = _sigma(fit, scale, len(u), kind)
    if not (always or sigma > _CURVED * radius) or not sigma < 0.5 * radius:
        return fit, scale
    for _ in range(3):
        sigma = _sigma(fit, scale, len(u), kind)
        # in a plane half of the noise along the surface is missing: the third semi-axis is as long as the first and adds 1/R
        share = 0.5 if kind in ("circle", "ellipse") else 1.0
        data = padded(u, scale, share * sigma**2)
        fit = solve(orthogonal_curved, fit.model, data, loss=None if loss is None else LOSSES[loss])
    return fit, scale


def _found(fit: Fit, scale: float, u: np.ndarray, kind: str, radial_cost: bool) -> Found:
    count = len(u)
    if radial_cost:
        # the radial cost's own J'J is not the information of the readings
        found = described(fit.model, u, kind)
        return eqx.tree_at(lambda f: (f.converged, f.weight), found, (bool(fit.usable), np.asarray(fit.weights)[:count]))
    return Found(
        jax.tree.map(np.asarray, fit.model),
        kind,
        np.asarray(covariance(fit, scaled=True)),
        _sigma(fit, scale, count, kind),
        scale * np.asarray(fit.residuals)[:count],
        np.asarray(fit.weights)[:count],
        bool(fit.usable),
        fit.message,
    )


@jax.jit
def _linearised(ellipsoid, data):
    return orthogonal(ellipsoid, data), jax.jacfwd(orthogonal)(ellipsoid, data)


def described(ellipsoid: Ellipsoid, u: np.ndarray, kind: str) -> Found:
    """An ellipsoid that another method found, with the covariance that the readings allow there (the Cramer-Rao bound)."""
    distance, slope = _linearised(_jax(ellipsoid), _jax(padded(u)))
    distance = np.asarray(distance)[: len(u)]
    jacobian = np.concatenate([np.asarray(slope.upper), np.asarray(slope.centre)], axis=1)[: len(u)]
    noise = float(np.sqrt(np.sum(distance**2) / max(len(u) - COUNT[kind], 1)))
    column = np.linalg.norm(jacobian, axis=0)
    triangle = np.linalg.qr(jacobian / np.where(column > 0, column, 1), mode="r")
    if np.linalg.cond(triangle) > 1e12:
        bound = np.full((column.size, column.size), np.inf)
    else:
        inverse = np.linalg.inv(triangle) / column[:, None]
        bound = noise**2 * inverse @ inverse.T
    return Found(ellipsoid, kind, bound, noise, distance, np.ones(len(u)), True, "")


def loss_name(loss: str | None) -> str | None:
    """The loss, checked."""
    if loss is None or (isinstance(loss, str) and loss in LOSSES):
        return loss
    raise DataError(f"There is no loss {loss!r}; known are None (least squares), {', '.join(repr(name) for name in LOSSES)}.")
