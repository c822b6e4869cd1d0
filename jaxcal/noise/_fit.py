"""`fit`: noise coefficients of a record, and `characterise`: of every channel of a log."""

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from .._errors import DataError
from .._frozen import replaced
from .._log import as_log
from .._precision import host_float64, is_traced
from .._quality import checked_rate, refuse_other_than_samples
from .._types import Any
from ..allan import deviation
from ._axes import sentences_of_axes
from ._checks import find_jumps, refuse_alike, refuse_extremes, resolution, sentences_of_checks
from ._display import fit_plainly
from ._joint import fit_jointly, with_second_opinion
from ._model import checked_terms
from ._observed import without_gaps
from ._overbound import overbound
from ._result import NoiseFit, stacked
from ._terms import GaussMarkov, Term
from ._whittle import fit_record, fit_traced

#: number of cluster sizes of a curve; neighbouring values are so strongly correlated that more would add no information
_CLUSTERS = 25
_MOST_EVENTS = 20  # largest number of steps among the events
#: name -> function of (curve, samples, terms, inside, automatic, confidence)
CURVES = {method: partial(fit_jointly, method=method) for method in ("gls", "edf", "wavelet")} | {
    method: partial(fit_plainly, method=method) for method in ("unweighted", "log", "slope")
}


def fit(
    y: Any,
    rate: float,
    *,
    method: str = "whittle",
    terms: Sequence[str | Term] = ("Q", "N", "B", "K"),
    confidence: float = 0.95,
    band: Any = None,
    conservative: bool = False,
    robust: bool = False,
) -> NoiseFit:
    r"""Noise coefficients of a static record, with intervals and verdicts.

    All terms are fitted jointly, none negative, in their exact form for samples. The default method maximises the Whittle
    likelihood of the ordinates P_k of the record's DCT-II,

    .. math:: -\ell(\theta) = \frac12\sum_k \Big[\ln S_k + \frac{P_k}{S_k}\Big],\qquad
              S = \frac{Q^2}{dt}s^2 + N^2 + \frac{B^2 dt}{s} + \frac{K^2 dt^2}{s^2},\quad s = 2\sin(\pi f dt)

    which reaches the information that the record holds. Intervals are those of the profile likelihood. The other methods fit
    the overlapped Allan variance sigma^2(tau) = 3Q^2/tau^2 + N^2/tau + (2 ln2/pi)B^2 + K^2 tau/3 + R^2 tau^2/2.

    The fit leaves out high frequencies (short cluster times) at which the model does not hold because of a filter, averaging or a
    resonance in the sensor, and names them. The effect of a filter below these frequencies is then fitted in place of Q, which has the
    same shape. Spectral lines become sinusoids of the model. If the record scatters more than the model allows, the intervals are wider,
    with a warning. A step, a ramp, a warm-up or a slow sinusoid is fitted together with the noise, and named. Noise of another exponent, or
    Gauss-Markov processes, become part of the model if they explain the slow noise better than B and K. If they explain it about as
    well, B or K is a hint at most, with a note, and the interval of N holds for both models. If the record does not decide between the
    models, coefficients and intervals are means over them, with a warning or a note. Single outlying samples are replaced by
    the mean of their neighbours, and counted.

    Parameters
    ----------
    y : (n,) or (n, channels) samples in rad/s, m/s^2 or T. NaN marks a gap.
    rate : sampling rate in Hz.
    method : "whittle"; or, on the Allan variance, "gls" (full covariance across tau), "edf" (weights from the degrees of
        freedom), "wavelet" (Haar, powers of two); or for comparison only, without uncertainty, "unweighted", "log", "slope".
    terms : which of "Q", "N", "B", "K", "R" to fit, and `Term` objects of your own, whose shape parameters stay fixed. With "whittle"
        also "markov", one first-order Gauss-Markov process, whose correlation time is estimated.
    confidence : level of the intervals and upper limits.
    band : (shortest, longest) cluster time in s to fit, instead of the band found; for "whittle" frequencies 1/(2 tau).
    conservative : also give coefficients whose Allan deviation is nowhere below the upper limit of the measured one, `overbound`.
    robust : whether the white noise may have heavy tails, with "whittle". The likelihood chooses between normal noise, Student's t, and a
        normal core with uniform bursts or with one or two wider components. N is the standard deviation of Student's t or of the core; a
        warning names the law.

    Returns
    -------
    NoiseFit
        Coefficients in SI units, for each channel if y has channels. The coefficients and `covariance` can be differentiated
        with respect to y; intervals have no derivative. A traced record is fitted as it is: nothing is checked or left out.

    Raises
    ------
    DataError
        If the record is constant, too short for the terms, or not finite (NaN apart), if two terms have densities of the same shape, or
        if an option is unknown.
    FitError
        If the fit did not give finite coefficients.

    Examples
    --------
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3, K=1e-4).simulate(100_000, rate=100.0, seed=0)
    >>> found = jaxcal.noise.fit(record, rate=100.0)
    >>> low, high = found.interval["N"]
    >>> bool(low < 1e-3 < high), found.verdict["N"]
    (True, 'present')

    References
    ----------
    P. Whittle, J. R. Stat. Soc. B 15, 1953. IEEE Std 952-1997, annex C (model); Greenhall and Riley, PTTI 2003 (degrees of
    freedom). Covariance of the Allan variance: `allan_covariance`. Thresholds for a coefficient at its bound: Self
    and Liang, J. Am. Stat. Assoc. 82, 1987.
    """
    return _fit(y, rate, method, terms, confidence, band, conservative, robust)


