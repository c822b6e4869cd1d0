"""`fit`: a thermal model of one channel."""

from typing import Any

import jax
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import AnyArray
from ..fitting import Fit
from ._curves import AbstractCurve, Chebyshev, Steps
from ._estimate import fitted, traced
from ._linear import ALARM, CAP, degree_by_bic, monomial_errors, monomials, pchip_curve, polynomial_curve, table_curve
from ._model import ThermalModel
from ._record import COARSE, Bins, Record, binned, record
from ._result import Candidate, Step, TemperatureFit
from ._search import Fitter, Score, effective, score, search
from ._smoothing import spline_curve
from ._steps import DEGREE, steps_curve
from ._uncertainty import steepness, uncertainty

MODELS = ("auto", "polynomial", "table", "pchip", "spline", "steps")
_WINDOW = 1.0  # degC: the window whose worst residual is reported
_STANDS_OUT = 3.0  # times the rms of the rest above which the worst window is told


@host_float64
def fit(
    temperature: Any,
    bias: Any,
    *,
    model: Any = "auto",
    degree: int | None = None,
    time: Any = None,
    lag: Any = None,
    play: Any = None,
    confidence: float = 0.95,
) -> TemperatureFit:
    r"""Bias of a sensor at rest against its temperature, jumps and hysteresis included.

    .. math:: b(T) = \sum_{i=0}^{3} q_i C_i(u) + \sum_{j=1}^{J} \frac{p_j}{1 + e^{-(T - t_j)/w_j}}

    is the model "steps", C_i a Chebyshev polynomial of the temperature scaled to -1 .. 1; a polynomial alone cannot follow a jump.

    Parameters
    ----------
    temperature : (n,) degC, in time order.
    bias : (n,) readings at rest, any unit; rows that are not numbers are left out, and told.
    model : "polynomial"; "table", means over 0.25 degC with lines between; "pchip", the same with monotone cubics; "spline", cubic
        smoothing spline by generalised cross-validation; "steps"; or "auto", which compares polynomials of degree 1, 3 and 5, steps and
        the spline on held-out data, and takes the simplest within a standard error of the best. Or a curve, or a `ThermalModel` with
        one: its numbers are where the search begins, all but the `low`, `high` and `nodes` of curves are fitted.
    degree : of the polynomial; None chooses by BIC up to 25 (model="polynomial").
    time : (n,) s. With it the record is averaged to seconds, and a lag can be found.
    lag : time constant in s with which the sensor follows the thermometer: a number, "auto" to search it, None for "auto" with
        model="auto" and 0 with the others. A search needs heating and cooling.
    play : half-width in degC of the backlash between thermometer and sensor, likewise.
    confidence : level of the intervals.

    Returns
    -------
    TemperatureFit
        Traced, for a polynomial of given degree, a table or a curve, with lag and play as numbers: the model, bins and residuals alone,
        of a record that is taken as it is, neither averaged nor cleaned.

    Raises
    ------
    DataError
        If the arrays do not belong together, the temperature covers less than 2 degC or fills less than 10 bins of 0.1 degC, or an
        option is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(seed=1)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time)
    >>> found.kind, round(found.steps[0].centre, 1), round(float(np.rad2deg(found.steps[0].height)), 2)
    ('steps', 24.5, 0.3)

    References
    ----------
    The thesis, equation (5.3) and section 7.1 (polynomials); G. Schwarz, Ann. Stat. 6 (1978) 461 (BIC); P. Craven and G. Wahba, Numer.
    Math. 31 (1979) 377 (spline); L. Breiman et al., Classification and Regression Trees, 1984, section 3.4.3 (one standard error).
    """
    if isinstance(model, ThermalModel):
        lag, play, model = model.lag if lag is None else lag, model.play if play is None else play, model.curve
    if is_traced(temperature, bias, time, model, lag, play):
        return traced(temperature, bias, model, degree, time, 0.0 if lag is None else lag, 0.0 if play is None else play)
    lag, play = _check(model, degree, lag, play, confidence, time)
    given = record(temperature, bias, time)
    found = search(given, lag, play)
    t = effective(given, found.lag, found.play)
    low, high = float(t.min()), float(t.max())
    warnings = list(given.warnings)
    if found.unsure:
        warnings.append(
            "heating and cooling differ, but the temperature changed too evenly to tell a lag from a play; record ramps of different speed"
        )
    elif lag == "auto" and given.time is None and len(np.unique(given.ramp)) > 1:
        warnings.append("a lag was not looked for, because the times are not known; give time=")
    candidates: tuple[Candidate, ...] = ()
    held_out, by_bic = "", degree_by_bic(binned(t, given.b), low, high)
    own = None
    if isinstance(model, AbstractCurve):
        own, kind = fitted(model, binned(t, given.b, low=low)).checked(), type(model).__name__
    elif model == "auto":
        kind, degree, candidates, held_out = _chosen(t, given, low, high)
    else:
        kind, degree = model, by_bic if model == "polynomial" and degree is None else degree
    if own is None and by_bic >= min(ALARM, CAP) and model in ("auto", "polynomial"):
        end = f"; {kind} was taken" if kind != "polynomial" else "; take model='auto'"
        warnings.append(f"BIC asks for a polynomial of degree {by_bic} of at most {CAP}: this curve is not a polynomial{end}")
    return _described(kind, degree, t, given, low, high, found, candidates, held_out, confidence, warnings, own)


