"""`fit`: hard and soft iron from readings in a field of constant magnitude, with what is known beside. Everything is checked here, once.

Data go one way: readings and options, the surface of the magnitudes, what sensors beside tell, the judgement.
"""

import os
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from .._errors import DataError
from .._frozen import made
from .._log import Log, LogLike, as_log
from .._message import Message
from .._precision import host_float64, is_traced
from .._types import Checked, Numbers, Samples
from ._aids import Accelerometer, Asked, Attitude, Gyroscope, Headings, told
from ._beside import beside
from ._field import INCLINATION
from ._judge import judged
from ._model import MagModel, parts_of
from ._quadric import COUNT, chosen, rows_of
from ._result import MagFit
from ._surface import surface_of

METHODS = ("ml", "consistent", "constrained")
MODELS = ("auto", *COUNT, "planar")


@host_float64
def fit(
    m: Checked[LogLike | Numbers],
    *,
    method: str = "ml",
    model: str | MagModel = "auto",
    field: Samples | None = None,
    field_error: float | None = None,
    inclination: float | None = None,
    aid: Checked[Accelerometer | Attitude | Gyroscope | Headings] | None = None,
    currents: dict[str, Any] | None = None,
    conditions: dict[str, Any] | None = None,
) -> MagFit:
    r"""Hard and soft iron from readings in many attitudes, in a field of constant magnitude.

    The default is the maximum-likelihood fit. It assumes white noise of one unknown variance in all axes, and any attitudes:

    .. math:: \min_{A, b} \sum_i d_i^2,\qquad d_i = \text{distance of } m_i \text{ to } (x - b)^T A (x - b) = 1,\quad A = U^T U,

    and starts from the consistent algebraic fit. Readings that are none of the field (spikes, zeros, repeats) are left out before. Where
    the noise exceeds 2 % of the field, the fit corrects the distances for the mean
    offset that noise causes at a curved surface. The soft iron found is symmetric, C = H A^{-1/2}. A rotation of all corrected readings,
    from an unsymmetric soft iron or a rotated sensor, leaves every magnitude unchanged, so magnitudes alone cannot show it; an `aid` does.

    Parameters
    ----------
    m : (n, 3) readings in any unit, without NaN. Or a `Log`, or a path, data frame or dataset of one; rows without a reading are then
        left out.
    method : "ml"; "consistent" (adjusted least squares: no noise bias, no iteration); or "constrained" (the magnetometer paper).
    model : "sphere" (4 parameters), "diagonal" (6), "symmetric" (9), or "planar" (turns about one axis). With
        "auto", "ml" chooses a model. Or a model object: a `MagModel`, or a subclass with
        fields of its own, of which the fit needs `measure` only. "ml" then fits its floating leaves: soft and hard iron from the algebraic
        fit, all others from their values. With an aid or currents, the fields of its own are those of the magnitudes.
    field : magnitude of the true field, or the field vector (north, east, down), in the unit of the readings. The vector also gives the
        dip. Without `field`, the corrected readings keep the unit and mean size of the readings.
    field_error : relative standard deviation of `field` in the unit of the readings. It covers the sensor's sensitivity and the mean
        stretch of its soft iron as well as the field model. The fit then uses `field`, and that soft irons are near 5 %, which helps most
        with part of a sphere.
    inclination : dip of the field in rad, used for `heading_error`. By default it comes from `field` or from an `Accelerometer`; without
        either, 57 degrees are assumed, and the result shows the error for other dips too.
    aid : `Accelerometer`, `Attitude`, `Gyroscope` or `Headings`: magnitudes and aid are then fitted together, each residual divided by its
        own standard deviation, and the soft iron is the full matrix, with the rotation that magnitudes cannot show. Priors keep open what
        the attitudes cannot show, so that a vehicle that stays level, or hardly tilts, has its headings calibrated too. Without an aid, the
        accelerometer of a `Log` shows the dip. With a `Gyroscope`, rows with NaN are left out, but their rates are used.
    currents : name -> (n,) current or throttle at the times of the readings: the field of each is fitted too, m = C h + b + k I, and the
        hard iron is that without currents. Anything else that shifts the hard iron in proportion, such as a temperature, serves as well.
    conditions : name -> array with one number per reading, such as a motor current or the temperature. The fit checks whether the
        residuals follow it. With a model object: further arguments of its `measure` and `correct`.

    Under `jit`, `vmap` and `grad` the fit takes the same steps, with method "ml" and model "sphere", "diagonal", "symmetric" or a model
    object. Nothing is left out, and `verdict` is "not judged". Derivatives are those of the solution (implicit function theorem).

    Returns
    -------
    MagFit
        The fit with its findings. Readings that determine nothing give a "refused" fit whose `model` is None. The model of a refused fit
        is for inspection only; do not use it.

    Raises
    ------
    DataError
        If the readings are not (n, 3) finite numbers, or an option is unknown or does not suit the method.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import MagModel, body_field, scenario
    >>> true = MagModel(np.array([[1.1, 0.1, 0.0], [0.1, 0.9, 0.0], [0.0, 0.0, 1.0]]), np.array([10.0, -5.0, 20.0]))
    >>> m = true.measure(body_field(scenario("all"), 47.0)) + np.random.default_rng(0).normal(size=(360, 3)) * 0.1
    >>> found = jaxcal.magnetometer.fit(m, field=47.0)
    >>> print(found.verdict, found.kind, found.model.hard_iron.round(1))
    good symmetric [10. -5. 20.]

    References
    ----------
    J. F. Vasconcelos et al., IEEE Trans. Aerosp. Electron. Syst. 47 (2011) 1293 (maximum likelihood); I. Markovsky et al., Numer.
    Math. 98 (2004) 177 (consistent); the magnetometer paper's equations 6 to 16 (constrained); the thesis, chapter 6.
    """
    asked = _asked(m, method, model, field, field_error, inclination, aid, currents, conditions)
    picked = chosen(rows_of(asked.m, asked.there), "symmetric" if asked.parts is not None else asked.model if asked.traced else "")
    surface = surface_of(asked, picked)
    surface = beside(asked, surface)
    kind = "none" if surface.model is None else surface.joint or surface.found.kind
    return made(
        MagFit, model=surface.model, field=surface.field, noise=surface.noise, residual=surface.residual, inclination=surface.dip,
        kind=kind, method="joint" if surface.joint else method, down=surface.down, alignment=surface.alignment, **judged(asked, surface),
    )  # fmt: skip


