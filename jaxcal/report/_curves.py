"""Deviations and spectra of the channels as sections of a page, and as JSON documents."""

import importlib.metadata
from typing import Any

import numpy as np

from .._log import Log
from ..allan import Deviation
from ..plot._allan import KINDS
from ..plot._style import duration_label, number_label
from ._explore import SENSOR_NAMES, explorer, first_unit, thinned
from ._html import Markup, definitions, join, numbers, provenance, recording, section, warnings_of
from ._noise import about_log, by_channel, channels_of

_ROWS = 100  # largest number of rows of a table of numbers
_MEANING = {
    Deviation: ("Deviation", "How much means over the cluster time τ differ from one to the next. On logarithmic axes white noise falls as "
     "1/√τ, flicker is level, and a random walk rises as √τ. Neighbouring values share most of their data."),
    None: ("Density", "Variance per Hz. White noise is level; flicker falls as 1/f, a random walk as 1/f². Each value is a mean over "
     "neighbouring ordinates, with a chi-square interval."),
}  # fmt: skip


def document(results: dict[str, Any], log: Log | None) -> dict[str, Any]:
    """Curves of every channel as a dictionary for JSON."""
    channels = {name: one.to_dict() for name, one in results.items()}
    what = "allan" if isinstance(next(iter(results.values())), Deviation) else "psd"
    return {"schema": f"jaxcal.{what}/1", "version": importlib.metadata.version("jaxcal"), **about_log(log), "channels": channels}


def summary(results: dict[str, Any]) -> list[tuple[str, str, Any]]:
    """Subject, verdict in one word, and the number of channels."""
    return [(_name(results), "warnings" if any(one.warnings for one in results.values()) else "ok", channels_of(results))]


def page(results: dict[str, Any], log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page."""
    first = next(iter(results.values()))
    length = "" if log is None else f", {duration_label(log.duration)}"
    lead = f"{channels_of(results)}{length} at {first.rate:.6g} Hz"
    groups: dict[str, dict[str, Any]] = {}
    for name, one in results.items():
        groups.setdefault(name.partition("_")[0], {})[name] = one
    curves = []
    for sensor, channels in groups.items():
        curves.append(explorer(sensor, channels, log))
        curves += [_numbers(name, one, sensor) for name, one in channels.items()]
    kind = first.kind if isinstance(first, Deviation) else f"{first.method}, {'one' if first.sided == 1 else 'two'}-sided"
    known = {"Made by": f"jaxcal {version}", "Method": f"{kind}, {100 * first.confidence:g} % intervals"}
    meaning = _MEANING[Deviation if isinstance(first, Deviation) else None]
    parts = [section("Curves", "plots", *curves), warnings_of(log, by_channel(results, "warnings")), recording(log)]
    return _name(results), lead, join((*parts, section("What it means", "meaning", definitions([meaning])), provenance(known, log)))


def _name(results: dict[str, Any]) -> str:
    first = next(iter(results.values()))
    return KINDS.get(first.kind, first.kind) if isinstance(first, Deviation) else "Spectrum"


def _numbers(name: str, one: Any, sensor: str) -> Markup:
    """Table of the values of a curve, or of a subset evenly spaced on a logarithmic scale."""
    scale, unit = first_unit(sensor)
    deviation = isinstance(one, Deviation)
    scale, unit = (scale, unit + " s" * one.unit_of_phase) if deviation else (scale**2, f"({unit})²/Hz")
    abscissa, values = (one.tau, one.deviation) if deviation else (one.frequency, one.density)
    level = f"{100 * one.confidence:g} %"
    columns = ("τ (s)" if deviation else "f (Hz)", f"value ({unit})", f"{level} low", f"{level} high", "degrees of freedom")
    chosen = thinned(len(abscissa), _ROWS)
    cells = [np.asarray(part)[chosen] for part in (abscissa, values / scale, one.lower / scale, one.upper / scale)]
    rows = [
        (*(number_label(float(value), 4) for value in row), number_label(float(freedom), 3))
        for *row, freedom in zip(*cells, np.asarray(one.edf)[chosen], strict=True)
    ]
    return numbers(f"Numbers of {SENSOR_NAMES.get(sensor, sensor).lower()} {name.partition('_')[2] or name}", columns, rows)
