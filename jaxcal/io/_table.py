"""Convert a table of columns to time stamps in s and sensors in SI: by explicit options first, then by names, then by values."""

import dataclasses
import re
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._message import Message, joined_messages, printable
from .._quality import all_finite
from .._units import si_unit
from . import _guess
from ._choose import HOW, numbers_of, option, select
from ._clock import OF_NAME, check_rate, clock_of, label_of, newest_first, no_clock, refuse_restarts, stated_rate
from ._columns import SENSORS, Columns, listing, scale
from ._evidence import Turning
from ._findings import READ
from ._mixed import own_rows
from ._names import COUNTS, RELATIVE, bracketed
from ._phase import differentiate
from ._saved import Saved
from ._stamps import Clock

#: characters of a column's name: no name of a sensor is longer, and patterns that look for units in it take time as its square
_LONGEST = 200


@dataclasses.dataclass
class Table:
    """Columns of a table, as a reader found them.

    `names` has empty strings for columns without a name. `integer` are the columns without decimals, `clocks` those with times of day in
    s, `days` those with dates without a time. `preamble` is the text above the table, `stem` the file name without its suffix. `rate` is
    a sampling rate that the file states separately; `saved` is the description written by `convert`.
    """

    columns: list[np.ndarray]
    names: list[str]
    integer: set[int] = dataclasses.field(default_factory=set)
    rate: float | int | None = None
    findings: list[Finding] = dataclasses.field(default_factory=list)
    saved: Saved | None = None
    clocks: set[int] = dataclasses.field(default_factory=set)
    days: set[int] = dataclasses.field(default_factory=set)
    preamble: str = ""
    stem: str = ""
    word: str | None = None  # the sensor that a word in every row names

    def __post_init__(self) -> None:
        # pandas writes a column of two levels as ('acc', 'x')
        self.names = [re.sub(r"^\('(\w*)', '(\w*)'\)$", r"\1 \2", printable(name)[:_LONGEST]) for name in self.names]


@dataclasses.dataclass(frozen=True)
class Choice:
    """How one quantity is read: columns (or topics), unit, reason, whether there is evidence, and the options that change it.

    `option` spells the options for Python; `option.spelt("terminal")` for the command line.
    """

    quantity: str
    columns: tuple[str, ...]
    unit: str
    reason: str
    certain: bool
    option: Message


@dataclasses.dataclass
class Signals:
    """Data for a `Log`, and the columns and units from which they come.

    `own_time` has the stamps of sensors with their own; `nominal` is a rate that the file states beside stamps. `choices` are for
    `jaxcal.io.inspect`, `sources` sentences on all topics, `imus` the `topics` of each IMU if there are several. `problems` are what keeps
    the table from being read.
    """

    time: np.ndarray | None
    sensors: dict[str, np.ndarray]
    own_time: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)
    epoch_ns: int = 0
    columns: dict[str, Any] = dataclasses.field(default_factory=dict)
    units: dict[str, str] = dataclasses.field(default_factory=dict)
    findings: list[Finding] = dataclasses.field(default_factory=list)
    rate: float | int | None = None
    nominal: float | None = None
    choices: list[Choice] = dataclasses.field(default_factory=list)
    sources: list[str] = dataclasses.field(default_factory=list)
    imus: list[str] = dataclasses.field(default_factory=list)
    problems: list[Any] = dataclasses.field(default_factory=list)


