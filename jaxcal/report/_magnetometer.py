"""A magnetometer calibration as a page, and as a JSON document."""

import importlib.metadata
import inspect
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from ..magnetometer import MagFit, heading_uncertainty
from ..plot import _magnetometer as pictures
from ._html import Markup, definitions, join, numbers, provenance, recording, scroll, section, table, tag, warnings_of
from ._sphere import sphere

_ROWS = 200  # largest number of readings in the table
_METHODS = {"ml": "maximum likelihood (orthogonal distance)", "consistent": "adjusted least squares"}
_MEANING = (
    ("Correction", "true field = inverse of the soft iron matrix times (reading less hard iron)."),
    ("Heading error", "What noise, coverage and the causes that were found leave, for readings without noise and a true vertical. A fit of "
     "norms cannot see a rotation common to all readings; unless it was aligned with another sensor, that comes on top."),
    ("Verdict", "good: below 1° rms; weak: below 5°, or with a doubt that is named; refused: not to be used."),
)  # fmt: skip


def document(found: MagFit, log: Log | None) -> dict[str, Any]:
    """A magnetometer fit as a dictionary for JSON."""
    model, cover, turn = found.model, found.coverage, found.alignment

    def of(one: Any, *names: str) -> dict[str, Any]:
        return {name: plain(getattr(one, name, None)) for name in names}

    return {
        "schema": "jaxcal.mag/1", "version": importlib.metadata.version("jaxcal"), **of(found, "verdict", "reason", "method"),
        "model": found.kind, **of(model, "hard_iron"), "hard_iron_error": None if model is None else plain(found.hard_iron_error),
        **of(model, "soft_iron"), "soft_iron_error": None if model is None else plain(found.soft_iron_error),
        **of(found, "field", "noise", "penalty", "field_error", "joint", "heading_error", "heading_range"),
        **of(found, "inclination", "down", "causes", "blocks", "terms"),
        "check": None if found.check is None else found.check.to_dict(),
        "covariance": {"parameters": list(found.names), "values": plain(found.covariance)},
        "coverage": None if cover is None else of(cover, "gaps", "variance", "wobble", "occupied", "largest_gap"),
        **of(found, "needed", "outliers"), "readings": len(found.residual),
        "alignment": None if turn is None else of(turn, "source", "rotation", "angle", "angle_error", "dip", "verdict", "reason"),
        "warnings": [*found.warnings, *(() if log is None else log.warnings)], "notes": [] if log is None else list(log.notes),
        "provenance": None if log is None else plain(log.provenance),
    }  # fmt: skip


def summary(found: MagFit) -> list[tuple[str, str, Any]]:
    """Subject, verdict in one word, and the reason for the verdict."""
    return [("Magnetometer", found.verdict, found.reason)]


