"""What a fit needs where its readings say little: the curvature term, and the penalty on directions in a corner."""

import contextlib
from typing import Any

import equinox as eqx
import numpy as np

from ...fitting import AbstractLoss, identifiability
from ._algebraic import NotEllipsoid
from ._orthogonal import ROUNDS, SETTLED, Found, attempt, curvature_variance, described_by, flat, padded
from ._penalty import Penalty, Size, half_log_det
from ._residuals import orthogonal, penalised, upper_and_centre
from ._shape import entries_of
from ._start import COUNT, PLANAR, basis_of, parameters_of, start

_IDLE = 0.1  # standard errors: a penalty that moves a fit by less is left out
_FAR = 1.0  # standard errors: beyond, the fit without the penalty may have run off
_SINGULAR = 1e8


def geometric(
    u: np.ndarray, kind: str, loss: AbstractLoss | None = None, cost: str = "orthogonal", penalty: float = 0.0, size: Size | None = None
) -> Found:
    """Least squares of orthogonal (or radial) distances, from the best algebraic start."""
    found = flat(u, kind, loss, cost)
    return found if cost == "radial" else refined(found, u, loss, penalty, size)


def refined(found: Found, u: np.ndarray, loss: AbstractLoss | None = None, penalty: float = 0.0, size: Size | None = None) -> Found:
    """The fit with the curvature term where the noise matters, the penalty where that does, and the size that is known."""
    bias = _step(found, u, penalty)[1] if penalty else 0.0
    if found.converged and bias < _IDLE:
        penalty = 0.0
    if not penalty and size is None:
        return _curvature_corrected(found, u, loss)
    return _penalised(found, u, loss, penalty, bias, size)


def left_out(fits: dict[str, Found], chosen: Found, u: np.ndarray, loss: AbstractLoss | None, penalty: float) -> np.ndarray:
    """Bias of a chosen model by what it leaves out, (9,), as far as the largest model shows it.

    The step to the largest model is that bias and noise, whose share of the likelihood ratio is one for each parameter left out
    (positive-part James and Stein). A model that is chosen for want of evidence is not more certain than one that is not.
    """
    largest = fits[max(fits, key=lambda kind: COUNT[kind])]
    more = COUNT[largest.kind] - COUNT[chosen.kind]
    if not more:
        return np.zeros(9)
    if penalty and not (largest.converged and _step(largest, u, penalty)[1] < _IDLE):
        largest = refined(largest, u, loss, penalty)
    if not np.isfinite(largest.covariance).all():
        return np.zeros(9)  # the verdict says that it could not be tried
    weight = largest.weight
    gain = float(np.sum(weight * chosen.distance**2) - np.sum(weight * largest.distance**2)) / max(largest.noise, 1e-300) ** 2
    return np.sqrt(max(1 - more / max(gain, 1e-300), 0.0)) * (entries_of(largest) - entries_of(chosen))


def _step(found: Found, u: np.ndarray, penalty: float) -> tuple[Any, float]:
    """How far the penalty moves a fit, to first order: in the parameters, and in standard errors of the readings alone."""
    if not np.isfinite(found.covariance).all():
        return np.zeros(9), np.inf
    upper, centre = upper_and_centre(found.parameters, basis_of(found.kind))
    form = Penalty.of(found.kind, found.noise, penalty)
    _, by_upper, by_z = half_log_det(upper, u - centre, (found.weight > 0.5).astype(float), form.basis, form.idle)
    slope = basis_of(found.kind).T @ np.concatenate([by_upper.ravel(), -by_z.sum(axis=0)])
    step = penalty * found.covariance @ slope
    return step, float(np.sqrt(max(penalty * slope @ step, 0.0)))


def _curvature_corrected(found: Found, u: np.ndarray, loss: AbstractLoss | None) -> Found:
    scale = 1.0 if loss is None else found.noise
    for _ in range(ROUNDS):
        if not (noise2 := float(curvature_variance(found))):
            break
        fit = attempt(orthogonal, found.parameters, padded(u, found.kind, scale, noise2), found.kind, loss)
        last, found = found.noise, described_by(fit, scale, len(u), found.kind, noise2)
        if abs(found.noise - last) < SETTLED * last:
            break
    return found


def _penalised(found: Found, u: np.ndarray, loss: AbstractLoss | None, penalty: float, bias: float, size: Size | None) -> Found:
    """The fit with penalty and prior; from a sphere too where the fit without them may have run off.

    The noise is that of the fit without them, whose degrees of freedom are known: what they add to the distances is none.
    """
    alone, noise, begin = found, max(found.noise, 1e-12), [found.parameters]
    scale = 1.0 if loss is None else noise
    if not found.converged or bias > _FAR:
        with contextlib.suppress(NotEllipsoid):  # then the one start has to do
            begin.append(parameters_of(found.kind, *start(u[found.weight > 0.5], "circle" if found.kind in PLANAR else "sphere")))
    noise2 = float(curvature_variance(found))
    data = padded(u, found.kind, scale, noise2, Penalty.of(found.kind, noise, penalty, size))
    fit = attempt(penalised, np.array(begin), data, found.kind, loss)
    found = described_by(fit, scale, len(u), found.kind, noise2)
    # penalty and prior make a solution where the readings have none, so the solver does not say that they have none
    known = identifiability(fit).condition < _SINGULAR
    covariance = found.covariance * (noise / max(found.noise, 1e-300)) ** 2 if known else np.full((9, 9), np.inf)
    found = eqx.tree_at(lambda f: (f.noise, f.covariance, f.penalty), found, (noise, covariance, penalty))
    if penalty:
        # what it moved the fit by is a bias: known in size, so part of the uncertainty
        step, bias = _step(found, u, penalty)
        found = eqx.tree_at(lambda f: (f.covariance, f.bias), found, (found.covariance + np.outer(step, step), bias))
    return found if size is None else _with_size(found, alone, size)


def _log_size(found: Found) -> tuple[float, np.ndarray]:
    """Logarithm of the mean semi-axis, and its derivative with respect to the parameters."""
    diagonal = np.diag(upper_and_centre(found.parameters, basis_of(found.kind))[0])
    slope = np.zeros(12)
    slope[[0, 4, 8]] = -1 / (3 * diagonal)
    return -float(np.mean(np.log(np.abs(diagonal)))), basis_of(found.kind).T @ slope


def _with_size(found: Found, alone: Found, size: Size) -> Found:
    """The prior's information in the covariance, and how far it is from what the readings alone say."""
    value, slope = _log_size(alone)
    conflict = 0.0
    if alone.converged and np.isfinite(alone.covariance).all():
        conflict = abs(value - size.log) / float(np.sqrt(size.error**2 + slope @ alone.covariance @ slope))
    covariance = found.covariance
    if np.isfinite(covariance).all():
        slope = _log_size(found)[1]
        gain = covariance @ slope
        covariance = covariance - np.outer(gain, gain) / (size.error**2 + slope @ gain)
    return eqx.tree_at(lambda f: (f.covariance, f.conflict), found, (covariance, conflict))