# overflow gives infinity, which counts as missing
@np.errstate(invalid="ignore", over="ignore")
def interpret(
    table: Table, columns: Columns, units: dict[str, str], rate: float | int | None, missing: float | int | None = None,
    phase: bool = False, wanted: str | None = None,
) -> Signals:  # fmt: skip
    """Convert a table to time stamps and sensors; `missing` is the number that marks a missing value, `phase` says that all values
    are time integrals, and `wanted` is the only sensor that is needed: of a magnetometer, readings without a clock will do.

    One error reports everything that is missing or contradictory, so that the user needs only one more call.
    """
    listed = listing(table.names, len(table.columns))
    if not table.columns or not len(table.columns[0]):
        raise DataError(f"there are no rows of numbers (columns: {listed})", code="no_rows")
    newest_first(table)
    found = select(table, columns, wanted)
    if not set(found.columns) - {"time"}:
        raise DataError(Message("no sensor among the columns {listed}; {how}", listed=listed, how=HOW), code="no_sensor")
    signals = Signals(None, {}, findings=[*table.findings, *found.findings], rate=rate)
    problems = signals.problems
    stated = (float(table.rate), "the file states") if table.rate else stated_rate(table.preamble, table.stem)
    clock: Clock | None = None
    if columns.get("time", ...) is not None:
        try:
            clock = clock_of(table, found, units, rate if rate is not None else stated and stated[0])
        except DataError as error:
            problems.append(error)
    names = [name for name in (*SENSORS, "temperature") if name in found.columns]
    raw = {name: [_without(numbers_of(table, i), missing) for i in found.columns[name]] for name in names}
    if clock is not None and not (clock.sure or phase):
        clock = _settled(clock, raw)
    _set_time(table, found, columns, clock, stated, signals)
    if wanted == "mag" and "mag" in raw and signals.time is None and not signals.rate:
        problems[:] = [one for one in problems if getattr(one, "code", "") != "no_rate"]
        raw, signals.rate = {"mag": raw["mag"]}, 1.0
        signals.findings.append(READ("no_clock"))
    period = clock.period if clock is not None else 1.0 / signals.rate if signals.rate else None
    raw, signals.time = own_rows(raw, signals.time, problems)
    for name in found.increments if period and not phase else ():
        raw[name] = [column / period for column in raw[name]]
        signals.findings.append(READ("increments", name, quantity=name))
    if phase:
        raw, signals.time = differentiate(raw, signals.time, signals.rate)
        signals.findings.append(READ("phase"))
    guesses = _units(table, found, raw, units, period, clock, signals)
    if problems:
        raise problems[0] if len(problems) == 1 and isinstance(problems[0], DataError) else _all_of(problems)
    signals.columns = {name: indices for name, indices in found.columns.items() if name == "time" or name in guesses}
    scales = {name: scale(guess.unit, name) for name, guess in guesses.items()}
    for name, guess in guesses.items():
        signals.units[name] = guess.unit
        reason = "; ".join(why for why in (found.why.get(name), guess.reason) if why)
        tell(table, name, found.columns[name], guess.unit, reason, guess.other, guess.sure, name in found.guessed, signals)
    taken = [i for indices in signals.columns.values() for i in indices]
    # a table of which most columns are used is converted in place, to save memory
    own = len(set(taken)) == len(taken) > len(table.columns) / 2
    for name, (factor, offset) in scales.items():
        signals.sensors[name] = _convert(raw.pop(name), factor, offset, own=own)
        # free the source columns: a large table may not fit into memory twice
        for i in found.columns[name]:
            table.columns[i] = table.columns[i][:0]
    unused = [name or str(i) for i, name in enumerate(table.names) if i not in taken]
    if unused and found.guessed:
        shown = f"{', '.join(unused[:12])}{' ...' if len(unused) > 12 else ''}"
        signals.findings.append(READ("not_read", what=f"column{'s' * (len(unused) > 1)} {shown}"))
    return signals


def _all_of(problems: list[Any]) -> DataError:
    """One error with everything that is missing or contradictory."""
    return DataError(joined_messages(problems, "; and "), next((code for one in problems if (code := getattr(one, "code", ""))), "unclear"))


