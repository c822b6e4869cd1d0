"""The sections of a noise report."""

import json
from collections.abc import Iterable
from typing import Any

from .._log import Log
from .._results import plain
from .._units import noise_units
from ..noise import NoiseFit
from ..plot import allan
from ..plot._style import display_unit, duration_label, interval_labels, number_label
from ._document import sensor_of
from ._html import Markup, each, join, tag
from ._numbers import scroll, shown, table_of
from ._svg import inline

SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
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


def noise_body(results: dict[str, NoiseFit], log: Log | None, version: str) -> Markup:
    """Every section of a report on noise."""
    sections = [_verdict(results, log), _plots(results), _remarks(results, log)]
    sections += [recording(log), _meaning(results), _provenance(results, log, version)]
    return join(sections)


def _verdict(results: dict[str, NoiseFit], log: Log | None) -> Markup:
    """What was found, in sentences, then a table for every sensor."""
    tables = []
    warnings = _warnings(results, log)
    if warnings:
        count = "one warning" if len(warnings) == 1 else f"{len(warnings)} warnings"
        tables.append(tag("p", "Read these numbers with ", tag("a", count, href="#warnings"), "."))
    for sensor, channels in by_sensor(results).items():
        lines = each("li", (_found(term, channels) for term in _terms(channels)))
        tables += [tag("h3", SENSORS[sensor]), tag("ul", lines), scroll(_table(sensor, channels), SENSORS[sensor])]
    return tag("section", tag("h2", "Verdict", id="verdict"), *tables, aria_labelledby="verdict")


def noise_summary(results: dict[str, NoiseFit]) -> list[tuple[str, str, Any]]:
    """What was found on every sensor: its name, the verdict in a word, sentences."""
    rows = []
    for sensor, channels in by_sensor(results).items():
        warned = any(fit.warnings for fit in channels.values())
        sentences = [piece for term in _terms(channels) for piece in (_found(term, channels), " ")]
        rows.append((f"Noise, {SENSORS[sensor].lower()}", "warnings" if warned else "fitted", join(sentences[:-1])))
    return rows


def by_sensor(results: dict[str, NoiseFit]) -> dict[str, dict[str, NoiseFit]]:
    """Results grouped by sensor, in the order in which they come."""
    groups: dict[str, dict[str, NoiseFit]] = {}
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
    head = tag("tr", tag("th", "Term", scope="col"), *(tag("th", _axis(name), scope="col") for name in channels))
    rows = []
    for term in _terms(channels):
        unit = tag("span", display_unit(term, sensor)[1], class_="small")
        name = tag("th", tag("b", term), tag("span", _name(term, sensor)), unit, scope="row")
        rows.append(tag("tr", name, *(_cell(term, fit, sensor) for fit in channels.values())))
    bands = (tag("td", *_fit_quality(fit)) for fit in channels.values())
    rows.append(tag("tr", tag("th", tag("span", "Fit"), tag("span", "band, goodness", class_="small"), scope="row"), *bands))
    level = f"{100 * next(iter(channels.values())).confidence:g} %"
    caption = (
        f"Each cell: value, {level} interval, verdict, and the length of record with which the value would be known to 10 %. Where a term "
        f"was not detected, its {level} upper limit. Goodness is the chance of a worse fit, were the model true."
    )
    return tag("table", tag("caption", caption), tag("thead", head), tag("tbody", *rows), class_="terms")


def _cell(term: str, fit: NoiseFit, sensor: str) -> Markup:
    if term not in fit.terms:
        return tag("td", tag("span", "not fitted", class_="small"))
    kind = fit.verdict[term]
    badge = tag("span", kind, class_=f"badge {kind}" if kind in ("present", "hint") else "badge")
    scale = display_unit(term, sensor)[0]
    if kind == "not detected":
        limit = float(fit.upper_limit[term]) / scale
        return tag("td", tag("strong", f"< {number_label(limit, 2)}"), badge)
    value, low, high = interval_labels(*(float(v) / scale for v in (fit.noise.coefficient(term), *fit.interval[term])))
    longer = float(fit.longer_record[term])
    needed = f"10 % after {duration_label(longer)}" if longer < float("inf") else "10 % not within reach"
    return tag("td", tag("strong", value), tag("span", f"{low} to {high}"), badge, tag("span", needed, class_="small"))


def _fit_quality(fit: NoiseFit) -> Iterable[Markup]:
    shortest, longest = (duration_label(float(end)) for end in fit.band)
    yield tag("span", f"{shortest} to {longest}")
    yield tag("span", f"p = {number_label(float(fit.goodness), 2)}", class_="small")


def _plots(results: dict[str, NoiseFit]) -> Markup:
    """The curves of every sensor, then each axis with the lines of its terms and its numbers."""
    parts = []
    for sensor, channels in by_sensor(results).items():
        name = SENSORS[sensor]
        axes = _listed([_axis(channel) for channel in channels])
        about = f"Allan deviation of the {name.lower()} against cluster time on logarithmic axes, for {axes}."
        parts += [tag("h3", name), _figure(channels, sensor, f"{name}: Allan deviation", about)]
        parts += [_axis_details(channel, fit, sensor, f"{sensor}-{i}") for i, (channel, fit) in enumerate(channels.items())]
    return tag("section", tag("h2", "Allan deviation", id="plots"), *parts, aria_labelledby="plots")


