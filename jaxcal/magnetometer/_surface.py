"""The surface of all readings that a field of one magnitude can give: chosen, fitted, and all readings beside it.

The covariance comes from fits without parts of the log, on the raw residuals. On real logs nothing else predicts the difference between
halves: what looks like a drift or a current there does not go on after the log, and taking it out of the residuals makes the error too
small.

A model object is fitted as the built-in models are. Field magnitudes do not determine a common rotation. So its soft iron is S Q with a
symmetric S, which is fitted, and the rotation Q of the start, which is kept. All other floating leaves are fitted unchanged.
"""

import contextlib
from typing import Any, NamedTuple

import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding
from ..fitting._serial import BLOCKS, CHANCE, by_parts, followed, span_of
from . import _quadric as quadric
from ._aids import Asked
from ._directions import bins
from ._findings import FINDINGS
from ._model import MagModel
from ._nearest import Ellipsoids, nearest, slopes_of
from ._orthogonal import Found, by_method, fitted, likeliest, maximised
from ._own_model import Measured
from ._quadric import COUNT, EXACT, NEAR_PLANAR, SYMMETRIC, UPPER, Chosen, Frame, NotEllipsoid, basis_of, unit

#: constant of Tukey's biweight, 95 % efficient with normal noise; standard deviations where its tail begins, how surely it is too heavy,
#: and rounds; with fewer readings a parameter, residuals of normal noise look heavy in 5 % of logs
_TUKEY, _TAIL, _SURE, _ROUNDS, _EACH = 4.685, 2.5, 4.0, 4, 4
FAST, BENT = "rate of turn", "nonlinearity"
_FEWEST = 80  # readings for which the correlation time is known well enough


class Cause(NamedTuple):
    """One cause: its name, the step of the estimate that it explains, its largest effect on a reading over the field."""

    name: str
    step: np.ndarray
    size: float


class Surface(NamedTuple):
    """What a fit knows: a fitted surface, or findings why there is none, and the normal of a plane of the readings; then the attitudes.

    rows : numbers of the fitted readings, of those of the log that are finite. m : these readings, as they were fitted. said : findings.
    found : in scaled readings; scale, radius : unit of its distances, and size of the field in that unit. slopes : (13 + q, p) derivative
    of hard iron, soft iron, field and further leaves by its parameters. through : (13, 12), by S and centre.
    model, field : what it says of the iron. further, usual : values of further leaves, and the median of each condition. matrix, freedom :
    (13 + q, 13 + q) covariance of iron, field and further leaves, and its degrees of freedom. parts : whether it is that of fits without
    parts of the log. causes : what the residuals follow; their steps are in the covariance.
    corrected : all readings. residual : (n,) their distances, and noise : their standard deviation, in their unit.
    unseen : (13,) bias by terms that a smaller model leaves out, or of another method. larger : surface of the largest model, if another.
    dip, down : of the field, and the axis that points down at level, or None. joint : kind of a fit with a sensor beside, or currents;
    spread : covariance with their fields, which are then among the further values; alignment : the rotation.
    """

    plane: Any = None
    rows: Any = None
    said: tuple[Finding, ...] = ()
    found: Any = None
    model: Any = None
    field: Any = np.inf
    slopes: Any = None
    through: Any = None
    corrected: Any = None
    residual: Any = np.zeros(0)
    noise: Any = np.inf
    m: Any = None
    scale: Any = 1.0
    radius: Any = 1.0
    unseen: Any = 0.0
    larger: Any = None
    further: Any = None
    usual: Any = None
    matrix: Any = None
    freedom: Any = np.inf
    parts: bool = False
    causes: tuple[Cause, ...] = ()
    dip: Any = None
    down: Any = None
    joint: str = ""
    spread: Any = None
    alignment: Any = None


