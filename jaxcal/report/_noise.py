"""The noise of the channels as sections of a page, and as a JSON document."""

import importlib.metadata
import math
from typing import Any, TypeVar

import numpy as np

from .._errors import DataError
from .._log import Log
from .._results import plain
from .._units import noise_units
from ..noise import NoiseFit
from ..plot._style import SENSORS, display_unit, duration_label, interval_labels, number_label
from ._explore import explorer
from ._html import Markup, definitions, each, join, numbers, provenance, recording, scroll, section, table, tag, warnings_of

F = TypeVar("F")
_MOST = 300  # largest number of rows of a table of numbers
_NAMES = {
    ("Q", "gyro"): "quantisation noise", ("N", "gyro"): "angle random walk", ("B", "gyro"): "bias instability",
    ("K", "gyro"): "rate random walk", ("R", "gyro"): "rate ramp",
    ("Q", "accel"): "quantisation noise", ("N", "accel"): "velocity random walk", ("B", "accel"): "bias instability",
    ("K", "accel"): "acceleration random walk", ("R", "accel"): "acceleration ramp",
    ("Q", "mag"): "quantisation noise", ("N", "mag"): "white noise", ("B", "mag"): "bias instability",
    ("K", "mag"): "random walk", ("R", "mag"): "ramp",
}  # fmt: skip
_MEANING = {
    "Q": "Rounding of the readings: an error of the integrated signal that does not grow; the deviation falls as 1/τ.",
    "N": "White noise of the readings: the integrated signal wanders with the square root of time; the deviation falls as 1/√τ and is N "
    "at 1 s. It is two-sided: a data sheet that gives a one-sided noise density gives √2 N.",
    "B": "Slow wander of the bias (flicker): the floor of the curve, at 0.664 B. Averaging for longer does not make the bias better known.",
    "K": "Random walk of the bias itself: the deviation rises as √τ. It is what a filter needs as bias random walk; B is not.",
    "R": "Steady drift of the readings: the deviation rises as τ. Temperature is the usual cause.",
}
_OWN = "A term of your own: the coefficient multiplies the root of the density that its class gives."


def _name(term: str, sensor: str) -> str:
    return _NAMES.get((term, sensor), "a term of your own")


def document(results: dict[str, NoiseFit], log: Log | None) -> dict[str, Any]:
    """Noise of every channel as a dictionary for JSON."""
    _check(results)
    first = next(iter(results.values()))
    return {
        "schema": "jaxcal.noise/1", "version": importlib.metadata.version("jaxcal"), "rate": number(first.deviation.rate),
        "duration": number(first.duration if log is None else log.duration), **about_log(log),
        "channels": {name: _channel(fit, sensor_of(name)) for name, fit in results.items()},
    }  # fmt: skip


def about_log(log: Log | None) -> dict[str, Any]:
    """Entries of a document on the recording."""
    if log is None:
        return {"provenance": None, "notes": [], "warnings": []}
    return {"provenance": plain(log.provenance), "notes": list(log.notes), "warnings": list(log.warnings)}


def _check(results: Any) -> None:
    """Raise a `DataError` unless there is at least one fit, each of a single channel with a known sensor."""
    if not isinstance(results, dict) or not results:
        raise DataError("there are no results; give the dictionary channel -> NoiseFit that jaxcal.noise.characterise returns")
    for name, fit in results.items():
        if not isinstance(fit, NoiseFit) or np.ndim(fit.deviation.deviation) != 1:
            raise DataError(f"the result of {name} is not a NoiseFit of one channel; NoiseFit.channel picks one of several")
        if not fit.verdict:
            raise DataError(f"method {fit.method!r} gives {name} no intervals and no verdicts; fit it with whittle, gls, edf or wavelet")
        sensor_of(name)


def sensor_of(channel: str) -> str:
    """Sensor of a channel: gyro_x -> gyro."""
    sensor = channel.partition("_")[0]
    if sensor not in ("gyro", "accel", "mag"):
        raise DataError(f"channel {channel!r} has no known sensor; expected names such as gyro_x, accel_y, mag_z")
    return sensor


def _channel(fit: NoiseFit, sensor: str) -> dict[str, Any]:
    terms = {
        term: {
            "value": number(fit.noise.coefficient(term)),
            "low": number(fit.interval[term][0]),
            "high": number(fit.interval[term][1]),
            "upper_limit": number(fit.upper_limit[term]),
            "verdict": str(fit.verdict[term]),
            "significance": number(fit.significance[term]),
            "longer_record": number(fit.longer_record[term]),
            "decides": number(fit.decides.get(term, math.inf)),
            "unit": noise_units(term, sensor)[-1],
        }
        for term in fit.terms
    }
    shapes = {term.name: {"class": type(term).__name__, **plain(term)} for _, term in fit.noise.further}
    return {
        **terms, "method": fit.method, "confidence": number(fit.confidence), "band": [number(end) for end in fit.band],
        "left_out": [str(sentence) for sentence in fit.left_out], "goodness": number(fit.goodness),
        "warnings": [str(sentence) for sentence in fit.warnings], "notes": [str(sentence) for sentence in fit.notes],
        "markov": [[number(value) for value in pair] for pair in fit.noise.markov],
        "sinusoid": [[number(value) for value in pair] for pair in fit.noise.sinusoid], **({"shapes": shapes} if shapes else {}),
    }  # fmt: skip


