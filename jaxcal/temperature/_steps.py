"""Polynomial of degree 3 with logistic steps, found one by one."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ._curves import Chebyshev, Steps
from ._linear import basis, bic
from ._record import FINE, Bins, binned, number

DEGREE, MOST = 3, 3
_NARROW, _WIDE, _FIRST = 0.01, 3.0, 0.1  # degC: widths allowed, and that with which a step is looked for
_EDGE, _GRID = 0.5, 0.1  # degC: distance of a centre from the ends, and between centres tried
_THIN = 0.02  # degC: bins on which steps are refined
_TALLEST = 1.5  # times the range of the bias
_GAIN = 2.0  # of BIC that a step must bring


def steps_curve(t: AnyArray, b: AnyArray, low: float, high: float) -> Steps:
    """Greedy search: a step is added where it helps most, all steps are refined, and it stays if BIC falls by more than 2.

    The search runs over bins of 0.1 degC, whose number BIC counts. The steps are refined on bins of 0.02 degC: over 0.1 degC the mean
    of a steep curve is not its value at the mean.
    """
    fine = binned(t, b, _THIN, low)
    place = number(fine.t, FINE, low)
    weight, base, y = _weighted(fine, low, high)
    coarse = binned(t, b, FINE, low)
    search = _weighted(coarse, low, high)
    total = np.bincount(place, fine.count)
    there = total > 0
    bins = int(np.count_nonzero(there))

    def fitted(shape: AnyArray) -> tuple[AnyArray, float]:
        design = _design(base, fine.t, weight, shape)
        linear = np.linalg.lstsq(design, y, rcond=None)[0]
        left = np.bincount(place, (y - design @ linear) * weight)[there]
        return linear, bic(float(np.sum(left**2 / total[there])), bins, base.shape[1] + 3 * shape.shape[1])

    centres = np.arange(low + _EDGE, high - _EDGE + 1e-9, _GRID)
    shape = np.zeros((2, 0))
    linear, best = fitted(shape)
    for _ in range(MOST):
        first = [_candidate(*search, coarse.t, shape, centres), np.log(_FIRST)]
        tried = _refined(base, fine.t, weight, y, np.column_stack([shape, first]))
        changed, value = fitted(tried)
        # two steps of one place and opposite signs mend the shape of one, with heights that mean nothing
        if not value < best - _GAIN or np.max(np.abs(changed[base.shape[1] :])) > _TALLEST * np.ptp(coarse.b):
            break
        shape, linear, best = tried, changed, value
    order = np.argsort(shape[0])
    height = linear[base.shape[1] :][order]
    return Steps(Chebyshev(linear[: base.shape[1]], low, high), height, shape[0][order], np.exp(shape[1][order]))


def jacobian(curve: Steps, t: AnyArray, low: float, high: float) -> AnyArray:
    """(n, parameters) derivative by q, p, and then (t_j, w_j) of each step."""
    t = np.asarray(t, dtype=float)
    columns = [*basis(t, low, high, DEGREE).T]
    sigmoid = [_sigmoid(t, c, w) for c, w in zip(curve.centre, curve.width, strict=True)]
    columns += sigmoid
    for s, p, c, w in zip(sigmoid, curve.height, curve.centre, curve.width, strict=True):
        bell = p * s * (1 - s) / w
        columns += [-bell, -bell * (t - c) / w]
    return np.stack(columns, axis=1)


def _sigmoid(t: AnyArray, centre: Any, width: Any) -> AnyArray:
    return 1 / (1 + np.exp(np.clip((centre - t) / width, -50.0, 50.0)))


def _design(base: AnyArray, t: AnyArray, weight: AnyArray, shape: AnyArray) -> AnyArray:
    return np.column_stack([base, *(weight * _sigmoid(t, centre, np.exp(log)) for centre, log in shape.T)])


def _weighted(bins: Bins, low: float, high: float) -> tuple[AnyArray, AnyArray, AnyArray]:
    """Square roots of the counts, and polynomials and data times these."""
    weight = np.sqrt(bins.count)
    return weight, basis(bins.t, low, high, DEGREE) * weight[:, None], bins.b * weight


def _candidate(weight: AnyArray, base: AnyArray, y: AnyArray, t: AnyArray, shape: AnyArray, centres: AnyArray) -> float:
    """Centre of the new step that lowers the sum of squares most, the linear coefficients following."""
    inside = np.linalg.qr(_design(base, t, weight, shape))[0]
    tried = weight[:, None] * _sigmoid(t[:, None], centres, _FIRST)
    tried = tried - inside @ (inside.T @ tried)
    left = y - inside @ (inside.T @ y)
    size = np.sum(tried**2, axis=0)
    gain = np.where(size > 1e-9 * np.sum(weight**2), (left @ tried) ** 2 / np.maximum(size, 1e-300), 0.0)
    return float(centres[np.argmax(gain)])


def _refined(base: AnyArray, t: AnyArray, weight: AnyArray, y: AnyArray, shape: AnyArray) -> AnyArray:
    """Centres and log widths by least squares with the linear coefficients eliminated (variable projection)."""
    count = shape.shape[1]
    low, high = t[0] + _EDGE, t[-1] - _EDGE
    bounds = (np.r_[np.full(count, low), np.full(count, np.log(_NARROW))], np.r_[np.full(count, high), np.full(count, np.log(_WIDE))])
    scale = np.r_[np.full(count, 0.1), np.ones(count)]

    def projected(x: AnyArray) -> tuple[AnyArray, AnyArray, AnyArray]:
        design = _design(base, t, weight, x.reshape(2, count))
        orthogonal, triangle = np.linalg.qr(design)
        inside = orthogonal.T @ y
        return orthogonal, y - orthogonal @ inside, np.linalg.lstsq(triangle, inside, rcond=None)[0][base.shape[1] :]

    def slope(x: AnyArray) -> AnyArray:
        # Kaufman's derivative, BIT 15 (1975) 49: the projection of the columns' own, without that of the coefficients
        orthogonal, _, height = projected(x)
        centre, log = x.reshape(2, count)
        z, s = (t[:, None] - centre) / np.exp(log), _sigmoid(t[:, None], centre, np.exp(log))
        bell = weight[:, None] * height * s * (1 - s)
        columns = np.concatenate([bell / np.exp(log), bell * z], axis=1)
        return columns - orthogonal @ (orthogonal.T @ columns)

    jac: Any = slope  # the stubs of scipy know names alone
    start = np.clip(shape.ravel(), bounds[0] + 1e-6, bounds[1] - 1e-6)
    found = scipy.optimize.least_squares(
        lambda x: projected(x)[1], start, jac, bounds=bounds, x_scale=scale, xtol=1e-6, ftol=1e-8, max_nfev=40
    )
    return found.x.reshape(2, count)
