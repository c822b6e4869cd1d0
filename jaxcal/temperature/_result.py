"""`TemperatureFit`: a thermal model with its uncertainty and diagnostics."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64
from .._results import Row, Unjudged
from .._types import AnyArray
from ._model import ThermalModel
from ._record import Bins


class Step(eqx.Module):
    """A jump of the bias at a certain temperature of the device.

    Attributes
    ----------
    centre : temperature of the jump, degC.
    width : width parameter w of the logistic function, degC; three quarters of the jump occur within 4 w.
    height : height in the unit of the bias.
    centre_error, width_error, height_error : standard errors of centre, width and height.
    chance : probability that a record without this jump shows an equally clear one at any temperature.

    Examples
    --------
    >>> from jaxcal.temperature import Step
    >>> Step(24.5, 0.05, 5e-3, 0.01, 0.01, 1e-4, 1e-6).height
    0.005
    """

    centre: float
    width: float
    height: float
    centre_error: float
    width_error: float
    height_error: float
    chance: float


class Candidate(eqx.Module):
    """A model structure that was compared with others.

    Attributes
    ----------
    name : "none", "lag", "play", "rate" or a combination; for a scale factor, the polynomial.
    score : penalised -2 log likelihood (BIC for a scale factor) minus that of the chosen structure.
    chosen : True for the chosen structure.

    Examples
    --------
    >>> from jaxcal.temperature import Candidate
    >>> Candidate("lag", 3.2).chosen
    False
    """

    name: str = eqx.field(static=True)
    score: float
    chosen: bool = eqx.field(static=True, default=False)


class TemperatureFit(Unjudged):
    """Bias of one channel as a function of temperature, with its uncertainty.

    `interval_at` gives the interval of the curve, relative to the mean noise of the record. `prediction_at` gives the interval of readings
    in the next cycle, including the bias drift until then.

    Attributes
    ----------
    model : `ThermalModel` with `bias_at` and `correct`.
    kind : "smooth", "polynomial", "table", or the class name of your own curve.
    degree : degree of a polynomial; None for other models.
    coefficients, coefficient_error : (degree + 1,) a1, a2, ... of the powers of T in degC, equation (5.3) of the thesis, and their
        standard errors; None for other models. Above degree 5 they alternate in sign and nearly cancel, so use `model` instead.
    steps : tuple of `Step`, sorted by temperature.
    parameters : name -> (value, standard error): parameters of your own curve, or the estimated lag, play and rate.
    noise : `jaxcal.noise.Noise` with the N, B and K estimated together with the curve; None if the times are unknown.
    rms, worst, worst_at : rms residual of the means over 0.1 degC over the whole range; the same in the worst window of 1 degC; and the
        centre of this window, degC. `rms` alone hides a misfit at a jump.
    grid, error : (bins,) temperatures, degC, and the standard error of the curve there.
    bins : the fitted `Bins`, over the effective temperature. residual : (bins,) mean biases of the bins minus the curve.
    next_error : (bins,) standard deviation of the mean reading over 0.1 degC in the next cycle about the curve.
    level : (standard deviation of the level of the next cycle, its degrees of freedom), from the levels of several records.
    thermometer : standard deviation of the thermometer's noise, degC.
    candidates : tuple of `Candidate`, the structures compared by likelihood; empty if there was no choice.
    confidence : level of `interval_at` and `prediction_at`.
    warnings, notes : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(jump=0.0)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time, model="polynomial", degree=3)
    >>> low, high = found.interval_at(np.array([30.0]))
    >>> found.kind, bool(low[0] < high[0])
    ('polynomial', True)
    """

    model: ThermalModel
    bins: Bins
    residual: AnyArray
    rms: Any
    kind: str = eqx.field(static=True)
    degree: Any = None
    coefficients: Any = None
    coefficient_error: Any = None
    steps: tuple[Step, ...] = ()
    parameters: dict[str, tuple[float, float]] = eqx.field(default_factory=dict)
    worst: Any = None
    worst_at: Any = None
    grid: Any = None
    error: Any = None
    next_error: Any = None
    level: tuple[float, int] = eqx.field(static=True, default=(0.0, 0))
    noise: Any = None
    thermometer: Any = None
    candidates: tuple[Candidate, ...] = ()
    confidence: float = eqx.field(static=True, default=0.95)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    notes: tuple[str, ...] = eqx.field(static=True, default=())

    _figure = ("temperature", False)

    def _rows(self) -> list[Row]:
        z = scipy.special.ndtri(0.5 + self.confidence / 2)
        known = () if self.coefficients is None else enumerate(zip(self.coefficients, self.coefficient_error, strict=True), 1)
        rows = [Row(f"a{i}", value, value - z * error, value + z * error, f"unit/degC^{i - 1}") for i, (value, error) in known]
        rows += [Row(name, value, value - z * error, value + z * error) for name, (value, error) in self.parameters.items()]
        for step in self.steps:
            half = z * step.height_error
            rows.append(Row(f"jump at {step.centre:.2f} degC", step.height, step.height - half, step.height + half, "unit"))
        return [*rows, Row("rms residual", self.rms, unit="unit"), Row(f"rms at {self.worst_at:.1f} degC", self.worst, unit="unit")]

    @host_float64
    def interval_at(self, temperature: Any) -> tuple[AnyArray, AnyArray]:
        """Limits of the confidence interval of the curve at steady temperatures (n,) or (), degC, at level `confidence`."""
        t = np.clip(np.asarray(temperature, dtype=float), self.model.low, self.model.high)
        value = np.asarray(self.model.curve.value(t))
        half = scipy.special.ndtri(0.5 + self.confidence / 2) * np.interp(t, self.grid, self.error)
        return np.asarray(value - half), np.asarray(value + half)

    @host_float64
    def prediction_at(self, temperature: Any) -> tuple[AnyArray, AnyArray]:
        """Limits of the prediction interval of mean readings over 0.1 degC in the next cycle, at temperatures (n,) or (), degC.

        After one record, the next cycle is a repetition without a pause, during which the bias continues to drift with B and K. After
        several records, it is another cycle of the same kind, whose level scatters as their levels do (Student's t).

        Raises
        ------
        DataError
            For a scale factor, which has no next cycle.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> made = jaxcal.temperature.simulate(jump=0.0)
        >>> low, high = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time).prediction_at(np.array([30.0]))
        >>> bool(low < jaxcal.temperature.reference_bias(np.array([30.0]), jump=0.0) < high)
        True
        """
        if self.next_error is None:
            raise DataError("a scale factor has no prediction of the next cycle; use interval_at")
        t = np.clip(np.asarray(temperature, dtype=float), self.model.low, self.model.high)
        value, tail = np.asarray(self.model.curve.value(t)), 0.5 + self.confidence / 2
        half = scipy.special.ndtri(tail) * np.interp(t, self.grid, self.next_error)
        spread, freedom = self.level
        half = np.hypot(half, scipy.special.stdtrit(freedom, tail) * spread) if freedom else half
        return np.asarray(value - half), np.asarray(value + half)
