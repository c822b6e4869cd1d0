r"""Causes that look like slow noise: a step, a ramp, a warm-up, a slow sinusoid, the temperature.

They change the mean of a record, and enter the likelihood as regressors. The search of each family uses the lowest ordinates of the
record and the likelihood ratio at a fixed density of the noise,

.. math:: \lambda = \frac{(\sum x_k y_k/S_k)^2}{\sum x_k^2/S_k}

once under the fitted density, in which B and K may already describe the cause as noise, and once under the density of N and Q alone.
The noise is then fitted again beside the best choice of each family. The likelihood ratio of the fits with and without the cause
decides, because B and K are fitted in both. A cause is admitted if fewer than one in 300 records of noise alone reaches its ratio in the
search of its family. The levels come from simulated records of N, of N and B, and of N, B and K (`benchmarks/records.py`).
"""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from ..spectrum._average import log_groups
from ._likelihood import ROUGH, minimise

_BLOCKS = 4096  # number of block means of a record, which have the same lowest ordinates as the record
_ORDINATES = 512  # number of ordinates that the search uses
_MARGIN = 48  # a step must have at least this share of the record, one in 48, on either side
_TIMES = 2.0 ** -np.arange(1, 7)  # time constants of a warm-up over the length of the record
_CYCLES = np.arange(0.5, 10.01, 0.25)
_WITHIN, _HALVINGS = ("warm-up", "sinusoid"), 5  # families whose time constant or frequency is refined, and number of halved steps
_ROUNDS = 3  # of the regression and the fit of the noise
_RECORDED = 12.0  # likelihood ratio by which any other cause must be better than the recorded temperature
_HOPELESS = 8.0  # distance to the wanted likelihood ratio that further rounds never gain
_MOST = 4  # number of causes of one record
_LOST = 1e-15  # share of the largest variance at which a combination of regressors is rounding
_STRONGEST = 1e6  # ratio of a coefficient to the smallest value from which its fit starts
#: likelihood ratio that one in 300 records of noise alone reaches in the search of a family
LEVELS = {"step": 24.0, "ramp": 14.0, "warm-up": 15.0, "sinusoid": 24.0, "temperature": 12.0}


class Cause(NamedTuple):
    """One cause: its family, its place (time in s, time constant in s, or frequency in Hz), likelihood ratio, and regressors."""

    family: str
    at: float
    gain: float
    columns: Callable[[np.ndarray], np.ndarray]


class _Low(NamedTuple):
    """The lowest ordinates of a record, the times at the middles of its blocks, and factors that turn a DCT-II of block means into them."""

    record: np.ndarray
    times: np.ndarray
    factor: np.ndarray

    def transform(self, x):
        """Ordinates of regressors given at `times`."""
        return (self.factor * np.asarray(scipy.fft.dct(x, norm="ortho", axis=0))[1 : len(self.factor) + 1].T).T


