"""Noise model, simulation and fit."""

from ._axes import Correlation as Correlation, correlation as correlation
from ._covariance import allan_covariance as allan_covariance
from ._discrete import StateSpace as StateSpace, discrete as discrete
from ._fit import characterise as characterise, fit as fit
from ._likelihood import log_likelihood as log_likelihood
from ._means import mean_covariance as mean_covariance
from ._model import Noise as Noise
from ._overbound import overbound as overbound, overbound_curve as overbound_curve
from ._recordings import RecordingsFit as RecordingsFit, fit_recordings as fit_recordings
from ._result import FittedSpectrum as FittedSpectrum, NoiseFit as NoiseFit
from ._terms import Block as Block, GaussMarkov as GaussMarkov, PowerLaw as PowerLaw, Term as Term
