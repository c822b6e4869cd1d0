"""How results reach the disk: files that are either whole or not there, and one layout of JSON."""

import contextlib
import json
import os
import pathlib
import shutil
import uuid
from typing import Any

from ._errors import ExportError

_WIDTH = 100  # a list with words in it is broken into lines beyond this


def write_atomically(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a file in one step: a reader sees the old content or the new one, never a part.

    The data (text in UTF-8, line ends as given, or bytes) go to a temporary file in the same folder, are flushed to the disk, and take
    the name `path` by a rename. If anything fails, the temporary file is removed and a file already at `path` is left as it was.
    """
    path = pathlib.Path(path)
    folder = path.parent
    if not folder.exists():
        raise ExportError(f"cannot write {path}: the folder {folder} does not exist; create it, or give a path in another folder")
    if not folder.is_dir():
        raise ExportError(f"cannot write {path}: {folder} is a file, not a folder; give a path in a folder")
    if path.is_dir():
        raise ExportError(f"cannot write {path}: it is a folder; give the path of a file in it, such as {path / 'result'}")
    content = data.encode("utf-8") if isinstance(data, str) else data
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)  # a pipe or device has no old content to keep, and must not be replaced by a file
        else:
            _replace(path.resolve(), content)  # a link keeps pointing at the file that is replaced
    except OSError as error:
        reason = (error.strerror or str(error)).lower()
        raise ExportError(f"cannot write {path}: {reason}; make the folder {folder} writable, or give a path in another folder") from error


def _replace(target: pathlib.Path, content: bytes) -> None:
    temporary = target.with_name(f".{uuid.uuid4().hex}.part")
    try:
        with open(temporary, "xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        if target.exists():
            shutil.copymode(target, temporary)
        os.replace(temporary, target)
    except BaseException:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)
        raise


def json_text(document: dict[str, Any]) -> str:
    """JSON with one key a line, arrays of numbers in one line, floats as their shortest exact text, and a final newline.

    NaN and infinity do not exist in JSON: the caller writes None and says why.

    Examples
    --------
    >>> from jaxcal._files import json_text
    >>> print(json_text({"rate": 200.0, "matrix": [[1.0, 0.0], [0.0, 1e-06]], "device": {"name": "a"}}), end="")
    {
      "rate": 200.0,
      "matrix": [[1.0, 0.0], [0.0, 1e-06]],
      "device": {
        "name": "a"
      }
    }
    """
    return _layout(document, "") + "\n"


def _layout(value: Any, indent: str) -> str:
    inner = indent + "  "
    if isinstance(value, dict) and value:
        entries = (f"{inner}{_plain(key)}: {_layout(item, inner)}" for key, item in value.items())
        return "{\n" + ",\n".join(entries) + f"\n{indent}}}"
    if isinstance(value, (list, tuple)) and not _is_short(value):
        return "[\n" + ",\n".join(inner + _layout(item, inner) for item in value) + f"\n{indent}]"
    return _plain(value)


def _is_short(items: list | tuple) -> bool:
    """Whether a list goes into one line: numbers always, words where they fit, dictionaries never."""
    leaves = list(items)
    while any(isinstance(leaf, (list, tuple)) for leaf in leaves):
        leaves = [inner for leaf in leaves for inner in (leaf if isinstance(leaf, (list, tuple)) else (leaf,))]
    if any(isinstance(leaf, dict) for leaf in leaves):
        return False
    return not any(isinstance(leaf, str) for leaf in leaves) or len(_plain(items)) <= _WIDTH


def _plain(value: Any) -> str:
    return json.dumps(value, ensure_ascii=False, allow_nan=False)
