"""The unit of a sensor: the stated unit, checked against the values; or a unit inferred from the values alone.

If the values contradict the stated unit, it is an error. A unit without evidence is a guess, and the log warns about it.
"""

import dataclasses
from typing import Any

import numpy as np

from .._answer import Finding
from .._errors import DataError
from .._message import Message, joined_messages
from .._units import STANDARD_GRAVITY, factor, find_unit, to_si
from . import _evidence
from ._findings import READ

#: sensor -> unit -> size of gravity (or of a field of 1 uT) in this unit, and the unit to suggest if the guess is wrong
_SIZES = {
    "accel": {"m/s^2": (STANDARD_GRAVITY, "g"), "g": (1.0, "m/s^2"), "mg": (1000.0, "g")},
    "mag": {"T": (1e-6, "uT"), "G": (1e-2, "uT"), "uT": (1.0, "G"), "mG": (10.0, "uT"), "nT": (1e3, "uT")},
}
#: sensor -> limits of the size for a certain unit, then for a guess; and units in which whole numbers are not counts
_RANGES = {
    "accel": ((0.88, 1.12, True, ("m/s^2", "g", "mg")), (0.7, 1.4, False, ("mg",))),
    "mag": ((22, 67, True, ("T", "G", "nT")), (15, 90, False, ())),
}
#: limits for a stated unit: median of specific force over gravity, field in uT, largest rate of common gyroscopes in deg/s, and
#: temperatures of sensors in degC
_STATED = {"accel": (0.6, 1.7), "mag": (5.0, 1000.0), "gyro": (0.0, 8000.0), "temperature": (-80.0, 200.0)}
_NOISY = 0.02  # noise of a sample in an unknown unit: common sensors have 0.03 to 0.5 deg/s, which is 0.0005 to 0.009 rad/s


class UnitDoubtError(DataError):
    """Error on the unit of a sensor: `why` it is wrong or unknown, and what to do; `right` is the unit that the values show."""

    def __init__(self, why: Any, remedy: str, code: str, right: str = "", **facts: Any):
        super().__init__(joined_messages([why, Message(remedy, **facts)]), code)
        self.why, self.right = why, right


def _contradicts(sensor: str, stated: str, where: str, but: str, unit: str) -> UnitDoubtError:
    """Error for a stated unit against which the values speak; `unit` is the one to give."""
    why, remedy = f"the unit of {sensor} is stated as {stated} ({where}), but {but}", "give the right one, {option.units:{sensor}={unit}}"
    return UnitDoubtError(why, remedy, "unit_contradicts", unit if find_unit(unit, sensor) else "", sensor=sensor, unit=unit)


def against_values(subject: str, sensor: str, unit: str | None, where: str, error: DataError) -> Finding:
    """Finding for a unit that is used although the values speak against it; its facts name the `right` one, if the values show one."""
    right = getattr(error, "right", "")
    return READ("against_values", subject, unit=unit, where=where, why=getattr(error, "why", error), sensor=sensor, right=right)


@dataclasses.dataclass(frozen=True)
class Guess:
    """A unit, the reason for it, the unit to suggest if it is wrong, and whether there is evidence besides plausibility."""

    unit: str
    reason: str
    other: str
    sure: bool = True


def fitting(sensor: str, size: float, row: int = 0) -> list[str]:
    """Units in which a size is that of gravity or of the Earth's field: for certain, or likely (`row` 1)."""
    low, high = _RANGES[sensor][row][:2]
    return [unit for unit, (one, _) in _SIZES[sensor].items() if low <= size / one <= high]


def _allowed(sensor: str, value: float) -> bool:
    """Whether a sensor can state this value."""
    return _STATED[sensor][0] <= value <= _STATED[sensor][1]


