"""Thermal models of sensor biases: smooth curves, jumps, hysteresis, polynomials, tables."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._curves import AbstractCurve as AbstractCurve, Chebyshev as Chebyshev, Piecewise as Piecewise, Steps as Steps
    from ._estimate import residuals as residuals, scale_factor as scale_factor
    from ._fit import fit as fit
    from ._hysteresis import lagged as lagged, played as played
    from ._log import characterise as characterise, thermometer as thermometer
    from ._model import ClampWarning as ClampWarning, ThermalModel as ThermalModel
    from ._record import Bins as Bins, binned as binned
    from ._result import Candidate as Candidate, Step as Step, TemperatureFit as TemperatureFit, TemperatureFits as TemperatureFits
    from ._simulate import Simulated as Simulated, reference_bias as reference_bias, simulate as simulate

install(
    __name__,
    {
        "_curves": "AbstractCurve Chebyshev Piecewise Steps",
        "_estimate": "residuals scale_factor",
        "_fit": "fit",
        "_hysteresis": "lagged played",
        "_log": "characterise thermometer",
        "_model": "ClampWarning ThermalModel",
        "_record": "Bins binned",
        "_result": "Candidate Step TemperatureFit TemperatureFits",
        "_simulate": "Simulated reference_bias simulate",
    },
)
