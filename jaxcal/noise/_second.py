"""The second opinion: generalised least squares on the Allan deviation, beside the likelihood fit of the same record."""

import dataclasses

import numpy as np
import scipy.optimize

from ._agreement import sentences_of_difference
from ._covariance import covariance, covariance_tensor
from ._model import Noise, noise_of
from ._result import NoiseFit

_LEFT = 0.1  # share of the Allan variance that must be left when lines are taken from it


def with_second_opinion(found: NoiseFit, samples: int) -> NoiseFit:
    """The fit with the coefficients that generalised least squares finds on the same band, and a warning where they disagree.

    The covariance across tau is that of the fitted model. Lines and Gauss-Markov processes are taken from the curve first. In a
    band that was cut, a tail of slope -1 takes the place of Q.
    """
    curve, names = found.deviation, tuple(term for term in found.terms if term != "markov")
    terms = tuple(term for _, _, term in (found.noise.part(name) for name in names))
    dt = 1.0 / curve.rate
    beside, v = Noise(markov=found.noise.markov, sinusoid=found.noise.sinusoid), curve.deviation**2
    if beside.markov or beside.sinusoid:
        v = v - np.asarray(beside.avar(curve.tau, dt=dt))
    kept = found.used & (v > _LEFT * curve.deviation**2)
    if kept.sum() <= len(names) + 1:
        note = "no second opinion: too few cluster times are left in the band, or lines make up most of the Allan variance"
        return dataclasses.replace(found, notes=(*found.notes, note))
    cut = not found.used[0] and "Q" in names
    columns = np.stack([term.avar(curve.tau, dt) for term in terms], axis=1)
    if cut:
        columns[:, names.index("Q")] *= -1.0  # what a filter leaves: the shape of Q, with the other sign
    theta = np.array([float(np.asarray(found.noise.coefficient(name))) ** 2 for name in names])
    c = covariance(covariance_tensor(samples, tuple(int(m) for m in curve.m), dt, terms), theta)
    share = np.sqrt(curve.count / (curve.count + curve.skipped))
    c = (c / share[:, None] / share[None, :])[np.ix_(kept, kept)]
    scale = np.sqrt(np.diagonal(c))
    factor = np.linalg.cholesky(c / scale[:, None] / scale[None, :] + 1e-8 * np.eye(len(scale)))
    a, b = (np.linalg.solve(factor, x) for x in (columns[kept] / scale[:, None], v[kept] / scale))
    unit = np.linalg.norm(a, axis=0)
    squares = scipy.optimize.nnls(a / unit, b)[0] / unit
    spread = np.linalg.inv((a / unit).T @ (a / unit)) / unit[:, None] / unit[None, :]
    if cut:
        squares[names.index("Q")] = 0.0
    other = noise_of(terms, np.sqrt(squares).tolist())
    said = sentences_of_difference(found, other, dict(zip(names, np.sqrt(np.diagonal(spread)), strict=True)))
    return dataclasses.replace(found, other=other, warnings=(*found.warnings, *said))
