"""Which commands suit a log, the best one first, with the line to type.

All judgements stand on the means and the scatter over each second, in which noise averages out and motion does not.
"""

import dataclasses
import shlex
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from .._log import Log
from .._types import AnyArray
from ._suited import motion

_MINUTE = 60.0  # s of rest, the least for a noise fit
_RESTS = 0.98  # share of still seconds of a log that is at rest, which allows a bump
_POSES = 9  # attitudes, the least that determine accelerometer and gyroscope
_APART = np.radians(15.0)  # rad between attitudes that count as different
_SIDES = 0.1  # spread of the field in its least direction, relative to its norm, that shows it from all sides
_SPAN = 5.0  # degC, the least span for a thermal model
_TURNING = np.radians(5.0)  # rad/s: a faster second is a turn
_STEADY = np.radians(1.0)  # rad/s by which a table's rate changes at most from second to second


@dataclasses.dataclass(frozen=True)
class Suitability:
    """Whether a command suits the log, why, and the line to type."""

    command: str
    suits: bool
    reason: str
    line: str


class _Seconds(NamedTuple):
    """Means and scatter of a sensor over each second, without seconds that lack samples."""

    mean: np.ndarray
    scatter: np.ndarray


def ranked(log: Log, name: str) -> tuple[Suitability, ...]:
    """Every command for a log, those that suit first, and of these the one that uses most of the log.

    Parameters
    ----------
    log : the log.
    name : its name in the line to type.
    """
    place = shlex.quote(name)
    found = [
        Suitability(f"jaxcal {command}", suits, reason, f"jaxcal {command} {place}{more}") for command, suits, reason, more in _judged(log)
    ]
    return tuple(sorted(found, key=lambda one: not one.suits))


def _judged(log: Log) -> Iterator[tuple[str, bool, str, str]]:
    """Command, whether it suits, why, and further options; in the order of rank."""
    accel, gyro, mag = _seconds(log, "accel"), _seconds(log, "gyro"), log.mag
    names = [sensor for sensor in ("gyro", "accel", "mag") if getattr(log, sensor) is not None]
    poses, turned = _attitudes(accel, gyro), _turned(mag)
    moved = motion(log)
    still = None if moved is None else 1.0 - moved.share
    rests = "whether it rests is not known" if still is None else f"{100 * still:.0f} % of it is at rest"
    long = f"{log.duration:.4g} s of {', '.join(names) or 'no sensor'}, and {rests}"
    long += f"; it needs {_MINUTE:g} s at rest" * (log.duration < _MINUTE or (still is not None and still < _RESTS))
    at_rest = bool(names) and log.duration >= _MINUTE and (still is None or still >= _RESTS)
    part = "" if at_rest or moved is None or moved.still is None else " --start {:.6g} --stop {:.6g}".format(*moved.still)

    if accel and gyro and mag is not None:
        yield (
            "device",
            turned and not at_rest,
            "all three sensors, turned by hand" if turned else "the sensor is not turned to all sides",
            "",
        )
    else:
        yield "device", False, "it needs accelerometer, gyroscope and magnetometer", ""
    yield (
        "imu",
        poses >= _POSES,
        f"{poses} attitude{'s' * (poses != 1)} at rest; it needs {_POSES}" if accel else "it needs an accelerometer of three axes",
        "",
    )
    yield (
        "mag",
        turned,
        ("the field is seen from all sides" if turned else "the field is seen from few sides") if mag is not None else "no magnetometer",
        "",
    )
    span = 0.0 if log.temperature is None else float(np.nanmax(log.temperature) - np.nanmin(log.temperature))
    warm = f"the temperature moves by {span:.3g} degC; it needs {_SPAN:g} at rest" if log.temperature is not None else "no temperature"
    yield "temperature", at_rest and span >= _SPAN, warm, ""
    rates = _table_rates(gyro)
    yield "rate-table", rates, "steady turns of both signs about each axis" if rates else "no steady turns about each axis", " --rates ..."
    upright, moves = _upright(accel), moved is not None and moved.share > 1.0 - _RESTS
    level = upright and moves and gyro is not None and poses == 1
    yield (
        "north",
        level,
        "rests in one attitude, with turns between" if level else "it needs rests on a level table, with turns between",
        "",
    )
    yield "noise", at_rest or bool(part), long, part
    for curve in ("allan", "psd"):
        yield curve, at_rest or bool(part), "the curve alone, as for noise", part


def _seconds(log: Log, sensor: str) -> _Seconds | None:
    """Means and scatter over each second; None without three axes or two whole seconds."""
    values = getattr(log, sensor)
    width = max(4, round(log.rate))
    if values is None or values.shape[1] != 3 or len(values) < 2 * width:
        return None
    blocks = np.asarray(values)[: len(values) // width * width].reshape(-1, width, 3)
    blocks = blocks[np.isfinite(blocks).all(axis=(1, 2))]
    return _Seconds(blocks.mean(axis=1), np.linalg.norm(blocks.std(axis=1), axis=1)) if len(blocks) > 1 else None


def _attitudes(accel: _Seconds | None, gyro: _Seconds | None) -> int:
    """Number of attitudes at rest that are 15 degrees or more apart."""
    if accel is None:
        return 0
    quiet = accel.scatter < max(3.0 * float(np.quantile(accel.scatter, 0.1)), 0.05)  # 0.05 m/s^2: readings in coarse steps
    steps = np.linalg.norm(np.diff(accel.mean, axis=0), axis=1) > 0.3  # m/s^2, 2 degrees of gravity
    quiet &= ~(np.concatenate([[False], steps]) | np.concatenate([steps, [False]]))
    if gyro is not None and len(gyro.mean) == len(quiet):
        quiet &= np.linalg.norm(gyro.mean - np.median(gyro.mean, axis=0), axis=1) < _TURNING
    found: list[np.ndarray] = []
    for mean in accel.mean[quiet][:20_000]:
        direction = mean / np.linalg.norm(mean)
        if len(found) < 50 and all(float(direction @ other) < np.cos(_APART) for other in found):
            found.append(direction)
    return len(found)


def _upright(accel: _Seconds | None) -> bool:
    """Whether gravity keeps its direction in the sensor all the time."""
    if accel is None:
        return False
    middle = np.median(accel.mean, axis=0)
    along = accel.mean @ middle / (np.linalg.norm(accel.mean, axis=1) * np.linalg.norm(middle))
    return bool((along > np.cos(_APART)).all())


def _turned(field: AnyArray | None) -> bool:
    """Whether the field comes from all sides."""
    mag = np.zeros((0, 3)) if field is None or field.shape[1] != 3 else np.asarray(field)
    seen = mag[np.isfinite(mag).all(axis=1)]
    if len(seen) < 10:
        return False
    sizes = np.linalg.svd(seen - seen.mean(axis=0), compute_uv=False) / np.sqrt(len(seen))
    return bool(sizes[-1] > _SIDES * np.median(np.linalg.norm(seen, axis=1)))


def _table_rates(gyro: _Seconds | None) -> bool:
    """Whether the log has steady turns about each axis, of both signs, three seconds each."""
    if gyro is None:
        return False
    steady = np.abs(np.diff(gyro.mean, axis=0)).max(axis=1) < _STEADY
    rate = gyro.mean[1:][steady]
    return all((np.count_nonzero(side * rate[:, axis] > _TURNING) >= 3) for axis in range(3) for side in (1, -1))
