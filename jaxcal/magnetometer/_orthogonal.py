"""Maximum likelihood of the readings of a surface: orthogonal distances, the curvature that noise sees, and a prior for few readings.

One function takes a surface of any kind to its fit, another an ellipsoid of the kind that the readings show.

The steps of the fit are the same for every model, on the host and in a trace. Between rounds of them the noise gives the mean offset that
it causes at the curved surface, and the weight of the prior: the entries of a soft iron depart from a multiple of the identity by 40 %.
The prior's error is in the covariance. It matters where readings are so few and noisy that the fit would run off.
"""

import contextlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from ..fitting._implicit import implicit
from ..fitting._information import symmetric_inverse
from . import _quadric as quadric
from ._nearest import Ellipsoids, Near, repeated
from ._quadric import COUNT, EXACT, NotEllipsoid, basis_of, inverse_of

CURVED = 0.02  # noise over radius above which the curvature term matters
_STEPS = 128  # most of a fit
SETTLED = 1e-7  # step in standard errors, and relative change of the noise, or of the degrees of freedom, that end the steps
_FARTHEST = 1e3  # sizes of the log: an ellipsoid so large is a plane
SOFT = 0.4  # spread of the entries of a soft iron about a multiple of the identity: the paper's sensor, the strongest known, has 0.3


class Weights(NamedTuple):
    """What a round knows of the noise.

    noise2 : variance for the curvature term. ridge : weight of the prior's squares. noise : standard deviation. scaled : (p, p) normal
    equations with columns of unit length. inverse : (p, p) covariance over the variance of the noise. freedom : readings less the
    parameters that they, not the prior, determine.
    """

    noise2: Any
    ridge: Any
    noise: Any
    scaled: Any
    inverse: Any
    freedom: Any


class Found(NamedTuple):
    """A fitted surface: parameters (p,), their covariance, noise and its degrees of freedom, distances (n,), and its readings.

    soft, centre : S and the centre of an ellipsoid in scaled readings. basis : from the parameters to their entries. noise2 : for the
    curvature term, in the distances.
    """

    parameters: Any
    soft: Any
    centre: Any
    covariance: Any
    noise: Any
    freedom: Any
    distance: Any
    near: Near
    converged: Any
    kind: str
    basis: Any
    noise2: Any = 0.0


def penalties(basis: np.ndarray) -> np.ndarray:
    """Departure (9, p) of S from a multiple of the identity by its parameters; its squares sum over the entries."""
    return basis[:9] - np.outer(np.eye(3, dtype=basis.dtype), basis[[0, 4, 8]].mean(axis=0))


def terms(x: Any, variance: Any, basis: np.ndarray, size: Any) -> tuple[Any, Any]:
    """Variance for the curvature term, and weight of the prior, for a variance of the noise."""
    xp, mean = x.__array_namespace__(), basis[[0, 4, 8]].mean(axis=0) @ x
    # a noise too small matters not, and with one too large there is no surface
    radius2 = (size * mean) ** 2
    curved = (0.25 * radius2 > variance) & (variance > CURVED**2 * radius2)
    return xp.where(curved, variance, 0.0), variance / (SOFT * mean) ** 2


def weighed(x: Any, near: Near, last: Sequence[Any], basis: np.ndarray, size: Any) -> Weights:
    """The noise by these distances, and the weights that it gives.

    last : variance for the curvature term, and weight of the prior. size : the field in the unit of the readings over that of S.
    """
    xp, rows, p = x.__array_namespace__(), near.slopes, x.size
    out = penalties(basis)
    normal = rows.T @ rows + last[1] * (out.T @ out)
    column = xp.sqrt(xp.diagonal(normal))
    column = xp.where(column > 0, column, 1.0)
    scaled = normal / column[:, None] / column[None]
    inverse = xp.linalg.inv(scaled + rounding_of(x) * np.eye(p, dtype=x.dtype)) / column[:, None] / column[None]
    held = ((out @ inverse) * out).sum()
    freedom = xp.maximum(len(rows) - p + last[1] * held, 1.0)
    left = near.distance - last[0] * near.curvature
    noise2 = (left**2).sum() / freedom
    return Weights(*terms(x, noise2, basis, size), xp.sqrt(noise2), scaled, inverse, freedom)


class _Point(NamedTuple):
    """Parameters, readings beside their surface, the weights before and there, the next step, the share of it to try, and whether done."""

    x: Any
    near: Near
    last: Sequence[Any]
    weights: Weights
    step: Any
    share: Any
    count: Any
    converged: Any
    done: Any


