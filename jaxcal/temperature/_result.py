"""`TemperatureFit`: a thermal model with what is known about it."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy.special

from .._precision import host_float64
from .._results import Row, Unjudged
from .._types import AnyArray
from ._model import ThermalModel
from ._record import Bins


class Step(eqx.Module):
    """A jump of the bias at a temperature: a property of the device.

    Attributes
    ----------
    centre : temperature of the jump, degC.
    width : the logistic function's own width, degC: four of them hold three quarters of the jump.
    height : in the unit of the bias.
    centre_error, width_error, height_error : standard errors of the three.
    """

    centre: float
    width: float
    height: float
    centre_error: float
    width_error: float
    height_error: float


class Candidate(eqx.Module):
    """A model that was compared.

    Attributes
    ----------
    name : of the model.
    score : mean squared error on held-out data, in the unit of the bias squared.
    error : standard error of the score.
    chosen : whether it was taken.
    """

    name: str = eqx.field(static=True)
    score: float
    error: float
    chosen: bool = eqx.field(static=True, default=False)


class TemperatureFit(Unjudged):
    """Bias of one channel against temperature, with its uncertainty.

    The intervals hold for the bias of this record. What the sensor wanders between two records, as by its rate random walk or from
    one turn-on to the next, comes on top, nearly as a constant.

    Attributes
    ----------
    model : `ThermalModel` with `bias_at` and `correct`.
    kind : "polynomial", "table", "pchip", "spline" or "steps".
    degree : of the polynomial, or of that under the steps; None for the others.
    coefficients, coefficient_error : (degree + 1,) a1, a2, ... of the powers of T in degC, equation (5.3) of the thesis, and their
        standard errors; None for other models. Above degree 5 they are numbers of alternating sign that nearly cancel: use `model`.
    steps : tuple of `Step`.
    parameters : numbers of a curve that was given to `fit`, by name, with their standard errors.
    rms, worst, worst_at : rms residual of the means over 0.1 degC: over all the range, and in the worst window of 1 degC, whose centre
        is `worst_at` (degC). The first alone hides a failure at a jump.
    grid, error : (bins,) temperatures, degC, and the standard error of the curve there.
    bins : `Bins` that were fitted, over the effective temperature; `residual` (bins,) what is left of them.
    thermometer : standard deviation of the thermometer's noise, degC.
    candidates : tuple of `Candidate`, the choice by held-out data; empty where nothing was chosen. `held_out`: "blocks" or "ramps".
    confidence : level of `interval_at`.
    warnings, notes : sentences.
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
    thermometer: Any = None
    candidates: tuple[Candidate, ...] = ()
    held_out: str = eqx.field(static=True, default="")
    confidence: float = eqx.field(static=True, default=0.95)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    notes: tuple[str, ...] = eqx.field(static=True, default=())

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
        """Ends of the interval of the curve at steady temperatures (n,) or (), degC, at level `confidence`."""
        t = np.clip(np.asarray(temperature, dtype=float), self.model.low, self.model.high)
        value = np.asarray(self.model.curve.value(t))
        half = scipy.special.ndtri(0.5 + self.confidence / 2) * np.interp(t, self.grid, self.error)
        return np.asarray(value - half), np.asarray(value + half)
