"""Interpret several column names together: axes as numbers or as roll, pitch and yaw, and groups named by the column before them."""

import dataclasses
import re

import numpy as np

from ._names import AXES, Name, loosened, parse, plain, unit_of

_ROLLS = re.compile(r"(roll|pitch|yaw)")
_RATES = (
    "rate", "rates", "speed", "vel", "velocity", "dot", "gyro", "gyr", "gyroscope", "omega", "angularvelocity", "angularrate",
    "angvel", "w",
)  # fmt: skip
_SENSORS = ("gyro", "accel", "mag", "accel or linear")


def meanings(table, shared: str, known: dict[int, Name]) -> list[Name | None]:
    """Meaning of every name: by itself, together with its neighbours and, if no sensor is found, without unknown words."""
    names = _grouped(table)
    found = [known.get(i) or (parse(name[len(shared) :]) if name else None) for i, name in enumerate(names)]
    if known:
        return found
    _rolls(names, found)
    _numbered(names, found)
    if not any(one is not None and one.kind in _SENSORS for one in found):
        for i, name in enumerate(names):
            # only names without a meaning, or with a meaning from their last word alone, are tried again
            one = found[i]
            if name and (one is None or one.kind in ("attitude", "motion")):
                found[i] = loosened(name[len(shared) :]) or found[i]
    return found


def _grouped(table) -> list[str]:
    """Complete repeated names x, y, z with the name of their group, which is that of an empty column before them."""
    low = [name.strip().lower() for name in table.names]
    if low.count("x") < 2:
        return table.names
    group, out = "", []
    for name, column in zip(table.names, table.columns, strict=True):
        if column.dtype.kind == "f" and not np.isfinite(column[:1000]).any():
            group = name
        out.append(f"{group}.{name}" if group and name.strip().lower() in ("x", "y", "z", "w") else name)
    return out


def _rolls(names: list[str], found: list[Name | None]) -> None:
    """Recognise rates about roll, pitch and yaw: GyroR, GyroP, GyroY; roll_rate, pitch_rate, yaw_rate; p, q, r."""
    low = [plain(name) for name in names]
    gyros = sum(one is not None and one.kind == "gyro" for one in found)
    for stem in ("gyro", "gyr", "rate", "omega", ""):
        for axes in (("r", "p", "y"), ("p", "q", "r")):
            wanted = [stem + axis for axis in axes]
            if (not stem and axes != ("p", "q", "r")) or not all(word in low for word in wanted):
                continue
            taken = [found[low.index(word)] for word in wanted]
            if gyros > sum(one is not None and one.kind == "gyro" for one in taken):
                continue
            for word, axis in zip(wanted, AXES, strict=True):
                found[low.index(word)] = Name("gyro", axis, None, 0, stem + "rpy")
            return
    if gyros:
        return
    rates: dict[str, dict[str, tuple[int, str | None]]] = {}
    for i, name in enumerate(names):
        word = _ROLLS.search(name.lower())
        if not word:
            continue
        bare = re.sub(r"[\[(].*", "", name.lower())
        inside = re.search(r"[\[(]([^\])]*)[\])]", name)
        rest = re.findall(r"[a-z]+|\d+", bare[: word.start()] + " " + bare[word.end() :])
        for tail in range(min(3, len(rest))):
            unit = unit_of("_".join(rest[len(rest) - tail :]), "gyro") if tail else inside and unit_of(inside[1], "gyro")
            if "".join(rest[: len(rest) - tail]) in _RATES and (unit or not tail):
                rates.setdefault("".join(rest), {})[word[1]] = i, unit or None
                break
    for stem, axes in rates.items():
        if len(axes) == 3:
            for axis, word in zip(AXES, ("roll", "pitch", "yaw"), strict=True):
                found[axes[word][0]] = Name("gyro", axis, axes[word][1], 0, stem + "rpy")
            return


def _numbered(names: list[str], found: list[Name | None]) -> None:
    """Recognise axes numbered 1, 2, 3 or 0, 1, 2: acc_1, acc_2, acc_3."""
    groups: dict[tuple[str, str], dict[int, int]] = {}
    for i, name in enumerate(names):
        match = re.fullmatch(r"([A-Za-z][A-Za-z _./:-]*[A-Za-z])[ _.-]?(\d)(\s*[\[(].*)?", name.strip())
        one = found[i]
        if match and (one is None or one.kind not in _SENSORS):
            groups.setdefault((match[1].lower(), match[3] or ""), {})[int(match[2])] = i
    for (stem, tail), places in groups.items():
        if sorted(places) not in ([0, 1, 2], [1, 2, 3]):
            continue
        read = [parse(f"{stem}_{axis}{tail}") for axis in AXES]
        if all(one is not None and one.kind in _SENSORS for one in read):
            for one, number in zip(read, sorted(places), strict=True):
                assert one is not None
                found[places[number]] = dataclasses.replace(one, instance=0)
