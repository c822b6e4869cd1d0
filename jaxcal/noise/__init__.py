"""Noise model, simulation and fit."""

from ._fit import characterise as characterise, fit as fit
from ._model import Noise as Noise
from ._result import NoiseFit as NoiseFit
