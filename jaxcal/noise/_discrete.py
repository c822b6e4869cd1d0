"""`discrete`: convert a noise model to a linear Gaussian state-space model at a sampling rate, for Kalman filters."""

import collections
import dataclasses
import functools
import math

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import is_traced
from .._types import Any, Checked, Float, Numbers
from ._model import Noise, checked_sampling
from ._terms import GaussMarkov, Term

#: lowest frequency of the default band, one cycle per hour, and the largest error of the density that the default chain may have; most
_LOWEST, _ERROR, _MOST_STATES = 1.0 / 3600.0, 0.1, 32
#: order of the terms in the state vector; terms of the user's own come last
_ORDER = ("K", "B", "flicker", "markov", "Q", "N", "R", "sinusoid")
#: frequencies per decade at which a chain is fitted, and the multiple of that number at which its error is determined
_PER_DECADE, _CLOSER = 24, 4
#: lowest corner frequencies to try, relative to the lower end of the band; the highest ones are their inverses, relative to the upper end
_LOW_CORNER = np.geomspace(0.2, 6.0, 12)


class StateSpace(eqx.Module):
    r"""Noise y of one channel, sampled at `rate`, as a linear Gaussian state-space model.

    .. math:: x_{t+1} = F x_t + w_t,\quad \mathrm{Cov}\,w = P,\qquad y_t = H x_t + v_t,\quad \mathrm{Var}\,v = r

    A filter that estimates a rate or a specific force uses P and r as its noise covariances, and adds H x to its model of the reading.
    All values are per sample at this rate: do not multiply them by the sampling interval. The states by name, with dt = 1/rate:

    ================  ==============================  ============================  =============  =====================
    state             transition                      variance per step             output         variance at the start
    ================  ==============================  ============================  =============  =====================
    (N: no state)                                     r = N^2 rate
    walk (K)          1                               K^2 dt                        1              0
    flicker i (B)     a = exp(-dt/Tc)                 qc^2 Tc/2 (1 - a^2)           1              qc^2 Tc/2
    markov i          the same, for the Gauss-Markov processes of the noise model
    next, last (Q)    last becomes next               Q^2 for next, 0 for last      rate, -rate    Q^2
    ramp, slope (R)   ramp grows by dt times slope    0                             1, 0           0, R^2
    cos i, sin i      rotation by 2 pi f0 dt          0                             1, 0           A^2/2
    ================  ==============================  ============================  =============  =====================

    Walk, flicker, markov, ramp and sinusoid states are in the unit of y (rad/s, m/s^2), and slope in that unit per second. The states of
    Q are in rad (m/s): they are the rounding errors of the integrated output after and before the sample.

    Attributes
    ----------
    transition : (states, states) transition matrix F of one step.
    process : (states, states) covariance P of the process noise of one step.
    output : (states,) output vector H.
    white : r, variance of the white noise of a sample; 0 if the model has no N.
    initial : (states, states) covariance of the states at the first sample.
    names : names of the states, in order.
    rate : sampling rate in Hz.
    noise : the same model as a `Noise`, in which the chain of Gauss-Markov processes replaces B; `noise.avar` and `noise.psd` with
        dt = 1/rate are exactly those of the matrices.
    chain : ((qc, Tc), ...) of the flicker states, as in `Noise.markov`; empty if no term needs a chain. Besides B, terms of your own
        without an exact state-space form need one.
    band : (low, high) frequencies in Hz between which the chain follows flicker. This and the next are None without a chain.
    psd_error : largest relative error of the density of the chain in `band`. That of the Allan deviation between the cluster times
        0.5/high and 0.1/low is less than half of it.

    Examples
    --------
    >>> import jaxcal
    >>> model = jaxcal.noise.discrete(jaxcal.noise.Noise(N=0.01, K=1e-4), rate=100.0)
    >>> model.names, model.transition.tolist(), round(float(model.white), 6)
    (('walk',), [[1.0]], 0.01)
    """

    transition: Float[np.ndarray, "states states"]
    process: Float[np.ndarray, "states states"]
    output: Float[np.ndarray, " states"]
    white: float
    initial: Float[np.ndarray, "states states"]
    rate: float
    noise: Noise
    chain: tuple[tuple[float, float], ...]
    band: tuple[float, float] | None
    psd_error: float | None
    names: tuple[str, ...] = eqx.field(static=True)


