"""Limits on the memory and time that a file may use in its reader.

A few damaged or malicious bytes can declare terabytes, and a file of one megabyte can contain a gigabyte of zeros. Sensor noise does
not compress: real logs grow by a factor of ten or twenty when unpacked, so a higher limit refuses no real log. Three measures
enforce the limit, from cheap to expensive:

- the size declared in a file is compared with the size of the file before memory is allocated (`check_declared`);
- if a library reads as many bytes as a record declares, the file object limits this to the end of the file (ROS);
- libraries that a damaged file can crash, and the process with them, run in a separate process (`_sandbox`).

jaxcal's own readers (ULog, DataFlash, text layout) take time proportional to the length of the file, whatever its content.
"""

import importlib.util

from ..._errors import DataError

#: unpacked bytes that every file may have; those of text, which takes ten times as much memory; those for each byte of a larger file
FREE, FREE_TEXT, _FACTOR = 1 << 25, 1 << 23, 24
#: bytes of a file that are read in one piece: with blocks of 4 MiB, two threads read as fast as they parse and need little memory
BLOCK = 1 << 22
#: samples or messages that are gathered or looked at together
PIECE = 50_000
#: largest number of files in a folder, of members of a zip file, of data sets and groups, of fields: no log has more
MOST = 5000


def allowed(size: int, free: int = FREE) -> int:
    """Largest unpacked size, in bytes, of a file of `size` bytes."""
    return max(free, _FACTOR * size)


def check_declared(declared: int, size: int, what: str, free: int = FREE) -> None:
    """Refuse a declared size that a file of `size` bytes cannot contain."""
    if declared > allowed(size, free):
        said = f"{what} is said to hold {declared} bytes in a file of {size}, more than a log can: copy it again, or save it uncompressed"
        raise DataError(said, code="too_large")


def require(library: str, purpose: str, extra: str) -> None:
    """Refuse if a library is not installed, and name the extra of the package that installs it."""
    if importlib.util.find_spec(library) is None:
        raise DataError(f'{purpose} needs {library}: pip install "jaxcal[{extra}]"', code="not_installed")
