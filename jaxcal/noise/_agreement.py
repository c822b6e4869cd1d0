"""Two estimators on one record: where they disagree, the model is wrong or the data are filtered."""

import numpy as np

from ._model import TERMS
from ._result import NoiseFit

_LARGEST = 3.0


def second_opinion(one: NoiseFit, other: NoiseFit) -> tuple[str, ...]:
    """Sentences on the terms that two methods see differently, for fits of one channel.

    Two efficient estimators of one record differ by less than their standard deviations. The difference of the squared
    coefficients is compared with the larger of the two. Terms that neither detects, and terms that one did not fit, are left out;
    so is everything where a method has no uncertainty.

    Examples
    --------
    >>> from jaxcal.noise import Noise, fit
    >>> from jaxcal.noise._agreement import second_opinion
    >>> record = Noise(N=1e-3).simulate(5000, 100.0, seed=0)
    >>> second_opinion(fit(record, 100.0, method="gls"), fit(record, 100.0, method="edf"))
    ()
    """
    said = []
    for term in TERMS:
        if not all(term in fit.verdict for fit in (one, other)) or one.verdict[term] == other.verdict[term] == "not detected":
            continue
        values, spreads = zip(*(_squared(fit, term) for fit in (one, other)), strict=True)
        if min(spreads) <= 0.0:
            continue
        apart = abs(values[0] - values[1]) / max(spreads)
        if apart > _LARGEST:
            first, second = (float(getattr(fit.noise, term)) for fit in (one, other))
            said.append(
                f"{term} is {first:.3g} by method {one.method} and {second:.3g} by method {other.method} (SI units), {apart:.1f} standard "
                "deviations apart: the noise model does not describe this record, or the data were filtered; look at the plot"
            )
    return tuple(said)


def _squared(fit: NoiseFit, term: str) -> tuple[float, float]:
    """Squared coefficient and its standard deviation."""
    index = fit.terms.index(term)
    return float(getattr(fit.noise, term)) ** 2, float(np.sqrt(fit.covariance[index, index]))
