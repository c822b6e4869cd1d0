"""Deviations and spectra of the channels: curves to explore."""

from typing import Any

from .._answer._curves import by_sensor
from .._log import Log
from ..allan import Deviation, Deviations
from ..plot._allan import KINDS
from ..spectrum import Spectra
from ._explore import explorer
from ._html import Markup, section

Curves = Deviations | Spectra
_DEVIATION = (
    "Deviation",
    "How much means over the cluster time τ differ from one to the next. On logarithmic axes white noise falls as 1/√τ, flicker is level, "
    "and a random walk rises as √τ. Neighbouring values share most of their data.",
)
_DENSITY = (
    "Density",
    "Variance per Hz. White noise is level; flicker falls as 1/f, a random walk as 1/f². Each value is a mean over neighbouring "
    "ordinates, with a chi-square interval.",
)


def subject(found: Curves) -> str:
    """Name of the statistic."""
    first = next(iter(found.values()))
    return KINDS.get(first.kind, first.kind) if isinstance(first, Deviation) else "Spectrum"


def lead(found: Curves) -> str:
    """Number of channels, and rate."""
    return f"{channels_of(found)} at {next(iter(found.values())).rate:.6g} Hz"


def channels_of(found: Any) -> str:
    """The number of channels in words."""
    return f"{len(found)} channel{'s' * (len(found) != 1)}"


def figures(found: Any, log: Log | None) -> tuple[list[Markup], list[Markup]]:
    """The deviation of every sensor, or its spectrum, and the curves to explore."""
    groups = [(sensor, {name: found[name] for name in names}) for sensor, _, names in by_sensor(found)]
    pairs = [explorer(sensor, channels, log) for sensor, channels in groups]
    return [first for first, _ in pairs], [section("Curves", "plots", *(views for _, views in pairs))]


def known(found: Curves) -> dict[str, str]:
    """The method, for the provenance."""
    first: Any = next(iter(found.values()))
    kind = first.kind if isinstance(first, Deviation) else f"{first.method}, {'one' if first.sided == 1 else 'two'}-sided"
    return {"Method": f"{kind}, {100 * first.confidence:g} % intervals"}


def meaning(found: Curves) -> list[tuple[str, str]]:
    """What the curves show."""
    return [_DEVIATION if isinstance(found, Deviations) else _DENSITY]
