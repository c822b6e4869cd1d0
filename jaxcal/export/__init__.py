"""Write calibrations as files for other tools, and read them back."""

from typing import TYPE_CHECKING

from .._lazy import install

if TYPE_CHECKING:
    from ._read import read as read
    from ._write import write as write

install(__name__, {"_read": "read", "_write": "write"})
