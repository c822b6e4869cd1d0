"""Assign the columns of a table to sensors: by `columns=`, by known devices, or by the odds of names, units and values."""

import dataclasses
import itertools
import re
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._message import Message, joined_messages
from ._columns import AXES, SENSORS, Columns, listing, resolve
from ._evidence import all_integer
from ._findings import READ
from ._mixed import refuse_mixed
from ._names import OTHERS, Name, bracketed, foreign, is_counter, is_other, parse, quantity_of, unit_in, unit_of
from ._profiles import ROS2_IMU, matching
from ._triples import ODDS, Triple, file_kind, triples_of, weigh_values

HOW = Message("say which is which, by number or name, as in {option.columns:time=...,gyro=...,accel=...}")
#: words that suggest a sensor in the name of a column
_LIKE = re.compile(r"gyr|angular|omega|rotrate|rotation(?!vector)|acc|mag(?:n|_|$|[xyz])|compass", re.IGNORECASE)
#: words for values that were processed after the sensor
_FILTERED = re.compile(
    r"filt(?!er.?off)|lpf|corrected|compensated|smooth|(?<![a-z])(?:avg|mean|true|ref|est|ekf|kalman|fused)(?![a-z])", re.IGNORECASE
)
_CLOCKS = re.compile(r"time|stamp", re.IGNORECASE)
#: names that programs give to columns without names
_SILENT = re.compile(r"(?:var|column|col|untitled|unnamed:?)[ _]?\d*(?:_\d+)?", re.IGNORECASE)
_NOT_LIKE = re.compile(r"covar|bias|std|status|accura|calib|norm|total|abs|count|clip|temp|image|max|min|magnitude", re.IGNORECASE)


@dataclasses.dataclass
class Selection:
    """Columns by quantity, units from the names, and how the choice was made; `names` are the meanings of all columns.

    `why` gives, for a sensor that its name did not tell, what did; `counters` are the names of columns that count rows; `increments` are
    the sensors whose columns hold increments over a sampling period.
    """

    columns: dict[str, list[int]]
    units: dict[str, str]
    names: list[Name | None]
    guessed: set[str]
    profile: str = ""
    gravity_free: list[int] = dataclasses.field(default_factory=list)  # columns of acceleration without gravity
    why: dict[str, str] = dataclasses.field(default_factory=dict)
    counters: list[str] = dataclasses.field(default_factory=list)
    increments: list[str] = dataclasses.field(default_factory=list)
    unsure: list[str] = dataclasses.field(default_factory=list)  # sensors that nothing but the size of their values tells
    findings: list[Finding] = dataclasses.field(default_factory=list)


def select(table: Any, columns: Columns, wanted: str | None = None) -> Selection:
    """Choose the sensors and the temperature of a table; time, unless explicit, is chosen in `_clock`. `wanted` is the sensor asked for."""
    table.word, count = _word(table), len(table.columns)
    if count == len(ROS2_IMU) and not any(table.names) and table.columns[2].dtype.kind == "O":
        table.names[:] = ROS2_IMU
    names = table.names
    explicit = resolve(columns, names, count)
    profile, known = matching(names, table.preamble, table.stem)
    full = _grouped(table, names)
    read = [known.get(i) or (parse(name) if name else None) for i, name in enumerate(full)]
    found = Selection({}, {}, read, set(), profile.name if profile else "")
    if profile:
        found.findings.append(READ("device", name=profile.name, sign=profile.sign and f"; {profile.sign}"))
    # columns called x, y, z twice say no more than columns without names
    said = [name for name, one in zip(names, read, strict=True) if name and not name.isdecimal() and (one is None or one.kind != "time")]
    named = (any(name.lower() not in AXES for name in said) or 0 < len(said) < 6) and not all(map(_SILENT.fullmatch, said))
    triples = triples_of(table, full, known, wanted) if named else []
    several = _by_odds(table, columns, found, triples)
    if set(explicit) - {"time"}:
        found.columns = {}
    for quantity, indices in explicit.items():
        found.columns[quantity] = indices
        meaning, inside = read[indices[0]], bracketed(names[indices[0]])
        own = meaning.unit if meaning and quantity == quantity_of(meaning.kind) else None
        found.units.pop(quantity, None)
        if unit := own or (unit_of(inside, quantity) if inside else None):
            found.units[quantity] = unit
    if not set(found.columns) - {"time"}:
        if named:
            raise _unclear_names(table, found, triples)
        _by_position(table, columns, found, wanted)
    found.guessed = set(found.columns) - set(explicit)
    try:
        refuse_mixed(table, found.columns)
    except DataError as error:
        if not set(explicit) - {"time"}:
            raise
        found.findings.append(READ("mixed", why=error))  # the columns were named, so that this is no more than a warning
    if not set(explicit) - {"time"}:
        _tell_doubts(table, found, triples, several)
    return found