def _asked(
    source: Any, method: str, model: Any, field: Any, field_error: Any, inclination: Any, aid: Any, currents: Any, conditions: Any
) -> Asked:  # fmt: skip
    """The fit as asked for, after a check that each option is known and that all suit one another."""
    m, force = _readings(source)
    own = isinstance(model, MagModel)
    if is_traced(m, field):
        host = zip(("method", "field_error", "aid", "currents", "conditions"),
                   (method != "ml", field_error, aid, currents, None if own else conditions), strict=True)  # fmt: skip
        return _in_trace(m, model, field, inclination, conditions or {}, [name for name, given in host if given])
    there = np.isfinite(m).all(axis=1) if m.ndim == 2 else np.zeros(0, dtype=bool)
    if m.ndim != 2 or m.shape[1] != 3 or not len(m):
        raise DataError(f"The readings have shape {m.shape}; expected (n, 3), one row per reading.", code="bad_shape")
    if not there.all() and not isinstance(aid, Gyroscope):
        raise DataError(f"{np.sum(~there)} readings are not finite, the first in row {np.argmin(there)}; drop them.", code="not_finite")
    for given, known, what in ((method, METHODS, "method"), ("auto" if own else model, MODELS, "model")):
        if given not in known:
            raise DataError(f"There is no {what} {given!r}; known are {', '.join(map(repr, known))}.", code="no_such_option")
    if method != "ml" and (own or model not in ("auto", "symmetric")):
        raise DataError(f"Method {method!r} fits the model 'symmetric' only; give method='ml'.", code="no_such_model")
    norm, dip = _norm_and_dip(field, inclination)
    if field_error is not None:
        if norm is None or method != "ml":
            raise DataError("A field error needs the `field` that it is of, and the method 'ml'.", code="field_error_alone")
        if not (isinstance(field_error, (int, float)) and 0 < field_error < 1):
            raise DataError(f"The field error is {field_error!r}; give the relative standard deviation of `field`, such as 0.02.",
                            code="bad_field_error")  # fmt: skip
    if not abs(dip) < np.pi / 2:
        raise DataError(f"The inclination is {dip:g} rad; it must lie between -pi/2 and pi/2, where there is a horizontal field.",
                        code="bad_inclination")  # fmt: skip
    count, parts = int(there.sum()), None
    if own:
        model = jax.tree.map(lambda leaf: np.asarray(leaf, dtype=float), model)
        parts = parts_of(model)
        least = 10 + len(parts[1])
        if count < least:
            raise DataError(f"There are {count} readings; this model with {least - 1} parameters needs {least}.", code="few_readings")
    recorded = {name: _numbers(one, f"The condition {name!r}", count, "condition", own) for name, one in (conditions or {}).items()}
    flows = {name: _numbers(one, "The current", len(m), "current") for name, one in (currents or {}).items()}
    if any(not np.ptp(one) > 0 for one in flows.values()):
        raise DataError("A current is constant: its field cannot be told from hard iron.", code="current_constant")
    aid = Accelerometer(force, turns=False) if aid is None and force is not None and not own else aid
    known = inclination is not None or np.ndim(field) == 1
    turns, at = getattr(aid, "turns", aid is not None), told(aid)
    for rows in (at.up, at.heading, at.gyro):
        if rows is not None and len(rows) != len(m):
            raise DataError(f"There are {len(m)} readings and {len(rows)} rows of the aid; give one for each reading.", code="rows_differ")
    return Asked(m, np.flatnonzero(there), method, model, norm, field_error, float(dip), known, at, turns, flows, recorded, parts)


