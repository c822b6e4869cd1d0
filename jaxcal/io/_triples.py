"""Columns that may be the three axes of one sensor, and the odds of each sensor by name, unit in brackets, file name and values."""

import dataclasses
import itertools
import re
from typing import Any

import numpy as np

from ..evidence._values import SAMPLE
from . import _guess
from ._columns import SENSORS
from ._evidence import all_integer, counts_hint, field_size, median_norm, spread
from ._names import AXES, CHANGING, Name, bracketed, described, foreign, is_other, kind_of, placed, unit_in, words_of

#: words for the axes x, y and z, and whether only rates are called so
_WORDS = (
    (AXES, False), (("roll", "pitch", "yaw"), True), (("r", "p", "y"), True), (("p", "q", "r"), True), (("beta", "gamma", "alpha"), True),
    (("1", "2", "3"), False), (("0", "1", "2"), False), (("surge", "sway", "heave"), False),
)  # fmt: skip
#: decimal logarithms of the odds that a piece of evidence gives one sensor against the others, the margin by which the best must lead,
#: and by how much another set of columns may stay behind the best to be named beside it.
#: Of 1,003 headers after public habits, at rest and turned by hand, none is silently wrong with these (benchmarks/columns.py)
ODDS = {"device": 12.0, "name": 6.0, "part of the name": 5.0, "unit": 4.0, "file": 4.0, "values": 2.0, "letter": 0.9, "margin": 1.0,
        "several": 3.0, "nearly": 0.2}  # fmt: skip
_FILES = {
    "linear": r"linear|useracc|free_?acc|without_?g|ohne_?g",
    "gravity": r"gravity",
    "attitude": r"orientation|attitude|euler|quat",
    "gyro": r"gyro|gyr(?![a-z])|angular_?vel|rotation_?rate|drehrate",
    "accel": r"acc(?![a-z])|accel|beschleunigung|specific_?force",
    "mag": r"mag(?![a-z])|magn|compass",
}


@dataclasses.dataclass
class Triple:
    """Three columns in the order x, y, z: what their names say, odds by sensor ("other" for none), and unit by sensor."""

    columns: list[int]
    name: Name | None = None
    odds: dict[str, float] = dataclasses.field(default_factory=dict)
    units: dict[str, str] = dataclasses.field(default_factory=dict)
    why: dict[str, str] = dataclasses.field(default_factory=dict)
    increments: bool = False  # whether the columns hold increments over a sampling period

    @property
    def kind(self) -> str:
        """The sensor with the best odds; "" if a second one is nearly as good."""
        first, second = sorted(self.odds, key=self.odds.__getitem__, reverse=True)[:2]
        return first if self.odds[first] >= self.odds[second] + ODDS["margin"] else ""

    @property
    def likely(self) -> str:
        """The sensor with the best odds."""
        return max((sensor for sensor in SENSORS if sensor in self.odds), key=self.odds.__getitem__)


def file_kind(stem: str) -> str | None:
    """The sensor named in a file name, or None."""
    low = re.sub(r"([a-z])([A-Z])", r"\1_\2", stem).lower()
    found = [kind for kind, pattern in _FILES.items() if re.search(rf"(?<![a-z])(?:{pattern})|(?:{pattern})", low)]
    return found[0] if len(found) == 1 or not {*found[:1]} <= {*SENSORS} else None


