r"""Spectra that pass for flicker and a random walk: another exponent, and Gauss-Markov processes.

B and K describe the slow noise of a record. Before the fit calls them present, it tries other models in their place: a density
:math:`c^2 (2\pi f)^{-\alpha}`, and one, two or three Gauss-Markov processes; and one process beside B and K. It fits all models to the
same ordinates, and compares twice their gains in log likelihood over B and K. A model is admitted where its gain reaches a level that
about one record in 300 of Q, N, B and K alone reaches (`benchmarks/records.py --only alternatives`). The fit then has its terms beside
B and K, which are judged by what they explain beyond it.

The root of a gain scatters with a standard deviation of one, and even the loss of one sample in a hundred changes it by 0.1. A record
near the level must not jump between two models for that. The result is therefore a mean of the fits with and without the model. The
share of the model grows evenly with the root of its gain, from 0 a little below the level to 1 above it. This is nearly the mean over the
decisions for records that scatter like the given one (P. Buehlmann and B. Yu, Ann. Statist. 30, 2002; B. Efron, J. Am. Stat. Assoc. 109,
2014). If several models are about as likely, they divide the share by their likelihoods.

A model that is not admitted may still be nearly as likely as B and K. The interval of N then holds for both models, and a term that
the other model does without is a hint at most:

- K, unless B and K explain the record better than flicker of any exponent from 0.8 to 1.2 does without K. The level of this likelihood
  ratio is set so that 3 % of records with flicker of exponent 1.2 show K. At that rate no verdict finds many more random walks
  (`benchmarks/records.py --only power`).
- B, where one Gauss-Markov process explains the record better than B and K do, or several explain it much better.
"""

import functools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .._types import AnyArray
from ._lanes import inverse
from ._likelihood import ROUGH, information, minimise
from ._limits import PRESENT
from ._model import PROCESSES
from ._spectral import Fitted, inflation_of
from ._terms import BUILT_IN, Filter, GaussMarkov, PowerLaw, Term

_ALIKE = 0.1  # least difference from 1 of an exponent that is not that of flicker
_EXPONENTS = np.arange(3, 19) / 10.0  # exponents that are tried
_OTHER = np.abs(_EXPONENTS - 1.0) > _ALIKE / 2.0
_FLICKER = slice(5, 10)  # exponents 0.8 to 1.2
_LAWS: tuple[tuple[Term, ...], ...] = tuple((PowerLaw(exponent=float(value)),) for value in _EXPONENTS)
#: twice the log likelihood that B and K must gain over flicker of such an exponent alone for K to be present
_WANDERS = 4.25
_TIMES = 14  # number of correlation times that are tried, from ten samples to a quarter of the record
_HALVINGS = 4  # how often the step between neighbouring correlation times or exponents is halved around the best one
_WORTH = 3.0  # score of one more term below which the search is short; admitted models reach at least twice this score
_THIRD = 2.0  # gain in log likelihood from a third process below which its correlation time is not refined
_SLOW = 5.41  # twice the gain in log likelihood of B and K below which the record has no slow noise to explain
_OWN = 1e-9  # share of a term's squares, not explained by the terms of the fit, below which it is no further term
_TINY = np.finfo(float).tiny ** 0.5
#: differences between the root of a gain and the root of its level between which the share of the model in the result grows from 0 to 1;
#: the share at the level; likelihood, over that of the likeliest model, that counts as zero
_BLUR = (0.5, 2.0)
_ADMITTED, _FAR = _BLUR[0] / sum(_BLUR), float(np.exp(-1.5))
#: family -> number of parameters beyond those of B and K, twice the gain in log likelihood above which the family is admitted, and
#: that above which B is a hint at most; three processes count for two parameters more, because their sum can look like flicker
_FAMILIES = {
    "power law": (0, 9.0, np.nan), "one process": (0, 8.0, 2.0), "two processes": (2, 13.0, 8.0), "three processes": (6, 17.0, 12.0),
    "process beside": (2, 13.0, np.nan),
}  # fmt: skip
_PROCESSES = ("one process", "two processes", "three processes")
_PARAMETER = 2.0  # twice the gain in log likelihood that each further parameter of a family must bring