def _lowest(y, most: int, dt: float) -> _Low:
    size = max(len(y) // _BLOCKS, 1)
    count = len(y) // size
    k = np.arange(1, min(_ORDINATES, most, max(count // 4, 8)) + 1)
    # a mean over a block attenuates the ordinates
    attenuated = np.sin(np.pi * k / (2 * count)) / (size * np.sin(np.pi * k / (2 * count * size)))
    low = _Low(np.empty(0), (np.arange(count) + 0.5) * size * dt, np.sqrt(size * dt) / attenuated)
    return low._replace(record=low.transform(y[: count * size].reshape(count, size).mean(axis=1)))


def _duration(low: _Low) -> float:
    return float(low.times[-1] + low.times[0])


def _step(start: float, t):
    return (np.asarray(t) >= start).astype(float)[:, None]


def _line(t):
    return (np.asarray(t) / t[-1])[:, None]


def _decay(time: float, t):
    return np.exp(-np.asarray(t) / time)[:, None]


def _wave(frequency: float, t):
    return np.stack([np.cos(2 * np.pi * frequency * t), np.sin(2 * np.pi * frequency * t)], axis=1)


def _steps(low: _Low, density) -> tuple[float, float]:
    """Largest likelihood ratio of a step, and its time. Two transforms give the scores and variances of all steps."""
    count, kept = len(low.times), len(density)
    # ordinate k of a step at block j is -sin(pi k j / count) times this
    amplitude = low.factor * np.sqrt(0.5 / count) / np.sin(np.pi * np.arange(1, kept + 1) / (2 * count))
    sines = np.asarray(scipy.fft.dst(np.pad(amplitude * low.record / density, (0, count - 1 - kept)), type=1)) / 2.0
    squares = np.pad(amplitude**2 / density, (1, count - 1 - kept))
    variance = (squares.sum() - np.real(np.fft.fft(squares))[1:]) / 2.0
    margin = max(count // _MARGIN, 2)
    ratio = (sines**2 / variance)[margin - 1 : count - margin]
    best = int(np.argmax(ratio))
    return float(ratio[best]), float(low.times[best + margin] - 0.5 * (low.times[1] - low.times[0]))


@functools.lru_cache(maxsize=16)
def _shapes(count: int, spacing: float, kept: int, factor: bytes) -> dict[str, tuple[list[tuple[float, Any]], np.ndarray]]:
    """Family -> its choices (place, regressors), and their ordinates (choices, ordinates, columns). Records of one length share them."""
    low = _Low(np.empty(0), (np.arange(count) + 0.5) * spacing, np.frombuffer(factor))
    duration = _duration(low)
    choices: dict[str, list[tuple[float, Any]]] = {
        "ramp": [(0.0, _line)],
        "warm-up": [(time * duration, functools.partial(_decay, time * duration)) for time in _TIMES],
        "sinusoid": [(c / duration, functools.partial(_wave, c / duration)) for c in _CYCLES],
    }
    return {family: (listed, np.stack([low.transform(made(low.times)) for _, made in listed])) for family, listed in choices.items()}


def _refined(low: _Low, density, family: str, at: float, made):
    """Refine the time constant of a warm-up or the frequency of a sinusoid by halving the distance to its neighbours."""
    if family not in _WITHIN:
        return at, made
    columns, step = (_decay, np.log(2.0)) if family == "warm-up" else (_wave, np.log1p(_CYCLES[0] / 2.0 / max(at * _duration(low), 0.5)))
    x = low.transform(made(low.times))
    for _ in range(_HALVINGS):
        step /= 2.0
        near = [(place, functools.partial(columns, place)) for place in (float(at * np.exp(-step)), float(at * np.exp(step)))]
        shapes = np.stack([x, *(low.transform(one(low.times)) for _, one in near)])
        _, best = _best(low, density, shapes)
        (at, made), x = [(at, made), *near][best], shapes[best]
    return at, made


def _best(low: _Low, density, x) -> tuple[float, int]:
    """The largest likelihood ratio, and its choice; `x` are the ordinates of all choices, (choices, ordinates, columns)."""
    weighted = x / density[:, None]
    score = np.einsum("k,ckq->cq", low.record, weighted)
    values, vectors = np.linalg.eigh(np.swapaxes(x, 1, 2) @ weighted)
    kept = values > _LOST * values[:, -1:]  # a pseudo-inverse: the temperature may be constant
    along = np.einsum("cq,cqr->cr", score, vectors)
    ratio = np.sum(np.where(kept, along**2 / np.where(kept, values, 1.0), 0.0), axis=1)
    best = int(np.argmax(ratio))
    return float(ratio[best]), best


def _candidates(low: _Low, density, temperature) -> dict[str, tuple[float, float, Any]]:
    ratio, start = _steps(low, density)
    shapes = _shapes(len(low.times), float(2.0 * low.times[0]), len(low.factor), low.factor.tobytes())
    found = {"step": (ratio, start, functools.partial(_step, start))}
    for family, (choices, x) in shapes.items():
        ratio, best = _best(low, density, x)
        found[family] = (ratio, *choices[best])
    if temperature is not None:
        found["temperature"] = (_best(low, density, low.transform(temperature(low.times))[None])[0], 0.0, temperature)
    return found


def find_causes(y, columns, theta, slow, dt: float, temperature: Callable[[np.ndarray], np.ndarray] | None = None) -> tuple[Cause, ...]:
    """The causes that explain a record better than slow noise alone does, in the order in which they were admitted.

    Parameters
    ----------
    y : (n,) record without gaps.
    columns, theta : (ordinates, p) expected first ordinates per squared coefficient, and (p,) fitted squared coefficients.
    slow : (p,) whether a coefficient is fitted again beside a cause; higher frequencies determine the others.
    dt : sampling interval in s.
    temperature : function of times in s that returns (times, 1) temperatures; None if they are unknown.
    """
    low = _lowest(y, len(columns), dt)
    kept = len(low.record)
    columns, slow = columns[:kept], np.asarray(slow, dtype=bool)
    base = columns[:, ~slow] @ theta[~slow]
    if not np.all(base > 0.0):
        return ()
    causes: list[Cause] = []
    (fitted,), (cost,) = _refitted(low, [np.zeros((kept, 0))], columns[:, slow], base, theta[slow])
    while len(causes) < _MOST:
        held = [low.transform(cause.columns(low.times)) for cause in causes]
        tried: dict[tuple[str, float], Any] = {}
        for density in (base + columns[:, slow] @ fitted, base):
            rest = low._replace(record=_residual(low.record, held, density))
            for family, (ratio, at, made) in _candidates(rest, density, temperature).items():
                if ratio > LEVELS[family]:
                    at, made = _refined(rest, density, family, at, made)
                    tried[family, at] = made
        if not tried:
            break
        designs = [np.concatenate([*held, low.transform(made(low.times))], axis=1) for made in tried.values()]
        levels = np.array([LEVELS[family] for family, _ in tried])
        found, costs = _refitted(low, designs, columns[:, slow], base, theta[slow], cost - levels)
        recorded = np.array([_RECORDED * (family == "temperature") for family, _ in tried])
        best = int(np.argmax(cost - costs - levels + recorded))
        if not cost - costs[best] > levels[best]:
            break
        (family, at), made = list(tried.items())[best]
        causes.append(Cause(family, at, float(cost - costs[best]), made))
        fitted, cost = found[best], costs[best]
    return tuple(causes)


def _residual(record, held, density):
    """The record less its regression on the columns in `held`, weighted by a density."""
    if not held:
        return record
    x = np.concatenate(held, axis=1) / np.sqrt(density)[:, None]
    return record - np.concatenate(held, axis=1) @ np.linalg.lstsq(x, record / np.sqrt(density), rcond=None)[0]


def _refitted(low: _Low, designs, columns, base, begun, wanted: Any = -np.inf):
    """Slow coefficients beside each design, (designs, p), and -2 log likelihood; only roughly if it comes nowhere near that `wanted`."""
    starts, count = log_groups(len(low.record), keep_tail=True)
    count = count.astype(float)
    means = [np.add.reduceat(values, starts, axis=0) / count.reshape(-1, *(1,) * (values.ndim - 1)) for values in (columns, base)]
    theta = np.tile(begun, (len(designs), 1))
    target = np.empty((len(designs), len(count)))
    p = theta.shape[1]
    for _ in range(_ROUNDS):
        for i, design in enumerate(designs):
            rest = _residual(low.record, [design] if design.shape[1] else [], base + columns @ theta[i])
            target[i] = np.add.reduceat(rest**2, starts) / count
        if p:
            # the likelihood has local maxima: one start is the fit of the whole record, the other has little of every term
            flat = np.median(target / means[1], axis=1)[:, None] * (means[1] / means[0].T).min(axis=1)[None, :]
            begin = np.concatenate([theta, np.maximum(flat, theta / _STRONGEST)])
            found = minimise(means[0], np.tile(target, (2, 1)), count, begin, base=means[1], rtol=ROUGH)
            costs = found.cost.reshape(2, -1)
            theta = found.theta.reshape(2, len(designs), p)[np.argmin(costs, axis=0), np.arange(len(designs))]
        s = means[1] + theta @ means[0].T
        cost = np.sum(count * (np.log(s) + target / s), axis=1)
        if not any(design.shape[1] for design in designs) or np.all(cost > wanted + _HOPELESS):
            break
    return theta, cost
