"""The surface of all readings that a field of one magnitude can give: chosen, fitted, and all readings beside it.

The covariance comes from fits without parts of the log, on the raw residuals. On real logs nothing else predicts the difference between
halves: what looks like a drift or a current there does not go on after the log, and taking it out of the residuals makes the error too
small.

A model object is fitted as the built-in models are. Field magnitudes do not determine a common rotation. So its soft iron is S Q with a
symmetric S, which is fitted, and the rotation Q of the start, which is kept. All other floating leaves are fitted unchanged.
"""

import functools
from typing import Any, NamedTuple

import jax
import numpy as np

from .._answer import Finding
from ..fitting._serial import BLOCKS, CHANCE, by_parts, followed, span_of, tamed
from . import _quadric as quadric
from ._aids import Asked
from ._field import sphere_grid
from ._findings import FINDINGS
from ._model import ROWS, MagModel, Measured
from ._orthogonal import Ellipsoids, Found, maximised, nearest, slopes_of
from ._quadric import COUNT, EXACT, NEAR_PLANAR, SYMMETRIC, UPPER, Chosen, Frame, NotEllipsoid, basis_of, begun, inverse_of, unit

_TUKEY, _ROUNDS = 4.685, 4  # constant of Tukey's biweight, 95 % efficient with normal noise; rounds
FAST, BENT = "rate of turn", "nonlinearity"
_FARTHEST = 1e3  # sizes of the log: an ellipsoid so large is a plane
_FEWEST = 80  # readings for which the correlation time is known well enough


