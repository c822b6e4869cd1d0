"""Files for other tools."""

from ._write import write as write
