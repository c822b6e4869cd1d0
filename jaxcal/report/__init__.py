"""Write results as one HTML page or as a JSON document."""

from ._write import write as write
