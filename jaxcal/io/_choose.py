"""Assign the columns of a table to sensors: by `columns=`, by known devices, or by names, units and values."""

import dataclasses
import re
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._message import Message, joined_messages
from . import _guess
from ._columns import AXES, SENSORS, Columns, listing, resolve
from ._findings import READ
from ._mixed import refuse_mixed
from ._names import OTHERS, Name, bracketed, is_counter, is_other, unit_of
from ._profiles import ROS2_IMU, matching
from ._spelling import meanings

HOW = Message("say which is which, by number or name, with {option.columns:time=0,gyro=1:3,accel=4:6}")
_FILES = {
    "linear": r"linear|useracc|free_?acc|without_?g|ohne_?g",
    "gravity": r"gravity",
    "attitude": r"orientation|attitude|euler|quat",
    "gyro": r"gyro|gyr(?![a-z])|angular_?vel|rotation_?rate|drehrate",
    "accel": r"acc(?![a-z])|accel|beschleunigung|specific_?force",
    "mag": r"mag(?![a-z])|magnet|compass",
}
#: words that suggest a sensor in the name of a column
_LIKE = re.compile(r"gyr|angular|omega|rotrate|rotation(?!vector)|acc|mag(?:n|_|$|[xyz])|compass", re.IGNORECASE)
#: words for values that were processed after the sensor
_FILTERED = re.compile(
    r"filt(?!er.?off)|lpf|corrected|compensated|smooth|(?<![a-z])(?:avg|mean|true|ref|est|ekf|kalman|fused)(?![a-z])", re.IGNORECASE
)
_CLOCKS = re.compile(r"time|stamp", re.IGNORECASE)
_NOT_LIKE = re.compile(r"covar|bias|std|status|accura|calib|norm|total|abs|count|clip|temp|image|max|min|magnitude", re.IGNORECASE)


@dataclasses.dataclass
class Selection:
    """Columns by quantity, units from the names, and how the choice was made; `names` are the meanings of all columns.

    `why` gives, for a sensor that its name did not tell, what did; `counters` are the names of columns that count rows.
    """

    columns: dict[str, list[int]]
    units: dict[str, str]
    names: list[Name | None]
    guessed: set[str]
    profile: str = ""
    gravity_free: list[int] = dataclasses.field(default_factory=list)  # columns of acceleration without gravity
    why: dict[str, str] = dataclasses.field(default_factory=dict)
    counters: list[str] = dataclasses.field(default_factory=list)
    findings: list[Finding] = dataclasses.field(default_factory=list)


def select(table, columns: Columns) -> Selection:
    """Choose the sensors and the temperature of a table; time, unless explicit, is chosen in `_clock`."""
    names, count = table.names, len(table.columns)
    explicit = resolve(columns, names, count)
    profile, known = matching(names if any(names) else _labelled(table), table.preamble, table.stem)
    shared = _shared_prefix(names)
    read = meanings(table, shared, known)
    found = Selection({}, {}, read, set(), profile.name if profile else "")
    if profile:
        found.findings.append(READ("device", name=profile.name, sign=profile.sign and f"; {profile.sign}"))
    if any(names) or known:
        _by_name(table, columns, found)
        _by_file(table, columns, found)
    if set(explicit) - {"time"}:
        found.columns = {}
    for quantity, indices in explicit.items():
        found.columns[quantity] = indices
        meaning = read[indices[0]]
        found.units.pop(quantity, None)
        inside = bracketed(names[indices[0]])
        kind = meaning.kind if meaning else ""
        own = meaning.unit if meaning and quantity in (kind, {"accel or linear": "accel", "linear": "accel"}.get(kind)) else None
        unit = own or (unit_of(inside, quantity) if inside else None)
        if unit:
            found.units[quantity] = unit
    if not set(found.columns) - {"time"}:
        _refuse_or_position(table, columns, found)
    found.guessed = set(found.columns) - set(explicit)
    if not set(explicit) - {"time"}:
        refuse_mixed(table, found.columns)
        _tell_unused(table, found)
    else:
        try:
            refuse_mixed(table, found.columns)
        except DataError as error:  # the columns were named, so that this is no more than a warning
            found.findings.append(READ("mixed", why=error))
    return found


