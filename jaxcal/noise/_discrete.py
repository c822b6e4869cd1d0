"""`discrete`: a noise model as a linear Gaussian state-space model at a sampling rate, for Kalman filters."""

import functools
import math

import equinox as eqx
import numpy as np
import scipy.linalg
import scipy.optimize

from .._errors import DataError
from .._precision import is_traced
from .._types import Any, Float
from ._model import Noise, numbers
from ._simulate import checked

#: lowest frequency of the default band, one cycle per hour, and the error of the density that the default chain may have
_LOWEST = 1.0 / 3600.0
_ERROR = 0.1
_MOST_STATES = 32
#: frequencies per decade at which a chain is fitted, and how many times as many at which its error is found
_PER_DECADE, _CLOSER = 24, 4
#: lowest and highest corner frequency that are tried, over the lower and over the upper end of the band
_LOW_CORNER = np.geomspace(0.2, 6.0, 12)
_HIGH_CORNER = np.geomspace(0.15, 5.0, 12)


class StateSpace(eqx.Module):
    r"""Noise y of one channel, sampled at `rate`, as a linear Gaussian state-space model.

    .. math:: x_{t+1} = F x_t + w_t,\quad \mathrm{Cov}\,w = P,\qquad y_t = H x_t + v_t,\quad \mathrm{Var}\,v = r

    A filter that estimates a rate or a specific force takes P and r for its noise, and adds H x to its model of the reading. Every
    value is exact at this rate; nothing is left to be multiplied by the sampling interval. The states by name, with dt = 1/rate:

    ================  ==============================  ============================  =============  =====================
    state             transition                      variance per step             output         variance at the start
    ================  ==============================  ============================  =============  =====================
    (N: no state)                                     r = N^2 rate
    walk (K)          1                               K^2 dt                        1              0
    flicker i (B)     a = exp(-dt/Tc)                 qc^2 Tc/2 (1 - a^2)           1              qc^2 Tc/2
    markov i          the same, for the processes that the model itself has
    next, last (Q)    last becomes next               Q^2 for next, 0 for last      rate, -rate    Q^2
    ramp, slope (R)   ramp grows by dt times slope    0                             1, 0           0, R^2
    cos i, sin i      rotation by 2 pi f0 dt          0                             1, 0           A^2/2
    ================  ==============================  ============================  =============  =====================

    Walk, flicker, markov, ramp and sinusoid states are in the unit of y (rad/s, m/s^2), slope in that unit per second, the
    states of Q in rad (m/s): they are the rounding errors of the integrated output after and before the sample.

    Attributes
    ----------
    transition : (states, states) F.
    process : (states, states) P, per step.
    output : (states,) H.
    white : r, variance of the white noise of a sample; 0 where the model has no N.
    initial : (states, states) covariance of the states at the first sample.
    names : names of the states, in order.
    rate : sampling rate in Hz.
    noise : the same model as a `Noise`, in which the chain of Gauss-Markov processes stands for B.
    chain : ((qc, Tc), ...) of the flicker states, as in `Noise.markov`; empty without B.
    band : (low, high) frequencies in Hz between which the chain follows flicker; None without B, as the next three.
    clusters : (shortest, longest) cluster times in s that this band serves: 0.5/high and 0.1/low.
    psd_error : largest relative error of the density of the chain in `band`.
    deviation_error : largest relative error of the Allan deviation of the chain in `clusters`.
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
    clusters: tuple[float, float] | None
    psd_error: float | None
    deviation_error: float | None
    names: tuple[str, ...] = eqx.field(static=True)

    def avar(self, tau):
        """Allan variance of y at cluster time tau in s (multiples of 1/rate), as `Noise.avar` with `dt`.

        Examples
        --------
        >>> import jaxcal
        >>> model = jaxcal.noise.discrete(jaxcal.noise.Noise(N=2.0), rate=10.0)
        >>> float(model.avar(4.0))
        1.0
        """
        return self.noise.avar(tau, dt=1.0 / self.rate)

    def psd(self, f):
        """Two-sided power spectral density of y at frequency f in Hz, as `Noise.psd` with `dt`.

        Examples
        --------
        >>> import jaxcal
        >>> model = jaxcal.noise.discrete(jaxcal.noise.Noise(N=2.0), rate=10.0)
        >>> float(model.psd(1.0))
        4.0
        """
        return self.noise.psd(f, dt=1.0 / self.rate)


def discrete(noise, rate, *, states=None, band=None) -> StateSpace:
    r"""Noise as a state-space model at a sampling rate: the process and measurement noise of a Kalman filter.

    Every term but flicker is exact. Flicker has no finite state: between the frequencies of `band` a sum of first-order
    Gauss-Markov processes stands for it,

    .. math:: \frac{B^2}{2\pi f} \approx \sum_i \frac{(q_i T_i)^2}{1 + (2\pi f T_i)^2},

    both sides in their exact form for samples. The corner frequencies 1/(2 pi Tc) are equally spaced in the logarithm, the
    strengths follow from non-negative least squares of the relative error, and of several ranges of corners the one with the
    smallest largest error is taken. Above the band the chain falls as 1/f^2, below it is level: its variance is finite.

    Parameters
    ----------
    noise : `Noise` of one channel. Without B, `states` and `band` have no bearing.
    rate : rate in Hz at which the filter takes samples.
    states : number of Gauss-Markov processes for B; None for the fewest whose density is within 10 % in the band (5 % in the
        deviation). About one per decade of the band does that; with 1.5 per decade it is 4 % or less.
    band : (low, high) frequencies in Hz, at least a decade apart; None for one cycle per hour to half the rate (or to the
        cut-off). For cluster times from t1 to t2 take 0.1/t2 to 0.5/t1.

    Returns
    -------
    StateSpace
        Matrices, with the band and the error of the chain.

    Raises
    ------
    DataError
        If the noise is of several channels, a coefficient is negative or not finite, or the rate, the number of states or the
        band is out of range.

    Examples
    --------
    A gyroscope with 0.25 deg/sqrt(h), a bias instability of 8 deg/h and a rate random walk, for a filter at 100 Hz:

    >>> import numpy as np
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=np.deg2rad(0.25 / 60), B=np.deg2rad(8 / 3600), K=1e-6)
    >>> model = jaxcal.noise.discrete(gyro, rate=100.0, states=3, band=(0.001, 1.0))
    >>> model.names
    ('walk', 'flicker 1', 'flicker 2', 'flicker 3')
    >>> f"{model.white:.2e} {model.process[0, 0]:.2e}, chain within {100 * model.deviation_error:.0f} %"
    '5.29e-07 1.00e-14, chain within 3 %'

    References
    ----------
    IEEE Std 952-1997, annex C (terms). Flicker as a sum of relaxation processes: van der Ziel, Physica 16, 1950, 359-372;
    Keshner, Proc. IEEE 70, 1982, 212-218.
    """
    noise, rate = _checked_model(noise, rate)
    chain, quality = (), dict.fromkeys(("band", "clusters", "psd_error", "deviation_error"))
    if noise.B > 0.0:
        chain, quality = _chain(noise, rate, _checked_band(band, rate, noise.cutoff), _checked_states(states))
    names, transition, process, output, initial = _states(noise, chain, rate)
    return StateSpace(
        transition=transition,
        process=process,
        output=output,
        white=noise.N**2 * rate,
        initial=initial,
        rate=rate,
        noise=Noise(Q=noise.Q, N=noise.N, K=noise.K, R=noise.R, markov=(*noise.markov, *chain), sinusoid=noise.sinusoid),
        chain=chain,
        names=names,
        **quality,
    )


def _states(noise: Noise, chain: tuple[tuple[float, float], ...], rate: float):
    """Names of the states, F, P, H and the covariance at the start."""
    dt = 1.0 / rate
    blocks: list[tuple[Any, Any, Any, Any, Any]] = []
    if noise.K > 0.0:
        blocks.append((("walk",), [[1.0]], [[noise.K**2 * dt]], [1.0], [[0.0]]))
    for kind, processes in (("flicker", chain), ("markov", noise.markov)):
        for i, (strength, correlation) in enumerate(processes, start=1):
            start = strength**2 * correlation / 2.0
            step = -start * math.expm1(-2.0 * dt / correlation)
            blocks.append(((f"{kind} {i}",), [[math.exp(-dt / correlation)]], [[step]], [1.0], [[start]]))
    if noise.Q > 0.0:
        error = noise.Q**2
        blocks.append((("next", "last"), [[0.0, 0.0], [1.0, 0.0]], [[error, 0.0], [0.0, 0.0]], [rate, -rate], error * np.eye(2)))
    if noise.R > 0.0:
        blocks.append((("ramp", "slope"), [[1.0, dt], [0.0, 1.0]], np.zeros((2, 2)), [1.0, 0.0], [[0.0, 0.0], [0.0, noise.R**2]]))
    for i, (amplitude, frequency) in enumerate(noise.sinusoid, start=1):
        c, s = math.cos(2.0 * math.pi * frequency * dt), math.sin(2.0 * math.pi * frequency * dt)
        blocks.append(((f"cos {i}", f"sin {i}"), [[c, s], [-s, c]], np.zeros((2, 2)), [1.0, 0.0], amplitude**2 / 2.0 * np.eye(2)))
    names = tuple(name for block in blocks for name in block[0])
    output = np.array([value for block in blocks for value in block[3]], dtype=float)
    return names, *(_diagonal([block[i] for block in blocks]) for i in (1, 2)), output, _diagonal([block[4] for block in blocks])


def _diagonal(blocks) -> Float[np.ndarray, "states states"]:
    """Block-diagonal matrix."""
    return np.asarray(scipy.linalg.block_diag(*blocks)) if blocks else np.zeros((0, 0))


def _chain(noise: Noise, rate: float, band: tuple[float, float], states: int | None):
    """The chain for B, and its band, the cluster times it serves and its errors in both."""
    unit, error = _fewest(band, rate) if states is None else _unit_chain(band, rate, states)
    chain = tuple((noise.B * strength, correlation) for strength, correlation in unit)
    shortest, longest = max(0.5 / band[1], 1.0 / rate), 0.1 / band[0]
    m = np.unique(np.round(np.geomspace(shortest, longest, 200) * rate))
    m = m[(m >= shortest * rate * (1.0 - 1e-9)) & (m <= longest * rate * (1.0 + 1e-9))]
    got, wanted = (n.avar(m / rate, dt=1.0 / rate) for n in (Noise(markov=unit), Noise(B=1.0, cutoff=noise.cutoff)))
    off = float(np.max(np.abs(np.sqrt(got / wanted) - 1.0)))
    return chain, {"band": band, "clusters": (shortest, longest), "psd_error": error, "deviation_error": off}


def _fewest(band: tuple[float, float], rate: float):
    for states in range(1, _MOST_STATES + 1):
        chain, error = _unit_chain(band, rate, states)
        if error <= _ERROR:
            return chain, error
    raise DataError(f"no chain of {_MOST_STATES} states is within {100 * _ERROR:g} % from {band[0]:g} to {band[1]:g} Hz; choose states=")


@functools.lru_cache(maxsize=64)
def _unit_chain(band: tuple[float, float], rate: float, states: int) -> tuple[tuple[tuple[float, float], ...], float]:
    """((qc, Tc), ...) for B = 1, and the largest relative error of its density in the band."""
    low, high = band
    number = math.ceil(_PER_DECADE * _CLOSER * math.log10(high / low)) + 1
    f = np.geomspace(low, high, number)
    f[-1] = high
    corner = [np.geomspace(low * a, max(high * b, low * a), states) for a in _LOW_CORNER for b in _HIGH_CORNER]
    correlation = 1.0 / (2.0 * math.pi * np.array(corner))
    # density of a Gauss-Markov process of unit strength over that of flicker, both of samples
    s, step = 2.0 * np.sin(math.pi * f / rate)[:, None, None], -np.expm1(-1.0 / (rate * correlation))
    relative = correlation / 2.0 * step * (2.0 - step) * s / (step**2 + (1.0 - step) * s**2)
    best, strength, error = 0, np.zeros(states), math.inf
    for i in range(len(corner)):
        columns = relative[:, i]
        scale = np.max(columns, axis=0)
        found = scipy.optimize.nnls(columns[::_CLOSER] / scale, np.ones(len(f[::_CLOSER])))[0] / scale
        reached = columns @ found
        middle = (np.max(reached) + np.min(reached)) / 2.0  # dividing by it makes both errors equal
        if np.max(reached) / middle - 1.0 < error:
            best, strength, error = i, found / middle, float(np.max(reached) / middle - 1.0)
    kept = strength > 0.0
    return tuple((math.sqrt(q), float(t)) for q, t in zip(strength[kept], correlation[best][kept], strict=True)), error


def _checked_model(noise: Any, rate: Any) -> tuple[Noise, float]:
    if not isinstance(noise, Noise):
        raise DataError(f"noise must be a jaxcal.noise.Noise (a fit has one, fit.noise); got {type(noise).__name__}")
    if is_traced(noise, rate):
        raise DataError("discrete builds its chain on the host; call it outside of jit, vmap and grad")
    if any(np.ndim(value) for value in numbers(noise)):
        raise DataError("noise has several channels, and a state-space model is of one; take noise.channel(0) and so on")
    checked(noise, 1, rate)
    terms = {term: float(getattr(noise, term)) for term in ("Q", "N", "B", "K", "R")}
    pairs = {kind: tuple((float(a), float(b)) for a, b in getattr(noise, kind)) for kind in ("markov", "sinusoid")}
    return Noise(**terms, **pairs, cutoff=float(noise.cutoff)), float(rate)


def _checked_states(states: Any) -> int | None:
    if states is None or (isinstance(states, (int, np.integer)) and not isinstance(states, bool) and 1 <= states <= _MOST_STATES):
        return None if states is None else int(states)
    raise DataError(f"states must be a whole number from 1 to {_MOST_STATES}, or None for the fewest that serve; got {states!r}")


def _checked_band(band: Any, rate: float, cutoff: float) -> tuple[float, float]:
    most = min(rate / 2.0, cutoff)
    try:
        low, high = (_LOWEST, most) if band is None else (float(edge) for edge in band)
    except (TypeError, ValueError):
        raise DataError(f"band must be (low, high) in Hz; got {band!r}") from None
    if not (low > 0.0 and 10.0 * low <= high * (1.0 + 1e-9) and high <= most * (1.0 + 1e-9)):
        end = f"half the rate, {most:g} Hz" if most == rate / 2.0 else f"the cut-off of flicker, {most:g} Hz"
        got = f"the default band is {low:g} to {high:g} Hz; give band=" if band is None else f"got {band!r}"
        raise DataError(f"band must be (low, high) in Hz, above 0, at least a decade wide and no higher than {end}; {got}")
    return low, min(high, most)
