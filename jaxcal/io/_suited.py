"""Check before any statistics that a log suits a command: implausible units, motion instead of rest, rest instead of motion.

Motion is detected in means over a second, in which vibration and noise average out but a rotation of the sensor does not.
"""

import dataclasses
from typing import Any

import numpy as np

from .._arrays import longest_run
from .._log import Log
from .._message import Message
from .._units import STANDARD_GRAVITY, factor, find_unit
from ._evidence import field_size, median_norm, turning

#: change of the mean over a second that indicates motion: 5 degrees of gravity, 5 deg/s, a tenth of the field
_FORCE, _RATE, _FIELD = 0.087 * STANDARD_GRAVITY, np.deg2rad(5.0), 0.1
_SIGMAS = 6.0  # the change must also exceed the noise of a mean by this factor
_SHARE = 0.02  # share of the seconds with motion that is tolerated, such as a bump
#: share of a log set aside as movement above which the rest is no rest either: static public logs have 1.5 % at most, moving ones from 5 %
_ASIDE = 0.2
_LONG = 60.0  # s
_SEEN = 2000  # number of blocks from which the noise is estimated
#: relative variation of a field below which it comes from one direction only
_ONE_SIDE = 0.05
_UNITS = {"accel": ("m/s^2", "g", "mg"), "mag": ("uT", "nT", "mG", "G", "mT", "T")}


@dataclasses.dataclass(frozen=True)
class Motion:
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
    if wrong := wrong_units(log):
        return wrong
    if command in ("noise", "temperature"):
        found = motion(log)
        if found is not None and found.share > _SHARE:
            return _moving(command, found, name)
        aside = sum(one.facts["percent"] for one in log.findings if one.code == "set_aside") / 100
        if aside > _ASIDE:
            return _moving(command, Motion(aside, "its readings vary", None if found is None else found.still), name)
    if command == "imu" and log.accel is not None and log.accel.shape[1] == 3:
        found = motion(log)
        if found is not None and found.share == 0.0:
            return (
                f"the sensor rests in one attitude all the time, and a calibration by hand needs nine or more: hold it still on each face "
                f"and edge, and turn it in between. For the noise of this log: jaxcal noise {name}"
            )
    if command == "mag" and log.mag is not None and log.mag.shape[1] == 3:
        seen = log.mag[np.isfinite(log.mag).all(axis=1)]
        if len(seen) > 50 and np.std(seen, axis=0).max() < _ONE_SIDE * float(np.median(np.linalg.norm(seen, axis=1))):
            return (
                "the field comes from one side all the time, and a calibration needs it from all sides: turn the sensor through all "
                f"attitudes while you log. For the noise of this log: jaxcal noise {name}"
            )
    return None


def _moving(command: str, found: Motion, name: str) -> str:
    text = f"the sensor moves in {100 * found.share:.0f} % of the log ({found.shown}), and jaxcal {command} needs a sensor at rest"
    if found.still is not None:
        start, stop = found.still
        return f"{text}. It is still from {start:.6g} s to {stop:.6g} s: jaxcal {command} {name} --start {start:.6g} --stop {stop:.6g}"
    return f"{text}. jaxcal info {name} says which commands suit this log: jaxcal imu for poses held by hand, jaxcal mag for a tumble"


def wrong_units(log: Log) -> str | Message | None:
    """Sentence on a unit that contradicts gravity or the Earth's field, or None."""
    units = log.provenance.get("units", {})
    for sensor, likely, expected in (
        ("accel", (8.8, 10.8), "gravity is 9.76 to 9.84 m/s^2"),
        ("mag", (20e-6, 70e-6), "the Earth's field is 20 to 70 uT"),
    ):
        values, unit = getattr(log, sensor), find_unit(str(units.get(sensor, "")), sensor)
        if values is None or values.shape[1] != 3 or unit is None:
            continue
        size = median_norm(values) if sensor == "accel" else field_size(values)[0]
        # an uncalibrated sensor may have a large error, so tolerate a factor of two
        if not size or likely[0] / 2 < size < 2 * likely[1]:
            continue
        raw = size / factor(unit, sensor)
        better = [one for one in _UNITS[sensor] if likely[0] < raw * factor(one, sensor) < likely[1]]
        if better:
            si = {"accel": f"{size:.3g} m/s^2", "mag": f"{size * 1e6:.3g} uT"}[sensor]
            right = f"{sensor}={better[0]}"
            return f"in {unit} the {sensor} readings have a size of {si}, but {expected}: the unit is {better[0]}. Give --units {right}"
    return _wrong_rate(log)