class Alternative(NamedTuple):
    """A family, its terms, and twice the gain in log likelihood over B and K.

    `gain` is divided by the factor by which the spectrum scatters more than the better of the two models allows, `explained` is not.
    """

    family: str
    terms: tuple[Term, ...]
    gain: float
    explained: float

    @property
    def weight(self) -> float:
        """Share of the model in the result, from 0 to 1."""
        root, level = np.sqrt([max(self.gain, 0.0), _FAMILIES[self.family][1]])
        return float(np.clip((root - level + _BLUR[0]) / sum(_BLUR), 0.0, 1.0))

    @property
    def net(self) -> float:
        """The gain less the cost of the further parameters, so that families can be compared."""
        return self.gain - _PARAMETER * _FAMILIES[self.family][0]

    def numbered(self, before: int) -> tuple[Term, ...]:
        """The terms, with names of their own beside other Gauss-Markov processes of which there are so many `before`."""
        names = PROCESSES[before : before + len(self.terms)]
        return tuple(
            GaussMarkov(term.time, name) if isinstance(term, GaussMarkov) else term for term, name in zip(self.terms, names, strict=True)
        )


class Alternatives(NamedTuple):
    """The best model of each family that was tried: the admitted one first, then the likeliest.

    `flicker` is flicker of the likeliest exponent near 1, without K. `shares` are those alternatives that have a share in the result, the
    admitted one first; B and K alone have what is left of one. `admitted` is the one of the largest share, if one gains more than chance
    explains.
    """

    listed: tuple[Alternative, ...] = ()
    flicker: Alternative | None = None
    admitted: Alternative | None = None
    shares: tuple[tuple[Alternative, float], ...] = ()

    @property
    def undecided(self) -> bool:
        """Whether several models have a share in the result."""
        return bool(self.shares) and not (len(self.shares) == 1 and self.shares[0][1] == 1.0)

    @property
    def rival(self) -> Alternative | None:
        """The likeliest alternative without B and K."""
        return max((one for one in self.listed if one.family != "process beside"), key=lambda one: one.net, default=None)

    def doubts(self) -> dict[str, Alternative]:
        """Terms that are a hint at most, each with the alternative that explains the record nearly as well without it."""
        model, found = self.admitted, {}
        if model is not None and model.family != "process beside":
            return {}  # B and K are judged by what they explain beyond it
        judged = [("B", one, _FAMILIES[one.family][2]) for one in self.listed if one.family in _PROCESSES]
        judged += [("K", self.flicker, -_WANDERS)] if self.flicker else []
        for term, one, level in judged:
            if one.net > model.net - PRESENT if model else one.gain > level:
                found.setdefault(term, one)
        return found


def find_alternatives(fitted: Fitted, terms: tuple[Term, ...], dt: float, duration: float) -> Alternatives:
    """The best alternative of each family; none if the fit has neither B nor K, or has terms that the user defined.

    Parameters
    ----------
    fitted : the fit with B and K.
    terms : the terms of its columns.
    dt, duration : sampling interval and length of the record in s.
    """
    slow = np.array([term.name in ("B", "K") for term in terms])
    if not np.any(fitted.theta[slow] > 0.0) or any(term.name not in (*BUILT_IN, Filter.name) for term in terms):
        return Alternatives()
    search = _Search(fitted, slow, dt)
    if search.alternative("none", (), search.without()).gain > -_SLOW:
        return Alternatives()
    times, step = _times(dt, duration)
    ones: list[tuple[Term, ...]] = [(one,) for one in _processes(dt, duration)]
    # densities of all choices at once: one by one they take a hundred times as long
    f = fitted.bins.frequency
    slopes, lags = PowerLaw(exponent=_EXPONENTS[:, None]).psd(f, dt), GaussMarkov(time=np.array(times)[:, None]).psd(f, dt)
    costs = search.costs(_LAWS, slopes[:, :, None])
    nearest = _FLICKER.start + int(np.argmin(costs[_FLICKER]))
    flicker = search.alternative("power law", _LAWS[nearest], float(costs[nearest]))
    index = int(np.flatnonzero(_OTHER)[np.argmin(costs[_OTHER])])
    law, process = (_LAWS[index], float(costs[index])), search.best(ones, lags[:, :, None])
    found = {"power law": law, "one process": process}
    if _score(fitted, np.concatenate([slopes[_OTHER], lags])) >= _WORTH:
        pairs: list[tuple[Term, ...]] = [
            (_process(long), _process(short, "markov2")) for i, long in enumerate(times) for short in times[:i]
        ]
        found = {
            "power law": search.refined(law, 0.1),
            "one process": search.refined(process, step),
            "two processes": (two := search.refined(search.best(pairs), step)),
            "process beside": search.best(ones, lags[:, :, None], beside=True),
        }
        three = search.best([(*two[0], _process(time, "markov3")) for time in times])
        if two[1] - three[1] > _THIRD:
            found["three processes"] = search.refined(three, step)
    listed = sorted((search.alternative(family, *one) for family, one in found.items()), key=lambda one: -one.net)
    shares = _shares(listed)
    admitted = shares[0][0] if sum(share for _, share in shares) > _ADMITTED else None
    return Alternatives(tuple(sorted(listed, key=lambda one: one is not admitted)), flicker, admitted, shares)


