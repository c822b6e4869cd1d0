"""`fit`: fit a thermal model to one channel."""

from typing import Any

import jax
import numpy as np

from .._answer import Finding, Message, Quantity
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import AnyArray, Checked, Real, Samples
from .._units import si_unit_of
from ..fitting import Estimate, Fit
from ._auto import choose, curve_of, design_of, next_variance
from ._curves import AbstractCurve, Chebyshev
from ._design import Design, Form
from ._estimate import fitted, traced
from ._findings import FINDINGS
from ._linear import basis, polynomial_curve, powers, table_curve
from ._model import ThermalModel
from ._prior import DEGREE
from ._record import COARSE, FINE, Bins, Record, binned, number, record
from ._result import TemperatureFit, no_estimate
from ._structure import settled

MODELS = ("auto", "polynomial", "table")


@host_float64
def fit(
    temperature: Samples, bias: Samples, *, model: Checked[str | ThermalModel | AbstractCurve | type[AbstractCurve]] = "auto",
    degree: int | None = None, time: Samples | None = None, lag: Checked[Real | str] | None = None,
    play: Checked[Real | str] | None = None, sensor: str = "", confidence: float = 0.95,
) -> Any:  # fmt: skip
    r"""Fit the bias of a sensor at rest as a function of its temperature: a smooth curve, jumps, hysteresis and noise.

    .. math:: b = \sum_m q_m C_m(u) + \sum_j \frac{p_j}{1 + e^{-(T_e - t_j)/w_j}} + c\,L_{\tau'}(\dot T) + n(t),\qquad
        q \sim N(0, \sigma^2 F_\ell F_\ell^T)

    C_m is a Chebyshev polynomial of the temperature at the sensor, scaled to -1 .. 1, and n is noise with N, B and K. F F' is the
    covariance that a Matern Gaussian process (smoothness 7/2, length ell) implies for all coefficients but the slope. The restricted
    likelihood estimates N, B, K, sigma and ell together, so the data determine how flexible the curve is. Curve and intervals are
    averages over the uncertainty of these parameters. The likelihood also decides on lag, play, the term in dT/dt and the jumps. Fewer
    than one in 300 records without a jump shows one.

    Parameters
    ----------
    temperature : (n,) degC, in time order; or a list of such arrays, one for each record (cycle).
    bias : (n,) readings at rest, any unit, or a list of such arrays; rows that are not numbers are left out, with a warning.
    model : "auto", the model above; "polynomial" of a given degree; "table", means over 0.25 degC with linear interpolation. Or your own
        `AbstractCurve`, as an instance or as a class with defaults, or a `ThermalModel` with one: the search begins at its numbers, and
        fits all of them except `low`, `high` and `nodes`.
    degree : degree of the polynomial.
    time : (n,) s, or a list of such arrays. With times the record is averaged to seconds, and a lag and a term in dT/dt can be estimated.
    lag : time constant in s with which the sensor follows the thermometer: a number, or "auto" to estimate it. None means "auto" with
        model="auto" and 0 with the other models. An estimate needs both heating and cooling.
    play : half-width in degC of the backlash between thermometer and sensor; a number, "auto" or None, as for `lag`.
    sensor : "gyro", "accel" or "mag" for readings in SI, which are then shown with their unit.
    confidence : level of the intervals.

    Returns
    -------
    TemperatureFit
        A traced call (with a polynomial of given degree, a table or a curve, and lag and play as numbers) returns only model, bins and
        residuals, and does not average or clean the record.

    Raises
    ------
    DataError
        If array lengths differ, the temperature covers less than 2 degC or fills less than 10 bins of 0.1 degC, or an option is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(seed=1)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time)
    >>> found.kind, round(found.steps[0].centre, 1), round(float(np.rad2deg(found.steps[0].height)), 2)
    ('smooth', 24.5, 0.3)

    References
    ----------
    The thesis, equation (5.3) and section 7.1 (polynomials); H. D. Patterson and R. Thompson, Biometrika 58 (1971) 545 (restricted
    likelihood); R. B. Davies, Biometrika 64 (1977) 247 (chance of a jump).
    """
    model = model() if isinstance(model, type) else model
    if isinstance(model, ThermalModel):
        lag, play, model = model.lag if lag is None else lag, model.play if play is None else play, model.curve
    if sensor not in ("", "gyro", "accel", "mag"):
        raise DataError(f"sensor={sensor!r}; expected gyro, accel or mag", code="sensor")
    quantity = f"B.{sensor}" if sensor else ""
    several = isinstance(temperature, (list, tuple)) and len(temperature) > 0 and np.ndim(temperature[0]) == 1
    if not several and is_traced(temperature, bias, time, model, lag, play):
        return traced(temperature, bias, model, degree, time, 0.0 if lag is None else lag, 0.0 if play is None else play, quantity)
    slow, slack = _check(model, degree, lag, play, confidence, time)
    records = _records(temperature, bias, time) if several else [record(temperature, bias, time)]
    auto = isinstance(model, str) and model == "auto"
    if not auto and several:
        raise DataError(Message("{count} records need {option.model:auto}; or join them", count=len(records)), code="one_record")
    design = design_of(records, smooth=auto)
    given = Form(lag=0.0 if slow == "auto" else float(slow), play=0.0 if slack == "auto" else float(slack))
    if auto:
        return _smooth(design, records, given, (slow, slack), float(confidence), quantity)
    return _given(model, degree, design, records[0], given, float(confidence), quantity)


