"""How much a file may ask for: what it declares is compared with its size before memory is taken.

A few damaged or malicious bytes can declare terabytes, and a file of one megabyte can hold a gigabyte of zeros. Sensor noise does
not compress: real logs grow by a factor of ten or twenty when unpacked, so that a limit far above that refuses no log.
"""

from .._errors import DataError

#: bytes that any file may ask for, and bytes more for each byte of it
_FREE, _FACTOR = 1 << 26, 256


def allowed(size: int) -> int:
    """Bytes that a file of `size` bytes may unpack to."""
    return _FREE + _FACTOR * size


def check_declared(declared: int, size: int, what: str) -> None:
    """Refuse what a file of `size` bytes cannot hold.

    Examples
    --------
    >>> from jaxcal.io._bounds import check_declared
    >>> check_declared(10**6, 10**5, "the table")
    """
    if declared > allowed(size):
        raise DataError(
            f"{what} is said to hold {declared} bytes in a file of {size}; it is damaged, or packed beyond what a log can be: "
            "copy it again, or save it without compression"
        )
