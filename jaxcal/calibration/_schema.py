"""The file: its schema, and what is no file of this kind.

The major version changes where an old reader would misread the file; it refuses. The minor version changes where keys were added: an old
reader ignores what it does not know.
"""

import json
import pathlib
import re
from typing import Any

from .._errors import DataError

_MAJOR = 1
SCHEMA = f"jaxcal.calibration/{_MAJOR}"
_LARGEST_FILE = 64 * 2**20  # bytes; a calibration has some thousands


def read_document(path: pathlib.Path) -> Any:
    """The JSON document in a file.

    Raises
    ------
    DataError
        If the file cannot be read, is too large for a calibration, or is not JSON.
    """
    try:
        size = path.stat().st_size
        if size > _LARGEST_FILE:
            raise DataError(f"{path} has {size / 2**20:.0f} MiB; a calibration has some KiB. Is it the log?")
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise DataError(f"cannot read {path}: {(error.strerror or str(error)).lower()}") from error
    except ValueError as error:
        raise DataError(f"{path} is not JSON ({error}); expected a file written by Calibration.save") from error
    try:
        return json.loads(text, parse_constant=_no_constant)
    except RecursionError:
        raise DataError(f"{path} has lists within lists without end; expected a file written by Calibration.save") from None
    except ValueError as error:
        raise DataError(f"{path} is not JSON ({error}); expected a file written by Calibration.save") from error


def _no_constant(word: str) -> None:
    raise ValueError(f"{word} is no number in JSON")


def current(document: Any) -> dict[str, Any]:
    """The document, if its schema is one that this version reads.

    Raises
    ------
    DataError
        If the schema is missing, or of another major version.
    """
    schema = document.get("schema") if isinstance(document, dict) else None
    found = re.fullmatch(r"jaxcal\.calibration/(\d{1,9})(?:\.(\d{1,9}))?", schema) if isinstance(schema, str) else None
    if found is None:
        raise DataError(f"schema is {schema!r:.80}; expected {SCHEMA!r}, as Calibration.save writes it")
    if int(found[1]) != _MAJOR:
        raise DataError(f"schema is {schema!r}, but this version of jaxcal reads {SCHEMA!r}; install the version that wrote the file")
    return document