def discrete(noise: Checked[Noise], rate: Numbers, *, states: Numbers | None = None, band: Numbers | None = None) -> StateSpace:
    r"""Convert noise to a state-space model at a sampling rate: the process and measurement noise of a Kalman filter.

    Every term except flicker is exact. Flicker has no state-space form with finitely many states. A sum of first-order Gauss-Markov
    processes, called the chain, approximates it between the frequencies of `band`,

    .. math:: \frac{B^2}{2\pi f} \approx \sum_i \frac{(q_i T_i)^2}{1 + (2\pi f T_i)^2},

    with both sides in their exact form for samples. The corner frequencies 1/(2 pi Tc) are equally spaced in the logarithm. The
    strengths follow from non-negative least squares of the relative error. Several ranges of corner frequencies are tried, and the one
    with the smallest maximum error is kept. Above the band the density of the chain falls as 1/f^2, below the band it is constant, so
    the variance of the chain is finite.

    Parameters
    ----------
    noise : `Noise` of one channel. `states` and `band` are ignored if it has neither B nor terms of your own.
    rate : rate in Hz at which the filter takes samples.
    states : number of Gauss-Markov processes for B. None takes the fewest whose density is within 10 % of flicker in the band (5 % in
        the deviation), which is about one per decade of the band; 1.5 per decade bring the error to 4 % or less.
    band : (low, high) frequencies in Hz, at least a decade apart. None takes one cycle per hour to half the rate.
        To cover cluster times from t1 to t2, give 0.1/t2 to 0.5/t1.

    Returns
    -------
    StateSpace
        Matrices of the model, with the band and the errors of the chain.

    Raises
    ------
    DataError
        If the noise has several channels, a coefficient is negative or not finite, or the rate, the number of states or the band is
        out of range.

    Examples
    --------
    A gyroscope with 0.25 deg/sqrt(h), a bias instability of 8 deg/h and a rate random walk, for a filter at 100 Hz:

    >>> import numpy as np
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=np.deg2rad(0.25 / 60), B=np.deg2rad(8 / 3600), K=1e-6)
    >>> model = jaxcal.noise.discrete(gyro, rate=100.0, states=3, band=(0.001, 1.0))
    >>> model.names
    ('walk', 'flicker 1', 'flicker 2', 'flicker 3')
    >>> f"{model.white:.2e} {model.process[0, 0]:.2e}, chain within {100 * model.psd_error:.0f} %"
    '5.29e-07 1.00e-14, chain within 13 %'

    References
    ----------
    IEEE Std 952-1997, annex C (terms). Flicker as a sum of relaxation processes: van der Ziel, Physica 16, 1950, 359-372;
    Keshner, Proc. IEEE 70, 1982, 212-218.
    """
    noise, rate = _checked_model(noise, rate)
    blocks, chains = [], []
    limits, error = None, None
    for name, coefficient, term in sorted(noise.parts, key=lambda part: (*_ORDER, part[0]).index(part[0])):
        block = term.states(1.0 / rate)
        if coefficient > 0.0 and block is not None:
            blocks.append((name, coefficient, block))
        elif coefficient > 0.0:
            limits = _checked_band(band, rate)
            unit, largest = _chain(term, rate, limits, _checked_states(states))
            chains += [(coefficient * strength, time) for strength, time in unit]
            label = "flicker" if name == "B" else name
            blocks += [(label, strength, GaussMarkov(time=time).states(1.0 / rate)) for strength, time in chains[-len(unit) :]]
            error = max(error or 0.0, largest)
    held = [(coefficient, block) for _, coefficient, block in blocks if block.names]
    exact = tuple(part for part in noise.further if part[1].states(1.0 / rate) is not None)

    def diagonal(matrices):
        return np.asarray(scipy.linalg.block_diag(*matrices)) if matrices else np.zeros((0, 0))

    return StateSpace(
        transition=diagonal([np.asarray(block.transition, dtype=float) for _, block in held]),
        process=diagonal([coefficient**2 * np.asarray(block.process) for coefficient, block in held]),
        output=np.array([value for _, block in held for value in block.output], dtype=float),
        white=float(sum(coefficient**2 * block.white for _, coefficient, block in blocks)),
        initial=diagonal([coefficient**2 * np.asarray(block.initial) for coefficient, block in held]),
        noise=dataclasses.replace(noise, B=0.0, markov=(*noise.markov, *chains), further=exact),
        names=_numbered([(label, block.names) for label, _, block in blocks]),
        rate=rate, chain=tuple(chains), band=limits, psd_error=error,
    )  # fmt: skip


