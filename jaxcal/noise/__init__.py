"""Noise model, simulation and fit."""

from ._model import Noise as Noise
from ._result import NoiseFit as NoiseFit
