"""Results as JSON and as data frames."""

import dataclasses
import importlib
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import DataError


def plain(value: Any) -> Any:
    """Any value in a form for JSON: modules as dictionaries, arrays as lists, infinite or unknown numbers as None.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._answer import plain
    >>> plain({"low": np.array([1.0, np.inf]), 2: ("a", None)})
    {'low': [1.0, None], '2': ['a', None]}
    """
    kind = type(value)  # most of a result is of the types that come first
    if kind is float:
        return value if math.isfinite(value) else None
    if kind is str or kind is int or value is None:
        return value
    if kind is dict:
        return {str(key): plain(item) for key, item in value.items()}
    if kind is list or kind is tuple:
        return [plain(item) for item in value]
    if isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    if hasattr(value, "to_dict") and not isinstance(value, type):
        value = value.to_dict()
    if hasattr(value, "__array__"):
        values = np.asarray(value)
        return values.tolist() if values.dtype.kind == "f" and np.isfinite(values).all() else plain(values.tolist())
    if hasattr(value, "_enumeration"):  # an item of an Equinox Enumeration, by its name
        names = value._enumeration._name_to_item.items()
        return next(name for name, item in names if int(item._value) == int(np.asarray(value._value)))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if not field.name.startswith("_")}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    return str(value)


def data_frame(columns: Mapping[str, Any]) -> Any:
    """A data frame of polars, or of pandas if polars is not installed."""
    for library in ("polars", "pandas"):
        try:
            module: Any = importlib.import_module(library)
        except ImportError:
            continue
        return module.DataFrame(dict(columns))
    raise DataError("to_dataframe() needs polars or pandas, and neither is installed: pip install polars", code="no_data_frame")
