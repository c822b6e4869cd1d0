"""Checks of the options of a joint fit, and its initial guess near the global minimum, from linear fits and a search over azimuths."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import array_module, is_traced
from .._types import AnyArray
from ._model import Table
from ._positions import EARTH_RATE, Positions, distance, least_squares, table_from_nav, wrap

_ALWAYS = ("phi", "theta", "psi", "b_a", "b_g")
_OTHER_AXES = ("b_a_y", "b_a_z", "b_g_y", "b_g_z")
_ANGLES = ("phi", "theta", "psi", "latitude")
#: sensor -> parameters that cannot be free without this sensor
NEEDED = {
    "accelerometer": ("b_a", "s_a", "ma_a_xy", "ma_a_xz", "b_a_rate", "b_a_y", "b_a_z", "ma_a_zx", "ma_a_zy"),
    "gyro": ("psi", "b_g", "s_g", "b_g_y", "b_g_z", "ma_g_zx", "ma_g_zy", "b_g_rate"),
}  # fmt: skip
_GRID = 360


def free_of(free: Any, priors: Any, positions: Positions, latitude: Any, sensors: tuple[bool, bool], known: tuple[str, ...]) -> set[str]:
    """Names of the free parameters; the default is angles and biases, and the scale errors if there is a z reading."""
    priors = priors or {}
    if free is None:
        names = {*_ALWAYS, *(("s_a", "s_g") if {"z", "-z"} & set(positions.mounting) else ()), *(n for n in _OTHER_AXES if n in known)}
        names -= {name for there, needed in zip(sensors, NEEDED.values(), strict=True) if not there for name in needed}
    else:
        names = {free} if isinstance(free, str) else set(free)
        for (sensor, needed), there in zip(NEEDED.items(), sensors, strict=True):
            lacking = [name for name in needed if name in names | set(priors)]
            if not there and lacking:
                raise DataError(f"There are no {sensor} readings, and {', '.join(lacking)} cannot be free without.", code="no_sensor")
    names |= set(priors) | ({"latitude"} if latitude is None else set())
    check_names(sorted(names), "free parameter", known)
    if not names:
        raise DataError("No parameter is free; name some in `free`.", code="free")
    return names


def check_names(names: Any, what: str, known: tuple[str, ...]) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        raise DataError(f"There is no {what} {unknown[0]!r}; known are {', '.join(known)}.", code="unknown_name")


def priors_of(priors: Any, known: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Means and reciprocal standard deviations by name; a prior is a standard deviation about zero, or (mean, deviation)."""
    mean: dict[str, Any] = {}
    certainty: dict[str, Any] = {}
    check_names(priors or {}, "parameter for a prior", known)
    for name, given in (priors or {}).items():
        pair = isinstance(given, (tuple, list)) or getattr(given, "ndim", 0)
        both: Any = given if pair else (0.0, given)
        centre, size = both
        if name in _ANGLES and not pair:
            raise DataError(f"The prior of {name} is {given!r}; that of an angle needs (mean, standard deviation) in rad.", code="prior")
        if not is_traced(size) and not float(size) > 0:
            raise DataError(f"The prior of {name} has the standard deviation {float(size):g}; it is positive, in SI units.", code="prior")
        mean[name], certainty[name] = centre, 1 / size
    return mean, certainty


