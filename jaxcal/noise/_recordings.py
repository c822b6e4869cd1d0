"""`fit_recordings`: noise coefficients of one device from several recordings, with an interval for the next recording."""

from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Grid, Result, joined
from .._errors import DataError
from .._quality import checked_record
from .._types import Numbers
from ._fit import fit
from ._model import Noise, noise_of
from ._result import NoiseFit
from ._sections import grids, headline_of, rows_of
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
    presence : term -> "present" if every recording shows it, "hint" if at least one does, otherwise "not detected".
    fits : `NoiseFit` of each recording.
    findings : those of all recordings.
    sensor : as in `NoiseFit`.
    confidence : level of the intervals.

    Examples
    --------
    >>> import jaxcal
    >>> records = [jaxcal.noise.Noise(N=n).simulate(5000, rate=100.0, seed=i) for i, n in enumerate((0.010, 0.011, 0.009, 0.010))]
    >>> found = jaxcal.noise.fit_recordings(records, rate=100.0)
    >>> found.presence["N"], len(found.fits)
    ('present', 4)
    """

    noise: Noise
    interval: dict[str, tuple[float, float]]
    between: dict[str, float]
    presence: dict[str, str]
    fits: tuple[NoiseFit, ...]
    confidence: float = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())
    sensor: str = eqx.field(static=True, default="")
    method: str = eqx.field(static=True, default="whittle")

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the terms."""
        return tuple(self.presence)

    @property
    def upper_limit(self) -> dict[str, float]:
        """Term -> high end of its interval."""
        return {term: high for term, (_, high) in self.interval.items()}

    @property
    def headline(self) -> str:
        """How well N of the next recording is known."""
        return f"{headline_of({'': self})}, from {len(self.fits)} recordings"

    def sections(self) -> list[Any]:
        """The coefficients, with the intervals of the next recording."""
        return [Grid("recordings", f"next of {len(self.fits)} recordings", ("",), tuple(rows_of({"": self}, self.sensor)))]


def fit_recordings(
    records: Sequence[Any], rate: float, *, terms: Sequence[str | Term] = ("Q", "N", "B", "K"), confidence: float = 0.95,
    band: Numbers | None = None,
) -> RecordingsFit:  # fmt: skip
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
    terms, band : as in `fit`.
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
    >>> found.presence["N"], bool(low < 0.0105 < high), round(found.between["N"], 1)
    ('present', True, 0.1)

    References
    ----------
    Prediction interval of a normal sample: G. J. Hahn and W. Q. Meeker, Statistical Intervals, Wiley, 1991.
    """
    if len(records) < 2:
        raise DataError(f"{len(records)} recording{'s' * (len(records) != 1)}: two at least show how recordings differ; use fit for one")
    fits = []
    for i, record in enumerate(records):
        try:
            if (shape := checked_record(record).shape)[1:]:
                raise DataError(f"it has the shape {shape}; give one channel, (n,), of each recording")
            fits.append(fit(record, rate, terms=terms, confidence=confidence, band=band))
        except DataError as error:
            raise DataError(f"recording {i}: {error}") from error
    return pooled(fits, confidence)


def pooled(fits: Sequence[NoiseFit], confidence: float) -> RecordingsFit:
    """Pool the fits of one channel in several recordings, as `fit_recordings` does."""
    first, values = fits[0], {}
    interval: dict[str, tuple[float, float]] = {}
    between, presence = {}, {}
    reach = float(scipy.special.stdtrit(len(fits) - 1, 0.5 + confidence / 2.0)) * np.sqrt(1.0 + 1.0 / len(fits))
    for term in first.terms:
        shown = [one.presence[term] == "present" for one in fits]
        presence[term] = "present" if all(shown) else "hint" if any(shown) else "not detected"
        if not all(shown):
            values[term], between[term] = 0.0, np.nan
            interval[term] = 0.0, max(float(one.upper_limit[term]) for one in fits)
            continue
        logs = np.log([float(one.noise.coefficient(term)) for one in fits])
        own = np.mean([one.covariance[term, term] / (4.0 * float(one.noise.coefficient(term)) ** 4) for one in fits])
        scatter = np.var(logs, ddof=1)
        middle, width = logs.mean(), reach * np.sqrt(max(scatter, own))
        values[term], between[term] = float(np.exp(middle)), float(np.sqrt(max(scatter - own, 0.0)))
        interval[term] = float(np.exp(middle - width)), float(np.exp(middle + width))
    parts = [first.noise.part(term)[2] for term in first.terms]
    said = tuple(joined(finding for one in fits for finding in one.findings))
    noise = noise_of(parts, list(values.values()))
    return RecordingsFit(noise, interval, between, presence, tuple(fits), confidence, said, first.sensor)


def grids_of(recordings: Sequence[Mapping[str, NoiseFit]], confidence: float) -> list[Grid]:
    """A table for each sensor with the intervals of the next recording of the channels that all recordings have."""
    shared = [name for name in recordings[0] if all(name in one for one in recordings)]
    pools = {name: pooled([one[name] for one in recordings], confidence) for name in shared}
    return grids(pools, "next", f"next of {len(recordings)} recordings")
