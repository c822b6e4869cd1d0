"""`density`: compute spectra, on the host or in a trace."""

import functools
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np

from .._answer import Finding
from .._precision import host_float64
from .._quality import checked_rate
from .._types import Any, Checked, Leaf, Samples
from ..evidence._uneven import widened
from . import _ordinates
from ._average import GROUPS, Groups, average as average_over
from ._checks import check_options, checked_record, checked_segment
from ._findings import FINDINGS
from ._result import Spectrum


@host_float64
def density(
    y: Samples,
    rate: Leaf,
    *,
    method: str = "periodogram",
    sided: int = 2,
    average: Checked[str] = "octave",
    confidence: float | int = 0.95,
    segment: Checked[int] | None = None,
    overlap: float | int = 0.5,
    keep_tail: bool = False,
) -> Spectrum:
    r"""Power spectral density with its chi-square interval: periodogram, Welch's method or DCT-II spectrum.

    With :math:`X_j = \sum_t y_t e^{-2\pi i j t/n}`, :math:`f_j = j/(n\,dt)`, the two-sided periodogram is

    .. math:: S_j = \frac{dt}{n} |X_j|^2,\qquad 0 < f_j \le \frac{1}{2\,dt},

    The one-sided periodogram is twice that, except for the ordinate at half the sampling rate, which exists for even n and is not doubled.
    The one-sided ordinates times 1/(n dt) add up to the mean square of the record without its mean. Frequency zero is left out.

    The periodogram uses the record as it is. If noise grows towards low frequencies or the record drifts, power leaks into other
    frequencies; a random walk comes out about twice too high. Welch's method averages overlapping segments under a Hann window: this
    reduces leakage, but gives no frequency below that of a segment. The DCT-II spectrum,

    .. math:: P_k = dt\, c_k^2,\qquad f_k = \frac{k}{2\,n\,dt},\quad k = 1 \ldots n-1,

    with c the orthonormal DCT-II, needs no window and has no leakage. Its ordinates are independent to within 5 %, each with one degree
    of freedom instead of two; a random walk has exactly the expectation :math:`K^2 dt^2 / (2\sin(\pi k/2n))^2`.

    Parameters
    ----------
    y : (n,) or (n, channels) samples in any unit (rad/s, m/s^2), without gaps.
    rate : sampling rate in Hz.
    method : "periodogram" (default), "welch" or "dct".
    sided : 2 (default), the convention of all noise coefficients in jaxcal, or 1, the convention of data sheets, which is twice as high.
    average : mean over neighbouring ordinates, in frequency and density. "octave" (default): ordinates 1 to 32 single, then 16
        values per octave (192 from 32,768 ordinates). "log": the first 48 single, then 40 values per decade. None: no average.
    confidence : level of the intervals, 0.95 by default. They hold for noise whose density is flat within the ordinates of a value.
    segment : length of Welch's segments in samples; by default the largest power of two up to an eighth of the record.
    overlap : share of a Welch segment that the next one contains too.
    keep_tail : also average the last ordinates if they do not fill their group; by default they are left out.

    Returns
    -------
    Spectrum
        frequency in Hz, density and its limits in the unit of y squared per Hz, counts and degrees of freedom.

    Raises
    ------
    DataError
        If y is constant, too short, or not finite everywhere (the message names the longest stretch without gaps), or an option
        is unknown.

    Examples
    --------
    White noise of density N^2 = 4:

    >>> import numpy as np
    >>> import jaxcal
    >>> white = 2.0 * np.sqrt(100.0) * np.random.default_rng(0).standard_normal(65_536)
    >>> result = jaxcal.spectrum.density(white, rate=100.0)
    >>> len(result.frequency), bool(abs(result.density[-1] / 4.0 - 1) < 0.1)
    (192, True)

    References
    ----------
    Averaging: thesis, Table 5.1 (its equation 5.11, for even n, is low by 2). P. D. Welch, IEEE Trans. Audio Electroacoust.
    15, 1967, 70-73. DCT-II: N. Ahmed, T. Natarajan and K. R. Rao, IEEE Trans. Computers C-23, 1974, 90-93.
    """
    check_options(method, sided, average, confidence)
    rate = checked_rate(rate)
    record = checked_record(y, rate)
    samples = record.shape[0]
    length, step = checked_segment(segment, overlap, method, samples)
    x, like = _centred(record)
    if method == "welch":
        found = _ordinates.welch(x, 1.0 / rate, length, step)
    else:
        found = (_ordinates.periodogram if method == "periodogram" else _ordinates.dct)(x, 1.0 / rate)
    cut = (length, step, (samples - length) // step + 1)
    return spectrum_of(found, rate, method, sided, average, confidence, bool(keep_tail), cut, record.ndim == 1, like, x.T)


def spectrum_of(
    found: Any, rate: float, method: str, sided: int, average: Any, confidence: float, keep_tail: bool, cut: tuple[int, int, int],
    flat: bool, like: Callable[[np.ndarray], Any] = np.asarray, record: Any = None,
) -> Spectrum:  # fmt: skip
    """Average the ordinates (channels, ordinates), with their intervals; `cut` is length, distance and number of the segments.

    The intervals are wider for a level that wanders in the `record`, (n, channels), if it is at hand.
    """
    length, step, segments = cut
    ordinates, bins = (length - 1, 2 * length) if method == "dct" else (length // 2, length)
    groups = GROUPS[average](ordinates, keep_tail=keep_tail)
    size = np.full(ordinates, 2.0 if sided == 1 else 1.0)
    if sided == 1 and method != "dct" and length % 2 == 0:
        size[-1] = 1.0
    v = _ordinates.welch_correlation(segments, length, step) if method == "welch" else np.ones(1)
    edf = groups[1].astype(np.float64) if method == "dct" else _ordinates.degrees_of_freedom(v, groups, size, length)
    if method == "welch":
        edf[0] = _ordinates.first_of_welch(segments, length, step)
    if sided == 1:
        found = found * like(size)[None, :]
    values = average_over(found, groups).T
    freedom, findings = np.repeat(edf[:, None], values.shape[1], axis=1), _left_out(ordinates, groups, rate / bins)
    if isinstance(record, np.ndarray):
        freedom, uneven = widened(freedom, record, 1, len(record) / rate, FINDINGS)
        findings = (*findings, *uneven)
    lower, upper = (values * like(factor) for factor in _ordinates.interval_factors(freedom, confidence))
    if flat:
        values, lower, upper, freedom = (array[:, 0] for array in (values, lower, upper, freedom))
    frequency = average_over(np.arange(1.0, ordinates + 1), groups) * (rate / bins)
    return Spectrum(
        frequency=frequency, density=values, lower=lower, upper=upper, count=groups[1] * segments, edf=freedom, method=method,
        sided=int(sided), average=average, rate=rate, confidence=confidence, findings=findings,
    )  # fmt: skip


def _centred(y: Any) -> tuple[Any, Callable[[np.ndarray], Any]]:
    """The record without its mean as (channels, n), and a function that makes an array of the same kind."""
    columns = y.T if y.ndim == 2 else y[None, :]
    if isinstance(y, np.ndarray):
        return np.subtract(columns, columns.mean(axis=1, keepdims=True), order="C"), np.asarray
    return columns - jnp.mean(columns, axis=1, keepdims=True), functools.partial(jnp.asarray, dtype=y.dtype)


def _left_out(ordinates: int, groups: Groups, spacing: float) -> tuple[Finding, ...]:
    """A finding on ordinates that do not fill a group."""
    first = int(groups[0][-1] + groups[1][-1])
    if first == ordinates:
        return ()
    return (FINDINGS("tail", lowest=(first + 1) * spacing, lost=ordinates - first, ordinates=ordinates),)