def _numbered(blocks: list[tuple[str, tuple[str, ...]]]) -> tuple[str, ...]:
    """Names of the states, numbered if there can be several of the same kind."""
    count: collections.Counter[str] = collections.Counter()
    found = []
    for label, names in blocks:
        count[label] += 1
        several = label in ("flicker", "markov", "sinusoid") or label not in _ORDER
        stems = (label,) if names == ("markov",) else names
        found += [f"{stem} {count[label]}" if several else stem for stem in stems]
    return tuple(found)


def _chain(term: Term, rate: float, band: tuple[float, float], states: int | None):
    """The chain for a term of coefficient one, and the largest error of its density in the band."""
    tried = (_unit_chain(term, band, rate, number) for number in (range(1, _MOST_STATES + 1) if states is None else (states,)))
    unit, error = next((found for found in tried if found[1] <= _ERROR or states is not None), ((), math.inf))
    if not unit:
        span = f"{band[0]:g} to {band[1]:g} Hz"
        raise DataError(f"no chain of {_MOST_STATES} states is within {100 * _ERROR:g} % from {span}; choose states=")
    return unit, error


@functools.lru_cache(maxsize=64)
def _unit_chain(term: Term, band: tuple[float, float], rate: float, states: int) -> tuple[tuple[tuple[float, float], ...], float]:
    """((qc, Tc), ...) of the chain for a coefficient of one, and the largest relative error of its density in the band."""
    low, high = band
    number = math.ceil(_PER_DECADE * _CLOSER * math.log10(high / low)) + 1
    f = np.geomspace(low, high, number)
    f[-1] = high
    corner = [np.geomspace(low * a, max(high * b, low * a), states) for a in _LOW_CORNER for b in 1.0 / _LOW_CORNER]
    correlation = 1.0 / (2.0 * math.pi * np.array(corner))
    # ratio of two densities of samples: a Gauss-Markov process of unit strength, and the term
    wanted = np.asarray(term.psd(f, 1.0 / rate))[:, None, None]
    relative = GaussMarkov(time=correlation).psd(f[:, None, None], 1.0 / rate) / wanted
    best = (), math.inf
    for i, times in enumerate(correlation):
        columns = relative[:, i]
        scale = np.max(columns, axis=0)
        found = scipy.optimize.nnls(columns[::_CLOSER] / scale, np.ones(len(f[::_CLOSER])))[0] / scale
        reached = columns @ found
        middle = (np.max(reached) + np.min(reached)) / 2.0  # division by it makes the largest errors up and down equal
        if np.max(reached) / middle - 1.0 < best[1]:
            strengths = np.sqrt(found / middle).tolist()
            unit = tuple((strength, time) for strength, time in zip(strengths, times.tolist(), strict=True) if strength > 0.0)
            best = unit, float(np.max(reached) / middle - 1.0)
    return best


def _checked_model(noise: Any, rate: Any) -> tuple[Noise, float]:
    if not isinstance(noise, Noise):
        raise DataError(f"noise must be a jaxcal.noise.Noise (a fit has one, fit.noise); got {type(noise).__name__}")
    if is_traced(noise, rate):
        raise DataError("discrete builds its chain on the host; call it outside of jit, vmap and grad")
    if any(np.ndim(value) for value in jax.tree.leaves(noise)):
        raise DataError("noise has several channels, and a state-space model is of one; take noise.channel(0) and so on")
    checked_sampling(1, rate)
    noise.check()
    return jax.tree.map(lambda value: float(value) if eqx.is_array_like(value) else value, noise), float(rate)


def _checked_states(states: Any) -> int | None:
    if states is None or (isinstance(states, (int, np.integer)) and not isinstance(states, bool) and 1 <= states <= _MOST_STATES):
        return None if states is None else int(states)
    raise DataError(f"states must be a whole number from 1 to {_MOST_STATES}, or None for the fewest that serve; got {states!r}")


def _checked_band(band: Any, rate: float) -> tuple[float, float]:
    most = rate / 2.0
    try:
        low, high = (_LOWEST, most) if band is None else (float(edge) for edge in band)
    except (TypeError, ValueError):
        raise DataError(f"band must be (low, high) in Hz; got {band!r}") from None
    if not (low > 0.0 and 10.0 * low <= high * (1.0 + 1e-9) and high <= most * (1.0 + 1e-9)):
        got = f"the default band is {low:g} to {high:g} Hz; give band=" if band is None else f"got {band!r}"
        raise DataError(
            f"band must be (low, high) in Hz, above 0, at least a decade wide and no higher than half the rate, {most:g} Hz; {got}"
        )
    return low, min(high, most)