def tell(
    table: Table, name: str, indices: list[int], unit: str, reason: str, other: str, sure: bool, guessed: bool, signals: Signals
) -> None:  # fmt: skip
    """Record how a quantity is read, and say so unless the user has chosen columns and unit."""
    numbers = _spelled(indices, ":", ",")
    option = Message("{option.columns:{name}={numbers}} {option.units:{name}={other}}", name=name, numbers=numbers, other=other or unit)
    shown = tuple(table.names[i] or f"column {i}" for i in indices)
    signals.choices.append(Choice(name, shown, unit, reason or "as given", sure, option))
    if guessed or reason:
        known = [table.names[i] for i in indices if table.names[i]]
        where = f"column{'s' * (len(indices) > 1)} {_spelled(indices, '-', ', ')}" + (f" ({', '.join(known)})" if known else "")
        facts: dict[str, Any] = {"where": where, "unit": {"date": "dates"}.get(unit, unit), "quantity": name, "columns": numbers}
        why = f" ({reason})" if reason and reason != "dates" else ""
        code = ("stated" if reason.startswith("from ") or not other else "read_as") if sure else "assumed"
        signals.findings.append(READ(code, name, **facts, why=why, other=other or unit))


def _set_time(table: Table, found: Any, columns: Columns, clock: Clock | None, stated: tuple[float, str] | None, signals: Signals) -> None:
    """Set the time stamps, or else the rate."""
    if clock is None:
        if "time" not in columns and (signals.rate or stated):
            _place_by_counter(table, found, float(signals.rate or (stated or (0.0,))[0]), signals)
        if signals.rate is None and stated is not None:
            signals.rate = stated[0]
            signals.findings.append(READ("rate_of_name" if stated[1] == OF_NAME else "rate_stated", rate=stated[0], source=stated[1]))
        elif signals.rate is None and not signals.problems:
            counters = [table.names[i] for i, one in enumerate(found.names) if one is not None and one.kind == "counter" and table.names[i]]
            signals.problems.append(no_clock(table, list(dict.fromkeys([*counters, *found.counters]))[:3]))
        return
    label = label_of(table, clock.columns)
    try:
        refuse_restarts(clock)
        if signals.rate is None and clock.reason:
            check_rate(clock, stated, signals.findings, label)
    except DataError as error:
        signals.problems.append(error)
    signals.time, signals.epoch_ns, signals.units["time"] = clock.time, clock.epoch_ns, clock.unit
    signals.nominal = float(table.rate) if table.rate else None
    tell(table, "time", clock.columns, clock.unit, clock.reason, clock.other, clock.sure, "time" in found.guessed, signals)


def _settled(clock: Clock, raw: dict[str, list[np.ndarray]]) -> Clock:
    """The clock in that of its two units in which gravity or the field turns as the gyroscope says, if it turns so in one of them."""
    values, fits = {name: _stack(columns) for name, columns in raw.items() if name != "temperature"}, {}
    for unit in {clock.unit, clock.other}:
        ratio = scale(unit, "time")[0] / scale(clock.unit, "time")[0]
        turns = _guess.turns_of(values, clock.period * ratio)
        if turns is not None and turns.unit and abs(turns.correlation) > 0.6:
            fits[unit] = ratio, f"{clock.reason.partition(';')[0]}; gravity or the field turns as the gyroscope says"
    if len(fits) != 1:
        return clock
    unit, (ratio, reason) = fits.popitem()
    other = clock.unit if unit == clock.other else clock.other
    time, epoch = clock.time * ratio, round(clock.epoch_ns * ratio)
    return dataclasses.replace(clock, time=time, unit=unit, reason=reason, other=other, sure=True, epoch_ns=epoch)


