"""Convert lines with a label for every number (``ax: 0.01 ay: 0.02``), with lists, or after a time and an arrow, to a table.

The result is one line of names, and lines of comma-separated numbers. A line of another form is unchanged, so that the reader of the table
counts it as a fault.
"""

import collections
import itertools
import re
from collections.abc import Callable

from ..._errors import DataError
from .._columns import SENSORS
from .._names import AXES, parse_name, unit_of

LOOK, SHARE = 60, 0.8
#: a label with its number; a time at the beginning of a line, in brackets or with the arrow of a serial monitor
_PAIR = re.compile(r"[A-Za-z\]\)][\"']?\s*(?:[:=]\s*[\[(]?|[\[(])\s*[-+]?\.?\d")
_TIME = re.compile(r"\s*\[?((?:\d{4}-\d\d-\d\d[ T])?\d\d:\d\d:\d\d[.,]\d+(?:,\d{3}(?=\]))?)\]?\s*(->|<\w+> [\w.-]+:)?\s*")
#: what follows a time after which blanks or a bracket stand instead of the mark between the numbers
_BESIDE = re.compile(r"(?:\]\s*|\s+)[^\s,;]+(?:, ?[^\s,;]+)+\s*")
#: the beginning of a line of the log of ESP-IDF, with the time in ms
_ESP = re.compile(r"\s*[EWIDV] \((\d+)\) [\w.-]+:\s*")
#: numbers in brackets, as Python writes a list
_LIST = re.compile(r"\"?[\[(]\s*([-+]?\.?\d[^\[\]()\":]*?)\s*[\])]\"?")
_LABELLED = re.compile(r"[A-Za-z][^\[(,;|\d]{0,20}[\[(]\s*[-+]?\.?\d")
#: a field of a message as `rostopic echo` prints it, and fields that tell such messages
_FIELD = re.compile(r"( *)(\w+): *(\S*)\s*$")
_MESSAGE = re.compile(r"^ *(?:angular_velocity|linear_acceleration|magnetic_field):", re.MULTILINE)
#: name, time in ms and value of a signal, as Teleplot takes them
_PLOT = re.compile(r"^>([\w.]+):(\d+):([-+\d.eE]+)", re.MULTILINE)
#: the text before the first number of a line
_WORD = re.compile(r"\s*([^\d\s]\D{0,40}?)[-+]?\.?\d")
_SENSOR = re.compile(r"imu|gyr|acc|mag", re.IGNORECASE)
_NUMBER = re.compile(r"(?<![\w.^])[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?(?!(?!(?:m?g|m?s|m?dps|[um]T)\b)[\w:]|\.\d)")


def relabelled(text: str) -> Callable[[str], str] | None:
    """Return a function that converts such text to a table; None for text of another form."""
    lines = [line for line in text.split("\n", LOOK + 1)[: LOOK + 1] if line.strip()][:LOOK]
    lines = [re.sub(r"\s{3,}", "  ", line) for line in lines]  # runs of blanks would take long
    if lines and all(map(_PLOT.match, lines)):
        return _plotted
    if turn := _turn(lines):
        return lambda text: (relabelled(joined := _joined(text, turn)) or str)(joined)
    if sum(line.strip() == "---" for line in text.split("\n", 2000)[:2000]) > 1 and _MESSAGE.search(text[:20_000]):
        return _echoed
    if (header := _listed(lines)) is not None:
        return lambda text: "\n".join([*header, *(_spread(line) for line in text.split("\n")[bool(header) :])])
    heads = {match[1].strip() if (match := _WORD.match(line)) and len(_PAIR.findall(line)) == 1 else "" for line in lines}
    if len(lines) > 4 and len(heads) == 1 and re.fullmatch(r"[A-Za-z]\w*[:=]", head := heads.pop()):  # the same word before every sample
        return lambda text: re.sub(rf"^\s*{head}\s*", "", text, flags=re.MULTILINE)
    arrows = sum(bool((match := _TIME.match(line)) and (match[2] or _BESIDE.fullmatch(line[match.end(1) :]))) for line in lines)
    pairs = sum(len(_PAIR.findall(_ESP.sub("", _TIME.sub("", line, 1), 1))) > 1 for line in lines)
    if len(lines) < 5 or max(arrows, pairs) < SHARE * len(lines):
        return None
    ((form, count),) = collections.Counter(_taken_apart(line)[0] for line in lines).most_common(1)
    if count < SHARE * len(lines) or len(form) < 2:
        return None
    names = _names(form)
    if form[0] == "\0" and any(map(_ESP.match, lines)):
        names[0] = "time_ms"

    def table(text: str) -> str:
        apart = [(line, *_taken_apart(line)) for line in text.split("\n")]
        out = [",".join(numbers) if own == form else line for line, own, numbers in apart]
        first = next(i for i, (_, own, _) in enumerate(apart) if own == form)
        return "\n".join([*out[:first], *[",".join(names)] * any(names[form[0] == "\0" :]), *out[first:]])

    return table


