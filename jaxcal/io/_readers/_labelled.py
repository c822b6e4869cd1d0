"""Convert lines with a label for every number (``ax: 0.01 ay: 0.02``), or lines after a time and an arrow, to a table.

The result is one line of names, and lines of comma-separated numbers. A line of another form is unchanged, so that the reader of the table
counts it as a fault.
"""

import collections
import itertools
import re
from collections.abc import Callable

from .._names import AXES

_LOOK, _SHARE = 60, 0.8
#: a label with its number; a time at the beginning of a line, in brackets or with the arrow of a serial monitor
_PAIR = re.compile(r"[A-Za-z\]\)]\s*[:=]\s*[-+]?\.?\d")
_TIME = re.compile(r"\s*\[?((?:\d{4}-\d\d-\d\d[ T])?\d\d:\d\d:\d\d[.,]\d+)\]?\s*(->)?\s*")
_NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?(?![\w:]|\.\d)")


def relabelled(text: str) -> Callable[[str], str] | None:
    """Return a function that converts such text to a table; None for text of another form."""
    lines = [line for line in text.split("\n", _LOOK + 1)[: _LOOK + 1] if line.strip()][:_LOOK]
    arrows = sum(bool((match := _TIME.match(line)) and match[2]) for line in lines)
    pairs = sum(len(_PAIR.findall(_TIME.sub("", line, 1))) > 1 for line in lines)
    if len(lines) < 5 or max(arrows, pairs) < _SHARE * len(lines):
        return None
    forms = collections.Counter(_taken_apart(line)[0] for line in lines)
    form, count = forms.most_common(1)[0]
    if count < _SHARE * len(lines) or len(form) < 2:
        return None
    names = _names(form)
    timed = form[0] == "\0"

    def table(text: str) -> str:
        out: list[str] = []
        waiting = any(names[timed:])
        for line in text.split("\n"):
            own, numbers = _taken_apart(line)
            if own == form and waiting:
                out.append(",".join(names))
                waiting = False
            out.append(",".join(numbers) if own == form else line)
        return "\n".join(out)

    return table


def _taken_apart(line: str) -> tuple[tuple[str, ...], list[str]]:
    """Split a line into the texts between its numbers, and the numbers; a time at its beginning is the first number."""
    match = _TIME.match(line)
    first = [match[1].replace(",", ".")] if match else []
    rest = line[match.end() :] if match else line
    words, end = [], 0
    numbers = []
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
    for before, after in itertools.pairwise(form[1:]):
        label = re.sub(r"^\W+|[^\w\])]+$", "", re.split(r"[,;|]", before)[-1])
        if not re.search(r"[A-Za-z]", label):
            place += 1
            label = f"{group}_{AXES[place]}" if group and place < 3 else ""
            if place == 1 and names and group:
                names[-1] = re.sub(re.escape(group), f"{group}_x", names[-1], count=1)
        elif label.lower() in AXES and group:
            label, place = f"{re.sub(r'[ _]?[xyzXYZ]$', '', group)}_{label}", 0
        else:
            group, place = label, 0
        unit = re.match(r"\s*([^\s,;|:=]*[A-Za-z\u00b0/][^\s,;|:=]*)\s*(?:[,;|]|$)", after)
        names.append((f"{label} [{unit[1]}]" if unit and label else label).replace(",", " "))
    return names
