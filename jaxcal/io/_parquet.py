"""Parquet through polars, in a process of its own (see `_apart`); columns are named as in a text table."""

import importlib.util
import pathlib

import numpy as np

from .._errors import DataError
from ._apart import apart
from ._bounds import allowed, check_declared
from ._saved import parse_saved
from ._table import Table


def read_parquet(path: pathlib.Path) -> Table:
    """Columns of a Parquet file; dates and times become datetime64[ns]."""
    if importlib.util.find_spec("polars") is None:
        raise DataError('reading Parquet needs polars: pip install "jaxcal[parquet]"')
    size = path.stat().st_size
    about, arrays = apart.read("parquet", str(path), allowed=allowed(size))
    if "declared" in about:
        check_declared(about["declared"], size, "the table")
    columns = []
    for form, array in zip(about["columns"], arrays, strict=True):
        if form["dates"]:
            array = array.view("datetime64[ns]")
        elif array.dtype.kind == "U":
            array = np.full(about["rows"], array[0], dtype=object)
        columns.append(array)
    integer = {j for j, form in enumerate(about["columns"]) if form["integer"]}
    saved = about["saved"]
    return Table(columns, [form["name"] for form in about["columns"]], integer, saved=None if saved is None else parse_saved(saved))
