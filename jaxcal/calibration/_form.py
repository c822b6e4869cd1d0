"""What a section must hold, and how it goes to JSON and back.

A form is: a text (that very text), `str` (any text), `float` (a number), a tuple (numbers of that shape, None for any length),
a list of one form (any number of them), a dictionary of forms (a key that ends in "?" may be left out), `Nullable(form)`.
"""

import dataclasses
import math
import os
from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError

_LARGEST_INTEGER = 2**63


class Nullable(eqx.Module):
    """A form, or None."""

    form: Any


def checked(value: Any, form: Any, path: str) -> Any:
    """`value` as its form asks for it: numbers as float64 arrays, lists as tuples, without unknown keys.

    Raises
    ------
    DataError
        Where the value does not have the form; the message names the key by its `path`.
    """
    if isinstance(form, Nullable):
        return None if value is None else checked(value, form.form, path)
    if isinstance(form, dict):
        return _checked_keys(value, form, path)
    if isinstance(form, list):
        if not isinstance(value, (list, tuple)):
            raise wrong(value, "a list", path)
        return tuple(checked(item, form[0], f"{path}[{i}]") for i, item in enumerate(value))
    if isinstance(form, tuple):
        return _numbers(value, form, path)
    if form is float:
        return float(_numbers(value, (), path))
    if not isinstance(value, str):
        raise wrong(value, "text", path)
    _check_text(value, path)
    if form is not str and value != form:
        raise wrong(value, f"{form!r}, because jaxcal holds SI", path)
    return value


def _checked_keys(value: Any, form: dict[str, Any], path: str) -> dict[str, Any]:
    needed = [key for key in form if not key.endswith("?")]
    if not isinstance(value, dict):
        raise wrong(value, f"a dictionary with {', '.join(key.rstrip('?') for key in form)}", path)
    for key in needed:
        if key not in value:
            raise DataError(f"{path}.{key} is missing; {path} needs {', '.join(needed)}")
    found = {}
    for key, inner in form.items():
        name = key.rstrip("?")
        if name == key or value.get(name) is not None:
            found[name] = checked(value[name], inner, f"{path}.{name}")
    return found


def _numbers(value: Any, shape: tuple[int | None, ...], path: str) -> np.ndarray:
    try:
        raw = np.array(value, dtype=object)
    except ValueError:  # lists within lists beyond what an array can have
        raise wrong(value, "numbers", path) from None
    fits = raw.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, raw.shape, strict=True))
    if not fits or not all(x is None or (isinstance(x, (int, float, np.number)) and not isinstance(x, bool)) for x in raw.flat):
        size = " x ".join("any" if length is None else str(length) for length in shape)
        raise wrong(value, f"{size} numbers" if shape else "a number", path)
    try:
        return np.array([math.nan if x is None else float(x) for x in raw.flat], dtype=np.float64).reshape(raw.shape)
    except OverflowError:  # an integer of hundreds of digits
        raise wrong(value, "numbers that a float can hold", path) from None


def free(value: Any, path: str) -> Any:
    """A value of the user's own, as JSON can say it.

    Raises
    ------
    DataError
        If it holds something that JSON cannot say.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, dict) and all(isinstance(key, str) for key in value):
        return {key: free(item, f"{path}.{key}") for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [free(item, f"{path}[{i}]") for i, item in enumerate(value)]
    if isinstance(value, str):
        _check_text(value, path)
        return value
    if isinstance(value, int) and not abs(value) < _LARGEST_INTEGER:
        raise wrong(value, f"a whole number below {_LARGEST_INTEGER:g}", path)
    if value is None or isinstance(value, (bool, int)) or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise wrong(value, "text, a finite number, true, false, None, or lists and dictionaries of these", path)


def _check_text(value: str, path: str) -> None:
    try:
        value.encode()
    except UnicodeEncodeError:
        raise wrong(value, "text of whole characters", path) from None


def wrong(value: Any, expected: str, path: str) -> DataError:
    """The error that says what stands at `path` and what should."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = f"a {type(value).__name__}"
    return DataError(f"{path} is {text if len(text) <= 80 else text[:77] + '...'}; expected {expected}")


_REASONS = {"not known": math.nan, "infinite": math.inf, "minus infinite": -math.inf}


def to_json(section: Any) -> dict[str, Any]:
    """A section for `json_text`: numbers that JSON cannot say are null, and `reason` tells for each what it was."""
    reason: dict[str, str] = {}

    def walk(value: Any, path: str) -> Any:
        if isinstance(value, eqx.Module):
            value = {f.name: getattr(value, f.name) for f in dataclasses.fields(value) if not _is_left_out(value, f)}
        if isinstance(value, np.ndarray):
            value = value.tolist()
        if isinstance(value, dict):
            return {key: walk(item, f"{path}.{key}" if path else key) for key, item in value.items()}
        if isinstance(value, (list, tuple)):
            return [walk(item, f"{path}[{i}]") for i, item in enumerate(value)]
        if isinstance(value, float) and not math.isfinite(value):
            reason[path] = "not known" if math.isnan(value) else "infinite" if value > 0 else "minus infinite"
            return None
        return value

    document = walk(section, "")
    return document | {"reason": reason} if reason else document


def _is_left_out(module: eqx.Module, field: dataclasses.Field) -> bool:
    return field.default is None and getattr(module, field.name) is None


def from_json(section: Any) -> Any:
    """A section as it was before `to_json`, lists for arrays."""
    reason = section.get("reason") if isinstance(section, dict) else None
    if not isinstance(reason, dict):
        return section

    def walk(value: Any, path: str) -> Any:
        if isinstance(value, dict):
            return {key: walk(item, f"{path}.{key}" if path else key) for key, item in value.items()}
        if isinstance(value, list):
            return [walk(item, f"{path}[{i}]") for i, item in enumerate(value)]
        return _REASONS.get(str(reason[path]), math.nan) if value is None and path in reason else value

    return walk(section, "")