def _in_trace(m: Any, model: Any, field: Any, inclination: Any, conditions: dict[str, Any], refused: list[str]) -> Asked:
    """A fit in a trace; `refused` names options that were given and are decided on the host."""
    own = isinstance(model, MagModel)
    if not (own or model in COUNT) or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            f"{said} is decided on the host. In jit, vmap and grad give model='sphere', 'diagonal', 'symmetric' or a model object, and no "
            "other method than 'ml'.", code="traced_options",
        )  # fmt: skip
    least = 10 + len(parts_of(model)[1]) if own else COUNT[model] + 1
    if m.ndim != 2 or m.shape[1] != 3 or len(m) < least:
        raise DataError(f"The readings have shape {m.shape}; this model needs (n, 3) with at least {least} rows.", code="bad_shape")
    model = jax.tree.map(lambda leaf: jnp.asarray(leaf, m.dtype), model) if own else model
    norm, dip = _norm_and_dip(field, inclination)
    return Asked(m, np.arange(len(m)), "ml", model, norm, None, float(dip), True, told(None), False, {}, conditions,
                 parts_of(model) if own else None, True)  # fmt: skip


def _numbers(given: Any, what: str, count: int, code: str, wide: bool = False) -> np.ndarray:
    """Finite numbers, one for each reading, or one row if `wide`."""
    values = np.asarray(given, dtype=float)
    if values.shape[:1] != (count,) or (values.ndim > 1 and not wide):
        raise DataError(f"{what} has shape {values.shape}; give one number for each of {count} readings.", code=f"{code}_shape")
    if not np.isfinite(values).all():
        raise DataError(f"{what} has values that are not finite.", code=f"{code}_not_finite")
    return values


def _norm_and_dip(field: Any, inclination: Any) -> tuple[Any, Any]:
    """Magnitude of the field, traced or not, and its dip: as given, from the field vector, or else the dip at Ankara."""
    norm = dip = None
    if isinstance(field, Tracer):
        norm = jnp.linalg.norm(jnp.atleast_1d(field))
    elif field is not None:
        vector = np.asarray(field, dtype=float)
        norm = float(np.linalg.norm(vector))
        if vector.shape not in ((), (3,)) or not 0 < norm < np.inf or (vector.ndim == 0 and vector < 0):
            raise DataError(f"The field is {field!r}; give its norm, or the vector (north, east, down), in the unit of the readings.",
                            code="bad_field")  # fmt: skip
        dip = float(np.arctan2(vector[2], np.hypot(vector[0], vector[1]))) if vector.ndim else None
    return norm, next(angle for angle in (inclination, dip, INCLINATION) if angle is not None)


def _readings(source: Any) -> tuple[Any, Any]:
    """Magnetometer readings (n, 3), from a log or anything else that `jaxcal.read` accepts by name, or an array unchanged.

    Also the specific force at the same times, if the log has it.
    """
    tabular = hasattr(source, "data_vars") or np.ndim(getattr(source, "columns", 0)) == 1
    if not (tabular or isinstance(source, Log | str | os.PathLike | dict)) or len(getattr(source, "columns", ())) == 3:
        m: Any = source if is_traced(source) else np.asarray(source)  # of a size that was checked before
        if m.dtype.kind not in "fiu":
            raise DataError(f"The readings must be real numbers; got values of type {m.dtype}.", code="not_numbers")
        return (m if is_traced(source) else m.astype(float, copy=False)), None
    log, m = mag_of(source, keep=("clipped",))
    there = np.isfinite(m).all(axis=1)
    force = log.accel if log.accel is not None and log.accel.shape[1] == 3 else None
    return m[there], None if force is None else force[there]


def mag_of(source: Any, **options: Any) -> tuple[Log, np.ndarray]:
    """The log, and its readings (n, 3) that are measurements, NaN elsewhere."""
    log = as_log(source)
    if log.mag is None or log.mag.shape[1] != 3:
        raise DataError(Message("the log has no magnetometer of three axes; name its columns with {option.columns:mag=...}"), code="no_mag")
    return log, log.usable("mag", **options)
