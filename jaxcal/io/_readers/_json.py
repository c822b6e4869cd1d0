"""Read JSON: lists of numbers, lists of records, or arrays by name."""

import contextlib
import datetime
import json
import pathlib
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from ..._errors import DataError
from .._columns import AXES
from .._table import Table
from ._bounds import FREE


def read_json(path: pathlib.Path) -> Table:
    """Read the columns of a JSON file.

    The file has rows of numbers, records, or arrays by name. Records may be nested, as in {"poses": [{"heading": 90, "samples": [...]}]};
    then each record also gets the numbers of the records around it. A vector of three numbers becomes three columns, name_x to name_z.
    """
    if path.stat().st_size > FREE:
        raise DataError(f"the file has {path.stat().st_size} bytes, and JSON is read up to {FREE}; write the readings as CSV", code="json")
    content = _parsed(path.read_text(encoding="utf-8-sig"))
    columns = _arrays(content) or _columns(_records(content, {})) or _arrays(_nested(content))
    if not columns:
        forms = 'rows of numbers [[x, y, z], ...], records [{"x": 1, ...}, ...], or arrays by name {"mag": [[x, y, z], ...], ...}'
        raise DataError(f"this is JSON, but there are no readings in it; expected {forms}", code="json")
    values = [_column(column) for _, column in columns]
    whole = {i for i, column in enumerate(values) if column.dtype.kind == "f" and np.all(np.isfinite(column)) and not np.any(column % 1)}
    return Table(values, [name for name, _ in columns], whole, stem=path.stem)


def _column(values: Sequence[Any]) -> np.ndarray:
    """Numbers, of which a few may be text, which is missing; or text, where most are."""
    words = sum(isinstance(value, str) for value in values)
    if 2 * words > len(values):
        return np.array([value if isinstance(value, str) else None for value in values], dtype=object)
    return np.array([np.nan if isinstance(value, str) else value for value in values] if words else values, dtype=float)


def _parsed(text: str) -> Any:
    """The content of a file, which may also hold one record in each line."""
    try:
        return json.loads(text)
    except ValueError as error:
        lines = [line for line in text.split("\n") if line.strip()]
        if len(lines) < 2 or not all(line.lstrip().startswith("{") and line.rstrip().endswith("}") for line in lines):
            raise error
        return [json.loads(line) for line in lines]


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _vector(value: Any) -> bool:
    return isinstance(value, list) and 1 <= len(value) <= 1000 and all(map(_number, value))


def _named(name: str, width: int) -> list[str]:
    return [f"{name}_{axis}" if name else "" for axis in (AXES if width == 3 else map(str, range(width)))]


def _rows(value: Any) -> bool:
    """Whether a value is a list of vectors of equal length."""
    return isinstance(value, list) and len(value) > 0 and all(map(_vector, value)) and len({len(row) for row in value}) == 1


def _arrays(content: Any) -> list[tuple[str, Sequence[Any]]]:
    """Columns from rows of numbers, or from arrays by name, all of equal length."""
    if _rows(content):
        return list(zip(_named("", len(content[0])), zip(*content, strict=True), strict=True))
    if not isinstance(content, dict):
        return []
    arrays = {name: value for name, value in content.items() if _rows(value) or (_vector(value) and len(value) > 1)}
    most = max((len(value) for value in arrays.values()), default=0)
    found: list[tuple[str, Sequence[Any]]] = []
    for name, value in arrays.items():
        if len(value) == most > 3:
            found += zip(_named(name, len(value[0])), zip(*value, strict=True), strict=True) if _rows(value) else [(name, value)]
    return found


def _nested(node: Any, before: str = "") -> Any:
    """The lists of an object, those of an object in it after its name."""
    found: dict[str, Any] = {}
    for name, value in node.items() if isinstance(node, dict) else ():
        found |= _nested(value, f"{before}{name}_") if isinstance(value, dict) else {before + name: value}
    return found


def _records(node: Any, around: dict[str, Any]) -> list[dict[str, Any]]:
    """Records in the order of the file, each with the numbers of the records around it."""
    if isinstance(node, list):
        return [record for one in node if isinstance(one, dict) for record in _records(one, around)]
    here = dict(around)
    for name, value in _flat(node):
        if _number(value) or isinstance(value, str):
            here[name] = value
        elif _vector(value):
            here |= dict(zip(_named(name, len(value)), value, strict=True))
    inner = [_records(value, here) for value in node.values() if isinstance(value, list) and value and isinstance(value[0], dict)]
    return max(inner, key=len) if inner else [here]


def _flat(node: dict[str, Any], before: str = "") -> Iterator[tuple[str, Any]]:
    """Values of a record by name, those of a record inside it after its name; numbers and dates in quotes are numbers, words are kept."""
    for name, value in node.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{before}{name}_")
            continue
        with contextlib.suppress(ValueError, OverflowError):
            if isinstance(value, str):
                value = datetime.datetime.fromisoformat(value).timestamp() if ":" in value else float(value)
        yield before + name, value


def _columns(records: list[dict[str, Any]]) -> list[tuple[str, Sequence[Any]]]:
    """Columns of the numbers that most records have; records without such a number have a missing value."""
    if len(records) < 2:
        return []
    names = list(dict.fromkeys(name for record in records for name in record))
    common = [name for name in names if 2 * sum(name in record for record in records) > len(records)]
    return [(name, [record.get(name, np.nan) for record in records]) for name in common]
