"""Errors of a joint fit: covariance of ellipsoid and rotation together, heading error, undetermined parameters, findings."""

from typing import Any

import numpy as np

from ..._answer import CAUTION, FATAL, Quantity
from ...fitting import information
from ...fitting._serial import BLOCKS, is_white, leave_out
from .._design._heading_error import WORDS, rms_heading
from .._ellipsoid._algebraic import triangle
from .._ellipsoid._kinds import ENTRIES, basis_of, upper_and_centre
from .._ellipsoid._shape import radius_of, root, root_slopes, unit
from .._findings import FINDINGS
from .._judge import by_readings
from ._residuals import CENTRE, TURN, JointPoses

_ALL = (*WORDS, "rotation about x", "rotation about y", "rotation about z")
_OPEN = 1e-8  # share of the largest singular value below which a direction is not determined
_GONE = 1e-4  # share of the largest variance above which a direction is open too
_BY_NOISE = 0.5  # share of the information due to noise alone
_EXACT = 1e-9  # scaled noise below which residuals are rounding
_ILL = 1000.0  # condition number: a digit of the noise is a hundred of the error
_LITTLE, _MORE = 0.005, 1.2  # share of the field, and ratio to the scatter across the surface: above both, the rates do not fit
_MUCH, _FOURFOLD = 0.05, 4.0  # share of the field and ratio at which axes or signs are wrong, not times
_ASKEW = np.deg2rad(2.0)  # error of a vertical that costs twice the limit of a good fit


