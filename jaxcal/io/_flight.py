"""What a flight log knows of its compasses: attitudes by the filter of the flight controller, place and date, and the compasses' names."""

import datetime
import os
import pathlib
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._log import Log
from .._types import AnyArray
from ._archive import unpacked
from ._find import find
from ._read import faults, named
from ._readers._dataflash import DataFlash, degrees, places_of, stamps_of
from ._readers._px4 import COMPASSES, FEW
from ._readers._ulog import ULog

#: records with the attitude: what flew the vehicle, then filters that ran beside it
_ATTITUDES = ("ATT", "XKF1", "NKF1", "EKF1", "AHR2")
_GPS = ("vehicle_gps_position", "sensor_gps")
_FIX = 3  # least fix_type (PX4) and Status (ArduPilot) of a position in three dimensions
_EPOCH = datetime.datetime(1980, 1, 6)  # of GPS weeks; its seconds are a few ahead of UTC, which no date shows
#: s and cosine of half the turn between two attitudes, beyond which none between them is known
_GAP, _APART = 1.0, float(np.cos(np.deg2rad(10.0)))


class Flight(NamedTuple):
    """Attitudes, place and date of a flight log, and its compasses.

    Attributes
    ----------
    source : topic or record of the attitudes, such as "vehicle_attitude" or "ATT".
    stamps : (n,) s since the start of the flight controller.
    quaternion : (n, 4) w, x, y, z, from body axes (forward, right, down) to north, east, down.
    place : latitude and longitude in degrees and altitude in m, the medians of GPS; None without a fix.
    date : day of the flight by GPS; None without a fix.
    compasses : label of each magnetometer, as in `jaxcal.read(path, topics=...)` -> `device` of its `Calibration`: the id by which the
        flight controller knows it, if the log has it.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.io import Flight
    >>> flight = Flight("ATT", np.arange(3.0), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)), None, None, {"MAG:0": None})
    >>> list(flight.compasses)
    ['MAG:0']
    """

    source: str
    stamps: AnyArray
    quaternion: AnyArray
    place: tuple[float, float, float] | None
    date: datetime.date | None
    compasses: dict[str, Any]

    def at(self, log: Log) -> AnyArray:
        """Attitudes (n, 4) when the magnetometer of a log took its readings; NaN where those around are a second or 20 degrees apart."""
        time = self.stamps - log.provenance["epoch_ns"] * 1e-9
        when = log.time + np.nan_to_num(log.offset.get("mag", np.zeros(len(log.time))))
        before = np.clip(np.searchsorted(time, when, side="right") - 1, 0, len(time) - 2)
        first, second = self.quaternion[before], self.quaternion[before + 1]
        cosine = np.sum(first * second, axis=1)
        step = time[before + 1] - time[before]
        share = ((when - time[before]) / step)[:, None]
        # a chord instead of the arc: with 20 degrees between the attitudes, it is off by 0.02 degrees at most
        found = (1 - share) * first + share * np.copysign(1.0, cosine)[:, None] * second
        known = (np.abs(cosine) > _APART) & (step <= _GAP) & (when >= time[0]) & (when <= time[-1])
        return np.where(known[:, None], found / np.linalg.norm(found, axis=1, keepdims=True), np.nan)


def flight(path: str | os.PathLike[str]) -> Flight:
    """Read attitudes, place and date of a flight log: PX4 ULog (`vehicle_attitude`) or ArduPilot DataFlash (`ATT`, `XKF1`, `AHR2`).

    Parameters
    ----------
    path : the log, or a zip file with it.

    Returns
    -------
    Flight

    Raises
    ------
    DataError
        Code "no_attitude" if the file is no flight log, or holds no attitudes.

    Examples
    --------
    >>> import jaxcal
    >>> flight = jaxcal.io.flight("flight.bin")  # doctest: +SKIP
    >>> log = jaxcal.read("flight.bin", topics=list(flight.compasses)[0])  # doctest: +SKIP
    >>> aid = jaxcal.magnetometer.Attitude(flight.at(log))  # doctest: +SKIP
    >>> jaxcal.magnetometer.fit(log.mag, aid=aid).headline  # doctest: +SKIP

    References
    ----------
    https://docs.px4.io/main/en/msg_docs/VehicleAttitude.html; https://ardupilot.org/plane/docs/logmessages.html
    """
    path = pathlib.Path(path)
    with named(path), faults("a flight log"):
        kind, sources = find(path)
        if kind == "zip":
            with unpacked(path) as folder:
                return flight(folder)
        if kind not in ("ulog", "dataflash"):
            raise DataError("it is no log of a flight controller (ULog or DataFlash), and holds no attitudes", code="no_attitude")
        found = _of_px4(sources[0]) if kind == "ulog" else _of_ardupilot(sources[0])
        # damage and repeated stamps would spoil the interpolation
        good = np.isfinite(found.quaternion).all(axis=1) & (np.abs(np.linalg.norm(found.quaternion, axis=1) - 1) < 1e-2)
        good[good] = np.diff(np.maximum.accumulate(found.stamps[good]), prepend=-1.0) > 0
        if good.sum() < 2:
            what = "vehicle_attitude" if kind == "ulog" else f"any of {', '.join(_ATTITUDES)}"
            raise DataError(f"it has no attitudes: no rows of {what}", code="no_attitude")
    return found._replace(stamps=found.stamps[good], quaternion=found.quaternion[good])


