"""Arrays with names and places (variables, structs, groups) -> one table."""

import posixpath

import numpy as np

from .._errors import DataError
from ._columns import by_name
from ._numpy import table_of_arrays
from ._options import SENSORS
from ._table import Table

_PLAIN = "iufb"
_NAMELESS, _WIDEST = "\0", 1000


def table_of_tree(arrays: dict[str, np.ndarray], topics: list[str] | None, kind: str, units: dict[str, str] | None = None) -> Table:
    """Table of the arrays of one group, or of all where their names are different.

    Parameters
    ----------
    arrays : path such as ``imu0/gyro`` -> numbers. Rows and columns may be either way round: the longer side is time.
    topics : name of the group to read, where several hold the same names.
    kind : what the arrays are called in messages.
    units : path -> unit, where the file gives one.

    Raises
    ------
    DataError
        If there are no arrays of numbers, or several groups and none is named.
    """
    groups: dict[str, dict[str, np.ndarray]] = {}
    for path, array in arrays.items():
        if array.dtype.kind in _PLAIN and array.size:
            unit = (units or {}).get(path)
            name = posixpath.basename(path) + (f" [{unit}]" if unit else "")
            groups.setdefault(posixpath.dirname(path), {})[name] = _upright(array)
    if not groups:
        shown = ", ".join(f"{path} {array.shape} {array.dtype}" for path, array in list(arrays.items())[:12]) or "nothing"
        raise DataError(f"no {kind} with numbers in it (there is {shown}); save time, gyro, accel, mag, temperature as plain arrays")
    with_sensors = [name for name, group in groups.items() if _has_sensor(group)]
    if topics is not None:
        wanted = [topic.strip("/") for topic in topics]
        unknown = [topic for topic in wanted if topic not in groups]
        if unknown or len(wanted) > 1:
            raise DataError(f"topics=: {', '.join(unknown or wanted)}: give one of the groups {_listed(with_sensors or list(groups))}")
        return _table(_inherited(groups, wanted[0]))
    if len(with_sensors) == 1:
        return _table(_inherited(groups, with_sensors[0]))
    names = [name for group in groups.values() for name in group]
    twice = {name for name in names if names.count(name) > 1}
    if twice and with_sensors:
        raise DataError(f"several groups hold sensors: name one with topics= (--topics): {_listed(with_sensors)}")
    return _table({name: array for group in groups.values() for name, array in group.items() if name not in twice})


def _inherited(groups: dict[str, dict[str, np.ndarray]], group: str) -> dict[str, np.ndarray]:
    """Arrays of a group, and of those around it (a clock that several sensors share)."""
    found = dict(groups[group])
    while group:
        group = posixpath.dirname(group)
        found = groups.get(group, {}) | found
    return found


def _table(arrays: dict[str, np.ndarray]) -> Table:
    matrices = [array for array in arrays.values() if array.ndim == 2 and array.shape[1] > 3]
    if len(matrices) == 1 and not _has_sensor(arrays):
        matrix = matrices[0]
        rest = {name: array for name, array in arrays.items() if array is not matrix and len(array) in (1, len(matrix))}
        table = table_of_arrays(rest | {f"{_NAMELESS}{j}": matrix[:, j] for j in range(min(matrix.shape[1], _WIDEST))})
        table.names = ["" if name.startswith(_NAMELESS) else name for name in table.names]
        return table
    return table_of_arrays(arrays)


def _has_sensor(arrays: dict[str, np.ndarray]) -> bool:
    names = [name for name, array in arrays.items() if array.ndim == 1]
    names += [f"{name}_{axis}" for name, array in arrays.items() if array.ndim == 2 for axis in "xyz"[: array.shape[1]]]
    try:
        return bool(set(by_name(names)[0]) & {*SENSORS, "temperature"})
    except DataError:
        return True


def _upright(array: np.ndarray) -> np.ndarray:
    """Time first: vectors of one dimension, and the longer side of a matrix down."""
    if array.ndim != 1 and array.size == max(array.shape, default=1):
        return array.reshape(-1)
    if array.ndim == 2 and array.shape[0] < array.shape[1]:
        return array.T
    return array


def _listed(groups: list[str]) -> str:
    return ", ".join(f"/{group}" for group in sorted(groups))
