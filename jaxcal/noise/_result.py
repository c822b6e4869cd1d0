"""`NoiseFit`: noise coefficients with their uncertainty."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ..allan import Deviation
from ._model import Noise, with_coefficients


class NoiseFit(eqx.Module):
    """Noise coefficients of one channel, or of several, with what is known about them.

    For a record of several channels every entry is per channel, channels last; verdicts, sentences and flags are then tuples
    with one entry per channel. `channel(i)` gives one of them.

    Attributes
    ----------
    noise : fitted `Noise`, SI units.
    terms : names of the fitted terms, in the order of `covariance`.
    interval : term -> (low, high) at level `confidence`, in the unit of the coefficient; low is 0 where zero cannot be excluded.
    upper_limit : term -> one-sided upper limit at level `confidence`.
    verdict : term -> "present", "hint" or "not detected".
    significance : term -> drop of the chi-square when the term is admitted: by chance above 2.71 in 5 % and above 5.41 in 1 %.
    covariance : (terms, terms) covariance of the *squared* coefficients, whose estimates are close to Gaussian and may
        lie at zero; channels last.
    goodness : chance of a worse chi-square in the band used, were the model true.
    longer_record : term -> record length in s at which the coefficient would be known to 10 % (inf where it is at zero).
    band : (shortest, longest) cluster time in s that the fit uses.
    left_out : one sentence for each octave of cluster time left out because the model does not hold there.
    warnings : sentences.
    deviation : the `Deviation` that was fitted, all cluster sizes; inside the band its edf and limits are those of the fitted
        model, outside those of the noise type identified there.
    used : (clusters,) True where a cluster size is in the band; channels last.
    duration : record length in s.
    confidence : level of interval and upper limit.
    method : name of the estimator.
    """

    noise: Noise
    interval: dict[str, tuple[Any, Any]]
    upper_limit: dict[str, Any]
    verdict: dict[str, Any]
    significance: dict[str, Any]
    covariance: AnyArray
    goodness: Any
    longer_record: dict[str, Any]
    band: tuple[Any, Any]
    left_out: tuple[Any, ...]
    warnings: tuple[Any, ...]
    deviation: Deviation
    used: AnyArray
    duration: float
    terms: tuple[str, ...] = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    method: str = eqx.field(static=True)

    def channel(self, index: int) -> "NoiseFit":
        """The fit of one channel of a record with several.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=[0.01, 0.02]).simulate(2000, rate=100.0, seed=1)
        >>> jaxcal.noise.fit(noise, rate=100.0).channel(1).verdict["N"]
        'present'
        """
        deviation = self.deviation.channel(index)

        def pick(value):
            return value[..., index]

        def pick_all(table):
            return {term: pick(value) for term, value in table.items()}

        return NoiseFit(
            noise=self.noise.channel(index),
            interval={term: (pick(low), pick(high)) for term, (low, high) in self.interval.items()},
            upper_limit=pick_all(self.upper_limit),
            verdict={term: value[index] for term, value in self.verdict.items()},
            significance=pick_all(self.significance),
            covariance=pick(self.covariance),
            goodness=pick(self.goodness),
            longer_record=pick_all(self.longer_record),
            band=(pick(self.band[0]), pick(self.band[1])),
            left_out=self.left_out[index],
            warnings=self.warnings[index],
            deviation=deviation,
            used=pick(self.used),
            duration=self.duration,
            terms=self.terms,
            confidence=self.confidence,
            method=self.method,
        )


def stacked(fits: list[NoiseFit]) -> NoiseFit:
    """The fits of the channels of one record as one result, channels last."""
    first = fits[0]
    xp = jnp if any(isinstance(leaf, jax.Array) for leaf in jax.tree.leaves(first)) else np

    def join(pick):
        return xp.stack([xp.asarray(pick(fit)) for fit in fits], axis=-1)

    names = ("deviation", "lower", "upper", "edf", "count", "alpha", "skipped")
    arrays = {name: join(lambda f, n=name: getattr(f.deviation, n)) for name in names}
    deviation = Deviation(
        tau=first.deviation.tau, m=first.deviation.m, kind=first.deviation.kind, rate=first.deviation.rate,
        confidence=first.confidence, warnings=first.deviation.warnings, **arrays,
    )  # fmt: skip
    return NoiseFit(
        noise=with_coefficients({t: join(lambda f, t=t: getattr(f.noise, t)) for t in first.terms}),
        interval={t: (join(lambda f, t=t: f.interval[t][0]), join(lambda f, t=t: f.interval[t][1])) for t in first.terms},
        upper_limit={t: join(lambda f, t=t: f.upper_limit[t]) for t in first.terms},
        verdict={t: tuple(f.verdict[t] for f in fits) for t in first.verdict},
        significance={t: join(lambda f, t=t: f.significance[t]) for t in first.terms},
        covariance=join(lambda f: f.covariance),
        goodness=join(lambda f: f.goodness),
        longer_record={t: join(lambda f, t=t: f.longer_record[t]) for t in first.terms},
        band=(join(lambda f: f.band[0]), join(lambda f: f.band[1])),
        left_out=tuple(f.left_out for f in fits),
        warnings=tuple(f.warnings for f in fits),
        deviation=deviation,
        used=join(lambda f: f.used),
        duration=first.duration,
        terms=first.terms,
        confidence=first.confidence,
        method=first.method,
    )