def _turn(lines: list[str]) -> list[str]:
    """The labels before the first number of lines that hold a sample together, one after the other; none of other lines."""
    kinds = [match[1].strip() if _PAIR.search(line) and (match := _WORD.match(line)) else "" for line in lines]
    turn = list(dict.fromkeys(kinds))
    if "" in turn or not 1 < len(turn) < 20 or len(kinds) <= 2 * len(turn):
        return []
    return turn if kinds == list(itertools.islice(itertools.cycle(turn), len(kinds))) else []


def _joined(text: str, turn: list[str]) -> str:
    """The lines of a sample in one line."""
    rows: list[list[str]] = []
    for line in text.split("\n"):
        kind = match[1].strip() if (match := _WORD.match(line)) else ""
        if kind == turn[0]:
            rows.append([])
        if rows and kind == turn[min(len(rows[-1]), len(turn) - 1)]:
            rows[-1].append(line.strip())
    return "\n".join(" | ".join(row) for row in rows if len(row) == len(turn)) + "\n"


def _echoed(text: str) -> str:
    """A table of the numbers in messages that ``rostopic echo`` or ``ros2 topic echo`` printed, with their paths as names."""
    rows: list[dict[str, str]] = []
    for message in re.split(r"^---\s*$", text, flags=re.MULTILINE):
        row: dict[str, str] = {}
        path: list[tuple[int, str]] = []
        for line in message.split("\n"):
            match = _FIELD.match(line)
            if not match:
                continue
            path = [one for one in path if one[0] < len(match[1])] + [(len(match[1]), match[2])]
            if _NUMBER.fullmatch(match[3]):
                row[".".join(name for _, name in path)] = match[3]
        if row:
            rows.append(row)
    return _written(rows)


def _plotted(text: str) -> str:
    """A table of signals that are sent one by one, with the same time where they are taken together."""
    rows: dict[str, dict[str, str]] = {}
    for name, stamp, value in _PLOT.findall(text):
        rows.setdefault(stamp, {"time_ms": stamp})[name] = value
    return _written(list(rows.values()))


def _written(rows: list[dict[str, str]]) -> str:
    """A table of these rows; one that lacks a value, as the last one that may be cut off, is left out."""
    names = list(rows[0]) if rows else []
    return "\n".join([",".join(names), *(",".join(row.get(name, "") for name in names) for row in rows if len(row) == len(names))]) + "\n"


def _listed(lines: list[str]) -> list[str] | None:
    """The header for lines with lists of numbers in brackets, such as ``0.1,"[1.0, 2.0, 3.0]"``, or none; None for other lines."""
    lists = [[len(one.split(",")) for one in _LIST.findall(line)] for line in lines]
    if len(lines) < 5 or max(lists[1], default=0) < 2 or sum(one == lists[1] for one in lists) < SHARE * len(lines):
        return None
    names = [field.strip().strip('"') for field in lines[0].split(",")]
    fields = _LIST.sub("\0", lines[1]).split(",")
    if lists[0] or len(names) != len(fields):
        return None if _LABELLED.search(lines[1]) else []
    widths = iter(lists[1])
    spread = [(name, next(widths) if "\0" in field else 1) for name, field in zip(names, fields, strict=True)]
    return [",".join(f"{name}_{AXES[k] if width == 3 else k}" if width > 1 else name for name, width in spread for k in range(width))]


def _spread(line: str) -> str:
    """A line with the numbers of its lists as fields, also where nothing but blanks stands between two lists."""
    return _LIST.sub(lambda match: ",".join(part.strip() for part in match[1].split(",")), re.sub(r"(?<=[\])])\s+(?=[\[(])", ",", line))


