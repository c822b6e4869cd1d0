"""Read records in chunks, from files that need not fit into memory.

Uncompressed NumPy .npy and .npz files are memory-mapped; Parquet is read by row groups, HDF5 by slices. A text table is converted first by
polars, in little memory; other formats by `jaxcal.io.convert`: the sensor messages of a large recording fit into memory, as its images are
not read.
"""

import dataclasses
import math
import pathlib
import shlex
import zipfile
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np

from .._errors import DataError
from .._message import Message
from ._find import find
from ._readers._bounds import require

_TIME = ("time", "timestamp", "stamp", "t")


@dataclasses.dataclass(frozen=True)
class Chunks:
    """A record that is read on demand: `read(start, stop)` returns (stop - start, channels)."""

    samples: int
    channels: int
    flat: bool  # whether the record is one channel of shape (n,)
    read: Callable[[int, int], np.ndarray]

    def of(self, length: int) -> Iterator[np.ndarray]:
        """The record in chunks of `length` samples, the last of which may be shorter."""
        for start in range(0, self.samples, length):
            yield self.read(start, min(start + length, self.samples))


def open_chunks(path: pathlib.Path, columns: Sequence[Any] | None) -> Chunks:
    """Open the record in a .npy, .npz, Parquet or HDF5 file.

    `columns` are channels by number (.npy) or name (Parquet), or arrays by name (.npz, HDF5). The default is all numeric
    columns except times.
    """
    kind, _ = find(path)
    if kind == "npy":
        return array_chunks(np.load(path, mmap_mode="r", allow_pickle=False), columns)
    if kind == "parquet":
        return _parquet_chunks(path, columns)
    if kind == "npz":
        return _joined(_mapped(path), columns)
    if kind == "hdf5":
        return _joined(_datasets(path), columns)
    convert = "jaxcal convert LOG LOG.npz"
    if kind == "csv":
        program = f"import polars; polars.scan_csv({str(path)!r}).sink_parquet({str(path.with_suffix('.parquet'))!r})"
        convert = f"python -c {shlex.quote(program)}"
    raise DataError(f"this is {kind}, which is not read in chunks; convert it once: {convert}", code="chunks")


def array_chunks(array: np.ndarray, columns: Sequence[Any] | None) -> Chunks:
    """The record in an array, which may be memory-mapped."""
    if array.ndim not in (1, 2) or array.dtype.kind not in "iuf":
        raise DataError(f"shape {array.shape}, type {array.dtype}; expected numbers of shape (n,) or (n, channels)", code="chunks")
    width = 1 if array.ndim == 1 else array.shape[1]
    chosen = np.arange(width) if columns is None else np.atleast_1d(np.asarray(columns))
    if chosen.dtype.kind not in "iu" or chosen.size == 0 or np.any((chosen < 0) | (chosen >= width)):
        raise DataError(f"columns={columns!r}: the array has columns 0 .. {width - 1}; choose among these numbers", code="chunks")
    place = slice(None) if columns is None else chosen  # without a copy
    return Chunks(len(array), len(chosen), array.ndim == 1, lambda start, stop: array[start:stop].reshape(-1, width)[:, place])


def _joined(arrays: dict[str, Any], columns: Sequence[Any] | None) -> Chunks:
    """The record of several arrays of one length, side by side."""
    usable = {name: array for name, array in arrays.items() if array.ndim in (1, 2) and array.dtype.kind in "iuf" and len(array) > 1}
    names = _named(list(usable), columns, "arrays of numbers are")
    chosen = [usable[name] for name in names]
    if len({len(array) for array in chosen}) > 1:
        lengths = ", ".join(f"{name} {array.shape}" for name, array in zip(names, chosen, strict=True))
        said = Message("the arrays have different lengths ({lengths}); name those of one length with {option.columns}", lengths=lengths)
        raise DataError(said, code="chunks")

    def read(start: int, stop: int) -> np.ndarray:
        return np.concatenate([np.asarray(array[start:stop], np.float64).reshape(stop - start, -1) for array in chosen], axis=1)

    width = sum(1 if array.ndim == 1 else array.shape[1] for array in chosen)
    return Chunks(len(chosen[0]), width, len(chosen) == 1 and chosen[0].ndim == 1, read)


def _named(usable: list[str], columns: Sequence[Any] | None, what: str) -> list[str]:
    """The names in `columns`; the default is all names except those of a time."""
    if columns is None:
        names = [name for name in usable if name.rpartition("/")[2].lower().split("_")[0] not in _TIME]
    else:
        names = [columns] if isinstance(columns, str) else [str(name) for name in columns]
    wrong = [name for name in names if name not in usable]
    if wrong or not names:
        said = f"columns {', '.join(wrong) or 'for a record'}: not in the file; {what} {', '.join(usable) or 'none'}"
        raise DataError(said, code="chunks")
    return names


def _mapped(path: pathlib.Path) -> dict[str, np.ndarray]:
    """Memory-map the arrays of an .npz file."""
    found = {}
    size = path.stat().st_size
    with zipfile.ZipFile(path) as archive, path.open("rb") as file:
        for member in archive.infolist():
            if member.compress_type != zipfile.ZIP_STORED:
                raise DataError("compressed arrays are not read in chunks; save them with numpy.savez", code="chunks")
            file.seek(member.header_offset + 26)
            lengths = file.read(4)
            file.seek(member.header_offset + 30 + int.from_bytes(lengths[:2], "little") + int.from_bytes(lengths[2:], "little"))
            read_header = getattr(np.lib.format, "read_array_header_{}_{}".format(*np.lib.format.read_magic(file)), None)
            if read_header is None:
                raise DataError(f"{member.filename} has a layout of NumPy's that is not known here; save it again", code="chunks")
            shape, fortran, dtype = read_header(file)
            if dtype.kind in "iuf" and file.tell() + math.prod(shape) * dtype.itemsize <= size:
                order = "F" if fortran else "C"
                found[member.filename.removesuffix(".npy")] = np.memmap(path, dtype, "r", file.tell(), shape, order)
    return found


def _datasets(path: pathlib.Path) -> dict[str, Any]:
    """Data sets of an HDF5 file, not loaded; the file stays open as long as they are used."""
    require("h5py", "reading HDF5 and MATLAB 7.3", "hdf5")
    import h5py

    found: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset) and item.shape and not item.external and not item.is_virtual:
            found[name] = item

    h5py.File(path, "r", locking="best-effort").visititems(take)
    return found


def _parquet_chunks(path: pathlib.Path, columns: Sequence[Any] | None) -> Chunks:
    require("polars", "reading Parquet", "parquet")
    import polars as pl

    table = pl.scan_parquet(path, glob=False)
    schema = table.collect_schema()
    names = _named([name for name, kind in schema.items() if kind.is_numeric()], columns, "those that hold numbers are")
    chosen = table.select(pl.col(name).cast(pl.Float64) for name in names)
    samples = int(table.select(pl.len()).collect().item())

    def read(start: int, stop: int) -> np.ndarray:
        return chosen.slice(start, stop - start).collect().fill_null(np.nan).to_numpy()

    return Chunks(samples, len(names), isinstance(columns, str), read)
