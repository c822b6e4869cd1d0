"""A multi-position calibration as sections of a page, and as a JSON document."""

import importlib.metadata
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from .._units import STANDARD_GRAVITY
from ..imu import ImuFit
from ._charts import Chart, Curve, charts
from ._html import Markup, estimate, join, numbers, provenance, recording, scroll, section, table, tag, warnings_of

_SENSORS = (("Accelerometer", 0, "m/s²"), ("Gyroscope", 12, "rad/s"))


def document(found: ImuFit, log: Log | None) -> dict[str, Any]:
    """A multi-position calibration as a dictionary for JSON."""
    sensors = {}
    for sensor, first, last in (("accel", 0, 12), ("gyro", 12, 33)):
        triad = getattr(found, sensor)
        if triad is not None:
            names = [name.removeprefix(f"{sensor}.") for name in found.names[first:last]]
            sensors[sensor] = {name: plain(getattr(triad, name)) for name in ("matrix", "bias", "g_sensitivity")}
            sensors[sensor]["intervals"] = dict(zip(names, plain(found.interval[first:last]), strict=True))
    further = {
        name: {"value": plain(float(value)), "interval": plain(interval)}
        for name, value, interval in list(zip(found.names, found.values, found.interval, strict=True))[33:]
    }
    return {
        "schema": "jaxcal.imu/1", "version": importlib.metadata.version("jaxcal"), "verdict": found.verdict, "reason": found.reason,
        "warnings": list(found.warnings), "convention": found.convention, "method": found.method, "gravity": found.gravity,
        "rate": found.rate, "poses": len(found.residual_norm), "turns": len(found.residual_turn), "sensors": sensors, "further": further,
        "residuals": {name: plain(getattr(found, f"residual_{name}")) for name in ("norm", "turn", "rest")},
        "held_out": {"norm": plain(found.held_out[0]), "turn": plain(found.held_out[1])},
        "condition": None if found.observability is None else plain(found.observability.condition), "temperature": plain(found.temperature),
        "provenance": None if log is None else plain(log.provenance),
    }  # fmt: skip


def summary(found: ImuFit) -> list[tuple[str, str, Any]]:
    """Subject, verdict in one word, and the reason for the verdict."""
    return [("Accelerometer and gyroscope" if found.gyro is not None else "Accelerometer", found.verdict, found.reason)]