def _of_px4(path: pathlib.Path) -> Flight:
    log = ULog(path, frozenset(("vehicle_attitude", *_GPS, *COMPASSES)))
    rows = {topic.label: log.rows(topic, list(topic.fields)) for topic in log.topics if topic.name not in COMPASSES}
    attitude: Any = rows.get("vehicle_attitude:0", {})
    if not {"timestamp", "q"} <= set(attitude):
        attitude = {"timestamp": np.zeros(0), "q": np.zeros((0, 4))}
    stamps = attitude.get("timestamp_sample", attitude["timestamp"])
    stamps = stamps if np.any(stamps) else attitude["timestamp"]
    place = date = None
    for label in (f"{name}:0" for name in _GPS):
        gps: Any = rows.get(label, {})
        new = "latitude_deg" in gps  # firmware 1.15 and later
        names = ("latitude_deg", "longitude_deg", "altitude_msl_m") if new else ("lat", "lon", "alt")
        if place is None and {"fix_type", "time_utc_usec", *names} <= set(gps):
            fixed = (gps["fix_type"] >= _FIX) & (gps["time_utc_usec"] > 0)
            place = _median([gps[name][fixed] * (1 if new else scale) for name, scale in zip(names, (1e-7, 1e-7, 1e-3), strict=True)])
            date = datetime.datetime.fromtimestamp(gps["time_utc_usec"][fixed][0] * 1e-6, datetime.UTC).date() if place else None
    count = {name: max((len(topic.offsets) for topic in log.topics if topic.name == name), default=0) for name in COMPASSES}
    chosen = next(name for name in COMPASSES if count[name] >= FEW * max(count.values()))
    found = {topic.label: log.rows(topic, ["device_id"]).get("device_id", []) for topic in log.topics if topic.name == chosen}
    known = {label: _device("px4", "mag_id", one[0] if len(one) else 0) for label, one in found.items()}
    return Flight("vehicle_attitude", stamps * 1e-6, np.asarray(attitude["q"], float), place, date, known)


def _of_ardupilot(path: pathlib.Path) -> Flight:
    log = DataFlash(path)
    source = next((name for name in _ATTITUDES if log.holds(name, "Roll", "Pitch", "Yaw")), "")
    stamps, quaternion = np.zeros(0), np.zeros((0, 4))
    if source:
        rows = log.rows(source)
        rows = rows[rows["C"] == rows["C"].min()] if "C" in log.formats[source].letters else rows  # of the first core
        angles = np.stack([degrees(log, source, rows, name) for name in ("Yaw", "Pitch", "Roll")], axis=1)
        stamps = stamps_of(rows, source) * 1e-9
        quaternion = scipy.spatial.transform.Rotation.from_euler("ZYX", angles, degrees=True).as_quat(scalar_first=True)
    place = date = None
    fields = set(log.formats["GPS"].letters) if log.holds("GPS", "Lat", "Lng", "Alt", "Status") else set()
    week, ms = ("GWk", "GMS") if "GWk" in fields else ("Week", "TimeMS")
    if {week, ms} <= fields:
        rows = log.rows("GPS")
        fixed = rows[(rows["Status"] >= _FIX) & (rows[week] > 0)]
        place = _median([degrees(log, "GPS", fixed, name) for name in ("Lat", "Lng", "Alt")])
        date = (_EPOCH + datetime.timedelta(weeks=int(fixed[week][0]), milliseconds=int(fixed[ms][0]))).date() if place else None
    rows = log.rows("PARM") if log.holds("PARM", "Name", "Value") else np.zeros(0, [("Name", "S16"), ("Value", "f4")])
    values = {bytes(name).decode("latin-1"): float(value) for name, value in zip(rows["Name"], rows["Value"], strict=True)}
    numbers = {label: int(label.partition(":")[2]) + 1 for label in places_of(log) if label.startswith("MAG")}
    ids = {label: values.get(f"COMPASS_DEV_ID{'' if i == 1 else i}", 0) for label, i in numbers.items()}
    return Flight(source, stamps, quaternion, place, date, {label: _device("ardupilot", "compass_id", one) for label, one in ids.items()})


def _device(tool: str, name: str, number: Any) -> dict[str, Any] | None:
    """`device` of a calibration, with the id of a sensor; None for the id 0, which no sensor has."""
    return {tool: {name: int(number)}} if number > 0 else None


def _median(columns: list[Any]) -> tuple[float, float, float] | None:
    """Medians of latitude, longitude and altitude, if there are any."""
    return (*(float(np.median(column)) for column in columns),) if len(columns[0]) else None  # type: ignore[return-value]