def triples_of(table: Any, names: list[str], known: dict[int, Name], wanted: str | None) -> list[Triple]:
    """Sets of three columns whose names differ only in the word for the axis, with the odds of each sensor."""
    groups: dict[tuple[Any, ...], dict[str, int]] = {}
    for i, name in enumerate(names):
        if not name or table.columns[i].dtype.kind not in "iufb" or i in table.clocks:
            continue
        if one := known.get(i):
            if one.axis:
                groups.setdefault((one.kind, one.stem), {}).setdefault(one.axis, i)
            continue
        for words, turning in _WORDS:
            split = words_of(re.sub("(roll|pitch|yaw)", r" \1 ", name, flags=re.IGNORECASE) if turning else name)
            for axis, rest in placed(split, words):
                # field1, field2, field3 are any fields of a record
                if words == AXES or not (set(rest) & set(AXES) or rest == ["field"]):
                    key = (words, turning, *rest)
                    # x, y, z, x, y, z are two sets
                    at = next(k for k in itertools.count() if groups.get((k, *key), {}).get(axis, i) == i)
                    groups.setdefault((at, *key), {})[axis] = i
    whole = {key: [axes[axis] for axis in AXES] for key, axes in groups.items() if len(axes) == 3}
    kin, found = _kin(table, {key: columns for key, columns in whole.items() if columns[0] not in known}), list[Triple]()
    for key, columns in whole.items():
        found.append(Triple(columns))
        _weigh(found[-1], table, names, known.get(columns[0]), key[1:], kin.get(key), wanted)
    # a column belongs to the set of which its name says most
    found.sort(key=lambda one: -max(one.odds.values()))
    taken: set[int] = set()
    kept = [one for one in found if not taken & set(one.columns) and not taken.update(one.columns)]
    return sorted(kept, key=lambda one: one.columns)


def _kin(table: Any, whole: dict[tuple[Any, ...], list[int]]) -> dict[tuple[Any, ...], Name]:
    """What the words say in which names differ that are alike otherwise, such as a and g in Xax and Xgx.

    Of such names, those of the accelerometer show gravity, and no others; names of biases, of errors and of two places do not.
    """
    families: dict[tuple[Any, ...], dict[tuple[Any, ...], Name]] = {}
    for key in whole:
        words = key[3:]
        for i, cut in ((i, cut) for i, word in enumerate(words) for cut in range(len(word)) if kind_of(word[cut:]) in SENSORS):
            said = described([words[i][cut:], *words[i + 1 :]])
            alike = (*words[:i], words[i][:cut], *(() if said and said.unit else words[i + 1 :]))
            if said and not any(len(one) > 1 and one in CHANGING for one in alike):
                families.setdefault((*key[:3], *alike), {})[key] = said
    kin: dict[tuple[Any, ...], Name] = {}
    for family in families.values():
        heavy = [_heavy(_readings(table, whole[key]), one.kind != "accel") > 0.0 for key, one in family.items()]
        if heavy == [one.kind == "accel" for one in family.values()] and len({one.kind for one in family.values()}) > 1:
            kin |= family
    return kin


def _weigh(
    one: Triple, table: Any, names: list[str], meaning: Name | None, key: tuple[Any, ...], kin: Name | None, wanted: str | None
) -> None:  # fmt: skip
    """Set the odds of each sensor, and of none, for three columns; `kin` is what their names say beside those of their kind."""
    one.odds = dict.fromkeys((*SENSORS, "linear", "other"), 0.0)
    inside = next(filter(None, (bracketed(names[i]) for i in one.columns)), None)  # often only the last axis has the unit
    if meaning is not None:
        kind, says, unit = meaning.kind, "device", meaning.unit
        one.name = meaning
    else:
        axes, turning, *words = key
        words = ["rate" if turning and word in ("speed", "vel", "velocity", "dot") else word for word in words]
        said = described(["rate", *words] if axes == ("p", "q", "r") else words)
        said = said if said and (said.sure or axes != ("p", "q", "r")) else None  # p_value is no rate
        if kin and not (said and said.sure and said.kind == kin.kind):
            said = dataclasses.replace(kin, sure=False)
        kind, unit = (said.kind, said.unit) if said else ("", None)
        inside = inside or (joined if not said and len(joined := "".join(words)) > 1 else None)  # x_nT
        says = "name" if said and said.sure else "part of the name"
        # G(x) is the acceleration of an app, and gx the rate of a sketch
        at_end = kind == "gyro" and not kin and words[-1:] == ["g"]
        vague = at_end and (len(words) == 1 or _heavy(_readings(table, one.columns), True) > 0.0)
        one.increments = kind in ("d gyro", "d accel")
        if one.increments:
            kind, says, inside = kind[2:], "part of the name", "m/s^2" if inside == "m/s" else inside
        if (turning and kind != "gyro") or _fourth(names[one.columns[0]], names):
            kind, says = "other", "name"
        elif said and not vague:
            one.name = Name(kind, "x", unit)
        elif is_other(names[one.columns[0]]):
            kind, says = "other", "name"
        one.odds["accel"] += vague * ODDS["part of the name"]
        letter = kind_of(words[-1][-1]) if not said and words and f"{words[-1]}x" in names[one.columns[0]].lower() else ""
        if letter in ("gyro", "mag"):  # an accelerometer shows gravity
            one.odds[letter] += ODDS["letter"]
    sensor = {"accel or linear": "accel", "": "other"}.get(kind, kind if kind in one.odds else "other")
    one.odds[sensor] += ODDS[says] if kind else 0.0
    if says == "name" and sensor in ("linear", "other"):
        return
    if foreign(inside):
        one.odds["other"] += ODDS["unit"]
    units = {kind: found for kind in SENSORS if (found := unit if unit and kind == sensor else unit_in(inside, kind))}
    one.units = units if inside not in ("g", "mg") or sensor == "mag" else {k: u for k, u in units.items() if k != "mag"}
    for kind in SENSORS:
        one.odds[kind] += ODDS["unit"] * ((kind in one.units) - (bool(one.units) and kind not in one.units)) if inside or unit else 0.0
    weigh_values(one, table, wanted)