@host_float64
def _fit(y, rate, method, terms, confidence, band, conservative=False, robust=False, temperature=None) -> NoiseFit:
    if method not in ("whittle", *CURVES):
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(('whittle', *CURVES))}")
    refuse_other_than_samples(y)
    terms = checked_terms(terms)
    if method != "whittle" and any(isinstance(term, GaussMarkov) and term.time is None for term in terms):
        raise DataError(f'the correlation time of a Gauss-Markov process is found by method "whittle"; got method {method!r}')
    if robust and method != "whittle":
        raise DataError(f'a robust fit needs method "whittle"; got method {method!r}')
    if not 0.0 < confidence < 1.0:
        raise DataError(f"confidence must lie between 0 and 1; got {confidence!r} (0.95 is 95 %)")
    traced, rate = is_traced(y), checked_rate(rate)
    y = y if traced else np.asarray(y)
    samples, many = y.shape[0] if y.ndim else 0, y.ndim == 2
    m, jumps = clusters(method, samples, terms), []
    refuse_alike(terms, samples, 1.0 / rate)
    if traced:
        if robust:
            raise DataError("heavy tails are found by a search on the host; ask for robust=True outside of jit, vmap and grad")
        if conservative:
            raise DataError("conservative coefficients need a linear programme on the host; ask for them outside of jit, vmap and grad")
        if method == "whittle":
            fits = [fit_traced(x, rate, terms, band, confidence) for x in (y.T if many else (y,))]
            return stacked(fits) if many else fits[0]
    elif y.dtype.kind in "fiu" and y.ndim in (1, 2):
        refuse_extremes(y)
        jumps = [find_jumps(x) for x in (y.T if many else (y,))]
        if robust:
            jumps = [found._replace(y=x, spikes=0, heavy=False, steps=()) for found, x in zip(jumps, y.T if many else (y,), strict=True)]
        if any(found.spikes and not found.heavy for found in jumps):
            y = np.stack([found.y for found in jumps], axis=1).reshape(y.shape)
    # the likelihood later fills gaps with noise of its model, and computes the curve again; straight lines serve until then
    filled = y if traced or method != "whittle" else without_gaps(y)
    curve = deviation(filled, rate, m=m, confidence=confidence, alpha=0 if traced else None)
    inside = _inside(curve.tau, band, terms)
    curves = [curve.channel(i) for i in range(curve.deviation.shape[1])] if many else [curve]
    if method != "whittle":
        fits = [CURVES[method](one, samples, terms, inside, band is None, confidence) for one in curves]
    else:
        each = zip(y.T if many else (y,), curves, strict=True)
        fits = [with_second_opinion(fit_record(x, one, terms, band, confidence, temperature, robust), samples) for x, one in each]
    for i, jump in enumerate(jumps):
        white = float(np.asarray(fits[i].noise.N)) ** 2
        said = sentences_of_checks(jump, *resolution(y[:, i] if many else y), 1.0 / curve.rate, white)
        at = [sample / curve.rate for sample in jump.steps[:_MOST_EVENTS]]
        events = tuple(sorted([*((time, time, "step") for time in at), *fits[i].events]))
        fits[i] = replaced(fits[i], warnings=(*said, *fits[i].warnings), events=events)
    if conservative:
        fits = [replaced(found, conservative=overbound(found)) for found in fits]
    return stacked(fits) if many else fits[0]


