"""`Spectrum`: a power spectral density with its uncertainty."""

import equinox as eqx
import numpy as np

from .._answer import Curve, Finding, Number
from .._answer._curves import SENSORS, Curved, Curves, Labelled, at_decades, labelled
from .._types import AnyArray
from ._ordinates import interval_factors


class Spectrum(Curved):
    """A power spectral density at frequencies above zero, with chi-square intervals.

    The first axis of every array is the frequency; arrays of a record with channels have a second axis.

    Attributes
    ----------
    frequency : (values,) Hz, mean over the averaged ordinates.
    density : (values,) or (values, channels), in the squared unit of the record per Hz; two-sided, or one-sided if `sided` is 1.
    lower, upper : limits of the interval at level `confidence`, same shape and unit as `density`.
    count : (values,) number of ordinates averaged; for Welch's method over neighbours and segments.
    edf : equivalent degrees of freedom of each value, same shape as `density`; fewer where the noise is uneven in time.
    method : "periodogram", "welch" or "dct".
    sided : 2 if the power is spread over positive and negative frequencies, 1 if all of it is assigned to positive ones.
    average : how neighbouring ordinates were averaged: "octave", "log" or None.
    rate : sampling rate in Hz.
    confidence : level of the interval.
    findings : on parts of the record or of the frequencies that were left out.

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
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    _figure, _value = ("spectrum", False), "density"
    _note = "The root of the density, and the rms over all frequencies."

    @property
    def headline(self) -> str:
        """Method and range of frequencies."""
        sided = "one" if self.sided == 1 else "two"
        return f"{self.method}, {sided}-sided, {self.frequency[0]:.4g} to {self.frequency[-1]:.4g} Hz"

    @property
    def _title(self) -> str:
        return self.method

    def _quantity(self, name: str) -> str:
        sensor = name.partition("_")[0]
        return f"{sensor}^2/Hz" if sensor in SENSORS else "unit^2/Hz"

    def _numbers(self, name: str) -> Labelled:
        """The root of the density with its 95 % interval at powers of ten of the frequency, and the rms over all frequencies."""
        sensor, prefix = name.partition("_")[0], f"{name}." * bool(name)
        root, unit = (f"N.{sensor}", f"B.{sensor}") if sensor in SENSORS else ("unit/sqrt(Hz)", "unit")
        density, low, high = (np.asarray(curve, dtype=float) for curve in (self.density, self.lower, self.upper))
        if self.confidence != 0.95:
            low, high = (density * factor for factor in interval_factors(np.asarray(self.edf), 0.95))
        roots = at_decades(self.frequency, *map(np.sqrt, (density, low, high)))
        main, more = labelled({f: Number(f"{prefix}root_density({f:g} Hz)", v, a, b, root) for f, (v, a, b) in roots.items()}, "at {:g} Hz")
        # every average begins with a single ordinate, at the distance of the ordinates
        power = float(np.sum(density * np.asarray(self.count) / self.count[0])) * float(self.frequency[0])
        main["rms"] = Number(f"{prefix}rms", (power * self.sided) ** 0.5, quantity=unit)
        return main, more

    def _drawn(self, name: str) -> Curve:
        known = {"frequency": "frequency"} | dict.fromkeys(("density", "lower", "upper"), self._quantity(name))
        names = ("frequency", "density", "lower", "upper", "count", "edf")
        columns = {column: (known.get(column, "ratio"), getattr(self, column)) for column in names}
        return Curve(name or "curve", f"density of {name}" if name else "density", columns)


class Spectra(Curves[Spectrum]):
    """Spectra of the channels of a log: channel -> `Spectrum`. The sensor that a name begins with tells the unit.

    Parameters
    ----------
    results : channel -> `Spectrum`.
    left_out : findings on channels without a spectrum.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = 1e-4 * np.random.default_rng(0).standard_normal((10_000, 2))
    >>> found = jaxcal.spectrum.density(y, 100.0, keep_tail=True)
    >>> print(jaxcal.spectrum.Spectra({"gyro_x": found.channel(0), "gyro_y": found.channel(1)}))
    Spectra: good: 2 channels, periodogram, two-sided, 0.01 to 49.33 Hz
    <BLANKLINE>
    gyroscope                 x                 y
    at 1 Hz     deg/sqrt(h)    0.050 ± 0.031     0.034 ± 0.021
    at 10 Hz    deg/sqrt(h)   0.0339 ± 0.0060   0.0361 ± 0.0064
    rms         deg/h         20.52             20.57
      The root of the density, and the rms over all frequencies.
    """

    _figure = ("spectrum", False)


Spectrum._several = Spectra
