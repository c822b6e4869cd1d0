"""`cross`: how much power channels share at each frequency."""

from itertools import combinations
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Grid, Number, Result, Section
from .._errors import DataError
from .._precision import host_float64
from .._quality import checked_confidence, checked_rate
from .._types import AnyArray
from ._average import GROUPS, average as average_over
from ._checks import check_options, checked_record


class CrossSpectrum(Result):
    """Cross-spectral density and coherence of several channels.

    Attributes
    ----------
    frequency : (values,) Hz, mean over the averaged ordinates.
    density : (values, channels, channels) complex, two-sided, in the products of the channels' units per Hz. The diagonal is the
        spectrum of each channel; the phase of an entry [i, j] is the phase of channel i relative to channel j.
    coherence : (values, channels, channels) squared modulus of the density over both spectra, 0 to 1; 1 for a single ordinate.
    level : (values,) coherence that independent channels exceed with the probability 1 - confidence; NaN for a single ordinate.
    count : (values,) number of ordinates averaged.
    rate : sampling rate in Hz.
    confidence : confidence of `level`.
    findings : none so far.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> a, b, common = np.random.default_rng(0).standard_normal((3, 4096))
    >>> found = jaxcal.spectrum.cross(np.stack([a + common, b + common], axis=1), rate=100.0)
    >>> found.coherence.shape[1:], bool(found.coherence[-1, 0, 1] > found.level[-1])
    ((2, 2), True)
    """

    frequency: AnyArray
    density: AnyArray
    coherence: AnyArray
    level: AnyArray
    count: AnyArray
    rate: float = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """Number of channels, and range of frequencies."""
        return f"{self.coherence.shape[1]} channels, {self.frequency[0]:.4g} to {self.frequency[-1]:.4g} Hz"

    def sections(self) -> list[Section]:
        """The largest coherence of each pair of channels, and its frequency."""
        rows, judged = [], np.flatnonzero(self.count > 1)
        for i, j in combinations(range(self.coherence.shape[1]), 2):
            values = self.coherence[judged, i, j]
            top = int(judged[np.argmax(values)]) if len(judged) else 0
            largest = Number(f"coherence[{i},{j}]", float(self.coherence[top, i, j]))
            rows.append((f"{i} and {j}", (largest, Number(f"frequency[{i},{j}]", float(self.frequency[top]), quantity="frequency"))))
        return [Grid("coherence", "channels", ("largest coherence", "at (Hz)"), tuple(rows))]


@host_float64
def cross(y: Any, rate: Any, *, average: Any = "octave", confidence: float = 0.95) -> CrossSpectrum:
    r"""Cross-spectral density and coherence of the channels of a record.

    With the transforms X of both channels, averaged over the n ordinates of each group of neighbouring frequencies,

    .. math:: S_{ij} = \frac{dt}{N} \langle X_i X_j^* \rangle,\qquad
        \gamma^2_{ij} = \frac{|S_{ij}|^2}{S_{ii} S_{jj}},\qquad
        P(\gamma^2 > g) = (1 - g)^{n-1}

    for independent channels. Because neighbouring ordinates are averaged, a delay between the channels that exceeds the inverse width of
    a group lowers the coherence.

    Parameters
    ----------
    y : (n, channels) samples without gaps, with at least two channels.
    rate : sampling rate in Hz.
    average : groups of neighbouring ordinates, "octave" (default) or "log", as in `density`.
    confidence : confidence of `level`.

    Returns
    -------
    CrossSpectrum

    Raises
    ------
    DataError
        If there is only one channel, the record has gaps, or an option is unknown.

    Examples
    --------
    Two channels that share half of their power:

    >>> import numpy as np
    >>> import jaxcal
    >>> a, b, common = np.random.default_rng(0).standard_normal((3, 65_536))
    >>> found = jaxcal.spectrum.cross(np.stack([a + common, b + common], axis=1), rate=100.0)
    >>> bool(abs(found.coherence[-1, 0, 1] - 0.25) < 0.05), bool(found.level[-1] < 0.01)
    (True, True)

    References
    ----------
    J. S. Bendat and A. G. Piersol, Random Data, Wiley, 2010, section 9.2; level for independent channels: N. R. Goodman, 1957.
    """
    check_options("periodogram", 2, average, confidence)
    if average is None:
        raise DataError('coherence needs an average over ordinates: average="octave" or "log"', code="average")
    rate, confidence = checked_rate(rate), checked_confidence(confidence)
    y = np.asarray(checked_record(y, rate))
    if y.ndim != 2 or y.shape[1] < 2:
        raise DataError(f"a cross-spectrum is of two channels or more, (n, channels); got the shape {y.shape}", code="shape")
    transform = np.asarray(scipy.fft.rfft(y - y.mean(axis=0), axis=0)).T[:, 1:] / np.sqrt(len(y) * rate)
    groups = GROUPS[average](transform.shape[1], keep_tail=False)
    products = transform[:, None] * transform[None].conj()
    density = np.moveaxis(average_over(products, groups), -1, 0)
    power = np.real(np.einsum("fii->fi", density))
    coherence = np.abs(density) ** 2 / (power[:, :, None] * power[:, None, :])
    count = groups[1]
    level = np.where(count > 1, 1.0 - (1.0 - confidence) ** (1.0 / np.maximum(count - 1, 1)), np.nan)
    frequency = average_over(np.arange(1.0, transform.shape[1] + 1), groups) * (rate / len(y))
    return CrossSpectrum(frequency, density, coherence, level, count, rate, confidence)
