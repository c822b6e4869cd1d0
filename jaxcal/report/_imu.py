"""A multi-position calibration as sections of a page, and as JSON can say it."""

import importlib.metadata
import json
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from ..imu import ImuFit
from ..plot import imu
from ._html import Markup, each, join, tag
from ._noise import recording
from ._numbers import numbers, scroll
from ._svg import inline

SCHEMA = "jaxcal.imu/1"
_SENSORS = (("Accelerometer", 0, "m/s²"), ("Gyroscope", 12, "rad/s"))


def imu_document(found: ImuFit, log: Log | None = None) -> dict[str, Any]:
    """A multi-position calibration as a dictionary for JSON."""
    sensors = {}
    for sensor, first, last in (("accel", 0, 12), ("gyro", 12, 33)):
        triad = getattr(found, sensor)
        if triad is not None:
            names = [name.removeprefix(f"{sensor}.") for name in found.names[first:last]]
            limits = plain(found.interval[first:last])
            sensors[sensor] = {
                "matrix": plain(triad.matrix), "bias": plain(triad.bias), "g_sensitivity": plain(triad.g_sensitivity),
                "intervals": dict(zip(names, limits, strict=True)),
            }  # fmt: skip
    return {
        "schema": SCHEMA, "version": importlib.metadata.version("jaxcal"), "verdict": found.verdict, "reason": found.reason,
        "warnings": list(found.warnings), "convention": found.convention, "method": found.method, "gravity": found.gravity,
        "rate": found.rate, "poses": len(found.residual_norm), "turns": len(found.residual_turn), "sensors": sensors,
        "residuals": {"norm": plain(found.residual_norm), "turn": plain(found.residual_turn), "rest": plain(found.residual_rest)},
        "held_out": {"norm": plain(found.held_out[0]), "turn": plain(found.held_out[1])},
        "condition": None if found.observability is None else plain(found.observability.condition), "temperature": plain(found.temperature),
        "provenance": None if log is None else plain(log.provenance),
    }  # fmt: skip


def imu_sections(found: ImuFit, log: Log | None, version: str) -> Markup:
    """Verdict with both triads, residuals, attitudes, warnings, recording and provenance; of a refused one the reason."""
    if found.accel is None:
        return tag("section", tag("h2", "Verdict", id="verdict"), tag("p", f"{found.verdict}: {found.reason}"), aria_labelledby="verdict")
    tables = [_matrix(found, name, first, unit) for name, first, unit in _SENSORS if first == 0 or found.gyro is not None]
    if found.gyro is not None and np.any(found.gyro.g_sensitivity):
        tables.append(
            _table(
                found,
                "Gyroscope: sensitivity to specific force (readings per m/s²)",
                ("x", "y", "z"),
                lambda i: [24 + 3 * i + j for j in range(3)],
            )
        )
    head = tag(
        "section", tag("h2", "Verdict", id="verdict"), tag("p", f"{found.verdict}: {found.reason}"), *tables, aria_labelledby="verdict"
    )
    svg = inline(imu(found)[0], "imu", "Residuals", "Residuals of every pose and turn: norms, angles after turns, still rates.")
    note = "Shaded: one standard deviation. Hollow: weighed down by the robust loss."
    picture = tag("figure", scroll(svg, "Residuals"), tag("figcaption", note))
    held = f"On poses and turns that a fit of the others did not see: {found.held_out[0]:.2g} m/s² rms in the norm"
    if found.gyro is not None:
        held += f", {np.rad2deg(found.held_out[1]):.2g} degrees in each component of the angle after a turn"
    seen = found.observability.sentence if found.observability is not None else "Not looked at: too few poses."
    residuals = tag(
        "section",
        tag("h2", "Residuals", id="residuals"),
        picture,
        *_numbers(found),
        *((tag("p", f"{held}."),) if np.isfinite(found.held_out[0]) else ()),
        aria_labelledby="residuals",
    )
    attitudes = tag("section", tag("h2", "Attitudes", id="attitudes"), tag("p", seen), aria_labelledby="attitudes")
    said = [*(() if log is None else log.warnings), *found.warnings]
    warnings = tag("section", tag("h2", "Warnings", id="warnings"), tag("ul", each("li", said or ["None."])), aria_labelledby="warnings")
    return join((head, residuals, attitudes, warnings, recording(log), _provenance(found, log, version)))


def _numbers(found: ImuFit) -> list[Markup]:
    """What the points of the figure are."""
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


def _matrix(found: ImuFit, name: str, first: int, unit: str) -> Markup:
    return _table(
        found,
        f"{name}: matrix (readings per {unit}) and bias (readings)",
        ("x", "y", "z", "bias"),
        lambda i: [*(first + 3 * i + j for j in range(3)), first + 9 + i],
    )


def _table(found: ImuFit, caption: str, columns: tuple[str, ...], entries) -> Markup:
    head = tag("tr", *(tag("th", name, scope="col") for name in ("", *columns)))
    rows = [tag("tr", tag("th", axis, scope="row"), *(_cell(found, k) for k in entries(i))) for i, axis in enumerate("xyz")]
    table = tag("table", tag("caption", f"{caption}, with intervals of 95 %"), tag("thead", head), tag("tbody", *rows))
    return scroll(table, caption)


def _cell(found: ImuFit, k: int) -> Markup:
    value, (low, high) = found.values[k], found.interval[k]
    if not high > low:
        return tag("td", f"{value:.6g} ", tag("span", "(fixed)", class_="small"))
    return tag("td", f"{value:.6g} ", tag("span", f"{low:.6g} to {high:.6g}", class_="small exact"))


def _provenance(found: ImuFit, log: Log | None, version: str) -> Markup:
    known = {
        "Made by": f"jaxcal {version}",
        "Method": f"{found.method}, convention {found.convention}, gravity {found.gravity:.6g} m/s²",
    }
    if found.still is not None:
        known["Still intervals"] = f"{len(found.residual_norm)}, below {found.still.multiple:g} times the initial variance"
    for key, value in plain(log.provenance if log is not None else {}).items():
        known[key] = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    items = [piece for key, value in known.items() for piece in (tag("dt", key), tag("dd", value))]
    return tag("section", tag("h2", "Provenance", id="provenance"), tag("dl", *items), aria_labelledby="provenance")