def characterise(
    log: Any,
    *,
    rate: float | None = None,
    method: str = "whittle",
    terms: Sequence[str | Term] = ("Q", "N", "B", "K"),
    confidence: float | int = 0.95,
    band: Any = None,
    conservative: bool = False,
    robust: bool = False,
    progress: Callable[[int, int, str], None] | None = None,
) -> dict[str, NoiseFit]:
    """Noise coefficients of every gyroscope, accelerometer and magnetometer channel of a static log.

    Where the white noise of two axes of a sensor is correlated by more than 5 %, a note says so; `correlation` gives its covariance.

    Parameters
    ----------
    log : the `Log`, or anything that `jaxcal.read` takes: a path, a data frame, a dataset, a dictionary of arrays.
    rate : sampling rate in Hz, where what is given has no times.
    method, terms, confidence, band, conservative, robust : as in `fit`.
    progress : called as progress(done, total, channel) before each channel, and once at the end.

    Returns
    -------
    dict
        Channel name (gyro_x .. mag_z) -> `NoiseFit`.

    Raises
    ------
    DataError
        As `fit`, naming the channel; or if the log has no sensor channel.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=[1e-4, 1e-4, 2e-4]).simulate(5000, rate=100.0, seed=0)
    >>> fits = jaxcal.noise.characterise(jaxcal.Log(None, gyro=gyro, rate=100.0))
    >>> sorted(fits)
    ['gyro_x', 'gyro_y', 'gyro_z']
    """
    log = as_log(log, rate)
    channels = log.channels()
    temperature = channels.pop("temperature", None)
    if not channels:
        raise DataError("the log has no gyroscope, accelerometer or magnetometer channel; name its columns with columns=")
    report = progress or (lambda done, total, name: None)
    fits = {}
    for done, (name, values) in enumerate(channels.items()):
        report(done, len(channels), name)
        try:
            found = _fit(values, log.rate, method, terms, confidence, band, conservative, robust, temperature)
            fits[name] = replaced(found, sensor=name.partition("_")[0])
        except DataError as error:
            raise DataError(f"{name}: {error}") from error
    for sensor in {name.partition("_")[0] for name in fits}:
        axes = {name: fit for name, fit in fits.items() if fit.sensor == sensor}
        if len(axes) > 1:
            for name, sentence in sentences_of_axes(np.stack([channels[name] for name in axes], axis=1), log.rate, axes).items():
                fits[name] = replaced(fits[name], notes=(*fits[name].notes, sentence))
    report(len(channels), len(channels), "")
    return fits


def clusters(method: str, samples: int, terms: Sequence[Any]) -> np.ndarray:
    """Cluster sizes for a fit: powers of two for "wavelet", else about 25 log-spaced, from 1 to a quarter of the record."""
    fewest = len(terms) + 3
    needed = 4 * (2 ** (fewest - 1) if method == "wavelet" else fewest)
    if samples < needed:
        hint = ", another method" if method == "wavelet" and samples >= 4 * fewest else ""
        raise DataError(
            f"{samples} sample{'s are' if samples != 1 else ' is'} too short a record to fit {len(terms)} noise terms; "
            f"record at least {needed} samples (an hour or more, for bias instability){hint}, or ask for fewer terms"
        )
    if method == "wavelet":
        return 2 ** np.arange((samples // 4).bit_length())
    return np.unique(np.round(np.logspace(0.0, np.log10(samples // 4), _CLUSTERS)).astype(np.int64))


def _inside(tau, band, terms) -> np.ndarray:
    if band is None:
        return np.ones(len(tau), dtype=bool)
    try:
        low, high = (float(edge) for edge in band)
    except (TypeError, ValueError):
        raise DataError(f"band must be (shortest, longest) cluster time in s; got {band!r}") from None
    inside = (tau >= low * (1 - 1e-9)) & (tau <= high * (1 + 1e-9))
    if inside.sum() <= len(terms):
        raise DataError(
            f"the band {low:g} s to {high:g} s holds {inside.sum()} cluster times, too few for {len(terms)} terms; "
            f"widen it (the record has {tau[0]:g} s to {tau[-1]:g} s) or ask for fewer terms"
        )
    return inside