def _figure(channels: dict[str, NoiseFit], prefix: str, title: str, about: str) -> Markup:
    svg = inline(allan(channels), prefix, title, about)
    text = "Points: measured. Lines: fitted model, thin outside its band. Shaded: interval of the measured values."
    return tag("figure", scroll(svg, title), tag("figcaption", text))


def _axis_details(channel: str, fit: NoiseFit, sensor: str, prefix: str) -> Markup:
    title = f"{SENSORS[sensor]} {_axis(channel)}"
    about = f"Allan deviation of {channel} with the fitted model and the line of each of its terms."
    figure = _figure({channel: fit}, prefix, f"{title}: Allan deviation and terms", about)
    return tag("details", tag("summary", f"{title}: terms and numbers"), figure, _numbers(channel, fit, sensor))


def _numbers(channel: str, fit: NoiseFit, sensor: str) -> Markup:
    scale, unit = display_unit("B", sensor)
    d = fit.deviation
    level = f"{100 * d.confidence:g} %"
    columns = ("τ (s)", f"deviation ({unit})", f"{level} low", f"{level} high", "degrees of freedom", "used in the fit")
    rows = []
    for i in shown(len(d.tau)):
        values = (d.tau[i], d.deviation[i] / scale, d.lower[i] / scale, d.upper[i] / scale)
        rows.append((*(number_label(float(v), 4) for v in values), number_label(float(d.edf[i]), 3), "yes" if fit.used[i] else "no"))
    return table_of(f"Numbers of {channel}", columns, rows)


def _warnings(results: dict[str, NoiseFit], log: Log | None) -> list[str]:
    return [*(() if log is None else log.warnings), *_by_channel({name: fit.warnings for name, fit in results.items()})]


def _remarks(results: dict[str, NoiseFit], log: Log | None) -> Markup:
    """Warnings, notes, and what the fits left out."""
    warnings = tag("ul", each("li", _warnings(results, log) or ["None."]))
    sections = [tag("section", tag("h2", "Warnings", id="warnings"), warnings, aria_labelledby="warnings")]
    notes = _by_channel({name: fit.notes for name, fit in results.items()})
    if notes:
        sections.append(tag("section", tag("h2", "Notes", id="notes"), tag("ul", each("li", notes)), aria_labelledby="notes"))
    left_out = {channel: fit.left_out for channel, fit in results.items() if fit.left_out}
    if left_out:
        about = "Cluster times that the coefficients do not rest on, by octave, and why."
        lists = (
            tag("details", tag("summary", f"{channel}: {len(said)} octave{'s' * (len(said) != 1)}"), tag("ul", each("li", said)))
            for channel, said in left_out.items()
        )
        title = tag("h2", "Left out of the fits", id="left-out")
        sections.append(tag("section", title, tag("p", about), *lists, aria_labelledby="left-out"))
    return join(sections)


def _by_channel(sentences: dict[str, Any]) -> list[str]:
    """Each sentence once, with the channels that it is true of."""
    channels: dict[str, list[str]] = {}
    for channel, said in sentences.items():
        for sentence in said:
            channels.setdefault(str(sentence), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in channels.items()]


def recording(log: Log | None) -> Markup:
    """What the log is, and what was guessed to read it."""
    if log is None:
        return Markup("")
    notes = [tag("h3", "How it was read"), tag("ul", each("li", log.notes))] if log.notes else []
    summary = tag("pre", log.summary(), tabindex="0", role="region", aria_label="Summary of the recording")
    return tag("section", tag("h2", "Recording", id="recording"), summary, *notes, aria_labelledby="recording")


def _meaning(results: dict[str, NoiseFit]) -> Markup:
    """A sentence on every term."""
    sensors = list(by_sensor(results))
    items = []
    for term in _terms(results):
        names = dict.fromkeys(_name(term, sensor) for sensor in sensors)
        units = ", ".join(dict.fromkeys(noise_units(term, sensor)[-1] for sensor in sensors))
        items += [
            tag("dt", f"{term}: {' / '.join(names)}"),
            tag("dd", _MEANING.get(term, _OWN), tag("span", f" SI unit: {units}.", class_="small")),
        ]
    return tag("section", tag("h2", "What the coefficients mean", id="meaning"), tag("dl", *items), aria_labelledby="meaning")


def _provenance(results: dict[str, NoiseFit], log: Log | None, version: str) -> Markup:
    """Where the numbers come from."""
    first = next(iter(results.values()))
    known: dict[str, Any] = {
        "Made by": f"jaxcal {version}",
        "Method": f"{first.method}, terms {' '.join(first.terms)}, {100 * first.confidence:g} % intervals",
    }
    for key, value in plain(log.provenance if log is not None else {}).items():
        known[key] = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
    items = [piece for key, value in known.items() for piece in (tag("dt", key), tag("dd", value))]
    return tag("section", tag("h2", "Provenance", id="provenance"), tag("dl", *items), aria_labelledby="provenance")
