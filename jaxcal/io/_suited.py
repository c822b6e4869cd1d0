"""Which commands suit a log: the refusal of one that does not, and all of them in their order, with the line to type.

All judgements stand on the means and the scatter over each second, in which noise and vibration average out and a rotation does not.
"""

import dataclasses
import shlex
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._arrays import longest_run
from .._errors import DataError
from .._log import Log
from .._message import Message
from .._types import AnyArray
from .._units import BEYOND, ON_EARTH, STANDARD_GRAVITY
from ..evidence._findings import said_of
from ..evidence._rests import still_intervals
from ._columns import SENSORS
from ._evidence import median_norm

#: motion: gravity or the field turns by this from second to second, or the gyroscope states as much
_TURN = np.radians(5.0)
_SIGMAS = 6.0  # the change must also exceed the noise of a mean by this factor
_SHARE = 0.02  # share of the seconds with motion that is tolerated, such as a bump
#: share of a log set aside as movement above which the rest is no rest either: static public logs have 1.5 % at most, moving ones from 5 %
_ASIDE = 0.2
_LONG = 60.0  # s of rest, the least for a noise fit
#: scatter of the field along a direction, relative to its norm, that shows it from there
_SIDES = 0.1
_POSES, _APART = 9, np.radians(15.0)  # attitudes that determine accelerometer and gyroscope, and the angle between two of them
_SPAN = 5.0  # degC, the least span for a thermal model
_STEADY = np.radians(1.0)  # rad/s by which a table's rate changes at most from second to second


@dataclasses.dataclass(frozen=True)
class Suitability:
    """Whether a command suits the log, why, and the line to type."""

    command: str
    suits: bool
    reason: str
    line: str


class _Seconds(NamedTuple):
    """Means (count, axes) and scatter of a sensor over each second; NaN in seconds that lack samples."""

    mean: np.ndarray
    scatter: np.ndarray

    @property
    def whole(self) -> np.ndarray:
        return np.isfinite(self.scatter)


class _Motion(NamedTuple):
    """Share of the seconds with motion, the evidence, and the longest still part as (start, stop) in s, or None."""

    share: float
    shown: str
    still: tuple[float, float] | None


def unsuited(command: str, log: Log, name: str = "LOG") -> str | Message | None:
    """Sentence that says why a log does not suit a command, with the right command lines; None if it suits.

    Parameters
    ----------
    command : "noise", "temperature", "imu" or "mag".
    log : the log.
    name : name of the log in the command line, as the user gave it.
    """
    name = shlex.quote(name)
    for one in log.findings:
        if one.code == "against_values" and one.facts["right"]:
            return Message("{why}. Give {option.units:{sensor}={right}}", **{key: one.facts[key] for key in ("why", "sensor", "right")})
    if command in ("noise", "temperature"):
        found = _motion(log)
        if found is not None and found.share > _SHARE:
            return _moving(command, found, name)
        aside = sum(one.facts["percent"] for one in log.findings if one.code == "set_aside") / 100
        if aside > _ASIDE:
            return _moving(command, _Motion(aside, "its readings vary", None if found is None else found.still), name)
    said = ""
    if command == "imu" and log.accel is not None and log.accel.shape[1] == 3 and (found := _motion(log)) and found.share == 0.0:
        said = f"the sensor rests in one attitude all the time; a calibration needs {_POSES}: hold it on faces and edges in turn"
    if command == "mag" and (sides := _sides(log.mag)) is not None and sides.max() < _SIDES:
        said = "the field comes from one side all the time, and a calibration needs it from all: turn the sensor through all attitudes"
    return f"{said}. For the noise of this log: jaxcal noise {name}" if said else None


def _moving(command: str, found: _Motion, name: str) -> str:
    text = f"the sensor moves in {100 * found.share:.0f} % of the log ({found.shown}), and jaxcal {command} needs a sensor at rest"
    if found.still is not None:
        start, stop = found.still
        return f"{text}. It is still from {start:.6g} s to {stop:.6g} s: jaxcal {command} {name} --start {start:.6g} --stop {stop:.6g}"
    return f"{text}. jaxcal info {name} says which commands suit this log: jaxcal imu for poses held by hand, jaxcal mag for a tumble"


