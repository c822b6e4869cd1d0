"""Tables of noise coefficients for readers: data-sheet units, digits justified by the interval, one table per sensor."""

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from .._units import noise_factor, noise_units, number
from ._screen import Screen

_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer", "clock": "clock"}
_VERDICTS = {"hint": "only a hint", "not detected": "not detected"}


def by_sensor(found: Mapping[str, Any]) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Sensor, its full name, and its channels with their results, for every sensor with results."""
    for sensor, name in _SENSORS.items():
        if axes := {channel: result for channel, result in found.items() if channel.startswith(f"{sensor}_")}:
            yield sensor, name, axes


def noise_tables(screen: Screen, fits: Mapping[str, Any], truth: Mapping[str, Any] | None = None, of: str = "interval") -> None:
    """Print one table for every sensor: one row per axis, and in each cell the coefficient with its interval below.

    Parameters
    ----------
    screen : where to print.
    fits : channel -> `NoiseFit`.
    truth : sensor -> simulated `Noise`; adds a row, and marks the intervals that do not contain it.
    of : name of the interval in the title.
    """
    for sensor, name, axes in by_sensor(fits):
        _sensor_table(screen, sensor, name, axes, None if truth is None else truth[sensor], of)


def _sensor_table(screen: Screen, sensor: str, name: str, axes: dict[str, Any], truth: Any, of: str) -> None:
    first = next(iter(axes.values()))
    columns = {term: _column(sensor, term, axes) for term in first.terms}
    rows = []
    if truth is not None:
        rows.append(["truth", *(f"{truth.coefficient(term) / scale:.4g}" for term, (_, scale) in columns.items())])
    for channel, fit in axes.items():
        cells = [_cell(fit, term, scale, truth) for term, (_, scale) in columns.items()]
        rows.append([channel.removeprefix(f"{sensor}_"), *cells])
    title = f"{name}: coefficient, {100 * first.confidence:g} % {of} below"
    screen.table(title, ["", *(f"{term}\n{unit}" for term, (unit, _) in columns.items())], rows)


def _column(sensor: str, term: str, axes: dict[str, Any]) -> tuple[str, float]:
    """Printed unit and its SI value: the data-sheet unit, with a power of ten for very small or large numbers."""
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
    mark = "" if truth is None or low <= truth.coefficient(term) / scale <= high else " *"
    if verdict == "not detected":
        limit = float(fit.upper_limit[term]) / scale
        return f"< {number(limit, limit / 2)}{mark}\nnot detected"
    half = (high - low) / 2
    text = f"{number(value, half)}{mark}\n{number(low, half)} to {number(high, half)}"
    return text if verdict == "present" else f"{text}\n{_VERDICTS.get(verdict, verdict)}"


def missed(fits: Mapping[str, Any], truth: Mapping[str, Any]) -> tuple[int, int]:
    """Number of intervals that do not contain the simulated coefficient, and number of all intervals."""
    found = [
        bool(fit.interval[term][0] <= truth[channel.partition("_")[0]].coefficient(term) <= fit.interval[term][1])
        for channel, fit in fits.items()
        for term in fit.terms
    ]
    return len(found) - sum(found), len(found)


def left_out(fits: Mapping[str, Any]) -> list[str]:
    """Sentences on cluster times that the fits did not use; a real log may have many, which the report lists one by one."""
    from .._results import by_channel

    found = {}
    for channel, fit in fits.items():
        if count := len(fit.left_out):
            octaves = f"{count} octave{'s' * (count > 1)}"
            found[channel] = [f"cluster times below {float(fit.band[0]):.3g} s ({octaves}), at which the noise model does not hold"]
    return by_channel(found)


def longer_record(fits: Mapping[str, Any]) -> list[str]:
    """For every sensor, the record length with which each detected term is known to 10 % on the worst axis."""
    return _lengths(fits, lambda fit, term: [float(fit.longer_record[term])] if fit.verdict[term] == "present" else [])


def decides(fits: Mapping[str, Any]) -> list[str]:
    """For every sensor, the record length that would detect an undetected term if the term were at its upper limit."""

    def seconds(fit: Any, term: str) -> list[float]:
        # leave out Q: a longer record does not help, because only the shortest cluster times determine it
        open_ = fit.verdict.get(term) == "not detected" and term in fit.decides and term != "Q"
        return [float(fit.decides[term])] if open_ else []

    return _lengths(fits, seconds)


def _lengths(fits: Mapping[str, Any], seconds: Callable[[Any, str], list[float]]) -> list[str]:
    """A sentence for every sensor: the terms with the longest record length over the axes, if it is finite."""
    found = []
    for _, name, axes in by_sensor(fits):
        longest = {
            term: max((length for fit in axes.values() for length in seconds(fit, term)), default=math.inf)
            for term in next(iter(axes.values())).terms
        }
        if needed := [f"{term} {duration(length)}" for term, length in longest.items() if math.isfinite(length)]:
            found.append(f"{name}: {', '.join(needed)}")
    return found


def duration(seconds: float) -> str:
    """Format a time for readers.

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
