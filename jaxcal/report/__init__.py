"""Results as one HTML page, and as a JSON document."""

from ._write import document as document, write as write
