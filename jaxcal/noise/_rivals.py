"""Limits and verdicts that hold for every model of the slow noise that the record does not exclude."""

from .._types import AnyArray
from ._alternatives import Alternative, Alternatives
from ._limits import Limits, levels_of
from ._result import PRESENT
from ._spectral import FILTER, Fitted, uncertainty

_LEAST = 1e-2  # likelihood ratio at which limits are found at least


def competing(found: Alternatives, confidence: float) -> Alternative | None:
    """The likeliest model without B and K, where the likelihood does not exclude it."""
    rival, (level, _) = found.rival, levels_of(confidence)
    return rival if rival is not None and rival.net > _own(found) - level else None


def widest(limits: Limits, names: tuple[str, ...], other: Limits, terms: tuple[str, ...]) -> Limits:
    """Limits of some terms that reach to those of another fit, which has limits of these terms alone."""
    low, high, upper = limits.low.copy(), limits.high.copy(), limits.upper.copy()
    for j, name in enumerate([name for name in names if name in terms]):
        i = _row(names, name)
        low[i], high[i], upper[i] = min(low[i], other.low[j]), max(high[i], other.high[j]), max(upper[i], other.upper[j])
    return limits._replace(low=low, high=high, upper=upper)


def over_models(
    limits: Limits, names: tuple[str, ...], fitted: Fitted, others: tuple[str, ...], widened: AnyArray, unit: float, found: Alternatives,
    confidence: float,
) -> Limits:  # fmt: skip
    """Limits of N that reach to where the likelihood of the rival has fallen as far below the larger maximum.

    Parameters
    ----------
    limits, names : those of the fit, and the names of its columns.
    fitted, others, widened : the fit of the rival, the names of its columns, and by how much their variances are widened.
    unit : unit of the rival's squared coefficients in that of the fit's.
    found : the alternatives, for the gains of both.
    confidence : level of the limits.
    """
    assert found.rival is not None
    behind = max(_own(found) - found.rival.net, 0.0)
    levels = [max(level - behind, _LEAST) for level in levels_of(confidence)]
    return widest(limits, names, uncertainty(fitted, widened, *levels, others, ("N",))[1].scaled(unit), ("N",))


def doubted(limits: Limits, names: tuple[str, ...], doubts: dict[str, Alternative]) -> tuple[Limits, dict[str, Alternative]]:
    """Limits in which a term may be zero that a model without it makes doubtful; and the doubts of terms that would be present."""
    there = {name: one for name, one in doubts.items() if name in names and limits.significance[_row(names, name)] > PRESENT}
    low = limits.low.copy()
    low[[_row(names, name) for name in there]] = 0.0
    return limits._replace(low=low), there


def _own(found: Alternatives) -> float:
    """Net gain of the model that is fitted over B and K alone."""
    return found.admitted.net if found.admitted else 0.0


def _row(names: tuple[str, ...], name: str) -> int:
    """Where a term stands in limits, which have none of the filter."""
    return [one for one in names if one != FILTER].index(name)
