"""Where the readings of each sensor go on the grid of a log, by time stamps of their own or by those of the log."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from ._answer import Finding
from ._errors import DataError
from ._log_findings import LOG
from ._timebase import GAP, Placement, nearest, place


def stamps_of(time: Any) -> tuple[np.ndarray | None, int]:
    """Stamps in s, and the nanoseconds to add to them."""
    if time is None:
        return None, 0
    stamps = np.asarray(time)
    if stamps.ndim != 1:
        raise DataError(f"time has shape {stamps.shape}; expected (n,)", code="shape")
    if np.issubdtype(stamps.dtype, np.datetime64):
        ns = stamps.astype("datetime64[ns]")
        missing = np.isnat(ns)
        ns = ns.astype(np.int64)
        epoch = int(ns[~missing][0]) if not missing.all() else 0
        return np.where(missing, np.nan, (ns - epoch) * 1e-9), epoch
    if stamps.dtype.kind not in "iuf":
        raise DataError(f"time holds {stamps.dtype} values; expected seconds as numbers, or datetime64", code="stamps")
    return stamps.astype(np.float64, copy=False), 0


def own_stamps(own_time: Mapping[str, Any], sensors: dict[str, np.ndarray], epoch: int) -> dict[str, np.ndarray]:
    """Stamps in s of each sensor that has its own, by the clock whose zero is at `epoch` ns."""

    def wrong(why: str) -> DataError:
        return DataError(f"own_time {why}", code="own_time")

    own = {}
    for name, time in own_time.items():
        if name not in sensors:
            raise wrong(f"has stamps of {name}, and the sensors are {', '.join(sensors)}; give its readings too")
        stamps, start = stamps_of(time)
        if stamps is None or stamps.shape != sensors[name].shape[:1]:
            raise wrong(f"of {name} has shape {np.shape(time)}; expected {len(sensors[name])} stamps, one for each reading")
        own[name] = stamps + ((start - epoch) * 1e-9 if start else 0.0)
    if own and len(own) == len(sensors):
        raise wrong("has stamps of every sensor; leave out those of the sensor to which `time` belongs")
    return own


def placed_alone(name: str, stamps: np.ndarray, values: np.ndarray) -> Placement:
    """Place the stamps of a sensor that has its own."""
    try:
        return place(stamps, None, equal_rows({name: values}))
    except DataError as error:
        raise error.of(name) from error


def equal_rows(sensors: dict[str, np.ndarray]) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """A function that tells for rows i and j whether all sensors have the same values."""

    def equal(i: np.ndarray, j: np.ndarray) -> np.ndarray:
        return np.all([np.all((v[i] == v[j]) | (np.isnan(v[i]) & np.isnan(v[j])), axis=1) for v in sensors.values()], axis=0)

    return equal


def at_nearest(name: str, values: np.ndarray, own: Placement, grid: Placement, found: list[Finding]) -> tuple[np.ndarray, np.ndarray]:
    """Readings at the nearest samples of the grid, NaN elsewhere, and their `Log.offset`.

    If two readings have the same nearest sample, the later one stays.
    """
    row, later = nearest(own, grid)
    values = values if own.source is None else values[own.source]
    near = np.flatnonzero(row >= 0)
    if not len(near):
        raise DataError(f"no stamp of {name} lies within the time of the log: its stamps are those of another clock", code="other_clock")
    placed, offset = np.full((values.shape[1], grid.size), np.nan).T, np.full(grid.size, np.nan)
    placed[row[near]], offset[row[near]] = values[near], later[near]
    if lost := len(row) - len(np.unique(row[near])):
        found.append(LOG("crowded", name, count=lost, total=len(row)))
    return placed, offset


def far_apart(gone: np.ndarray, later: np.ndarray) -> np.ndarray:
    """Rows without a reading, between readings that are farther apart than usual; `later` (n,) is `Log.offset` in samples."""
    there = np.flatnonzero(~gone)
    if len(there) < 2:
        return gone
    at = np.concatenate([[0.0], there + later[there], [len(gone) - 1.0]])
    apart = np.diff(at)
    return gone & (apart > GAP * np.median(apart[1:-1]))[np.searchsorted(there, np.arange(len(gone)))]


def common_length(stamps: np.ndarray | None, sensors: dict[str, np.ndarray]) -> int:
    """Number of rows that stamps and sensors have in common."""
    if not sensors:
        raise DataError("a log needs at least one of gyro, accel, mag and temperature", code="no_sensor")
    lengths = {name: len(values) for name, values in sensors.items()} | ({} if stamps is None else {"time": len(stamps)})
    if len(set(lengths.values())) > 1:
        held = ", ".join(f"{name} has {n}" for name, n in lengths.items())
        raise DataError(f"all arrays need one row per sample, but {held}", code="lengths")
    return next(iter(lengths.values()))


def on_grid(values: np.ndarray, grid: Placement) -> np.ndarray:
    """Values at their places on a grid, NaN elsewhere."""
    if grid.source is not None:
        values = values[grid.source]
    if grid.slot is None:
        return values
    placed = np.full((values.shape[1], grid.size), np.nan).T
    placed[grid.slot] = values
    return placed
