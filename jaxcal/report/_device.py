"""Sections of the page of a device calibrated from one recording, and its JSON document."""

import importlib.metadata
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from .._units import STANDARD_GRAVITY
from ..device import DeviceFit
from ._charts import Chart, Curve, charts
from ._html import Markup, definitions, estimate, join, numbers, provenance, recording, scroll, section, table, tag, warnings_of

_MOST = 140  # largest number of points of a curve
_ROWS = 100  # largest number of rows of the table behind the figures
_DEGREE = np.pi / 180
_MEANING = (
    ("Frame", "The axes are those of the accelerometer: its x axis, and its y axis in their plane. The matrices of gyroscope and "
     "magnetometer contain their rotation to these axes."),
    ("Delay", "How much later than the accelerometer a sensor reports; negative where it is earlier."),
    ("Residual", "The difference between what a sensor read and what the calibrated device would have read on the way that fits all "
     "sensors best. Noise scatters about zero with the same width everywhere. A stretch that leaves zero was disturbed, or the model "
     "is too simple there."),
    ("Contribution", "The share of the rests, of the slower and of the faster half of the motion in what is known of a parameter. "
     "The shares of a parameter add up to 100 %."),
)  # fmt: skip
#: heading, names of matrix and offset, size and name of the unit in which the offset is shown
_SENSORS = (
    ("Accelerometer", "accel.matrix", "accel.bias", 1.0, "m/s²"),
    ("Gyroscope", "gyro.matrix", "gyro.bias", _DEGREE, "deg/s"),
    ("Magnetometer", "magnetometer.soft_iron", "magnetometer.hard_iron", None, ""),
)
_OTHERS = (
    ("gyro_delay", "Delay of the gyroscope", 1e-3, "ms"), ("mag_delay", "Delay of the magnetometer", 1e-3, "ms"),
    ("dip", "Dip of the field", _DEGREE, "°"),
)  # fmt: skip


def document(found: DeviceFit, log: Log | None) -> dict[str, Any]:
    """Document for JSON, schema "jaxcal.device/1"; parameters that the recording does not determine are None."""
    parameters = {
        name: None if name in found.undetermined else {"value": plain(value), "low": plain(low), "high": plain(high)}
        for name, (value, low, high) in _known(found).items()
    }
    return {
        "schema": "jaxcal.device/1", "version": importlib.metadata.version("jaxcal"), "verdict": found.verdict, "reason": found.reason,
        "verdicts": dict(found.verdicts), "warnings": [*found.warnings, *(() if log is None else log.warnings)], "parameters": parameters,
        "undetermined": list(found.undetermined), "covariance": {"parameters": list(found.names), "values": plain(found.covariance)},
        "noise": plain(found.noise), "reach": plain(found.reach), "speed": plain(found.speed), "disagreement": plain(found.disagreement),
        "disturbed": [list(one) for one in found.disturbed], "rests": [list(one) for one in found.rests],
        "contribution": plain(found.contribution), "gravity": found.gravity, "rate": found.rate, "duration": found.duration,
        "notes": [] if log is None else list(log.notes), "provenance": None if log is None else plain(log.provenance),
    }  # fmt: skip


def summary(found: DeviceFit) -> list[tuple[str, str, Any]]:
    """The sensors, the verdict, and its reason, as one row."""
    return [("Accelerometer, gyroscope and magnetometer", found.verdict, found.reason)]


def _unit_of_field(found: DeviceFit) -> tuple[float, str]:
    """Size and name of the unit in which fields are shown: uT if the readings are in teslas."""
    return (1e-6, "µT") if found.model is not None and float(found.model.field) < 1e-2 else (1.0, "of the readings")


