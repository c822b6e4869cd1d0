"""`fit`: hard and soft iron from readings in a field of constant magnitude, with what is known beside."""

import functools
from typing import Any

import jax
import jax.numpy as jnp

from .._compile import filter_jit
from .._errors import DataError
from .._frozen import made
from .._precision import host_float64, is_traced
from ._aids import Plane
from ._checked import asked_for, field_readings, norm_and_dip
from ._design._heading_error import both_tilts, rms_heading
from ._ellipsoid._algebraic import COUNT, Frame, between
from ._ellipsoid._orthogonal import fitted
from ._findings import FINDINGS
from ._joined import joined
from ._magnitudes import Surface, by_magnitudes, ellipsoid
from ._model import MagModel
from ._own_model import changes_of, fit_leaves, further_names
from ._result import LIMITS, MagFit, estimated


@host_float64
def fit(
    m: Any,
    *,
    method: str = "ml",
    model: str | MagModel = "auto",
    field: Any = None,
    field_error: float | None = None,
    inclination: float | None = None,
    limits: tuple[float, float] = LIMITS,
    aid: Any = None,
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
        fields of its own. "ml" then fits its floating leaves, from their values or from the algebraic fit. With an aid or currents, the
        fields of its own are those of the magnitudes.
    field : magnitude of the true field, or the field vector (north, east, down), in the unit of the readings. The vector also gives the
        dip. Without `field`, the corrected readings keep the unit and mean size of the readings.
    field_error : relative standard deviation of `field` in the unit of the readings. It covers the sensor's sensitivity and the mean
        stretch of its soft iron as well as the field model. The fit then uses `field`, and that soft irons are near 5 %, which helps most
        with part of a sphere.
    inclination : dip of the field in rad, used for `heading_error`. By default it comes from `field` or from an `Accelerometer`; without
        either, 57 degrees are assumed, and the result shows the error for other dips too.
    limits : rms heading errors in rad above which the verdict is "weak" and "refused".
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
    m, force = field_readings(m)
    if is_traced(m, field):
        host = {"method": method != "ml", "field_error": field_error, "aid": aid, "currents": currents,
                "conditions": conditions and not isinstance(model, MagModel)}  # fmt: skip
        return fit_traced(m, model, field, inclination, conditions, [name for name, given in host.items() if given])
    asked = asked_for(m, force, method, model, field, field_error, inclination, limits, aid, currents, conditions)
    first, used, plane = by_magnitudes(asked)
    turns = getattr(asked.aid, "turns", asked.aid is not None)
    if plane is not None and not turns:
        asked, turns = asked._replace(aid=Plane(plane, model == "planar")), True
    return joined(first, asked, used) if turns or currents or field_error is not None else first


def fit_traced(m: Any, model: Any, field: Any, inclination: Any, conditions: Any, refused: list[str]) -> MagFit:
    """The traced fit; `refused` names options that were given and are decided on the host."""
    own = isinstance(model, MagModel)
    if not (own or model in COUNT) or refused:
        said = ", ".join(f"`{name}`" for name in refused) or f"model={model!r}"
        raise DataError(
            "A traced fit has its structure fixed by model='sphere', 'diagonal', 'symmetric' or a model object, and method='ml'; "
            f"{said} is decided on the host. Leave it out, or call `fit` outside of jit, vmap and grad.", code="traced_options",
        )  # fmt: skip
    names = further_names(model) if own else []
    least = 10 + len(names) if own else COUNT[model] + 1
    if m.ndim != 2 or m.shape[1] != 3 or len(m) < least:
        raise DataError(f"The readings have shape {m.shape}; this model needs (n, 3) with at least {least} rows.", code="bad_shape")
    norm, dip = norm_and_dip(field, inclination)
    told = _pure(model, float(dip), m, norm, conditions or {})
    further = dict(zip(names, told.pop("further"), strict=True))
    known = estimated(told["model"], told["field"], told.pop("covariance"), float(len(m) + 1 - least), further, norm is not None or own)
    return made(
        MagFit, inclination=dip, method="ml", kind=type(model).__name__ if own else model, findings=(FINDINGS("not_judged"),),
        estimate=known, **told,
    )  # fmt: skip


@filter_jit
def _pure(model: Any, dip: float, m: Any, norm: Any, conditions: Any) -> dict[str, Any]:
    """The results of a traced fit; one program, since called eagerly by `grad` its operations would be compiled one by one."""
    if isinstance(model, MagModel):
        usual = {name: jnp.median(value, axis=0) for name, value in conditions.items()}
        typed = jax.tree.map(lambda leaf: jnp.asarray(leaf, m.dtype), model)
        found, own, size, slopes, *_ = fit_leaves(typed, m, norm, conditions)
        surface = Surface(found=found, model=own, field=size, slopes=slopes, change=functools.partial(changes_of, own, size, usual))
    else:
        frame = Frame.of(m)
        surface = ellipsoid(fitted(frame.scaled(m), model), frame, norm)
    found, matrix = surface.found, between(surface.slopes, surface.found.covariance)
    return {
        "model": surface.model, "covariance": matrix, "field": surface.field, "noise": found.noise * surface.scale,
        "heading_error": rms_heading(both_tilts(surface.change, dip), matrix), "residual": found.distance * surface.scale,
        "further": jnp.concatenate([jnp.ravel(leaf) for leaf in jax.tree.leaves(surface.model)])[12:],
    }  # fmt: skip
