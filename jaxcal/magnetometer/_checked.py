"""Checks of the readings and options of a fit."""

from typing import Any

import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import real_numbers
from ._ellipsoid._kinds import COUNT
from ._field import INCLINATION

METHODS = ("ml", "consistent", "constrained")
MODELS = ("auto", *COUNT, "planar")


def checked(m, method, model, field, inclination, field_error) -> tuple[np.ndarray, float | None, float]:
    """Readings, magnitude of the field and dip, after a check that each option is known and suits the method."""
    m = readings_of(m)
    for given, known, what in ((method, METHODS, "method"), (model, MODELS, "model")):
        if given not in known:
            raise DataError(f"There is no {what} {given!r}; known are {', '.join(map(repr, known))}.", code="no_such_option")
    if method != "ml" and model not in ("auto", "symmetric"):
        raise DataError(f"Method {method!r} fits the model 'symmetric' only; method 'ml' has {model!r}.", code="no_such_model")
    norm, dip = norm_and_dip(field, inclination)
    if field_error is not None:
        if norm is None or method != "ml":
            raise DataError("A field error needs the `field` that it is of, and the method 'ml'.", code="field_error_alone")
        if not (isinstance(field_error, (int, float)) and 0 < field_error < 1):
            raise DataError(f"The field error is {field_error!r}; give the relative standard deviation of `field`, such as 0.02.",
                            code="bad_field_error")  # fmt: skip
    if not abs(dip) < np.pi / 2:
        raise DataError(f"The inclination is {dip:g} rad; it must lie between -pi/2 and pi/2, where there is a horizontal field.",
                        code="bad_inclination")  # fmt: skip
    return m, norm, float(dip)


def readings_of(m: Any) -> np.ndarray:
    """Readings (n, 3) as finite numbers."""
    m = real_numbers(m, "the readings")
    if m.ndim != 2 or m.shape[1] != 3 or not len(m):
        raise DataError(f"The readings have shape {m.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    bad = np.flatnonzero(~np.isfinite(m).all(axis=1))
    if bad.size:
        raise DataError(f"{bad.size} readings are not finite, the first in row {bad[0]}; leave them out.", code="not_finite")
    return m


def norm_and_dip(field: Any, inclination: Any) -> tuple[Any, Any]:
    """Magnitude of the field, traced or not, and its dip: as given, from the field vector, or else the dip at Ankara."""
    norm = dip = None
    if isinstance(field, jax.core.Tracer):
        norm = jnp.linalg.norm(jnp.atleast_1d(field))
    elif field is not None:
        vector = np.asarray(field, dtype=float)
        norm = float(np.linalg.norm(vector))
        if vector.shape not in ((), (3,)) or not 0 < norm < np.inf or (vector.ndim == 0 and vector < 0):
            raise DataError(f"The field is {field!r}; give its norm, or the vector (north, east, down), in the unit of the readings.",
                            code="bad_field")  # fmt: skip
        dip = float(np.arctan2(vector[2], np.hypot(vector[0], vector[1]))) if vector.ndim else None
    return norm, next(angle for angle in (inclination, dip, INCLINATION) if angle is not None)


def checked_conditions(conditions: dict[str, Any], count: int) -> dict[str, np.ndarray]:
    """Recorded conditions as arrays of one number per reading."""
    found = {}
    for name, given in conditions.items():
        values = np.asarray(given, dtype=float)
        if values.shape != (count,):
            raise DataError(f"The condition {name!r} has shape {values.shape}; give one number for each of {count} readings.",
                            code="condition_shape")  # fmt: skip
        if not np.isfinite(values).all():
            raise DataError(f"The condition {name!r} has values that are not finite.", code="condition_not_finite")
        found[name] = values
    return found
