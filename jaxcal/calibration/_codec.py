"""Convert calibrations to JSON and back. The fields of the classes and their types define the contents of a file.

The major version of the schema changes if an old reader would misread the file; the old reader then refuses it. The minor version
changes if keys were added; an old reader ignores keys that it does not know.

A type is `float`, `str`, `X | None`, `tuple[X, ...]`, `dict[str, X]`, `Float[np.ndarray, "3 _"]` (numbers of that shape, `_` for any
length), `Any` (numbers of any shape, text or None), or a class with fields. If a class has subclasses, as a sensor model does, the
key "class" names the one to use.
"""

import dataclasses
import functools
import json
import math
import os
import pathlib
import re
import types
import typing
from typing import Any

import numpy as np

from .._errors import DataError
from .._files import PIECE

SCHEMA = "jaxcal.calibration/1"
#: a larger number means damage; raw counts per SI unit stay far below it
LARGEST = 1e15


def read_document(path: pathlib.Path) -> dict[str, Any]:
    """The JSON document in a file, or a `DataError` if this version cannot read it."""
    try:
        size = path.stat().st_size
        if size > PIECE:
            raise DataError(f"it has {size} bytes, and a calibration has some thousand. Is it the log?", code="too_large")
        document = json.loads(path.read_text(encoding="utf-8"), parse_constant=_no_constant)
    except OSError as error:
        raise DataError(f"it cannot be read: {(error.strerror or str(error)).lower()}", code="unreadable") from error
    except DataError:
        raise
    except ValueError as error:
        raise DataError(f"this is not JSON ({error}); expected a file written by Calibration.save", code="not_json") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if not (isinstance(schema, str) and re.fullmatch(r"jaxcal\.calibration/\d{1,9}(?:\.\d{1,9})?", schema)):
        raise DataError(f"schema is {schema!r:.80}; expected {SCHEMA!r}, as Calibration.save writes it", code="schema")
    if schema.partition(".calibration")[2].partition(".")[0] != SCHEMA.partition(".calibration")[2]:
        raise DataError(f"schema is {schema!r}, and this version of jaxcal reads {SCHEMA!r}; install the one that wrote it", code="version")
    return document  # type: ignore[return-value]


def _no_constant(word: str) -> None:
    raise DataError(f"{word} is no number in JSON", code="not_json")


def structured(value: Any, kind: Any, path: str) -> Any:
    """`value` as an object of type `kind`: numbers as float64 arrays, lists as tuples, without unknown keys.

    If the value does not have the type, a `DataError` names the key by its `path`.
    """
    origin, inner = typing.get_origin(kind), typing.get_args(kind)
    if origin in (typing.Union, types.UnionType):
        return None if value is None else structured(value, inner[0], path)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        return value if isinstance(value, kind) else _object(value, kind, path)
    if origin is tuple:
        if not isinstance(value, (list, tuple)):
            raise wrong(value, "a list", path)
        return tuple(structured(item, inner[0], f"{path}[{i}]") for i, item in enumerate(value))
    if origin is dict:
        if not isinstance(value, dict):
            raise wrong(value, "a dictionary", path)
        return {_text(key, path): structured(item, inner[1], f"{path}.{key}") for key, item in value.items()}
    if kind is str:
        return _text(value, path)
    if hasattr(kind, "dim_str"):
        return numbers(value, tuple(int(word) if word.isdigit() else None for word in kind.dim_str.split()), path)
    if kind is not float and (value is None or isinstance(value, (str, bool, int))):
        return free(value, path)
    found = numbers(value, () if kind is float else None, path)
    return found if found.ndim else float(found)


def _object(value: Any, kind: Any, path: str) -> Any:
    if isinstance(value, dict) and "class" in value:
        kind = _class_of(kind, value["class"], f"{path}.class")
    types_of = _hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind)}
    needed = [name for name, one in fields.items() if one.default is one.default_factory is dataclasses.MISSING]
    if not isinstance(value, dict):
        raise wrong(value, f"a dictionary with {', '.join(fields)}", path)
    for name in needed:
        required(value, name, path, needed)
    present = [name for name in fields if name in needed or value.get(name) is not None]
    arguments = {name: structured(value[name], types_of.get(name, Any), f"{path}.{name}") for name in present}
    try:
        return kind(**arguments)
    except (TypeError, ValueError) as error:
        raise DataError(f"it makes no {kind.__name__}: {error}", code="value", subject=path) from error


@functools.lru_cache(256)
def _hints(kind: type) -> dict[str, Any]:
    """Types of the fields of a class; empty if one was imported for type checkers only."""
    try:
        return typing.get_type_hints(kind)
    except NameError:
        return {}