def _word(table: Any) -> str | None:
    """The sensor named by a word in every row, or None."""
    for column in table.columns:
        words = {str(value).strip() for value in column if value is not None} if column.dtype.kind == "O" else ()
        if len(words) == 1 and (kind := file_kind(next(iter(words)))) in SENSORS:
            return kind
    return None


def _grouped(table: Any, names: list[str]) -> list[str]:
    """Complete repeated names x, y, z with the name of their group, which is that of an empty column before them."""
    low = [re.sub(r"^([xyzw])\.\d$", r"\1", name.strip().lower()) for name in names]  # x.1, as pandas names a second x
    if low.count("x") < 2:
        return names
    group, out = "", []
    for name, axis, column in zip(names, low, table.columns, strict=True):
        if column.dtype.kind == "f" and not np.isfinite(column[:1000]).any():
            group = name
        out.append(f"{group}.{axis}" if group and axis in ("x", "y", "z", "w") else name)
    return out


def is_number(table: Any, index: int) -> bool:
    """Whether a column holds numbers."""
    return table.columns[index].dtype.kind in "iufb" and index not in table.clocks


def numbers_of(table: Any, index: int, *, dates: bool = False) -> np.ndarray:
    """The numbers of a column, or also its dates or times of day; an error if it holds text."""
    column = table.columns[index]
    if is_number(table, index) or (dates and column.dtype.kind != "O"):
        return column
    held = "dates" if column.dtype.kind != "O" else f"text, such as {next((str(v) for v in column if v is not None), '')!r}"
    said = "column {index} ({name}) holds {held}, where numbers are expected; name others with {option.columns}"
    raise DataError(Message(said, index=index, name=table.names[index] or "no name", held=held), code="text")


def _present(table: Any, index: int) -> bool:
    column = table.columns[index]
    return is_number(table, index) and (column.dtype.kind != "f" or any(np.isfinite(part).any() for part in (column[:1], column)))


def _by_odds(table: Any, columns: Columns, found: Selection, triples: list[Triple]) -> dict[str, list[Triple]]:
    """Assign each sensor to the columns with the best odds for it, or to single axes by their names; the best, if others are like them."""
    # of several, those of a whole name, then unprocessed ones, which noise analysis and calibration need
    whole = [one for one in triples if any(_present(table, i) for i in one.columns)] or triples
    filtered = [bool(_FILTERED.search(" ".join(table.names[i] for i in one.columns))) for one in whole]
    several: dict[str, list[Triple]] = {}
    for sensor in [name for name in SENSORS if name not in columns]:
        ranked = [k for k, one in enumerate(whole) if one.kind == sensor]
        ranked.sort(key=lambda k: (filtered[k], -round(whole[k].odds[sensor])))
        if not ranked:
            _by_axis(table, found, sensor, {i for one in triples if one.kind for i in one.columns}, {one.kind for one in whole})
            continue
        first, *others = (whole[k] for k in ranked)
        found.increments += [sensor] * first.increments
        found.columns[sensor] = first.columns
        if unit := first.units.get(sensor):
            found.units[sensor] = unit
        if first.name is None and sensor not in first.units:
            found.why[sensor] = first.why.get(sensor, "")
            found.unsure += [sensor] * (not found.why[sensor])
        for i, axis in zip(first.columns, AXES, strict=True):
            found.names[i] = found.names[i] or Name(sensor, axis, first.units.get(sensor))
        others = [one for one in others if one.odds[sensor] > first.odds[sensor] - ODDS["several"] and not one.increments]
        if others:
            several[sensor] = [first, *others[:4]]
    found.gravity_free = [i for one in triples if one.kind == "linear" for i in one.columns if _present(table, i)]
    temperatures = [i for i, one in enumerate(found.names) if one is not None and one.kind == "temperature" and _present(table, i)]
    if temperatures and "temperature" not in columns:
        found.columns["temperature"] = temperatures[:1]
        if (one := found.names[temperatures[0]]) is not None and one.unit:
            found.units["temperature"] = one.unit
    return several


