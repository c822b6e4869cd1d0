"""Power spectral density of a record, and cross-spectra of its channels."""

from ._cross import CrossSpectrum as CrossSpectrum, cross as cross
from ._density import density as density
from ._result import Spectra as Spectra, Spectrum as Spectrum
from ._segments import Segments as Segments
