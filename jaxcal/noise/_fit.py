"""`fit`: noise coefficients of a record, and `characterise`: of every channel of a log."""

from collections.abc import Callable

import numpy as np

from .._errors import DataError
from .._log import Log
from .._precision import host_float64, is_traced
from ..allan import deviation
from ._edf import CLUSTERS, fit_curve
from ._model import TERMS
from ._result import NoiseFit, stacked

_METHODS = ("edf",)


@host_float64
def fit(y, rate, *, method="edf", terms=("Q", "N", "B", "K"), confidence=0.95, band=None) -> NoiseFit:
    r"""Noise coefficients of a static record, with intervals.

    The overlapped Allan variance at about 25 cluster sizes up to a quarter of the record is fitted with

    .. math:: \sigma^2(\tau) = \frac{3Q^2}{\tau^2} + \frac{N^2}{\tau} + \frac{2\ln 2}{\pi}B^2 + \frac{K^2\tau}{3} + \frac{R^2\tau^2}{2}

    in its exact form for samples, all terms jointly and none negative. The weights follow from the equivalent degrees of
    freedom at the fit itself, iterated. Neighbouring cluster sizes say nearly the same thing, so the covariance of the
    coefficients, the intervals and the verdicts use the exact covariance of the whole curve. Intervals invert the
    chi-square test of each value of a coefficient: the covariance is that under the value tested.

    Short cluster times at which the model does not hold (a filter, averaging or an oscillation in the sensor) are left out and
    named. What these leave at longer cluster times falls as 1/tau^2 with either sign; a tail of that form is then fitted beside
    the terms, so that it biases none of them, and Q, which has the same slope, is not estimated. Where the curve scatters more
    than the noise model allows, the intervals are widened to the scatter, with a warning.

    Parameters
    ----------
    y : (n,) or (n, channels) samples in rad/s, m/s^2 or T. NaN marks a gap.
    rate : sampling rate in Hz.
    method : "edf", the weighted Allan variance fit described above.
    terms : which of "Q", "N", "B", "K", "R" to fit.
    confidence : level of the intervals and upper limits.
    band : (shortest, longest) cluster time in s to fit, instead of the band found by the chi-square.

    Returns
    -------
    NoiseFit
        Coefficients in SI units, per channel where y has channels. The coefficients and `covariance` can be differentiated
        with respect to y; intervals carry no derivative.

    Raises
    ------
    DataError
        If the record is constant, too short for the terms, or not finite (NaN apart), or an option is unknown.
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
    IEEE Std 952-1997, annex C (model); Greenhall and Riley, PTTI 2003 (degrees of freedom). Covariance: see
    `jaxcal.noise._covariance`. Thresholds for a coefficient at its bound: Self and Liang, J. Am. Stat. Assoc. 82, 1987.
    """
    if method not in _METHODS:
        raise DataError(f"unknown method {method!r}; expected one of {', '.join(_METHODS)}")
    terms = _checked_terms(terms)
    y = y if is_traced(y) else np.asarray(y)
    samples = y.shape[0] if y.ndim else 0
    # the noise type serves the plot outside of the band; a traced record has no plot
    curve = deviation(y, rate, m=_clusters(samples, terms), confidence=confidence, alpha=0 if is_traced(y) else None)
    if not is_traced(y):
        _refuse_constant(curve.deviation)
    inside = _inside(curve.tau, band, terms)
    if y.ndim == 1:
        return fit_curve(curve, samples, terms, inside, band is None, confidence)
    channels = [curve.channel(i) for i in range(y.shape[1])]
    return stacked([fit_curve(one, samples, terms, inside, band is None, confidence) for one in channels])


def characterise(
    log: Log,
    *,
    method="edf",
    terms=("Q", "N", "B", "K"),
    confidence=0.95,
    band=None,
    progress: Callable[[int, int, str], None] | None = None,
) -> dict[str, NoiseFit]:
    """Noise coefficients of every gyroscope, accelerometer and magnetometer channel of a static log.

    Parameters
    ----------
    log : the `Log`.
    method, terms, confidence, band : as in `fit`.
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
    channels = {name: values for name, values in log.channels().items() if name != "temperature"}
    if not channels:
        raise DataError("the log has no gyroscope, accelerometer or magnetometer channel; name its columns with columns=")
    report = progress or (lambda done, total, name: None)
    fits = {}
    for done, (name, values) in enumerate(channels.items()):
        report(done, len(channels), name)
        try:
            fits[name] = fit(values, log.rate, method=method, terms=terms, confidence=confidence, band=band)
        except DataError as error:
            raise DataError(f"{name}: {error}") from error
    report(len(channels), len(channels), "")
    return fits


def _checked_terms(terms) -> tuple[str, ...]:
    terms = tuple(terms)
    unknown = [term for term in terms if term not in TERMS]
    if unknown or not terms or len(set(terms)) != len(terms):
        raise DataError(f"terms must be distinct names among {', '.join(TERMS)}; got {terms!r}")
    return terms


def _clusters(samples: int, terms) -> np.ndarray:
    """Cluster sizes of the fit: log-spaced from 1 to a quarter of the record."""
    fewest = len(terms) + 3
    if samples < 4 * fewest:
        raise DataError(
            f"{samples} sample{'s are' if samples != 1 else ' is'} too short a record to fit {len(terms)} noise terms; "
            f"record at least {4 * fewest} samples (an hour or more, for bias instability), or ask for fewer terms"
        )
    return np.unique(np.round(np.logspace(0.0, np.log10(samples // 4), CLUSTERS)).astype(np.int64))


def _refuse_constant(found) -> None:
    dead = np.flatnonzero(np.all(found.reshape(len(found), -1) == 0.0, axis=0))
    if len(dead):
        where = f"channel {dead[0]} is" if found.ndim == 2 else "the record is"
        raise DataError(
            f"{where} constant (every sample equal): there is no noise to characterise. Check that the sensor was running and "
            "that its resolution is finer than its noise; leave a dead channel out"
        )


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