def ranked(log: Log, name: str) -> tuple[Suitability, ...]:
    """Every command for a log called `name`, those that suit first, and of these the one that uses most of the log."""
    quoted = shlex.quote(name)
    found = [Suitability(f"jaxcal {what}", suits, why, f"jaxcal {what} {quoted}{more}") for what, suits, why, more in _judged(log)]
    return tuple(sorted(found, key=lambda one: not one.suits))


def _judged(log: Log) -> Iterator[tuple[str, bool, str, str]]:
    """Command, whether it suits, why, and further options; in the order of rank."""
    accel, gyro = (None if one is None or one.shape[1] != 3 else _seconds(one, log.rate) for one in (log.accel, log.gyro))
    names = [sensor for sensor in SENSORS if getattr(log, sensor) is not None]
    sides, poses, moved = _sides(log.mag), _attitudes(log), _motion(log)
    turned = sides is not None and bool(sides.min() > _SIDES)
    aside = sum(one.facts["percent"] for one in said_of(log.evidence, len(log.time), log.rate)) / 100
    still = None if moved is None else 1.0 - max(moved.share, aside)
    rests = "whether it rests is not known" if still is None else f"{100 * still:.0f} % of it is at rest"
    turns = moved is not None and moved.share > _SHARE
    enough = not turns and aside <= _ASIDE
    at_rest = bool(names) and log.duration >= _LONG and enough
    long = f"{log.duration:.5g} s of {', '.join(names) or 'no sensor'}, and {rests}" + f"; it needs {_LONG:g} s at rest" * (not at_rest)
    part = "" if at_rest or moved is None or moved.still is None else " --start {:.6g} --stop {:.6g}".format(*moved.still)

    reason = "all three sensors, turned by hand" if turned else "the sensor is not turned to all sides"
    whole = {name: (values := getattr(log, name)) is not None and values.shape[1] == 3 for name in SENSORS}
    three = all(whole.values())
    yield "device", three and turned and not at_rest, reason if three else "it needs accelerometer, gyroscope and magnetometer", ""
    found = f"{poses} attitude{'s' * (poses != 1)} at rest; it needs {_POSES}"
    yield "imu", poses >= _POSES, found if whole["accel"] else "it needs an accelerometer of three axes", ""
    yield "mag", turned, "no magnetometer" if log.mag is None else f"the field is seen from {'all' if turned else 'few'} sides", ""
    span = 0.0 if log.temperature is None else float(np.nanmax(log.temperature) - np.nanmin(log.temperature))
    warm = f"the temperature moves by {span:.3g} degC; it needs {_SPAN:g} at rest" if log.temperature is not None else "no temperature"
    yield "temperature", at_rest and span >= _SPAN, warm, ""
    rates = _table_rates(gyro)
    yield "rate-table", rates, "steady turns of both signs about each axis" if rates else "no steady turns about each axis", " --rates ..."
    level = _upright(accel) and turns and gyro is not None and poses == 1 and log.duration >= 4 * _LONG
    reason = "rests in one attitude, with turns between" if level else f"it needs rests of {_LONG:g} s on a level table, at several angles"
    yield "north", level, reason, " --latitude ..."
    yield "noise", at_rest or bool(part), long, part
    for curve in ("allan", "psd"):
        yield curve, at_rest or bool(part), "the curve alone, as for noise", part
    if gyro is not None and (at_rest or part):
        yield "budget", True, "what its noise costs in heading, level and position", part
    elif gyro is not None and accel is not None:
        yield "budget calibration.json --motion", True, "what the errors of a calibrated sensor cost in this motion", ""


def _seconds(values: AnyArray, rate: float) -> _Seconds | None:
    """Means and scatter over each second; None without three whole seconds."""
    width = max(4, round(rate))
    count = len(values) // width
    blocks = np.asarray(values)[: count * width].T.reshape(values.shape[1], count, width)
    found = _Seconds(blocks.mean(axis=2).T, np.linalg.norm(blocks.std(axis=2), axis=0))
    found.mean[~found.whole] = np.nan
    return found if np.count_nonzero(found.whole) > 2 else None


