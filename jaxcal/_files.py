"""Write results to disk: files that are either complete or absent, and one layout for JSON."""

import contextlib
import functools
import hashlib
import importlib.metadata
import json
import math
import os
import pathlib
import platform
import re
import shutil
import time
import uuid
from typing import Any

from ._errors import ExportError
from ._message import Message

_DAYS = 3 * 86400.0  # s; age after which a left-over file is removed
PIECE = 1 << 22  # bytes: the most of a JSON document, and of each end of a file that is searched for the marks
#: how jaxcal marks the files that it writes: JSON, comments and pages, pictures, converted logs, tables of numbers, and logs
_MARKS = re.compile(
    rb"\"schema\"\s*:\s*\"jaxcal\.|written by jaxcal|Creator.{0,9}jaxcal|<dc:title>jaxcal|Software\0jaxcal|PK.{28}jaxcal\.npy"
    rb"|\APAR1.*jaxcal"
    rb"|^name,value,low,high,unit,state|^time \[s\](,(gyro|accel|mag)_[xyz] \[[^],]+\])*(,temperature \[degC\])?\r?\n-?\d+\.\d{9},",
    re.IGNORECASE | re.DOTALL,
)
#: version of an installed package; to look for it takes 0.3 ms
version_of = functools.cache(importlib.metadata.version)
_DIGEST = re.compile(rb"\b[0-9a-f]{64}\b")


def shown(path: str | os.PathLike[str]) -> str:
    r"""The name of a file as printable text: file names need not be text, and may contain line feeds.

    Examples
    --------
    >>> from jaxcal._files import shown
    >>> print(shown("a" + chr(10) + "b.csv"), shown("caf" + chr(0xdce9) + ".csv"))
    a\nb.csv caf\xe9.csv
    """
    name = pathlib.Path(path).name or os.fspath(path)
    text = os.fsencode(name).decode("utf-8", "backslashreplace")
    return "".join(letter if letter.isprintable() else letter.encode("unicode_escape").decode() for letter in text)


def write_atomically(path: str | os.PathLike[str], data: str | bytes) -> None:
    """Write a file in one step: a reader sees the old content or the new one, never a part.

    The data (text in UTF-8 with its line ends unchanged, or bytes) are written to a temporary file in the same folder, flushed to the disk,
    and renamed to `path`. If anything fails, the temporary file is removed and an existing file at `path` stays unchanged.
    """
    path = pathlib.Path(path)
    folder = path.parent
    if not folder.is_dir():
        what = "is a file, not a folder" if folder.exists() else "does not exist"
        raise ExportError(f"cannot write {path}: {folder} {what}; give a path in a folder that is there", code="not_written")
    if path.is_dir():
        raise ExportError(f"cannot write {path}: it is a folder; give the path of a file, as {path / 'result'}", code="not_written")
    content = data.encode("utf-8", "backslashreplace") if isinstance(data, str) else data  # names of files need not be text
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(content)  # a pipe or device has no old content to keep, and must not be replaced by a file
        else:
            _replace(path.resolve(), content)  # a link keeps pointing to the file that is replaced
    except OSError as error:
        said = f"cannot write {path}: {(error.strerror or str(error)).lower()}; make the folder {folder} writable, or give another"
        raise ExportError(said, code="not_written") from error


def check_replaceable(path: str | os.PathLike[str], digest: str = "", *, force: bool = False) -> None:
    """Refuse to replace a file that jaxcal did not write, or that it wrote for another log.

    Every file of jaxcal has a mark: the schema of JSON, a comment or a footer "written by jaxcal", or the metadata of a picture. Most files
    also contain the SHA-256 of their log. An empty file, and a pipe or device, may always be written.

    Parameters
    ----------
    path : the file to write.
    digest : SHA-256 of the log; "" if it is not known, which skips the second test.
    force : True allows everything.

    Raises
    ------
    ExportError
        With the code "not_ours" or "other_log".

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> from jaxcal._files import check_replaceable
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "imu.yaml")
    ...     check_replaceable(path)
    ...     _ = path.write_text("rate: 200" + chr(10))
    ...     try:
    ...         check_replaceable(path)
    ...     except jaxcal.ExportError as error:
    ...         print(error.code)
    not_ours
    """
    path = pathlib.Path(path)
    if force or not path.is_file() or not path.stat().st_size:
        return
    with path.open("rb") as file:  # the marks stand near the ends, also in a log of gigabytes
        content = file.read(PIECE)
        file.seek(max(file.tell(), path.stat().st_size - PIECE))
        content += file.read()
    if not _MARKS.search(content):
        said = Message("{name} exists, and jaxcal did not write it; {option.force:True} replaces it", name=path)
        raise ExportError(said, code="not_ours")
    logs = set(_DIGEST.findall(content))
    if digest and logs and digest.encode() not in logs:
        said = Message("{name} was written for another log; give another name, or {option.force:True} to replace it", name=path)
        raise ExportError(said, code="other_log")


def hidden_name(suffix: str = "") -> str:
    """A name for a temporary file or folder of a run; it contains the process number, so that the next run can remove left-overs."""
    return f".jaxcal-{_host()}-{os.getpid()}-{uuid.uuid4().hex[:12]}{suffix}"


def _host() -> str:
    return hashlib.sha256(platform.node().encode()).hexdigest()[:8]


def clear_hidden(folder: pathlib.Path) -> None:
    """Remove left-overs of killed runs from a folder: those of this machine whose process has ended, and any that are days old."""
    with contextlib.suppress(OSError):
        for left in folder.glob(".jaxcal-*"):
            match = re.fullmatch(r"\.jaxcal-([0-9a-f]{8})-(\d+)-[0-9a-f]{12}.*", left.name)
            if match and match[1] == _host() and os.name == "posix":
                gone = int(match[2]) != os.getpid() and not _runs(int(match[2]))
            else:
                gone = time.time() - left.lstat().st_mtime > _DAYS
            if gone and left.is_dir() and not left.is_symlink():
                shutil.rmtree(left, ignore_errors=True)
            elif gone:
                left.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _replace(target: pathlib.Path, content: bytes) -> None:
    temporary = target.with_name(hidden_name(".part"))
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
    """JSON with one key per line, arrays of numbers in one line, floats as their shortest exact text, and a final newline.

    NaN and infinity do not exist in JSON: the caller must write None and give the reason.

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
    if type(value) is float and math.isfinite(value):  # an encoder takes several times as long for a single number
        return repr(value)
    inner = indent + "  "
    if isinstance(value, dict) and value:
        entries = [f"{inner}{_plain(key)}: {_layout(item, inner)}" for key, item in value.items()]
        return "{\n" + ",\n".join(entries) + f"\n{indent}}}"
    if isinstance(value, (list, tuple)) and any(isinstance(item, dict) for item in value):
        return "[\n" + ",\n".join(inner + _layout(item, inner) for item in value) + f"\n{indent}]"
    return _plain(value)


#: text of a value in one line; `json.dumps` would make an encoder for each
_plain = json.JSONEncoder(ensure_ascii=False, allow_nan=False).encode
