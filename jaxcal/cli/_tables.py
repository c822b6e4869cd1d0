"""Noise coefficients as people read them: data-sheet units, digits that the interval justifies, one table a sensor."""

import math
from collections.abc import Mapping
from typing import Any

from .._units import noise_factor, noise_units, number
from ._screen import Screen

_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}
_VERDICTS = {"hint": "only a hint", "not detected": "not detected"}


def noise_tables(screen: Screen, fits: Mapping[str, Any], truth: Mapping[str, Any] | None = None) -> None:
    """One table for every sensor: a row for every axis, in each cell the coefficient and its interval below.

    Parameters
    ----------
    screen : where to print.
    fits : channel -> `NoiseFit`.
    truth : sensor -> `Noise` that was simulated: adds a row, and marks the intervals that miss it.
    """
    for sensor, name in _SENSORS.items():
        axes = {channel: fit for channel, fit in fits.items() if channel.startswith(f"{sensor}_")}
        if axes:
            _sensor_table(screen, sensor, name, axes, None if truth is None else truth[sensor])


def _sensor_table(screen: Screen, sensor: str, name: str, axes: dict[str, Any], truth: Any) -> None:
    first = next(iter(axes.values()))
    columns = {term: _column(sensor, term, axes) for term in first.terms}
    rows = []
    if truth is not None:
        rows.append(["truth", *(f"{truth.coefficient(term) / scale:.4g}" for term, (_, scale) in columns.items())])
    for channel, fit in axes.items():
        cells = [_cell(fit, term, scale, truth) for term, (_, scale) in columns.items()]
        rows.append([channel.removeprefix(f"{sensor}_"), *cells])
    title = f"{name}: coefficient, {100 * first.confidence:g} % interval below"
    screen.table(title, ["", *(f"{term}\n{unit}" for term, (unit, _) in columns.items())], rows)


def _column(sensor: str, term: str, axes: dict[str, Any]) -> tuple[str, float]:
    """Unit as printed, and its SI value: the data-sheet unit, with a power of ten where numbers would be clumsy."""
    unit = noise_units(term, sensor)[0]
    factor = noise_factor(term, sensor, unit)
    largest = max(float(fit.upper_limit[term]) for fit in axes.values()) / factor
    if 0.01 <= largest < 1e5 or not 0 < largest < math.inf:
        return unit, factor
    power = 3 * math.floor(math.log10(largest) / 3)
    return f"1e{power} {unit}", factor * 10.0**power


def _cell(fit: Any, term: str, scale: float, truth: Any) -> str:
    low, high = (float(limit) / scale for limit in fit.interval[term])
    value = float(fit.noise.coefficient(term)) / scale
    verdict = str(fit.verdict[term])
    mark = ""
    if truth is not None and not low <= truth.coefficient(term) / scale <= high:
        mark = " *"
    if verdict == "not detected":
        limit = float(fit.upper_limit[term]) / scale
        return f"< {number(limit, limit / 2)}{mark}\nnot detected"
    half = (high - low) / 2
    text = f"{number(value, half)}{mark}\n{number(low, half)} to {number(high, half)}"
    return text if verdict == "present" else f"{text}\n{_VERDICTS.get(verdict, verdict)}"


def missed(fits: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[int, int]:
    """How many intervals miss the simulated coefficient, and how many there are."""
    found = [
        bool(fit.interval[term][0] <= truth[channel.partition("_")[0]].coefficient(term) <= fit.interval[term][1])
        for channel, fit in fits.items()
        for term in fit.terms
    ]
    return len(found) - sum(found), len(found)


def by_channel(sentences: Mapping[str, Any]) -> list[str]:
    """Sentences of several channels, each once with the channels it is true of.

    Examples
    --------
    >>> from jaxcal.cli._tables import by_channel
    >>> by_channel({"gyro_x": ["short record"], "gyro_y": ["short record", "odd"]})
    ['gyro_x, gyro_y: short record', 'gyro_y: odd']
    """
    channels: dict[str, list[str]] = {}
    for channel, found in sentences.items():
        for sentence in found:
            channels.setdefault(str(sentence), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in channels.items()]


def left_out(fits: Mapping[str, Any]) -> list[str]:
    """Cluster times that the fits could not use; a real log may have many octaves of them, which the report lists one by one."""
    found = {}
    for channel, fit in fits.items():
        if count := len(fit.left_out):
            octaves = f"{count} octave{'s' * (count > 1)}"
            found[channel] = [f"cluster times below {float(fit.band[0]):.3g} s ({octaves}), at which the noise model does not hold"]
    return by_channel(found)


def longer_record(fits: Mapping[str, Any]) -> list[str]:
    """For every sensor, how long a record makes each term certain to 10 % on the worst axis; nothing on terms that are not there."""
    found = []
    for sensor, name in _SENSORS.items():
        axes = [fit for channel, fit in fits.items() if channel.startswith(f"{sensor}_")]
        needed = []
        for term in axes[0].terms if axes else ():
            seconds = max((float(fit.longer_record[term]) for fit in axes if fit.verdict[term] == "present"), default=math.inf)
            needed += [f"{term} {duration(seconds)}"] if math.isfinite(seconds) else []
        found += [f"{name}: {', '.join(needed)}"] if needed else []
    return found


def decides(fits: Mapping[str, Any]) -> list[str]:
    """For every sensor, how long a record decides whether a term is there that was not detected, were it at its upper limit."""
    found = []
    for sensor, name in _SENSORS.items():
        axes = [fit for channel, fit in fits.items() if channel.startswith(f"{sensor}_")]
        needed = []
        for term in axes[0].terms if axes else ():
            seconds = [float(fit.decides[term]) for fit in axes if fit.verdict.get(term) == "not detected" and term in fit.decides]
            # Q is told at once where the band is whole, and not at all where it is cut
            needed += [f"{term} {duration(max(seconds))}"] if seconds and term != "Q" and math.isfinite(max(seconds)) else []
        found += [f"{name}: {', '.join(needed)}"] if needed else []
    return found


def duration(seconds: float) -> str:
    """A time as people say it.

    Examples
    --------
    >>> from jaxcal.cli._tables import duration
    >>> duration(42.3), duration(610.0), duration(5400.0), duration(4e6), duration(4e8)
    ('42 s', '10 min', '1.5 h', '46 days', '13 years')
    """
    units = {"years": 86400.0 * 365.25, "days": 86400.0, "h": 3600.0, "min": 60.0}
    unit = next((unit for unit, size in units.items() if seconds >= 1.2 * size), "s")
    count = seconds / units.get(unit, 1.0)
    return f"{count:.0f} {unit}" if count >= 9.95 else f"{count:.2g} {unit}"
