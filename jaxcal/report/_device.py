"""Figures of a device calibrated from one recording: attitude, place and residuals along it."""

from typing import Any

import numpy as np

from .._units import shown_in
from ..device import DeviceFit
from ._charts import Chart, Curve, charts
from ._explore import short
from ._html import MOST, Markup, data, evenly, section, tag

SUBJECT = "Calibration"
_MEANING = (
    ("Frame", "The axes are those of the accelerometer: its x axis, and its y axis in their plane. The matrices of gyroscope and "
     "magnetometer contain their rotation to these axes."),
    ("Open", "The motion does not determine this parameter."),
    ("Delay", "How much later than the accelerometer a sensor reports; negative where it is earlier."),
    ("Residual", "The difference between what a sensor read and what the calibrated device would have read on the way that fits all "
     "sensors best. Noise scatters about zero with the same width everywhere. A stretch that leaves zero was disturbed, or the model "
     "is too simple there."),
)  # fmt: skip


def lead(found: DeviceFit) -> str:
    """Length and rate of the recording."""
    return f"{found.duration:.4g} s at {found.rate:.6g} Hz"


def meaning(_: DeviceFit) -> tuple[tuple[str, str], ...]:
    """Terms of the page."""
    return _MEANING


def known(found: DeviceFit) -> dict[str, str]:
    """Facts for the provenance."""
    return {"Gravity": f"{found.gravity:.6g} m/s²"}


def figures(found: DeviceFit, _: Any) -> tuple[list[Markup], list[Markup]]:
    """The residuals along the recording, and the attitude."""
    return [charts([one]) for one in _residuals(found)], [section("Motion", "motion", *_way(found), *_stretches_of(found))]


def _unit_of_field(found: DeviceFit) -> tuple[str, float]:
    """Name and size of the unit in which fields are shown."""
    return shown_in(found.estimate.quantity("field"))


def _stretches(found: DeviceFit, values: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Combine the windows to groups, half of `MOST`: times, means, lowest and highest values; NaN for a group without values."""
    time, values = np.asarray(found.time)[:-1], np.asarray(values, dtype=float)
    starts = np.arange(0, len(values), max(-(-2 * len(values) // MOST), 1))
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


def _way(found: DeviceFit) -> list[Markup]:
    """The axes of the device in the world along the recording, for the script that replays them; and a chart of the place."""
    shown, marks = evenly(len(found.time), MOST), _edges(found)
    frames = [short(row, 3) for row in np.asarray(found.attitude)[shown].reshape(-1, 9)]
    replay = tag("div", data({"time": short(found.time[shown]), "frames": frames}), tag("div", class_="static"), class_="sphere replay")
    place = (np.asarray(found.place) - np.mean(found.place, axis=0))[shown]
    about = "From its mean, as far as the accelerometer and the bound on the place show it"
    about += ". Dashed: where a disturbed stretch begins or ends." if marks else "."
    curves = [Curve(name, "line", found.time[shown], place[:, i], color=i) for i, name in enumerate(("north", "west", "up"))]
    return [replay, charts([Chart("device-place", "Place", about, "Time (s)", "Place", (("m", 1.0), ("cm", 0.01)), curves, marks)])]


def _edges(found: DeviceFit) -> list[float]:
    """Times at which disturbed intervals begin and end, s."""
    return sorted({float(edge) for start, stop, *_ in found.disturbed for edge in (start, stop)})


def _residuals(found: DeviceFit) -> list[Chart]:
    """Charts of the residuals of each sensor in every window."""
    step, marks = float(np.median(np.diff(found.time))), _edges(found)
    unit, size = _unit_of_field(found)
    percent = float(found.model.field) / 100
    said = f"For each window of {step:.2g} s"
    note = "; dashed: ends of disturbed stretches." if marks else "."
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


def _stretches_of(found: DeviceFit) -> list[Markup]:
    """Sentences that list the rests and the disturbed intervals."""
    parts = []
    for what, spans in (("Rests", found.rests), ("Disturbed stretches, which count less or not at all", found.disturbed)):
        if spans:
            parts.append(tag("p", f"{what}: ", ", ".join(f"{start:.1f} to {stop:.1f} s" for start, stop in spans), "."))
    return parts
