"""Earth's field at a place and in body axes (x forward, y right, z down; azimuth, elevation, bank), the heading, and seen directions.

Coverage is by MotionCal's regions (with its southern index corrected) and by the largest gap.
"""

import datetime
import functools
import warnings
from types import ModuleType
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced, real_numbers
from .._types import AnyArray, Checked, Samples
from ._quadric import unit

#: dip of the field at Ankara, where the magnetometer paper's experiment was made
INCLINATION = np.deg2rad(57.0)
HEADINGS = np.arange(24) * np.pi / 12  # every 15 degrees
ZONES = (1, 15, 34, 34, 15, 1)  # sectors of the zones of latitude, from the north pole on: 100 regions of equal area
_GRID = 500  # points of the lattice, 9 degrees apart


class Coverage(eqx.Module):
    """How well readings fill the sphere of directions.

    Attributes
    ----------
    counts : (100,) readings per region of equal area: pole, 15 sectors, 34, 34, 15, pole.
    occupied : share of 500 equal bins that contain a reading.
    largest_gap : half-angle of the largest cap without a reading, rad.
    missing : (k, 3) unit vectors to the centres of the regions without a reading.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, coverage, scenario
    >>> found = coverage(body_field(scenario("three_turns")))
    >>> f"{100 * found.occupied:.0f} % of the directions", len(found.missing) > 50
    ('13 % of the directions', True)
    """

    counts: AnyArray
    occupied: float
    largest_gap: float
    missing: AnyArray


@functools.cache
def sphere_grid() -> np.ndarray:
    """Points of a Fibonacci lattice, (500, 3); each represents nearly the same area."""
    k = np.arange(_GRID) + 0.5
    z, angle = 1 - 2 * k / _GRID, np.pi * (1 + np.sqrt(5)) * k
    grid = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    grid.flags.writeable = False
    return grid


def _edges() -> np.ndarray:
    """Heights of the upper edges of the zones, on a sphere of radius one."""
    return 1 - 2 * np.cumsum([0, *ZONES[:-1]]) / sum(ZONES)


def regions(directions: np.ndarray) -> np.ndarray:
    """Region of each direction, 0 to 99."""
    x, y, z = directions.T
    zone = np.searchsorted(-_edges(), -z, side="right") - 1
    sectors = np.array(ZONES)[zone]
    sector = np.minimum(sectors - 1, ((np.arctan2(y, x) + np.pi) * sectors / (2 * np.pi)).astype(int))
    return np.cumsum([0, *ZONES[:-1]])[zone] + sector


@functools.cache
def middles() -> np.ndarray:
    """Unit vectors to the centres of the regions, (100, 3)."""
    latitude = np.arcsin(np.append(_edges(), -1.0))
    middle = np.repeat((latitude[1:] + latitude[:-1]) / 2, ZONES)
    middle[[0, -1]] = latitude[[0, -1]]
    longitude = np.concatenate([(np.arange(n) + 0.5) * 2 * np.pi / n for n in ZONES]) - np.pi
    found = np.stack([np.cos(longitude) * np.cos(middle), np.sin(longitude) * np.cos(middle), np.sin(middle)], axis=1)
    found.flags.writeable = False
    return found


@host_float64
def coverage(m: Samples) -> Coverage:
    """How evenly corrected readings fill the sphere.

    Parameters
    ----------
    m : (n, 3) corrected readings in any unit; the hard iron must be subtracted already.

    Returns
    -------
    Coverage

    Raises
    ------
    DataError
        If a reading is zero or not finite, or there are no readings.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> full = jaxcal.magnetometer.coverage(body_field(scenario("all", samples=2000)))
    >>> turns = jaxcal.magnetometer.coverage(body_field(scenario("three_turns")))
    >>> len(full.missing) < 1, len(turns.missing) > 50
    (True, True)

    References
    ----------
    P. Stoffregen, MotionCal (quality.c), with corrected positions of the southern sectors.
    """
    m = real_numbers(m, "m")
    if m.ndim != 2 or m.shape[-1] != 3 or not len(m):
        raise DataError(f"The corrected readings have shape {m.shape}; they must be (n, 3) with at least one row.")
    norm = np.linalg.norm(m, axis=1)
    if not (np.isfinite(norm) & (norm > 0)).all():
        raise DataError("A corrected reading is zero or not finite; leave it out.")
    directions = m / norm[:, None]
    counts = np.bincount(regions(directions), minlength=sum(ZONES))
    largest = float(np.max(scipy.spatial.KDTree(directions).query(sphere_grid())[0]))
    occupied = len(np.unique(scipy.spatial.KDTree(sphere_grid()).query(directions)[1])) / _GRID
    return Coverage(counts, occupied, 2 * float(np.arcsin(min(largest / 2, 1.0))), middles()[counts == 0])


