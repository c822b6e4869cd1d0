"""Ellipsoids {b + S h : |h| = 1}, with S the soft iron times the field: their kinds, fits without iteration, and which readings to fit.

A quadric is theta = [a..f | p, r, s, k] over the monomials [x^2, xy, xz, y^2, yz, z^2 | x, y, z, 1]. Every fit works on readings
that are centred and scaled, and eliminates the linear part exactly: with linear and quadratic constraints, and consistent. These also start
the iterative fits. Functions run in NumPy on the host unless they say "traced".

Readings that are none of the field (spikes, zeros, blunders) are found before the fit, which then is plain least squares. A sensor that
rests, or a value that a driver repeats, must not outvote the rest of a log. So every cell of space speaks with four readings at most. An
ellipsoid through the nearest part of these (least trimmed squares, P. J. Rousseeuw and K. Van Driessen, Technometrics 41, 1999, 212) says
how far the readings scatter, and which of them are too far.
"""

import contextlib
import functools
import math
from collections import namedtuple
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import interpolated as quantile
from .._errors import FitError
from .._types import AnyArray
from ..evidence._values import clipped, held

#: place of each entry of a symmetric matrix among its six upper ones, then their rows and columns, and the matrix (9, 6) from them to all;
#: int32, since JAX takes an array of NumPy as it first met it, and x64 may be off the next time
PLACE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]], dtype=np.int32)
UPPER = tuple(part.astype(np.int32) for part in np.triu_indices(len(PLACE)))
SYMMETRIC = np.equal.outer(PLACE.ravel(), np.unique(PLACE)).astype(float)
_HALVES, _ONES = (1 + np.eye(3)) / 2, np.ones(3)
#: number of parameters of each kind
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9}


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """Matrix (12, p) from the parameters of a kind to the entries of S and the centre."""
    diagonal, free = SYMMETRIC[:, np.diag(PLACE)], COUNT[kind] - 3
    basis = np.zeros((12, COUNT[kind]))
    basis[:9, :free] = {"sphere": diagonal.sum(axis=1, keepdims=True), "diagonal": diagonal, "symmetric": SYMMETRIC}[kind]
    basis[9:, free:] = np.eye(3)
    basis.flags.writeable = False
    return basis


@functools.cache
def inverse_of(kind: str) -> np.ndarray:
    """Matrix (p, 12) from the entries of S and the centre to the nearest parameters of a kind."""
    return np.linalg.pinv(basis_of(kind))


def parameters_of(kind: str, iron: Any) -> Any:
    """Parameters of the given kind nearest to entries (12,) of S and a centre."""
    return inverse_of(kind).astype(iron.dtype) @ iron


#: singular value of the centred readings over their size, 0.58 for a full sphere, below which they lie near a plane
NEAR_PLANAR = 0.05


class Frame(NamedTuple):
    """Centring and scaling of readings, u = (m - centre) / scale."""

    centre: AnyArray
    scale: Any

    @staticmethod
    def of(m: AnyArray) -> "Frame":
        centre = m.sum(axis=0) / len(m)
        return Frame(centre, (((m - centre[None, :]) ** 2).sum() / len(m)) ** 0.5)

    def in_frame(self, m: Any) -> Any:
        return (m - self.centre[None, :]) / self.scale


def lengths(v: np.ndarray) -> Any:
    """Length of each row (n, 3); in a quarter of the time of `numpy.linalg.norm` if the columns are contiguous, as `rows_of` has them."""
    return np.sqrt((v * v) @ _ONES)


def unit(v: np.ndarray) -> np.ndarray:
    """Rows scaled to length one."""
    return v / np.maximum(lengths(v), 1e-300)[:, None]


def rows_of(m: Any, rows: np.ndarray) -> Any:
    """Some rows, by their numbers in ascending order, with contiguous columns; the array itself if these are all."""
    return m if len(rows) == len(m) else m.T.take(rows, axis=1).T


def soft_of(shape: Any) -> Any:
    """S of the surface x'Ax = 1: the inverse of the symmetric root of A."""
    xp = shape.__array_namespace__()
    values, vectors = xp.linalg.eigh(shape)
    # rounding may make an eigenvalue negative if the ellipsoid diverged
    return (vectors / xp.sqrt(xp.maximum(values, xp.finfo(values.dtype).eps * xp.abs(values[-1])))[None, :]) @ vectors.T


