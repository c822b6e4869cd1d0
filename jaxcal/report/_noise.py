"""The noise of the channels: curves, and what the terms mean."""

from typing import Any

from .._answer._curves import by_sensor
from .._log import Log
from .._units import noise_units
from ..noise import NoiseFits
from ..noise._sections import name_of
from ..plot._style import duration_label
from ._curves import channels_of, figures as curves
from ._html import Markup, join, tag

SUBJECT, PART = "Noise", "noise"
_MEANING = {
    "Q": "Rounding of the readings: an error of the integrated signal that does not grow; the deviation falls as 1/τ.",
    "N": "White noise of the readings: the integrated signal wanders with the square root of time; the deviation falls as 1/√τ and is N "
    "at 1 s. It is two-sided: a data sheet that gives a one-sided noise density gives √2 N.",
    "B": "Slow wander of the bias (flicker): the floor of the curve, at 0.664 B. Averaging for longer does not make the bias better known.",
    "K": "Random walk of the bias itself: the deviation rises as √τ. It is what a filter needs as bias random walk; B is not.",
    "R": "Steady drift of the readings: the deviation rises as τ. Temperature is the usual cause.",
}
_OWN = "A term of your own: the coefficient multiplies the root of the density that its class gives."


def lead(fits: NoiseFits) -> str:
    """Number of channels, length and rate."""
    first = next(iter(fits.values()))
    return f"{channels_of(fits)}, {duration_label(first.duration)} at {first.deviation.rate:.6g} Hz"


def figures(fits: NoiseFits, log: Log | None) -> tuple[list[Markup], list[Markup]]:
    """The curves of every sensor."""
    return curves(fits, log)


def known(fits: NoiseFits) -> dict[str, str]:
    """The method, for the provenance."""
    first = next(iter(fits.values()))
    return {"Method": f"{first.method}, terms {' '.join(first.terms)}, {100 * first.confidence:g} % intervals"}


def meaning(fits: NoiseFits) -> list[tuple[str, Any]]:
    """Explanations of the fitted terms."""
    sensors, items = [sensor for sensor, _, _ in by_sensor(fits)], []
    for term in dict.fromkeys(term for fit in fits.values() for term in fit.terms):
        names = dict.fromkeys(name_of(term, sensor) for sensor in sensors)
        units = ", ".join(dict.fromkeys(noise_units(term, sensor)[-1] for sensor in sensors))
        text = join((_MEANING.get(term, _OWN), tag("span", f" SI unit: {units}.", class_="small")))
        items.append((f"{term}: {' / '.join(names)}", text))
    return items
