"""Closed forms of the azimuth: pure functions of readings in units of the Earth's rate; most solve a sin(psi) + b cos(psi) = c."""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Any, Array
from ._findings import FINDINGS
from ._positions import ROUNDING, SMALL, wrap

(WEAK,) = FINDINGS["weak"].limits


class Roots(eqx.Module):
    """Roots of one or more equations.

    roots : in (-pi, pi]. std : standard deviations; large but finite for merged roots. real : flags of the real roots.
    degenerate, infeasible, clipped : flags for all roots together. merged, weak : flags for each root.
    """

    roots: Array
    std: Array
    real: Array
    degenerate: Array
    infeasible: Array
    clipped: Array
    merged: Array
    weak: Array


def root_of(square: Array) -> Array:
    """Square root; for arguments that are not positive, both value and derivative are zero."""
    inside = square > 0
    return jnp.where(inside, jnp.sqrt(jnp.where(inside, square, 1)), 0)


def arc_cosine(c: Array, r: Array) -> tuple[Array, Array]:
    """acos(clip(c / r)), accurate near 0 and pi, and sqrt(r^2 - c^2)."""
    inside = (r - c) * (r + c) > 0
    sine = root_of((r - c) * (r + c))
    angle = jnp.arctan2(jnp.where(inside, sine, 0), jnp.where(inside, c, 1))
    return jnp.where(inside, angle, jnp.where(c < 0, jnp.asarray(np.pi, dtype=c.dtype), 0)), sine


def solve(coefficients: Callable[[Array], Array], x: Array, covariance: Array, empty: float = ROUNDING) -> Roots:
    """Both roots of a sin(psi) + b cos(psi) = c, where `coefficients` computes (a, b, c) from the data `x` with their `covariance`.

    The standard deviation of a root is that of a sin + b cos - c divided by its derivative by psi; it includes the errors of all of `x`.
    """
    a, b, c = coefficients(x)
    slopes = jax.jacfwd(coefficients)(x)
    square = a**2 + b**2
    degenerate = square < empty**2
    r = jnp.sqrt(jnp.where(degenerate, 1, square))
    middle = jnp.arctan2(jnp.where(degenerate, 0, a), jnp.where(degenerate, 1, b))
    c = jnp.where(degenerate, 0, c)
    half, sine = arc_cosine(c, r)
    away = jnp.where(jnp.abs(c) > r, jnp.where(c < 0, middle + np.pi, middle), middle)
    excess = (jnp.abs(c) - r) / r
    sigma_away = _misfit(away, slopes, covariance) / r
    infeasible = (excess > jnp.maximum(5 * sigma_away, 1e-9)) & ~degenerate
    roots = jnp.stack([wrap(middle - half), wrap(middle + half)])
    sigma = jnp.stack([_misfit(root, slopes, covariance) for root in roots]) / r
    slope = sine / r
    std = sigma / jnp.maximum(slope, jnp.sqrt(jnp.maximum(sigma, 1e-300)))
    both = jnp.ones(2, dtype=bool)
    return Roots(
        roots, std, both & ~degenerate & ~infeasible, degenerate, infeasible, (excess > 0) & ~infeasible & ~degenerate,
        both & (slope < SMALL), (std > WEAK) & ~degenerate,
    )  # fmt: skip


def _misfit(root: Array, slopes: Array, covariance: Array) -> Array:
    """Standard deviation of a sin + b cos - c at one root."""
    row = jnp.sin(root) * slopes[0] + jnp.cos(root) * slopes[1] - slopes[2]
    return root_of(row @ covariance @ row)


class Closed(eqx.Module):
    """Roots with further estimates of a method: bias in units of the Earth's rate, scale of each root, latitude (`triad`), amplitude."""

    found: Roots
    bias: Any = None
    scale: Any = None
    scale_approx: Any = None
    latitude: Any = None
    latitude_std: Any = None
    rho: Any = None


def _trig(x: Array) -> tuple[Array, Array, Array, Array]:
    """Sine and cosine of roll and pitch, the last two entries of the data of every method."""
    return jnp.sin(x[-2]), jnp.cos(x[-2]), jnp.sin(x[-1]), jnp.cos(x[-1])


def _flat(x: Array) -> Array:
    """Whether roll or pitch is 90 degrees."""
    return jnp.min(jnp.abs(jnp.cos(x[-2:]))) < ROUNDING


