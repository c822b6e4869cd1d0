"""Results as one HTML page, and as a JSON document."""

from ._document import noise_document as noise_document
from ._thermal import temperature_document as temperature_document
from ._write import write as write
