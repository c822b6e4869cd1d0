"""Limits and verdicts that hold for all models of the slow noise that are nearly as likely as the fitted one."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .._types import AnyArray
from ._alternatives import Alternative, Alternatives
from ._limits import PRESENT, Limits, levels_of
from ._spectral import FILTER, Fitted, uncertainty

_LEAST = 1e-2  # smallest likelihood ratio at which limits are computed
_LEAST_CHANCE = np.finfo(float).tiny  # smallest likelihood of a coefficient of zero


class Estimate(NamedTuple):
    """Squared coefficients of all columns of a fit, their covariance, and limits of all columns but the last, the filter."""

    theta: AnyArray
    covariance: AnyArray
    limits: Limits

    def among(self, where: list[int], size: int, unit: float) -> "Estimate":
        """The estimate in another unit, among `size` columns of which these are number `where`; the others are zero."""
        theta, covariance, ends = np.zeros(size), np.zeros((size, size)), np.zeros((len(self.limits), size - 1))
        theta[where], covariance[np.ix_(where, where)] = self.theta * unit, self.covariance * unit**2
        ends[:, where[:-1]] = self.limits.scaled(unit)
        return Estimate(theta, covariance, Limits(*ends))


def mean_of(estimates: list[Estimate], shares: AnyArray, two_sided: float, one_sided: float) -> Estimate:
    r"""Mean of the estimates under several models, none of which is certain. All estimates have the same columns.

    .. math:: \bar\theta = \sum_m w_m\theta_m,\qquad \bar C = \sum_m w_m\,[C_m + (\theta_m-\bar\theta)(\theta_m-\bar\theta)^T]

    The squares of the distances of the limits from the coefficients are combined like the variances, and the likelihoods of a coefficient
    of zero are averaged (J. A. Hoeting et al., Statist. Sci. 14, 1999).

    Parameters
    ----------
    estimates, shares : those of the models, and their shares w, which sum to one.
    two_sided, one_sided : likelihood ratio at the ends of the intervals, and at the upper limits.
    """
    theta = np.stack([one.theta for one in estimates])
    mean = shares @ theta
    apart = theta - mean
    covariance = np.einsum("m,mij->ij", shares, np.stack([one.covariance for one in estimates])) + (shares * apart.T) @ apart
    ends = {name: np.stack([getattr(one.limits, name) for one in estimates]) for name in Limits._fields}

    def end(name: str, sign: float, level: float) -> AnyArray:
        squares = (ends[name] - theta[:, :-1]) ** 2 + level * apart[:, :-1] ** 2
        return np.maximum(mean[:-1] + sign * np.sqrt(shares @ squares), 0.0)

    zero = -2.0 * np.log(np.maximum(shares @ np.exp(-0.5 * ends["significance"]), _LEAST_CHANCE))
    return Estimate(mean, covariance, Limits(end("low", -1.0, two_sided), end("high", 1.0, two_sided), end("upper", 1.0, one_sided), zero))


def competing(found: Alternatives, confidence: float) -> Alternative | None:
    """The likeliest model without B and K, unless the likelihood excludes it at this level."""
    rival, (level, _) = found.rival, levels_of(confidence)
    return rival if rival is not None and rival.net > _own(found) - level else None


def widest(limits: Limits, names: tuple[str, ...], other: Limits, terms: tuple[str, ...]) -> Limits:
    """Limits that, for some terms, also contain the limits of another fit, which has no others."""
    low, high, upper = limits.low.copy(), limits.high.copy(), limits.upper.copy()
    for j, name in enumerate([name for name in names if name in terms]):
        i = _row(names, name)
        low[i], high[i], upper[i] = min(low[i], other.low[j]), max(high[i], other.high[j]), max(upper[i], other.upper[j])
    return limits._replace(low=low, high=high, upper=upper)


def over_models(
    limits: Limits, names: tuple[str, ...], fitted: Fitted, others: tuple[str, ...], widened: AnyArray, unit: float, found: Alternatives,
    confidence: float,
) -> Limits:  # fmt: skip
    """Limits of which those of N also hold under the rival: values at which its likelihood is close enough to the larger maximum.

    Parameters
    ----------
    limits, names : those of the fit, and the names of its columns.
    fitted, others, widened : the fit of the rival, the names of its columns, and the factors by which their variances grow.
    unit : unit of the rival's squared coefficients over the unit of the fit's.
    found : the alternatives, with the gains in likelihood of both models.
    confidence : level of the limits.
    """
    assert found.rival is not None
    behind = max(_own(found) - found.rival.net, 0.0)
    two_sided, one_sided = (max(level - behind, _LEAST) for level in levels_of(confidence))
    return widest(limits, names, uncertainty(fitted, widened, two_sided, one_sided, others, ("N",))[1].scaled(unit), ("N",))


def doubted(limits: Limits, names: tuple[str, ...], doubts: dict[str, Alternative]) -> dict[str, Alternative]:
    """The doubts of those terms that would otherwise be present."""
    return {name: one for name, one in doubts.items() if name in names and limits.significance[_row(names, name)] > PRESENT}


def reaching_zero(limits: Limits, names: tuple[str, ...], terms: Iterable[str]) -> Limits:
    """Limits in which each of the `terms` may be zero."""
    low = limits.low.copy()
    low[[_row(names, name) for name in terms]] = 0.0
    return limits._replace(low=low)


def _own(found: Alternatives) -> float:
    """Net gain of the fitted model over B and K alone."""
    return found.admitted.net if found.admitted else 0.0


def _row(names: tuple[str, ...], name: str) -> int:
    """Position of a term in the limits, which leave out the filter."""
    return [one for one in names if one != FILTER].index(name)