def _natural(found: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of W = Q'U, (p, 3, 3), of 12 numbers on the unit sphere (six of the shape, centre, rotation), and of the last three."""
    matrix, changes = found.matrix, np.zeros((len(found.parameters), 3, 3))
    changes[range(6), *np.triu_indices(3)] = 1.0
    changes[:6] = found.base.T @ changes[:6]
    changes[TURN] = -np.cross(np.eye(3)[:, None], matrix.T[None]).transpose(0, 2, 1)
    inverse = np.linalg.inv(matrix)
    relative = changes @ inverse
    form = (relative + np.swapaxes(relative, 1, 2))[:, *ENTRIES].T
    centre = np.zeros((3, len(changes)))
    centre[:, CENTRE] = matrix
    # W is the rotated symmetric root: W = Q'S, so that dQ' = (dW - Q'dS) S^-1
    shape = matrix.T @ matrix
    by_shape = changes.transpose(0, 2, 1) @ matrix + matrix.T @ changes
    roots = np.einsum("pe,eij->pij", by_shape[:, *ENTRIES], root_slopes(shape))
    turned = ((root(shape) @ inverse).T @ roots - changes) @ inverse
    angles = np.stack([turned[:, 2, 1] - turned[:, 1, 2], turned[:, 0, 2] - turned[:, 2, 0], turned[:, 1, 0] - turned[:, 0, 1]]) / 2
    return changes, np.concatenate([form, centre, angles]), angles


def _covariance(found: Any) -> tuple[np.ndarray, bool]:
    """Covariance, and whether it is valid; if the data leave a combination of parameters undetermined, it is large along that."""
    held = np.asarray(found.fit.at_bound)
    rows = np.concatenate([triangle(np.asarray(found.fit.jacobian)), np.asarray(found.fit.prior_jacobian)])
    known = information(rows, held=held, tolerance=_OPEN)
    inverse = known.vectors.T / np.maximum(known.singular_values, _OPEN) / known.column[:, None]
    inverse = np.where(held[:, None], 0.0, inverse)
    return inverse @ inverse.T, bool(known.rank == np.sum(~held)) and not held[:9].any()


def _serial(found: Any, covariance: np.ndarray) -> tuple[np.ndarray, int]:
    """Covariance from fits without parts of the log, and their number, if the residuals are not white; else the given one and zero."""
    free, n = ~np.asarray(found.fit.at_bound), len(found.data.u)
    residuals, jacobian = np.asarray(found.fit.residuals), np.asarray(found.fit.jacobian)[:, free]
    # put all residuals of a reading next to each other
    order = np.argsort(np.concatenate([np.arange(n), np.repeat(np.arange(n), (len(residuals) - n) // n)]), kind="stable")
    there = order[np.asarray(found.fit.counted)[order]]
    residuals, jacobian = residuals[there], jacobian[there]
    if found.sigma[0] < _EXACT or is_white(jacobian, residuals):
        return covariance, 0
    prior = np.asarray(found.fit.prior_jacobian)[:, free]
    part = np.ix_(free, free)
    matrix, inside = np.zeros_like(covariance), covariance[part]
    matrix[part] = leave_out(jacobian, residuals, prior.T @ prior) + inside @ (prior.T @ prior) @ inside
    return (matrix, BLOCKS) if np.isfinite(matrix).all() else (covariance, 0)


def _by_noise(found: Any, ways: np.ndarray) -> np.ndarray:
    """Share of the information along each direction that noise alone creates: how much an equal amount of extra noise adds to it."""
    extra = found.sigma[0] * np.random.default_rng(0).normal(size=np.shape(found.data.u))
    steps = ways / np.abs(ways).max(axis=1, keepdims=True)
    told = [np.sum((found.jacobian(found.data.u + sign * extra) @ steps.T) ** 2, axis=0) for sign in (0.0, 1.0, -1.0)]
    return ((told[1] + told[2]) / 2 - told[0]) / np.maximum(told[0], 1e-300)


def _words(ways: np.ndarray) -> str:
    """The parameters that make up the given directions, in words."""
    shares = np.max(np.abs(ways) / np.abs(ways).max(axis=1, keepdims=True), axis=0)
    chosen = [word for word, share in zip(_ALL, shares, strict=True) if share > 0.5]
    return ", ".join(chosen)


def shares(data: JointPoses, parameters: np.ndarray, base: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the products per variance of a reading, and per variance of the force's direction."""
    upper = upper_and_centre(parameters[:9], basis_of("symmetric"))[0]
    y = unit((data.u - parameters[CENTRE]) @ upper.T)
    force = data.force @ base.T
    normal = unit(y @ upper)
    slope = force @ upper
    slope = slope - np.sum(slope * normal, axis=1, keepdims=True) * normal
    return np.sum(slope**2, axis=1), 1 - np.sum(y * force, axis=1) ** 2


def _condition(found: Any, natural: np.ndarray) -> float:
    """Condition number on the unit sphere, with both kinds of residual as lengths of one size, so that it depends on the attitudes only."""
    jacobian, data, n = np.asarray(found.fit.jacobian), found.data, len(found.data.u)
    along = data.sigma[1]
    if isinstance(data, JointPoses):  # for a field of magnitude one
        by_reading, by_force = shares(data, found.parameters, found.base)
        along = np.sqrt(np.mean(data.sigma[0] ** 2 * by_reading + along**2 * by_force))
    heard = np.repeat(data.paired, (len(jacobian) - n) // n)
    size = np.concatenate([np.full(n, data.sigma[0]), along / np.where(heard > 0, heard, 1.0)])
    rows = np.concatenate([triangle(jacobian * size[:, None]), data.sigma[1] * np.asarray(found.fit.prior_jacobian)])
    known = information(rows, held=np.asarray(found.fit.at_bound), tolerance=_OPEN)
    if known.rank < np.sum(~known.held):
        return np.inf
    values = np.linalg.svd(natural @ known.root, compute_uv=False)
    return float(values[0] / values[-1])


def examined(
    found: Any, spread: float, level: tuple[float, np.ndarray], outliers: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
    """Covariances of parameters and rotation, predicted heading error, and facts with findings.

    level : dip, and the axis of the second sensor that points down at level.
    """
    covariance, determined = _covariance(found)
    changes, natural, angles = _natural(found)
    values, vectors = np.linalg.eigh(natural @ covariance @ natural.T)
    rates, blocks, known = hasattr(found.data, "attitude"), 0, []
    # the parameters that change with each direction if all others adapt
    ways = (covariance @ natural.T @ vectors / np.maximum(values, 1e-300)).T
    by_noise = _by_noise(found, ways) if determined and np.isfinite(ways).all() else np.zeros(12)

    def change(directions: np.ndarray) -> np.ndarray:
        slopes = np.einsum("pij,nj->nip", changes, directions @ np.linalg.inv(found.matrix).T)
        slopes[:, :, CENTRE] -= found.matrix
        return slopes

    condition = _condition(found, natural) if determined else np.inf
    if determined:
        covariance, blocks = _serial(found, covariance)
    error = rms_heading(change, covariance, *level) if determined else np.full(2, np.inf)
    weakest = _words(vectors[:, -1:].T)
    across = found.sigma[0] / radius_of(found.upper.T @ found.upper)
    if not determined:
        known.append(FINDINGS("undetermined", what=_words(vectors[:, values > _GONE * values[-1]].T)))
    elif (spoilt := by_noise > _BY_NOISE).any():
        known.append(FINDINGS("undetermined", what=_words(vectors[:, spoilt].T)))
    elif not bool(found.fit.usable):
        known.append(FINDINGS("not_converged", what=weakest))
    elif condition > _ILL:
        known.append(FINDINGS("hardly", what=weakest))
    # a surface that diverged has no size to compare the scatter with
    known += by_readings(across if determined or across < 1 else 0.0, outliers, found.count)
    along = spread * np.sqrt(1.5)
    if rates and along**2 - across**2 > _LITTLE**2 and along > _MORE * across:
        severity = FATAL if along > _MUCH and along > _FOURFOLD * across else CAUTION
        known.append(FINDINGS("rates_off", severity=severity, cost=along, size=100 * along))
    elif not rates and found.sigma[1] > _ASKEW:
        known.append(FINDINGS("force_off", cost=found.sigma[1], angle=Quantity(float(found.sigma[1]), "angle")))
    if blocks:
        known.append(FINDINGS("correlated", size=100 * across))
    turned = angles @ covariance @ angles.T if determined else np.full((3, 3), np.inf)
    facts = {
        "known": tuple(known), "condition": condition, "parts": blocks > 0, "weakest": weakest,
    }  # fmt: skip
    return covariance if determined else np.full_like(covariance, np.inf), turned, error, facts
