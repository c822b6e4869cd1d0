"""`correlation`: correlation of the white noise between the axes of a sensor."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._arrays import longest_run
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence, checked_rate, checked_record
from .._types import Float, Numbers, Samples
from ._findings import FINDINGS
from ._model import Noise

#: information, in ordinates of pure white noise, below which no correlation is computed; ratio of an ordinate to its expectation that only
#: a line or a step exceeds: one in 2e7 ordinates of noise does
_FEWEST, _LARGEST = 100.0, 30.0
_DENSITIES = 500  # frequencies, evenly spaced in their logarithm, at which the density of a model is computed


class Correlation(Result):
    """Covariance and correlation of the white noise N of several axes.

    Attributes
    ----------
    covariance : (axes, axes) in unit^2/Hz: N^2 on the diagonal, elsewhere the correlation times N of both axes.
    correlation : (axes, axes) of the white noise, -1 to 1.
    interval : (axes, axes, 2) limits of the correlation at level `confidence`.
    findings : the axes whose noise is correlated by more than chance explains, and the samples used if some are missing.
    confidence : level of the intervals.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal((5000, 2))
    >>> found = jaxcal.noise.correlation(y, 1.0, [jaxcal.noise.Noise(N=1.0)] * 2)
    >>> print(repr(found).splitlines()[0], found.correlation.shape)
    Correlation: good: white noise correlated by up to ... (2, 2)
    """

    covariance: Float[np.ndarray, "axes axes"]
    correlation: Float[np.ndarray, "axes axes"]
    interval: Float[np.ndarray, "axes axes 2"]
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The largest correlation."""
        return f"white noise correlated by up to {np.max(np.abs(np.triu(self.correlation, 1))):.2g}"

    def sections(self) -> list[Section]:
        """The correlation of each pair of axes."""
        limits = [(i, j, *map(float, self.interval[i, j])) for i, j in combinations(range(len(self.correlation)), 2)]
        cells = [Number(f"correlation[{i},{j}]", float(self.correlation[i, j]), low, high) for i, j, low, high in limits]
        return [listed("correlation", "white noise", ((f"axes {one.name[12]} and {one.name[14]}", one) for one in cells))]