def _check(model: Any, degree: Any, lag: Any, play: Any, confidence: float, time: Any) -> tuple[Any, Any]:
    if not isinstance(model, AbstractCurve) and model not in MODELS:
        raise DataError(f"unknown model {model!r}; expected one of {', '.join(MODELS)}")
    if degree is not None and (isinstance(model, AbstractCurve) or model != "polynomial"):
        raise DataError(f"degree={degree} goes with model='polynomial', not with {model!r}")
    if degree is not None and (not isinstance(degree, (int, np.integer)) or isinstance(degree, bool) or not 0 <= degree <= CAP):
        raise DataError(f"degree={degree!r}; expected a whole number from 0 to {CAP}")
    if not 0 < confidence < 1:
        raise DataError(f"confidence={confidence:g}; expected a level between 0 and 1, such as 0.95")
    checked = []
    for name, value in (("lag", lag), ("play", play)):
        if value is None:
            value = "auto" if model == "auto" else 0.0
        number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
        if value != "auto" and not (number and np.isfinite(value) and value >= 0):
            raise DataError(f'{name}={value!r}; expected "auto", None, or a number from 0')
        checked.append(value)
    if checked[0] != "auto" and checked[0] > 0 and time is None:
        raise DataError("a lag needs the times of the samples: give time= (s)")
    return checked[0], checked[1]


def _fitter(kind: str, degree: int | None) -> Fitter:
    return {
        "polynomial": lambda t, b, low, high: polynomial_curve(binned(t, b, low=low), low, high, degree or 0),
        "table": lambda t, b, low, high: table_curve(binned(t, b, COARSE)),
        "pchip": lambda t, b, low, high: pchip_curve(binned(t, b, COARSE)),
        "spline": lambda t, b, low, high: spline_curve(binned(t, b, low=low)),
        "steps": steps_curve,
    }[kind]


def _chosen(t: AnyArray, given: Record, low: float, high: float) -> tuple[str, int | None, tuple[Candidate, ...], str]:
    """Kind and degree: the simplest within one standard error of the best; the spline only where it is better by more than that."""
    scores: dict[tuple[str, int | None], Score] = {}
    tried: list[tuple[str, int | None]] = [("polynomial", 1), ("polynomial", 3), ("polynomial", 5)]
    if len(steps_curve(t, given.b, low, high).centre):
        tried.append(("steps", None))  # without a step it is the polynomial of degree 3
    for one in (*tried, ("spline", None)):
        scores[one] = score(_fitter(*one), t, given.b, given.ramp, given.whole)
    best = min(tried, key=lambda one: scores[one].mean)
    reach = scores[best].mean + scores[best].error
    chosen = next(one for one in tried if scores[one].mean <= reach)
    spline = scores["spline", None]
    if spline.mean + spline.error < scores[best].mean:
        chosen = ("spline", None)
    names = [kind if degree is None else f"{kind} {degree}" for kind, degree in scores]
    table = tuple(Candidate(name, s.mean, s.error, one == chosen) for name, (one, s) in zip(names, scores.items(), strict=True))
    return chosen[0], chosen[1], table, spline.held_out