def _motion(log: Log) -> _Motion | None:
    """Find motion from the means over each second; None if there are too few data."""
    parts: list[tuple[str, AnyArray | None, float]] = [("gravity", log.accel, _TURN * STANDARD_GRAVITY), ("the rate", log.gyro, _TURN)]
    if log.accel is None and log.gyro is None and log.mag is not None:
        parts = [("the field", log.mag, _TURN * median_norm(np.asarray(log.mag)))]
    moved: dict[str, np.ndarray] = {}
    steady: list[np.ndarray] = []
    for name, values, limit in parts:
        if values is None or (name == "gravity" and (values.shape[1] != 3 or not 5.0 < median_norm(np.asarray(values)) < 15.0)):
            continue
        if (found := _seconds(values, log.rate)) is None:
            continue
        limit += _SIGMAS * float(np.nanmedian(found.scatter)) / np.sqrt(max(4, round(log.rate)))
        # differences from the middle of all seconds, and from the second before; NaN compares as no motion
        moved[name] = np.linalg.norm(found.mean - np.nanmedian(found.mean, axis=0), axis=1) > limit
        steady.append(~(np.linalg.norm(np.diff(found.mean, axis=0, prepend=found.mean[:1]), axis=1) <= limit / 2))
    if not moved:
        return None
    share = float(np.mean(np.any(list(moved.values()), axis=0)))
    what = [name for name, gone in moved.items() if gone.any()]
    return _Motion(share, f"{' and '.join(what)} change{'s' * (len(what) == 1)}", _longest(~np.any(steady, axis=0), log.rate))


def _longest(still: np.ndarray, rate: float) -> tuple[float, float] | None:
    """Start and stop in s of the longest run of still seconds, without one at each end; None if it is short."""
    start, stop = longest_run(still)
    seconds = max(4, round(rate)) / rate
    first, last = start + (start > 0), stop - (stop < len(still))
    return (first * seconds, last * seconds) if (last - first) * seconds >= _LONG else None


def _attitudes(log: Log) -> int:
    """Number of attitudes at rest that are 15 degrees or more apart."""
    sensors = {name: x for name in ("accel", "gyro") if (x := getattr(log, name)) is not None and x.shape[1] == 3}
    try:
        ends = still_intervals(sensors, log.rate).ends if "accel" in sensors else ()
    except DataError:  # too short, or constant
        return 0
    found: list[np.ndarray] = []
    for start, stop in ends:
        mean = np.nanmean(sensors["accel"][start:stop], axis=0)
        direction = mean / np.linalg.norm(mean)
        if all(float(direction @ other) < np.cos(_APART) for other in found):
            found.append(direction)
    return len(found)


def _upright(accel: _Seconds | None) -> bool:
    """Whether gravity keeps its direction in the sensor all the time."""
    if accel is None:
        return False
    means = accel.mean[accel.whole]
    middle = np.median(means, axis=0)
    return bool((means @ middle > np.cos(_APART) * np.linalg.norm(means, axis=1) * np.linalg.norm(middle)).all())


def _sides(field: AnyArray | None) -> np.ndarray | None:
    """Scatter of the field along its three principal directions, relative to that of the Earth, or to its norm; None with too few data."""
    seen = np.zeros((0, 3)) if field is None or field.shape[1] != 3 else np.asarray(field)[np.isfinite(field).all(axis=1)]
    if len(seen) < 10:
        return None
    norm = float(np.median(np.linalg.norm(seen, axis=1)))
    # the norm of readings beside a magnet is not that of the field, while counts have no other size
    size = norm if norm > BEYOND["mag"] else min(norm, ON_EARTH["field"][1])
    return np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False) / np.sqrt(len(seen)) / size


def _table_rates(gyro: _Seconds | None) -> bool:
    """Whether the log has steady turns about each axis, of both signs, three seconds each."""
    if gyro is None:
        return False
    steady = np.abs(np.diff(gyro.mean, axis=0)).max(axis=1) < _STEADY
    rate = gyro.mean[1:][steady]
    return all((np.count_nonzero(side * rate[:, axis] > _TURN) >= 3) for axis in range(3) for side in (1, -1))
