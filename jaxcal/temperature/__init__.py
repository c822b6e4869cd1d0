"""Thermal models of sensor biases: smooth curves, jumps, hysteresis, polynomials, tables."""

from ._curves import AbstractCurve as AbstractCurve, Chebyshev as Chebyshev, Piecewise as Piecewise, Steps as Steps
from ._estimate import residuals as residuals, scale_factor as scale_factor
from ._fit import fit as fit
from ._hysteresis import lagged as lagged, played as played
from ._log import characterise as characterise, thermometer as thermometer
from ._model import ClampWarning as ClampWarning, ThermalModel as ThermalModel
from ._record import Bins as Bins, binned as binned
from ._result import Candidate as Candidate, Step as Step, TemperatureFit as TemperatureFit
from ._simulate import Simulated as Simulated, reference_bias as reference_bias, simulate as simulate
