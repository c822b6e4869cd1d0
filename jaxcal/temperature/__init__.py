"""Thermal models of sensor biases: smooth curves, jumps, hysteresis, polynomials, tables."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._curves import AbstractCurve as AbstractCurve, Chebyshev as Chebyshev, Piecewise as Piecewise, Steps as Steps
    from ._estimate import residuals as residuals
    from ._fit import fit as fit
    from ._log import characterise as characterise, thermometer as thermometer
    from ._model import ClampWarning as ClampWarning, ThermalModel as ThermalModel
    from ._result import Step as Step, TemperatureFit as TemperatureFit, TemperatureFits as TemperatureFits
    from ._simulate import reference_bias as reference_bias, simulate as simulate

install(
    __name__,
    {
        "_curves": "AbstractCurve Chebyshev Piecewise Steps",
        "_estimate": "residuals",
        "_fit": "fit",
        "_log": "characterise thermometer",
        "_model": "ClampWarning ThermalModel",
        "_result": "Step TemperatureFit TemperatureFits",
        "_simulate": "reference_bias simulate",
    },
)
