"""Results as one HTML page, and as a JSON document."""

from ._document import noise_document as noise_document
from ._fleet import write_fleet as write_fleet
from ._magnetometer import mag_document as mag_document
from ._north import north_document as north_document, write_north as write_north
from ._thermal import temperature_document as temperature_document
from ._write import write as write