def _by_axis(table: Any, found: Selection, sensor: str, taken: set[int], whole: set[str]) -> None:
    """Assign one or two axes, or three of different spelling; beside a `whole` sensor, axes that lack one before them are left out."""
    axes: dict[str, int] = {}
    for i, one in enumerate(found.names):
        fits = one is not None and bool(one.axis) and sensor in (one.kind, one.kind.removesuffix(" or linear"))
        if one is not None and fits and i not in taken and _present(table, i):
            axes.setdefault(one.axis, i)
    present = [axis for axis in AXES if axis in axes]
    if present != list(AXES[: len(present)]):
        said = "of {sensor} only the axes {axes} are recognised; name its columns with {option.columns:{sensor}=...}"
        error = DataError(Message(said, axes=", ".join(present), sensor=sensor), code="axes")
        if not whole & set(SENSORS):
            raise error
        found.findings.append(READ("axes", (sensor,), why=error))
    elif present:
        found.columns[sensor] = [axes[axis] for axis in present]
        if unit := next((one.unit for i in found.columns[sensor] if (one := found.names[i]) and one.unit), None):
            found.units[sensor] = unit


def _unclear_names(table: Any, found: Selection, triples: list[Triple]) -> DataError:
    """Error for names that do not say which sensor the columns hold: what they hold, and the option with what is known."""
    names, count = table.names, len(table.columns)
    if found.gravity_free:
        said = "{names} hold acceleration without gravity (linear or free), which is no specific force, and no other sensor is in the table"
        how = "; to read it all the same: {option.columns:{given}} {option.units:accel=m/s^2}"
        facts = {"names": ", ".join(names[i] for i in found.gravity_free[:3]), "given": option({"accel": found.gravity_free[:3]})}
        return DataError(Message(said + how, **facts), code="gravity_free")
    likely = [one for one in triples if not one.kind and one.odds[one.likely] > 0] or [one for one in triples if one.kind != "other"]
    refuse_mixed(table, {one.likely: one.columns for one in likely})
    apart = {i for one in triples if one.kind == "other" for i in one.columns}
    other = [i in apart or is_other(names[i]) or (one is not None and one.kind in OTHERS) for i, one in enumerate(found.names)]
    left = [i for i, name in enumerate(names) if not other[i] and is_number(table, i) and found.names[i] is None and not is_counter(name)]
    if len(left) < 3 and any(other):
        held = f"the columns {listing(names, count)} hold attitudes, places, speeds or states of a filter"
        return DataError(f"{held}; no inertial sensor is among them: log its readings themselves", code="no_sensor")
    why = f"the columns {listing(names, count)} do not say which sensor they hold"
    return unclear(why, given=option({one.likely: one.columns for one in likely[::-1]}))


def option(columns: dict[str, list[int]]) -> str:
    """Columns by quantity as the option `columns` takes them."""
    return ",".join(f"{name}={','.join(map(str, indices))}" for name, indices in columns.items())


def unclear(why: Any, code: str = "columns_unclear", given: str = "") -> DataError:
    """Error for columns that do not show which sensor they hold; `given` are columns to name, if some are likely."""
    how = Message("say which is which (gyro, accel, mag), as in {option.columns:{given}}", given=given) if given else HOW
    return DataError(joined_messages([why, how]), code)


def _by_position(table: Any, columns: Columns, found: Selection, wanted: str | None) -> None:
    """Assign columns without names: three, six or nine beside time, by their values."""
    numeric = [i for i in range(len(table.columns)) if is_number(table, i) and not foreign(bracketed(table.names[i]))]
    time, listed = found.columns.get("time"), listing(table.names, len(table.columns))
    stamps = [i for i, one in enumerate(table.columns) if one.dtype.kind == "M" or i in table.clocks]
    if time is None and "time" not in columns and not stamps:
        rising = [i for i in numeric if increasing(table.columns[i])]
        counters = [i for i in rising if np.mean(np.diff(table.columns[i]) == 1) > 0.95] if len(rising) > 1 else []
        time = [i for i in rising if i not in counters][:1] or None
        numeric = [i for i in numeric if i not in rising]
    left = [i for i in numeric if i not in (time or [])]
    if len(left) not in (3, 6, 9):
        # leave out constant columns, such as the number of a person or a sensor
        left = [i for i in left if np.ptp(table.columns[i]) > 0] if len(table.columns[0]) > 10 else left
    refuse_mixed(table, {"accel": left[-3:]})
    if len(left) not in (3, 6, 9):
        rises = f" (column {time[0]} rises, as time does)" if time else ""
        raise unclear(f"{listed}{rises}: 3, 6 or 9 columns besides time can be told apart, not {len(left)}")
    triples = [Triple(left[i : i + 3]) for i in range(0, len(left), 3)]
    for one in triples:
        if one.columns[2] - one.columns[0] != 2 and table.word is None:
            raise unclear(f"{listed}: columns {', '.join(map(str, one.columns))} do not stand side by side as axes do")
        flat = [np.ptp(table.columns[i]) == 0 for i in one.columns]
        if any(flat) and not all(flat) and len(table.columns[0]) > 100:
            raise unclear(f"{listed}: column {one.columns[flat.index(True)]} never changes, as no axis of a sensor does")
        one.odds = dict.fromkeys(SENSORS, 0.0) | {"linear": 0.0, "other": 0.0}
        weigh_values(one, table, wanted, nameless=True)
    roles, second = _joint(triples, table)
    of = {role: one.columns for role, one in zip(roles, triples, strict=True)}
    if not triples[0].why:
        which = ", ".join(f"{role} is {indices[0]}-{indices[-1]}" for role, indices in of.items())
        found.findings.append(
            READ("roles", which=which, given=option({role: one.columns for role, one in zip(second, triples, strict=True)}))
        )
    found.why |= {role: why for role, one in zip(roles, triples, strict=True) if (why := one.why.get(role))}
    found.columns |= ({"time": time} if time else {}) | of