class NotEllipsoid(FitError):
    """The fitted quadric is not an ellipsoid."""


def monomials(u: Any) -> Any:
    """The monomials of each reading, (n, 10)."""
    xp, axes = u.__array_namespace__(), u.T
    return xp.concatenate([axes[:1] * axes, axes[1:2] * axes[1:], axes[2:] * axes[2:], axes, xp.ones_like(axes[:1])]).T


def shape_of(theta: Any) -> tuple[Any, Any]:
    """Shape matrix A and centre of any quadric theta, scaled so that (u - x0)'A(u - x0) = 1."""
    quadratic = theta[PLACE] * _HALVES.astype(theta.dtype)  # the matrix printed in the paper belongs to another order of the monomials
    x0 = theta.__array_namespace__().linalg.solve(quadratic, -theta[6:9] / 2)
    return quadratic / (x0 @ quadratic @ x0 - theta[9]), x0


def ellipsoid_of(theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of an ellipsoid; an error for any other quadric."""
    with np.errstate(all="ignore"), contextlib.suppress(np.linalg.LinAlgError):
        shape, x0 = shape_of(theta)
        values = np.linalg.eigvalsh(np.where(np.isfinite(shape), shape, -1.0))
        # a centre hundreds of data radii away means a paraboloid, to within rounding
        if values[0] > 0 and values[-1] <= 1e12 * values[0] and np.linalg.norm(x0) <= 1e6:
            return shape, x0
    raise NotEllipsoid("the data do not determine an ellipsoid", "no_ellipsoid")


def linear(u: Any, kind: str) -> Any:
    """Theta of smallest algebraic residual under a + d + f = 3 (Y. Petrov, ellipsoid_fit), which is invariant to rotation and shift."""
    # the quadratic part is that of a sphere, plus changes within the kind that keep the trace
    part = np.linalg.pinv(SYMMETRIC) @ basis_of(kind)[:9, : COUNT[kind] - 3]
    keeping = np.linalg.svd(part[np.diag(PLACE)].sum(axis=0, keepdims=True))[2][1:].T
    moves = scipy.linalg.block_diag(part @ keeping, np.eye(4)).astype(u.dtype)
    fixed = np.isin(np.arange(10), np.diag(PLACE)).astype(u.dtype)
    columns = monomials(u)
    design, side, xp = columns @ moves, -columns @ fixed, u.__array_namespace__()
    # in a trace it is only a start, and a batch of small systems is quick
    return fixed + moves @ (np.linalg.lstsq(design, side)[0] if xp is np else xp.linalg.solve(design.T @ design, design.T @ side))


def constrained(products: np.ndarray) -> np.ndarray:
    """The quadric of length one with the least mean square under 4ac - b^2 = 1, for a x^2 + b xy + c y^2, from the mean products.

    The magnetometer paper, equations 11 to 16. It is an ellipsoid, or a hyperboloid about z.
    """
    first, rest = [0, 1, 3], [2, 4, 5, 6, 7, 8, 9]
    gain = np.linalg.solve(products[np.ix_(rest, rest)], products[np.ix_(rest, first)])
    left = products[np.ix_(first, first)] - products[np.ix_(first, rest)] @ gain
    constraint = np.array([[0.0, 0.0, 2.0], [0.0, -1.0, 0.0], [2.0, 0.0, 0.0]])
    q = np.zeros(10)
    # left q = lambda C q has exactly one solution with q'Cq > 0, because C has one positive eigenvalue
    vectors = np.real(np.linalg.eig(np.linalg.solve(constraint, left))[1]).T
    q[first] = vectors[np.argmax(np.einsum("ki,ij,kj->k", vectors, constraint, vectors))]
    q[rest] = -gain @ q[first]
    return q / np.linalg.norm(q)


#: exponents (x, y, z) of the ten monomials
EXPONENTS = np.array([(2, 0, 0), (1, 1, 0), (1, 0, 1), (0, 2, 0), (0, 1, 1), (0, 0, 2), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)])


@functools.cache
def _laplacians() -> np.ndarray:
    """Matrix (200, 100) from the mean products of the monomials, by rows, to the coefficients of the variance and its square in `noisy`."""
    before = (EXPONENTS[:, None] - EXPONENTS == np.eye(3)[:, None, None]).all(axis=3)
    one, slopes = np.eye(len(EXPONENTS)), before * EXPONENTS.T[:, :, None]  # slopes of the monomials along an axis are d times themselves
    laplacian: Any = sum(np.kron(d @ d, one) + 2 * np.kron(d, d) + np.kron(one, d @ d) for d in slopes)
    return np.concatenate([-laplacian / 2, laplacian @ laplacian / 8])


_STEPS = 30  # most of `adjusted`, which takes three where the noise is small, and eight where it is as large as the field


def noisy(products: np.ndarray, variance: float) -> np.ndarray:
    """Mean products of the monomials without those of a noise: exp(-s^2/2 D) of them, with the Laplacian D."""
    first, second = (_laplacians() @ products.ravel()).reshape(2, *products.shape)
    return products + variance * (first + variance * second)


def adjusted(products: np.ndarray) -> tuple[float, np.ndarray]:
    """The smallest variance of the noise that makes `noisy` singular, and the quadric that it then maps to zero."""
    (first, second), s2 = (_laplacians() @ products.ravel()).reshape(2, *products.shape), 0.0
    # Newton's steps on the smallest eigenvalue as it falls with the variance; readings that are exact need none
    for _ in range(_STEPS):
        values, vectors = np.linalg.eigh(products + s2 * (first + s2 * second))
        q = vectors[:, 0]
        s2 -= values[0] / (q @ (first + 2 * s2 * second) @ q)
        if abs(values[0]) <= 1e-12:  # the step has doubled its digits
            break
    return s2, vectors[:, 0]


def by_products(u: np.ndarray, method: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape matrix and centre of a fit by mean products of the monomials: "constrained", or "consistent" (adjusted least squares).

    I. Markovsky, A. Kukush and S. Van Huffel, Numer. Math. 98 (2004) 177; V. Renaudin, M. H. Afzal and G. Lachapelle, J. Sensors 2010,
    967245.
    """
    columns = monomials(u)
    products = columns.T @ columns / len(u)
    return ellipsoid_of(constrained(products) if method == "constrained" else adjusted(products)[1])


def start(u: np.ndarray, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Shape and centre of the first algebraic fit, in order of merit, that gives an ellipsoid."""
    for way in ("consistent", kind, "sphere") if kind == "symmetric" else (kind, "sphere"):
        with contextlib.suppress(NotEllipsoid):
            return ellipsoid_of(linear(u, way)) if way in COUNT else by_products(u, way)
    raise NotEllipsoid("the data do not determine an ellipsoid", "no_ellipsoid")


def traced_start(u: Any, kind: str) -> tuple[Any, Any]:
    """Shape and centre of the linear algebraic fit, or of the sphere if that fit is no ellipsoid: `start` without a choice on the host."""
    best, sphere = (shape_of(linear(u, which)) for which in (kind, "sphere"))
    values = jnp.linalg.eigvalsh(jnp.where(jnp.isfinite(best[0]), best[0], -1.0))
    good = (values[0] > 1e-6 * values[-1]) & jnp.all(jnp.isfinite(best[1]))
    # if the sphere has no real points, use one about the readings' mean
    real = sphere[0][0, 0] > 0
    round_ = (jnp.where(real, sphere[0], jnp.eye(3, dtype=u.dtype)), jnp.where(real, sphere[1], 0.0))
    return jnp.where(good, best[0], round_[0]), jnp.where(good, best[1], round_[1])


def begun(u: Any, way: str) -> Any:
    """Entries (12,) of S and centre from which to begin a kind by scaled readings, traced or not; or those by a method of `by_products`."""
    if not isinstance(u, np.ndarray):
        shape, centre = traced_start(u, way)
    else:
        shape, centre = start(u, way) if way in COUNT else by_products(u, way)
    return u.__array_namespace__().concatenate([soft_of(shape).ravel(), centre])


def away(found: tuple[np.ndarray, np.ndarray], u: np.ndarray) -> np.ndarray:
    """Size of the first-order distance to an ellipsoid."""
    z = (u - found[1]).T
    normal = found[0] @ z
    r = np.sqrt(np.maximum((z * normal).sum(axis=0), 1e-12))
    return np.abs((r - 1) * r) / np.maximum(lengths(normal.T), 1e-12)


OUTLIER = 4.0  # robust standard deviations: one of 16,000 normal readings
CURVED = 0.02  # noise over radius above which the curvature term matters
EXACT = 1e-9  # share of the field below which residuals are rounding, not noise
LONG = 20_000  # largest number of readings that are all fitted
_CELL, _PER_CELL, _PER_LONG = 0.25, 4, 32  # side of a cell over the size of the log; readings of each that vote, and of a long log
#: quantile of the distances from the median reading that is the size, above which there may be spikes; how many sizes away they begin
_SIZE, _SPIKE = 0.8, 5.0
#: shares of the readings, nearest to the median, from which trimmed fits start; the last is the share that they keep in all rounds
_SHARES, _ROUNDS = (0.97, 0.7), 4
#: factor by which the trimmed fit must be closer than the plain one; robust standard deviations of a reading that is left out; their share,
#: above which nothing is left out
_CLOSER, _FAR, _MOST = 2.0, 6.0, 0.1
#: standard deviations where a tail begins, how surely it is heavy; with fewer readings a parameter, normal noise seems so in 5 % of logs
_TAIL, _SURE, _EACH = 2.5, 4.0, 4


def spread_of(distance: np.ndarray) -> float:
    """Robust standard deviation of sizes of distances, in scaled units."""
    return max(1.4826 * float(quantile(distance, 0.5)), 1e-9)


def _voters(off: np.ndarray, size: float, most: int = _PER_CELL) -> np.ndarray:
    """Rows of at most so many readings of each cell, evenly over time, of a log of some size."""
    # cells that share a number are far apart, and only few
    number = 2.0 ** np.array([0, 17, 34]) @ np.floor(off.T / (_CELL * size))
    order = np.argsort(number, kind="stable")
    number = number[order]
    first = np.searchsorted(number, number)
    count = np.searchsorted(number, number, side="right") - first
    return np.sort(order[(np.arange(len(number)) - first) * most % count < most])


def _frame(m: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Median reading and size of a log, by readings of which every cell has four at most: a dwell does not shrink them; and these rows."""
    rows, part = np.arange(len(m)), m
    for _ in range(4):
        middle, last = quantile(part.T, 0.5), rows
        size = float(quantile(lengths(part - middle), _SIZE))
        if not size > 0:
            break
        rows = _voters(m - middle, size)
        if np.array_equal(rows, last):
            break
        part = rows_of(m, rows)
    return middle, size, rows


def thinned(m: np.ndarray) -> np.ndarray:
    """Rows of a long log of which every cell of space has 32 at most: neighbouring readings repeat one another."""
    middle, size, _ = _frame(m)
    return _voters(m - middle, size, _PER_LONG) if size > 0 else np.arange(len(m))


def _trimmed(u: np.ndarray) -> list[tuple[float, tuple[np.ndarray, np.ndarray]]]:
    """Ellipsoids through the nearest part of the readings (concentration steps of least trimmed squares), with the median distance."""
    order, found = np.argsort(lengths(u)), []
    for share in _SHARES:
        rows = order[: int(share * len(u))]
        with contextlib.suppress(NotEllipsoid, np.linalg.LinAlgError):
            for number in range(_ROUNDS + 1):
                one = ellipsoid_of(linear(u[rows], "symmetric"))
                distance = away(one, u)
                found += [(float(quantile(distance, 0.5)), one)] if number else []
                rows = np.argsort(distance)[: int(_SHARES[-1] * len(u))]
    return found


def sound(m: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray, np.ndarray] | None]:
    """Flags (n,) of the readings that do not stand apart, and the ellipsoid near them with their distances, in any unit.

    All readings are kept where an ellipsoid through most is not to be had, or more than a tenth stand apart.
    """
    everything, middle = np.ones(len(m), dtype=bool), quantile(m.T, 0.5)
    size = float(quantile(lengths(m - middle), _SIZE))
    if size > 0 and (lengths(m - middle) <= _SPIKE * size).all() and _solid(u := (m - middle) / size):
        # there is no need to vote where little noise, and no reading, stands apart from an ellipsoid through all
        found, distance = _through(u, u)
        if found is not None and distance.max() <= OUTLIER * spread_of(distance) <= OUTLIER * CURVED and _tail(distance) <= _SURE / 2:
            return everything, (found[0] / size**2, middle + size * found[1], distance)
    middle, size, voters = _frame(m)
    kept = lengths(m - middle) <= _SPIKE * size
    close = np.flatnonzero(kept)
    if not size > 0 or len(m) - len(close) > _MOST * len(m) or len(close) < 2 * COUNT["symmetric"]:
        return everything, None
    u = (m - middle) / size
    voters = voters if len(close) == len(m) else close[_voters(rows_of(u, close), 1.0)]
    vote = rows_of(u, voters)
    if not _solid(vote):
        return kept, None
    found, distance = _through(vote, u)
    # a fit without a reading that stands apart needs no other
    if found is None or not distance[voters].max() <= OUTLIER * spread_of(distance[voters]):
        median, trimmed = min(_trimmed(vote), key=lambda one: one[0], default=(np.inf, None))
        if trimmed is not None and (found is None or _CLOSER * median < quantile(distance[voters], 0.5)):
            found, distance = trimmed, away(trimmed, u)
    if found is None:
        return kept, None
    near, (shape, centre) = kept & (distance <= _FAR * spread_of(distance[voters])), found
    few = np.count_nonzero(near) < (1 - _MOST) * len(m)
    return (everything, None) if few else (near, (shape / size**2, middle + size * centre, distance[near]))


def _solid(u: np.ndarray) -> bool:
    """Whether scaled readings are enough for an ellipsoid, and not near a plane."""
    squares = np.linalg.eigvalsh((off := u - u.sum(axis=0) / max(len(u), 1)).T @ off)
    return len(u) >= 2 * COUNT["symmetric"] and bool(squares[0] >= NEAR_PLANAR**2 * squares.sum())


def _through(vote: np.ndarray, u: np.ndarray) -> tuple[tuple[np.ndarray, np.ndarray] | None, np.ndarray]:
    """The ellipsoid through some readings, or None, and the distances of others."""
    with contextlib.suppress(NotEllipsoid, np.linalg.LinAlgError):
        found = start(vote, "symmetric")
        return found, away(found, u)
    return None, np.zeros(0)


def _tail(distance: np.ndarray) -> float:
    """By how many of its standard deviations the number of far readings exceeds that of normal noise."""
    usual = math.erfc(_TAIL / math.sqrt(2)) * len(distance)
    return (np.count_nonzero(distance > _TAIL * spread_of(distance)) - usual) / math.sqrt(usual)


class Chosen(namedtuple("Chosen", "rows m frame full near heavy distinct flat", defaults=(0, None, False, 0, False))):
    """Readings to fit: numbers, themselves, frame, how many were saturated, S and centre (12,) near them, whether their tail is heavy.

    distinct : how many differ; only whether any model has fewer parameters. flat : whether they are nearly in a plane.
    """


def chosen(m: Any, everything: str = "") -> Chosen:
    """The readings to fit: without spikes, repeats and saturated ones, thinned if many; or all, for a fit of the kind `everything`."""
    if everything:
        frame, near = Frame.of(m), None
        with contextlib.suppress(NotEllipsoid):
            near = begun(frame.in_frame(m), everything)
        return Chosen(np.arange(len(m)), m, frame, near=near)
    m = np.asfortranarray(m)
    full = clipped(m)
    used = np.flatnonzero(~(full | held(m)))
    kept, near = sound(rows_of(m, used))
    used, some = used[kept], ...
    if len(used) > LONG:
        some = thinned(rows_of(m, used))
        used = used[some]
    m = rows_of(m, used)
    frame, clipping = Frame.of(m), int(full.sum())
    if near is None:
        return Chosen(used, m, frame, clipping)
    heavy = len(m) >= _EACH * COUNT["symmetric"] and _tail(near[2][some]) > _SURE
    iron = np.concatenate([soft_of(near[0]).ravel() / frame.scale, (near[1] - frame.centre) / frame.scale])
    return Chosen(used, m, frame, clipping, iron, heavy)
