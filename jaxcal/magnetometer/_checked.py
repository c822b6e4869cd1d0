"""A fit as asked for: everything is checked here, once."""

import os
from typing import Any, NamedTuple

import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._log import Log, as_log
from .._message import Message
from .._precision import is_traced, real_numbers
from ._aids import Accelerometer, Gyroscope
from ._field import INCLINATION
from ._model import MagModel
from ._own_model import further_names
from ._quadric import COUNT

METHODS = ("ml", "consistent", "constrained")
MODELS = ("auto", *COUNT, "planar")


class Asked(NamedTuple):
    """Readings and options of a fit, checked.

    Attributes
    ----------
    m : (n, 3) readings; NaN in some rows beside rates, which are integrated over all of them. there : numbers of the rows with a reading.
    method, model, aid, limits : as for `fit`; the accelerometer of a log is an aid that does not turn the axes.
    norm, field_error, dip : magnitude of the field and its relative error, or None, and its dip. known : whether the dip was given.
    currents, conditions : name -> numbers at the times of the readings. traced : whether the fit is in a trace; nothing is chosen then.
    """

    m: np.ndarray
    there: np.ndarray
    method: str
    model: Any
    norm: float | None
    field_error: float | None
    dip: float
    known: bool
    limits: tuple[float, float]
    aid: Any
    currents: dict[str, np.ndarray]
    conditions: dict[str, np.ndarray]
    traced: bool = False

    @property
    def sign(self) -> float:
        """Sign of the dip at the place; zero if it is not known."""
        return float(np.sign(self.dip)) if self.known else 0.0


def asked_for(
    source: Any, method: str, model: Any, field: Any, field_error: Any, inclination: Any, limits: Any, aid: Any, currents: Any,
    conditions: Any,
) -> Asked:  # fmt: skip
    """The fit as asked for, after a check that each option is known and that all suit one another."""
    m, force = field_readings(source)
    own = isinstance(model, MagModel)
    if is_traced(m, field):
        host = {"method": method != "ml", "field_error": field_error, "aid": aid, "currents": currents,
                "conditions": conditions and not own}  # fmt: skip
        return _in_trace(m, model, field, inclination, conditions or {}, [name for name, given in host.items() if given])
    there = np.isfinite(m).all(axis=1) if m.ndim == 2 else np.zeros(0, dtype=bool)
    if m.ndim != 2 or m.shape[1] != 3 or not len(m):
        raise DataError(f"The readings have shape {m.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    if not there.all() and not isinstance(aid, Gyroscope):
        raise DataError(
            f"{np.sum(~there)} readings are not finite, the first in row {np.argmin(there)}; leave them out.", code="not_finite"
        )
    if own and method != "ml":
        raise DataError("A model object is fitted by method='ml'.", code="model_object_options")
    for given, known, what in ((method, METHODS, "method"), ("auto" if own else model, MODELS, "model")):
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
    count = int(there.sum())
    recorded = {name: _numbers(one, f"The condition {name!r}", count, "condition", own) for name, one in (conditions or {}).items()}
    flows = {name: _numbers(one, "The current", len(m), "current") for name, one in (currents or {}).items()}
    if any(not np.ptp(one) > 0 for one in flows.values()):
        raise DataError("A current is constant: its field cannot be told from hard iron.", code="current_constant")
    aid = Accelerometer(force, turns=False) if aid is None and force is not None and not own else aid
    known = inclination is not None or np.ndim(field) == 1
    return Asked(m, np.flatnonzero(there), method, model, norm, field_error, float(dip), known, (float(limits[0]), float(limits[1])), aid,
                 flows, recorded)  # fmt: skip


def _in_trace(m: Any, model: Any, field: Any, inclination: Any, conditions: dict[str, Any], refused: list[str]) -> Asked:
    """A fit in a trace; `refused` names options that were given and are decided on the host."""
    own = isinstance(model, MagModel)
    if not (own or model in COUNT) or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal', 'symmetric' or a model object, and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad.", code="traced_options",
        )  # fmt: skip
    least = 10 + len(further_names(model)) if own else COUNT[model] + 1
    if m.ndim != 2 or m.shape[1] != 3 or len(m) < least:
        raise DataError(f"The readings have shape {m.shape}; this model needs (n, 3) with at least {least} rows.", code="bad_shape")
    norm, dip = norm_and_dip(field, inclination)
    return Asked(m, np.arange(len(m)), "ml", model, norm, None, float(dip), True, (0.0, 0.0), None, {}, conditions, True)


def _numbers(given: Any, what: str, count: int, code: str, wide: bool = False) -> np.ndarray:
    """Finite numbers, one for each reading, or one row if `wide`."""
    values = np.asarray(given, dtype=float)
    if values.shape[:1] != (count,) or (values.ndim > 1 and not wide):
        raise DataError(f"{what} has shape {values.shape}; give one number for each of {count} readings.", code=f"{code}_shape")
    if not np.isfinite(values).all():
        raise DataError(f"{what} has values that are not finite.", code=f"{code}_not_finite")
    return values


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


def field_readings(source: Any) -> tuple[Any, Any]:
    """Magnetometer readings (n, 3), from a log or anything else that `jaxcal.read` accepts by name, or an array unchanged.

    Also the specific force at the same times, if the log has it.
    """
    tabular = hasattr(source, "data_vars") or np.ndim(getattr(source, "columns", 0)) == 1
    if not (tabular or isinstance(source, Log | str | os.PathLike | dict)) or len(getattr(source, "columns", ())) == 3:
        if not is_traced(source):
            source = real_numbers(source, "the readings")
            if source.ndim != 2:
                raise DataError(f"The readings have shape {source.shape}; expected (n, 3), one row per reading.", code="bad_shape")
        return source, None
    log = as_log(source)
    if log.mag is None or log.mag.shape[1] != 3:
        raise DataError(Message("the log has no magnetometer of three axes; name its columns with {option.columns:mag=...}"), code="no_mag")
    m = log.usable("mag", keep=("clipped",))
    there = np.isfinite(m).all(axis=1)
    force = log.accel if log.accel is not None and log.accel.shape[1] == 3 else None
    return m[there], None if force is None else force[there]