def _check(model: Any, degree: Any, lag: Any, play: Any, confidence: float, time: Any) -> tuple[Any, Any]:
    if (name := model if isinstance(model, str) else "") not in MODELS and not isinstance(model, AbstractCurve):
        raise DataError(f"unknown model {model!r}; expected one of {', '.join(MODELS)}, or a curve", code="model")
    auto = name == "auto"
    if (name == "polynomial") != (degree is not None):
        said = "{option.model:polynomial} and {option.degree} go together; {option.model:auto} has as much freedom as the data support"
        raise DataError(Message(said), code="degree")
    if degree is not None and (not isinstance(degree, (int, np.integer)) or isinstance(degree, bool) or not 0 <= degree <= DEGREE):
        said = "{option.degree:{degree}}: expected a whole number from 0 to {cap}"
        raise DataError(Message(said, degree=degree, cap=DEGREE), code="degree")
    if not 0 < confidence < 1:
        raise DataError(Message("{option.confidence:{level:g}}: expected a level between 0 and 1", level=confidence), code="confidence")
    checked = []
    for name, value in (("lag", lag), ("play", play)):
        value = ("auto" if auto else 0.0) if value is None else value
        number = isinstance(value, (int, float, np.number)) and not isinstance(value, bool) and np.isfinite(value) and value >= 0
        if not number and not (value == "auto" and auto):
            raise DataError(Message(f"{{option.{name}:{value}}}: expected a number, or auto with {{option.model:auto}}"), code=name)
        checked.append(value)
    if checked[0] != "auto" and checked[0] > 0 and time is None:
        raise DataError(Message("a lag needs the times of the samples: give {option.time}"), code="no_time")
    return checked[0], checked[1]


def _records(temperature: Any, bias: Any, time: Any) -> list[Record]:
    """The checked records."""
    count = len(temperature)
    for name, values in (("bias", bias), ("time", time)):
        if values is not None and (not isinstance(values, (list, tuple)) or len(values) != count):
            raise DataError(f"temperature is a list of {count} records; expected {name} to be a list of as many", code=name)
    records = []
    for i in range(count):
        try:
            records.append(record(temperature[i], bias[i], None if time is None else time[i]))
        except DataError as error:
            raise error.of(f"record {i}") from None
    return records


def _smooth(design: Design, records: list[Record], given: Form, asked: tuple[Any, Any], confidence: float, quantity: str) -> TemperatureFit:
    """Fit by the restricted likelihood."""
    timed = all(one.time is not None for one in records)
    both = any(len(np.unique(one.ramp)) > 1 for one in records) or len({bool(one.t[-1] > one.t[0]) for one in records}) > 1
    # a single ramp cannot separate effects of temperature and time
    searched = [name for name, value in zip(("lag", "play"), asked, strict=True) if value == "auto" and (timed or name == "play")]
    searched = [*searched, *(["rate"] if timed else [])] if both else []
    thermometer = float(np.median([one.noise for one in records]))
    chosen, unsure = choose(design, given, tuple(searched), thermometer)
    common = [FINDINGS("lag_or_play")] if unsure else []
    if asked[0] == "auto" and both and not timed:
        common.append(FINDINGS("untimed"))
    units = {"rate": f"{si_unit_of(quantity)} s/degC".strip(), "jump.height": quantity, "jump.centre": "degC", "jump.width": "degC",
             "lag": "time", "rate_lag": "time", "play": "degC"}  # fmt: skip
    fitted_model, t, b, facts = curve_of(design, chosen, thermometer, confidence, units)
    if not timed:
        facts["noise"] = None
    bins = binned(t, b)
    residual = bins.b - np.asarray(fitted_model.curve.value(bins.t))
    rms, worst, worst_at = _windows(bins, residual)
    own = dict.fromkeys(told for each in records for told in each.findings)
    findings = [told for told in own if not both or told.code != "one_way"]
    return TemperatureFit(
        fitted_model, bins, residual, rms, "smooth", quantity, worst=worst, worst_at=worst_at, thermometer=thermometer,
        confidence=confidence, findings=(*findings, *common, *_thermometer(fitted_model.curve, bins, thermometer, rms, quantity)),
        **facts,
    )  # fmt: skip