def _class_of(base: type, name: Any, path: str) -> type:
    """The class of that name among `base` and its subclasses; of several, the one defined last. Nothing is imported."""
    known = [base]
    for kind in known:
        known += kind.__subclasses__()
    found = [kind for kind in known if kind.__name__ == name]
    if not found:
        names = ", ".join(dict.fromkeys(kind.__name__ for kind in known))
        said = f"{name!r:.80} is none of the classes {names}; first import the module that defines it as a subclass of {base.__name__}"
        raise DataError(said, code="class", subject=path)
    return found[-1]


def required(value: dict[str, Any], name: str, path: str, needed: Any) -> Any:
    """The value of a required key."""
    if name not in value:
        raise DataError(f"it is missing; {path} needs {', '.join(needed)}", code="missing", subject=f"{path}.{name}")
    return value[name]


def checked_unit(value: Any, unit: str, path: str) -> None:
    """Raise a `DataError` unless a section declares the given SI unit."""
    if not isinstance(value, dict):
        raise wrong(value, f"a dictionary with unit {unit!r}", path)
    if required(value, "unit", path, ("unit",)) != unit:
        raise wrong(value["unit"], f"{unit!r}, because jaxcal holds SI", f"{path}.unit")


def numbers(value: Any, shape: tuple[int | None, ...] | None, path: str) -> np.ndarray:
    """Numbers of the given shape, where None means any length, or any shape; a number that is None becomes NaN."""
    try:
        raw = np.array(value, dtype=object)
    except ValueError:  # nested more deeply than an array can be
        raise wrong(value, "numbers", path) from None
    wanted = raw.shape if shape is None else shape
    fits = raw.ndim == len(wanted) and all(want in (None, got) for want, got in zip(wanted, raw.shape, strict=True))
    if not fits or not all(x is None or (isinstance(x, (int, float, np.number)) and not isinstance(x, bool)) for x in raw.flat):
        size = " x ".join("any" if length is None else str(length) for length in shape or ())
        raise wrong(value, "a number" if shape == () else f"{size} numbers".strip(), path)
    try:
        return np.array([math.nan if x is None else float(x) for x in raw.flat], dtype=np.float64).reshape(raw.shape)
    except OverflowError:  # an integer of hundreds of digits
        raise wrong(value, "numbers that a float can hold", path) from None


def _text(value: Any, path: str) -> str:
    if not isinstance(value, str) or value != value.encode("utf-8", "ignore").decode():
        raise wrong(value, "text of whole characters", path)
    return value


def wrong(value: Any, expected: str, path: str) -> DataError:
    """The error that reports the value at `path` and the expected one."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = f"a {type(value).__name__}"
    return DataError(f"{text if len(text) <= 80 else text[:77] + '...'}; expected {expected}", code="value", subject=path)


def free(value: Any, path: str) -> Any:
    """A value given by the user in a form that JSON can store, or a `DataError`."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: free(item, f"{path}.{key}") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [free(item, f"{path}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, str):
        return _text(value, path)
    whole = isinstance(value, int) and abs(value) < np.iinfo(np.int64).max  # larger ones are not exact in other readers of JSON
    if value is None or whole or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise wrong(value, "text, a finite number, true, false, None, or lists and dictionaries of these", path)


def document_of(model: Any, base: type, path: str) -> dict[str, Any]:
    """The fields of a model as lists, numbers and text, with its class unless it is `base`; a `DataError` for anything else."""
    found: dict[str, Any] = {} if type(model) is base else {"class": type(model).__name__}
    for field in dataclasses.fields(model):
        value, kind, place = getattr(model, field.name), _hints(type(model)).get(field.name), f"{path}.{field.name}"
        if dataclasses.is_dataclass(value):
            if not (isinstance(kind, type) and isinstance(value, kind)):
                raise wrong(value, f"a field declared as {type(value).__name__}, for it could not be read", place)
            value = document_of(value, kind, place)
        elif not (value is None or isinstance(value, (str, bool, int))):
            value = numbers(np.asarray(value), None, place).tolist()
        found[field.name] = value
    return found


def check_finite(values: Any, path: str) -> None:
    """Raise a `DataError` if a number is not finite, or absurdly large."""
    if not np.all(np.abs(values) < LARGEST):
        raise wrong(np.asarray(values).tolist(), f"finite numbers below {LARGEST:g}", path)


# numbers that JSON cannot store


def to_json(section: Any) -> Any:
    """A section for JSON: numbers that JSON cannot store become null."""
    value = section.to_document() if hasattr(section, "to_document") else section
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        held = ((field, getattr(value, field.name)) for field in dataclasses.fields(value))
        value = {field.name: item for field, item in held if not (item is None and field.default is None)}
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, dict):
        return {key: to_json(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [to_json(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