def _labelled(table) -> list[str]:
    """Names for a table without names, if it has five columns: the word of a sensor, a time, and three axes."""
    if (
        len(table.columns) == len(ROS2_IMU)
        and not any(table.names)
        and [i for i, one in enumerate(table.columns) if one.dtype.kind == "O"] == [2]
    ):
        table.names[:] = ROS2_IMU
    if len(table.columns) == 5 and table.columns[0].dtype.kind == "O":
        words = {str(value).strip() for value in table.columns[0] if value is not None}
        if len(words) == 1:
            return [f"{next(iter(words))}_{part}" for part in ("word", "time", *AXES)]
    return table.names


def _shared_prefix(names: list[str]) -> str:
    """Common prefix of all names up to a separator, such as the name of a device; empty if it may denote a sensor."""
    named = [name for name in names if name]
    ends = (min(named), max(named)) if len(named) > 3 else ("", "")
    same = next((i for i, (a, b) in enumerate(zip(*ends, strict=False)) if a != b), min(map(len, ends)))
    prefix = ends[0][:same]
    prefix = prefix[: max(prefix.rfind(mark) for mark in "_./: ") + 1]
    return "" if len(prefix) < 4 or _LIKE.search(prefix) else prefix


def is_number(table, index: int) -> bool:
    """Whether a column holds numbers."""
    return table.columns[index].dtype.kind in "iufb" and index not in table.clocks


def _present(table, index: int) -> bool:
    column = table.columns[index]
    return is_number(table, index) and (column.dtype.kind != "f" or bool(np.isfinite(column).any()))


def _groups(table, meanings: list[Name | None], kind: str) -> dict[tuple[int, str], dict[str, int]]:
    """Columns of one kind by sensor: (instance, stem) -> axis -> column; sensors without any value are left out."""
    found: dict[tuple[int, str], dict[str, int]] = {}
    for i, one in enumerate(meanings):
        if one is not None and one.kind == kind and one.axis and is_number(table, i):
            found.setdefault((one.instance, one.stem), {}).setdefault(one.axis, i)
    full = {key: axes for key, axes in found.items() if any(_present(table, i) for i in axes.values())}
    return full or dict(list(found.items())[:1])


def _by_name(table, columns: Columns, found: Selection) -> None:
    for sensor in SENSORS:
        if sensor in columns:
            continue
        groups = _groups(table, found.names, sensor)
        if sensor == "accel" and not groups:
            groups = _groups(table, found.names, "accel or linear")
        if not groups:
            continue
        whole = [key for key, axes in groups.items() if len(axes) == 3]
        # prefer unprocessed values, which noise analysis and calibration need
        whole.sort(key=lambda key: bool(_FILTERED.search(" ".join(table.names[i] for i in groups[key].values()))))
        key = whole[0] if whole else next(iter(groups))
        axes = groups[key]
        if not whole:  # the axes of one sensor may be spelled differently
            for other in groups.values():
                axes = other | axes
        present = [axis for axis in AXES if axis in axes]
        if present != list(AXES[: len(present)]):
            said = "only the axes {axes} of {sensor} are recognised in the columns {listed}; name them with {option.columns:{sensor}=...}"
            listed = listing(table.names, len(table.names))
            raise DataError(Message(said, axes=", ".join(present), sensor=sensor, listed=listed), code="axes")
        found.columns[sensor] = [axes[axis] for axis in present]
        unit = next((one.unit for i in found.columns[sensor] if (one := found.names[i]) and one.unit), None)
        if unit:
            found.units[sensor] = unit
        others = [axes for other, axes in groups.items() if other != key and len(axes) == 3]
        if whole and others:
            shown = [",".join(table.names[axes[axis]] for axis in AXES) for axes in others[:4]]
            names = ",".join(table.names[i] for i in found.columns[sensor])
            facts: dict[str, Any] = {"names": names, "others": "; ".join(shown), "quantity": sensor, "first": shown[0]}
            found.findings.append(READ("several_columns", (sensor,), 0.0, None, **facts))
    found.gravity_free = [i for i, one in enumerate(found.names) if one is not None and one.kind == "linear" and _present(table, i)]
    temperatures = [i for i, one in enumerate(found.names) if one is not None and one.kind == "temperature" and _present(table, i)]
    if temperatures and "temperature" not in columns:
        found.columns["temperature"] = temperatures[:1]
        one = found.names[temperatures[0]]
        if one is not None and one.unit:
            found.units["temperature"] = one.unit


