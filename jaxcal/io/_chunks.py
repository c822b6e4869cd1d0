"""Records chunk by chunk, from files that need not fit into memory: NumPy .npy (memory-mapped) and Parquet (by row groups)."""

import pathlib
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ._detect import detect

_TIME = ("time", "timestamp", "stamp", "t")


class Chunks(eqx.Module):
    """A record that is read when it is asked for: `read(start, stop)` gives (stop - start, channels)."""

    samples: int
    channels: int
    flat: bool  # a single channel without an axis of its own
    read: Callable[[int, int], np.ndarray]

    def of(self, length: int) -> Iterator[np.ndarray]:
        """The record in chunks of `length` samples, the last of which may be shorter."""
        for start in range(0, self.samples, length):
            yield self.read(start, min(start + length, self.samples))


def open_chunks(path: pathlib.Path, columns: Sequence[Any] | None) -> Chunks:
    """The record in a .npy or Parquet file.

    Parameters
    ----------
    path : file.
    columns : channels by number (.npy) or name (Parquet); all by default, of Parquet all that hold numbers and no time.

    Raises
    ------
    DataError
        If the file is neither, or has no such channels.
    """
    kind, _ = detect(path)
    if kind == "npy":
        return array_chunks(np.load(path, mmap_mode="r", allow_pickle=False), columns)
    if kind == "parquet":
        return _parquet_chunks(path, columns)
    raise DataError(f"this is {kind}, which is not read in chunks; save it as .npy or Parquet, or read it whole with jaxcal.read")


def array_chunks(array: np.ndarray, columns: Sequence[Any] | None) -> Chunks:
    """The record in an array, in memory or mapped."""
    if array.ndim not in (1, 2) or array.dtype.kind not in "iuf":
        raise DataError(f"the array has shape {array.shape} and type {array.dtype}; expected numbers of shape (n,) or (n, channels)")
    width = 1 if array.ndim == 1 else array.shape[1]
    if columns is None:
        return Chunks(len(array), width, array.ndim == 1, lambda start, stop: array[start:stop].reshape(-1, width))
    chosen = np.atleast_1d(np.asarray(columns))
    if chosen.dtype.kind not in "iu" or chosen.size == 0 or np.any((chosen < 0) | (chosen >= width)):
        raise DataError(f"columns={columns!r}: the array has columns 0 .. {width - 1}; choose among these numbers")
    return Chunks(len(array), len(chosen), array.ndim == 1, lambda start, stop: array[start:stop].reshape(-1, width)[:, chosen])


def _parquet_chunks(path: pathlib.Path, columns: Sequence[Any] | None) -> Chunks:
    try:
        import polars as pl
    except ImportError as error:
        raise DataError('reading Parquet needs polars: pip install "jaxcal[parquet]"') from error

    table = pl.scan_parquet(path, glob=False)
    schema = table.collect_schema()
    numeric = [name for name, kind in schema.items() if kind.is_numeric()]
    if columns is None:
        names = [name for name in numeric if name.lower().split("_")[0] not in _TIME]
    else:
        names = [columns] if isinstance(columns, str) else list(columns)
    wrong = [str(name) for name in names if name not in numeric]
    if wrong or not names:
        raise DataError(f"columns {', '.join(wrong) or 'for a record'}: not in the file; those that hold numbers are {', '.join(numeric)}")
    chosen = table.select(pl.col(name).cast(pl.Float64) for name in names)
    samples = int(table.select(pl.len()).collect().item())

    def read(start: int, stop: int) -> np.ndarray:
        return chosen.slice(start, stop - start).collect().fill_null(np.nan).to_numpy()

    return Chunks(samples, len(names), isinstance(columns, str), read)
