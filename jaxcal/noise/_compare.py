"""`compare`: which process is the slow noise of a record? Likelihoods of models beside N, and what each means at long times."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Grid, Number, Result, Section
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_rate, checked_record, refuse_infinite
from .._types import AnyArray, Numbers, Samples
from ._likelihood import scoring
from ._observed import Observed
from ._solve import FILTER, Solved, solve
from ._terms import BUILT_IN, GaussMarkov, PowerLaw, Term

_EXPONENTS = np.arange(0.3, 1.96, 0.1)
#: correlation times that are tried, from ten samples to a quarter of the record; how often the step between neighbouring times is halved
#: around the best one
_TIMES, _HALVINGS = 16, 4
#: name of a rival -> its terms: built-in ones, P for a power law, M for each Gauss-Markov process
_RIVALS = {"white": "", "B": "B", "K": "K", "B and K": "BK", "power law": "P", "markov": "M", "two markov": "MM", "B and markov": "BM"}


class Comparison(Result):
    """Models of the slow noise of a record, the likeliest first.

    Attributes
    ----------
    names : of the models.
    gain : (models,) twice the log likelihood beyond that of white noise alone.
    parameters : (models,) number of fitted parameters beside Q and N.
    shape : (models,) exponent of a power law, or correlation times in s, in words.
    later : (models,) Allan deviation that the model predicts at ten times the length of the record, in the unit of the record.
    findings : none.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3, K=1e-3).simulate(20_000, rate=100.0, seed=1)
    >>> found = jaxcal.noise.compare(record, 100.0)
    >>> found.names[0], found.names[-1]
    ('K', 'white')
    """

    names: tuple[str, ...] = eqx.field(static=True)
    gain: AnyArray
    parameters: tuple[int, ...] = eqx.field(static=True)
    shape: tuple[str, ...] = eqx.field(static=True)
    later: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The likeliest model, and its distance to the next one."""
        cost = self.gain - 2.0 * np.array(self.parameters)
        lead = f", by {cost[0] - cost[1]:.2g} over {self.names[1]}" if len(cost) > 1 else ""
        return f"the likeliest slow noise is {self.names[0]}{lead} (differences below about 6 decide nothing)"

    def sections(self) -> list[Section]:
        """One row for each model."""
        keys, listed = ("gain", "parameters", "later"), zip(self.names, self.shape, self.gain, self.parameters, self.later, strict=True)
        rows = tuple(
            (f"{name}  {shape}", tuple(Number(f"{name}.{key}", float(value)) for key, value in zip(keys, values, strict=True)))
            for name, shape, *values in listed
        )
        columns = ("twice the log likelihood", "parameters", "deviation at 10 times the length")
        return [Grid("comparison", "slow noise", columns, rows)]


