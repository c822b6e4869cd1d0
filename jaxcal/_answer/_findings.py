"""`Finding`: one thing that a result has to say. Each package lists its findings in one table, and nothing else writes such sentences.

A finding holds a code and facts; a renderer makes the sentence. The verdict on a result is the worst severity among its findings.
"""

import dataclasses
import enum
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from .._message import Message, Plain, Reader
from .._units import shown_in, si_unit_of


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number with its unit, as a fact of a sentence.

    Parameters
    ----------
    value : the number, in SI.
    quantity : name of the quantity in the table of units: "gyro", "accel", "mag", "angle", "time", ...

    Examples
    --------
    >>> from jaxcal._answer import Message, Quantity
    >>> str(Message("a step of {size:.2g}", size=Quantity(1e-6, "mag")))
    'a step of 1 uT'
    """

    value: float
    quantity: str

    def shown(self, wanted: Sequence[str] = ()) -> "_Shown":
        """The number in the first wanted unit that fits, or in the usual one, for a format string."""
        unit, size = shown_in(self.quantity, wanted)
        return _Shown(self.value / size, unit)

    def to_dict(self) -> dict[str, Any]:
        """Value and SI unit, for JSON."""
        return {"value": self.value, "unit": si_unit_of(self.quantity)}


class _Shown:
    """A number and its unit, which a format string shows together."""

    def __init__(self, value: float, unit: str):
        self.value, self.unit = value, unit

    def __format__(self, spec: str) -> str:
        return f"{format(Plain(self.value), spec or '.3g')} {self.unit}".strip()


class Severity(enum.IntEnum):
    """How much a finding matters. The worst one gives the verdict: good, weak or refused."""

    NOTE = 0
    CAUTION = 1
    FATAL = 2


NOTE, CAUTION, FATAL = Severity
#: severity -> verdict
VERDICTS = {NOTE: "good", CAUTION: "weak", FATAL: "refused"}


@dataclasses.dataclass(frozen=True)
class Kind:
    """An entry of a package's table of findings.

    Parameters
    ----------
    severity : NOTE, CAUTION or FATAL, unless the finding has its own.
    sentence : what was found, as a format string of `Message`; its names are the facts of the finding.
    remedy : what to do, as a format string with the same facts; "" if there is nothing to do.
    guess : True for something that was inferred and changes the numbers if it is wrong; it stands above the table of numbers.
    terminal : the remedy for the command line, where it differs by more than the spelling of options.
    limits : values above which `Table.over` says it, and above which it says it one severity higher; with their evidence beside them.
    """

    severity: Severity
    sentence: str
    remedy: str = ""
    guess: bool = False
    terminal: str | None = None
    limits: tuple[float | int, ...] = ()


@dataclasses.dataclass(frozen=True, eq=False)
class Finding:
    """Something to know about a result or a recording.

    Attributes
    ----------
    code : name of the finding in the table of its package. Programs and tests ask for this, never for the sentence.
    severity : `Severity`.
    subject : the channels or sensors that it concerns, such as ("gyro_x", "gyro_y"); empty for all.
    facts : name -> number, text or `Quantity`, as the sentence names them.
    cost : by how much it matters beside findings of the same severity, in the unit of the result; larger is worse.
    kind : entry of the table.
    similar : other channels with a finding of this code, whose facts differ; only `joined` sets it.

    Examples
    --------
    >>> from jaxcal._answer import CAUTION, Kind, table
    >>> findings = table(late=Kind(CAUTION, "The readings are {delay:.0f} s late.", "Give {option.rate}."))
    >>> found = findings("late", ("gyro_x", "gyro_y"), delay=3.2)
    >>> str(found)
    'gyro x, y: The readings are 3 s late. Give rate=.'
    >>> found.code, found.facts["delay"]
    ('late', 3.2)
    """

    code: str
    severity: Severity
    subject: tuple[str, ...]
    facts: Mapping[str, Any]
    cost: float
    kind: Kind
    similar: tuple[str, ...] = ()

    def spelt(self, reader: Reader = "python", wanted: Sequence[str] = ()) -> str:
        """Subject, sentence and remedy for a reader, with quantities in the wanted units."""
        said = [Message(self.kind.sentence, **self.facts).spelt(reader, wanted)]
        if self.kind.remedy:
            said.append(Message(self.kind.remedy, terminal=self.kind.terminal, **self.facts).spelt(reader, wanted))
        others = f" (similar: {joined_names(self.similar)})" if self.similar else ""
        about = f"{joined_names(self.subject)}{others}: " if self.subject else ""
        return about + " ".join(said)

    def of(self, *subject: str) -> "Finding":
        """The same finding about other channels."""
        return dataclasses.replace(self, subject=subject)

    def to_dict(self) -> dict[str, Any]:
        """The finding in a form for JSON: code, severity, subject, facts with units, cost, and the sentence."""
        facts = {name: fact.to_dict() if isinstance(fact, Quantity) else fact for name, fact in self.facts.items()}
        return {"code": self.code, "severity": self.severity.name.lower(), "subject": list(self.subject), "facts": facts,
                "cost": self.cost, "text": str(self)}  # fmt: skip

    def __str__(self) -> str:
        return self.spelt()

    def _key(self) -> tuple[Any, ...]:
        return self.code, self.severity, self.subject, self.cost, str(self)

    # facts may be arrays, which have no order and no hash: findings compare by what they say
    def __eq__(self, other: object) -> bool:
        return isinstance(other, Finding) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())


class Table(dict[str, Kind]):
    """The findings of a package, by code; a call makes a `Finding`."""

    def __call__(
        self, code: str, /, subject: Iterable[str] | str = (), cost: float | int = 0.0, severity: Severity | None = None, **facts: Any
    ) -> Finding:
        """The finding of this code about a subject, with its facts."""
        kind = self[code]
        about = (subject,) if isinstance(subject, str) else tuple(subject)
        return Finding(code, kind.severity if severity is None else severity, about, facts, float(cost), kind)

    def over(self, code: str, value: Any, subject: Iterable[str] | str = (), cost: Any = None, **facts: Any) -> list[Finding]:
        """The finding if `value` is above its limits, each further limit a severity higher; none below, or for NaN.

        Examples
        --------
        >>> from jaxcal._answer import CAUTION, Kind, table
        >>> findings = table(scatter=Kind(CAUTION, "scatter of {share:.0f} %", limits=(0.1, 0.2)))
        >>> [[one.severity.name for one in findings.over("scatter", size, share=100 * size)] for size in (0.05, 0.15, 0.25)]
        [[], ['CAUTION'], ['FATAL']]
        """
        kind = self[code]
        above = sum(bool(value > limit) for limit in kind.limits)
        severity = Severity(kind.severity + above - 1) if above else None
        return [self(code, subject, value if cost is None else cost, severity, **facts)] if above else []


def table(**kinds: Kind) -> Table:
    """The table of findings of a package: code -> `Kind`."""
    return Table(kinds)


def worst(findings: Iterable[Finding]) -> Severity:
    """The worst severity; NOTE without findings."""
    return max((one.severity for one in findings), default=NOTE)


def verdict_of(findings: Iterable[Finding]) -> str:
    """The verdict: "good", "weak" or "refused"."""
    return VERDICTS[worst(findings)]


def ordered(findings: Iterable[Finding]) -> list[Finding]:
    """Findings, the worst first: by severity, then by cost."""
    return sorted(findings, key=lambda one: (-one.severity, -one.cost))


def joined(findings: Iterable[Finding]) -> list[Finding]:
    """One finding for each code, the worst first. Times and sizes are those of its own channels; the others are named as similar.

    Guesses are not joined, because each has its own facts.

    Examples
    --------
    >>> from jaxcal._answer import CAUTION, Kind, joined, table
    >>> findings = table(step=Kind(CAUTION, "a step of {size:g} m/s^2"))
    >>> [str(one) for one in joined([findings("step", "accel_x", 1.0, size=0.1), findings("step", "accel_z", 2.0, size=0.2)])]
    ['accel z (similar: accel x): a step of 0.2 m/s^2']
    """
    groups: dict[Any, list[Finding]] = {}
    for one in ordered(findings):
        groups.setdefault((one.code, one.subject if one.kind.guess else ()), []).append(one)
    found = []
    for group in groups.values():
        own = {name for one in group if str(one.of()) == str(group[0].of()) for name in one.subject}
        others = {name for one in group for name in one.subject} - own
        found.append(dataclasses.replace(group[0], subject=tuple(sorted(own)), similar=tuple(sorted(others))))
    return found


def merged(findings: Iterable[Finding]) -> list[Finding]:
    """All findings, the worst first; those that differ only in their channel are one, about all these channels.

    Examples
    --------
    >>> from jaxcal._answer import CAUTION, Kind, merged, table
    >>> findings = table(step=Kind(CAUTION, "a step of {size:g} m/s^2"))
    >>> [str(one) for one in merged([findings("step", f"accel_{axis}", size=size) for axis, size in zip("xyz", (1, 1, 2))])]
    ['accel x, y: a step of 1 m/s^2', 'accel z: a step of 2 m/s^2']
    """
    groups: dict[tuple[Any, ...], list[Finding]] = {}
    for one in ordered(findings):
        groups.setdefault((one.code, one.severity, str(one.of())), []).append(one)
    return [group[0].of(*dict.fromkeys(name for one in group for name in one.subject)) for group in groups.values()]


def joined_names(names: Iterable[str]) -> str:
    """Names of channels for readers: axes of a sensor together.

    Examples
    --------
    >>> from jaxcal._answer import joined_names
    >>> joined_names(["gyro_x", "gyro_y", "accel_x", "temperature"])
    'gyro x, y; accel x; temperature'
    """
    axes: dict[str, list[str]] = {}
    for name in names:
        sensor, _, axis = name.rpartition("_")
        axes.setdefault(sensor if sensor and len(axis) == 1 else name, []).extend([axis] if sensor and len(axis) == 1 else [])
    return "; ".join(f"{sensor} {', '.join(found)}".strip() for sensor, found in axes.items())
