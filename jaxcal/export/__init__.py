"""Files for other tools."""

from ._read import read as read
from ._write import write as write