def number(value: Any) -> float | None:
    """Convert a number for JSON: None if it is infinite or unknown."""
    return plain(float(value))


def channels_of(results: dict[str, Any]) -> str:
    """The number of channels in words."""
    return f"{len(results)} channel{'s' * (len(results) != 1)}"


def page(results: dict[str, NoiseFit], log: Log | None, version: str) -> tuple[str, str, Markup]:
    """Subject, subtitle and sections of the page."""
    _check(results)
    first = next(iter(results.values()))
    lead = f"{channels_of(results)}, {duration_label(first.duration)} at {first.deviation.rate:.6g} Hz"
    method = f"{first.method}, terms {' '.join(first.terms)}, {100 * first.confidence:g} % intervals"
    known = {"Made by": f"jaxcal {version}", "Method": method}
    warnings = by_channel(results, "warnings")
    sections = [
        _verdict(results, len(warnings) + len(() if log is None else log.warnings)),
        _plots(results, log),
        warnings_of(log, warnings),
    ]
    notes = by_channel(results, "notes")
    if notes:
        sections.append(section("Notes", "notes", tag("ul", each("li", notes))))
    sections += [_left_out(results), recording(log), _meaning(results), provenance(known, log)]
    return "Noise", lead, join(sections)


def _verdict(results: dict[str, NoiseFit], warned: int) -> Markup:
    """The result in sentences, then a table for every sensor."""
    tables = []
    if warned:
        count = "one warning" if warned == 1 else f"{warned} warnings"
        tables.append(tag("p", "Read these numbers with ", tag("a", count, href="#warnings"), "."))
    for sensor, channels in by_sensor(results).items():
        lines = each("li", (_found(term, channels) for term in _terms(channels)))
        tables += [tag("h3", SENSORS[sensor]), tag("ul", lines), scroll(_table(sensor, channels), SENSORS[sensor])]
    return section("Verdict", "verdict", *tables)


def summary(results: dict[str, NoiseFit]) -> list[tuple[str, str, Any]]:
    """For every sensor, its name, the verdict in one word, and sentences on the result."""
    rows = []
    for sensor, channels in by_sensor(results).items():
        warned = any(fit.warnings for fit in channels.values())
        sentences = [piece for term in _terms(channels) for piece in (_found(term, channels), " ")]
        rows.append((f"Noise, {SENSORS[sensor].lower()}", "warnings" if warned else "fitted", join(sentences[:-1])))
    return rows


def by_sensor(results: dict[str, F]) -> dict[str, dict[str, F]]:
    """Group results by sensor, in their original order."""
    groups: dict[str, dict[str, F]] = {}
    for name, fit in results.items():
        groups.setdefault(sensor_of(name), {})[name] = fit
    return groups


def _terms(channels: dict[str, NoiseFit]) -> list[str]:
    fitted = dict.fromkeys([*_MEANING, *(term for fit in channels.values() for term in fit.terms)])
    return [term for term in fitted if any(term in fit.terms for fit in channels.values())]


def _axis(channel: str) -> str:
    return channel.partition("_")[2] or channel


def _found(term: str, channels: dict[str, NoiseFit]) -> Markup:
    """One sentence on one term over all axes."""
    axes: dict[str, list[str]] = {}
    for name, fit in channels.items():
        if term in fit.terms:
            axes.setdefault(fit.verdict[term], []).append(_axis(name))
    words = {"present": "found on", "hint": "a hint on", "not detected": "not detected on"}
    parts = []
    for kind, names in axes.items():
        where = ("any axis" if kind == "not detected" else "every axis") if len(names) == len(channels) > 1 else _listed(names)
        parts.append(f"{words.get(kind, kind)} {where}")
    sensor = sensor_of(next(iter(channels)))
    return join((tag("b", term), f" ({_name(term, sensor)}): {', '.join(parts)}."))


