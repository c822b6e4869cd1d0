"""Which files of a folder are the recording."""

import pathlib
import re

from .._errors import DataError
from ._detect import detect

#: names of text tables; anything else that is text (notes, configuration) is no log
_TEXT = (".csv", ".tsv", ".txt", ".dat", ".csv.gz", ".tsv.gz", ".txt.gz", ".dat.gz")
_PART = re.compile(r"(.+)_(\d+)")
_SHOWN, _MOST = 8, 10_000


def find(path: pathlib.Path) -> tuple[str, list[pathlib.Path]]:
    """Format of a log and its files: one, or the parts of a split ROS recording in order.

    Raises
    ------
    DataError
        If there is nothing readable, or a folder holds several logs that do not say they belong together.
    """
    if not path.is_dir():
        kind, source = detect(path)
        return kind, [source]
    if (path / "metadata.yaml").is_file():
        return "rosbag2", [path]
    logs: dict[pathlib.Path, str] = {}
    for i, file in enumerate(sorted(file for file in path.iterdir() if file.is_file() and not file.name.startswith("."))):
        if i == _MOST:
            raise DataError(f"the folder holds more than {_MOST} files; give one log")
        try:
            kind, _ = detect(file)
        except (DataError, OSError):
            continue
        if kind != "csv" or file.name.lower().endswith(_TEXT):
            logs[file] = kind
    kinds = set(logs.values())
    if not logs:
        raise DataError("the folder holds no readable log and no ROS 2 recording (metadata.yaml); give a log file")
    if len(logs) > 1 and kinds <= {"rosbag1"} | {"rosbag2"} and len(kinds) == 1:
        return kinds.pop(), _parts(list(logs))
    if len(logs) > 1:
        shown = ", ".join(file.name for file in logs)
        if len(logs) > _SHOWN:
            shown = ", ".join(file.name for file in list(logs)[:_SHOWN]) + f" and {len(logs) - _SHOWN} more"
        raise DataError(f"the folder holds {len(logs)} logs, each a recording of its own: {shown}; give one of them")
    file, kind = logs.popitem()
    return kind, [file]


def _parts(files: list[pathlib.Path]) -> list[pathlib.Path]:
    """Parts of one recording in order: name_0, name_1, ... as `rosbag record --split` and `ros2 bag record -b` name them."""
    found: dict[int, pathlib.Path] = {}
    stems = set()
    for file in files:
        match = _PART.fullmatch(file.stem)
        stems.add((match[1], file.suffix) if match else (file.name, ""))
        if match:
            found[int(match[2])] = file
    if len(stems) > 1 or len(found) < len(files):
        mend = " run `ros2 bag reindex` on it, or" if files[0].suffix != ".bag" else ""
        raise DataError(f"the folder holds {len(files)} parts of a recording but no metadata.yaml;{mend} give one part")
    missing = sorted(set(range(max(found) + 1)) - set(found))
    if missing:
        name = f"{next(iter(stems))[0]}_{missing[0]}{files[0].suffix}"
        raise DataError(f"the folder holds parts of a recording, but {name} is missing; put it there, or give one part")
    return [found[number] for number in sorted(found)]
