"""Read calibrations in YAML with PyYAML, and get numbers from them."""

import math
from typing import Any

import numpy as np

from .._errors import DataError
from .._types import AnyArray
from ..calibration._codec import LARGEST

_AGAIN = "give rate= (Hz), the rate of the sensor"


def parse(text: str) -> dict[str, Any]:
    """Parse a text to a mapping. OpenCV's directive and tags are ignored."""
    try:
        import yaml
    except ImportError as error:
        raise DataError('reading YAML needs PyYAML; install it with pip install "jaxcal[yaml]"', code="not_installed") from error

    class Loader(yaml.SafeLoader):
        """Takes the tag of OpenCV's matrices."""

    Loader.add_multi_constructor("tag:yaml.org,2002:opencv", lambda loader, _, node: loader.construct_mapping(node, deep=True))
    try:
        # OpenCV's directive is not YAML
        found = yaml.load("\n".join("" if line.startswith("%YAML") else line for line in text.splitlines()), Loader)
    except yaml.YAMLError as error:
        raise DataError(f"the file is not YAML: {' '.join(str(error).split())}", code="unreadable") from error
    except (RecursionError, ValueError) as error:  # too deeply nested lists; an invalid date or number
        raise DataError(f"the file is no configuration: {error}", code="unreadable") from error
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found):
        raise DataError("the file holds no keys", code="unreadable")
    return found


def mapping(found: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Follow a path of keys through nested mappings, and return the last mapping."""
    for key in keys:
        value = found.get(key)
        if not isinstance(value, dict):
            raise DataError(f"{key} is {'missing' if value is None else 'no mapping'}; expected keys below it", code="unreadable")
        found = value
    return found


def numbers_of(found: dict[str, Any], key: str, *shape: int) -> AnyArray:
    """Return the number, vector or matrix at a key."""
    value, size = found.get(key), math.prod(shape)
    rows = value if isinstance(value, list) else [value]
    flat: list[Any] = [item for row in rows for item in (row if isinstance(row, list) else [row])]
    try:
        # YAML reads 1e-3, without a decimal point, as a string
        values = np.array([float("nan") if isinstance(item, bool) else float(item) for item in flat])
    except (TypeError, ValueError, OverflowError):
        values = np.array([])
    if len(values) != size or not np.all(np.abs(values) < LARGEST):
        expected = f"{size} numbers" if size > 1 else "a number"
        raise DataError(f"{key} is {'missing' if value is None else repr(value)[:80]}; expected {expected}", code="unreadable")
    return values.reshape(shape)


def read_rate(found: dict[str, Any], key: str, options: dict[str, Any]) -> float:
    """The rate given by the user, or else the rate at a key."""
    if options["rate"] is None and key not in found:
        raise DataError(f"the file does not say the rate; {_AGAIN}", code="unreadable")
    return float(options["rate"] or numbers_of(found, key))
