"""Free parameters, priors and starts of the joint fit, checked."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import is_traced
from ._positions import Positions

_ALWAYS = ("phi", "theta", "psi", "b_a", "b_g")
_ANGLES = ("phi", "theta", "psi", "latitude")
_FEW_ANGLES = 3
#: sensor -> what cannot be free without it
_NEEDED = {"accelerometer": ("b_a", "s_a", "ma_a_xy", "ma_a_xz", "b_a_rate"), "gyro": ("psi", "b_g", "s_g")}


def free_of(free: Any, priors: Any, positions: Positions, latitude: Any, sensors: tuple[bool, bool], known: tuple[str, ...]) -> set[str]:
    """Names of the parameters that are estimated; by default angles, biases, and the scale errors where there is a z reading."""
    priors = priors or {}
    if free is None:
        names = {*_ALWAYS, *(("s_a", "s_g") if {"z", "-z"} & set(positions.mounting) else ())}
        for there, needed in zip(sensors, _NEEDED.values(), strict=True):
            names -= set() if there else set(needed)
    else:
        names = {free} if isinstance(free, str) else set(free)
        for (sensor, needed), there in zip(_NEEDED.items(), sensors, strict=True):
            lacking = [name for name in needed if name in names | set(priors)]
            if not there and lacking:
                raise DataError(f"There are no {sensor} readings, and {', '.join(lacking)} cannot be free without.")
    names |= set(priors) | ({"latitude"} if latitude is None else set())
    _check(sorted(names), "free parameter", known)
    if not names:
        raise DataError("No parameter is free; name some in `free`.")
    return names


def _check(names: Any, what: str, known: tuple[str, ...]) -> None:
    unknown = [name for name in names if name not in known]
    if unknown:
        raise DataError(f"There is no {what} {unknown[0]!r}; known are {', '.join(known)}.")


def priors_of(priors: Any, known: tuple[str, ...]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Means and one over the standard deviations by name; a prior is a standard deviation about zero, or (mean, deviation)."""
    mean: dict[str, Any] = {}
    certainty: dict[str, Any] = {}
    _check(priors or {}, "parameter for a prior", known)
    for name, given in (priors or {}).items():
        pair = isinstance(given, (tuple, list)) or getattr(given, "ndim", 0)
        both: Any = given if pair else (0.0, given)
        centre, size = both
        if name in _ANGLES and not pair:
            raise DataError(f"The prior of {name} is {given!r}; an angle's prior needs its mean: (mean, standard deviation) in rad.")
        if not is_traced(size) and not float(size) > 0:
            raise DataError(f"The prior of {name} has the standard deviation {float(size):g}; it is positive, in SI units.")
        mean[name], certainty[name] = centre, 1 / size
    return mean, certainty


def start_of(start: Any, known: tuple[str, ...]) -> dict[str, Any]:
    """Values that the caller sets."""
    _check(start or {}, "parameter for a start", known)
    return dict(start or {})


def check_latitude_free(free: set[str], priors: dict[str, Any], positions: Positions) -> None:
    """Refuse a free latitude that the readings cannot give (section 2 of the method)."""
    if "latitude" not in free or "latitude" in priors:
        return
    in_plane = np.isin(np.array(positions.mounting), ["x", "y"])
    if not is_traced(positions.angle):
        distinct = len(np.unique(np.round(np.exp(1j * np.asarray(positions.angle)[in_plane]), 6)))
        if distinct < _FEW_ANGLES:
            raise DataError(
                f"The latitude cannot be found from {distinct} distinct table angles; measure at three or more, such as 0, 90 and 180 "
                "degrees, or give the latitude."
            )
    if "s_g" in free and "s_g" not in priors and in_plane.all():
        raise DataError(
            "The latitude and the gyro's scale error cannot both be found on the table alone; add a reading with mounting 'z', hold s_g, "
            "give it a prior, or give the latitude."
        )