def file_kind(stem: str) -> str | None:
    """The sensor named in a file name, or None."""
    low = re.sub(r"([a-z])([A-Z])", r"\1_\2", stem).lower()
    found = [kind for kind, pattern in _FILES.items() if re.search(rf"(?<![a-z])(?:{pattern})|(?:{pattern})", low)]
    if found and found[0] in ("linear", "gravity", "attitude"):
        return found[0]
    return found[0] if len(found) == 1 else None


def _by_file(table, columns: Columns, found: Selection) -> None:
    """Assign columns that are called x, y, z to the sensor in the file name."""
    if found.profile or set(found.columns) & set(SENSORS) or any(sensor in columns for sensor in SENSORS):
        return
    kind = file_kind(table.stem)
    axes = _bare_axes(table, found)
    if len(axes) != 3 or kind is None:
        return
    if kind == "linear":
        found.gravity_free = axes
    if kind in SENSORS:
        found.columns[kind] = axes
        inside = bracketed(table.names[axes[0]])
        unit = unit_of(inside, kind) if inside else None
        if unit:
            found.units[kind] = unit
        found.why[kind] = "by the file's name"


def _bare_axes(table, found: Selection) -> list[int]:
    """Columns that are called x, y, z, alone or with the same words in all three names."""
    groups: dict[str, dict[str, int]] = {}
    for i, name in enumerate(table.names):
        bare = re.sub(r"[\[(].*?[\])]|(?:(?<=^[xyzXYZ])|^)(?:axis|raw|value)[ _]?", "", name.lower())
        match = re.search(r"(?<![a-z0-9])([xyz])(?![a-z0-9])", bare)
        if match and (found.names[i] is None or len(bare) == 1) and _present(table, i):
            groups.setdefault(bare[: match.start()] + "?" + bare[match.end() :], {}).setdefault(match[1], i)
    whole = [[axes[axis] for axis in AXES] for axes in groups.values() if len(axes) == 3]
    return whole[0] if len(whole) == 1 else []


def _refuse_or_position(table, columns: Columns, found: Selection) -> None:
    names, count = table.names, len(table.columns)
    if found.gravity_free:
        said = (
            "{names} hold acceleration from which gravity was removed (linear or free acceleration), which is no specific force, and no "
            "other sensor is in the table; to read these values all the same: {option.columns:accel={a}:{b}} {option.units:accel=m/s^2}"
        )
        shown, (a, b) = ", ".join(names[i] for i in found.gravity_free[:3]), (found.gravity_free[0], found.gravity_free[-1])
        raise DataError(Message(said, names=shown, a=a, b=b), code="gravity_free")
    if any(names) and not all(name.isdecimal() for name in names if name):
        refuse_mixed(table, {"accel": _bare_axes(table, found)})
        other = [is_other(name) or (one is not None and one.kind in OTHERS) for name, one in zip(names, found.names, strict=True)]
        left = [
            i for i, name in enumerate(names) if not other[i] and is_number(table, i) and found.names[i] is None and not is_counter(name)
        ]
        if len(left) < 3 and any(other):
            held = f"the columns {listing(names, count)} hold attitudes, places, speeds or states of a filter"
            raise DataError(f"{held}; no inertial sensor is among them: log its readings themselves", code="no_sensor")
        raise _unclear(f"the columns {listing(names, count)} do not say which sensor they hold")
    _by_position(table, columns, found)


def _unclear(why: Any, code: str = "columns_unclear") -> DataError:
    """Error for columns that do not show which sensor they hold."""
    return DataError(joined_messages([why, HOW]), code)


