"""What a joint fit knows: covariance of ellipsoid and rotation together, heading error, what stays open, verdict."""

import functools
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._design._heading_error import WORDS, grids, grids_across, rms
from .._ellipsoid._algebraic import triangle
from .._ellipsoid._shape import ENTRIES, root, root_slopes
from ._joint_residuals import CENTRE, TURN

_ALL = (*WORDS, "rotation about x", "rotation about y", "rotation about z")
_OPEN = 1e-8  # smallest singular value, of the largest
_BY_NOISE = 0.5
_ILL = 1000.0
_NOISY, _TOO_NOISY = 0.1, 0.2
_MANY_OUTLIERS = 0.01
_LITTLE, _MORE = 0.005, 1.2  # of the field, and of the scatter across the surface: rates that do not fit
_MUCH, _FOURFOLD = 0.05, 4.0
_ASKEW = np.deg2rad(2.0)


class Known(eqx.Module):
    """Covariance of the parameters, that of the rotation, predicted heading error, and what to think of it."""

    covariance: np.ndarray
    turned: np.ndarray
    heading_error: np.ndarray
    condition: float
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)


def _cross(v: np.ndarray) -> np.ndarray:
    x, y, z = v
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def _changes(found: Any) -> np.ndarray:
    """Derivative of W = Q'U with respect to the parameters, (p, 3, 3)."""
    changes = np.zeros((len(found.parameters), 3, 3))
    for k, (i, j) in enumerate(zip(*np.triu_indices(3), strict=True)):
        changes[k, i, j] = 1.0
    changes[:6] = found.base.T @ changes[:6]
    changes[TURN] = [-_cross(axis) @ found.matrix for axis in np.eye(3)]
    return changes


def _natural(found: Any) -> tuple[np.ndarray, np.ndarray]:
    """From the parameters to changes on the unit sphere, (12, p): six of the shape, centre, rotation vector; and that one, (3, p)."""
    matrix, changes = found.matrix, _changes(found)
    inverse = np.linalg.inv(matrix)
    relative = changes @ inverse
    j, k = np.transpose(ENTRIES)
    form = (relative + np.swapaxes(relative, 1, 2))[:, j, k].T
    centre = np.zeros((3, len(changes)))
    centre[:, CENTRE] = matrix
    # the symmetric root turned: W = Q'S, so that dQ' = (dW - Q'dS) S^-1
    shape = matrix.T @ matrix
    symmetric = root(shape)
    by_shape = changes.transpose(0, 2, 1) @ matrix + matrix.T @ changes
    roots = np.einsum("pe,eij->pij", by_shape[:, j, k], root_slopes(shape))
    rotation = symmetric @ inverse
    turned = (rotation.T @ roots - changes) @ inverse
    angles = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]]) / 2
    return np.concatenate([form, centre, angles]), angles


def _heading_error(found: Any, covariance: np.ndarray, inclination: float) -> np.ndarray:
    """Root mean square heading error at level and tilted: shape, centre and rotation with all that they have in common."""
    matrix, changes = found.matrix, _changes(found)
    inverse = np.linalg.inv(matrix)
    errors = []
    for (_, directions), across in zip(grids(inclination), grids_across(inclination), strict=True):
        slopes = np.einsum("ni,pij,nj->np", across, changes, directions @ inverse.T)
        slopes[:, CENTRE] -= across @ matrix
        errors.append(rms(slopes, covariance))
    return np.array(errors)


def _covariance(found: Any) -> tuple[np.ndarray, bool]:
    """Covariance, and whether it is one: where the data leave something open, large along that."""
    jacobian = np.asarray(found.fit.jacobian)
    held = np.asarray(found.fit.at_bound)
    jacobian = np.where(held, 0.0, jacobian)
    column = np.linalg.norm(jacobian, axis=0)
    column = np.where(column > 0, column, 1.0)
    s, vectors = np.linalg.svd(triangle(jacobian / column))[1:]
    least = _OPEN * s[0]
    free = (~held).sum()
    inverse = vectors.T / np.maximum(s, least) / column[:, None]
    inverse = np.where(held[:, None], 0.0, inverse)
    return inverse @ inverse.T, bool(s[free - 1] > least) and not held[:9].any()


@functools.partial(jax.jit, static_argnames="function")
def _along(function, parameters, data, ways):
    return jax.vmap(lambda way: jax.jvp(lambda p: function(p, data), (parameters,), (way,))[1])(ways)


def _by_noise(found: Any, ways: np.ndarray) -> np.ndarray:
    """Share of what the data tell along each way that noise alone gives: what as much noise again adds to it."""
    extra = found.sigma[0] * np.random.default_rng(0).normal(size=np.shape(found.data.u))
    told = []
    for sign in (0.0, 1.0, -1.0):
        data = eqx.tree_at(lambda d: d.u, found.data, found.data.u + sign * extra)
        told.append(np.sum(np.asarray(_along(found.function, found.parameters, data, ways)) ** 2, axis=1))
    return ((told[1] + told[2]) / 2 - told[0]) / np.maximum(told[0], 1e-300)