def _described(
    kind: str, degree: int | None, t: AnyArray, given: Record, low: float, high: float, hysteresis: Any,
    candidates: tuple[Candidate, ...], held_out: str, confidence: float, warnings: list[str], own: Fit | None,
) -> TemperatureFit:  # fmt: skip
    bins = binned(t, given.b, low=low)
    if degree is not None and degree >= len(bins.t):
        raise DataError(f"degree={degree} needs more than the {len(bins.t)} bins of 0.1 degC that the record fills; take a lower one")
    curve = _fitter(kind, degree)(t, given.b, low, high) if own is None else jax.tree.map(np.asarray, own.model)
    residual = bins.b - np.asarray(curve.value(bins.t))
    rms, worst, worst_at = _windows(bins, residual)
    if kind == "polynomial" and worst > _STANDS_OUT * _elsewhere(bins, residual, worst_at):
        warnings.append(
            f"the polynomial of degree {degree} leaves {worst:.3g} (unit of the bias) in the degree around {worst_at:.1f} degC, "
            f"{worst / rms:.1f} times its rms: a jump there? model='auto' follows it"
        )
    grid, error, covariance = uncertainty(kind, curve, t, given.b, bins, given.noise, own)
    found: dict[str, Any] = {"degree": degree}
    if own is not None:
        found["parameters"] = dict(
            zip(own.names, zip(own.parameters.tolist(), np.sqrt(np.diag(covariance)).tolist(), strict=True), strict=True)
        )
    elif isinstance(curve, Chebyshev):
        found |= {"coefficients": monomials(curve), "coefficient_error": monomial_errors(curve, covariance)}
    elif isinstance(curve, Steps):
        found = {"degree": DEGREE, "steps": _steps(curve, covariance)}
    slope = np.abs(steepness(curve, bins.t))
    note = (
        f"the thermometer's noise of {given.noise:.2g} degC adds up to {float(np.max(slope)) * given.noise:.2g} to a corrected reading, at "
        f"{bins.t[np.argmax(slope)]:.1f} degC"
    )
    return TemperatureFit(
        ThermalModel(curve, low, high, float(hysteresis.lag), float(hysteresis.play)), bins, residual, rms, kind, **found,
        worst=worst, worst_at=worst_at, grid=grid, error=error, thermometer=given.noise, candidates=candidates, held_out=held_out,
        confidence=float(confidence), warnings=tuple(warnings), notes=(*given.notes, note),
    )  # fmt: skip


def _windows(bins: Bins, residual: AnyArray) -> tuple[float, float, float]:
    """Rms over all, and in the worst window of 1 degC with its centre."""
    centres = np.arange(float(bins.t[0]) + _WINDOW / 2, float(bins.t[-1]) - _WINDOW / 2 + 1e-9, 0.1)
    square = np.concatenate([[0.0], np.cumsum(bins.count * residual**2)])
    count = np.concatenate([[0.0], np.cumsum(bins.count)])
    first, last = (np.searchsorted(bins.t, centres + side * _WINDOW / 2) for side in (-1, 1))
    held = count[last] - count[first]
    mean = np.where(held > 0, (square[last] - square[first]) / np.where(held > 0, held, 1), 0)
    worst = int(np.argmax(mean))
    return float(np.sqrt(square[-1] / count[-1])), float(np.sqrt(mean[worst])), float(centres[worst])


def _elsewhere(bins: Bins, residual: AnyArray, centre: float) -> float:
    away = np.abs(bins.t - centre) > _WINDOW
    return float(np.sqrt(np.average(residual[away] ** 2, weights=bins.count[away]))) if away.any() else np.inf


def _steps(curve: Steps, covariance: AnyArray) -> tuple[Step, ...]:
    first, count = len(curve.base.coefficients), len(curve.centre)
    heights, shapes = np.split(np.sqrt(np.diag(covariance))[first:], [count])
    columns = (curve.centre, curve.width, curve.height, shapes[::2], shapes[1::2], heights)
    return tuple(Step(*map(float, row)) for row in zip(*columns, strict=True))
