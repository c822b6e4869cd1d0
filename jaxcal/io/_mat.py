"""MATLAB files of the versions 4 to 7 through scipy, in a process of its own (see `_apart`); 7.3 is HDF5, see `_hdf5`."""

import pathlib
import struct
import zlib

from .._errors import DataError
from ._apart import apart
from ._bounds import check_declared
from ._table import Table
from ._tree import table_of_tree

_COMPRESSED = 15
_ORDER = {b"IM": "<", b"MI": ">"}


def read_mat(path: pathlib.Path, topics: list[str] | None) -> Table:
    """Variables of a MATLAB file by name, and the fields of structs."""
    _check(path)
    about, arrays = apart.read("mat", str(path))
    named = {name: array.astype(array.dtype.newbyteorder("=")) for name, array in zip(about["names"], arrays, strict=True)}
    if not named and about["opaque"]:
        raise DataError(
            "it holds MATLAB objects (table, timetable), whose layout is not public; save arrays, or a struct of them "
            "(S = table2struct(T, 'ToScalar', true); save log.mat -struct S)"
        )
    return table_of_tree(named, topics, "variable")


def _check(path: pathlib.Path) -> None:
    """Compare the sizes that variables declare, unpacked ones included, with that of the file."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(128)
        order = _ORDER.get(head[126:128])
        if order is None or not head.startswith(b"MATLAB"):
            return  # version 4: nothing is packed
        total = 0
        while len(tag := file.read(8)) == 8:
            kind, length = struct.unpack(order + "II", tag)
            start = file.tell()
            if start + length > size:
                raise DataError(f"it ends within a variable, {start + length - size} bytes early; it is cut off or damaged: copy it again")
            if kind == _COMPRESSED:
                try:
                    inner = zlib.decompressobj().decompress(file.read(min(length, 512)), 8)
                except zlib.error as error:
                    raise DataError(f"a variable cannot be unpacked ({error}); it is damaged: copy it again") from error
                total += struct.unpack(order + "II", inner)[1] if len(inner) == 8 else 0
                check_declared(total, size, "a variable")
            file.seek(start + length)