def _place_by_counter(table: Table, found: Any, rate: float, signals: Signals) -> None:
    """Without a clock, use a sample counter to find lost samples, and set time stamps if it skips some."""
    for i, one in enumerate(found.names):
        if one is None or one.kind != "counter" or table.columns[i].dtype.kind not in "iuf":
            continue
        counts = np.asarray(table.columns[i], np.float64)
        steps = np.diff(counts)
        lost = steps > 1
        if np.isfinite(counts).all() and np.all(steps >= 1) and np.any(lost) and np.mean(steps == 1) > 0.95 and not np.any(counts % 1):
            signals.time = (counts - counts[0]) / rate
            facts = {"count": int((steps[lost] - 1).sum()), "places": np.count_nonzero(lost)}
            signals.findings.append(READ("skips", counter=table.names[i], **facts))
            return


def _units(
    table: Table, found: Any, raw: dict[str, Any], units: dict[str, str], period: float | None, clock: Clock | None, signals: Signals
) -> dict[str, _guess.Guess]:  # fmt: skip
    """Find the unit of every sensor; a magnetometer without a field, or a sensor without a unit, is left out with a warning."""
    guesses: dict[str, _guess.Guess] = {}
    values: dict[str, np.ndarray] = {}
    for name in list(raw):
        values[name] = _stack(raw[name])
        why = _guess.no_field(values[name]) if name == "mag" and name in found.guessed and "mag" not in units else None
        if why and len(set(raw) - {"temperature"}) > 1:
            signals.findings.append(READ("left_out", name, why=why, quantity=name))
            del raw[name], values[name]
        elif why:
            said = "mag: {why}; there is no other sensor in the table. {option.units:mag=...} reads it all the same"
            signals.problems.append(Message(said, why=why))
    turns = _guess.turns_of(values, period)
    for name in raw:
        first = table.names[found.columns[name][0]]
        stated, header = units.get(name) or found.units.get(name), found.units.get(name)
        if name in units and header and scale(header, name) != scale(units[name], name):
            signals.findings.append(READ("against_header", name, unit=units[name], header=header))
        where = "as given" if name in units else f"from {found.profile}" if found.profile and name in found.guessed else "from the name"
        try:
            if stated is None:
                _refuse_unknown_unit(name, first)
                if name == "gyro" and (like := _guess.keeps_length(values[name])):
                    said = "{like}: name them with {option.columns:{given}}, or read them all the same with {option.units:gyro=deg/s}"
                    rest = {one: columns for one, columns in found.columns.items() if one != "gyro"}
                    raise DataError(Message(said, like=like, given=option({"accel": found.columns[name]} | rest)), code="accel_as_gyro")
            guesses[name] = _unit(name, values[name], stated, where, period, turns, name in units, signals.findings)
        except DataError as error:
            unsure = name == "mag" or getattr(error, "code", "") == "gravity_free" or name in found.unsure
            apart = (stated is None and unsure) or name == "temperature"
            if name in found.guessed and set(raw) - {name, "temperature"} and apart:  # the other sensors can be used without it
                signals.findings.append(READ("left_out", name, why=getattr(error, "why", error), quantity=name))
            else:
                signals.problems.append(error)
    for name in set(raw) - set(guesses):
        raw.pop(name)
    _check_turns(guesses, turns, clock, signals)
    return guesses


def _unit(
    name: str, values: np.ndarray, stated: str | None, where: str, period: float | None, turns: Turning | None, given: bool,
    findings: list[Finding],
) -> _guess.Guess:  # fmt: skip
    if not np.isfinite(values).all(axis=1).any():
        # `Log` refuses a sensor without values, and names it
        return _guess.Guess(stated or si_unit(name), "there is nothing to tell it from", "")
    if not given:
        return _guess.judged(name, values, stated, where, period, turns)
    try:
        _guess.judged(name, values, stated, where, period, turns)
    except DataError as error:  # a unit given by the caller overrides the evidence in the values
        findings.append(_guess.against_values(name, name, stated, where, error))
    return _guess.Guess(stated or "", "", "")