def _fourth(name: str, names: list[str]) -> bool:
    """Whether a name with w in the place of x is there too, as in a quaternion."""
    low = name.lower()
    return any(low[: x.start()] + "w" + low[x.end() :] in map(str.lower, names) for x in re.finditer("x", low))


def weigh_values(one: Triple, table: Any, wanted: str | None, *, nameless: bool = False) -> None:
    """Add the odds by the name of the file, by the sensor that the command needs, and by the values."""
    values = _readings(table, one.columns)
    if len(values) > 1 and (values[[0, -1]] == values[0]).all() and (values == values[0]).all():
        return  # a fact about the recording, which stands in every row
    said = {"by the file's name": file_kind(table.stem), "by the word that stands in every row": table.word, "as the command needs": wanted}
    for why, kind in said.items():
        if kind is not None:
            one.odds[kind if kind in one.odds else "other"] += ODDS["file"]
            one.why[kind] = why
    steady = spread(values)
    # the length of a rate changes more than that of gravity or a field
    sure = ODDS["values"] + 0.5 * min(2.0, -np.log10(max(steady, 1e-9)))
    radius, how = field_size(values)
    may = not all_integer(values) if nameless else how == "sphere radius"
    field = steady < 0.9 and may and bool(_guess.fitting("mag", radius))
    heavy = _heavy(values, one.odds["gyro"] > one.odds["accel"])
    one.odds["accel"] += heavy * sure
    one.odds["mag"] += field * (sure if how == "sphere radius" else 1.0)
    # without names, what is like neither gravity nor a field is a rate
    one.odds["gyro"] += nameless * (not (heavy or field or all_integer(values))) * ODDS["values"]


def _readings(table: Any, columns: list[int]) -> np.ndarray:
    """Some rows of three columns."""
    step = max(1, len(table.columns[0]) // SAMPLE)
    return np.column_stack([np.asarray(table.columns[i][::step], np.float64) for i in columns])


def _heavy(values: np.ndarray, rate: bool) -> float:
    """Whether the length of values is that of gravity: 1, or `nearly`; that of what is called a rate must be steady and right."""
    if _guess.directions(values) or not spread(values) < (0.1 if rate else 0.5):
        return 0.0
    fits, norm = bool(counts_hint("accel", values)), median_norm(values)
    return 1.0 if fits or _guess.fitting("accel", norm) else ODDS["nearly"] * (not rate and bool(_guess.fitting("accel", norm, 1)))
