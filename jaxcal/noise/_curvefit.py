r"""Methods "gls", "log" and "slope", which fit an Allan deviation curve; for comparison with other work, on the host only.

With v the squares of the deviation, and A the exact Allan variances of the terms per squared coefficient theta:

- gls: :math:`\min_{\theta \ge 0} (v - A\theta)'\,C(\theta)^{-1}(v - A\theta)`, iterated, with the full covariance across cluster times,
  :math:`C(\theta) = \sum_{ij}\theta_i\theta_j T_{ij}` (`covariance_tensor`). Intervals are those of the normal law of theta.
- log: :math:`\min_{\theta \ge 0} \sum (\ln A\theta - \ln v)^2`. All cluster sizes count alike, however well they are known, so that B and K
  scatter by 30 to 40 % where weights give 11 and 23 %, and absent terms come out positive.
- slope: tangents of slope -1, -1/2, +1/2 and +1 (Q, N, K and R), drawn where the slope of the curve is nearest to theirs and read at
  tau = sqrt 3, 1, 3 and sqrt 2 s. B is the minimum of the deviation divided by 0.664 (thesis, section 5.4.4; IEEE Std 952-1997, annex C).
  Tangents blame one term for what several add up to: B comes out about 44 % too high on a gyroscope with N, B and K.

For log and slope no valid error propagation exists: intervals, limits and the covariance are unknown.
"""

import math
from typing import NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError, FitError
from .._frozen import replaced
from .._message import Message
from .._types import AnyArray
from ..allan import Deviation
from ..allan._uncertainty._edf import interval_factors
from ._covariance import covariance_tensor
from ._findings import FINDINGS, of_model
from ._likelihood import Limits, chance, inverse, levels_of
from ._record import Asked, Record
from ._result import NoiseFit, assemble, with_edf
from ._terms import Term

#: term -> slope in log-log, time in s at which its tangent is read, and the local slope that the curve must go below (rising: above)
#: for the term to be reported
_TANGENTS = {"Q": (-1.0, math.sqrt(3.0), -0.75), "N": (-0.5, 1.0, math.inf), "K": (0.5, 3.0, 0.25), "R": (1.0, math.sqrt(2.0), 0.75)}
_WIDENED = 0.01  # chance of a worse chi-square below which the intervals of gls are widened to the observed scatter
#: steps of an iteration, and the relative change of the modelled variance at which it ends; what keeps a correlation matrix invertible
_STEPS, _SETTLED, _RIDGE = 200, 1e-12, 1e-8


class _Curve(NamedTuple):
    """Variances v, columns A and tensor T."""

    v: AnyArray
    columns: AnyArray
    tensor: AnyArray


def fit_curves(record: Record, asked: Asked) -> list[NoiseFit]:
    """Fit the overlapped Allan deviation of each channel by the method asked for."""
    found = []
    for y, name in zip(record.channels, record.names, strict=True):
        try:
            wait, inside = asked.begin(y)
            curve = wait()
            inside = inside[np.isin(asked.m, curve.m)]  # gaps may leave no difference at the largest cluster sizes
            found.append(fit_deviation(curve, len(y), asked.terms, inside, asked.method, asked.confidence))
        except DataError as error:
            raise error.of(name) from None
    return found


def fit_deviation(curve: Deviation, samples: int, terms: tuple[Term, ...], inside: AnyArray, method: str, confidence: float) -> NoiseFit:
    """Fit the cluster sizes `inside` of a curve."""
    data, used, unit = _curve_of(curve, samples, terms, inside)
    if method == "gls":
        return _jointly(curve, data, used, unit, samples, terms, confidence)
    theta = _logarithmic(data, used) * unit if method == "log" else _tangents(curve, terms, used)
    chi, _, _ = _chi_square(data, used, theta / unit)
    unknown = np.full((len(terms), len(terms)), np.nan)
    return assemble(
        theta, unknown, None, terms, curve, samples / curve.rate, goodness=chance(chi, _freedom(used, theta)), used=inside,
        confidence=confidence, method=method, band=(np.min(curve.tau[inside]), np.max(curve.tau[inside])),
        findings=(*getattr(curve, "findings", ()), FINDINGS("no_intervals", method=method)),
    )  # fmt: skip


def _curve_of(curve: Deviation, samples: int, terms: tuple[Term, ...], inside: AnyArray) -> tuple[_Curve, AnyArray, float]:
    """The curve in units of its largest variance, which cluster sizes have a variance, and that unit."""
    v, dt = np.asarray(curve.deviation) ** 2, 1.0 / curve.rate
    used = inside & (v > 0.0)
    unit = float(np.max(v[used]))
    columns = np.stack([np.asarray(term.avar(curve.tau, dt)) for term in terms], axis=1)
    loss = np.sqrt(1.0 + curve.skipped / curve.count)  # gaps leave fewer differences
    tensor = covariance_tensor(samples, tuple(int(m) for m in curve.m), dt, terms) * np.outer(loss, loss)
    return _Curve(np.where(used, v / unit, 1.0), columns, tensor), used, unit


