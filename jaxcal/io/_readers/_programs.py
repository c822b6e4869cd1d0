"""Convert text that known programs write to a line of names and lines of numbers: ArduPilot, LabVIEW, VectorNav."""

import itertools
import re
from collections.abc import Callable

from .._names import parse_name
from ._labelled import LOOK, SHARE

#: names of the fields of messages that hold their readings in a fixed order
_IMU = "MagX [G],MagY [G],MagZ [G],AccX [m/s^2],AccY [m/s^2],AccZ [m/s^2],GyrX [rad/s],GyrY [rad/s],GyrZ [rad/s]"
_SENTENCES = {"$VNYMR": f"Yaw,Pitch,Roll,{_IMU}", "$VNIMU": f"{_IMU},Temperature [degC],Pressure"}


def of_program(text: str) -> Callable[[str], str] | None:
    """The function that converts text of a known program to a table, or None for other text."""
    if text.startswith("FMT, "):
        return _dataflash
    if text.startswith("LabVIEW Measurement"):
        return _labview
    lines = [line for line in text.split("\n", LOOK)[:LOOK] if line.strip()]
    if len(lines) > 2 and re.match(r"[\d.]+ sec,", lines[2]):  # durations, as MATLAB writes those of a timetable
        return lambda text: re.sub(r"^([\d.]+) sec,", r"\1,", text, flags=re.MULTILINE)
    sentence = next((one for one in _SENTENCES if sum(line.startswith(one) for line in lines) > SHARE * len(lines)), "")
    if sentence:
        kept = re.compile(rf"{re.escape(sentence)},(.*)\*[0-9A-Fa-f]+")
        return lambda text: "\n".join([_SENTENCES[sentence], *(match[1] for line in text.split("\n") if (match := kept.match(line)))])
    return None


def _dataflash(text: str) -> str:
    """The records of the first IMU in the text of a DataFlash log, by the names in its FMT lines."""
    rows = [[field.strip() for field in line.split(",")] for line in text.split("\n") if line.startswith(("FMT,", "IMU,"))]
    names = next((row[5:] for row in rows if row[0] == "FMT" and row[3] == "IMU"), [])
    first = [row[1:] for row in rows if row[0] == "IMU" and len(row) == len(names) + 1]
    if "I" in names:
        first = [row for row in first if row[names.index("I")] == "0"]
    return "\n".join(",".join(row) for row in [names, *first])


def _labview(text: str) -> str:
    """The rows below the last header of a LabVIEW measurement file, with units beside the names, and the rate if there is no time."""
    *heads, body = re.split(r"^\*\*\*End_of_Header\*\*\*.*\n", text, flags=re.MULTILINE)
    stated = {words[0]: words[1:] for line in "".join(heads).split("\n") if len(words := line.rstrip("\r\t ").split("\t")) > 1}
    names, *rows = body.lstrip("\r\n").split("\n")
    first, *channels = names.rstrip("\r").split("\t")
    units = [f" [{unit}]" if unit else "" for unit in stated.get("Y_Unit_Label", [])]
    named = [name + unit for name, unit in itertools.zip_longest([one for one in channels if one != "Comment"], units, fillvalue="")]
    timed = stated.get("X_Columns", ["One"])[0] != "No"
    rate = "" if timed else f"sampling rate: {1 / float(stated.get('Delta_X', ['1'])[0].replace(',', '.')):.9g} Hz\n"
    header = "\t".join(["time [s]" if timed else first, *named]) + "\n" if any(map(parse_name, named)) else ""
    # the last column holds comments, and is empty in most rows
    width = len(named) + 1
    return rate + header + "\n".join("\t".join(row.split("\t")[(not timed) : width]) for row in rows)
