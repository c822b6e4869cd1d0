"""Earth's field at a place and in body axes (x forward, y right, z down; azimuth, elevation, bank), and the heading that it gives."""

import datetime
import warnings
from typing import Any

import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced, real_numbers
from .._types import AnyArray, Checked, Samples
from ._directions import INCLINATION, unit_field


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
    if name not in _SAMPLES:
        raise DataError(f"There is no scenario {name!r}; known are {', '.join(map(repr, _SAMPLES))}.")
    count = _SAMPLES[name] if samples is None else int(samples)
    if count < 1:
        raise DataError(f"A scenario of {count} samples was asked for; it needs at least one.")
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
        why = "in free fall, or within 10 degrees of a magnetic pole"
        warnings.warn(f"{lost} of {angle.size} headings are NaN: {why}, there is none.", UserWarning, stacklevel=3)
    return angle


@filter_jit
def _heading(m: Any, accel: Any, declination: Any) -> Any:
    """Heading; NaN where the sensor falls, or the field is too steep."""
    x, y, z = jnp.moveaxis(m, -1, 0)
    fx, fy, fz = jnp.moveaxis(accel, -1, 0)
    force, field = jnp.linalg.norm(accel, axis=-1), jnp.linalg.norm(m, axis=-1)
    falling = ~(force >= _LIGHTEST)
    # Replace the inputs as well as the results: atan2 has no derivative at the origin.
    fz = jnp.where(falling, -1, fz)
    fx, fy = (jnp.where(falling, 0, f) for f in (fx, fy))
    cross = jnp.sqrt(fy**2 + fz**2)
    length = jnp.sqrt(fx**2 + cross**2)
    upright = cross > 0
    cross = jnp.where(upright, cross, 1)
    sp, cp = jnp.where(upright, -fy / cross, 0), jnp.where(upright, -fz / cross, 1)
    st, ct = fx / length, jnp.where(upright, cross, 0) / length
    forward, right = x * ct + y * sp * st + z * cp * st, y * cp - z * sp
    steep = ~(jnp.sqrt(forward**2 + right**2) > STEEPEST * field)
    angle = jnp.arctan2(-jnp.where(steep, 0, right), jnp.where(steep, 1, forward))
    angle = jnp.mod(angle + declination, 2 * jnp.pi)
    return jnp.where(falling | steep, jnp.nan, angle)


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
