"""`fit_recordings`: noise coefficients of one device from several recordings, with an interval for the next recording."""

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._results import Result, Row
from ._fit import fit
from ._model import Noise, noise_of
from ._result import UNITS, NoiseFit
from ._terms import Term


class RecordingsFit(Result):
    """Noise coefficients of one device from several recordings.

    Attributes
    ----------
    noise : `Noise` of the device: geometric means over the recordings. A term that is not present in all recordings has 0.
    interval : term -> (low, high) that contains the coefficient of the next recording at level `confidence`. For a term that is not
        present in all recordings, it reaches from 0 to the largest upper limit of a recording.
    between : term -> standard deviation between recordings of the logarithm of the coefficient, without the errors of the recordings;
        0.1 is 10 %. NaN for a term that is not present in all recordings.
    verdict : term -> "present" if every recording shows it, "hint" if at least one does, otherwise "not detected".
    fits : `NoiseFit` of each recording.
    warnings : sentences.
    confidence : level of the intervals.

    Examples
    --------
    >>> import jaxcal
    >>> records = [jaxcal.noise.Noise(N=n).simulate(5000, rate=100.0, seed=i) for i, n in enumerate((0.010, 0.011, 0.009, 0.010))]
    >>> found = jaxcal.noise.fit_recordings(records, rate=100.0)
    >>> found.verdict["N"], len(found.fits)
    ('present', 4)
    """

    noise: Noise
    interval: dict[str, tuple[float, float]]
    between: dict[str, float]
    verdict: dict[str, str]
    fits: tuple[NoiseFit, ...]
    warnings: tuple[str, ...]
    confidence: float = eqx.field(static=True)

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(self.verdict)

    @property
    def upper_limit(self) -> dict[str, float]:
        """Term -> high end of its interval."""
        return {term: high for term, (_, high) in self.interval.items()}

    @property
    def reason(self) -> str:
        """Number of recordings, and the terms that are present in all of them."""
        shown = [term for term, verdict in self.verdict.items() if verdict == "present"]
        return f"{len(self.fits)} recordings; {', '.join(shown) or 'no term'} in all of them"

    def _rows(self) -> list[Row]:
        rows = self.verdict.items()
        return [Row(term, self.noise.coefficient(term), *self.interval[term], UNITS.get(term, "SI"), verdict) for term, verdict in rows]


def fit_recordings(
    records: Sequence[Any],
    rate: float,
    *,
    terms: Sequence[str | Term] = ("Q", "N", "B", "K"),
    confidence: float = 0.95,
    band: Any = None,
    robust: bool = False,
) -> RecordingsFit:
    r"""Noise coefficients of one device from several recordings, with intervals for the next recording.

    Recordings of one device differ by more than their own errors. The model takes the logarithms of a coefficient as normally distributed
    about the value of the device. If k recordings have mean logarithm m and standard deviation s, the next one lies within

    .. math:: m \pm t_{k-1}\, s\,\sqrt{1 + 1/k}

    at the stated level, with t the quantile of Student's law. s is at least as large as the errors of the recordings. The interval is
    wide for two or three recordings, because they say little of the scatter.

    Parameters
    ----------
    records : two recordings or more, each (n,) samples in rad/s, m/s^2 or T; NaN marks a gap. Lengths may differ.
    rate : sampling rate in Hz of all recordings.
    terms, band, robust : as in `fit`.
    confidence : level of the intervals.

    Returns
    -------
    RecordingsFit

    Raises
    ------
    DataError
        If there are fewer than two recordings, or one has several channels; and as `fit`, naming the recording.

    Examples
    --------
    >>> import jaxcal
    >>> records = [jaxcal.noise.Noise(N=n).simulate(5000, rate=100.0, seed=i) for i, n in enumerate((0.010, 0.011, 0.009, 0.010))]
    >>> found = jaxcal.noise.fit_recordings(records, rate=100.0)
    >>> low, high = found.interval["N"]
    >>> found.verdict["N"], bool(low < 0.0105 < high), round(found.between["N"], 1)
    ('present', True, 0.1)

    References
    ----------
    Prediction interval of a normal sample: G. J. Hahn and W. Q. Meeker, Statistical Intervals, Wiley, 1991.
    """
    if len(records) < 2:
        raise DataError(f"{len(records)} recording{'s' * (len(records) != 1)}: two at least show how recordings differ; use fit for one")
    fits = []
    for i, record in enumerate(records):
        if np.ndim(record) != 1:
            raise DataError(f"recording {i} has the shape {np.shape(record)}; give one channel, (n,), of each recording")
        try:
            fits.append(fit(record, rate, terms=terms, confidence=confidence, band=band, robust=robust))
        except DataError as error:
            raise DataError(f"recording {i}: {error}") from error
    return pooled(fits, confidence)


def pooled(fits: Sequence[NoiseFit], confidence: float) -> RecordingsFit:
    """Pool the fits of one channel in several recordings, as `fit_recordings` does."""
    first, values = fits[0], {}
    interval: dict[str, tuple[float, float]] = {}
    between, verdict = {}, {}
    reach = float(scipy.special.stdtrit(len(fits) - 1, 0.5 + confidence / 2.0)) * np.sqrt(1.0 + 1.0 / len(fits))
    for i, term in enumerate(first.terms):
        shown = [one.verdict[term] == "present" for one in fits]
        verdict[term] = "present" if all(shown) else "hint" if any(shown) else "not detected"
        if not all(shown):
            values[term], between[term] = 0.0, np.nan
            interval[term] = 0.0, max(float(one.upper_limit[term]) for one in fits)
            continue
        logs = np.log([float(one.noise.coefficient(term)) for one in fits])
        own = np.mean([one.covariance[i, i] / (4.0 * float(one.noise.coefficient(term)) ** 4) for one in fits])
        scatter = np.var(logs, ddof=1)
        width = reach * np.sqrt(max(scatter, own))
        middle = logs.mean()
        values[term], between[term] = float(np.exp(middle)), float(np.sqrt(max(scatter - own, 0.0)))
        interval[term] = float(np.exp(middle - width)), float(np.exp(middle + width))
    parts = [first.noise.part(term)[2] for term in first.terms]
    said = tuple(f"recording {i}: {sentence}" for i, one in enumerate(fits) for sentence in one.warnings)
    return RecordingsFit(noise_of(parts, list(values.values())), interval, between, verdict, tuple(fits), said, confidence)
