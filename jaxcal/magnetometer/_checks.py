"""Options of `fit`: checked before anything is computed."""

from functools import partial
from typing import Any

import jax.core
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from ._ellipsoid._algebraic import algebraic, axes, consistent, constrained, li_griffiths, minmax
from ._ellipsoid._kinds import SOLID
from ._ellipsoid._orthogonal import loss_of
from ._field import INCLINATION

#: method -> model -> algebraic fit
DIRECT: dict[str, dict[str, Any]] = {
    "minmax": {"diagonal": minmax},
    "axes": {"symmetric": axes},
    "constrained": {"symmetric": constrained},
    "li_griffiths": {"symmetric": li_griffiths},
    "algebraic": {kind: partial(algebraic, kind=kind) for kind in reversed(SOLID)},
    "consistent": {"symmetric": lambda u: consistent(u)[:2]},
}
METHODS = ("ml", "consistent", "algebraic", "li_griffiths", "constrained", "radial", "axes", "minmax")
MODELS = ("auto", *SOLID, "planar")


def checked(m, method, model, field, loss, inclination, choose, penalty, field_error) -> tuple[np.ndarray, float | None, float]:
    """Readings, norm of the field and dip; every option known and at home with the method."""
    try:
        m = np.asarray(m, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError("The readings are not numbers; give an array of shape (n, 3).") from error
    if m.ndim != 2 or m.shape[1] != 3 or not len(m):
        raise DataError(f"The readings have shape {m.shape}; expected (n, 3), one row per reading.")
    bad = np.flatnonzero(~np.isfinite(m).all(axis=1))
    if bad.size:
        raise DataError(f"{bad.size} readings are not finite, the first in row {bad[0]}; leave them out.")
    if np.abs(m).max() > 1e100 or 0 < np.ptp(m) < 1e-100:
        raise DataError("The readings leave the range in which their fourth powers are numbers; give them in tesla or counts.")
    ways = ("bic", "held_out")
    for given, known, what in ((method, METHODS, "method"), (model, MODELS, "model"), (choose, ways, "way to choose")):
        if given not in known:
            raise DataError(f"There is no {what} {given!r}; known are {', '.join(map(repr, known))}.")
    allowed = {"ml": MODELS, "radial": ("auto", *SOLID)}.get(method, ("auto", *DIRECT.get(method, ())))
    if model not in allowed:
        raise DataError(f"Method {method!r} has no model {model!r}; it has {', '.join(map(repr, allowed))}. Method 'ml' has all.")
    if loss_of(loss) is not None and method not in ("ml", "radial"):
        raise DataError(f"Method {method!r} takes no loss; use method='ml' with loss={loss!r}.")
    if not (isinstance(penalty, (int, float)) and 0 <= penalty < np.inf):
        raise DataError(f"The penalty is {penalty!r}; give its weight: 0.5, 1 for Jeffreys' prior, or 0 for none.")
    norm, dip = norm_and_dip(field, inclination, model)
    if field_error is not None:
        if norm is None or method != "ml":
            raise DataError("A field error needs the `field` that it is of, and method='ml'.")
        if not (isinstance(field_error, (int, float)) and 0 < field_error < 1):
            raise DataError(f"The field error is {field_error!r}; give the relative standard deviation of `field`, such as 0.02.")
    if not abs(dip) < np.pi / 2:
        raise DataError(f"The inclination is {dip:g} rad; it must lie between -pi/2 and pi/2, where there is a horizontal field.")
    return m, norm, float(dip)


def norm_and_dip(field: Any, inclination: Any, model: str = "") -> tuple[Any, Any]:
    """Norm of the field, traced or not, and its dip: the one given, that of the vector, or that of Ankara."""
    if field is not None and model == "planar":
        raise DataError("Readings in a plane do not show the whole field: leave out `field` with model='planar'.")
    norm = dip = None
    if isinstance(field, jax.core.Tracer):
        norm = jnp.linalg.norm(jnp.atleast_1d(field))
    elif field is not None:
        vector = np.asarray(field, dtype=float)
        norm = float(np.linalg.norm(vector))
        if vector.shape not in ((), (3,)) or not 0 < norm < np.inf or (vector.ndim == 0 and vector < 0):
            raise DataError(f"The field is {field!r}; give its norm, or the vector (north, east, down), in the unit of the readings.")
        dip = float(np.arctan2(vector[2], np.hypot(vector[0], vector[1]))) if vector.ndim else None
    return norm, next(angle for angle in (inclination, dip, INCLINATION) if angle is not None)
