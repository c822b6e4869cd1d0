"""`Spectrum`: a power spectral density with its uncertainty."""

from typing import Any

import equinox as eqx

from .._frozen import channel_of
from .._results import Row, Unjudged, columns_of, rows_of
from .._types import AnyArray


class Spectrum(Unjudged):
    """A power spectral density at frequencies above zero, with chi-square intervals.

    The first axis of every array is the frequency; arrays of a record with channels have a second axis.

    Attributes
    ----------
    frequency : (values,) Hz, mean over the averaged ordinates.
    density : (values,) or (values, channels), in the squared unit of the record per Hz; two-sided, or one-sided if `sided` is 1.
    lower, upper : limits of the interval at level `confidence`, same shape and unit as `density`.
    count : (values,) number of ordinates averaged; for Welch's method over neighbours and segments.
    edf : (values,) equivalent degrees of freedom of each value.
    method : "periodogram", "welch" or "dct".
    sided : 2 if the power is spread over positive and negative frequencies, 1 if all of it is assigned to positive ones.
    average : how neighbouring ordinates were averaged: "octave", "log" or None.
    rate : sampling rate in Hz.
    confidence : level of the interval.
    warnings : sentences on parts of the record or of the frequencies that were left out.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(4096)
    >>> found = jaxcal.spectrum.density(y, rate=100.0)
    >>> found.sided, bool(found.lower[-1] < 0.01 < found.upper[-1])
    (2, True)
    """

    frequency: AnyArray
    density: AnyArray
    lower: AnyArray
    upper: AnyArray
    count: AnyArray
    edf: AnyArray
    method: str = eqx.field(static=True)
    sided: int = eqx.field(static=True)
    average: str | None = eqx.field(static=True)
    rate: float = eqx.field(static=True)
    confidence: float = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())

    _figure = ("spectrum", False)

    def _columns(self) -> dict[str, Any]:
        return columns_of(self, ("frequency", "density", "lower", "upper", "count", "edf"))

    def _rows(self) -> list[Row]:
        return rows_of(self, "density", lambda i: f"density at {float(self.frequency[i]):.4g} Hz", "unit^2/Hz")

    def channel(self, index: int) -> "Spectrum":
        """The same result for one of several channels."""
        return channel_of(self, "density", index)
