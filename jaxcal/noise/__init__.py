"""Noise of a sensor at rest: a model of it, simulated records, and its coefficients fitted to a record."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._axes import correlation as correlation
    from ._binned import log_likelihood as log_likelihood
    from ._compare import compare as compare
    from ._covariance import allan_covariance as allan_covariance
    from ._discrete import StateSpace as StateSpace, discrete as discrete
    from ._fit import characterise as characterise, fit as fit
    from ._means import mean_covariance as mean_covariance
    from ._model import Noise as Noise
    from ._overbound import overbound as overbound
    from ._recordings import fit_recordings as fit_recordings
    from ._result import NoiseFit as NoiseFit, NoiseFits as NoiseFits
    from ._terms import Block as Block, GaussMarkov as GaussMarkov, Term as Term

install(__name__, {
    "_axes": "correlation", "_binned": "log_likelihood", "_compare": "compare", "_covariance": "allan_covariance",
    "_discrete": "StateSpace discrete", "_fit": "characterise fit", "_means": "mean_covariance", "_model": "Noise",
    "_overbound": "overbound", "_recordings": "fit_recordings", "_result": "NoiseFit NoiseFits", "_terms": "Block GaussMarkov Term",
})  # fmt: skip
