"""Tables and curves of noise fits as data."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._answer import Curve, Grid, Number, Section, joined_names, listed
from ._terms import BUILT_IN

SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}
QUOTED = (1.0, 10.0, 100.0, 1000.0)  # cluster times in s at which the deviation is part of every answer
_VAGUE = 3.0  # ratio of the upper limit of a deviation to its value from which the record says too little
#: units where the sensor is not known; "unit" stands for the unit of the readings
_UNITS = {"Q": "unit s", "N": "unit sqrt(s)", "B": "unit", "K": "unit/sqrt(s)", "R": "unit/s"}
_NAMES = {
    "Q": "quantisation", "N": "white noise", "B": "bias instability", "K": "random walk", "R": "ramp", "markov": "Gauss-Markov process",
    ("N", "gyro"): "angle random walk", ("K", "gyro"): "rate random walk", ("N", "accel"): "velocity random walk",
}  # fmt: skip


def name_of(term: str, sensor: str = "") -> str:
    """Name of a term: "N" of a gyroscope is the angle random walk.

    Examples
    --------
    >>> from jaxcal.noise._sections import name_of
    >>> name_of("N", "gyro"), name_of("K", "mag")
    ('angle random walk', 'random walk')
    """
    return _NAMES.get((term, sensor), _NAMES.get(term, "a term of your own"))


def quantity_of(term: str, sensor: str) -> str:
    """Quantity of a coefficient in the table of units; if the sensor is not known, its unit in those of the readings."""
    return f"{'K' if term == 'markov' else term}.{sensor}" if sensor else _UNITS.get("K" if term == "markov" else term, "SI")


def number_of(fit: Any, term: str, prefix: str = "") -> Number:
    """A coefficient with its interval, or its upper limit if the term is not detected; open if it has none.

    Recordings and fits have the same tables.
    """
    value, quantity = float(np.asarray(fit.noise.coefficient(term))), quantity_of(term, fit.sensor)
    presence = fit.presence.get(term, "")
    if presence == "not detected":
        limit = float(fit.upper_limit[term])
        return Number(prefix + term, math.nan, math.nan, limit, quantity, "limit" if math.isfinite(limit) else "open")
    low, high = (float(end) for end in fit.interval.get(term, (math.nan, math.nan)))
    return Number(prefix + term, value, low, high, quantity, remark="hint" if presence == "hint" else "")


def floor_of(fit: Any, prefix: str = "") -> tuple[Number, Number]:
    """Lowest point of the Allan deviation, and the cluster time at which it lies.

    It is taken where the upper limit is lowest, so that cluster times that hold few parts of the record do not decide. The interval reaches
    down to the lowest point of the curve, which may be the floor as well. Where Q and N alone would lie within the interval at that cluster
    time, the record shows no floor, and the upper limit is given.
    """
    curve, quantity = fit.deviation, quantity_of("B", fit.sensor)
    i = int(np.nanargmin(np.where(np.isfinite(curve.upper), curve.upper, np.inf)))
    tau, low, high = (float(values[i]) for values in (curve.tau, curve.lower, curve.upper))
    fast = sum(float(getattr(fit.noise, term)) ** 2 * BUILT_IN[term].avar(tau) for term in ("Q", "N"))
    seen = low > math.sqrt(fast)
    value, low = (float(curve.deviation[i]), min(low, float(np.nanmin(curve.deviation)))) if seen else (math.nan, math.nan)
    found = Number(f"{prefix}floor", value, low, high, quantity, "estimated" if seen else "limit")
    return found, Number(f"{prefix}floor_at", tau, quantity="time")


def measured_at(fit: Any, tau: float, prefix: str = "") -> Number | None:
    """Measured Allan deviation at a cluster time; None if the record is too short for it."""
    curve = fit.deviation
    at = np.flatnonzero(curve.m == round(tau * float(curve.rate)))
    if not len(at):
        return None
    value, low, high = (float(values[at[0]]) for values in (curve.deviation, curve.lower, curve.upper))
    known = high < _VAGUE * value
    return Number(f"{prefix}deviation_{tau:g}_s", value, low, high, quantity_of("B", fit.sensor)) if known else None


def headline_of(fits: Mapping[str, Any]) -> str:
    """How well N, or the first term, is known on the worst axis."""
    first = next(iter(fits.values()))
    term = "N" if "N" in first.terms else first.terms[0]
    cells = {name: number_of(fit, term) for name, fit in fits.items()}
    known = [cell.half / cell.value for cell in cells.values() if cell.state == "estimated" and cell.value > 0.0]
    absent = [name for name, cell in cells.items() if cell.state == "limit"]
    if not known or not all(map(math.isfinite, known)):
        return f"{term} is not detected" if absent else f"method {first.method} gives no intervals"
    where = " on every axis" if len(fits) > 1 and not absent else ""
    return f"{term} to {100 * max(known):.2g} %{where}" + f", not detected on {joined_names(absent)}" * bool(absent)


def sections_of(fits: Mapping[str, Any]) -> list[Section]:
    """A table of coefficients for each sensor, then a table of details for each, and the curve of each channel."""
    groups: dict[str, dict[str, Any]] = {}
    for name, fit in fits.items():
        groups.setdefault(fit.sensor, {})[name] = fit
    filters = [
        (f"{SENSORS.get(sensor, sensor)} {one.name[-1]}", one) for sensor, axes in groups.items() for one in _for_filters(sensor, axes)
    ]
    return [
        *(_coefficients(sensor, axes) for sensor, axes in groups.items()),
        *(_details(sensor, axes) for sensor, axes in groups.items() if next(iter(axes.values())).deviation is not None),
        listed("filter", "for a filter, worst axis", filters, detail=True),
        *(_curve(name, fit) for name, fit in fits.items() if fit.deviation is not None),
    ]


def rows_of(axes: Mapping[str, Any], sensor: str) -> list[tuple[str, tuple[Number, ...]]]:
    """A row for each term."""
    names = dict.fromkeys(term for fit in axes.values() for term in fit.terms)
    label = {term: f"{'M' if term == 'markov' else term}  {name_of(term, sensor)}" for term in names}
    return [(label[term], tuple(number_of(fit, term, _prefix(name)) for name, fit in axes.items())) for term in names]


def columns_of(axes: Mapping[str, Any], sensor: str) -> tuple[str, ...]:
    """Heads of the columns: the axes of a sensor."""
    return tuple(name.removeprefix(f"{sensor}_").removeprefix("channel ") for name in axes)


def grids(fits: Mapping[str, Any], key: str, title: str) -> list[Grid]:
    """A table of the coefficients of each sensor alone."""
    found = []
    for sensor in dict.fromkeys(fit.sensor for fit in fits.values()):
        axes = {name: fit for name, fit in fits.items() if fit.sensor == sensor}
        label = f"{SENSORS.get(sensor, 'noise')}, {title}"
        found.append(Grid(f"{sensor}_{key}", label, columns_of(axes, sensor), tuple(rows_of(axes, sensor))))
    return found


def _prefix(name: str) -> str:
    return f"{name}." if name else ""


def _coefficients(sensor: str, axes: Mapping[str, Any]) -> Grid:
    rows, fits = list[Any](rows_of(axes, sensor)), list(axes.items())
    if all("markov" in fit.terms for _, fit in fits):
        times = (Number(f"{_prefix(name)}markov_time", float(np.asarray(fit.noise.markov[0][1])), quantity="time") for name, fit in fits)
        rows.append(("  time  of correlation", tuple(times)))
    if all(fit.deviation is not None for _, fit in fits):
        value, at = zip(*(floor_of(fit, _prefix(name)) for name, fit in fits), strict=True)
        rows += [("floor  of the curve", value), ("  at  cluster time", at)]
        for tau in QUOTED:
            cells = tuple(measured_at(fit, tau, _prefix(name)) for name, fit in fits)
            rows += [(f"{tau:g} s  deviation", cells)] if any(cells) else []
    # what no axis determines is among the details
    rows = [row for row in rows if not _all_open(row)]
    title, note = SENSORS.get(sensor, "noise"), _filter_line(_for_filters(sensor, axes))
    return Grid(sensor or "noise", title, columns_of(axes, sensor), tuple(rows), note=note)


def _all_open(row: tuple[str, tuple[Number | None, ...]]) -> bool:
    return all(cell is not None and cell.state == "open" for cell in row[1])


def _for_filters(sensor: str, axes: Mapping[str, Any]) -> list[Number]:
    """N and K of the worst axis, or the upper limit of what is not present, as files for other tools have them."""
    found = []
    for term in ("N", "K") if sensor else ():
        cells = []
        for fit in (fit for fit in axes.values() if term in fit.presence):
            one = number_of(fit, term)
            if fit.presence[term] != "present":
                one = one._replace(value=math.nan, low=math.nan, high=float(fit.upper_limit[term]), state="limit")
            cells.append(one._replace(name=f"{sensor}.filter_{term}", remark=""))
        if cells and math.isfinite(bound_of(worst := max(cells, key=bound_of))):
            found.append(worst)
    return found


def bound_of(one: Number) -> float:
    """What a filter takes of a coefficient: its value, or its upper limit."""
    return float(one.high if one.state == "limit" else one.value)


def _filter_line(numbers: list[Number]) -> str:
    said = [f"{one.name[-1]} {bound_of(one):.3g} {one.unit}" for one in numbers]
    return f"filter (SI, worst axis): {', '.join(said)}" if said else ""


def _details(sensor: str, axes: Mapping[str, Any]) -> Grid:
    """Lengths of record, the band of the fit and its goodness."""

    def row(label: str, key: str, value: Any, quantity: str = "time") -> tuple[str, tuple[Number | None, ...]]:
        cells = (Number(_prefix(name) + key, float(value(fit)), quantity=quantity) for name, fit in axes.items())
        return label, tuple(cell if math.isfinite(cell.value) else None for cell in cells)

    rows: list[Any] = [
        row("fitted from", "band_from", lambda fit: fit.band[0]), row("fitted to", "band_to", lambda fit: fit.band[1]),
        row("chance of a worse fit", "goodness", lambda fit: fit.goodness, "ratio"),
    ]  # fmt: skip
    for term in next(iter(axes.values())).terms:
        longer = row(f"record for {term} to 10 %", f"{term}.longer_record", lambda fit, t=term: fit.longer_record.get(t, math.inf))
        rows += [longer] if any(longer[1]) else []
    rows += [one for one in rows_of(axes, sensor) if _all_open(one)]
    title = f"fit of the {SENSORS.get(sensor, 'noise')}"
    return Grid(f"{sensor or 'noise'}_fit", title, columns_of(axes, sensor), tuple(rows), detail=True)


def _curve(name: str, fit: Any) -> Curve:
    curve, unit = fit.deviation, quantity_of("B", fit.sensor)
    values = {key: (unit, getattr(curve, key)) for key in ("deviation", "lower", "upper")}
    columns = {"tau": ("time", curve.tau), **values, "edf": ("ratio", curve.edf), "used": ("ratio", np.asarray(fit.used, dtype=float))}
    return Curve(f"{name or 'noise'}_deviation", f"Allan deviation of {name}".removesuffix(" of "), columns)