def surface_of(asked: Asked, picked: Chosen) -> Surface:
    """The surface through the chosen readings, the finding why there is none, or their plane."""
    one = _of_kind(asked, picked) if asked.parts is None else _of_object(asked, picked.m)
    if asked.traced:
        return one._replace(matrix=between(one.slopes, one.found.covariance), freedom=float(len(one.m) - one.found.parameters.size))
    clipped = (FINDINGS("clipped", count=picked.full),) if picked.full else ()
    one = one._replace(rows=picked.rows, said=(*clipped, *one.said))
    return one if one.found is None else _uncertain(one, asked.conditions)


def _uncertain(one: Surface, conditions: dict[str, np.ndarray]) -> Surface:
    """The surface with its covariance: by parts of the log, at least that of white residuals, with what the fit cannot see by itself."""
    found, matrix, freedom, parts, causes = one.found, one.found.covariance, one.found.freedom, False, ()
    if np.isfinite(matrix).all() and found.converged and found.noise > EXACT * one.radius:
        causes = tuple(_causes(one, conditions)) if one.usual is None else ()
        matrix, parts = by_parts(matrix, found.near.slopes, found.distance)
    matrix = between(one.slopes, matrix) + sum(np.outer(step, step) for step in [one.unseen, *(cause.step for cause in causes)])
    return one._replace(matrix=matrix, freedom=float(BLOCKS - 1) if parts else freedom, parts=parts, causes=causes)


def _causes(one: Surface, conditions: dict[str, np.ndarray]) -> list[Cause]:
    """The causes that the residuals beside an ellipsoid show, the surest first."""
    found, causes, jacobian = one.found, [], one.found.near.slopes
    if len(found.distance) < _FEWEST:
        return []
    # a soft iron that the model leaves out is told by another step: a cause is what the largest model does not explain
    span = span_of(jacobian if found.kind == "symmetric" else slopes_of(found.near, basis_of("symmetric")))
    for name, part in _columns(one, conditions).items():
        part = part[:, np.abs(part).max(axis=0) > 1e-12 * one.radius]
        coefficients, chance = followed(span, part, found.distance)
        if chance < CHANCE:
            effect, length = part @ coefficients, np.linalg.norm(jacobian, axis=0)
            step = np.linalg.lstsq(jacobian / length, effect, rcond=1e-9)[0] / length
            causes.append((chance, Cause(name, one.slopes @ step, float(np.max(np.abs(effect))) / one.radius)))
    return [cause for _, cause in sorted(causes, key=lambda one: one[0])]


