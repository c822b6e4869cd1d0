"""Parquet through polars; columns are named as in a text table."""

import pathlib

import numpy as np

from .._errors import DataError
from ._saved import parse_saved
from ._table import Table


def read_parquet(path: pathlib.Path) -> Table:
    """Columns of a Parquet file; dates and times become datetime64[ns]."""
    try:
        import polars as pl
    except ImportError as error:
        raise DataError('reading Parquet needs polars: pip install "jaxcal[parquet]"') from error

    frame = pl.read_parquet(path, glob=False)
    columns: list[np.ndarray] = []
    integer = set()
    for j, (series, kind) in enumerate(zip(frame.iter_columns(), frame.dtypes, strict=True)):
        if kind.is_temporal():
            series = series.dt.total_nanoseconds() if kind == pl.Duration else series.cast(pl.Datetime("ns"))
        elif kind.is_decimal():
            series = series.cast(pl.Float64)
        columns.append(series.to_numpy())
        if kind.is_integer():
            integer.add(j)
    about = pl.read_parquet_metadata(path).get("jaxcal")
    return Table(columns, frame.columns, integer, saved=None if about is None else parse_saved(about))