def _words(ways: np.ndarray) -> str:
    """The parameters in which some directions lie, in words."""
    shares = np.max(np.abs(ways) / np.abs(ways).max(axis=1, keepdims=True), axis=0)
    chosen = [word for word, share in zip(_ALL, shares, strict=True) if share > 0.5]
    return ", ".join(chosen)


def _condition(found: Any, natural: np.ndarray) -> float:
    """Condition number on the unit sphere, both kinds of residual as lengths of one size: that of the attitudes, whatever the noise."""
    jacobian = np.asarray(found.fit.jacobian)
    size = np.full(len(jacobian), found.size_along)
    size[: found.padded] = found.data.sigma[0]
    heard = np.repeat(found.data.paired, (len(jacobian) - found.padded) // found.padded)
    size[found.padded :] /= np.where(heard > 0, heard, 1.0)
    free = ~np.asarray(found.fit.at_bound)
    jacobian = (jacobian * size[:, None])[:, free]
    column = np.linalg.norm(jacobian, axis=0)
    if not (column > 0).all():
        return np.inf
    s, vectors = np.linalg.svd(triangle(jacobian / column))[1:]
    if s[-1] <= _OPEN * s[0]:
        return np.inf
    spread = natural[:, free] @ (vectors.T / s / column[:, None])
    values = np.linalg.svd(spread, compute_uv=False)
    return float(values[0] / values[-1])


def _contradiction(across: float, along: float) -> tuple[list[str], list[str]]:
    """Where rates put readings farther from where they are than the noise of the readings does."""
    if not (along**2 - across**2 > _LITTLE**2 and along > _MORE * across):
        return [], []
    said = [
        f"The readings are off by {100 * along:.2g} % of the field from where the rates put them, and scatter by {100 * across:.2g} % "
        "about the ellipsoid: look at the times, axes, signs and scale of the rates."
    ]
    return (said, []) if along > _MUCH and along > _FOURFOLD * across else ([], said)


def judged(found: Any, spread: float, inclination: float, limits: tuple[float, float], outliers: int) -> Known:
    """Verdict with the sentences that lead to it, the gravest first."""
    covariance, known = _covariance(found)
    natural, angles = _natural(found)
    values, vectors = np.linalg.eigh(natural @ covariance @ natural.T)
    condition = _condition(found, natural) if known else np.inf
    rates = hasattr(found.data, "attitude")
    sensor, cure = ("rates", "turn about a second axis") if rates else ("specific force", "tilt the sensor about two axes")
    refused, weak = [], []
    # the parameters that change with each direction, whatever the others do
    ways = (covariance @ natural.T @ vectors / np.maximum(values, 1e-300)).T
    by_noise = _by_noise(found, ways) if known and np.isfinite(ways).all() else np.zeros(12)
    radius = float(abs(np.linalg.det(found.matrix))) ** (-1 / 3)
    error = _heading_error(found, covariance, inclination) if known else np.full(2, np.inf)
    level, tilted = np.rad2deg(error)
    if not known:
        gone = values > 1e-4 * values[-1]
        refused.append(f"Readings and {sensor} together do not determine {_words(vectors[:, gone].T)}: {cure}.")
    elif (spoilt := by_noise > _BY_NOISE).any():
        refused.append(f"Readings and {sensor} show {_words(vectors[:, spoilt].T)} through their noise only: {cure}.")
    elif not bool(found.fit.usable):
        refused.append(f"The joint fit did not converge; least certain is {_words(vectors[:, -1:].T)}: {cure}.")
    across, along = found.sigma[0] / radius, spread * np.sqrt(1.5) if rates else found.sigma[1]
    if across > _NOISY and (not refused or across < 1):
        said = f"The readings scatter by {100 * across:.0f} % of the field about the best ellipsoid."
        (refused if across > _TOO_NOISY else weak).append(said)
    if rates:
        worse, bad = _contradiction(across, along)
        refused, weak = refused + worse, weak + bad
    elif along > _ASKEW:
        degrees = np.rad2deg(along)
        weak.append(f"The specific force is off by {degrees:.2g} degrees: the sensor moved, or the accelerometer is not calibrated.")
    if not refused:
        weakest = _words(vectors[:, -1:].T)
        least, most = np.rad2deg(limits)
        if not level <= least:
            large = "by more than 30 degrees" if not level <= 30 else f"by {level:.2g} degrees rms"
            at = "" if not level <= 30 else f" at level and {tilted:.2g} at 20 degrees of tilt"
            (weak if level <= most else refused).append(f"The heading would be wrong {large}{at}; least certain is {weakest}.")
        if condition > _ILL:
            weak.append(f"Readings and {sensor} hardly determine {weakest} (condition number {condition:.3g}).")
    if outliers > max(_MANY_OUTLIERS * found.count, 2):
        weak.append(f"{outliers} of {found.count} readings are outliers; leave them out.")
    said = (
        f"Norms and {sensor} were fitted together; the heading error to expect is {level:.2g} degrees rms at level and {tilted:.2g} "
        "at 20 degrees of tilt, that of the rotation included."
    )
    turned = angles @ covariance @ angles.T if known else np.full((3, 3), np.inf)
    verdict, reason = ("refused" if refused else "weak" if weak else "good"), " ".join([*refused, *weak]) or said
    return Known(covariance if known else np.full_like(covariance, np.inf), turned, error, condition, verdict, reason)