def page(found: ImuFit, log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page; for a refused calibration only the reason."""
    lead = f"{len(found.residual_norm)} poses, {len(found.residual_turn)} turns at {found.rate:.6g} Hz"
    verdict = tag("p", f"{found.verdict}: {found.reason}")
    if found.accel is None:
        return "Calibration", lead, section("Verdict", "verdict", verdict)
    tables = [
        _table(found, f"{name}: matrix (readings per {unit}) and bias (readings)", ("x", "y", "z", "bias"),
               lambda i, first=first: (*range(first + 3 * i, first + 3 * i + 3), first + 9 + i))
        for name, first, unit in _SENSORS if first == 0 or found.gyro is not None
    ]  # fmt: skip
    if found.gyro is not None and np.any(found.gyro.g_sensitivity):
        caption = "Gyroscope: sensitivity to specific force (readings per m/s²)"
        tables.append(_table(found, caption, ("x", "y", "z"), lambda i: range(24 + 3 * i, 27 + 3 * i)))
    if further := found.names[33:]:
        caption = "Further terms (readings per power of SI units), with intervals of 95 %"
        rows = [(name, estimate(found.values[i], *found.interval[i])) for i, name in enumerate(further, 33)]
        tables.append(scroll(table(("", "value"), rows, caption), caption))
    figure = charts(_residuals(found))
    held = []
    if np.isfinite(found.held_out[0]):
        text = f"On poses and turns that a fit of the others did not see: {found.held_out[0]:.2g} m/s² rms in the norm"
        if found.gyro is not None:
            text += f", {np.rad2deg(found.held_out[1]):.2g} degrees in each component of the angle after a turn"
        held.append(tag("p", f"{text}."))
    seen = found.observability.sentence if found.observability is not None else "Not looked at: too few poses."
    method = f"{found.method}, convention {found.convention}, gravity {found.gravity:.6g} m/s²"
    known = {"Made by": f"jaxcal {version}", "Method": method}
    if found.still is not None:
        below = f"below {found.still.multiple:g} times the variance at rest" if np.isfinite(found.still.multiple) else "as given"
        known["Still intervals"] = f"{len(found.residual_norm)}, {below}"
    sections = [section("Verdict", "verdict", verdict, *tables), section("Residuals", "residuals", figure, *_numbers(found), *held)]
    sections += [section("Attitudes", "attitudes", tag("p", seen)), warnings_of(log, found.warnings), recording(log)]
    return "Calibration", lead, join((*sections, provenance(known, log)))


def _numbers(found: ImuFit) -> list[Markup]:
    """Tables of the numbers in the figure."""
    norm, rest = -1e3 * np.asarray(found.residual_norm), np.rad2deg(found.residual_rest) * 3600
    low, turned = (set(np.asarray(index).tolist()) for index in found.down_weighted)
    columns = ("pose", "norm less gravity (mm/s²)", *(f"still rate less model, {axis} (deg/h)" for axis in "xyz" if len(rest)), "weight")
    rows = [
        (i + 1, f"{norm[i]:.3f}", *(f"{rate:.2f}" for rate in (rest[i] if len(rest) else ())), "below a half" if i in low else "full")
        for i in range(len(norm))
    ]
    tables = [numbers("Numbers of the poses", columns, rows)]
    if found.gyro is not None:
        turns = np.rad2deg(found.residual_turn)
        rows = [(i + 1, f"{turn:.4f}", "below a half" if i in turned else "full") for i, turn in enumerate(turns)]
        tables.append(numbers("Numbers of the turns", ("turn", "angle after the turn (deg)", "weight"), rows))
    return tables


def _table(found: ImuFit, caption: str, columns: tuple[str, ...], entries: Callable[[int], Iterable[int]]) -> Markup:
    rows = [(axis, *(estimate(found.values[k], *found.interval[k]) for k in entries(i))) for i, axis in enumerate("xyz")]
    return scroll(table(("", *columns), rows, f"{caption}, with intervals of 95 %", "matrix"), caption)


def _residuals(found: ImuFit) -> list[Chart]:
    """Residuals of every pose and turn; hollow dots mark those with a reduced weight in the robust loss."""
    down = [np.asarray(which, dtype=int) for which in found.down_weighted]

    def dots(name: str, values: Any, color: int, hollow: Any = ()) -> Curve:
        return Curve(name, "dots", np.arange(1, len(values) + 1), values, color=color, hollow=hollow)

    note = "Hollow: weighed down by the robust loss."
    norm, turns = -np.asarray(found.residual_norm), np.asarray(found.residual_turn)
    shown = [
        Chart("imu-norm", "Norm of the specific force less gravity, at rest", f"One dot a pose; {found.sigma[0]:.2g} m/s² rms. {note}",
              "Pose", "Norm less gravity", (("mm/s²", 1e-3), ("mg", STANDARD_GRAVITY * 1e-3)), [dots("norm", norm, 0, down[0])])
    ]  # fmt: skip
    if found.gyro is not None and len(turns):
        shown.append(
            Chart("imu-turn", "Angle after each turn", f"Between the vertical that the gyroscope predicts and the accelerometer's. {note}",
                  "Turn", "Angle after the turn", (("deg", np.pi / 180), ("mrad", 1e-3)), [dots("angle", turns, 1, down[1])])
        )  # fmt: skip
    if found.gyro is not None and len(found.residual_rest):
        rates = np.asarray(found.residual_rest).T
        shown.append(
            Chart("imu-rest", "Still rate less the model", "One dot a pose and axis.", "Pose", "Still rate less model",
                  (("deg/h", np.pi / 180 / 3600), ("mdeg/s", np.pi / 180e3), ("rad/s", 1.0)),
                  [dots(axis, rate, i) for i, (axis, rate) in enumerate(zip("xyz", rates, strict=True))])
        )  # fmt: skip
    return shown
