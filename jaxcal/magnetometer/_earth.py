"""`earth_field`: the field at a place and date, by the World Magnetic Model."""

import datetime
from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray


def earth_field(latitude: float | int, longitude: float | int, date: Any, *, altitude: float | int = 0.0) -> AnyArray:
    """Earth's field (north, east, down) in tesla; its norm and dip are what `fit(field=...)` takes from it.

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
        If the place is none on Earth, the model does not hold at the date, or pygeomag is not installed.

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
        start, end = datetime.date(date.year, 1, 1), datetime.date(date.year + 1, 1, 1)
        day = date.date() if isinstance(date, datetime.datetime) else date
        return date.year + (day - start) / (end - start)
    try:
        return float(date)
    except (TypeError, ValueError) as error:
        raise DataError(f"The date is {date!r}; expected a datetime.date, or a year with decimals.") from error