def _check_turns(guesses: dict[str, _guess.Guess], turns: Turning | None, clock: Clock | None, signals: Signals) -> None:
    """Check that rates and time stamps together agree with the observed rotation of gravity or of the field."""
    if turns is None or "gyro" not in guesses or abs(turns.correlation) < 0.6:
        return
    factor, _ = scale(guesses["gyro"].unit, "gyro")
    slope = turns.slope / factor
    if guesses["gyro"].unit != f"1 {si_unit('gyro')}" and not 0.2 < abs(slope) < 5.0:  # one unit a count: its size is not known
        what = "the clock is not in " + clock.unit if clock is not None and not clock.sure else "the unit of gyro or of time is wrong"
        found = READ("turns_differ", "gyro", ratio=slope, r=abs(turns.correlation), what=what)
        if guesses["gyro"].reason and (guesses["gyro"].reason != "as given"):
            said = "{found} Give them with {option.units:gyro=...,time=...}, or {option.rate:HZ}"
            signals.problems.append(Message(said, found=found))
        else:
            signals.findings.append(found)
    elif slope < 0:
        signals.findings.append(READ("turns_against", "gyro"))


def _without(column: np.ndarray, missing: float | int | None) -> np.ndarray:
    """Replace the number that marks a missing value, if there is one, by NaN."""
    return column if missing is None else np.where(column == missing, np.nan, column)


def _beside(columns: list[np.ndarray]) -> np.ndarray | None:
    """View columns that are successive rows of one array as (k, n), without a copy; None for other columns."""
    base = columns[0].base
    if base is None or base.ndim != 2 or base.dtype != np.float64 or not base.flags.writeable or base.strides[1] != base.itemsize:
        return None
    if base.shape[1] < len(columns[0]) or any(column.base is not base or column.strides != (base.itemsize,) for column in columns):
        return None
    place, rest = divmod(columns[0].ctypes.data - base.ctypes.data, base.strides[0])
    if rest or any(column.ctypes.data != columns[0].ctypes.data + j * base.strides[0] for j, column in enumerate(columns)):
        return None
    return base[place : place + len(columns), : len(columns[0])]


def _convert(columns: list[np.ndarray], factor: float, offset: float, *, own: bool = False) -> np.ndarray:
    """Convert columns to (n, k) in SI, each channel contiguous; in place if they are adjacent and may be overwritten (`own`)."""
    out = _beside(columns) if own else None
    if out is None:
        out = np.empty((len(columns), len(columns[0])))
        for row, column in zip(out, columns, strict=True):
            np.multiply(column, factor, out=row, casting="unsafe")
    elif factor != 1.0:
        out *= factor
    if offset:
        out += offset
    return out.T


def _stack(columns: list[np.ndarray]) -> np.ndarray:
    """Stack columns to (n, k), with NaN for values that are not finite."""
    rows = _beside(columns)
    values = _convert(columns, 1.0, 0.0) if rows is None else rows.T
    return values if all_finite(values) else np.where(np.isfinite(values), values, np.nan)


def _refuse_unknown_unit(name: str, header: str) -> None:
    """Refuse an unknown unit in square brackets, because a guess could contradict the statement of the header."""
    inside = bracketed(header) or ""
    relative = name == "mag" and (RELATIVE.fullmatch(inside) or header.lower().endswith(("_flux", " a.u.", "_au")))
    if relative or COUNTS.fullmatch(inside) or re.search(r"\[[^\]]*[A-Za-z][^\]]*\]", header):
        said = "the header {header!r} gives no known unit of {name}; give it, or the size of one, as in {option.units:{name}={example}}"
        example = "50 uT" if name == "mag" else f"0.01 {si_unit(name)}"
        raise DataError(Message(said, header=header, name=name, example=example), code="unit_unknown")


def _spelled(indices: list[int], to: str, between: str) -> str:
    """Spell consecutive numbers as a range, other numbers one by one."""
    run = len(indices) > 1 and indices == list(range(indices[0], indices[-1] + 1))
    return f"{indices[0]}{to}{indices[-1]}" if run else between.join(map(str, indices))