def _jointly(curve: Deviation, data: _Curve, used: AnyArray, unit: float, samples: int, terms, confidence: float):
    relative, spread, misfit, settled = _fixed_point(data, used)
    theta, covariance, freedom = relative * unit, spread * unit**2, _freedom(used, relative)
    if not np.all(np.isfinite(theta)):
        raise FitError(Message("the fit gave no finite coefficients; give fewer {option.terms} or another {option.band}"))
    goodness = chance(misfit, freedom)
    inflation = max(misfit / freedom, 1.0) if goodness < _WIDENED else 1.0
    covariance = covariance * inflation
    fit = assemble(
        theta, covariance, _limits_of(theta, covariance, confidence), terms, curve, samples / curve.rate, goodness=goodness,
        used=used, confidence=confidence, method="gls", band=(np.min(curve.tau[used]), np.max(curve.tau[used])), findings=(
            *getattr(curve, "findings", ()), *of_model(inflation, None), *(() if settled else (FINDINGS("unsettled"),)),
        ),
    )  # fmt: skip
    variance = np.diagonal(_covariance(data, theta / unit))
    edf = 2.0 * (data.columns @ theta / unit) ** 2 / np.where(used & (variance > 0.0), variance, 1.0)
    return replaced(fit, deviation=with_edf(curve, used, edf))


def _limits_of(theta: AnyArray, covariance: AnyArray, confidence: float) -> Limits:
    """Limits of a normal law downwards; upwards at least those of a chi-square of the same relative error, which is skewed."""
    error = np.sqrt(np.diagonal(covariance))
    both, one = (error * np.sqrt(level) for level in levels_of(confidence))
    edf = np.maximum(2.0 * theta**2 / np.where(error > 0.0, error, np.inf) ** 2, 1.0)
    (_, skewed), (_, one_sided) = (interval_factors(edf, level) for level in (confidence, 2.0 * confidence - 1.0))
    high, upper = np.maximum(theta + both, theta * skewed**2), np.maximum(theta + one, theta * one_sided**2)
    return Limits(np.maximum(theta - both, 0.0), high, upper, (theta / np.where(error > 0.0, error, np.inf)) ** 2)


def _covariance(data: _Curve, theta: AnyArray) -> AnyArray:
    return np.einsum("i,ijmn,j->mn", theta, data.tensor, theta)


def _chi_square(data: _Curve, used: AnyArray, theta: AnyArray) -> tuple[float, AnyArray, AnyArray]:
    """Chi-square of the curve with the covariance at theta; and the whitened rows and values."""
    c = _covariance(data, theta)[np.ix_(used, used)]
    scale = np.sqrt(np.where(np.diagonal(c) > 0.0, np.diagonal(c), 1.0))
    root = np.linalg.cholesky(c / np.outer(scale, scale) + _RIDGE * np.eye(len(c)))
    rows = np.linalg.solve(root, np.column_stack([data.columns, data.v])[used] / scale[:, None])
    return float(np.sum((rows[:, -1] - rows[:, :-1] @ theta) ** 2)), rows[:, :-1], rows[:, -1]


def _freedom(used: AnyArray, theta: AnyArray) -> float:
    return max(float(np.sum(used) - np.sum(theta != 0.0)), 1.0)


def _fixed_point(data: _Curve, used: AnyArray) -> tuple[AnyArray, AnyArray, float, bool]:
    """Coefficients, covariance and misfit at the fixed point of the weights, and whether it was reached."""
    theta = scipy.optimize.nnls(data.columns[used] / data.v[used, None], np.ones(np.sum(used)))[0]
    settled = False
    for _ in range(_STEPS):
        _, rows, target = _chi_square(data, used, theta)
        new = scipy.optimize.nnls(rows, target)[0]
        before, after = data.columns[used] @ theta, data.columns[used] @ new
        # half steps, because whole ones may oscillate; the last is whole, so that coefficients that tend to zero become zero
        settled = bool(np.max(np.abs(after - before) / np.abs(after)) < _SETTLED)
        theta = new if settled else 0.5 * (theta + new)
        if settled:
            break
    misfit, rows, _ = _chi_square(data, used, theta)
    return theta, inverse(rows.T @ rows), misfit, settled


def _logarithmic(data: _Curve, used: AnyArray) -> AnyArray:
    """Squared coefficients by least squares on the logarithms: Gauss and Newton, with shorter steps where the sum does not fall."""
    columns, v = data.columns[used], data.v[used]

    def cost_of(theta: AnyArray) -> float:
        return float(np.sum(np.log(np.maximum(columns @ theta, np.finfo(float).tiny) / v) ** 2))

    theta = scipy.optimize.nnls(columns / v[:, None], np.ones(len(v)))[0]
    cost = cost_of(theta)
    for _ in range(_STEPS):
        model = columns @ theta
        wanted, step = scipy.optimize.nnls(columns / model[:, None], np.log(v / model) + 1.0)[0], 1.0
        while (new := cost_of(theta + step * (wanted - theta))) > cost and step > _SETTLED:
            step *= 0.5
        if new > cost:
            break
        change = np.max(np.abs(columns @ (wanted - theta)) / model)
        theta, cost = theta + step * (wanted - theta), new
        if change < _SETTLED:
            break
    return theta


def _tangents(curve: Deviation, terms: tuple[Term, ...], use: AnyArray) -> AnyArray:
    """Squared coefficients from the tangents and the minimum of the curve."""
    tau, ad = curve.tau[use], np.asarray(curve.deviation)[use]
    slope = np.gradient(np.log(ad), np.log(tau))
    index, lowest = np.arange(len(tau)), int(np.argmin(ad))
    values = {"B": ad[lowest] / 0.664}
    for term, (wanted, time, least) in _TANGENTS.items():
        side = index <= lowest if wanted < 0 else index > lowest
        at = int(np.argmin(np.where(side, np.abs(slope - wanted), np.inf)))
        seen = side[at] and (slope[at] < least if wanted < 0 else slope[at] > least)
        values[term] = ad[at] * (time / tau[at]) ** wanted if seen else 0.0
    if unknown := [term.name for term in terms if term.name not in values]:
        raise DataError(f"method 'slope' reads tangents of Q, N, B, K and R; {', '.join(unknown)} has none: take another method")
    return np.array([values[term.name] for term in terms]) ** 2
