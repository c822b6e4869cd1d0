"""What a log says about the values of a sensor, as findings."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from .._answer import NOTE, Finding, Quantity
from .._log_findings import LOG
from .._units import si_unit_of
from ._stretch import NOT_STILL, Stretch
from ._values import STUCK

#: stretches whose time is said, the longest of all
_NAMED = 3


def seen_in(sensor: str, names: list[str], values: np.ndarray, rate: float, unit: str, stretches: list[Stretch]) -> list[Finding]:
    """Findings about the values (n, axes) of a sensor, and about the stretches that are seen in them."""
    found, quantity = [], sensor if unit == si_unit_of(sensor) else unit
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    constant = low == high
    if sensor != "temperature" and constant.any():
        of = [name for name, same in zip(names, constant, strict=True) if same]
        found.append(LOG("constant", of, values=", ".join(f"{value:.6g}" for value in low[constant]), unit=unit))
    if stuck := [one for one in stretches if one.kind == "stuck"]:
        longest = max(stuck, key=lambda one: one.samples)
        facts = {"length": longest.stop - longest.start, "at": longest.start - 1 / rate, "samples": sum(one.samples for one in stuck)}
        of = sensor if len(longest.axes) == values.shape[1] else [names[axis] for axis in longest.axes]
        found.append(LOG("frozen", of, count=len(stuck), run=STUCK, **facts))
    for one in stretches:
        share, about = one.samples / len(values), [names[axis] for axis in one.axes]
        if one.kind == "held":
            found.append(LOG("repeats", sensor, percent=100 * share, rate=rate * (1 - share)))
        elif one.kind == "coarse":
            found.append(LOG("steps", about, step=Quantity(float(f"{one.size:.4g}"), quantity)))
        elif one.kind != "stuck":
            of = sensor if one.kind == "warm_up" else about
            size = Quantity(one.size, quantity) if one.kind in ("clipped", "warm_up", "wrapped") else one.size
            found.append(LOG(one.kind, of, count=one.samples, size=size, length=one.stop))
    return found


def said_of(stretches: Iterable[Stretch], samples: int, rate: float) -> list[Finding]:
    """A finding on what was set aside as no noise of a sensor at rest: its share, and what happened when."""
    aside = joined_times(one for one in stretches if one.kind in NOT_STILL)
    if not aside:
        return []
    seconds = sum(stop - start for start, stop in aside)
    what = f"something moved at {_times(aside, ', and {} times more')}"
    share = seconds * rate / samples
    return LOG.over("set_aside", share, seconds=seconds, percent=percent(share), what=what)


def percent(share: float) -> float:
    """A share of a log in per cent, for two digits: not all of a log that gives an answer is set aside or missing."""
    return min(100.0 * share, 99.0)


def unrest(log: Any) -> list[Finding]:
    """The finding on what was set aside, if so much was that the rest is hardly rest either: a result at rest is weak for it."""
    return [one for one in said_of(log.evidence, len(log.time), log.rate) if one.severity > NOTE]


def joined_times(stretches: Iterable[Stretch]) -> list[tuple[float, float]]:
    """Start and stop of what stretches of several sensors make together, s."""
    found: list[tuple[float, float]] = []
    for one in sorted(stretches, key=lambda one: one.start):
        if found and one.start <= found[-1][1]:
            found[-1] = found[-1][0], max(found[-1][1], one.stop)
        else:
            found.append((one.start, one.stop))
    return found


def _times(found: list[tuple[float, float]], more: str) -> str:
    """When the longest were, in the order of time, and how many more there are."""
    longest = sorted(sorted(found, key=lambda one: one[0] - one[1])[:_NAMED])
    return ", ".join(dict.fromkeys(clock(start) for start, _ in longest)) + more.format(len(found) - _NAMED) * (len(found) > _NAMED)


def timeline(stretches: Iterable[Stretch]) -> list[str]:
    """A line for each kind of stretch, the longest in all first: sensors, how long in all, and when the longest were.

    Examples
    --------
    >>> from jaxcal.evidence import Stretch
    >>> from jaxcal.evidence._findings import timeline
    >>> timeline([Stretch("knock", "gyro", (0,), 49.9, 50.7), Stretch("knock", "accel", (2,), 49.9, 51.1)])
    ['knock (gyro, accel): 1.2 s from 0:49']
    """
    kinds: dict[str, list[Stretch]] = {}
    for one in stretches:
        if one.kind not in ("coarse", "resampled"):  # these are of all the time
            kinds.setdefault(one.kind, []).append(one)
    lines = []
    for kind, found in kinds.items():
        sensors = ", ".join(dict.fromkeys(one.sensor for one in found if one.sensor))
        times = joined_times(found)
        total = sum(stop - start for start, stop in times)
        # these are scattered between start and stop
        long = f"{sum(one.samples for one in found)} readings" if kind in ("held", "zeroed", "clipped") else f"{total:.3g} s"
        lines.append((total, f"{kind.replace('_', '-')}{f' ({sensors})' * bool(sensors)}: {long} from {_times(times, ' and {} more')}"))
    return [line for _, line in sorted(lines, key=lambda one: -one[0])]


def clock(seconds: float) -> str:
    """A time from the start as m:ss or h:mm:ss.

    Examples
    --------
    >>> from jaxcal.evidence._findings import clock
    >>> clock(49.9), clock(7054.0)
    ('0:49', '1:57:34')
    """
    minutes, rest = divmod(int(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"