def _at(x: Array, rate: Array, lat: Array, tau: Any) -> Array:
    """Coefficients (a, b, c) of equations (42), (43) for a rate, or for half the difference of opposite rates; x ends with the level."""
    sf, cf, st, ct = _trig(x)
    s, c, sl, cl = jnp.sin(tau), jnp.cos(tau), jnp.sin(lat), jnp.cos(lat)
    return jnp.stack([-cf * cl * s, cl * (st * sf * s + ct * c), rate - st * sl * c + ct * sf * sl * s])


def opposed(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equation (40), first form: 0 and 180 degrees."""
    return Closed(solve(lambda x: _at(x, (x[0] - x[1]) / 2, lat, 0.0), x, covariance), bias=(x[0] + x[1]) / 2)


def quadrature(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equation (40), second form: 90 and 270 degrees."""
    return Closed(solve(lambda x: _at(x, (x[0] - x[1]) / 2, lat, np.pi / 2) / jnp.cos(lat), x, covariance), bias=(x[0] + x[1]) / 2)


def single_reading(x: Array, covariance: Array, lat: Array, tau: Array) -> Closed:
    """One reading at the table angle tau, corrected for bias and scale."""
    return Closed(solve(lambda x: _at(x, x[0], lat, tau), x, covariance))


def four_point(x: Array, covariance: Array, lat: Array) -> Closed:
    """Readings at 0, 90, 180 and 270 degrees, which give one root."""
    flat = _flat(x)

    def parts(x: Array) -> Array:
        sf, cf, st, ct = _trig(x)
        sl, cl = jnp.sin(lat), jnp.cos(lat)
        u1 = ((x[0] - x[2]) / 2 - st * sl) / (jnp.where(flat, 1, ct) * cl)
        u2 = ((x[1] - x[3]) / 2 + ct * sf * sl) / cl
        return jnp.stack([(u1 * st * sf - u2) / jnp.where(flat, 1, cf), u1])

    return Closed(_one_root(parts, x, covariance, flat), bias=jnp.mean(x[:4]))


def _one_root(parts: Any, x: Array, covariance: Array, flat: Array) -> Roots:
    """Azimuth as atan2 of two functions of the readings, with its standard deviation."""
    y = parts(x)
    empty = flat | (y @ y < ROUNDING**2)
    safe = jnp.where(empty, 1, y @ y)
    s, c = jnp.where(empty, 0, y[0]), jnp.where(empty, 1, y[1])
    slopes = jax.jacfwd(parts)(x)
    row = (c * slopes[0] - s * slopes[1]) / safe
    std = root_of(row @ covariance @ row)
    false = jnp.zeros(1, dtype=bool)
    return Roots(jnp.arctan2(s, c)[None], std[None], ~empty[None], empty, false[0], false[0], false, ((std > WEAK) & ~empty)[None])


def maximum(x: Array, covariance: Array, lat: Array, bias: Array, known: Array) -> Closed:
    """Azimuth from the amplitude over the table angle, equations (44) to (52) without the quartic.

    x = (cosine, sine, phi, theta) with the fitted harmonics, which are valid if `known`.
    """
    sf, cf, st, _ = _trig(x)
    level = (jnp.hypot(sf, st * cf) < SMALL) | ~known

    def rate(x: Array, sign: Any) -> Array:
        return sign * root_of(1 - x[0] ** 2 - x[1] ** 2)

    def coefficients(x: Array, sign: Array) -> Array:
        sf, cf, st, ct = _trig(x)
        return jnp.stack([sf, st * cf, (rate(x, sign) + ct * cf * jnp.sin(lat)) / jnp.cos(lat)])

    signs = jnp.asarray([-1.0, 1.0], dtype=x.dtype)
    both = jax.vmap(lambda sign: solve(lambda x: coefficients(x, sign), x, covariance, SMALL))(signs)
    rho = root_of(x[0] ** 2 + x[1] ** 2)
    toward = x[:2] / jnp.where(rho > 0, rho, 1)
    sigma = jnp.sqrt(jnp.maximum(toward @ covariance[:2, :2] @ toward, 0))
    over = rho - 1 > jnp.maximum(5 * sigma, 1e-9)
    merged = jnp.abs(rate(x, 1.0)) < 1e-6
    roots, std, real, several, weak = (part.reshape(-1) for part in (both.roots, both.std, both.real, both.merged, both.weak))
    infeasible = over | jnp.all(both.infeasible)
    found = Roots(roots, std, real & ~over & ~level, level, infeasible, (rho > 1) & ~over, several | merged, weak)
    return Closed(found, bias=bias, rho=rho)


def _scaled(x: Array) -> tuple[Array, Array, Array]:
    """Bias, S Wx and S Wy from the readings at 0, 90 and 180 degrees."""
    b = (x[0] + x[2]) / 2
    return b, x[0] - b, x[1] - b


def _ratio(x: Array, lat: Array) -> Array:
    """Coefficients (a, b, c) of equation (58), multiplied by w2 and cos(lat) to avoid divisions by zero."""
    _, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x)
    sl, cl = jnp.sin(lat), jnp.cos(lat)
    return jnp.stack([-w1 * cf * cl, (w1 * st * sf - w2 * ct) * cl, (w2 * st + w1 * ct * sf) * sl])


