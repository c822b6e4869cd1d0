"""A magnetometer calibration as a page, and as a JSON document."""

import importlib.metadata
from typing import Any

import numpy as np

from .._log import Log
from .._results import plain
from ..magnetometer import MagFit, heading_uncertainty
from ..plot import _magnetometer as pictures
from ._html import Markup, each, join, tag
from ._noise import recording
from ._numbers import numbers, scroll
from ._svg import inline

SCHEMA = "jaxcal.mag/1"
_ROWS = 200  # readings that the table behind the figures lists
_METHODS = {"ml": "maximum likelihood (orthogonal distance)", "consistent": "adjusted least squares"}


def mag_document(found: MagFit, log: Log | None = None) -> dict[str, Any]:
    """A magnetometer fit as a dictionary for JSON."""
    model, cover, turn = found.model, found.coverage, found.alignment
    return {
        "schema": SCHEMA,
        "version": importlib.metadata.version("jaxcal"),
        "verdict": found.verdict,
        "reason": found.reason,
        "method": found.method,
        "model": found.kind,
        "hard_iron": None if model is None else plain(model.hard_iron),
        "hard_iron_error": None if model is None else plain(found.hard_iron_error),
        "soft_iron": None if model is None else plain(model.soft_iron),
        "field": plain(found.field),
        "noise": plain(found.noise),
        "penalty": plain(found.penalty),
        "field_error": plain(found.field_error),
        "joint": found.joint,
        "heading_error": plain(found.heading_error),
        "inclination": plain(found.inclination),
        "covariance": {"parameters": list(found.names), "values": plain(found.covariance)},
        "coverage": None
        if cover is None
        else {name: plain(getattr(cover, name)) for name in ("gaps", "variance", "wobble", "occupied", "largest_gap")},
        "needed": plain(found.needed),
        "outliers": plain(found.outliers),
        "readings": len(found.residual),
        "alignment": None
        if turn is None
        else {
            "source": turn.source, "rotation": plain(turn.rotation), "angle": plain(turn.angle), "angle_error": plain(turn.angle_error),
            "dip": plain(turn.dip), "verdict": turn.verdict, "reason": turn.reason,
        },
        "warnings": [*found.warnings, *(() if log is None else log.warnings)],
        "notes": [] if log is None else list(log.notes),
        "provenance": None if log is None else plain(log.provenance),
    }  # fmt: skip


def mag_body(found: MagFit, log: Log | None) -> Markup:
    """The page between its head and its foot."""
    version = importlib.metadata.version("jaxcal")
    parts = [_verdict(found)]
    if found.model is not None:
        readings = None if log is None or log.mag is None else np.asarray(log.mag)[np.isfinite(log.mag).all(axis=1)]
        parts.append(_pictures(found, readings))
    remarks = [*found.warnings, *(() if log is None else log.warnings)]
    said = tag("ul", each("li", remarks or ["None."]))
    parts.append(tag("section", tag("h2", "Warnings", id="warnings"), said, aria_labelledby="warnings"))
    parts += [recording(log), _meaning()]
    known: dict[str, Any] = {
        "Made by": f"jaxcal {version}",
        "Method": f"{_METHODS.get(found.method, found.method)}{', penalised' if found.penalty else ''}, model {found.kind}"
        + (f", jointly with {found.alignment.source}" if found.joint else ""),
    }
    known |= {key: str(value) for key, value in plain(log.provenance if log is not None else {}).items()}
    items = [piece for key, value in known.items() for piece in (tag("dt", key), tag("dd", value))]
    parts.append(tag("section", tag("h2", "Provenance", id="provenance"), tag("dl", *items), aria_labelledby="provenance"))
    return join(parts)


def _verdict(found: MagFit) -> Markup:
    badge = tag("span", found.verdict, class_="badge present" if found.verdict == "good" else "badge hint")
    parts = [tag("h2", "Verdict", id="verdict"), tag("p", badge, " ", found.reason)]
    if found.model is not None:
        scale, unit = pictures.unit_of(found)
        model, spread = found.model, found.hard_iron_error / scale
        rows = [tag("tr", *(tag("th", text, scope="col") for text in ("", "x", "y", "z")))]
        hard = np.asarray(model.hard_iron) / scale
        cells = [f"{b:.5g} ± {s:.2g}" if np.isfinite(s) else f"{b:.5g}, open" for b, s in zip(hard, spread, strict=True)]
        rows.append(_row(f"hard iron ({unit})", cells))
        for axis, row in zip("xyz", np.asarray(model.soft_iron), strict=True):
            rows.append(_row(f"soft iron, {axis}", [f"{c:.5f}" for c in row]))
        for row in found._rows()[12:-2]:  # of a model with more fields, in the units of the readings
            rows.append(_row(row.name, [f"{row.value:.5g}", f"{row.low:.5g} to {row.high:.5g}" if row.high > row.low else "", ""]))
        parts.append(scroll(tag("table", tag("tbody", *rows)), "Calibration"))
        level, tilted = np.rad2deg(found.heading_error)
        facts = {
            "Heading error to expect (rms)": f"{level:.2g}°" + (f" at level, {tilted:.2g}° at 20° of tilt" if np.isfinite(tilted) else ""),
            "Field": f"{found.field / scale:.5g} {unit}",
            "Noise of a reading": f"{found.noise / scale:.3g} {unit} per axis",
            "Readings": f"{len(found.residual)}, {len(found.outliers)} of them outliers",
            "Coverage": f"{100 * found.coverage.occupied:.0f} % of 500 directions; gaps {found.coverage.gaps:.0f} %, variance "
            f"{found.coverage.variance:.1f} %, wobble {found.coverage.wobble:.1f} % (MotionCal's figures)",
        }
        if found.alignment is not None:
            facts["Rotation"] = f"against {found.alignment.source}: {found.alignment.reason}"
        parts.append(tag("dl", *(piece for key, value in facts.items() for piece in (tag("dt", key), tag("dd", value)))))
    return tag("section", *parts, aria_labelledby="verdict")


