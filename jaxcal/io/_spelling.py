"""Interpret several column names together: axes as numbers or as roll, pitch and yaw, and groups named by the column before them."""

import dataclasses
import re

import numpy as np

from ._names import AXES, Name, loosened, parse, words_of

#: words for the axes x, y and z, and whether only a gyroscope has them
_AXES = (
    (("roll", "pitch", "yaw"), True), (("r", "p", "y"), True), (("p", "q", "r"), True), (("1", "2", "3"), False), (("0", "1", "2"), False),
)  # fmt: skip
_SENSORS = ("gyro", "accel", "mag", "accel or linear")


def meanings(table, shared: str, known: dict[int, Name]) -> list[Name | None]:
    """Meaning of every name: by itself, together with its neighbours and, if no sensor is found, without unknown words."""
    names = _grouped(table)
    found = [known.get(i) or (parse(name[len(shared) :]) if name else None) for i, name in enumerate(names)]
    if known:
        return found
    for words, turning in _AXES:
        _respelt(names, found, words, turning)
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


def _respelt(names: list[str], found: list[Name | None], words: tuple[str, ...], turning: bool) -> None:
    """Read names with other words for all three axes as those with x, y and z: GyroR, roll_rate, acc_1; p, q, r alone are rates."""
    groups: dict[str, dict[str, int]] = {}
    if turning and {one.axis for one in found if one is not None and one.kind == "gyro"} == set(AXES):
        return
    for i, name in enumerate(names):
        one, parts = found[i], words_of(re.sub("(roll|pitch|yaw)", r" \1 ", name, flags=re.IGNORECASE))
        if one is not None and one.kind in _SENSORS and not (turning and one.kind == "gyro"):
            continue
        if len(parts) == 1 and parts[0][:-1] in ("gyro", "gyr", "rate", "omega"):
            parts = [parts[0][:-1], parts[0][-1]]
        parts = ["rate" if turning and part in ("speed", "vel", "velocity", "dot") else part for part in parts]
        at = [k for k, part in enumerate(parts) if part in words]
        if len(at) == 1:
            axis = AXES[words.index(parts[at[0]])]
            unit = re.search(r"\s*[\[(][^\])]*[^\])\d][^\])]*[\])]\s*$", name)
            alone = "gyro_" if words == ("p", "q", "r") and len(parts) == 1 else ""
            spelt = alone + "_".join([*parts[: at[0]], "\0", *parts[at[0] + 1 :]]) + (unit[0] if unit else "")
            groups.setdefault(spelt, {})[axis] = i
    for spelt, axes in groups.items():
        read = {axis: parse(spelt.replace("\0", axis)) for axis in AXES}
        if len(axes) == 3 and all(one is not None and one.kind in (("gyro",) if turning else _SENSORS) for one in read.values()):
            for axis, one in read.items():
                assert one is not None
                found[axes[axis]] = dataclasses.replace(one, instance=0)
