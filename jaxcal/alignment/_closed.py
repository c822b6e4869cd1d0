"""The closed forms of the azimuth, as pure functions of the readings in units of the Earth's rate."""

import equinox as eqx
import jax
import jax.numpy as jnp

from .._types import Any, Array
from ._equation import Roots, joined, root_of, solve

_FLAT = 1e-9
_LEVEL = 1e-6


class Closed(eqx.Module):
    """Roots, with the bias and scale of each in units of the Earth's rate where the method gives them, and the latitude of `triad`."""

    found: Roots
    bias: Any = None
    scale: Any = None
    scale_approx: Any = None
    latitude: Any = None
    latitude_std: Any = None
    rho: Any = None


def _trig(phi: Array, theta: Array) -> tuple[Array, Array, Array, Array]:
    return jnp.sin(phi), jnp.cos(phi), jnp.sin(theta), jnp.cos(theta)


def opposed(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equation (40), first: 0 and 180."""

    def coefficients(x: Array) -> Array:
        _, _, st, ct = _trig(x[2], x[3])
        return jnp.stack([0 * ct, ct * jnp.cos(lat), (x[0] - x[1]) / 2 - st * jnp.sin(lat)])

    return Closed(solve(coefficients, x, covariance), bias=(x[0] + x[1]) / 2)


def quadrature(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equation (40), second: 90 and 270."""

    def coefficients(x: Array) -> Array:
        sf, cf, st, ct = _trig(x[2], x[3])
        return jnp.stack([-cf, st * sf, ((x[0] - x[1]) / 2 + ct * sf * jnp.sin(lat)) / jnp.cos(lat)])

    return Closed(solve(coefficients, x, covariance), bias=(x[0] + x[1]) / 2)


def single_reading(x: Array, covariance: Array, lat: Array, tau: Array) -> Closed:
    """Equations (42), (43): one reading at the table angle tau, bias and scale taken off."""

    def coefficients(x: Array) -> Array:
        sf, cf, st, ct = _trig(x[1], x[2])
        s, c, sl, cl = jnp.sin(tau), jnp.cos(tau), jnp.sin(lat), jnp.cos(lat)
        return jnp.stack([-cf * cl * s, cl * (st * sf * s + ct * c), x[0] - st * sl * c + ct * sf * sl * s])

    return Closed(solve(coefficients, x, covariance))


def four_point(x: Array, covariance: Array, lat: Array) -> Closed:
    """0, 90, 180 and 270: one root."""
    _, cf, _, ct = _trig(x[4], x[5])
    flat = (jnp.abs(cf) < _FLAT) | (jnp.abs(ct) < _FLAT)

    def parts(x: Array) -> Array:
        sf, cf, st, ct = _trig(x[4], x[5])
        sl, cl = jnp.sin(lat), jnp.cos(lat)
        u1 = ((x[0] - x[2]) / 2 - st * sl) / (jnp.where(flat, 1, ct) * cl)
        u2 = ((x[1] - x[3]) / 2 + ct * sf * sl) / cl
        return jnp.stack([(u1 * st * sf - u2) / jnp.where(flat, 1, cf), u1])

    return Closed(_one_root(parts, x, covariance, flat), bias=jnp.mean(x[:4]))


def _one_root(parts: Any, x: Array, covariance: Array, flat: Array) -> Roots:
    """The azimuth as atan2 of two numbers of the readings."""
    y = parts(x)
    empty = flat | (y @ y < _FLAT**2)
    safe = jnp.where(empty, 1, y @ y)
    s, c = jnp.where(empty, 0, y[0]), jnp.where(empty, 1, y[1])
    row = (c * jax.jacfwd(parts)(x)[0] - s * jax.jacfwd(parts)(x)[1]) / safe
    std = root_of(row @ covariance @ row)
    steep = jnp.max(jnp.abs(row)) > 50
    weak = jnp.where(jnp.trace(covariance) > 0, std > 0.17453292519943295, steep) & ~empty
    false = jnp.zeros(1, dtype=bool)
    return Roots(jnp.arctan2(s, c)[None], std[None], ~empty[None], empty, false[0], false[0], false, weak[None])


def maximum(x: Array, covariance: Array, lat: Array, bias: Array) -> Closed:
    """The amplitude against the table angle, equations (44) to (52) without the quartic; x = (cosine, sine, phi, theta)."""
    sf, cf, st, _ = _trig(x[2], x[3])
    level = jnp.hypot(sf, st * cf) < _LEVEL

    def rate(x: Array, sign: float) -> Array:
        return sign * root_of(1 - x[0] ** 2 - x[1] ** 2)

    def coefficients(x: Array, sign: float) -> Array:
        sf, cf, st, ct = _trig(x[2], x[3])
        return jnp.stack([sf, st * cf, (rate(x, sign) + ct * cf * jnp.sin(lat)) / jnp.cos(lat)])

    both = joined(*(solve(lambda x, sign=sign: coefficients(x, sign), x, covariance, _LEVEL) for sign in (-1.0, 1.0)))
    rho = root_of(x[0] ** 2 + x[1] ** 2)
    toward = x[:2] / jnp.where(rho > 0, rho, 1)
    sigma = jnp.sqrt(jnp.maximum(toward @ covariance[:2, :2] @ toward, 0))
    over = rho - 1 > jnp.maximum(5 * sigma, 1e-9)
    merged = jnp.abs(rate(x, 1.0)) < 1e-6
    found = Roots(
        both.roots, both.std, both.real & ~over & ~level, level, over | both.infeasible, (rho > 1) & ~over, both.merged | merged, both.weak
    )
    return Closed(found, bias=bias, rho=rho)


def _scaled(x: Array) -> tuple[Array, Array, Array]:
    """Bias, and S Wx and S Wy, from 0, 90 and 180."""
    b = (x[0] + x[2]) / 2
    return b, x[0] - b, x[1] - b


def _ratio(x: Array, lat: Array) -> Array:
    """Equation (58) through w2 and cos(lat): regular everywhere."""
    _, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x[3], x[4])
    sl, cl = jnp.sin(lat), jnp.cos(lat)
    return jnp.stack([-w1 * cf * cl, (w1 * st * sf - w2 * ct) * cl, (w2 * st + w1 * ct * sf) * sl])


