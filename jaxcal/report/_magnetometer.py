"""Figures of a magnetometer calibration on its page."""

import inspect
from typing import Any

import numpy as np

from .._log import Log
from .._units import shown_in
from ..magnetometer import MagFit
from ..magnetometer._result import quantity_of
from ._html import MOST, Markup, evenly, numbers, section
from ._sphere import sphere

SUBJECT, PART = "Magnetometer", "magnetometer"
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


def figures(found: MagFit, log: Log | None) -> tuple[list[Markup], list[Markup]]:
    """The sphere and its numbers; the numbers of the readings only if the readings are available."""
    if found.model is None:
        return [], []
    m = None if log is None or log.mag is None else np.asarray(log.mag)[np.isfinite(log.mag).all(axis=1)]
    alone = len(inspect.signature(found.model.correct).parameters) == 1  # a user's model may need conditions
    fitted = m is not None and len(m) == len(found.residual) and alone and not found.estimate.select("currents.*").names
    return [sphere(found, m if fitted else None)], [section("Readings", "plots", _readings(found, m))] if fitted else []


def _readings(found: MagFit, m: Any) -> Markup:
    unit, scale = shown_in(quantity_of(found.field))
    pick = evenly(len(m), MOST)
    fixed, out = np.asarray(found.model.correct(m[pick])) / scale, set(np.asarray(found.outliers).tolist())  # type: ignore[union-attr]
    off = np.asarray(found.residual) / scale
    columns = ("reading", *(f"{axis} ({unit})" for axis in "xyz"), *(f"{axis} corrected" for axis in "xyz"), "residual", "")
    rows = [
        (i + 1, *(f"{v:.4g}" for v in (*(m[i] / scale), *line)), f"{off[i]:+.2g}", "outlier" if i in out else "")
        for i, line in zip(pick, fixed, strict=True)
    ]
    return numbers(
        f"Numbers of {len(pick)} of {len(m)} readings, evenly over the log" * (len(pick) < len(m)) or "Every reading", columns, rows
    )
