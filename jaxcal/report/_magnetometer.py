"""Figures of a magnetometer calibration on its page."""

import inspect
from typing import Any

import numpy as np

from .._log import Log
from .._units import shown_in
from ..magnetometer import MagFit, heading_uncertainty
from ..magnetometer._iron import quantity_of
from ._html import Markup, numbers, section
from ._sphere import sphere

SUBJECT = "Magnetometer"
_ROWS = 200  # largest number of readings in the table
_METHODS = {"ml": "maximum likelihood (orthogonal distance)", "consistent": "adjusted least squares", "joint": "with other sensors"}


def lead(found: MagFit) -> str:
    """Subtitle of the page."""
    return f"{len(found.residual)} readings: {found.verdict}"


def known(found: MagFit) -> dict[str, str]:
    """Method and model, for the provenance."""
    return {"Method": f"{_METHODS.get(found.method, found.method)}, model {found.kind}"}


def meaning(found: MagFit) -> tuple[tuple[str, str], ...]:
    """Terms of the page."""
    return (
        ("Correction", "The true field is the matrix of the correction times (reading - hard iron). The soft iron is its inverse."),
        ("Heading error", "The error that noise, coverage and what the residuals follow leave, for readings without noise and a true "
         "vertical. Magnitudes cannot show a rotation common to all readings; without another sensor, that error comes on top."),
        ("Verdict", "good: below 1° rms; weak: below 5°, or where a finding says why; refused: not to be used."),
    )  # fmt: skip


def figures(found: MagFit, log: Log | None) -> list[Markup]:
    """The sphere and its numbers; the numbers of the readings only if the readings are available."""
    if found.model is None:
        return []
    m = None if log is None or log.mag is None else np.asarray(log.mag)[np.isfinite(log.mag).all(axis=1)]
    alone = len(inspect.signature(found.model.correct).parameters) == 1  # a user's model may need conditions
    fitted = m is not None and len(m) == len(found.residual) and alone and not found.estimate.select("currents.*").names
    parts = [sphere(found, m if fitted else None), *([_readings(found, m)] if fitted else []), _regions(found)]
    if np.isfinite(found.heading_error[0]):
        parts.append(_headings(found))
    return [section("Pictures", "plots", *parts)]


def _readings(found: MagFit, m: Any) -> Markup:
    unit, scale = shown_in(quantity_of(found.field))
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
    tilts = {"at level (°)": 0.0, "at 20° of tilt (°)": np.deg2rad(20)}
    values = [np.rad2deg(heading_uncertainty(found, np.deg2rad(degrees), tilt=tilt)) for tilt in tilts.values()]
    rows = [(degree, *(f"{value:.3g}" for value in line)) for degree, *line in zip(degrees, *values, strict=True)]
    return numbers("Numbers of the heading error", ("heading (°)", *tilts), rows)