def scale_at(x: Array, lat: Array, psi: Array) -> Array:
    """Scale factor of a root: projection of the readings on the Earth's rate in the table's plane."""
    _, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x)
    sl, cl, sp, cp = jnp.sin(lat), jnp.cos(lat), jnp.sin(psi), jnp.cos(psi)
    wx, wy = cp * ct * cl + st * sl, (cp * st * sf - sp * cf) * cl - ct * sf * sl
    square = wx**2 + wy**2
    return jnp.where(square > 0, (w1 * wx + w2 * wy) / jnp.where(square > 0, square, 1), 0)


def bias_and_scale(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (53) to (60): readings at 0, 90 and 180 degrees."""
    found = solve(lambda x: _ratio(x, lat), x, covariance)
    scale = scale_at(x, lat, found.roots)
    return Closed(_positive(found, scale), bias=_scaled(x)[0], scale=scale)


def _positive(found: Roots, scale: Array) -> Roots:
    """Mark the result as infeasible if no root has a positive scale; all roots are kept."""
    none = ~jnp.any(found.real & (scale > 0)) & ~found.degenerate
    return eqx.tree_at(lambda r: r.infeasible, found, found.infeasible | none)


def scale_first(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (61) to (67): the roots of `bias_and_scale`, with the linear approximation (66) of the scale."""
    made, flat = bias_and_scale(x, covariance, lat), _flat(x)
    _, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x)
    cf, ct = jnp.where(flat, 1, cf), jnp.where(flat, 1, ct)
    sl, cl = jnp.sin(lat), jnp.cos(lat)
    tf, tt, tl = sf / cf, st / ct, sl / cl
    p, q = w1 * tt * tf - w2 / cf, tl * tf / ct
    # x = 1 / (S cos(lat)) solves leading x^2 + middle x = lean / cos(lat)^2
    leading, middle, lean = p**2 + (w1 / ct) ** 2, -2 * (p * q + w1 * tl * tt / ct), 1 - (sl / (ct * cf)) ** 2
    approx = 1 + (-lean + leading + middle * cl) / jnp.where(2 * lean == middle * cl, 1, 2 * lean - middle * cl)
    empty = flat | (leading < ROUNDING**2)
    found = dataclasses.replace(made.found, real=made.found.real & (made.scale > 0) & ~empty, degenerate=made.found.degenerate | empty)
    return Closed(found, bias=made.bias, scale=jnp.where(made.scale > 0, made.scale, 0), scale_approx=approx)


def triad(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (68) to (71) with the level: readings at 0, 90, 180 degrees and z; scale and latitude are not needed."""

    def levelled(x: Array) -> Array:
        b, w1, w2 = _scaled(x)
        w3 = x[3] - b
        sf, cf, st, ct = _trig(x)
        return jnp.stack([ct * w1 + sf * st * w2 + cf * st * w3, cf * w2 - sf * w3, -st * w1 + sf * ct * w2 + cf * ct * w3])

    def latitude(x: Array) -> Array:
        h = levelled(x)
        return jnp.arctan2(-h[2], root_of(h[0] ** 2 + h[1] ** 2))

    found = _one_root(lambda x: jnp.stack([-1.0, 1.0]).astype(x.dtype) * levelled(x)[1::-1], x, covariance, jnp.asarray(False))
    alpha = jnp.sum(levelled(x) ** 2)
    slope = jax.jacfwd(latitude)(x)
    return Closed(
        found, bias=_scaled(x)[0], scale=jnp.sqrt(alpha)[None], scale_approx=1 + (alpha - 1) / 2, latitude=latitude(x),
        latitude_std=jnp.sqrt(jnp.maximum(slope @ covariance @ slope, 0)),
    )  # fmt: skip
