"""MATLAB files of the versions 4 to 7 through scipy; 7.3 is HDF5, see `_hdf5`."""

import pathlib
import struct
import warnings
import zlib
from typing import Any

import numpy as np

from .._errors import DataError
from ._bounds import check_declared
from ._table import Table
from ._tree import table_of_tree

_COMPRESSED, _DEEPEST = 15, 32
_ORDER = {b"IM": "<", b"MI": ">"}


def read_mat(path: pathlib.Path, topics: list[str] | None) -> Table:
    """Variables of a MATLAB file by name, and the fields of structs."""
    import scipy.io

    _check(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # on names that occur twice, and on objects, which are told of below
        variables = scipy.io.loadmat(path, simplify_cells=True, appendmat=False, verify_compressed_data_integrity=True)
    arrays: dict[str, np.ndarray] = {}
    opaque: list[str] = []
    for name, value in variables.items():
        if not name.startswith("__"):
            _collect(name, value, arrays, opaque, 0)
    if not arrays and (opaque or "__function_workspace__" in variables or "None" in variables):
        raise DataError(
            "it holds MATLAB objects (table, timetable), whose layout is not public; save arrays, or a struct of them "
            "(S = table2struct(T, 'ToScalar', true); save log.mat -struct S)"
        )
    return table_of_tree(arrays, topics, "variable")


def _collect(path: str, value: Any, arrays: dict[str, np.ndarray], opaque: list[str], depth: int) -> None:
    import scipy.io.matlab

    if isinstance(value, dict):
        for name, inner in value.items():
            if depth < _DEEPEST and not name.startswith("_"):
                _collect(f"{path}/{name}", inner, arrays, opaque, depth + 1)
    elif isinstance(value, scipy.io.matlab.MatlabOpaque | scipy.io.matlab.MatlabFunction):
        opaque.append(path)
    elif isinstance(value, np.ndarray | float | int | np.number):
        array = np.asarray(value)
        if array.dtype.kind in "iufb":
            arrays[path] = array.astype(array.dtype.newbyteorder("="))


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
