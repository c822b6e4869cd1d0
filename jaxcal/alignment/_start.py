"""Initial guess of the joint fit: in the right basin, from linear fits and a search over the azimuth."""

from typing import Any

import jax
import numpy as np

from .._precision import array_module
from .._types import AnyArray
from ._frames import EARTH_RATE, distance, table_from_nav, wrap
from ._table import Table

_GRID = 360


def initial_guess(
    table: Table, dwell: AnyArray, given: dict[str, Any], known: set[str], free: set[str], hint: Any, noise: Any, hemisphere: Any
) -> tuple[dict[str, Any], dict[str, Any], Any]:
    """Values to start from, other values that fit as well, and whether they do.

    Parameters
    ----------
    table : the readings. dwell : (n,) of its rows, s.
    given : value of every parameter that the caller sets or that is held. known : names that the caller set. free : names to estimate.
    hint : azimuth, rad, or None. noise : of the gyro, standard deviation for a second, to say which minima of the search are one as
        good as the other. hemisphere : +1, -1, or 0 for either.
    """
    xp = array_module(table, given, hint, noise)
    axes, root = table.places.axes[:, 0], xp.sqrt(dwell)
    weight_accel, weight_gyro = (xp.where(measured, root, 0) for measured in table.measured)
    accel = (table.accel - given["b_a"]) / table.places.gravity
    gyro = (table.gyro - given["b_g"]) / EARTH_RATE
    down, seen = _vector(-axes, accel, weight_accel, "b_a" in free)
    rate, turns = _vector(axes, gyro, weight_gyro, "b_g" in free)

    chosen = lambda name, value: given[name] if name in known or name not in free else value  # noqa: E731
    upside_down = xp.cos(given["phi"]) < 0 if "phi" in known else False
    flat = xp.sqrt(xp.maximum(1 - down[0] ** 2 - down[1] ** 2, 0))
    third = xp.where(seen[2], down[2], xp.where(upside_down, -flat, flat))
    phi = chosen("phi", xp.arctan2(down[1], third))
    theta = chosen("theta", xp.arctan2(-down[0], xp.hypot(down[1], third)))
    column = weight_gyro * float("b_g" in free)
    if "latitude" in free and "latitude" not in known:
        side = xp.sqrt(xp.maximum(1 - rate[0] ** 2 - rate[1] ** 2, 0))
        pairs = [_levelled(xp, rate[:2], xp.where(turns[2], rate[2], z), phi, theta) for z in (side, -side)]
        cost = [_preference(xp, *pair, hint, hemisphere) for pair in pairs]
        two = ~turns[2] & (side > 1e-6)
        swap = two & (cost[1] < cost[0])
        (psi, latitude), (other, other_latitude) = (
            [xp.where(swap, second, first) for first, second in zip(*pair, strict=True)] for pair in (pairs, pairs[::-1])
        )
        twofold = two & (cost[0] == cost[1])
    else:
        latitude = other_latitude = given["latitude"]
        psi, other, tie = _search(xp, phi, theta, latitude, axes, gyro, weight_gyro, column, hint, noise)
        twofold = tie if "psi" in free and "psi" not in known else xp.zeros_like(tie)
    first = given | {"phi": phi, "theta": theta, "psi": chosen("psi", psi), "latitude": latitude}
    second = first | {"psi": other, "latitude": other_latitude}
    # a free parameter's solution does not depend on where the search began; one that is held keeps its derivative
    still = lambda values: {n: jax.lax.stop_gradient(v) if xp is not np and n in free else v for n, v in values.items()}  # noqa: E731
    return still(first), still(second), twofold


def _vector(axes: AnyArray, reading: AnyArray, weight: AnyArray, offset: bool) -> tuple[AnyArray, AnyArray]:
    """Least-squares vector v of reading = axes.v + b, and which of its components the readings determine."""
    xp = array_module(axes, reading, weight)
    rows = weight[:, None] * xp.concatenate([axes, xp.full((axes.shape[0], 1), float(offset), dtype=axes.dtype)], axis=1)
    left, s, right = xp.linalg.svd(rows, full_matrices=False)
    kept = s > 1e-6 * xp.max(s)
    inverse = xp.where(kept, 1 / xp.where(kept, s, 1), 0)
    vector = right.T @ (inverse * (left.T @ (weight * reading)))
    hidden = 1 - xp.sum(xp.where(kept[:, None], right, 0) ** 2, axis=0)
    return vector[:3], hidden[:3] < 1e-6


def _levelled(xp: Any, plane: AnyArray, third: Any, phi: Any, theta: Any) -> tuple[Any, Any]:
    """Azimuth and latitude of an Earth's rate in table axes."""
    h = table_from_nav(phi, theta, xp.zeros_like(third)).T @ xp.stack([*plane, third])
    return xp.arctan2(-h[1], h[0]), xp.arctan2(-h[2], xp.hypot(h[0], h[1]))


def _preference(xp: Any, psi: Any, latitude: Any, hint: Any, hemisphere: Any) -> Any:
    """How far a candidate is from what was said before: 0 where nothing was."""
    return (0.0 if hint is None else distance(psi, hint)) + xp.where(hemisphere * latitude < 0, 10.0, 0.0)


def _search(xp, phi, theta, latitude, axes, gyro, weight, column, hint, noise) -> tuple[Any, Any, Any]:
    """Lowest misfit of the gyro over a grid of azimuths, the next minimum, and whether it is as good."""
    grid = xp.arange(_GRID, dtype=gyro.dtype) * (2 * np.pi / _GRID)
    east, north = (table_from_nav(phi, theta, angle)[:, 0] for angle in (np.pi / 2, 0.0))
    vertical = table_from_nav(phi, theta, 0.0)[:, 2] * xp.sin(latitude)
    waves = xp.stack([xp.cos(grid), xp.sin(grid)], axis=1) @ xp.stack([north, east]) * xp.cos(latitude) - vertical[None, :]
    misfit = weight[None, :] * (gyro[None, :] - waves @ axes.T)
    square = column @ column
    along = misfit @ column / xp.where(square > 0, square, 1)
    misfit = misfit - along[:, None] * column[None, :]
    cost = xp.sum(misfit**2, axis=1) / (noise / EARTH_RATE) ** 2
    far = False if hint is None else distance(grid, hint) > np.pi / 2
    best = xp.argmin(xp.where(far, xp.inf, cost))
    valley = (cost <= xp.roll(cost, 1)) & (cost <= xp.roll(cost, -1)) & (distance(grid, grid[best]) > 3 * 2 * np.pi / _GRID)
    second = xp.argmin(xp.where(valley, cost, xp.inf))
    # a minimum between two points of the grid lies lower than both by up to a quarter step's worth of curvature
    fine = (xp.roll(cost, 1) + xp.roll(cost, -1) - 2 * cost) / 8
    tie = xp.any(valley) & (cost[second] - fine[second] - cost[best] < 9) & (hint is None)
    return wrap(grid[best]), wrap(grid[second]), tie
