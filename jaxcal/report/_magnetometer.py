"""Figures of a magnetometer calibration on its page."""

import inspect

import numpy as np

from .._log import Log
from ..magnetometer import MagFit
from ._html import Markup
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
    """The sphere, with the readings where they are available."""
    if found.model is None:
        return [], []
    m = None if log is None or log.mag is None else np.asarray(log.mag)[np.isfinite(log.mag).all(axis=1)]
    alone = len(inspect.signature(found.model.correct).parameters) == 1  # a user's model may need conditions
    fitted = m is not None and len(m) == len(found.residual) and alone and not found.estimate.select("currents.*").names
    return sphere(found, m if fitted else None), []
