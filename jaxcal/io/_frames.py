"""Convert recordings in memory to tables: data frames of pandas and polars, dictionaries and arrays.

This module imports none of these libraries: it recognises an object by the module of its class.
"""

from typing import Any

import numpy as np

from .._errors import DataError
from ._readers._arrays import arrays_of_columns, table_of_arrays
from ._table import Table

_TAKEN = "a path, a jaxcal.Log, a pandas or polars data frame, a dictionary of arrays, or an array of columns with its rate"


def table_of(source: Any) -> Table:
    """Copy the columns of an object in memory into a table, with their names."""
    library, kind = type(source).__module__.partition(".")[0], type(source).__name__
    if library == "polars" and kind in ("DataFrame", "LazyFrame"):
        frame = source.collect() if kind == "LazyFrame" else source
        return table_of_arrays({one.name: np.array(one.to_numpy()) for one in frame.get_columns()})
    if library == "pandas" and kind in ("DataFrame", "Series"):
        return table_of_arrays(_of_pandas(source.to_frame() if kind == "Series" else source))
    if isinstance(source, dict):
        return table_of_arrays({str(name): _array(values) for name, values in source.items()})
    if isinstance(source, list | tuple) or hasattr(source, "__array__"):
        return arrays_of_columns(_array(source))
    raise DataError(f"a recording cannot be made of {kind} objects; expected {_TAKEN}", code="not_a_recording")


def _array(values: Any) -> np.ndarray:
    try:
        return np.array(values)
    except ValueError as error:
        raise DataError(f"its values do not make an array: {error}", code="not_a_recording") from error


def _of_pandas(frame: Any) -> dict[str, Any]:
    columns = {} if type(frame.index).__name__ == "RangeIndex" else {str(frame.index.name or "time"): _moments(frame.index)}
    return columns | {str(name): _moments(frame[name]) for name in frame.columns}


def _moments(column: Any) -> np.ndarray:
    """Values of a column; times with a time zone are converted to UTC."""
    if getattr(column.dtype, "tz", None) is not None:
        column = (column.dt if hasattr(column, "dt") else column).tz_convert(None)
    return np.array(column)