def _joint(triples: list[Triple], table: Any) -> list[tuple[str, ...]]:
    """The sensors of columns without names, each sensor once: the best two by their odds together; an error if these are nearly equal."""
    totals = {
        roles: sum(one.odds[role] for one, role in zip(triples, roles, strict=True))
        for roles in itertools.permutations(SENSORS, len(triples))
        if "accel" in roles or len(triples) == 1
    }
    best, second = sorted(totals, key=totals.__getitem__, reverse=True)[:2]
    if totals[best] < totals[second] + ODDS["margin"] or (len(triples) > 1 and triples[best.index("accel")].odds["accel"] <= 0.0):
        values = [np.column_stack([table.columns[i] for i in one.columns]) for one in triples]
        whole = ", whole numbers that look like raw counts," if all(map(all_integer, values)) else ""
        why = f"their values{whole} do not show gravity, a field and rates clearly enough"
        given = option({role: one.columns for role, one in zip(best, triples, strict=True)})
        raise unclear(f"{listing(table.names, len(table.columns))}: {why}", "no_gravity" if len(triples) > 1 else "counts", given)
    return [best, second]


def increasing(values: np.ndarray) -> bool:
    """Whether a column increases like time: nearly all steps are positive."""
    return values.dtype.kind in "iufM" and len(values) > 1 and bool(np.mean(values[1:] > values[:-1]) >= 0.95)


def _tell_doubts(table: Any, found: Selection, triples: list[Triple], several: dict[str, list[Triple]]) -> None:
    """Report of which columns the choice is in doubt, and which look like those of a sensor but are not read."""
    for sensor, ones in several.items():
        names, *shown = (",".join(table.names[i] for i in one.columns) for one in ones)
        given = option(found.columns | {sensor: ones[1].columns})
        found.findings.append(READ("several_columns", (sensor,), 0.0, None, names=names, others="; ".join(shown), given=given))
    for sensor in found.unsure:
        names = ", ".join(table.names[i] for i in found.columns[sensor])
        odds = next(one.odds for one in triples if one.columns == found.columns[sensor])
        other = max((kind for kind in SENSORS if kind != sensor), key=lambda kind: (kind not in found.columns, odds[kind]))
        given = {kind: indices for kind, indices in found.columns.items() if kind != sensor} | {other: found.columns[sensor]}
        found.findings.append(READ("roles", (sensor,), which=f"{sensor} is {names}", given=option(given)))
    used = {i for indices in found.columns.values() for i in indices}
    missing = [sensor for sensor in SENSORS if sensor not in found.columns]
    doubtful = [one for one in triples if not used & set(one.columns) and not one.kind and {one.likely, "gyro"} & set(missing)]
    strange = [
        i for i, name in enumerate(table.names)
        if i not in used and found.names[i] is None and not (_NOT_LIKE.search(name) or is_counter(name))
        and (_LIKE.search(name) or any(unit_in(bracketed(name), sensor) for sensor in missing))
        and _present(table, i) and not _CLOCKS.search(name) and not any(i in one.columns for one in triples if one.kind)
    ]  # fmt: skip
    strange = sorted({*strange, *(i for one in doubtful for i in one.columns)})
    shown = ", ".join(f"{i} ({table.names[i]})" for i in strange[:9]) + (" ..." if len(strange) > 9 else "")
    if strange and not set(found.columns) & set(SENSORS):
        raise unclear(f"the columns {shown} look like those of a sensor, but which axis of which is not understood")
    if strange:
        likely = doubtful or [Triple(strange[:3], odds=dict.fromkeys(missing or SENSORS, 0.0))]
        more = {one.likely if one.likely in missing else "gyro": one.columns for one in likely[::-1]}
        found.findings.append(READ("strange", columns=shown, first=option(found.columns | more)))
    if found.gravity_free and "accel" not in found.columns:
        found.findings.append(READ("gravity_free", "accel", columns=", ".join(table.names[i] for i in found.gravity_free[:3])))