def accel_unit(values: np.ndarray, stated: str | None, where: str, period: float | None) -> Guess:
    """Unit of an accelerometer, whose values must include gravity."""
    norm, whole = _evidence.median_norm(values), values.shape[1] == 3
    seen = f"median norm {norm:.4g}"
    if whole and directions(values):
        return Guess(stated or "g", "every vector has the length 1; uncertain, normalised vectors are no specific force", "m/s^2", False)
    if stated is None:
        stays = _evidence.gravity_stays(values, period) if whole else np.nan
        if whole and stays < 0.45:
            raise _gravity_free("", seen, stays)
        return _by_size("accel", norm, seen, values)
    size = factor_of(stated, "accel")
    if not whole or size is None or not norm:
        return Guess(stated, where, stated)
    force = norm * size / STANDARD_GRAVITY
    stays = _evidence.gravity_stays(values, period)
    if _allowed("accel", force) and not stays < 0.45:
        return Guess(stated, f"{where}; {seen}", stated)
    better = [unit for unit in fitting("accel", norm) if unit != stated and stays > 0.6]
    if better:
        raise _contradicts("accel", stated, where, f"its {seen} is that of gravity in {better[0]}", better[0])
    if force < _STATED["accel"][0] or stays < 0.45:
        raise _gravity_free(stated, seen, stays)
    but = f"its {seen} would be {force:.3g} times gravity, and that in no unit: correct the file"
    raise _contradicts("accel", stated, where, but, f"{1 / norm:.4g} g")


def directions(values: np.ndarray) -> bool:
    """Whether vectors turn and all have the length 1, which noise would change: these are directions, and no measurements."""
    length = _evidence.normalised(values)
    return length is not None and abs(length - 1.0) < 1e-3 and float(np.ptp(_evidence.norms(values))) < 1e-4


def _gravity_free(stated: str, seen: str, stays: float) -> UnitDoubtError:
    left = f", of which {100 * stays:.0f} % is left after averaging" if np.isfinite(stays) else ""
    why = f"gravity is missing from accel ({f'{seen} {stated}'.strip()}{left}): this is linear acceleration, and no specific force"
    remedy = "record the accelerometer itself (with g); {option.units:accel={unit}} reads it all the same"
    return UnitDoubtError(why, remedy, "gravity_free", unit=stated or "m/s^2")


def mag_unit(values: np.ndarray, stated: str | None, where: str) -> Guess:
    """Unit of a magnetometer from the radius of a sphere fit: the Earth's field is 22 to 67 uT."""
    radius, how = _evidence.field_size(values)
    seen = f"{how} {radius:.3g}"
    if stated is None:
        norm = _evidence.median_norm(values)
        if fitting("mag", radius) or not fitting("mag", norm, 1):
            return _by_size("mag", radius, seen, values)
        # readings on a small part of a sphere fit any radius, so use the median magnitude
        return dataclasses.replace(_by_size("mag", norm, f"median norm {norm:.3g}; uncertain, the {seen}", values), sure=False)
    size = factor_of(stated, "mag")
    if size is None or values.shape[1] != 3 or not radius:
        return Guess(stated, where, stated)
    field = radius * size * 1e6
    if any(_allowed("mag", one * size * 1e6) for one in (radius, _evidence.median_norm(values))):
        return Guess(stated, f"{where}; {seen}", stated)
    better = [unit for unit in fitting("mag", radius) if unit != stated]
    advice = better[0] if better else f"{4e-5 / radius:.3g} T"
    like = f"it is that in {better[0]}" if better else "the values may be normalised, or counts"
    raise _contradicts("mag", stated, where, f"its {seen} would be {field:.3g} uT, and the Earth's field is 22 to 67 uT: {like}", advice)


def no_field(values: np.ndarray) -> str | None:
    """Sentence that says why magnetometer values are not a field (zero, or normalised directions); None if they may be one."""
    seen = _evidence.thinned(values)
    if len(seen) and not seen.any():
        return "it is zero in every sample"
    length = _evidence.normalised(values)
    if length is None:
        return None
    return None if fitting("mag", length) else f"every vector has the length {length:.6g}: it is normalised, a direction and no field"


