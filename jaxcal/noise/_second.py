"""The second opinion: method "gls" on the band of a likelihood fit of the same record."""

import dataclasses

import numpy as np

from ._agreement import sentences_of_difference
from ._allanfit import alone, covariance_of
from ._curve import estimate
from ._joint import curve_of
from ._model import Noise, noise_of
from ._result import NoiseFit

_LEFT = 0.1  # share of the Allan variance that must be left when lines are taken from it


def with_second_opinion(found: NoiseFit, samples: int) -> NoiseFit:
    """The fit with the coefficients that generalised least squares finds on the same band, and a warning where they disagree.

    Lines and Gauss-Markov processes are taken from the curve first. In a band that was cut, a tail of slope -1 takes the place of Q.
    """
    curve, names = found.deviation, tuple(term for term in found.terms if term != "markov")
    terms = tuple(found.noise.part(name)[2] for name in names)
    beside, variance = Noise(markov=found.noise.markov, sinusoid=found.noise.sinusoid), curve.deviation**2
    if beside.markov or beside.sinusoid:
        variance = variance - np.asarray(beside.avar(curve.tau, dt=1.0 / curve.rate))
    kept = found.used & (variance > _LEFT * curve.deviation**2)
    if kept.sum() <= len(terms) + 1:
        note = "no second opinion: too few cluster times are left in the band, or lines make up most of the Allan variance"
        return dataclasses.replace(found, notes=(*found.notes, note))
    data, kept, unit = curve_of(curve, samples, terms, variance, kept)
    lanes = alone(data, kept, np.asarray(not found.used[0]))
    theta, _ = estimate(data, lanes, full=True)
    errors = np.sqrt(np.diagonal(covariance_of(data, lanes, theta[0], True))) * unit
    squares = theta[0, : len(terms)] * unit
    other = noise_of(terms, np.sqrt(squares).tolist())
    said = sentences_of_difference(found, other, dict(zip(names, errors, strict=False)))
    return dataclasses.replace(found, other=other, warnings=(*found.warnings, *said))
