"""The noise of the channels: curves, and what the terms mean."""

from collections.abc import Mapping
from typing import Any, TypeVar

from .._answer import plain
from .._errors import DataError
from .._log import Log
from .._units import noise_units
from ..noise import NoiseFits
from ..noise._sections import SENSORS, name_of
from ..plot._style import duration_label
from ._explore import explorer
from ._html import Markup, join, section, tag

F = TypeVar("F")
SUBJECT = "Noise"
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


def figures(fits: NoiseFits, log: Log | None) -> list[Markup]:
    """The curves of every sensor."""
    return [section("Curves", "plots", *(explorer(sensor, channels, log) for sensor, channels in by_sensor(fits).items()))]


def known(fits: NoiseFits) -> dict[str, str]:
    """The method, for the provenance."""
    first = next(iter(fits.values()))
    return {"Method": f"{first.method}, terms {' '.join(first.terms)}, {100 * first.confidence:g} % intervals"}


def meaning(fits: NoiseFits) -> list[tuple[str, Any]]:
    """Explanations of the fitted terms."""
    sensors, items = list(by_sensor(fits)), []
    for term in dict.fromkeys(term for fit in fits.values() for term in fit.terms):
        names = dict.fromkeys(name_of(term, sensor) for sensor in sensors)
        units = ", ".join(dict.fromkeys(noise_units(term, sensor)[-1] for sensor in sensors))
        text = join((_MEANING.get(term, _OWN), tag("span", f" SI unit: {units}.", class_="small")))
        items.append((f"{term}: {' / '.join(names)}", text))
    return items


def sensor_of(channel: str) -> str:
    """Sensor of a channel: gyro_x -> gyro."""
    sensor = channel.partition("_")[0]
    if sensor not in SENSORS:
        raise DataError(f"channel {channel!r} has no known sensor; expected names such as gyro_x, accel_y, mag_z")
    return sensor


def number(value: Any) -> float | None:
    """Convert a number for JSON: None if it is infinite or unknown."""
    return plain(float(value))


def channels_of(results: Mapping[str, Any]) -> str:
    """The number of channels in words."""
    return f"{len(results)} channel{'s' * (len(results) != 1)}"


def by_sensor(results: Mapping[str, F]) -> dict[str, dict[str, F]]:
    """Group results by sensor, in their original order."""
    groups: dict[str, dict[str, F]] = {}
    for name, fit in results.items():
        groups.setdefault(sensor_of(name), {})[name] = fit
    return groups


def by_channel(results: dict[str, Any], field: str) -> list[str]:
    """List each sentence of a field once, with the channels to which it applies."""
    channels: dict[str, list[str]] = {}
    for channel, fit in results.items():
        for sentence in getattr(fit, field):
            channels.setdefault(str(sentence), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in channels.items()]