def _by_size(sensor: str, size: float, seen: str, values: np.ndarray) -> Guess:
    whole = _evidence.all_integer(values)
    steps = (_evidence.step_unit("accel", values) if sensor == "accel" else None) or ("", "")
    for low, high, sure, no_counts in _RANGES[sensor]:
        for unit, (one, other) in _SIZES[sensor].items():
            if low <= size / one <= high and (not whole or unit in no_counts):
                if steps[0] == unit:
                    return Guess(unit, f"{seen}; {steps[1]}", other)
                sure = sure and not steps[0]
                if sensor == "accel" and unit == "mg" and sure and 961.0 < size < 998.0:
                    return Guess(unit, f"{seen}; uncertain, could be cm/s^2", "cm/s^2", False)
                # whole numbers near 1000 may be counts of 1/1024 g; a single axis does not give a magnitude
                sure = sure and not (whole and unit == "mg") and values.shape[1] == 3
                # without rotation, a magnet near a sensor in uT makes a field of this size as well
                sure = sure and not (unit == "mG" and not seen.startswith("sphere"))
                return Guess(unit, seen + ("" if sure else "; uncertain"), other, sure)
    raise undecided(sensor, seen, values, {"accel": "g", "mag": "uT"}[sensor])


def gyro_unit(values: np.ndarray, stated: str | None, where: str, turns: _evidence.Turning | None) -> Guess:
    """Unit of a gyroscope: the stated unit, checked against steps, rotations and size; else a unit inferred from these, or a guess."""
    largest = float(np.nanmax(np.abs(values)))
    steps = _evidence.step_unit("gyro", values)
    if stated is not None:
        _contradict_gyro(values, stated, where, steps, turns, largest)
        return Guess(stated, where + (f"; {steps[1]}" if steps and steps[0] == stated else ""), stated)
    if _evidence.all_integer(values):
        raise undecided("gyro", "all values are whole numbers", values, "deg/s")
    other = {"rad/s": "deg/s", "deg/s": "rad/s"}
    if not _allowed("gyro", largest):
        remedy = "give the unit, or the size of one count, as in {option.units:gyro=mdeg/s}"
        raise UnitDoubtError(f"the unit of gyro cannot be told: it reaches {largest:.4g}, too much for deg/s", remedy, "unit_unknown")
    if steps and not (turns is not None and turns.unit not in (None, steps[0]) and abs(turns.correlation) > 0.7):
        return Guess(steps[0], steps[1], other[steps[0]])
    if turns is not None and turns.unit:
        sure = bool(abs(turns.correlation) > 0.5)
        reason = f"states {abs(turns.slope) ** -1:.2g} times the turns of gravity or the field, r = {abs(turns.correlation):.2f}"
        return Guess(turns.unit, reason + ("" if sure else "; uncertain"), other[turns.unit], sure)
    # the following uses medians over about 100 parts of the record
    lengths = _evidence.norms(values)
    middle = float(np.median(lengths)) if len(lengths) else 0.0
    if largest > 35 and middle > 20 and np.ptp(np.quantile(lengths, [0.1, 0.9])) < 0.5 * middle:
        return Guess("deg/s", f"assumed: never far from {middle:.3g}, as on a turntable; mdeg/s at rest would look so too", "mdeg/s", False)
    if largest > 35:
        return Guess("deg/s", f"reaches {largest:.3g}; 35 rad/s would be 2005 deg/s", "rad/s")
    floor = _evidence.noise_floor(values)
    if floor > _NOISY:
        return Guess("deg/s", f"assumed: noise of {floor:.2g} from sample to sample where it moves least is much for rad/s", "rad/s", False)
    block = max(1, len(lengths) // 100)
    lengths = np.median(lengths[: len(lengths) // block * block].reshape(-1, block), axis=1)
    quiet, lively = np.quantile(lengths, [0.1, 0.9])
    norm = float(np.median(lengths))
    if lively > 3 * quiet or (norm > 0.35 and 0.0 < 20 * floor < lively - quiet):
        return Guess("rad/s", f"assumed, because the rate varies and is {largest:.3g} at most", "deg/s", False)
    if norm > 0.35:
        return Guess("deg/s", f"assumed: median norm {norm:.3g} at rest, much for rad/s", "rad/s", False)
    return Guess("rad/s", f"assumed: median norm {norm:.3g} at rest fits rad/s and deg/s", "deg/s", False)


def keeps_length(values: np.ndarray) -> str | None:
    """Sentence that the vectors rotate while their magnitude stays that of gravity, or None."""
    if values.shape[1] != 3:
        return None
    seen = _evidence.thinned(values)
    lengths = np.linalg.norm(seen, axis=1)
    if len(seen) < 50 or not lengths.all():
        return None
    middle = float(np.median(lengths))
    turned = float(np.linalg.norm(np.mean(seen / lengths[:, None], axis=0)))
    if fitting("accel", middle) and turned < 0.9 and float(np.std(lengths)) < 0.15 * middle:
        return f"the columns that are called those of the gyroscope turn, but keep the length {middle:.4g}, as gravity does"
    return None


def _contradict_gyro(values, stated: str, where: str, steps, turns: _evidence.Turning | None, largest: float) -> None:
    says = ""
    right = {"rad/s": "deg/s", "deg/s": "rad/s"}.get(find_unit(stated, "gyro") or "", "")
    if not right:
        return
    if steps and steps[0] == right:
        says = f"its values come in {steps[1]}, as those of common sensors do in {right}, and in steps of none in {stated}"
    elif turns is not None and turns.unit == right and abs(turns.correlation) > 0.7 and not steps:
        says = f"gravity or the field turns as it says in {right} (r = {abs(turns.correlation):.2f})"
    elif stated == "rad/s" and largest > 80:
        says, right = f"it reaches {largest:.4g}, which would be {np.degrees(largest):.4g} deg/s", "deg/s"
    elif stated == "deg/s" and not _allowed("gyro", largest):
        says, right = f"it reaches {largest:.5g} deg/s, which no common sensor does: these may be raw counts", f"{1 / 16.4:.5g} deg/s"
    if says:
        raise _contradicts("gyro", stated, where, says, right)


def temperature_unit(values: np.ndarray, stated: str | None, where: str) -> Guess:
    """Unit of a temperature: the stated unit, else degC or K, whichever is plausible for a sensor; an error if neither is."""
    median = float(np.nanmedian(values))
    low, high = _STATED["temperature"]
    if stated is not None:
        if (found := find_unit(stated, "temperature")) and not low <= float(to_si(median, found, "temperature")) <= high:
            raise _contradicts("temperature", stated, where, f"its median {median:.4g} is none that a sensor has", "...")
        return Guess(stated, where, stated)
    if low <= median <= high:
        # 75 is a common room temperature in degF, but rare for a device in degC
        sure = not 60 < median < 110
        return Guess("degC", f"median {median:.4g}" + ("" if sure else "; uncertain, could be degF"), "K" if sure else "degF", sure)
    if low + 273.15 <= median <= high + 273.15:
        return Guess("K", f"median {median:.4g}", "degC")
    raise undecided("temperature", f"median {median:.4g}", values, "0.01 degC")


def judged(name: str, values: np.ndarray, stated: str | None, where: str, period: float | None, turns: _evidence.Turning | None) -> Guess:
    """Unit of a quantity: the stated one, checked against the values, or one that these tell."""
    if name == "gyro":
        return gyro_unit(values, stated, where, turns)
    if name == "accel":
        return accel_unit(values, stated, where, period)
    return (mag_unit if name == "mag" else temperature_unit)(values, stated, where)


def turns_of(values: dict[str, np.ndarray], period: float | None) -> _evidence.Turning | None:
    """Compare the gyroscope (as rad/s) with the rotation of gravity or of the field, whichever correlates better."""
    if "gyro" not in values or not period:
        return None
    found = [_evidence.turning(values["gyro"], values[name], period) for name in ("accel", "mag") if name in values]
    return max((one for one in found if one is not None), key=lambda one: abs(one.correlation), default=None)


def factor_of(unit: str, sensor: str) -> float | None:
    """SI value of a unit; None for a unit with a number before it."""
    return factor(unit, sensor) if find_unit(unit, sensor) else None


def undecided(sensor: str, seen: str, values: np.ndarray, example: str) -> UnitDoubtError:
    """Error for values without any evidence of their unit."""
    why, remedy, unit = f"the unit of {sensor} cannot be told ({seen})", "give it with {option.units:{sensor}={unit}}", example
    if _evidence.all_integer(values):
        hint = _evidence.counts_hint(sensor, values)
        unit = hint or f"0.01 {example}"
        why += ": these look like raw counts" + (f", and their norm is that of gravity if one count is {hint}" if hint else "")
        remedy = "give the size of one, as in {option.units:{sensor}={unit}}"
    return UnitDoubtError(why, remedy, "unit_unknown", sensor=sensor, unit=unit)