def _by_position(table, columns: Columns, found: Selection) -> None:
    count = len(table.columns)
    numeric = [i for i in range(count) if is_number(table, i)]
    time = found.columns.get("time")
    stamps = [i for i in range(count) if table.columns[i].dtype.kind == "M" or i in table.clocks]
    if time is None and "time" not in columns and not stamps:
        rising = [i for i in numeric if increasing(table.columns[i])]
        counters = [i for i in rising if np.mean(np.diff(table.columns[i]) == 1) > 0.95] if len(rising) > 1 else []
        time = [i for i in rising if i not in counters][:1] or None
        numeric = [i for i in numeric if i not in counters]
    left = [i for i in numeric if i not in (time or [])]
    if len(left) not in (3, 6, 9):
        # leave out constant columns, such as the number of a person or a sensor
        left = [i for i in left if np.ptp(table.columns[i]) > 0] if len(table.columns[0]) > 10 else left
    refuse_mixed(table, {"accel": left[-3:]})
    label = _label(table)
    if label and len(left) == 3:
        found.columns |= {label: left} | ({"time": time} if time else {})
        found.why[label] = "by the word that stands in every row"
        return
    if len(left) not in (3, 6, 9):
        rises = f" (column {time[0]} rises, as time does)" if time else ""
        raise _unclear(f"{listing(table.names, count)}{rises}: 3, 6 or 9 columns besides time can be told apart, not {len(left)}")
    triples = [left[i : i + 3] for i in range(0, len(left), 3)]
    apart = [triple for triple in triples if triple[2] - triple[0] != 2]
    if apart:
        shown = ", ".join(map(str, apart[0]))
        raise _unclear(f"{listing(table.names, count)}: columns {shown} do not stand side by side as axes do")
    flat = [[np.ptp(table.columns[i]) == 0 for i in triple] for triple in triples]
    if any(map(any, flat)) and not all(map(any, flat)) and len(table.columns[0]) > 100:
        at = next(triple[one.index(True)] for triple, one in zip(triples, flat, strict=True) if any(one))
        raise _unclear(f"{listing(table.names, count)}: column {at} never changes, as no axis of a sensor does")
    kind = file_kind(table.stem) if len(triples) == 1 else None
    try:
        if kind in SENSORS:
            roles = [kind]
        else:
            roles = _guess.roles([np.column_stack([table.columns[i] for i in triple]).astype(np.float64) for triple in triples])
            which = ", ".join(f"{role} is {triple[0]}-{triple[-1]}" for role, triple in zip(roles, triples, strict=True))
            found.findings.append(READ("roles", which=which))
    except DataError as error:
        raise _unclear(error, error.code) from None
    found.columns |= ({"time": time} if time else {}) | dict(zip(roles, triples, strict=True))


def _label(table) -> str | None:
    """The sensor named by a word in every row, or None; rows of several sensors are refused."""
    for i, column in enumerate(table.columns):
        if column.dtype.kind != "O":
            continue
        words = {str(value).strip() for value in column if value is not None}
        kinds = {file_kind(word) for word in list(words)[:50]}
        if len(words) == 1 and kinds & set(SENSORS):
            return kinds.pop()
        if 1 < len(words) < 50 and kinds & set(SENSORS):
            words = ", ".join(sorted(words)[:6])
            raise DataError(f"column {i} names the sensor of each row ({words}); split the file by it and read the parts", code="mixed")
    return None


def increasing(values: np.ndarray) -> bool:
    """Whether a column increases like time: nearly all steps are positive."""
    if values.dtype.kind not in "iuf":
        return False
    steps = np.diff(values)
    return bool(len(steps) and np.count_nonzero(np.greater(steps, steps.dtype.type(0))) >= 0.95 * len(steps))


def _tell_unused(table, found: Selection) -> None:
    """Report columns that look like those of a sensor but are not read."""
    used = {i for indices in found.columns.values() for i in indices}
    strange = [
        i for i, name in enumerate(table.names)
        if i not in used and found.names[i] is None and _LIKE.search(name) and not (_NOT_LIKE.search(name) or is_counter(name))
        and _present(table, i) and not _CLOCKS.search(name)
    ]  # fmt: skip
    shown = ", ".join(f"{i} ({table.names[i]})" for i in strange[:9]) + (" ..." if len(strange) > 9 else "")
    if strange and not set(found.columns) & set(SENSORS):
        raise _unclear(f"the columns {shown} look like those of a sensor, but which axis of which is not understood")
    if strange:
        found.findings.append(READ("strange", columns=shown))
    if found.gravity_free and "accel" not in found.columns:
        found.findings.append(READ("gravity_free", "accel", columns=", ".join(table.names[i] for i in found.gravity_free[:3])))
