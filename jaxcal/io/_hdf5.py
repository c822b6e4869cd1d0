"""HDF5, and MATLAB 7.3, which is HDF5, through h5py.

Only what lies in the file itself is read: links to other files, data stored in them, and virtual data sets are left out, since a
log must not make its reader open files of its choice.
"""

import pathlib
from typing import Any

import numpy as np

from .._errors import DataError
from ._bounds import check_declared
from ._table import Table
from ._tree import table_of_tree

#: data sets and groups looked at, and how deep
_MOST, _DEEPEST = 10_000, 32
_OPAQUE = ("table", "timetable", "datetime", "duration", "string")


def read_hdf5(path: pathlib.Path, topics: list[str] | None) -> Table:
    """Arrays of an HDF5 file by the names of the data sets, at any depth; an attribute `units` gives the unit."""
    with _open(path) as file:
        arrays, units, left_out = _arrays(file, path.stat().st_size)
    try:
        table = table_of_tree(arrays, topics, "data set", units)
    except DataError as error:
        raise DataError(f"{error}; not read: {'; '.join(left_out)}") if left_out else error from None
    table.notes += left_out
    return table


def _open(path: pathlib.Path) -> Any:
    try:
        import h5py
    except ImportError as error:
        raise DataError('reading HDF5 and MATLAB 7.3 needs h5py: pip install "jaxcal[hdf5]"') from error
    return h5py.File(path, "r", locking="best-effort")


def _arrays(file: Any, size: int) -> tuple[dict[str, np.ndarray], dict[str, str], list[str]]:
    """Numeric data sets by path, their units, and sentences on what is not read."""
    found: dict[str, np.ndarray] = {}
    units: dict[str, str] = {}
    left_out: list[str] = []
    total = 0
    for path, dataset in datasets(file):
        kind = _attribute(dataset, "MATLAB_class")
        if kind in _OPAQUE or dataset.attrs.get("MATLAB_object_decode") is not None:
            left_out.append(f"{path} is a MATLAB {kind or 'object'}; save it as a struct of arrays (table2struct(T, 'ToScalar', true))")
            continue
        names = dataset.dtype.names
        if kind in ("char", "cell") or dataset.shape is None or not (names or dataset.dtype.kind in "iufb"):
            continue
        total += int(np.prod(dataset.shape, dtype=object)) * dataset.dtype.itemsize
        check_declared(total, size, "the file")
        unit = _attribute(dataset, "units") or _attribute(dataset, "unit")
        array = dataset[()]
        for name in names or ("",):
            column = np.asarray(array[name] if name else array)
            if column.dtype.kind in "iufb":
                label = f"{path}/{name}" if name else path
                found[label] = column.astype(column.dtype.newbyteorder("="))
                if unit:
                    units[label] = unit
    return found, units, left_out


def datasets(file: Any) -> list[tuple[str, Any]]:
    """Data sets stored in the file itself, by path."""
    import h5py

    found: list[tuple[str, Any]] = []
    waiting: list[tuple[str, Any, int]] = [("", file, 0)]
    seen = set()
    while waiting:
        prefix, group, depth = waiting.pop()
        if group in seen or depth > _DEEPEST:
            continue
        seen.add(group)
        for name in group:
            if len(found) + len(waiting) > _MOST:
                raise DataError(f"the file holds more than {_MOST} data sets; it is damaged, or no log: save the log's arrays alone")
            if name.startswith("#") or group.get(name, getclass=True, getlink=True) is not h5py.HardLink:
                continue
            item = group.get(name)
            path = f"{prefix}{name}"
            if isinstance(item, h5py.Group):
                waiting.append((f"{path}/", item, depth + 1))
            elif isinstance(item, h5py.Dataset) and not item.external and not item.is_virtual:
                found.append((path, item))
    return sorted(found, key=lambda pair: pair[0])


def _attribute(dataset: Any, name: str) -> str:
    value = dataset.attrs.get(name)
    if isinstance(value, bytes):
        return value.decode("latin-1")
    return value if isinstance(value, str) else ""