def _listed(names: list[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _table(sensor: str, channels: dict[str, NoiseFit]) -> Markup:
    rows = []
    for term in _terms(channels):
        unit = tag("span", display_unit(term, sensor)[1], class_="small", data_unit=f"{sensor} {term}")
        name = join((tag("b", term), tag("span", _name(term, sensor)), unit))
        rows.append((name, *(_cell(term, channel, fit, sensor) for channel, fit in channels.items())))
    rows.append((join((tag("span", "Fit"), tag("span", "band, goodness", class_="small"))), *map(_fit_quality, channels.values())))
    level = f"{100 * next(iter(channels.values())).confidence:g} %"
    caption = (
        f"Each cell: value, {level} interval, verdict, and the length of record with which the value would be known to 10 %. Where a term "
        f"was not detected, its {level} upper limit. Goodness is the chance of a worse fit, were the model true."
    )
    return table(("Term", *map(_axis, channels)), rows, caption, "terms")


def _cell(term: str, channel: str, fit: NoiseFit, sensor: str) -> Markup:
    if term not in fit.terms:
        return tag("span", "not fitted", class_="small")
    kind = fit.verdict[term]
    badge = tag("span", kind, class_=f"badge {kind}" if kind in ("present", "hint") else "badge")
    scale, name = display_unit(term, sensor)[0], f"{channel} {term}"  # the script finds the cell by this name when the unit changes
    if kind == "not detected":
        return join((tag("strong", f"< {number_label(float(fit.upper_limit[term]) / scale, 2)}", data_coefficient=name), badge))
    value, low, high = interval_labels(*(float(v) / scale for v in (fit.noise.coefficient(term), *fit.interval[term])))
    longer = float(fit.longer_record[term])
    needed = f"needs {duration_label(longer)} for ±10 %" if longer < math.inf else "±10 % is not within reach"
    return join((tag("strong", value, data_coefficient=name), tag("span", f"{low} to {high}"), badge, tag("span", needed, class_="small")))


def _fit_quality(fit: NoiseFit) -> Markup:
    shortest, longest = (duration_label(float(end)) for end in fit.band)
    goodness = tag("span", f"p = {number_label(float(fit.goodness), 2)}", class_="small")
    return join((tag("span", f"{shortest} to {longest}"), goodness))


def _plots(results: dict[str, NoiseFit], log: Log | None) -> Markup:
    """The curves of every sensor, and tables of numbers for each axis."""
    parts = []
    for sensor, channels in by_sensor(results).items():
        parts.append(explorer(sensor, channels, log))
        parts += [_numbers(channel, fit, sensor) for channel, fit in channels.items()]
    return section("Curves", "plots", *parts)


def _numbers(channel: str, fit: NoiseFit, sensor: str) -> Markup:
    """Table of all cluster times, or of 300 that are evenly spaced on a logarithmic scale."""
    (scale, unit), d = display_unit("B", sensor), fit.deviation
    level = f"{100 * d.confidence:g} %"
    columns = ("τ (s)", f"deviation ({unit})", f"{level} low", f"{level} high", "degrees of freedom", "used in the fit")
    count = len(d.tau)
    rows = []
    for i in range(count) if count <= _MOST else sorted({round(count ** (k / (_MOST - 1))) - 1 for k in range(_MOST)}):
        values = (d.tau[i], d.deviation[i] / scale, d.lower[i] / scale, d.upper[i] / scale)
        rows.append((*(number_label(float(v), 4) for v in values), number_label(float(d.edf[i]), 3), "yes" if fit.used[i] else "no"))
    return numbers(f"Numbers of {channel}", columns, rows)


def _left_out(results: dict[str, NoiseFit]) -> Markup:
    left_out = {channel: fit.left_out for channel, fit in results.items() if fit.left_out}
    if not left_out:
        return Markup("")
    about = "Cluster times that the coefficients do not rest on, by octave, and why."
    lists = (
        tag("details", tag("summary", f"{channel}: {len(said)} octave{'s' * (len(said) != 1)}"), tag("ul", each("li", said)))
        for channel, said in left_out.items()
    )
    return section("Left out of the fits", "left-out", tag("p", about), *lists)


def by_channel(results: dict[str, Any], field: str) -> list[str]:
    """List each sentence of a field once, with the channels to which it applies."""
    channels: dict[str, list[str]] = {}
    for channel, fit in results.items():
        for sentence in getattr(fit, field):
            channels.setdefault(str(sentence), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in channels.items()]


def _meaning(results: dict[str, NoiseFit]) -> Markup:
    """Explanations of the fitted terms."""
    sensors, items = list(by_sensor(results)), []
    for term in _terms(results):
        names = dict.fromkeys(_name(term, sensor) for sensor in sensors)
        units = ", ".join(dict.fromkeys(noise_units(term, sensor)[-1] for sensor in sensors))
        text = join((_MEANING.get(term, _OWN), tag("span", f" SI unit: {units}.", class_="small")))
        items.append((f"{term}: {' / '.join(names)}", text))
    return section("What the coefficients mean", "meaning", definitions(items))
