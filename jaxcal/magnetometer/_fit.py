"""`fit`: hard and soft iron from readings in a field of constant magnitude, with what is known beside."""

from typing import Any

from .._log import LogLike
from .._precision import host_float64
from .._types import Checked, Numbers, Samples
from ._aids import Accelerometer, Attitude, Gyroscope, Headings, Plane
from ._checked import asked_for
from ._joined import joined
from ._judge import by_magnitudes
from ._model import MagModel
from ._result import LIMITS, MagFit
from ._surface import surface_of


@host_float64
def fit(
    m: Checked[LogLike | Numbers],
    *,
    method: str = "ml",
    model: str | MagModel = "auto",
    field: Samples | None = None,
    field_error: float | None = None,
    inclination: float | None = None,
    limits: tuple[float, float] = LIMITS,
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
    asked = asked_for(m, method, model, field, field_error, inclination, limits, aid, currents, conditions)
    surface = surface_of(asked)
    first = by_magnitudes(asked, surface)
    turns = getattr(asked.aid, "turns", asked.aid is not None)
    if surface.plane is not None and not turns:
        asked, turns = asked._replace(aid=Plane(surface.plane, model == "planar")), True
    return joined(first, asked, asked.there[surface.rows]) if turns or currents or field_error is not None else first