def _row(name: str, cells: list[str]) -> Markup:
    return tag("tr", tag("th", name, scope="row"), *(tag("td", cell) for cell in cells))


def _pictures(found: MagFit, m: np.ndarray | None) -> Markup:
    """Every figure with its numbers below it; those of the readings only where they are at hand."""
    fitted = m is not None and len(m) == len(found.residual)
    figures: list[tuple[Any, str, str, Markup]] = []
    if fitted:
        about = "Readings before and after correction on three planes and in space."
        *planes, space = pictures.sphere(m, found)
        space.figure.set_size_inches(8.0, 7.4)  # three panels of four are square,
        space.set_box_aspect(None, zoom=0.85)  # and the layout does not see the labels of the fourth
        space.zaxis.labelpad = -4
        figures.append((planes[0], "Readings", about, _readings(found, m)))
    about = "Directions of the corrected field: readings per region of equal area."
    figures.append((pictures.coverage(found), "Coverage", about, _regions(found)))
    if fitted:
        about = "Distance of each reading to the ellipsoid, by direction. Its numbers are those of the readings."
        figures.append((pictures.residual(m, found), "Residuals", about, Markup("")))
    if np.isfinite(found.covariance).all():
        figures.append(
            (pictures.heading_error(found), "Heading error", "Standard deviation of the heading against heading.", _headings(found))
        )
    parts = [
        join((tag("h3", title), tag("figure", scroll(inline(ax, f"mag-{i}", title, about), title), tag("figcaption", about)), table))
        for i, (ax, title, about, table) in enumerate(figures)
    ]
    return tag("section", tag("h2", "Pictures", id="plots"), *parts, aria_labelledby="plots")


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
    zones = (
        ("above +78.5°", 1),
        ("+42.8° to +78.5°", 15),
        ("0° to +42.8°", 34),
        ("-42.8° to 0°", 34),
        ("-78.5° to -42.8°", 15),
        ("below -78.5°", 1),
    )
    rows, first = [], 0
    for name, size in zones:
        part = counts[first : first + size]
        rows.append((name, size, int(np.sum(part > 0)), int(part.min()), int(part.max()), ", ".join(str(int(n)) for n in part)))
        first += size
    columns = ("latitude", "regions", "with readings", "fewest", "most", "readings by region, eastward from -180°")
    return numbers("Numbers of the regions", columns, rows)


def _headings(found: MagFit) -> Markup:
    degrees = np.arange(0, 360, 15)
    level = np.rad2deg(heading_uncertainty(found, np.deg2rad(degrees)))
    columns, values = ["heading (°)", "at level (°)" if found.plane is None else "in the plane (°)"], [level]
    if found.plane is None:
        columns.append("at 20° of tilt (°)")
        values.append(np.rad2deg(heading_uncertainty(found, np.deg2rad(degrees), tilt=np.deg2rad(20))))
    return numbers("Numbers of the heading error", columns, [(d, *(f"{v[i]:.3g}" for v in values)) for i, d in enumerate(degrees)])


def _meaning() -> Markup:
    items = (
        tag("dt", "Correction"), tag("dd", "true field = inverse of the soft iron matrix times (reading less hard iron)."),
        tag("dt", "Heading error"), tag("dd", "What noise and coverage leave, for readings without noise and a true vertical. A fit of "
            "norms cannot see a rotation common to all readings; unless it was aligned with another sensor, that comes on top."),
        tag("dt", "Verdict"), tag("dd", "good: below 1° rms; weak: below 5°, or with a doubt that is named; refused: not to be used."),
    )  # fmt: skip
    return tag("section", tag("h2", "What it means", id="meaning"), tag("dl", *items), aria_labelledby="meaning")
