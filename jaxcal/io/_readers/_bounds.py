"""What a file may ask of the reader of its format: how much memory, and for how long.

A few damaged or malicious bytes can declare terabytes, and a file of one megabyte can hold a gigabyte of zeros. Sensor noise does
not compress: real logs grow by a factor of ten or twenty when unpacked, so that a limit far above that refuses no log. Three
measures keep libraries within it, in the order of what they cost:

- sizes that a file declares are compared with the size of the file before memory is taken (`check_declared`);
- where a library reads as many bytes as a record says it has, its file ends no later than the file does (ROS);
- libraries that a damaged file can bring down, the process with them, read in a process of their own (`_sandbox`).

The readers written here (ULog, DataFlash, text layout) take time in proportion to the length of the file, whatever it holds.
"""

import importlib.util

from ..._errors import DataError

#: bytes that any file may ask for, and bytes more for each byte of it
_FREE, _FACTOR = 1 << 26, 256


def allowed(size: int) -> int:
    """Bytes that a file of `size` bytes may unpack to."""
    return _FREE + _FACTOR * size


def check_declared(declared: int, size: int, what: str) -> None:
    """Refuse what a file of `size` bytes cannot hold."""
    if declared > allowed(size):
        raise DataError(
            f"{what} is said to hold {declared} bytes in a file of {size}; it is damaged, or packed beyond what a log can be: "
            "copy it again, or save it without compression"
        )


def require(library: str, purpose: str, extra: str) -> None:
    """Say which extra of the package brings a library that is not installed."""
    if importlib.util.find_spec(library) is None:
        raise DataError(f'{purpose} needs {library}: pip install "jaxcal[{extra}]"')