def _given(model: Any, degree: int | None, design: Design, one: Record, given: Form, confidence: float, quantity: str) -> TemperatureFit:
    """Fit a given form by least squares over bins; the standard errors use the noise estimated about a smooth curve."""
    t, b = design.filtered(given.lag, given.play), design.b
    low, high = float(t.min()), float(t.max())
    bins, findings, own = binned(t, b, low=low), list(one.findings), None
    if degree is not None and degree >= len(bins.t):
        said = "{option.degree:{degree}} needs more than the {bins} bins of 0.1 degC that the record fills; take a lower one"
        raise DataError(Message(said, degree=degree, bins=len(bins.t)), code="degree")
    curve: Any
    if isinstance(model, AbstractCurve):
        own, kind = fitted(model, bins).checked(), type(model).__name__
        curve = jax.tree.map(np.asarray, own.model)
    else:
        kind = model
        curve = polynomial_curve(bins, low, high, degree) if degree is not None else table_curve(binned(t, b, COARSE))
    residual = bins.b - np.asarray(curve.value(bins.t))
    rms, worst, worst_at = _windows(bins, residual)
    grid, rows, gain = _gain(curve, own, bins, t, b, degree, low, high)
    found = settled(design, given)
    restricted = design.restricted(found.form)
    averaged = restricted.averaged(found.phi)
    place = np.unique(number(t, FINE, low), return_inverse=True)[1]
    samples = (gain / bins.count)[:, place]
    white = (np.abs(steepness(curve, bins.t)) * one.noise)[place]
    # leave out the mean of the noise, which cannot be distinguished from the bias
    samples_free = samples - samples.sum(axis=1, keepdims=True) / len(t)
    covariance = design.bands.spread(samples_free, averaged.weight @ averaged.theta) + (samples * white**2) @ samples.T
    error = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", rows, covariance, rows), 0))
    if own is not None:
        estimate = Estimate(own.names, np.asarray(own.parameters), covariance, quantities=dict.fromkeys(own.names, ""))
    else:
        estimate = powers(curve, covariance, quantity) if isinstance(curve, Chebyshev) else no_estimate()
    wander = averaged.theta @ next_variance(place, np.zeros(len(t)), design.dt)
    after = averaged.quantile(wander + np.interp(bins.t, grid, error) ** 2, confidence)
    return TemperatureFit(
        ThermalModel(curve, low, high, given.lag, given.play), bins, residual, rms, kind, quantity, degree, estimate, worst=worst,
        worst_at=worst_at, grid=grid, error=error, next_error=np.interp(grid, bins.t, after),
        noise=None if one.time is None else averaged.noise, thermometer=one.noise, confidence=confidence,
        findings=(*findings, *_thermometer(curve, bins, one.noise, rms, quantity)),
    )  # fmt: skip


def _gain(
    curve: Any, own: Fit | None, bins: Bins, t: AnyArray, b: AnyArray, degree: int | None, low: float, high: float
) -> tuple[AnyArray, AnyArray, AnyArray]:  # fmt: skip
    """Temperatures, derivative of the curve there by its parameters, and derivative of the parameters by the bins."""
    root = np.sqrt(bins.count)
    if own is None and degree is None:
        # a node is the mean of its bins
        nodes = binned(t, b, COARSE)
        share = (np.abs(bins.t[:, None] - nodes.t).argmin(axis=1)[:, None] == np.arange(len(nodes.t))) * bins.count[:, None]
        return nodes.t, np.eye(len(nodes.t)), (share / np.maximum(share.sum(axis=0), 1)).T
    rows = basis(bins.t, low, high, degree or 0) if own is None else own.jacobian / root[:, None]
    return bins.t, rows, np.linalg.pinv(rows * root[:, None]) * root


def steepness(curve: AbstractCurve, t: AnyArray, step: float = 1e-3) -> AnyArray:
    """Derivative df/dT by central differences."""
    return (np.asarray(curve.value(t + step)) - np.asarray(curve.value(t - step))) / (2 * step)


def _thermometer(curve: AbstractCurve, bins: Bins, noise: float, rms: float, quantity: str) -> list[Finding]:
    """What the thermometer's noise adds to a corrected reading, where that is more than the model leaves."""
    adds = np.abs(steepness(curve, bins.t)) * noise
    worst = int(np.argmax(adds))
    if not adds[worst] > rms:
        return []
    return [FINDINGS("thermometer", cost=adds[worst], noise=noise, adds=Quantity(float(adds[worst]), quantity), at=float(bins.t[worst]))]


def _windows(bins: Bins, residual: AnyArray) -> tuple[float, float, float]:
    """Rms of all residuals, and rms and centre of the worst window of a degree, in which users read curves."""
    degree = np.floor(bins.t - bins.t[0]).astype(int)
    square, count = np.bincount(degree, bins.count * residual**2), np.bincount(degree, bins.count)
    mean = square / np.maximum(count, 1)
    worst = int(np.argmax(mean))
    return float(np.sqrt(square.sum() / count.sum())), float(np.sqrt(mean[worst])), float(bins.t[0]) + worst + 0.5
