"""From squared coefficients to a `NoiseFit`: what every estimator's result has in common."""

import jax.numpy as jnp
import numpy as np

from .._precision import is_traced
from ..allan import Deviation
from ..allan._uncertainty._edf import interval_factors
from ._limits import Limits
from ._model import noise_of
from ._result import NoiseFit
from ._terms import Term

#: rises of the objective above which a term is hinted at, and is present: 5 % and 1 % by chance, for a coefficient that
#: cannot be negative (S. G. Self and K.-Y. Liang, J. Am. Stat. Assoc. 82, 1987)
_HINT, _PRESENT = 2.71, 5.41


def verdict_of(rise: float) -> str:
    """Verdict on a term from the rise of the objective without it."""
    return "present" if rise > _PRESENT else "hint" if rise > _HINT else "not detected"


def assemble(theta, spread, limits: Limits, terms: tuple[Term, ...], duration: float, *, sinusoid=(), **others) -> NoiseFit:
    """`NoiseFit` of squared coefficients, their covariance and their limits, all in SI.

    Parameters
    ----------
    theta, spread, limits : squared coefficients in the order of `terms`, (p,), (p, p), and their limits.
    terms : the terms.
    duration : record length in s.
    sinusoid : ((amplitude, frequency), ...) of the lines taken out.
    others : the remaining fields of `NoiseFit`.
    """
    traced = is_traced(theta)
    xp = jnp if traced else np
    positive = theta > 0.0
    guarded = xp.where(positive, theta, 1.0)  # keeps the derivative of the root finite where the coefficient is zero
    value = xp.where(positive, xp.sqrt(guarded), 0.0)
    low, high, upper = (xp.sqrt(end) for end in (limits.low, limits.high, limits.upper))
    relative = xp.sqrt(xp.diagonal(spread)) / (2.0 * guarded)
    longer = xp.where(positive, duration * (relative / 0.1) ** 2, xp.inf)

    def table(values):
        return {term.name: values[i] for i, term in enumerate(terms)}

    return NoiseFit(
        noise=noise_of(terms, [value[i] for i in range(len(terms))], sinusoid),
        interval={term.name: (low[i], high[i]) for i, term in enumerate(terms)},
        upper_limit=table(upper),
        verdict={} if traced else {term: verdict_of(float(rise)) for term, rise in table(limits.significance).items()},
        significance=table(limits.significance),
        covariance=spread,
        longer_record=table(longer),
        duration=duration,
        terms=tuple(term.name for term in terms),
        **others,
    )


def with_edf(curve: Deviation, used, edf) -> Deviation:
    """The deviation with the edf of the fitted model, and the limits that follow, where `used`."""
    edf = np.where(used, np.maximum(edf, 1.0), curve.edf)
    low, high = interval_factors(edf, curve.confidence)
    arrays = {name: getattr(curve, name) for name in ("tau", "m", "deviation", "count", "alpha", "skipped")}
    return Deviation(
        **arrays, edf=edf, lower=curve.deviation * low, upper=curve.deviation * high, kind=curve.kind, rate=curve.rate,
        confidence=curve.confidence, warnings=curve.warnings,
    )  # fmt: skip