def _wrong_rate(log: Log) -> Message | None:
    """Sentence on a gyroscope unit that contradicts the observed rotation of gravity or the field, or None."""
    unit = find_unit(str(log.provenance.get("units", {}).get("gyro", "")), "gyro")
    if log.gyro is None or unit not in ("rad/s", "deg/s"):
        return None
    for vector in (log.accel, log.mag):
        found = None if vector is None else turning(np.asarray(log.gyro), np.asarray(vector), 1.0 / log.rate)
        if found is not None and abs(found.correlation) > 0.7:
            for right, ratio in (("deg/s", np.pi / 180.0), ("rad/s", 180.0 / np.pi)):
                if right != unit and 0.5 < abs(found.slope) / ratio < 2.0:
                    return Message(
                        "in {unit} the gyroscope states {ratio:.3g} times the turns that gravity or the field make: the unit is {right}. "
                        "Give {option.units:gyro={right}}", unit=unit, ratio=1 / abs(found.slope), right=right,
                    )  # fmt: skip
    return None


def motion(log: Log) -> Motion | None:
    """Find motion from the means over each second; None if there are too few data."""
    width = max(4, round(log.rate))
    parts: list[tuple[str, Any, float]] = [("gravity", log.accel, _FORCE), ("the rate", log.gyro, _RATE)]
    if log.accel is None and log.gyro is None and log.mag is not None:
        field = np.asarray(log.mag)
        parts = [("the field", field, _FIELD * median_norm(field))]
    moved: dict[str, np.ndarray] = {}
    steady: list[np.ndarray] = []
    for name, values, limit in parts:
        if values is None or (name == "gravity" and (values.shape[1] != 3 or not 5.0 < median_norm(values) < 15.0)):
            continue
        blocks = _means(values, width, limit)
        if blocks is not None:
            moved[name], steps = blocks
            steady.append(steps)
    if not moved:
        return None
    share = float(np.mean(np.any(list(moved.values()), axis=0)))
    what = [name for name, gone in moved.items() if gone.any()]
    shown = f"{' and '.join(what)} change{'s' * (len(what) == 1)}"
    return Motion(share, shown, _longest(~np.any(steady, axis=0), width / log.rate))


def _means(values: np.ndarray, width: int, limit: float) -> tuple[np.ndarray, np.ndarray] | None:
    """For each block, whether its mean differs from the median of all means, and whether it differs from the block before."""
    count = len(values) // width
    if count < 3:
        return None
    blocks = values[: count * width].reshape(count, width, -1)
    whole = np.asarray(np.isfinite(blocks).all(axis=(1, 2)))
    if np.count_nonzero(whole) < 3:
        return None
    means = np.where(whole[:, None], blocks.mean(axis=1), np.nan)
    some = blocks[np.flatnonzero(whole)[:: 1 + count // _SEEN]]
    scatter = float(np.median(np.linalg.norm(some.std(axis=1), axis=1)))
    limit += _SIGMAS * scatter / np.sqrt(width)
    with np.errstate(invalid="ignore"):
        away = np.linalg.norm(means - np.median(means[whole], axis=0), axis=1) > limit
        steps = np.linalg.norm(np.diff(means, axis=0, prepend=means[:1]), axis=1) > limit / 2
    return away & whole, steps | ~whole


def _longest(still: np.ndarray, seconds: float) -> tuple[float, float] | None:
    """Start and stop in s of the longest run of still blocks, without one block at each end; None if it is short."""
    start, stop = longest_run(still)
    first, last = start + (start > 0), stop - (stop < len(still))
    return (first * seconds, last * seconds) if (last - first) * seconds >= _LONG else None
