"""What a fleet is compared by: the coefficients of one log, each a number with its interval."""

import dataclasses
import math
from typing import Any

import numpy as np

_MOST = 400  # numbers taken from the result of a task of one's own


@dataclasses.dataclass(frozen=True)
class Coefficient:
    """A number of one log.

    Attributes
    ----------
    value : None where the log has none, as of a term not detected.
    low, high : limits of its interval, or None. Of a term not detected `high` is the upper limit.
    unit : its SI unit, "" if not known.
    """

    value: float | None
    low: float | None = None
    high: float | None = None
    unit: str = ""


def number(value: Any) -> float | None:
    """A float, None where it is not finite."""
    value = float(value)
    return value if math.isfinite(value) else None


def listed(coefficients: dict[str, Coefficient]) -> dict[str, list[Any]]:
    """As JSON has them: name -> [value, low, high, unit]."""
    return {name: [one.value, one.low, one.high, one.unit] for name, one in coefficients.items()}


def of_list(table: Any) -> dict[str, Coefficient]:
    """The coefficients of a result file."""
    return {str(name): Coefficient(*row) for name, row in dict(table or {}).items()}


def numbers_of(result: Any) -> dict[str, Coefficient]:
    """The numbers in the result of a task of one's own: a.b for nested dictionaries, a[0] for short lists.

    Examples
    --------
    >>> from jaxcal.batch._coefficients import numbers_of
    >>> sorted((name, one.value) for name, one in numbers_of({"bias": [1.0, 2.0], "name": "x", "fit": {"rms": 3}}).items())
    [('bias[0]', 1.0), ('bias[1]', 2.0), ('fit.rms', 3.0)]
    """
    found: dict[str, Coefficient] = {}

    def walk(value: Any, name: str) -> None:
        if len(found) >= _MOST or isinstance(value, bool):
            return
        if isinstance(value, int | float):
            found[name or "value"] = Coefficient(number(value))
        elif isinstance(value, dict):
            for key, item in value.items():
                walk(item, f"{name}.{key}" if name else str(key))
        elif isinstance(value, list) and len(value) <= 12:
            for i, item in enumerate(value):
                walk(item, f"{name}[{i}]")

    walk(result, "")
    return found


def as_json(value: Any) -> Any:
    """Any result as JSON has it: arrays as lists, dataclasses (all of jaxcal's results) by field, None for what is not finite."""
    if value is None or isinstance(value, str | bool):
        return value
    if isinstance(value, int | float | np.number):
        return int(value) if isinstance(value, int | np.integer) else number(value)
    if isinstance(value, dict):
        return {str(key): as_json(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [as_json(item) for item in value]
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: as_json(getattr(value, field.name)) for field in dataclasses.fields(value) if not field.name.startswith("_")}
    if hasattr(value, "__array__"):
        return as_json(np.asarray(value).tolist())
    return str(value)