@host_float64
def compare(y: Samples, rate: Numbers, *, rivals: Sequence[str] = tuple(_RIVALS)) -> Comparison:
    """Compare models of the slow noise of a record by their likelihoods. Q and N are part of each model.

    `fit` gives the coefficients of IEEE Std 952, whichever process made the noise. Use `compare` where a filter must predict beyond the
    length of the record: models that fit equally well differ there by large factors.

    Parameters
    ----------
    y : (n,) record in rad/s, m/s^2 or T. NaN marks a gap.
    rate : sampling rate in Hz.
    rivals : models to compare: "white", "B", "K", "B and K", "power law", "markov", "two markov", "B and markov".

    Returns
    -------
    Comparison
        Models in the order of twice the log likelihood less two for each parameter (Akaike's criterion).

    Raises
    ------
    DataError
        If a rival is unknown, or the record is too short.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3, markov=((1e-3, 20.0),)).simulate(50_000, rate=100.0, seed=1)
    >>> found = jaxcal.noise.compare(record, 100.0, rivals=("white", "B and K", "markov"))
    >>> found.names[0]
    'markov'

    References
    ----------
    H. Akaike, IEEE Trans. Autom. Control 19, 1974.
    """
    rate, record = checked_rate(rate), checked_record(y)
    if unknown := set(rivals) - set(_RIVALS):
        raise DataError(f"unknown rivals {', '.join(sorted(unknown))}; expected some of {', '.join(_RIVALS)}", code="unknown_rival")
    if record.ndim != 1:
        raise DataError(f"y must be (n,), one channel; got shape {record.shape}")
    refuse_infinite(record, "y")
    dt = 1.0 / rate
    solved = solve([Observed(record, dt)], tuple(BUILT_IN[term] for term in "QNBK"), None)
    names, duration = solved.names, len(record) * dt
    base = np.array([name in ("Q", "N", FILTER) for name in names])
    _, white = _fitted(solved, base, (), dt)
    found = []
    for name in rivals:
        terms = _likeliest(solved, base, name, dt, duration)
        theta, cost = _fitted(solved, base, terms, dt)
        squares, end = theta * float(solved.bins.unit[0]), 10.0 * duration
        later = float(squares[names.index("N")]) / end  # Q and N are the first columns
        later += sum(float(value) * float(term.avar(end)) for value, term in zip(squares[base.sum() :], terms, strict=True))
        times = [f"{term.time:.2g}" for term in terms if isinstance(term, GaussMarkov)]
        shape = f"of {' and '.join(times)} s" if times else ""
        shape = f"of exponent {terms[0].exponent:.2g}" if terms and isinstance(terms[0], PowerLaw) else shape
        count = len(terms) + len(times) + isinstance(terms[0] if terms else None, PowerLaw)
        gain = 2.0 * max(white - cost, 0.0)  # each model contains white noise
        found.append((gain, name, count, shape, np.sqrt(later)))
    found.sort(key=lambda one: 2.0 * one[2] - one[0])
    gains, listed, counts, shapes, later = zip(*found, strict=True)
    return Comparison(listed, np.array(gains), counts, shapes, np.array(later))


def _fitted(solved: Solved, base: AnyArray, terms: Sequence[Term], dt: float) -> tuple[AnyArray, float]:
    """Coefficients and cost of a fit of the base terms with others, of one channel."""
    bins, density, weight = solved.bins, solved.bins.density[0], solved.weight[0]
    own = [bins.columns[:, base] * solved.among[0, base], *(np.asarray(term.psd(bins.frequency, dt))[:, None] for term in terms)]
    level = np.median(density[weight > 0])
    start = [solved.theta[0, base], *(np.atleast_1d(level / np.median(one)) for one in own[1:])]
    return scoring(np.concatenate(own, axis=1), density, weight, np.concatenate(start))


def _likeliest(solved: Solved, base: AnyArray, name: str, dt: float, duration: float) -> tuple[Term, ...]:
    """The terms of a rival, with the likeliest exponent or correlation times."""
    letters, processes = _RIVALS[name], _RIVALS[name].count("M")
    held = tuple(BUILT_IN[letter] for letter in letters if letter in BUILT_IN)
    if "P" in letters:
        candidates = [(PowerLaw(exponent=float(value)),) for value in _EXPONENTS]
        return min(candidates, key=lambda terms: _fitted(solved, base, terms, dt)[1])
    times = _best_times(lambda times: _fitted(solved, base, (*held, *_processes(times)), dt)[1], processes, dt, duration)
    return (*held, *_processes(times))


def _processes(times: Sequence[float]) -> tuple[GaussMarkov, ...]:
    return tuple(GaussMarkov(time=time, name=f"markov{i}") for i, time in enumerate(times))


def _best_times(cost_of: Any, processes: int, dt: float, duration: float) -> tuple[float, ...]:
    """Correlation times of the lowest cost: the best of a grid, refined by halving its steps."""
    times = np.geomspace(10.0 * dt, max(duration / 4.0, 20.0 * dt), _TIMES)
    step = float(np.log(times[1] / times[0]))
    cost, best = min((cost_of(one), one) for one in combinations(times.tolist(), processes))
    for _ in range(_HALVINGS):
        step *= 0.5
        moved = [(*best[:i], best[i] * float(np.exp(by)), *best[i + 1 :]) for i in range(processes) for by in (-step, step)]
        cost, best = min([(cost, best), *((cost_of(one), one) for one in moved)])
    return best


def likeliest_time(solved: Solved, dt: float, duration: float) -> float:
    """Correlation time in s at which a Gauss-Markov process beside the fitted terms of one channel has the highest likelihood."""
    whole = np.ones(len(solved.names), dtype=bool)
    return _best_times(lambda times: _fitted(solved, whole, _processes(times), dt)[1], 1, dt, duration)[0]
