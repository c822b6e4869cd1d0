"""NumPy files: a 2-D .npy as the columns of a table, an .npz by the names of its arrays. Pickled objects are never loaded."""

import pathlib

import numpy as np

from .._errors import DataError
from ._options import AXES
from ._saved import parse_saved
from ._table import Table

_RATE = {"rate", "fs", "samplerate", "samplingrate", "freq", "frequency"}


def read_npy(path: pathlib.Path) -> Table:
    """Columns of a 2-D array (memory-mapped), or the fields of a structured one."""
    array = np.load(path, mmap_mode="r", allow_pickle=False)
    if array.dtype.names:
        return table_of_arrays({name: array[name] for name in array.dtype.names})
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or array.dtype.kind not in "iufb":
        raise DataError(f"the array has shape {array.shape} and type {array.dtype}; expected numbers of shape (samples, columns)")
    if array.shape[0] < array.shape[1]:
        raise DataError(f"the array has shape {array.shape}; time is the first axis: transpose it before saving")
    columns = [array[:, j] for j in range(array.shape[1])]
    integer = {j for j, column in enumerate(columns) if _whole(column)}
    return Table(columns, [""] * len(columns), integer)


def read_npz(path: pathlib.Path) -> Table:
    """Arrays of an .npz by name: vectors such as gyro (n, 3), single channels such as gyro_x (n,), and a scalar rate."""
    with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    saved = arrays.pop("jaxcal", None)
    table = table_of_arrays(arrays)
    if saved is not None and saved.dtype.kind == "U" and saved.size == 1:
        table.saved = parse_saved(str(saved.reshape(())))
    return table


def table_of_arrays(arrays: dict[str, np.ndarray]) -> Table:
    columns: list[np.ndarray] = []
    names: list[str] = []
    table = Table(columns, names)
    shapes = {name: array.shape for name, array in arrays.items()}
    lengths = [array.shape[0] for array in arrays.values() if array.ndim in (1, 2)]
    n = max(lengths, default=0)
    left_out = []
    for name, array in arrays.items():
        if array.size == 1 and name.lower().replace("_", "") in _RATE:
            table.rate = float(array.reshape(()))
        elif array.ndim == 1 and len(array) == n:
            columns.append(array)
            names.append(name)
        elif array.ndim == 2 and len(array) == n and 1 <= array.shape[1] <= 3:
            columns += [array[:, k] for k in range(array.shape[1])]
            names += [f"{name}_{AXES[k]}" for k in range(array.shape[1])]
        else:
            left_out.append(f"{name} {array.shape}")
    if not columns or n < 1:
        raise DataError(f"no arrays of shape (n,) or (n, 3) of one length: {shapes}; use the keys time, gyro, accel, mag, temperature")
    if left_out:
        table.notes.append(f"arrays not used, since their shape is not that of {n} samples: {', '.join(left_out)}")
    table.integer = {j for j, column in enumerate(columns) if _whole(column)}
    return table


def _whole(column: np.ndarray) -> bool:
    head = column[:10_000]
    return column.dtype.kind in "iu" or (column.dtype.kind == "f" and np.array_equal(head, np.round(head)))