def rounds(near_at: Callable[[Any, Near], Near], x: Any, near: Near, basis: np.ndarray, size: Any) -> tuple[Any, Near, Weights, Any]:
    """The end x of the steps with the readings beside the surface there, its weights, and whether it has converged.

    Gauss-Newton steps, each with the noise that the distances before it show; a step that raises the cost is shortened.
    near_at : takes parameters, and the readings beside a surface not far from theirs, to the readings beside theirs.
    """
    xp, out, rounding = x.__array_namespace__(), penalties(basis), rounding_of(x)

    def cost(x: Any, near: Near, here: Near, last: Sequence[Any]) -> Any:
        # with the offset of the point from which a step begins, whose slopes leave that of the curvature out
        return ((near.distance - last[0] * here.curvature) ** 2).sum() + last[1] * ((out @ x) ** 2).sum()

    def point(x: Any, near: Near, last: Sequence[Any], count: Any) -> _Point:
        weights = weighed(x, near, last, basis, size)
        gradient = near.slopes.T @ (near.distance - last[0] * near.curvature) + last[1] * (out.T @ (out @ x))
        step, total = -(weights.inverse @ gradient), cost(x, near, near, last)
        off = -(gradient @ step) / xp.where(total > 0, total, 1.0)  # square of the step in standard errors, over the readings
        short = xp.linalg.norm(step) <= rounding * xp.linalg.norm(x)
        alike = SETTLED + rounding
        settled = (abs(weights.noise2 - last[0]) <= alike * weights.noise2) & (abs(weights.freedom - last[2]) <= alike * weights.freedom)
        flat = ((off <= SETTLED**2) | short) & xp.isfinite(total)
        done = flat & settled | ~xp.isfinite(weights.noise) | (count >= _STEPS)
        return _Point(x, near, last, weights, step, 0.0 * off + 1.0, count, flat, done)

    def advance(here: _Point) -> _Point:
        x = here.x + here.share * here.step
        near = near_at(x, here.near)
        # so near the solution that the cost only changes by rounding it cannot judge a step
        better = cost(x, near, here.near, here.last) <= (1 + rounding) * cost(here.x, here.near, here.near, here.last)
        shorter = here._replace(share=here.share / 4, count=here.count + 1, done=here.count >= _STEPS)
        if xp is np and not better:
            return shorter
        weights = here.weights
        there = point(x, near, (weights.noise2, weights.ridge, weights.freedom), here.count + 1)
        return there if xp is np else jax.tree.map(lambda new, old: xp.where(better, new, old), there, shorter)

    near = near_at(x, near)  # which also gives the start its shapes
    first, none = weighed(x, near, (0.0, 0.0), basis, size), xp.zeros((), dtype=x.dtype)
    begin = point(x, near, (first.noise2 + none, first.ridge, first.freedom), xp.asarray(0))
    end = repeated(advance, begin, lambda here: here.done)
    # the last step is so short that the distances follow it by their slopes
    step = xp.where(end.converged, end.step, 0.0)
    return end.x + step, end.near._replace(distance=end.near.distance + end.near.slopes @ step), end.weights, end.converged


def rounding_of(x: Any) -> float:
    """Smallest eigenvalue of normal equations of p parameters, with columns of unit length, that is no rounding."""
    return 10 * x.size * float(np.finfo(x.dtype).eps)


def found_of(x: Any, near: Near, weights: Weights, basis: np.ndarray, converged: Any, kind: str) -> Found:
    """A fitted surface by its distances and their slopes, and by the prior."""
    iron, xp, scaled = basis @ x, x.__array_namespace__(), weights.scaled
    # a combination that is lost in the rounding of the normal equations
    determined = xp.linalg.eigvalsh(scaled if xp is np else jax.lax.stop_gradient(scaled))[0] > 100 * rounding_of(x)
    covariance = xp.where(determined, weights.noise**2 * weights.inverse, np.inf)
    left = near.distance - weights.noise2 * near.curvature
    soft, centre = iron[:9].reshape(3, 3), iron[9:]
    return Found(x, soft, centre, covariance, weights.noise, weights.freedom, left, near, converged, kind, basis, weights.noise2)


def maximised(surface: Any, begin: Any, h: Any) -> Found:
    """The fit of a surface (see `Ellipsoids`) by `rounds` from parameters, and unit fields (n, 3) near which to begin.

    In a trace it has a derivative: that of the root of the slope of the cost, with the variance of the noise as one more unknown.
    """
    basis, kind, none = surface.basis, surface.kind, 0.0 * h[:, 0]
    near = Near(none, h, h, none, none, h, h)
    if isinstance(begin, np.ndarray):
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *surface.data), begin, near, basis, surface.size)
        return found_of(x, near, weights, basis, converged, kind)

    def solver(begin: Any, near: Near, size: Any, *data: Any) -> tuple:
        x, near, weights, converged = rounds(lambda x, near: surface.near(x, near, *data), begin, near, basis, size)
        return jnp.append(x, weights.noise**2), (near, converged.astype(x.dtype))

    def score(root: Any, further: tuple, _: Any, __: Near, size: Any, *data: Any) -> Any:
        x, near, out = root[:-1], surface.settled(root[:-1], further[0], *data), penalties(basis)
        noise2, ridge = terms(x, root[-1], basis, size)
        after = weighed(x, near, (noise2, ridge), basis, size)
        slope = near.slopes.T @ (near.distance - noise2 * near.curvature) + ridge * (out.T @ out @ x)
        return jnp.append(slope, after.noise**2 - root[-1])

    begin, near = jax.lax.stop_gradient((begin, near))
    root, (near, converged) = implicit(solver, score, begin, near, jnp.asarray(surface.size, h.dtype), *surface.data)
    x, near = root[:-1], surface.settled(root[:-1], near, *surface.data)
    noise2, ridge = terms(x, root[-1], basis, surface.size)
    return found_of(x, near, weighed(x, near, (noise2, ridge), basis, surface.size), basis, converged > 0, kind)


