"""Power spectral density of a record."""

from ._density import density as density
from ._result import Spectrum as Spectrum
from ._segments import Segments as Segments