def refuse_kinds(lines: list[str]) -> None:
    """Refuse lines that are not one sample each: printed arrays, and lines of several kinds in turn with a word before the numbers."""
    lines = [line for line in lines if line.strip()]
    if len(lines) > 4 and "[[" in lines[0] and sum(line.strip()[0] == "[" for line in lines) > SHARE * len(lines):
        raise DataError("the lines stand in brackets, as print() writes an array: save it with numpy.savetxt or as .npy", code="printed")
    found = [(match[1], line) for line in lines if (match := _WORD.match(line)) and re.search("[A-Za-z]", match[1])]
    kinds = collections.Counter(kind for kind, _ in found)
    turns = sum(one != other for (one, _), (other, _) in itertools.pairwise(found))
    if len(found) < max(20, 0.6 * len(lines)) or not 2 <= len(kinds) <= 20 or turns < 0.4 * len(found):
        return
    # a label before every sample, such as that of an activity, is no kind of line
    sensors = [kind for kind, _ in kinds.most_common() if _SENSOR.search(kind)]
    widths = {len(re.split("[,;\t ]+", line)) for _, line in found}
    ends = {kind.rstrip()[-1:] for kind in kinds}
    # nor is a column of words, which `by_sensor` and `refuse_mixed` judge
    if len(widths) == 1 and (ends <= {",", ";"} or not (sensors or ends <= {":", "="})):
        return
    kind = sensors[0] if sensors else kinds.most_common(1)[0][0]
    word = re.sub(r"([\\/.*$^\[\]])", r"\\\1", kind)
    labelled = len(_PAIR.findall(next(line for one, line in found if one == kind))) > 1
    command = f"grep '{word}' LOG > one.txt" if labelled else f"sed -n 's/^ *{word}//p' LOG > one.txt"
    shown = ", ".join(repr(kind.strip(" ,;:=\t")) for kind, _ in kinds.most_common(6))
    said = f"lines of several kinds take turns ({shown}), over which a sample is spread; keep those of one sensor, as with `{command}`"
    raise DataError(said, code="several_kinds")


def _taken_apart(line: str) -> tuple[tuple[str, ...], list[str]]:
    """Split a line into the texts between its numbers, and the numbers; a time at its beginning is the first number."""
    match = _TIME.match(line) or _ESP.match(line)
    first = [re.sub(",(?=.*[.,])|,(?=\\d+$)", lambda mark: "." * ("." not in match[1]), match[1])] if match else []
    rest = line[match.end() :] if match else line
    words, numbers, end = [], [], 0
    for one in _NUMBER.finditer(rest):
        words.append(" ".join(rest[end : one.start()].split()))
        numbers.append(one[0])
        end = one.end()
    words.append(" ".join(rest[end:].split()))
    return ("\0" * len(first), *words), first + numbers


def _names(form: tuple[str, ...]) -> list[str]:
    """Names of the columns: the label before each number, and a unit after it; several numbers after one label are its axes."""
    names: list[str] = ["time"] if form[0] == "\0" else []
    group, place = "", 0
    # a unit between a number and the next label
    texts = [
        re.sub(r"^(\S+) (?=\S)", lambda m: f"{m[1]}, " if any(unit_of(m[1], one) for one in SENSORS) else m[0], one) for one in form[1:]
    ]
    for before, after in itertools.pairwise(texts):
        label = re.sub(r"^\W+|(?<![^\w\])])[^\w\])]+$", "", re.split(r"[,;|]", before)[-1])
        if parse_name(label) is None and parse_name(last := label.split(" ")[-1]):
            label = last
        if not re.search(r"[A-Za-z]", label):
            place += 1
            label = f"{group}_{AXES[place]}" if group and place < 3 else ""
            if place == 1 and names and group:
                names[-1] = re.sub(re.escape(group), f"{group}_x", names[-1], count=1)
        elif label.lower() in AXES and group and group.lower() not in AXES:
            label, place = f"{re.sub(r'[ _]?[xyzXYZ]$', '', group)}_{label}", 0
        else:
            group, place = label, 0
        unit = re.match(r"\s*(?=[^\s,;|:=]*[A-Za-z\u00b0/])([^\s,;|:=]+)\s*(?:[,;|]|$)", after)
        names.append((f"{label} [{unit[1]}]" if unit and label else label).replace(",", " "))
    return names
