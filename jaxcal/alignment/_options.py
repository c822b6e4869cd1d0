"""Free parameters, priors and starts of the joint fit, checked."""

from typing import Any

import numpy as np

from .._errors import DataError
from .._precision import is_traced
from ._model import COUNT, INDEX, NAMES
from ._positions import Positions

_ALWAYS = ("phi", "theta", "psi", "b_a", "b_g")
_FEW_ANGLES = 3


def free_of(free: Any, priors: Any, positions: Positions, latitude: Any, sensors: tuple[bool, bool]) -> np.ndarray:
    """(14,) which parameters are estimated; by default angles, biases, and the scale errors where there is a z reading."""
    if free is None:
        names = [name for name in _ALWAYS if name not in (("b_a",) * (not sensors[0]) + ("b_g", "psi") * (not sensors[1]))]
        if {"z", "-z"} & set(positions.mounting):
            names += [name for name, there in (("s_a", sensors[0]), ("s_g", sensors[1])) if there]
    else:
        names = [free] if isinstance(free, str) else list(free)
    names += [name for name in (priors or {}) if name not in names]
    if latitude is None and "latitude" not in names:
        names.append("latitude")
    _known(names, "free parameter")
    if latitude is not None and "latitude" in names and (free is None or "latitude" not in list(free)) and "latitude" not in (priors or {}):
        names.remove("latitude")
    chosen = np.zeros(COUNT, dtype=bool)
    chosen[[INDEX[name] for name in names]] = True
    return chosen


def _known(names: Any, what: str) -> None:
    unknown = [name for name in names if name not in INDEX]
    if unknown:
        raise DataError(f"There is no {what} {unknown[0]!r}; known are {', '.join(NAMES)}.")


def priors_of(priors: Any) -> tuple[list[Any], list[Any]]:
    """Means and one over the standard deviations, (14,) each; a prior is a standard deviation about zero, or (mean, deviation)."""
    mean: list[Any] = [0.0] * COUNT
    certainty: list[Any] = [0.0] * COUNT
    _known(priors or {}, "parameter for a prior")
    for name, given in (priors or {}).items():
        centre, size = given if isinstance(given, (tuple, list)) or getattr(given, "ndim", 0) else (0.0, given)
        if name in ("phi", "theta", "psi", "latitude") and not (isinstance(given, (tuple, list)) or getattr(given, "ndim", 0)):
            raise DataError(f"The prior of {name} is {given!r}; an angle's prior needs its mean: (mean, standard deviation) in rad.")
        if not is_traced(size) and not float(size) > 0:
            raise DataError(f"The prior of {name} has the standard deviation {float(size):g}; it is positive, in SI units.")
        mean[INDEX[name]], certainty[INDEX[name]] = centre, 1 / size
    return mean, certainty


def given_of(start: Any) -> tuple[list[Any], np.ndarray]:
    """Values that the caller sets, and which."""
    values: list[Any] = [0.0] * COUNT
    known = np.zeros(COUNT, dtype=bool)
    _known(start or {}, "parameter for a start")
    for name, value in (start or {}).items():
        values[INDEX[name]], known[INDEX[name]] = value, True
    return values, known


def check_latitude_free(free: np.ndarray, certainty: list[Any], positions: Positions) -> None:
    """Refuse a free latitude that the readings cannot give (section 2 of the method)."""
    i = INDEX["latitude"]
    if not free[i] or (is_traced(certainty[i]) or certainty[i] > 0):
        return
    words = np.array(positions.mounting)
    in_plane = np.isin(words, ["x", "y"])
    angles = np.asarray(positions.angle)
    distinct = 0 if is_traced(angles) else len(np.unique(np.round(np.exp(1j * angles[in_plane]), 6)))
    if not is_traced(angles) and distinct < _FEW_ANGLES:
        raise DataError(
            f"The latitude cannot be found from {distinct} distinct table angles; measure at three or more, such as 0, 90 and 180 degrees, "
            "or give the latitude."
        )
    scale_open = free[INDEX["s_g"]] and not (is_traced(certainty[INDEX["s_g"]]) or certainty[INDEX["s_g"]] > 0)
    if scale_open and in_plane.all():
        raise DataError(
            "The latitude and the gyro's scale error cannot both be found on the table alone; add a reading with mounting 'z', hold s_g, "
            "give it a prior, or give the latitude."
        )


__all__ = ["check_latitude_free", "free_of", "given_of", "priors_of"]
