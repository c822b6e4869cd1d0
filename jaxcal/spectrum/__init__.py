"""Power spectral density of a record."""

from ._density import density as density
from ._result import Spectra as Spectra, Spectrum as Spectrum