def unit_field(attitudes: Any, inclination: Any, xp: ModuleType = np) -> Any:
    """`body_field` of magnitude one. Plain numbers give NumPy arrays, even while something else is traced."""
    azimuth, elevation, bank = xp.moveaxis(attitudes, -1, 0)
    ct, st, cp, sp = xp.cos(elevation), xp.sin(elevation), xp.cos(bank), xp.sin(bank)
    north, east, down = xp.cos(inclination) * xp.cos(azimuth), -xp.cos(inclination) * xp.sin(azimuth), xp.sin(inclination)
    forward, below = north * ct - down * st, north * st + down * ct
    return xp.stack([forward, east * cp + below * sp, below * cp - east * sp], axis=-1)


def axes_at(headings: Any, tilt: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit vectors to the north, to the east and down, (n, 3) each, in the axes of a sensor at these headings.

    Level, or, if it is tilted, in each of eight directions of the tilt, (8 n, 3).
    """
    way = np.repeat(np.arange(8 if tilt else 1) * np.pi / 4, len(headings))
    elevation, bank = np.arcsin(np.sin(tilt) * np.cos(way)), np.arctan2(np.sin(tilt) * np.sin(way), np.cos(tilt))
    attitudes = np.stack([np.resize(headings, len(way)), elevation, bank], axis=1)
    north, below = (unit_field(attitudes, dip) for dip in (0.0, np.pi / 2))
    return north, np.cross(below, north), below


def level_axes(up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors forward and to the right in the horizontal plane, (n, 3) each, in the body axes of upward vectors."""
    forward = unit(np.array([1.0, 0.0, 0.0]) - up[:, :1] * up)
    return forward, np.cross(forward, up)


@host_float64
def body_field(attitudes: Samples, field: float = 1.0, inclination: float = INCLINATION) -> AnyArray:
    r"""Earth's field in body axes, without declination.

    .. math:: h = H\,R_x(\phi)R_y(\theta)R_z(\psi)\,[\cos I, 0, \sin I]^T

    Parameters
    ----------
    attitudes : (n, 3) azimuth, elevation and bank in rad.
    field : magnitude H of the field.
    inclination : dip I in rad, positive downwards.

    Returns
    -------
    (n, 3) in the unit of `field`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field
    >>> print(body_field(np.deg2rad([[90.0, 0.0, 0.0]]), 50.0, np.deg2rad(60.0)).round(2) + 0.0)
    [[  0.  -25.   43.3]]

    References
    ----------
    The magnetometer paper, section IV.
    """
    return field * unit_field(np.asarray(attitudes), inclination)


_SAMPLES = {"all": 360, "three_turns": 120, "twelve_points": 4}


@host_float64
def scenario(name: str, *, samples: int | None = None, elevation: float = np.deg2rad(30.0), seed: int = 0) -> AnyArray:
    """Attitudes of the three ways to collect readings in the magnetometer paper.

    Parameters
    ----------
    name : "all", random attitudes, uniform; "three_turns", full turns at three elevations; "twelve_points", four headings at each.
    samples : attitudes for "all" (360), or headings per turn for the others (120 and 4).
    elevation : the three elevations are minus this, 0 and this, in rad.
    seed : seed of the random attitudes of "all".

    Returns
    -------
    (n, 3) azimuth, elevation and bank in rad.

    Raises
    ------
    DataError
        For an unknown name, or fewer than one sample.

    Examples
    --------
    >>> from jaxcal.magnetometer import scenario
    >>> scenario("all").shape, scenario("three_turns").shape, scenario("twelve_points").shape
    ((360, 3), (360, 3), (12, 3))

    References
    ----------
    The magnetometer paper, section IV.
    """
    count = _SAMPLES.get(name, 0) if samples is None else int(samples)
    if name not in _SAMPLES or count < 1:
        raise DataError(f"There is no scenario {name!r} of {count} samples; known are {', '.join(map(repr, _SAMPLES))}, of one or more.")
    if name == "all":
        rng = np.random.default_rng(seed)
        azimuth, bank = rng.uniform(0, 2 * np.pi, count), rng.uniform(-np.pi, np.pi, count)
        return np.stack([azimuth, np.arcsin(rng.uniform(-1, 1, count)), bank], axis=1)
    azimuth = np.tile(np.arange(count) * 2 * np.pi / count, 3)
    tilt = np.repeat([-elevation, 0.0, elevation], count)
    return np.stack([azimuth, tilt, np.zeros(3 * count)], axis=1)


STEEPEST = 0.17  # horizontal share of the field below which there is no heading: within 10 degrees of a magnetic pole
_LIGHTEST = 1.0  # m/s^2 of specific force below which there is no vertical


@host_float64
def heading(m: Samples, accel: Samples, *, declination: float = 0.0) -> AnyArray:
    r"""Heading from the corrected field and the specific force at rest, both in body axes (x forward, y right, z down).

    .. math:: \phi = \mathrm{atan2}(-f_y, -f_z),\quad \theta = \mathrm{atan2}(f_x, \sqrt{f_y^2 + f_z^2}),\quad
              \psi = \mathrm{atan2}(-Y_h, X_h) + \delta

    where X_h and Y_h are the field rotated back by bank and elevation.

    Parameters
    ----------
    m : (3,) or (n, 3) corrected field, any unit.
    accel : specific force, same shape, m/s^2; at rest it points up, (0, 0, -9.81) when level.
    declination : added to the magnetic heading, rad.

    Returns
    -------
    Heading in rad in [0, 2 pi), clockwise from north. NaN within 10 degrees of a magnetic pole and in free fall; a warning then says
    how many headings are NaN and why.

    Raises
    ------
    DataError
        If the shapes differ or do not end in three.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import heading
    >>> print(np.rad2deg(heading(np.array([0.0, -20.0, 40.0]), np.array([0.0, 0.0, -9.81]))).round(6))
    90.0

    References
    ----------
    NXP AN4248, equations 13 to 22, for these axes.
    """
    if not is_traced(m, accel):
        m, accel = real_numbers(m, "m"), real_numbers(accel, "accel")
    m, accel = jnp.asarray(m, dtype=jnp.result_type(float)), jnp.asarray(accel, dtype=jnp.result_type(float))
    if m.shape != accel.shape or m.ndim not in (1, 2) or m.shape[-1] != 3:
        raise DataError(f"The field has shape {m.shape} and the specific force {accel.shape}; both must be (3,) or (n, 3).")
    angle = _heading(m, accel, jnp.asarray(declination, dtype=m.dtype))
    if not is_traced(m, accel) and (lost := int(np.isnan(angle).sum())):
        said = f"{lost} of {angle.size} headings are NaN: in free fall, or within 10 degrees of a magnetic pole, there is none."
        warnings.warn(said, UserWarning, stacklevel=3)
    return angle


@filter_jit
def _heading(m: Any, accel: Any, declination: Any) -> Any:
    """Heading; NaN where the sensor falls, or the field is too steep."""
    size = jnp.linalg.norm(accel, axis=-1, keepdims=True)
    falling = ~(size >= _LIGHTEST)
    # Replace the inputs as well as the results: atan2 has no derivative at the origin, and a direction none without a length.
    x, _, z = (jnp.broadcast_to(axis, m.shape) for axis in jnp.eye(3, dtype=m.dtype))
    up = jnp.where(falling, -z, accel) / jnp.where(falling, 1.0, size)
    level = x - up[..., :1] * up
    # where x points up or down, the sensor has no bank
    forward = jnp.where(jnp.any(level != 0, axis=-1, keepdims=True), level, up[..., :1] * z)
    forward = forward / jnp.linalg.norm(forward, axis=-1, keepdims=True)
    north, east = (jnp.sum(m * way, axis=-1) for way in (forward, jnp.cross(forward, up)))
    lost = falling[..., 0] | ~(jnp.sqrt(north**2 + east**2) > STEEPEST * jnp.linalg.norm(m, axis=-1))
    angle = jnp.arctan2(-jnp.where(lost, 0, east), jnp.where(lost, 1, north))
    return jnp.where(lost, jnp.nan, jnp.mod(angle + declination, 2 * jnp.pi))


def earth_field(
    latitude: float | int, longitude: float | int, date: Checked[str | float | datetime.date], *, altitude: float | int = 0.0
) -> AnyArray:
    """Earth's field (north, east, down) in tesla, for use as `fit(field=...)`, which takes its magnitude and dip.

    Parameters
    ----------
    latitude, longitude : geodetic, degrees; north and east positive.
    date : `datetime.date`, or a decimal year.
    altitude : above the ellipsoid, m.

    Returns
    -------
    (3,) T. The declination is ``atan2(east, north)``.

    Raises
    ------
    DataError
        If there is no such place on Earth, the model does not hold at the date, or pygeomag is not installed.

    Examples
    --------
    >>> from jaxcal.magnetometer import earth_field
    >>> earth_field(39.93, 32.86, 2026.5).shape  # doctest: +SKIP
    (3,)

    References
    ----------
    NOAA and BGS, The US/UK World Magnetic Model for 2025-2030; coefficients and code of pygeomag.
    """
    if not abs(latitude) <= 90 or not abs(longitude) <= 360:
        raise DataError(f"The place is {latitude:g}, {longitude:g}; expected degrees of latitude (-90 to 90) and longitude.")
    try:
        import pygeomag
    except ImportError as error:
        raise DataError('The field of a place needs the package pygeomag: pip install "jaxcal[geomag]"') from error
    year = _decimal_year(date)
    base = 5 * int(year // 5)
    names = {2010: "2010", 2015: "2015v2", 2020: "2020", 2025: "2025"}
    if base not in names:
        raise DataError(f"The date is {date}; the World Magnetic Models known here hold from 2010 to 2030.")
    model = pygeomag.GeoMag(coefficients_file=f"wmm/WMM_{names[base]}.COF")
    found = model.calculate(glat=latitude, glon=longitude, alt=altitude / 1000, time=year)
    return 1e-9 * np.array([found.x, found.y, found.z])


def _decimal_year(date: Any) -> float:
    if isinstance(date, datetime.date):
        return date.year + (date.timetuple().tm_yday - 1) / 365.25
    try:
        return float(date)
    except (TypeError, ValueError) as error:
        raise DataError(f"The date is {date!r}; expected a datetime.date, or a year with decimals.") from error
