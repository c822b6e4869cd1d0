"""Limits and verdicts that hold for all models of the slow noise that are nearly as likely as the fitted one."""

from .._types import AnyArray
from ._alternatives import Alternative, Alternatives
from ._limits import Limits, levels_of
from ._result import PRESENT
from ._spectral import FILTER, Fitted, uncertainty

_LEAST = 1e-2  # smallest likelihood ratio at which limits are computed


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


def doubted(limits: Limits, names: tuple[str, ...], doubts: dict[str, Alternative]) -> tuple[Limits, dict[str, Alternative]]:
    """Limits in which every doubtful term may be zero, and the doubts of those terms that would otherwise be present."""
    there = {name: one for name, one in doubts.items() if name in names and limits.significance[_row(names, name)] > PRESENT}
    low = limits.low.copy()
    low[[_row(names, name) for name in there]] = 0.0
    return limits._replace(low=low), there


def _own(found: Alternatives) -> float:
    """Net gain of the fitted model over B and K alone."""
    return found.admitted.net if found.admitted else 0.0


def _row(names: tuple[str, ...], name: str) -> int:
    """Position of a term in the limits, which leave out the filter."""
    return [one for one in names if one != FILTER].index(name)