def initial_guess(
    table: Table, dwell: AnyArray, given: dict[str, Any], known: set[str], free: set[str], hint: Any, noise: Any, hemisphere: Any
) -> tuple[dict[str, Any], Any]:
    """Initial values, and whether a second minimum fits equally well.

    `given` has a value for every parameter; `known` are the names that the caller set. `noise` is the gyro's white noise, which decides
    whether two minima of the search are equally good. `hemisphere` is 1 (north), -1 (south) or 0 (unknown).
    """
    xp = array_module(table, given, hint, noise)
    axes, root = table.places.axes[:, 0], xp.sqrt(dwell)
    # one column for each bias
    one_hot = [table.places.channel == i for i in range(3)] if _OTHER_AXES[0] in given else [xp.ones_like(table.places.channel)]
    offsets = xp.stack([xp.asarray(column, dtype=axes.dtype) for column in one_hot], -1)
    weight_accel, weight_gyro = (xp.where(measured, root, 0) for measured in table.measured)
    accel = (table.readings[0] - given["b_a"]) / table.places.gravity
    gyro = (table.readings[1] - given["b_g"]) / EARTH_RATE
    down, seen = _vector(-axes, accel, weight_accel, offsets * float("b_a" in free))
    rate, turns = _vector(axes, gyro, weight_gyro, offsets * float("b_g" in free))

    chosen = lambda name, value: given[name] if name in known or name not in free else value  # noqa: E731
    upside_down = xp.cos(given["phi"]) < 0 if "phi" in known else False
    flat = xp.sqrt(xp.maximum(1 - down[0] ** 2 - down[1] ** 2, 0))
    third = xp.where(seen[2], down[2], xp.where(upside_down, -flat, flat))
    phi = chosen("phi", xp.arctan2(down[1], third))
    theta = chosen("theta", xp.arctan2(-down[0], xp.hypot(down[1], third)))
    column = weight_gyro[:, None] * offsets * float("b_g" in free)
    if "latitude" in free and "latitude" not in known:
        side = xp.sqrt(xp.maximum(1 - rate[0] ** 2 - rate[1] ** 2, 0))
        pairs = [_levelled(xp, rate[:2], xp.where(turns[2], rate[2], z), phi, theta) for z in (side, -side)]
        cost = [_preference(xp, *pair, hint, hemisphere) for pair in pairs]
        two = ~turns[2] & (side > 1e-6)
        swap = two & (cost[1] < cost[0])
        psi, latitude = (xp.where(swap, second, first) for first, second in zip(*pairs, strict=True))
        twofold = two & (cost[0] == cost[1])
    else:
        latitude = given["latitude"]
        psi, tie = _search(xp, phi, theta, latitude, axes, gyro, weight_gyro, column, hint, noise)
        twofold = tie if "psi" in free and "psi" not in known else xp.zeros_like(tie)
    return given | {"phi": phi, "theta": theta, "psi": chosen("psi", psi), "latitude": latitude}, twofold


def _vector(axes: AnyArray, reading: AnyArray, weight: AnyArray, offsets: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Least-squares vector v in reading = axes.v + b, and which of its components the readings determine."""
    xp = array_module(axes, reading, weight)
    rows = xp.concatenate([axes, offsets], axis=1)
    solution, _, known = least_squares(rows, reading, weight, 1e-6)
    return solution[:3], known[:3]


def _levelled(xp: Any, plane: AnyArray, third: Any, phi: Any, theta: Any) -> tuple[Any, Any]:
    """Azimuth and latitude from the Earth's rate in table axes."""
    h = table_from_nav(phi, theta, xp.zeros_like(third)).T @ xp.stack([*plane, third])
    return xp.arctan2(-h[1], h[0]), xp.arctan2(-h[2], xp.hypot(h[0], h[1]))


def _preference(xp: Any, psi: Any, latitude: Any, hint: Any, hemisphere: Any) -> Any:
    """Penalty of a candidate for disagreement with the azimuth hint and the hemisphere; 0 without either."""
    return (0.0 if hint is None else distance(psi, hint)) + xp.where(hemisphere * latitude < 0, 10.0, 0.0)


def _search(xp, phi, theta, latitude, axes, gyro, weight, column, hint, noise) -> tuple[Any, Any]:
    """Azimuth with the lowest misfit of the gyro on a grid, and whether the next minimum fits equally well."""
    grid = xp.arange(_GRID, dtype=gyro.dtype) * (2 * np.pi / _GRID)
    east, north = (table_from_nav(phi, theta, angle)[:, 0] for angle in (np.pi / 2, 0.0))
    vertical = table_from_nav(phi, theta, 0.0)[:, 2] * xp.sin(latitude)
    waves = xp.stack([xp.cos(grid), xp.sin(grid)], axis=1) @ xp.stack([north, east]) * xp.cos(latitude) - vertical[None, :]
    misfit = weight[None, :] * (gyro[None, :] - waves @ axes.T)
    square = xp.sum(column**2, axis=0)
    misfit = misfit - (misfit @ column / xp.where(square > 0, square, 1)[None, :]) @ column.T
    cost = xp.sum(misfit**2, axis=1) / (noise / EARTH_RATE) ** 2
    far = False if hint is None else distance(grid, hint) > np.pi / 2
    best = xp.argmin(xp.where(far, xp.inf, cost))
    valley = (cost <= xp.roll(cost, 1)) & (cost <= xp.roll(cost, -1)) & (distance(grid, grid[best]) > 3 * 2 * np.pi / _GRID)
    second = xp.argmin(xp.where(valley, cost, xp.inf))
    # the true minimum between two grid points can be lower than both; subtract the largest possible difference
    fine = (xp.roll(cost, 1) + xp.roll(cost, -1) - 2 * cost) / 8
    tie = xp.any(valley) & (cost[second] - fine[second] - cost[best] < 9) & (hint is None)
    return wrap(grid[best]), tie