def page(found: MagFit, log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page."""
    parts = [_verdict(found)]
    if found.model is not None:
        readings = None if log is None or log.mag is None else np.asarray(log.mag)[np.isfinite(log.mag).all(axis=1)]
        parts.append(_pictures(found, readings))
    method = f"{_METHODS.get(found.method, found.method)}{', penalised' if found.penalty else ''}, model {found.kind}"
    if found.joint and found.alignment is not None:
        method += f", jointly with {found.alignment.source}"
    parts += [warnings_of(log, found.warnings), recording(log), section("What it means", "meaning", definitions(_MEANING))]
    parts.append(provenance({"Made by": f"jaxcal {version}", "Method": method}, log))
    return "Magnetometer", f"{len(found.residual)} readings: {found.verdict}", join(parts)


def _verdict(found: MagFit) -> Markup:
    badge = tag("span", found.verdict, class_="badge present" if found.verdict == "good" else "badge hint")
    parts = [tag("p", badge, " ", found.reason)]
    if found.model is not None:
        scale, unit = pictures.unit_of(found)
        model, hard = found.model, zip(np.asarray(found.model.hard_iron) / scale, found.hard_iron_error / scale, strict=True)
        rows = [(f"hard iron ({unit})", *(_with_error(*both) for both in hard))]
        for axis, *both in zip("xyz", np.asarray(model.soft_iron), found.soft_iron_error, strict=True):
            rows.append((f"soft iron, {axis}", *(_with_error(*one) for one in zip(*both, strict=True))))
        for row in found._rows()[12:-2]:  # further fields of a model, in the units of the readings
            rows.append((row.name, f"{row.value:.5g}", f"{row.low:.5g} to {row.high:.5g}" if row.high > row.low else "", ""))
        parts.append(scroll(table(("", "x", "y", "z"), rows, class_="matrix"), "Calibration"))
        level, tilted = np.rad2deg(found.heading_error)
        cover = found.coverage
        facts = {
            "Heading error to expect (rms)": f"{level:.2g}°" + (f" at level, {tilted:.2g}° at 20° of tilt" if np.isfinite(tilted) else ""),
            "Field": f"{found.field / scale:.5g} {unit}",
            "Noise of a reading": f"{found.noise / scale:.3g} {unit} per axis",
            "Readings": f"{len(found.residual)}, {len(found.outliers)} of them outliers",
            "Coverage": f"{100 * cover.occupied:.0f} % of 500 directions; gaps {cover.gaps:.0f} %, variance {cover.variance:.1f} %, "
            f"wobble {cover.wobble:.1f} % (MotionCal's figures)",
        }
        if found.alignment is not None:
            facts["Rotation"] = f"against {found.alignment.source}: {found.alignment.reason}"
        if found.check is not None:
            facts["Check"] = found.check.reason
        parts.append(definitions(facts.items()))
    return section("Verdict", "verdict", *parts)


def _with_error(value: float, error: float) -> str:
    """A value and its standard error, both to the second digit of the error."""
    if not np.isfinite(error):
        return f"{value:.5g}, open"
    if not error > 0:
        return f"{value:g} (fixed)"
    digits = max(1 - int(np.floor(np.log10(error))), 0)
    return f"{value:.{digits}f}\u00a0±\u00a0{error:.{digits}f}"


def _pictures(found: MagFit, m: np.ndarray | None) -> Markup:
    """The sphere and its numbers; the numbers of the readings only if the readings are available."""
    alone = len(inspect.signature(found.model.correct).parameters) == 1  # a user's model may need conditions  # type: ignore[union-attr]
    fitted = m is not None and len(m) == len(found.residual) and alone
    parts = [sphere(found, m if fitted else None), *([_readings(found, m)] if fitted else []), _regions(found)]
    if np.isfinite(found.covariance).all():
        parts.append(_headings(found))
    return section("Pictures", "plots", *parts)


def _readings(found: MagFit, m: Any) -> Markup:
    scale, unit = pictures.unit_of(found)
    pick = np.unique(np.linspace(0, len(m) - 1, min(len(m), _ROWS)).astype(int))
    fixed, out = np.asarray(found.model.correct(m[pick])) / scale, set(np.asarray(found.outliers).tolist())  # type: ignore[union-attr]
    off = np.asarray(found.residual) / scale
    columns = ("reading", *(f"{axis} ({unit})" for axis in "xyz"), *(f"{axis} corrected" for axis in "xyz"), "residual", "")
    rows = [
        (i + 1, *(f"{v:.4g}" for v in (*(m[i] / scale), *line)), f"{off[i]:+.2g}", "outlier" if i in out else "")
        for i, line in zip(pick.tolist(), fixed, strict=True)
    ]
    return numbers(
        f"Numbers of {len(pick)} of {len(m)} readings, evenly over the log" * (len(pick) < len(m)) or "Every reading", columns, rows
    )


def _regions(found: MagFit) -> Markup:
    counts = np.asarray(found.coverage.counts)
    sizes = {
        "above +78.5°": 1, "+42.8° to +78.5°": 15, "0° to +42.8°": 34, "-42.8° to 0°": 34, "-78.5° to -42.8°": 15, "below -78.5°": 1,
    }  # fmt: skip
    zones = zip(sizes, np.split(counts, np.cumsum(list(sizes.values()))[:-1]), strict=True)
    rows = [
        (name, len(part), int(np.sum(part > 0)), int(part.min()), int(part.max()), ", ".join(map(str, part.astype(int))))
        for name, part in zones
    ]
    columns = ("latitude", "regions", "with readings", "fewest", "most", "readings by region, eastward from -180°")
    return numbers("Numbers of the regions", columns, rows)


def _headings(found: MagFit) -> Markup:
    degrees = np.arange(0, 360, 15)
    tilts = {"at level (°)": 0.0, "at 20° of tilt (°)": np.deg2rad(20)} if found.plane is None else {"in the plane (°)": 0.0}
    values = [np.rad2deg(heading_uncertainty(found, np.deg2rad(degrees), tilt=tilt)) for tilt in tilts.values()]
    rows = [(degree, *(f"{value:.3g}" for value in line)) for degree, *line in zip(degrees, *values, strict=True)]
    return numbers("Numbers of the heading error", ("heading (°)", *tilts), rows)
