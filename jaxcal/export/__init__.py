"""Write calibrations as files for other tools, and read them back."""

from ._read import read as read
from ._write import write as write