class Surface(NamedTuple):
    """What a fit knows: a fitted surface, or findings why there is none, and the normal of a plane of the readings; then the attitudes.

    rows : numbers of the fitted readings, of those of the log that are finite. m : these readings, as they were fitted. said : findings.
    found : in scaled readings; scale, radius : unit of its distances, and size of the field in that unit. slopes : (12 + q, p) derivative
    of the whole matrix C H, hard iron and further leaves by its parameters.
    model, field : what it says of the iron. further, usual : values of further leaves, and the median of each condition. matrix, freedom :
    (12 + q, 12 + q) covariance of C H, hard iron and further leaves, and its degrees of freedom. parts : whether it is that of fits without
    parts of the log. flat : whether the readings are nearly in a plane. causes : what the residuals follow: name, step of the estimate that
    it explains, which is in the covariance, and largest effect on a reading over the field.
    corrected, along : all readings, and their unit vectors before sensors beside. residual : (n,) their distances, and noise : their
    standard deviation, in their unit.
    unseen : (12,) bias by terms that a smaller model leaves out, or of another method. larger : surface of the largest model, if another.
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
    corrected: Any = None
    along: Any = None
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
    flat: bool = False
    causes: tuple[tuple[str, np.ndarray, float], ...] = ()
    dip: Any = None
    down: Any = None
    joint: str = ""
    spread: Any = None
    alignment: Any = None


def surface_of(asked: Asked, picked: Chosen) -> Surface:
    """The surface through the chosen readings, the finding why there is none, or their plane."""
    ready = _prepared(asked, picked)
    one = ready if isinstance(ready, Surface) else _fitted(asked, picked, ready)
    if asked.traced:
        return one._replace(matrix=between(one.slopes, one.found.covariance), freedom=float(len(one.m) - one.found.parameters.size))
    clipped = (FINDINGS("clipped", count=picked.full),) if picked.full else ()
    one = one._replace(rows=picked.rows, said=(*clipped, *one.said))
    return one if one.found is None else _uncertain(one._replace(along=unit(one.corrected)), asked.conditions)


def _prepared(asked: Asked, picked: Chosen) -> Chosen | Surface:
    """The chosen readings, without a heavy tail; or the finding why they show no surface, or their plane."""
    m, frame, near, auto = picked.m, picked.frame, picked.near, asked.method == "ml" and asked.model in ("auto", "planar")
    if asked.parts is not None or asked.traced:
        flat = not asked.traced and bool(_extents(m - frame.centre)[2] < NEAR_PLANAR)
        return picked._replace(flat=flat) if near is not None else Surface(said=(FINDINGS("no_ellipsoid"),))
    count = _distinct(picked.m)
    least = "sphere" if auto else "symmetric" if asked.model == "auto" else asked.model
    if count <= COUNT[least] or frame.scale < EXACT * np.abs(m).max():
        return Surface(said=(FINDINGS("few", count=count, model=least, least=COUNT[least] + 1),))
    if picked.heavy:
        m, iron = _calmed(m, frame, near)
        frame = Frame.of(m)
        near = (iron - np.append(np.zeros(9), frame.centre)) / frame.scale
    spread = _extents(m - frame.centre)
    if spread[1] < NEAR_PLANAR:
        return Surface(said=(FINDINGS("line"),))
    if asked.model == "planar" or (spread[2] < NEAR_PLANAR and auto):
        normal = np.linalg.svd(m - frame.centre, full_matrices=False)[2][2]
        return Surface(plane=normal * np.sign(normal[np.argmax(np.abs(normal))]))
    return picked._replace(m=m, frame=frame, near=near, distinct=count, flat=bool(spread[2] < NEAR_PLANAR))


def _extents(off: np.ndarray) -> np.ndarray:
    """Root mean squares along the principal axes of centred readings, the largest first; in a plane one is zero to within 1e-8."""
    squares = np.linalg.eigvalsh(off.T @ off)[::-1]
    return np.sqrt(np.maximum(squares, 0.0) / max(squares.sum(), 1e-300))


def _fitted(asked: Asked, picked: Chosen, ready: Chosen) -> Surface:
    """The surface of the model asked for or, of the kinds that the largest does not exclude, of that which the readings show.

    Kinds need more distinct readings than parameters. Beside the fit by another method, that of maximum likelihood shows its bias.
    """
    u, auto, near = ready.frame.in_frame(ready.m), asked.method == "ml" and asked.model == "auto", ready.near
    fits, full, count, own = {}, None, int, asked.parts is not None
    kinds = [kind for kind in reversed(COUNT) if ready.distinct > COUNT[kind]] if auto else ["symmetric" if own else asked.model]
    ways = {"consistent": ["consistent"], "constrained": ["symmetric", "constrained"]}.get(asked.method, kinds)
    for way in ways:
        kind = way if way in COUNT else "symmetric"
        if full is not None:
            # to the parameters that are nearest by the information of the larger model: almost the fit, where both models hold
            beyond, more = _beyond(full.kind, kind), 2 * (COUNT[full.kind] - COUNT[kind])
            across = full.covariance @ beyond.T
            step = -across @ np.linalg.solve(beyond @ across, beyond @ full.parameters)
            # to first order in the step; ln(n) / n is at most 1 / e
            gain = _level(full.distance + full.near.slopes @ step) - _level(full.distance)
            if gain > more / np.e or gain > more * np.log(count()) / count():
                continue
            near = iron if ((iron := full.basis @ (full.parameters + step))[:9:4] > 0).all() else None
        try:
            iron = begun(u, way) if near is None or way != kind else near
        except NotEllipsoid:
            continue
        begin: Any = Ellipsoids.of(u, kind), quadric.parameters_of(kind, iron), 0.0 * u
        begin = _object(asked, ready, iron) if own else begin
        found = maximised(*begin, way != kind)
        if own:
            return _of_object(asked, begin[0], found)
        if not asked.traced and way == kind and not np.abs(found.parameters).max() < _FARTHEST:
            continue
        fits[way] = found
        if auto and len(fits) == 1:
            count = functools.cache(functools.partial(_occupied, found.near.field))
            if found.converged and np.isfinite(found.covariance).all():
                full = found
    if not fits or (not auto and ways[-1] not in fits):
        return Surface(said=(FINDINGS("no_ellipsoid"),))
    several = auto and len(fits) > 1
    found = min(fits.values(), key=lambda one: _score(one.distance, one.kind, count())) if several else [*fits.values()][-1]
    one = ellipsoid(found, ready.frame, asked.norm)._replace(m=ready.m, flat=ready.flat)
    if asked.traced:
        return one
    # all readings, as they are, beside the surface of those that were fitted
    same = ready.m is picked.m and len(ready.m) == len(asked.there)
    beside = found.near if same else nearest(found.soft, ready.frame.in_frame(asked.m[asked.there]) - found.centre[None])
    one = one._replace(
        unseen=one.scale * _left_out(next(iter(fits.values())) if auto else fits.get("symmetric", found), found),
        corrected=one.field * beside.corrected, residual=(beside.distance - found.noise2 * beside.curvature) * one.scale,
    )  # fmt: skip
    largest = fits.get("symmetric")
    if not auto or found is largest:
        return one
    wide = ellipsoid(largest or found, ready.frame, None)
    sure = largest is not None and largest.converged
    return one._replace(larger=wide._replace(matrix=between(wide.slopes, np.where(sure, wide.found.covariance, np.inf))))


@functools.cache
def _beyond(larger: str, kind: str) -> np.ndarray:
    """Combinations (k, p) of the parameters of a kind that are zero for a smaller one."""
    return np.linalg.svd(inverse_of(larger) @ basis_of(kind))[0][:, COUNT[kind] :].T


def _score(distance: Any, kind: str, count: int) -> float:
    """The criterion n ln(mean d^2) + k ln n. n is the number of occupied bins of 500, because neighbours repeat one another."""
    return float(count * _level(distance) + COUNT[kind] * np.log(count))


def _level(distance: np.ndarray) -> Any:
    """Logarithm of the mean square."""
    return np.log(max(distance @ distance / len(distance), EXACT**2))


def _left_out(largest: Found, chosen: Found) -> np.ndarray:
    """Bias (12,) of S and centre of the chosen model due to the terms that it leaves out, as far as the largest model shows it.

    A lack of evidence for these terms must not make the fit more certain. The step to the largest model is this bias plus noise, and noise
    contributes one per parameter to the likelihood ratio (positive-part James and Stein). What a method has beside noise is a bias, too.
    """
    more = COUNT[largest.kind] - COUNT[chosen.kind]
    if more and not np.isfinite(largest.covariance).all():
        return np.zeros(12)  # the verdict reports that the largest model could not be tried
    gain = float(chosen.distance @ chosen.distance - largest.distance @ largest.distance) / max(largest.noise**2, 1e-300)
    step = largest.basis @ largest.parameters - chosen.basis @ chosen.parameters
    return np.sqrt(max(1 - more / max(gain, 1e-300), 0.0)) * step


def _uncertain(one: Surface, conditions: dict[str, np.ndarray]) -> Surface:
    """The surface with its covariance: by parts of the log, at least that of white residuals, with what the fit cannot see by itself."""
    found, matrix, freedom, parts, causes, calm = one.found, one.found.covariance, one.found.freedom, False, (), None
    if np.isfinite(matrix).all() and found.converged and found.noise > EXACT * one.radius:
        if one.usual is None and len(found.distance) >= _FEWEST:
            causes, calm = _causes(one, conditions)
        matrix, parts = by_parts(matrix, found.near.slopes, found.distance, calm=calm)
    matrix = between(one.slopes, matrix) + sum(np.outer(step, step) for step in [one.unseen, *(step for _, step, _ in causes)])
    return one._replace(matrix=matrix, freedom=float(BLOCKS - 1) if parts else freedom, parts=parts, causes=causes)


def _causes(one: Surface, conditions: dict[str, np.ndarray]) -> tuple[tuple[tuple[str, np.ndarray, float], ...], np.ndarray | None]:
    """The causes that the residuals beside an ellipsoid show, the surest first; and the residuals as `tamed` beside the parameters."""
    found, causes, jacobian = one.found, [], one.found.near.slopes
    # a soft iron that the model leaves out is told by another step: a cause is what the largest model does not explain
    full = found.kind == "symmetric"
    span = span_of(jacobian if full else slopes_of(found.near, basis_of("symmetric")))
    calm = tamed(span, found.distance)
    columns = _columns(one, conditions)
    for name, (coefficients, chance) in followed(span, columns, calm).items():
        if chance < CHANCE:
            effect, length = columns[name] @ coefficients, np.linalg.norm(jacobian, axis=0)
            step = np.linalg.lstsq(jacobian / length, effect, rcond=1e-9)[0] / length
            causes.append((chance, (name, one.slopes @ step, float(np.max(np.abs(effect))) / one.radius)))
    return tuple(cause for _, cause in sorted(causes, key=lambda one: one[0])), calm if full else None


def _columns(one: Surface, conditions: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Columns of each cause, for the fitted readings in order of time."""
    near, rows, radius = one.found.near, one.rows, one.radius
    z, columns = (one.found.soft.T @ near.field.T).T, {}
    for name, values in conditions.items():
        # the hard iron stays that of the mean condition
        off = values[rows] - values[rows].mean()
        if off.any():
            columns[name] = near.normal * (off / np.abs(off).max())[:, None]
    # averaging over a short time shortens a turning vector in proportion to the square of its rate
    steps = one.along[1:] - one.along[:-1]
    turn = np.concatenate([steps[:1], (steps[1:] + steps[:-1]) / 2, steps[-1:]])[rows]
    columns[FAST] = ((near.normal * z).sum(axis=1) * (turn * turn).sum(axis=1))[:, None]
    square = near.normal * (z / radius) ** 2
    columns[BENT] = np.concatenate([square, square * z / radius], axis=1)
    return columns