def fitted(u: Any, kind: str, near: Any = None) -> Found:
    """The ellipsoid of a kind through scaled readings; near : entries (12,) of S and centre to start from.

    In a trace nothing is chosen on the host.

    Raises
    ------
    NotEllipsoid
        If the readings lie on another quadric.
    """
    if near is not None:
        begin = inverse_of(kind) @ near
    else:
        begin = quadric.host_start(u, kind) if isinstance(u, np.ndarray) else quadric.traced_start(jax.lax.stop_gradient(u), kind)
    found = maximised(Ellipsoids.of(u, kind), begin, 0.0 * u)
    if isinstance(u, np.ndarray) and not np.abs(found.parameters).max() < _FARTHEST:
        raise NotEllipsoid("plane")
    return found


def by_method(u: np.ndarray, method: str, kind: str, near: Any) -> tuple[Found, Any]:
    """The ellipsoid by another method, with the smallest covariance that the readings allow there (Cramer-Rao bound), and its bias."""
    shape, centre = quadric.by_products(u, method)
    surface, x, bias = Ellipsoids.of(u, kind), quadric.parameters_of(kind, quadric.soft_of(shape), centre), 0.0
    beside = surface.near(x, None, u)
    weights = weighed(x, beside, (0.0, 0.0), surface.basis, 1.0)._replace(noise2=0.0, ridge=0.0)
    with contextlib.suppress(NotEllipsoid):
        # what the paper's method has beside noise is a bias, as the terms that a smaller model leaves out
        bias = surface.basis @ (fitted(u, kind, near).parameters - x) if method == "constrained" else bias
    return found_of(x, beside, weights, surface.basis, True, kind), bias


def likeliest(u: np.ndarray, distinct: int, near: Any, occupied: Callable[[Any], int]) -> tuple[Found, Found | None, np.ndarray]:
    """The ellipsoid of the kind that scaled readings show, that of the largest kind, and the bias by what the first leaves out.

    Kinds need more distinct readings than parameters. occupied : takes unit fields to the number of directions that count as one reading.
    """
    fits, failure, full, count = {}, None, None, 0
    for kind in reversed(COUNT):
        if distinct <= COUNT[kind]:
            continue
        if full is not None:
            x, step = _smaller(full, kind)
            margin = (COUNT[full.kind] - COUNT[kind]) * np.log(count)
            # to first order in the step, which is the smallest in the covariance of the larger model
            if _score(full.distance + full.near.slopes @ step, kind, count) > _score(full.distance, full.kind, count) + margin:
                continue
            near = basis_of(kind) @ x if (x[: COUNT[kind] - 3] > 0).all() else None
        try:
            fits[kind] = fitted(u, kind, near)
        except NotEllipsoid as error:
            failure = error
            continue
        if len(fits) == 1:
            count = occupied(fits[kind].near.field)
            full = fits[kind] if fits[kind].converged and np.isfinite(fits[kind].covariance).all() else None
    if not fits:
        raise failure or NotEllipsoid("quadric with more parameters than readings")
    found = min(fits.values(), key=lambda one: _score(one.distance, one.kind, count))
    return found, fits.get("symmetric"), _left_out(next(iter(fits.values())), found)


def _smaller(full: Found, kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Parameters of a smaller kind nearest to a fit in its covariance: almost its fit where both models hold; and the step there."""
    whiten, basis = symmetric_inverse(full.covariance), inverse_of(full.kind) @ basis_of(kind)
    x = symmetric_inverse(basis.T @ whiten @ basis) @ (basis.T @ whiten @ full.parameters)
    return x, basis @ x - full.parameters


def _score(distance: Any, kind: str, count: int) -> float:
    """The criterion n ln(mean d^2) + k ln n. n is the number of occupied bins of 500, because neighbours repeat one another."""
    return float(count * np.log(max(np.mean(distance**2), EXACT**2)) + COUNT[kind] * np.log(count))


def _left_out(largest: Found, chosen: Found) -> np.ndarray:
    """Bias (12,) of S and centre of the chosen model due to the terms that it leaves out, as far as the largest model shows it.

    A lack of evidence for these terms must not make the fit more certain. The step to the largest model is this bias plus noise, and noise
    contributes one per parameter to the likelihood ratio (positive-part James and Stein).
    """
    more = COUNT[largest.kind] - COUNT[chosen.kind]
    if not more or not np.isfinite(largest.covariance).all():
        return np.zeros(12)  # the verdict reports that the largest model could not be tried
    gain = float(np.sum(chosen.distance**2) - np.sum(largest.distance**2)) / max(largest.noise, 1e-300) ** 2
    step = largest.basis @ largest.parameters - chosen.basis @ chosen.parameters
    return np.sqrt(max(1 - more / max(gain, 1e-300), 0.0)) * step