def scale_at(x: Array, lat: Array, psi: Array) -> Array:
    """Scale factor of a root, by projection on the Earth's rate in the table's plane."""
    _, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x[3], x[4])
    sl, cl, sp, cp = jnp.sin(lat), jnp.cos(lat), jnp.sin(psi), jnp.cos(psi)
    wx, wy = cp * ct * cl + st * sl, (cp * st * sf - sp * cf) * cl - ct * sf * sl
    square = wx**2 + wy**2
    return jnp.where(square > 0, (w1 * wx + w2 * wy) / jnp.where(square > 0, square, 1), 0)


def bias_and_scale(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (53) to (60): 0, 90 and 180."""
    found = solve(lambda x: _ratio(x, lat), x, covariance)
    scale = scale_at(x, lat, found.roots)
    return Closed(_positive(found, scale), bias=_scaled(x)[0], scale=scale)


def _positive(found: Roots, scale: Array) -> Roots:
    """All roots stay; a method that finds none with a positive scale does not fit."""
    none = ~jnp.any(found.real & (scale > 0)) & ~found.degenerate
    return eqx.tree_at(lambda r: r.infeasible, found, found.infeasible | none)


def scale_first(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (61) to (67), solved for 1/S."""
    by_angle = solve(lambda x: _ratio(x, lat), x, covariance)
    b, w1, w2 = _scaled(x)
    sf, cf, st, ct = _trig(x[3], x[4])
    flat = (jnp.abs(cf) < _FLAT) | (jnp.abs(ct) < _FLAT)
    cf, ct = jnp.where(flat, 1, cf), jnp.where(flat, 1, ct)
    sl, cl = jnp.sin(lat), jnp.cos(lat)
    tf, tt, tl = sf / cf, st / ct, sl / cl
    p, q = w1 * tt * tf - w2 / cf, tl * tf / ct
    leading = p**2 + (w1 / ct) ** 2
    middle = -2 * (p * q + w1 * tl * tt / ct)
    last = (1 - (sl / (ct * cf)) ** 2) / cl**2
    root = root_of(middle**2 + 4 * leading * last)
    # the stable form of both roots: no difference of nearly equal numbers
    half = -(middle + jnp.where(middle < 0, -root, root)) / 2
    empty = flat | (leading < _FLAT**2)
    inverse = jnp.stack([half / jnp.where(empty, 1, leading), jnp.where(half == 0, 0, -last / jnp.where(half == 0, 1, half))])
    psi = jnp.arctan2(inverse * p - q, inverse * w1 / ct - tl * tt)
    positive = inverse > 0
    scale = jnp.where(positive, 1 / (jnp.where(positive, inverse, 1) * cl), 0)
    # the same estimates as by angle first, in another order: they have the same standard deviations
    near = jnp.argmin(jnp.abs(jnp.sin((psi[:, None] - by_angle.roots[None, :]) / 2)), axis=1)
    lean = last * cl**2
    approx = 1 + (-lean + leading + middle * cl) / jnp.where(2 * lean == middle * cl, 1, 2 * lean - middle * cl)
    found = Roots(
        psi, by_angle.std[near], by_angle.real[near] & positive & ~empty, by_angle.degenerate | empty,
        by_angle.infeasible | (~jnp.any(positive) & ~empty), by_angle.clipped, by_angle.merged[near], by_angle.weak,
    )  # fmt: skip
    return Closed(found, bias=b, scale=scale, scale_approx=approx)


def triad(x: Array, covariance: Array, lat: Array) -> Closed:
    """Equations (68) to (71) and the level: 0, 90, 180 and z; neither scale nor latitude is needed."""

    def levelled(x: Array) -> Array:
        b, w1, w2 = _scaled(x)
        w3 = x[5] - b
        sf, cf, st, ct = _trig(x[3], x[4])
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