def between(slopes: Any, covariance: Any) -> Any:
    """Covariance J C J'; infinite if C is: infinity times zero is NaN."""
    xp = covariance.__array_namespace__()
    known = xp.isfinite(covariance).all()
    return xp.where(known, slopes @ xp.where(known, covariance, 0.0) @ slopes.T, xp.inf)


def _occupied(field: np.ndarray) -> int:
    """Number of bins, of 500, that contain a unit field."""
    # products in blocks: a tree would answer as fast, but its library takes as long to load as all of a first fit
    grid, blocks = sphere_grid(), np.array_split(field, len(field) // ROWS + 1)
    return np.unique(np.concatenate([np.argmax(block @ grid.T, axis=1) for block in blocks])).size


def radius_of(soft: Any) -> Any:
    """Geometric mean of all semi-axes."""
    xp = soft.__array_namespace__()
    return xp.cbrt(xp.abs(xp.linalg.det(soft)))


def ellipsoid(found: Found, frame: Frame, norm: Any) -> Surface:
    """The surface of an ellipsoid in scaled readings, traced or not; `norm`: magnitude of the field if it is given."""
    radius = radius_of(found.soft)
    field = frame.scale * radius if norm is None else norm
    model = MagModel(found.soft * frame.scale / field, frame.centre + frame.scale * found.centre)
    return Surface(
        found=found, model=model, field=field, slopes=frame.scale * found.basis, residual=found.distance * frame.scale,
        noise=found.noise * frame.scale, scale=frame.scale, radius=radius,
    )  # fmt: skip


def _distinct(m: np.ndarray) -> int:
    """Number of distinct readings; only the first few are counted where these suffice for any model."""
    few = len(set(map(tuple, m[: 2**4].tolist())))
    return few if few > COUNT["symmetric"] else len(np.unique(m, axis=0))


def _calmed(m: np.ndarray, frame: Frame, near: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Readings whose distances d from an ellipsoid near them, with a heavy tail, are psi(d) / mean(psi'); psi is Tukey's.

    near : entries (12,) of S and centre of that ellipsoid in the frame. Also those of the ellipsoid to which this leads, in their unit.

    Least squares of these pseudo-values is the redescending fit, and their scatter gives its covariance (P. J. Huber and E. M. Ronchetti,
    Robust Statistics, 2009, section 7.8). Normal noise needs none of this.
    """
    u, x, surface = frame.in_frame(m), quadric.parameters_of("symmetric", near), Ellipsoids.of(frame.in_frame(m), "symmetric")
    for _ in range(_ROUNDS):
        one = surface.near(x, None, u)
        square = np.minimum((one.distance / (_TUKEY * quadric.spread_of(np.abs(one.distance)))) ** 2, 1.0)
        pulled = one.distance * (1 - square) ** 2 / np.mean((1 - square) * (1 - 5 * square))
        m = frame.centre + frame.scale * (u - one.normal * (one.distance - pulled)[:, None])
        x = x + np.linalg.lstsq(-one.slopes, pulled, rcond=None)[0]
    return m, frame.scale * (surface.basis @ x) + np.append(np.zeros(9), frame.centre)


def _object(asked: Asked, ready: Chosen, near: Any) -> tuple[Measured, Any, Any]:
    """The surfaces of a model object; parameters to begin with, of the algebraic fit and its values, and unit fields (n, 3)."""
    m, frame, given = ready.m, ready.frame, asked.parts[0]
    xp, kind = m.__array_namespace__(), m.dtype
    left, _, right = xp.linalg.svd(given[:9].reshape(3, 3))
    turn, more, iron = left @ right, given.size - 12, frame.scale * near
    norm = radius_of(iron[:9].reshape(3, 3)) if asked.norm is None else asked.norm
    soft, hard = iron[:9].reshape(3, 3) / norm, frame.centre + iron[9:]
    basis = np.concatenate([basis_of("symmetric"), np.zeros((12, more))], axis=1).astype(kind)
    symmetric = (xp.asarray(SYMMETRIC.T.reshape(6, 3, 3), dtype=kind) @ turn).reshape(6, 9).T
    to_leaves = xp.concatenate([
        xp.concatenate([symmetric, xp.zeros((9, 3 + more), dtype=kind)], axis=1), xp.eye(3 + more, 9 + more, 6, dtype=kind)
    ])  # fmt: skip
    structure = jax.tree.map(lambda leaf: np.zeros(leaf.shape, leaf.dtype), asked.model)
    h = (m - hard[None]) @ xp.linalg.inv(soft @ turn).T
    h = h / (h**2).sum(axis=1, keepdims=True) ** 0.5
    surface = Measured(structure, (m, norm, asked.conditions, to_leaves), type(asked.model).__name__, basis, norm)
    return surface, xp.concatenate([soft[UPPER], hard, given[12:]]), h


def _of_object(asked: Asked, surface: Measured, found: Found) -> Surface:
    """The surface of a model object, traced or not."""
    (m, norm, conditions, to_leaves), (_, names, put) = surface.data, asked.parts
    xp = m.__array_namespace__()
    leaves = to_leaves @ found.parameters
    return Surface(
        found=found, model=put(leaves), field=norm, residual=found.distance, noise=found.noise, m=m, radius=norm,
        slopes=xp.concatenate([norm * to_leaves[:9], to_leaves[9:]]),
        corrected=norm * found.near.corrected, further=dict(zip(names, leaves[12:], strict=True)),
        usual={name: xp.median(value, axis=0) for name, value in conditions.items()},
    )  # fmt: skip