def page(found: DeviceFit, log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject of the page, the line below its title, and its sections; of a refused one only reason and recording."""
    lead = f"{found.duration:.4g} s at {found.rate:.6g} Hz"
    badge = tag("span", found.verdict, class_="badge present" if found.verdict == "good" else "badge hint")
    verdict = tag("p", badge, " ", found.reason)
    if found.model is None:
        return "Calibration", lead, join((section("Verdict", "verdict", verdict), warnings_of(log, found.warnings), recording(log)))
    sections = [section("Verdict", "verdict", verdict, _verdicts(found), *_tables(found))]
    if found.undetermined:
        said = "The motion does not determine these parameters, and they have no value: "
        sections.append(section("Not determined", "undetermined", tag("p", said, ", ".join(found.undetermined), ".")))
    sections += [section("Attitude", "attitude", charts(_way(found)))]
    sections += [section("Residuals", "residuals", charts(_residuals(found)), _numbers(found), *_stretches_of(found))]
    sections += [_contributions(found)] if found.contribution else []
    sections += [warnings_of(log, found.warnings), recording(log), section("What it means", "meaning", definitions(_MEANING))]
    (size, unit), noise = _unit_of_field(found), found.noise
    known = {
        "Made by": f"jaxcal {version}", "Gravity": f"{found.gravity:.6g} m/s²",
        "Noise": f"accelerometer {noise['accel'] / STANDARD_GRAVITY * 1e6:.3g} µg/√Hz, gyroscope {np.rad2deg(noise['gyro']):.3g} °/s/√Hz, "
        f"magnetometer {noise['mag'] / size:.3g} {unit} a reading",
        "Place of the hand": f"{found.reach:.2g} m and {found.speed:.2g} m/s rms along each axis",
    }  # fmt: skip
    return "Calibration", lead, join((*sections, provenance(known, log)))


def _known(found: DeviceFit) -> dict[str, tuple[float, float, float]]:
    """Name of a parameter -> value and limits of its interval."""
    return {
        name: (float(value), float(low), float(high))
        for name, value, (low, high) in zip(found.names, np.asarray(found.values), np.asarray(found.interval), strict=True)
    }


def _verdicts(found: DeviceFit) -> Markup:
    """Table of the verdict on every sensor."""
    names = {"accel": "Accelerometer", "gyro": "Gyroscope", "magnetometer": "Magnetometer"}
    rows = [
        (names[sensor], tag("span", verdict, class_="badge present" if verdict == "good" else "badge hint"))
        for sensor, verdict in found.verdicts.items()
    ]
    return table(("Sensor", "Verdict"), rows)


def _cell(known: dict[str, tuple[float, float, float]], name: str, size: float = 1.0) -> Markup:
    """Cell with a value and its interval; a parameter that the model does not have is zero."""
    value, low, high = known.get(name, (0.0, 0.0, 0.0))
    return estimate(value / size, low / size, high / size)


def _tables(found: DeviceFit) -> list[Markup]:
    """Tables of matrix and offset of every sensor, and of delays and dip."""
    known, (field, unit) = _known(found), _unit_of_field(found)
    tables = []
    for name, matrix, offset, size, own in _SENSORS:
        rows = [
            (axis, *(_cell(known, f"{matrix}[{i},{j}]") for j in range(3)), _cell(known, f"{offset}[{i}]", size or field))
            for i, axis in enumerate("xyz")
        ]
        what = f"{name}: matrix, and offset ({own or unit}), with intervals of 95 %"
        tables.append(scroll(table(("", "x", "y", "z", "offset"), rows, what, "matrix"), what))
    rows = [(label, _cell(known, name, size), unit) for name, label, size, unit in _OTHERS]
    tables.append(scroll(table(("", "value", "unit"), rows, "Clocks and field, with intervals of 95 %"), "Clocks and field"))
    return tables


def _stretches(found: DeviceFit, values: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Combine the windows to at most `_MOST` groups: their times, means, lowest and highest values; NaN for a group without values."""
    time, values = np.asarray(found.time)[:-1], np.asarray(values, dtype=float)
    starts = np.arange(0, len(values), max(-(-len(values) // _MOST), 1))
    count = np.add.reduceat(np.isfinite(values).astype(float), starts)
    mean = np.add.reduceat(np.nan_to_num(values), starts) / np.where(count > 0, count, np.nan)
    middle = time[np.minimum(starts + np.diff(np.append(starts, len(values))) // 2, len(time) - 1)]
    return middle, mean, np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)


def _lines(found: DeviceFit, values: Any, names: str = "xyz", first: int = 0) -> list[Curve]:
    """A line for each column of `values`, with a band from its lowest to its highest value."""
    curves = []
    for i, name in enumerate(names):
        time, mean, low, high = _stretches(found, np.asarray(values)[:, i])
        curves.append(Curve(name, "line", time, mean, low, high, color=first + i))
    return curves


def _way(found: DeviceFit) -> list[Chart]:
    """Charts of attitude and position during the recording."""
    attitude = np.asarray(found.attitude)
    up, north = attitude[:, 2], attitude[:, 0]
    marks = _edges(found)
    note = " Dotted: where a disturbed stretch begins or ends." if marks else ""
    step = max(-(-len(found.time) // (2 * _MOST)), 1)
    place = np.asarray(found.place) - np.mean(found.place, axis=0)

    def lines(values: Any, names: Any) -> list[Curve]:
        return [Curve(name, "line", found.time[::step], values[::step, i], color=i) for i, name in enumerate(names)]

    return [
        Chart("device-up", "Direction up", f"Along the axes of the device: 1 where the axis points up, -1 where it points down.{note}",
              "Time (s)", "Component", (("", 1.0),), lines(up, "xyz"), marks),
        Chart("device-north", "Direction of magnetic north", f"Along the axes of the device.{note}", "Time (s)", "Component",
              (("", 1.0),), lines(north, "xyz"), marks),
        Chart("device-place", "Place", f"From its mean, as far as the accelerometer and the bound on the place show it.{note}", "Time (s)",
              "Place", (("m", 1.0), ("cm", 0.01)), lines(place, ("north", "west", "up")), marks),
    ]  # fmt: skip


def _edges(found: DeviceFit) -> list[float]:
    """Times at which disturbed intervals begin and end, s."""
    return sorted({float(edge) for start, stop, *_ in found.disturbed for edge in (start, stop)})


def _residuals(found: DeviceFit) -> list[Chart]:
    """Charts of the residuals of each sensor in every window."""
    step, marks = float(np.median(np.diff(found.time))), _edges(found)
    size, unit = _unit_of_field(found)
    percent = float(found.model.field) / 100  # type: ignore[union-attr]
    said = f"For each window of {step:.2g} s"
    note = "; dotted: ends of disturbed stretches." if marks else "."
    left = np.asarray(found.residual_inertial)
    return [
        Chart("device-gyro", "Gyroscope", f"{said}: difference between the turn of the gyroscope and that of the attitude{note}",
              "Time (s)", "Turn left, in its noise", (("", 1.0),), _lines(found, left[:, :3]), marks),
        Chart("device-accel", "Accelerometer", f"{said}: difference between the change of velocity that it reads and that of the way. "
              f"The hand may move, so this is small; errors of the accelerometer show in the place{note}", "Time (s)",
              "Velocity left, in its noise", (("", 1.0),), _lines(found, left[:, 3:6]), marks),
        Chart("device-mag", "Magnetometer", f"{said}: root mean square difference between the field that it reads and that of the "
              f"attitude{note}", "Time (s)", "Field left", ((unit, size), ("% of the field", percent)),
              _lines(found, found.residual_field), marks),
    ]  # fmt: skip


def _numbers(found: DeviceFit) -> Markup:
    """Table of the residuals in a subset of the windows."""
    size, unit = _unit_of_field(found)
    pick = np.unique(np.linspace(0, len(found.time) - 2, min(len(found.time) - 1, _ROWS)).astype(int))
    kinds = (("turn", ""), ("velocity", ""), ("field", f" ({unit})"))
    columns = ("time (s)", *(f"{kind} {axis}{own}" for kind, own in kinds for axis in "xyz"))
    values = np.concatenate([np.asarray(found.residual_inertial)[:, :6], np.asarray(found.residual_field) / size], axis=1)
    rows = [(f"{found.time[k]:.2f}", *(f"{value:.3g}" if np.isfinite(value) else "" for value in values[k])) for k in pick.tolist()]
    return numbers(f"Residuals of {len(pick)} of {len(found.time) - 1} windows, evenly over the recording", columns, rows)


def _stretches_of(found: DeviceFit) -> list[Markup]:
    """Sentences that list the rests and the disturbed intervals."""
    parts = []
    for what, spans in (("Rests", found.rests), ("Disturbed stretches, which count less or not at all", found.disturbed)):
        if spans:
            parts.append(tag("p", f"{what}: ", ", ".join(f"{start:.1f} to {stop:.1f} s" for start, stop in spans), "."))
    return parts


def _contributions(found: DeviceFit) -> Markup:
    """Section with the contribution of each kind of motion to the information on the parameters."""
    groups = {
        "Accelerometer, matrix": "accel.matrix", "Accelerometer, bias": "accel.bias", "Gyroscope, matrix": "gyro.matrix",
        "Gyroscope, bias": "gyro.bias", "Soft iron and rotation": "magnetometer.soft_iron", "Hard iron": "magnetometer.hard_iron",
        "Delays": "_delay",
    }  # fmt: skip
    rows = []
    for label, part in groups.items():
        at = [i for i, name in enumerate(found.names) if part in name and name not in found.undetermined]
        if at:
            rows.append((label, *(f"{100 * np.mean(np.asarray(share)[at]):.0f} %" for share in found.contribution.values())))
    return section("What each kind of motion contributed", "contribution", scroll(table(("", *found.contribution), rows), "Contributions"))
