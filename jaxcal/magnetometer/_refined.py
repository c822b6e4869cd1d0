"""What a fit needs where its readings say little: the curvature term, and the penalty on directions in a corner."""

import contextlib

import equinox as eqx
import numpy as np

from ._efficiency import Penalty, half_log_det
from ._orthogonal import Found, attempt, bounds_of, described_by, flat, padded, upper_of
from ._quadric import NotEllipsoid
from ._residuals import guarded, orthogonal
from ._start import PLANAR, basis_of, parameters_of, start

CURVED = 0.02  # noise over radius above which the curvature term is worth a fit
_IDLE = 0.1  # standard errors: a penalty that moves a fit by less is left out
_FAR = 1.0  # standard errors: beyond, the fit without the penalty may have run off
_LEVELLINGS, _SETTLED = 3, 3e-3


def geometric(u: np.ndarray, kind: str, loss: str | None = None, cost: str = "orthogonal", penalty: float = 0.0) -> Found:
    """Least squares of orthogonal (or radial) distances, from the best algebraic start."""
    found = flat(u, kind, loss, cost)
    return found if cost == "radial" else refined(found, u, loss, penalty)


def refined(found: Found, u: np.ndarray, loss: str | None = None, penalty: float = 0.0) -> Found:
    """The fit with sigma^2 times the mean curvature taken off where the noise matters, and with the penalty where that does."""
    size = _pull(found, u, penalty) if penalty else 0.0
    if not penalty or (found.converged and size < _IDLE):
        return _levelled(found, u, loss)
    return _guarded(found, u, loss, penalty, size)


def _pull(found: Found, u: np.ndarray, penalty: float) -> float:
    """Length of the step that the penalty asks for, in standard errors of the readings alone."""
    if not np.isfinite(found.covariance).all():
        return np.inf
    upper, centre = upper_of(found.parameters, found.kind)
    form = Penalty.of(found.kind, found.noise, penalty)
    _, by_upper, by_z = half_log_det(upper, u - centre, (found.weight > 0.5).astype(float), form.basis, form.idle)
    asked = penalty * basis_of(found.kind).T @ np.concatenate([by_upper[np.triu_indices(3)], -by_z.sum(axis=0)])
    return float(np.sqrt(max(asked @ found.covariance @ asked, 0.0)))


def _noise2(found: Found) -> float:
    """Variance whose curvature term counts; readings in a plane have no noise across it, so of the two curvatures one does."""
    radius = float(np.linalg.det(found.shape)) ** (-1 / 6)
    if not 0.5 * radius > found.noise > CURVED * radius:
        return 0.0
    return (0.5 if found.kind in PLANAR else 1.0) * found.noise**2


def _levelled(found: Found, u: np.ndarray, loss: str | None) -> Found:
    scale = 1.0 if loss is None else found.noise
    for _ in range(_LEVELLINGS):
        if not (noise2 := _noise2(found)):
            break
        solved = attempt(orthogonal, found.parameters, padded(u, found.kind, scale, noise2), bounds_of(found.kind), loss)
        last, found = found.noise, described_by(solved, scale, len(u), found.kind, noise2)
        if abs(found.noise - last) < _SETTLED * last:
            break
    return found


def _guarded(found: Found, u: np.ndarray, loss: str | None, penalty: float, size: float) -> Found:
    """The fit with the penalty; from a sphere too where the fit without it may have run off.

    The noise is that of the fit without it, whose degrees of freedom are known: what the penalty adds to the distances is none.
    """
    noise, begin = max(found.noise, 1e-12), [found.parameters]
    scale = 1.0 if loss is None else noise
    if not found.converged or size > _FAR:
        with contextlib.suppress(NotEllipsoid):  # then the one start has to do
            begin.append(parameters_of(found.kind, *start(u[found.weight > 0.5], "circle" if found.kind in PLANAR else "sphere")))
    noise2 = _noise2(found)
    data = padded(u, found.kind, scale, noise2, Penalty.of(found.kind, noise, penalty))
    found = described_by(attempt(guarded, np.array(begin), data, bounds_of(found.kind), loss), scale, len(u), found.kind, noise2)
    covariance = found.covariance * (noise / max(found.noise, 1e-300)) ** 2
    found = eqx.tree_at(lambda f: (f.noise, f.covariance, f.penalty), found, (noise, covariance, penalty))
    return eqx.tree_at(lambda f: f.pull, found, _pull(found, u, penalty))
