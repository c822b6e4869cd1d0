"""Which format a path holds, by its first bytes."""

import pathlib
import struct

from .._errors import DataError

#: formats that are read, as `format=` names them
FORMATS = ("csv", "npy", "npz", "parquet", "rosbag1", "rosbag2", "mat", "hdf5", "ulog", "dataflash")

_MAGIC = (
    (b"\x93NUMPY", "npy"),
    (b"PK\x03\x04", "npz"),
    (b"PK\x05\x06", "npz"),
    (b"PAR1", "parquet"),
    (b"#ROSBAG V", "rosbag1"),
    (b"SQLite format 3\0", "rosbag2"),
    (b"\x89MCAP0\r\n", "rosbag2"),
    (b"\x89HDF\r\n\x1a\n", "hdf5"),
    (b"MATLAB 7.3", "hdf5"),
    (b"MATLAB 5.0", "mat"),
    (b"ULog\x01\x12\x35", "ulog"),
    (b"\xa3\x95", "dataflash"),
)
#: HDF5 may begin behind a block of the user's, as in MATLAB 7.3
_HDF5, _USER_BLOCKS = b"\x89HDF\r\n\x1a\n", (512, 1024, 2048)


def detect(path: pathlib.Path) -> tuple[str, pathlib.Path]:
    """Format of a file, and the path to read.

    Raises
    ------
    DataError
        If there is nothing readable at `path`.
    """
    if not path.exists():
        raise DataError("there is no such file; check the path")
    if not path.is_file():
        raise DataError("this is not a regular file; save the data in one and give its path")
    with path.open("rb") as file:
        head = file.read(32)
    if not head:
        raise DataError("the file is empty")
    for magic, kind in _MAGIC:
        if head.startswith(magic):
            wanted = {b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}.get(magic)
            if wanted and path.suffix != wanted:
                raise DataError(f"this is a ROS 2 recording, but its name does not end in {wanted}; rename it")
            return kind, path
    if any(_at(path, place) == _HDF5 for place in _USER_BLOCKS):
        return "hdf5", path
    if path.suffix.lower() == ".mat" and _is_mat4(head):
        return "mat", path
    if path.suffix.lower() in (".npz", ".npy", ".parquet", ".mcap", ".db3", ".bag", ".ulg", ".mat", ".h5", ".hdf5"):
        raise DataError(f"the name ends in {path.suffix}, but the file does not begin as such a file does; it is damaged, or misnamed")
    return "csv", path


def _at(path: pathlib.Path, place: int) -> bytes:
    with path.open("rb") as file:
        file.seek(place)
        return file.read(len(_HDF5))


def _is_mat4(head: bytes) -> bool:
    """Whether a file begins as MATLAB 4 does: a type of four decimal digits, and sizes that are none too large."""
    return any(
        kind in (*range(60), *range(1000, 1060)) and rows >= 0 and columns >= 0 and imaginary in (0, 1) and 0 < length < 256
        for order in "<>"
        for kind, rows, columns, imaginary, length in [struct.unpack(order + "5i", head[:20].ljust(20, b"\xff"))]
    )
