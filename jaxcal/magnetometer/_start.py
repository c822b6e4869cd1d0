"""Where the iterative fits start: the best algebraic fit that gives an ellipsoid, and one that outliers do not carry off."""

import numpy as np

from . import _quadric
from ._consistent import consistent
from ._quadric import NotEllipsoid
from ._residuals import Ellipsoid

_ENOUGH_FOR_ADJUSTED = 30
_SUBSETS = 200
_SUBSET = 12  # readings: three more than a symmetric fit needs, so that noise does not decide

#: kind -> parameters, and the directions of (A_xx, A_xy, A_yy, A_xz, A_yz, A_zz, b) that it can move on the unit sphere
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9, "circle": 3, "ellipse": 5}
PLANAR = ("circle", "ellipse")


def ellipsoid(kind: str, shape: np.ndarray, centre: np.ndarray) -> Ellipsoid:
    """The nearest parameters of a kind to a shape matrix and centre."""
    if kind in ("sphere", "circle"):
        size = np.linalg.det(shape[:2, :2]) ** 0.25 if kind == "circle" else np.linalg.det(shape) ** (1 / 6)
        return Ellipsoid(np.array([size]), centre[: 2 if kind == "circle" else 3])
    if kind == "diagonal":
        return Ellipsoid(np.sqrt(np.diag(shape)), centre)
    upper = np.linalg.cholesky(shape).T
    if kind == "symmetric":
        return Ellipsoid(upper[np.triu_indices(3)], centre)
    return Ellipsoid(np.array([upper[0, 0], upper[0, 1], upper[1, 1]]), centre[:2])


def _attempts(u: np.ndarray, kind: str):
    if kind == "symmetric":
        if len(u) >= _ENOUGH_FOR_ADJUSTED:
            yield lambda: consistent(u)[:2]
        yield lambda: _quadric.trace(u)
        yield lambda: _quadric.li_griffiths(u)
    if kind == "diagonal":
        yield lambda: _quadric.diagonal(u)
    if kind in PLANAR:
        if kind == "ellipse":
            yield lambda: _quadric.ellipse(u)
        yield lambda: _quadric.circle(u)
    else:
        yield lambda: _quadric.sphere(u)


def start(u: np.ndarray, kind: str) -> Ellipsoid:
    """First of the algebraic fits, in order of merit, that is an ellipsoid."""
    reason = None
    for attempt in _attempts(u, kind):
        try:
            return ellipsoid(kind, *attempt())
        except NotEllipsoid as error:
            reason = reason or error
    assert reason is not None
    raise reason


def _relative(found: Ellipsoid, u: np.ndarray) -> np.ndarray:
    """First-order distance to an ellipsoid."""
    shape, centre = np.asarray(found.shape()), np.asarray(found.middle())
    z = u - centre
    normal = z @ shape
    r = np.sqrt(np.maximum(np.sum(z * normal, axis=1), 1e-12))
    return (r - 1) * r / np.maximum(np.linalg.norm(normal, axis=1), 1e-12)


def robust_start(u: np.ndarray, kind: str) -> Ellipsoid:
    """Start of least median distance over fits of random subsets, refined on the readings near it."""
    rng, best, least = np.random.default_rng(0), start(u, kind), np.inf
    fit = {"sphere": _quadric.sphere, "diagonal": _quadric.diagonal, "symmetric": _quadric.trace, "circle": _quadric.circle}.get(
        kind, _quadric.ellipse
    )
    for trial in range(_SUBSETS + 1):
        try:
            found = best if trial == 0 else ellipsoid(kind, *fit(u[rng.choice(len(u), min(len(u), _SUBSET), replace=False)]))
        except (NotEllipsoid, np.linalg.LinAlgError):
            continue
        median = float(np.median(np.abs(_relative(found, u))))
        if median < least:
            best, least = found, median
    distance = np.abs(_relative(best, u))
    near = u[distance <= 3 * 1.4826 * max(least, 1e-12)]
    try:
        return start(near, kind) if len(near) > 2 * COUNT[kind] else best
    except NotEllipsoid:
        return best
