"""The part of YAML in which calibrations are written: keys by indentation, numbers, words, and lists of numbers.

Anchors, several documents, multi-line text and the like are refused, not guessed at.
"""

import re
from typing import Any

from .._errors import DataError

_LARGEST = 2**20  # characters
_DEEPEST = 20
_KEY = re.compile(r"""(?P<key>"[^"]*"|'[^']*'|[^\s:\[\]{}"'#][^:\[\]{}"'#]*?)\s*:(?:\s+(?P<value>.*))?$""")
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_WORDS = {"true": True, "false": False, "null": None, "~": None}


def parse(text: str) -> dict[str, Any]:
    r"""The mapping that a text holds.

    Raises
    ------
    DataError
        If it is not such a text; the message names the line.

    Examples
    --------
    >>> from jaxcal.export._yaml import parse
    >>> parse("a: 1.0  # Hz\nb:\n  c: [1, 2]\n  d:\n  - [3.5]")
    {'a': 1.0, 'b': {'c': [1.0, 2.0], 'd': [[3.5]]}}
    """
    if len(text) > _LARGEST:
        raise DataError(f"the file has {len(text)} characters; a configuration has some thousands")
    lines = _lines(text)
    if not lines:
        raise DataError("the file holds no keys")
    found, rest = _mapping(lines, 0, lines[0][1], 0)
    if rest < len(lines):
        raise _wrong(lines[rest])
    return found


Line = tuple[int, int, str]  # number, indentation, text


def _lines(text: str) -> list[Line]:
    """Lines with something in them, lists that go over several joined."""
    found: list[Line] = []
    depth = 0
    for i, raw in enumerate(text.splitlines(), 1):
        if raw.startswith("%YAML") or raw.strip() in ("---", "..."):
            continue
        line = _without_comment(raw).rstrip()
        if not line.strip():
            continue
        if "\t" in line[: len(line) - len(line.lstrip())]:
            raise DataError(f"line {i} is indented by a tab; YAML takes spaces")
        if depth > 0:
            number, indent, start = found[-1]
            found[-1] = (number, indent, f"{start} {line.strip()}")
        else:
            found.append((i, len(line) - len(line.lstrip()), line.strip()))
        depth += line.count("[") - line.count("]")
    return found


def _without_comment(line: str) -> str:
    quote = ""
    for i, letter in enumerate(line):
        if quote:
            quote = "" if letter == quote else quote
        elif letter in "\"'":
            quote = letter
        elif letter == "#" and (i == 0 or line[i - 1].isspace()):
            return line[:i]
    return line


def _mapping(lines: list[Line], at: int, indent: int, depth: int) -> tuple[dict[str, Any], int]:
    if depth > _DEEPEST:
        raise _wrong(lines[at])
    found: dict[str, Any] = {}
    while at < len(lines) and lines[at][1] == indent:
        match = _KEY.match(lines[at][2])
        if match is None or lines[at][2].startswith("- "):
            raise _wrong(lines[at])
        key, value = _word(match["key"]), (match["value"] or "").strip()
        if key in found:
            raise DataError(f"line {lines[at][0]}: {key} stands there twice")
        value = "" if value.startswith("!!") and " " not in value else value
        at += 1
        if value:
            found[key] = _value(value, lines[at - 1])
        elif at < len(lines) and lines[at][1] >= indent and lines[at][2].startswith("-"):
            found[key], at = _sequence(lines, at, lines[at][1])
        elif at < len(lines) and lines[at][1] > indent:
            found[key], at = _mapping(lines, at, lines[at][1], depth + 1)
        else:
            found[key] = None
    if at < len(lines) and lines[at][1] > indent:
        raise _wrong(lines[at])
    return found, at


def _sequence(lines: list[Line], at: int, indent: int) -> tuple[list[Any], int]:
    found = []
    while at < len(lines) and lines[at][1] == indent and lines[at][2].startswith("-"):
        found.append(_value(lines[at][2][1:].strip(), lines[at]))
        at += 1
    return found, at


def _value(text: str, line: Line) -> Any:
    if text.startswith("["):
        if not text.endswith("]") or text.count("[") != text.count("]") or "[" in text[1:]:
            raise _wrong(line)
        inner = text[1:-1].strip().rstrip(",")
        return [_value(item.strip(), line) for item in inner.split(",")] if inner else []
    if text[:1] in "{}&*|>!@`]," or not text:
        raise _wrong(line)
    if _NUMBER.fullmatch(text):
        return float(text)
    return _WORDS.get(text.lower(), _word(text))


def _word(text: str) -> str:
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "\"'" else text


def _wrong(line: Line) -> DataError:
    return DataError(f"line {line[0]} is {line[2]!r:.80}; expected a key and its value, or a list of numbers")
