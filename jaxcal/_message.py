"""`Message`: a sentence and the facts in it, spelt for whoever reads it.

A sentence is written once. It names options as `{option.rate}`, which reads `rate=` in Python and `--rate` on the command line. It names
quantities as facts, which are shown in the units that the reader asked for. No code searches or edits a finished sentence.
"""

import shlex
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple

Reader = Literal["python", "terminal"]
#: options that take `NAME=VALUE`; in Python their value is a dictionary
_PAIRS = ("columns", "units", "axes")
#: values of the command line that are no text in Python
_CONSTANTS = {"...": "...", "none": "None"}


class _Option(NamedTuple):
    """One option: `{option.rate}`, or with a value behind a colon: `{option.rate:200}`."""

    name: str
    reader: Reader

    def __format__(self, value: str) -> str:
        if self.reader == "terminal":
            option = "--" + self.name.replace("_", "-")
            return option if value in ("", "True") else f"{option} {shlex.quote(value)}"
        key, equals, rest = value.partition("=")
        if self.name in _PAIRS and equals and "," not in value:
            return f"{self.name}={{{key!r}: {_CONSTANTS.get(rest, repr(rest))}}}"
        return f"{self.name}={value if value == '' or _is_python(value) else repr(value)}"


class _Options:
    def __init__(self, reader: Reader):
        self._reader: Reader = reader

    def __getattr__(self, name: str) -> _Option:
        return _Option(name, self._reader)


def _is_python(text: str) -> bool:
    """Whether a value reads the same in Python without quotes: a number, a placeholder in capitals, or a constant."""
    return text in ("True", "False", "None", "...") or text.isupper() or text.replace(".", "").replace("-", "").replace("e", "").isdigit()


def printable(text: str) -> str:
    """Text of a file for any output: no line feeds, and none of the characters that steer a terminal or turn the direction of writing.

    Examples
    --------
    >>> from jaxcal._message import printable
    >>> printable("gyro" + chr(27) + "[2J" + chr(0x202E) + "x" + chr(10) + "y")
    'gyro[2Jx y'
    """
    return text if text.isprintable() else "".join(one if one.isprintable() else " " * one.isspace() for one in text)


class Plain(float):
    """A number that a format such as ".2g" shows without an exponent where it has no more than six digits: 110 rather than 1.1e+02."""

    def __format__(self, spec: str) -> str:
        said = format(float(self), spec)
        return f"{float(said):.0f}" if spec.endswith("g") and "e+0" in said and abs(self) < 1e6 else said


def _told(fact: Any, reader: Reader, wanted: Sequence[str]) -> Any:
    """A fact for a format string: a quantity in its unit, a message or an error as its reader types it, a number without exponent."""
    if isinstance(fact, float):
        return Plain(fact)
    if hasattr(fact, "shown"):
        return fact.shown(wanted)
    return fact.spelt(reader) if hasattr(fact, "spelt") else printable(fact) if isinstance(fact, str) else fact


def joined_messages(parts: Sequence[Any], between: str = "; ") -> "Message":
    """Several messages, errors or texts as one message.

    Examples
    --------
    >>> from jaxcal._message import Message, joined_messages
    >>> joined_messages([Message("give {option.rate:100}"), "or stamps"], ", ").spelt("terminal")
    'give --rate 100, or stamps'
    """
    return Message(between.join(f"{{part{i}}}" for i in range(len(parts))), **{f"part{i}": part for i, part in enumerate(parts)})


class Message:
    """A sentence with facts: a format string, in which `option` is known, and facts with a method `shown` have units.

    Parameters
    ----------
    template : the sentence, as a format string.
    terminal : the sentence for the command line where it differs by more than the spelling of options.
    facts : what the sentence names; another message or an error stands in it as its reader types it.

    Examples
    --------
    >>> from jaxcal._message import Message
    >>> said = Message("{count} rows need {option.rate:200} and {option.units:accel=0.01 g}", count=3)
    >>> str(said)
    "3 rows need rate=200 and units={'accel': '0.01 g'}"
    >>> said.spelt("terminal")
    "3 rows need --rate 200 and --units 'accel=0.01 g'"
    """

    def __init__(self, template: str, /, *, terminal: str | None = None, **facts: Any):
        self.template, self.facts, self._terminal = template, facts, terminal

    def spelt(self, reader: Reader = "python", wanted: Sequence[str] = ()) -> str:
        """The sentence for a reader, with quantities in the wanted units where they fit."""
        shown = {name: _told(fact, reader, wanted) for name, fact in self.facts.items()}
        template = self._terminal if reader == "terminal" and self._terminal is not None else self.template
        return template.format(option=_Options(reader), **shown)

    def __str__(self) -> str:
        return self.spelt()

    def __repr__(self) -> str:
        return f"Message({self.spelt()!r})"
