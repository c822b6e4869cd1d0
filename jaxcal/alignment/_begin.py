"""Where the joint fit starts: in the right basin, from linear fits and a search over the azimuth."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Array
from ._equation import distance
from ._frames import EARTH_RATE, earth_rate, table_from_nav, wrap
from ._model import INDEX, Table
from ._simulate import attenuation

_GRID = 360


class Start(eqx.Module):
    """values : (14,). other : (14,) another set of values that fits as well, meaningful where `twofold`."""

    values: Array
    other: Array
    twofold: Array


def sensitive(table: Table, dtype: Any) -> Array:
    """Sensitive axis at every position in table axes, (n, 3), the turning part attenuated as the readings are."""
    u = jnp.asarray(table.axes, dtype=dtype)[:, 0]
    k = attenuation(jnp.asarray(table.width, dtype=dtype))
    c, s = k * jnp.cos(table.angle), k * jnp.sin(table.angle)
    return jnp.stack([c * u[:, 0] - s * u[:, 1], s * u[:, 0] + c * u[:, 1], u[:, 2]], axis=1)


def _vector(u: Array, reading: Array, weight: Array, offset: Array) -> tuple[Array, Array]:
    """Least-squares vector v of reading = u.v + b, and which of its components the readings determine."""
    rows = weight[:, None] * jnp.concatenate([u, jnp.broadcast_to(offset, (u.shape[0], 1))], axis=1)
    left, s, right = jnp.linalg.svd(rows, full_matrices=False)
    kept = s > 1e-6 * jnp.max(s)
    inverse = jnp.where(kept, 1 / jnp.where(kept, s, 1), 0)
    vector = right.T @ (inverse * (left.T @ (weight * reading)))
    hidden = 1 - jnp.sum(jnp.where(kept[:, None], right, 0) ** 2, axis=0)
    return vector[:3], hidden[:3] < 1e-6


def begin(table: Table, given: Array, known: Array, free: Array, hint: Array, noise: Array, hemisphere: Array) -> Start:
    """Start of the joint fit.

    given, known : (14,) values that the caller sets, and which. hint : azimuth, NaN where there is none. noise : standard deviation
    of the gyro for a second, to say which minima of the search are one as good as the other. hemisphere : +1, -1 or 0.
    """
    at = lambda name: given[INDEX[name]]  # noqa: E731
    dtype = given.dtype
    u, root = sensitive(table, dtype), jnp.sqrt(jnp.asarray(table.dwell, dtype=dtype))
    one = lambda name: jnp.where(free[INDEX[name]], 1, 0).astype(dtype)  # noqa: E731
    accel = (table.accel - at("b_a")) / table.gravity
    gyro = (table.gyro - at("b_g")) / EARTH_RATE
    down, seen = _vector(-u, accel, jnp.where(table.has_accel, root, 0), one("b_a"))
    rate, turns = _vector(u, gyro, jnp.where(table.has_gyro, root, 0), one("b_g"))

    plane = down[0] ** 2 + down[1] ** 2
    up = jnp.where(known[INDEX["phi"]], jnp.cos(at("phi")), 1)
    third = jnp.where(seen[2], down[2], jnp.where(up < 0, -1, 1) * jnp.sqrt(jnp.maximum(1 - plane, 0)))
    set_to = lambda name, value: jnp.where(known[INDEX[name]] | ~free[INDEX[name]], at(name), value)  # noqa: E731
    phi = set_to("phi", jnp.arctan2(down[1], third))
    theta = set_to("theta", jnp.arctan2(-down[0], jnp.hypot(down[1], third)))

    lat_free = free[INDEX["latitude"]] & ~known[INDEX["latitude"]]
    side = jnp.sqrt(jnp.maximum(1 - rate[0] ** 2 - rate[1] ** 2, 0))
    first, second = (_levelled(rate.at[2].set(jnp.where(turns[2], rate[2], z)), phi, theta) for z in (side, -side))
    two = lat_free & ~turns[2] & (side > 1e-6)
    cost = jnp.stack([_preference(psi, lat, hint, hemisphere) for psi, lat in (first, second)])
    swap = two & (cost[1] < cost[0])
    found = jnp.where(swap, jnp.stack(second), jnp.stack(first))
    rest = jnp.where(swap, jnp.stack(first), jnp.stack(second))
    latitude = set_to("latitude", found[1])

    searched, other, tie = _search(phi, theta, latitude, u, gyro, jnp.where(table.has_gyro, root, 0), one("b_g"), hint, noise)
    psi = set_to("psi", jnp.where(lat_free, found[0], searched))
    values = given.at[:3].set(jnp.stack([phi, theta, psi])).at[INDEX["latitude"]].set(latitude)
    twofold = jnp.where(lat_free, two & (cost[0] == cost[1]), tie & free[INDEX["psi"]] & ~known[INDEX["psi"]])
    second_values = values.at[2].set(jnp.where(lat_free, rest[0], other)).at[INDEX["latitude"]].set(jnp.where(lat_free, rest[1], latitude))
    return Start(jax.lax.stop_gradient(values), jax.lax.stop_gradient(second_values), twofold)


def _levelled(w: Array, phi: Array, theta: Array) -> tuple[Array, Array]:
    """Azimuth and latitude of an Earth's rate in table axes."""
    h = table_from_nav(phi, theta, jnp.zeros_like(phi)).T @ w
    return jnp.arctan2(-h[1], h[0]), jnp.arctan2(-h[2], jnp.hypot(h[0], h[1]))


def _preference(psi: Array, latitude: Array, hint: Array, hemisphere: Array) -> Array:
    """How far a candidate is from what was said before: 0 where nothing was."""
    by_hint = jnp.where(jnp.isnan(hint), 0, distance(psi, jnp.where(jnp.isnan(hint), 0, hint)))
    return by_hint + jnp.where(hemisphere * latitude < 0, 10, 0)


def _search(phi, theta, latitude, u, gyro, weight, offset, hint, noise) -> tuple[Array, Array, Array]:
    """Lowest misfit of the gyro over a grid of azimuths, the next minimum, and whether it is as good."""
    grid = jnp.arange(_GRID, dtype=phi.dtype) * (2 * np.pi / _GRID)
    model = jax.vmap(lambda psi: u @ earth_rate(table_from_nav(phi, theta, psi), latitude))(grid)
    misfit = weight[None, :] * (gyro[None, :] - model)
    column = weight * offset
    square = column @ column
    along = misfit @ column / jnp.where(square > 0, square, 1)
    misfit = misfit - along[:, None] * column[None, :]
    cost = jnp.sum(misfit**2, axis=1) / (noise / EARTH_RATE) ** 2
    far = ~jnp.isnan(hint) & (distance(grid, jnp.where(jnp.isnan(hint), 0, hint)) > np.pi / 2)
    best = jnp.argmin(jnp.where(far, jnp.inf, cost))
    valley = (cost <= jnp.roll(cost, 1)) & (cost <= jnp.roll(cost, -1)) & (distance(grid, grid[best]) > 3 * 2 * np.pi / _GRID)
    second = jnp.argmin(jnp.where(valley, cost, jnp.inf))
    # a minimum between two points of the grid lies lower than both by up to a quarter step's worth of curvature
    fine = (jnp.roll(cost, 1) + jnp.roll(cost, -1) - 2 * cost) / 8
    tie = jnp.any(valley) & (cost[second] - fine[second] - cost[best] < 9) & jnp.isnan(hint)
    return wrap(grid[best]), wrap(grid[second]), tie