@host_float64
def correlation(y: Samples, rate: Numbers, fits: Sequence[Any], *, confidence: float = 0.95) -> Correlation:
    r"""Correlation of the white noise of several axes, such as a common supply or clock causes.

    S is the density of the fitted noise model of an axis. With the orthonormal DCT-II ordinates c of two axes and the share
    :math:`g_k = N_i N_j / \sqrt{S_{i,k} S_{j,k}}` of white noise in them, the correlation and its interval are

    .. math:: \rho = \frac{s_{ij}}{\sqrt{s_{ii} s_{jj}}},\qquad
        s_{ij} = \sum_k g_k \frac{dt\, c_{i,k} c_{j,k}}{\sqrt{S_{i,k} S_{j,k}}},\qquad
        \operatorname{artanh} \rho \pm \frac{z}{\sqrt{\sum_k g_k^2}} .

    The expected contribution of other noise, :math:`\sum_k g_k (1 - g_k)`, is subtracted from :math:`s_{ii}`. Ordinates above 30 times
    their expectation in any axis come from lines or steps and are left out.

    Parameters
    ----------
    y : (n, axes) samples in rad/s, m/s^2 or T. Only the longest stretch of rows without NaN is used.
    rate : sampling rate in Hz.
    fits : `NoiseFit` or `Noise` of each axis, such as `fit(y[:, i], rate)` returns. Every axis needs N above zero.
    confidence : level of the intervals.

    Returns
    -------
    Correlation

    Raises
    ------
    DataError
        If there is not one model for each axis, an axis has no N, or the record holds too little white noise.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> a, b = np.random.default_rng(0).standard_normal((2, 20_000))
    >>> y = np.stack([a, 0.6 * a + 0.8 * b], axis=1)
    >>> found = jaxcal.noise.correlation(y, 100.0, [jaxcal.noise.fit(axis, 100.0) for axis in y.T])
    >>> low, high = found.interval[0, 1]
    >>> bool(low < 0.6 < high), f"{high - low:.2f}"
    (True, '0.02')

    References
    ----------
    Interval of a correlation: R. A. Fisher, Metron 1, 1921.
    """
    rate, confidence, record = checked_rate(rate), checked_confidence(confidence), checked_record(y)
    if record.ndim != 2 or len(fits) != record.shape[1]:
        raise DataError(f"one noise model for each axis: got {len(fits)} models and a record of the shape {np.shape(record)}")
    models = [fit if isinstance(fit, Noise) else fit.noise for fit in fits]
    strength = np.array([float(model.N) for model in models])
    if np.any(strength <= 0.0):
        raise DataError(f"axis {int(np.argmin(strength))} has no white noise, N = 0: there is nothing to be correlated")
    gone = np.isnan(record).any(axis=1)
    start, stop = longest_run(~gone) if gone.any() else (0, len(gone))
    said = [FINDINGS("stretch", start=int(start), stop=int(stop))] if gone.any() else []
    # a transform of some lengths takes several times as long as of others nearby
    part = np.ascontiguousarray(record[start : start + scipy.fft.prev_fast_len(stop - start)].T)
    n, axes = part.shape[1], len(models)
    if n < _FEWEST:
        raise DataError(f"the longest stretch without gaps has {n} samples; a correlation needs {_FEWEST:.0f} at least")
    white = np.asarray(scipy.fft.dct(part - part.mean(axis=1, keepdims=True), norm="ortho"))[:, 1:]
    edges = np.unique(np.geomspace(1.0, n, _DENSITIES).astype(int))  # between two of them the densities hardly change
    starts, width = edges[:-1] - 1, np.diff(edges)
    frequency = (edges[:-1] + edges[1:] - 1) / 2.0 * (rate / (2.0 * n))
    parts = [model.parts for model in models]
    terms = {id(term): term for one in parts for *_, term in one}  # which the models share
    shapes = {place: np.asarray(term.psd(frequency, 1.0 / rate)) for place, term in terms.items()}
    density = np.array([sum(size**2 * shapes[id(term)] for _, size, term in one) for one in parts])
    largest = _LARGEST * rate * density
    for i in np.flatnonzero(np.any(np.maximum.reduceat(white**2, starts, axis=1) >= largest, axis=0)):
        part = white[:, starts[i] : starts[i] + width[i]]
        lines = np.any(part**2 >= largest[:, i, None], axis=0)
        part[:, lines] = 0.0
        width[i] -= np.count_nonzero(lines)
    share = strength[:, None] ** 2 / density
    sums = np.array([[np.add.reduceat(one * other, starts) for other in white] for one in white])
    both = np.einsum("ib,jb,ijb->ij", *[share / (strength[:, None] * np.sqrt(rate))] * 2, sums)
    # sum for each axis alone, minus its other noise: scatter common to both sums cancels, and so does a small error of the fitted level
    own = np.diagonal(both) + np.sum(width * share * (share - 1.0), axis=1)
    if not np.all(own > 0.0):
        raise DataError("white noise does not stand out in all axes; there is no correlation to find", code="no_white")
    rho = both / np.sqrt(np.outer(own, own))
    np.fill_diagonal(rho, 1.0)
    information = (width * share) @ share.T
    if np.min(information) < _FEWEST:
        raise DataError(f"white noise is worth {np.min(information):.0f} ordinates only; a correlation needs {_FEWEST:.0f}: N is too small")
    reach = float(scipy.special.ndtri(0.5 + confidence / 2.0)) / np.sqrt(information)
    middle = np.arctanh(np.where(np.eye(axes, dtype=bool), 0.0, np.clip(rho, -1.0 + 1e-12, 1.0 - 1e-12)))
    interval = np.stack([np.tanh(middle - reach), np.tanh(middle + reach)], axis=2)
    interval[np.arange(axes), np.arange(axes)] = 1.0
    for i, j in combinations(range(axes), 2):
        if interval[i, j, 0] > 0.0 or interval[i, j, 1] < 0.0:
            facts = dict(zip(("rho", "low", "high"), map(float, (rho[i, j], *interval[i, j])), strict=True))
            said.append(FINDINGS("correlated", cost=abs(facts["rho"]), pair=f"{i} and {j}", **facts))
    covariance = rho * np.outer(strength, strength)
    return Correlation(covariance, rho, interval, confidence, tuple(said))


def findings_of_axes(y: Any, rate: float, fits: Mapping[str, Any]) -> list[Finding]:
    """The pair of channels whose white noise is correlated most, if it matters; `y` is (n, channels)."""
    names = list(fits)
    try:
        found = correlation(y, rate, list(fits.values()))
    except DataError:
        return []  # without white noise, or with gaps everywhere, the correlation is unknown
    # the pair whose interval lies farthest from zero
    sure = np.triu(np.maximum(found.interval[:, :, 0], -found.interval[:, :, 1]), 1)
    i, j = np.unravel_index(np.argmax(sure), sure.shape)
    low, high = map(float, found.interval[i, j])
    pair, rho = " and ".join(names[k].rpartition("_")[2] for k in (i, j)), float(found.correlation[i, j])
    about = names[0].partition("_")[0]
    return FINDINGS.over("correlated", float(sure[i, j]), about, cost=abs(rho), pair=pair, rho=rho, low=low, high=high)