def _shares(listed: list[Alternative]) -> tuple[tuple[Alternative, float], ...]:
    """Alternatives with a share in the result, the largest first.

    Together they have the largest of their weights, divided in proportion to their likelihoods. A likelihood that is far from the
    largest counts as zero. Every share changes continuously with the gains.
    """
    near = [one for one in listed if one.weight > 0.0]
    if not near:
        return ()
    best = max(one.net for one in near)
    parts = np.array([one.weight * max(np.exp(0.5 * (one.net - best)) - _FAR, 0.0) for one in near])
    shares = max(one.weight for one in near) * parts / parts.sum()
    found = [(one, float(share)) for one, share in zip(near, shares, strict=True) if share > 0.0]
    return tuple(sorted(found, key=lambda each: -each[1]))


def _score(fitted: Fitted, densities: AnyArray) -> float:
    """Largest score statistic of one more term beside the fit, for terms of some densities, (terms, bins).

    For a small coefficient this is the likelihood ratio of the term (C. R. Rao, Proc. Camb. Phil. Soc. 44, 1948). It needs no fit with the
    term, and takes a hundredth of the time of a search.
    """
    bins, present = fitted.bins, fitted.theta > 0.0
    model = np.maximum(bins.columns @ fitted.theta, _TINY)
    root = np.sqrt(bins.weight / 2.0)
    held = bins.columns[:, present] * (root / model)[:, None]
    extra = densities.T * (root / model)[:, None]
    extra = extra / np.linalg.norm(extra, axis=0)
    rest = extra - held @ np.linalg.lstsq(held, extra, rcond=None)[0]
    information = np.sum(rest**2, axis=0)
    slope = rest.T @ (root * (bins.density / model - 1.0))
    return float(np.max(np.where(information > _OWN, slope**2 / np.maximum(information, _OWN), 0.0)))


def likeliest_time(fitted: Fitted, dt: float, duration: float) -> float:
    """Correlation time in s at which a Gauss-Markov process beside the fitted terms has the highest likelihood."""
    search = _Search(fitted, np.zeros(len(fitted.theta), dtype=bool), dt)
    ((process,), _) = search.best([(one,) for one in _processes(dt, duration)], beside=True)
    return float(getattr(process, "time"))  # noqa: B009


def widening(fitted: Fitted, terms: tuple[Term, ...], extra: tuple[Term, ...], dt: float) -> AnyArray:
    """Factor by which the variance of each coefficient grows because the shapes of the `extra` terms are estimated too."""
    theta, step, bins = fitted.theta, 1e-4, fitted.bins
    names = [term.name for term in terms]
    size = [theta[names.index(term.name)] / (2.0 * step) for term in extra]
    sides = [[np.asarray(_moved(term, sign * step).psd(bins.frequency, dt)) for sign in (1.0, -1.0)] for term in extra]
    slopes = np.stack([one * (high - low) for one, (high, low) in zip(size, sides, strict=True)], axis=1)
    there = np.append(theta > 0.0, np.any(slopes != 0.0, axis=0))
    wide = bins._replace(columns=np.concatenate([bins.columns, slopes], axis=1)[:, there])
    count = int(np.sum(theta > 0.0))
    both = information(wide, np.append(theta, np.zeros(len(extra)))[there])
    factor = np.ones(len(theta))
    factor[theta > 0.0] = np.diagonal(inverse(both))[:count] / np.diagonal(inverse(both[:count, :count]))
    return factor


def _times(dt: float, duration: float) -> tuple[list[float], float]:
    """Correlation times in s that are tried, and the logarithm of the ratio of neighbouring ones."""
    times = np.geomspace(10.0 * dt, max(duration / 4.0, 20.0 * dt), _TIMES)
    return times.tolist(), float(np.log(times[1] / times[0]))


@functools.lru_cache(maxsize=64)
def _processes(dt: float, duration: float) -> tuple[Term, ...]:
    """One process for each correlation time that is tried. Records of one length share the result."""
    return tuple(_process(time) for time in _times(dt, duration)[0])


def _process(time: float, name: str = "markov") -> GaussMarkov:
    return GaussMarkov(time=float(time), name=name)