def _columns(one: Surface, conditions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of each cause, for the fitted readings in order of time."""
    near, rows, radius = one.found.near, one.rows, one.radius
    z, columns = near.field @ one.found.soft, {}
    for name, values in conditions.items():
        # the hard iron stays that of the mean condition
        off = values[rows] - values[rows].mean()
        if off.any():
            columns[name] = near.normal * (off / np.abs(off).max())[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    turn = np.gradient(unit(one.corrected), axis=0)[rows]
    columns[FAST] = (np.sum(near.normal * z, axis=1) * np.sum(turn**2, axis=1))[:, None]
    columns[BENT] = np.concatenate([near.normal * (z / radius) ** 2, near.normal * (z / radius) ** 3], axis=1)
    return columns


def between(slopes: Any, covariance: Any) -> Any:
    """Covariance J C J'; infinite if C is: infinity times zero is NaN."""
    xp = covariance.__array_namespace__()
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


def _of_kind(asked: Asked, picked: Chosen) -> Surface:
    """The surface of a built-in model through chosen readings, and all readings beside it."""
    m, method, model, norm, everything = picked.m, asked.method, asked.model, asked.norm, asked.m[asked.there]
    frame = Frame.of(m)
    if asked.traced:
        u = frame.scaled(m)
        return ellipsoid(fitted(u, model), frame, norm)._replace(m=m)
    count, near, unseen, largest = _distinct(m), None, 0.0, None
    least = "sphere" if model in ("auto", "planar") and method == "ml" else "symmetric" if model == "auto" else model
    if count <= COUNT[least] or frame.scale < EXACT * np.abs(m).max():
        return Surface(said=(FINDINGS("few", count=count, model=least, least=COUNT[least] + 1),))
    if picked.near is not None:
        m, iron = _calmed(m, frame, *picked.near)
        frame = Frame.of(m)
        near = (iron - np.append(np.zeros(9), frame.centre)) / frame.scale
    u = frame.scaled(m)
    spread = quadric.extents(u)
    if spread[1] < NEAR_PLANAR:
        return Surface(said=(FINDINGS("line"),))
    if model == "planar" or (spread[2] < NEAR_PLANAR and model == "auto" and method == "ml"):
        normal = np.linalg.svd(u, full_matrices=False)[2][2]
        return Surface(plane=normal * np.sign(normal[np.argmax(np.abs(normal))]))
    try:
        if method != "ml":
            found, unseen = by_method(u, method, least, near)
        elif model != "auto":
            found = fitted(u, model, near)
        else:
            found, largest, unseen = likeliest(u, count, near, _occupied)
    except NotEllipsoid as error:
        return Surface(said=(FINDINGS("no_ellipsoid", quadric=error.quadric),))
    # all readings, as they are, beside the surface of those that were fitted
    same = len(picked.m) == len(everything) and m is picked.m
    whole = u if same else frame.scaled(everything)
    beside = found.near if same else nearest(found.soft, whole - found.centre[None])
    one = ellipsoid(found, frame, norm)
    one = one._replace(
        m=m, unseen=one.through @ (unseen + np.zeros(12)), corrected=one.field * beside.corrected,
        residual=(beside.distance - found.noise2 * beside.curvature) * frame.scale,
    )  # fmt: skip
    if model != "auto" or method != "ml" or found is largest:
        return one
    wide = one._replace(matrix=np.full((13, 13), np.inf))  # as long as the largest model is not known
    if largest is not None and largest.converged:
        wide = ellipsoid(largest, frame, None)
        wide = wide._replace(matrix=between(wide.slopes, largest.covariance))
    return one._replace(larger=wide)


def _occupied(field: np.ndarray) -> int:
    """Number of bins, of 500, that contain a unit field."""
    return int(np.count_nonzero(np.bincount(bins(unit(field)))))


def radius_of(soft: Any) -> Any:
    """Geometric mean of all semi-axes."""
    xp = soft.__array_namespace__()
    return xp.cbrt(xp.abs(xp.linalg.det(soft)))


def iron_slopes(whole: Any, field: Any, given: bool) -> Any:
    """Derivative (13, 12) of hard iron, soft iron and field by the whole matrix C H and the hard iron; H = det(C H)^(1/3) unless given."""
    xp = whole.__array_namespace__()
    by_field = xp.zeros(9, dtype=whole.dtype) if given else field / 3 * xp.linalg.inv(whole).T.ravel()
    by_soft = xp.concatenate([xp.eye(9, dtype=whole.dtype) / field - xp.outer(whole.ravel(), by_field) / field**2, by_field[None]])
    hard = xp.eye(3, 12, 9, dtype=whole.dtype)
    return xp.concatenate([hard, xp.concatenate([by_soft, xp.zeros((10, 3), dtype=whole.dtype)], axis=1)])


def ellipsoid(found: Found, frame: Frame, norm: Any) -> Surface:
    """The surface of an ellipsoid in scaled readings, traced or not; `norm`: magnitude of the field if it is given."""
    radius = radius_of(found.soft)
    field = frame.scale * radius if norm is None else norm
    through = iron_slopes(found.soft * frame.scale, field, norm is not None) * frame.scale
    model = MagModel(found.soft * frame.scale / field, frame.centre + frame.scale * found.centre)
    return Surface(
        found=found, model=model, field=field, slopes=through @ found.basis, through=through, residual=found.distance * frame.scale,
        noise=found.noise * frame.scale, scale=frame.scale, radius=radius,
    )  # fmt: skip


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len(np.unique(m[: 2**6], axis=0))
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _calmed(m: np.ndarray, frame: Frame, shape: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings whose distances d from an ellipsoid near them are psi(d) / mean(psi'), if these have too heavy a tail; psi is Tukey's.

    Also the entries (12,) of S and the centre of that ellipsoid.

    Least squares of these pseudo-values is the redescending fit, and their scatter gives its covariance (P. J. Huber and E. M. Ronchetti,
    Robust Statistics, 2009, section 7.8). Normal noise needs none of this.
    """
    near, basis, u = (shape * frame.scale**2, (centre - frame.centre) / frame.scale), basis_of("symmetric"), frame.scaled(m)
    x, ratio = quadric.parameters_of("symmetric", quadric.soft_of(near[0]), near[1]), quadric.away(near, u)
    usual = scipy.special.erfc(_TAIL / np.sqrt(2)) * len(u)
    if len(u) >= _EACH * COUNT["symmetric"] and np.sum(ratio > _TAIL * quadric.spread_of(ratio)) > usual + _SURE * np.sqrt(usual):
        for _ in range(_ROUNDS):
            one = Ellipsoids.of(u, "symmetric").near(x, None, u)
            square = np.minimum((one.distance / (_TUKEY * quadric.spread_of(np.abs(one.distance)))) ** 2, 1.0)
            pulled = one.distance * (1 - square) ** 2 / np.mean((1 - square) * (1 - 5 * square))
            m = frame.centre + frame.scale * (u - one.normal * (one.distance - pulled)[:, None])
            x = x + np.linalg.lstsq(-one.slopes, pulled, rcond=None)[0]
    return m, frame.scale * (basis @ x) + np.append(np.zeros(9), frame.centre)


def _of_object(asked: Asked, m: Any) -> Surface:
    """The surface of a model object through readings (n, 3), on the host or in a trace, from the algebraic fit, or else from its values."""
    model, field, conditions, (given, names, put) = asked.model, asked.norm, asked.conditions, asked.parts
    xp, kind, frame = m.__array_namespace__(), m.dtype, Frame.of(m)
    left, values, right = xp.linalg.svd(given[:9].reshape(3, 3))
    turn, soft, hard, more = left @ right, (left * values[None]) @ left.T, given[9:12], given.size - 12
    norm = xp.median(xp.linalg.norm(m - hard[None], axis=1)) if field is None else field
    with contextlib.suppress(NotEllipsoid):
        begun = (quadric.host_start if xp is np else quadric.traced_start)(frame.scaled(m), "symmetric")
        iron = frame.scale * (basis_of("symmetric") @ begun)
        norm = radius_of(iron[:9].reshape(3, 3)) if field is None else field
        soft, hard = iron[:9].reshape(3, 3) / norm, frame.centre + iron[9:]
    basis = np.concatenate([basis_of("symmetric"), np.zeros((12, more))], axis=1).astype(kind)
    symmetric = (xp.asarray(SYMMETRIC.T.reshape(6, 3, 3), dtype=kind) @ turn).reshape(6, 9).T
    to_leaves = xp.concatenate([
        xp.concatenate([symmetric, xp.zeros((9, 3 + more), dtype=kind)], axis=1), xp.eye(3 + more, 9 + more, 6, dtype=kind)
    ])  # fmt: skip
    structure = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), model)
    h = (m - hard[None]) @ xp.linalg.inv(soft @ turn).T
    h = h / (h**2).sum(axis=1, keepdims=True) ** 0.5
    begin = xp.concatenate([soft[UPPER], hard, given[12:]])
    found = maximised(Measured(structure, (m, norm, conditions, to_leaves), type(model).__name__, basis, norm), begin, h)
    leaves = to_leaves @ found.parameters
    return Surface(
        found=found, model=put(leaves), field=norm, residual=found.distance, noise=found.noise, m=m,
        slopes=xp.concatenate([to_leaves[np.r_[9:12, 0:9]], xp.zeros((1, 9 + more), dtype=kind), to_leaves[12:]]), radius=norm,
        corrected=norm * found.near.corrected, further=dict(zip(names, leaves[12:], strict=True)),
        usual={name: xp.median(value, axis=0) for name, value in conditions.items()},
    )  # fmt: skip