def _moved(term: Term, by: float) -> Term:
    """The term with its exponent, or the logarithm of its correlation time, changed `by` some amount."""
    if isinstance(term, PowerLaw):
        return PowerLaw(exponent=1.0 + np.sign(term.exponent - 1.0) * max(abs(term.exponent + by - 1.0), _ALIKE))
    assert isinstance(term, GaussMarkov)
    return _process(term.time * float(np.exp(by)), term.name)


class _Search:
    """Fits with other terms in place of the slow terms, or beside them."""

    def __init__(self, fitted: Fitted, slow: AnyArray, dt: float):
        self._fitted, self._slow, self._dt = fitted, slow, dt
        bins, theta = fitted.bins, fitted.theta
        model = np.maximum(bins.columns @ theta, _TINY)
        # if the fit has no slow terms, the search for a process starts at the level of the ordinates
        self._level = np.maximum(bins.columns[:, slow] @ theta[slow] if slow.any() else bins.density, _TINY)
        self._share = bins.weight * np.minimum(self._level / model, 1.0) ** 2

    def alternative(self, family: str, terms: tuple[Term, ...], cost: float) -> Alternative:
        """The alternative of this cost; its gains are minus infinity if the search found no minimum."""
        if not (np.isfinite(self._fitted.cost) and np.isfinite(cost)):
            return Alternative(family, terms, -np.inf, -np.inf)
        explained = 2.0 * float(self._fitted.cost - cost)
        # as in an F test, the variance factor is that of the better model: what the other model explains is no scatter
        rest = max(float(self._fitted.deviance) - max(explained, 0.0), 0.0)
        return Alternative(family, terms, explained / float(inflation_of(rest, self._fitted.freedom)[1]), explained)

    def without(self) -> float:
        """Cost of the fit without the slow terms."""
        kept, bins = ~self._slow, self._fitted.bins
        start = np.where(self._fitted.theta[kept] > 0.0, self._fitted.theta[kept], 0.0)
        start = np.maximum(start, np.where(bins.columns[:, kept].min(axis=0) >= 0.0, _TINY, 0.0))
        return float(minimise(bins.columns[:, kept], bins.density, bins.weight, start[None, :], rtol=ROUGH).cost[0])

    def costs(self, candidates: Sequence[tuple[Term, ...]], extra: AnyArray | None = None, *, beside: bool = False) -> AnyArray:
        """Cost of the fit with each candidate; `extra`, (candidates, bins, terms), are the densities of its terms, if known."""
        bins, lanes = self._fitted.bins, len(candidates)
        if extra is None:
            extra = np.stack([np.stack([np.asarray(term.psd(bins.frequency, self._dt)) for term in one], axis=1) for one in candidates])
        kept = np.ones_like(self._slow) if beside else ~self._slow
        # each term starts at the level of the slow terms in the bins in which it is the strongest term of its candidate
        strength = extra / extra.max(axis=1, keepdims=True)
        own = self._share[:, None] * (strength / np.maximum(strength.sum(axis=2, keepdims=True), _TINY)) ** 4
        level = np.sum(own * (np.log(self._level)[:, None] - np.log(extra)), axis=1) / np.maximum(np.sum(own, axis=1), _TINY)
        columns = np.concatenate([np.broadcast_to(bins.columns[:, kept], (lanes, len(self._level), int(np.sum(kept)))), extra], axis=2)
        start = np.concatenate([np.tile(self._fitted.theta[kept], (lanes, 1)), np.exp(level)], axis=1)
        return np.asarray(minimise(columns, bins.density, bins.weight, start, rtol=ROUGH).cost)

    def best(
        self, candidates: Sequence[tuple[Term, ...]], extra: AnyArray | None = None, *, beside: bool = False
    ) -> tuple[tuple[Term, ...], float]:
        """The candidate of the lowest cost, and this cost."""
        costs = self.costs(candidates, extra, beside=beside)
        index = int(np.argmin(costs))
        return candidates[index], float(costs[index])

    def refined(self, found: tuple[tuple[Term, ...], float], step: float) -> tuple[tuple[Term, ...], float]:
        """The candidate of the lowest cost with shape parameters within a step of those `found`, and this cost."""
        for _ in range(_HALVINGS):
            step *= 0.5
            terms = found[0]
            moves = [(i, sign * step) for i in range(len(terms)) for sign in (-1.0, 1.0)]
            found = min(found, self.best([(*terms[:i], _moved(terms[i], by), *terms[i + 1 :]) for i, by in moves]), key=lambda one: one[1])
        return found
