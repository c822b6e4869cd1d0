"""Interactive curves: data for the script of a page, and the same curves as static figures.

A page has one JSON document for each sensor. `explore.js` draws its views: the Allan deviation, the spectrum, the residual of the fit,
and the signal. Values are in SI units; the script divides them by the chosen unit.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._log import Log
from .._units import noise_factor, noise_units, si_unit, unit_label
from ..allan import Deviation
from ..noise import NoiseFit
from ..noise._result import FittedSpectrum
from ..noise._sections import bound_of, floor_of
from ..plot._allan import KINDS
from ..plot._style import SENSORS
from ..spectrum import Spectrum, density
from ._html import FINE, MOST, Markup, data, tag
from ._svg import Mark, figure, log_axis

#: sensor -> units to choose from, beginning with the default: the unit of B, and units of other terms unless they are the usual ones
_UNITS: dict[str, dict[str, dict[str, str]]] = {
    "gyro": {"deg/h": {}, "deg/s": {"Q": "deg", "N": "deg/sqrt(s)", "K": "deg/s/sqrt(s)", "R": "deg/h/s"}, "rad/s": {}},
    "accel": {"mg": {}, "ug": {"N": "ug/sqrt(Hz)", "K": "mg/sqrt(s)"}, "m/s^2": {}},
    "clock": {"": {}},
    "mag": {"nT": {}, "uT": {"Q": "uT s", "N": "uT/sqrt(Hz)", "K": "uT/sqrt(s)", "R": "uT/h"}, "T": {}},
}
SENSOR_NAMES = {**SENSORS, "clock": "Clock"}
_FEWEST, _PER_DECADE = 3, 24  # least number of ordinates in a point of a spectrum, and points per decade


class _Grids:
    """Arrays that several curves share; each is stored once."""

    def __init__(self) -> None:
        self.kept: list[list[float | None]] = []
        self._places: dict[bytes, int] = {}

    def place(self, values: Any) -> int:
        """Store an array and return its index."""
        array = np.asarray(values, dtype=float)
        key = array.tobytes()
        if key not in self._places:
            self._places[key] = len(self.kept)
            self.kept.append(short(array, 6))
        return self._places[key]


def short(values: Any, digits: int = 4) -> list[float | None]:
    """Round numbers to a few digits; values that are not finite become None."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in np.asarray(values, dtype=float).tolist()]


def explorer(sensor: str, channels: Mapping[str, Any], log: Log | None) -> tuple[Markup, Markup]:
    """The first view of one sensor as a static figure; and all views: controls and charts if scripts run, else the other static figures.

    Parameters
    ----------
    sensor : "gyro", "accel" or "mag".
    channels : channel -> `NoiseFit`, `Deviation` or `Spectrum`.
    log : the recording, for the signal.
    """
    if sensor not in _UNITS:
        raise DataError(f"channel {sensor!r} has no known sensor; expected names such as gyro_x, accel_y, mag_z", code="no_sensor")
    grids, level = _Grids(), getattr(next(iter(channels.values())), "confidence", 0.95)
    found = [_channel(name, result, log, grids, level) for name, result in channels.items()]
    deviations = [one for one in channels.values() if isinstance(one, Deviation)]
    deviations += [one.deviation for one in channels.values() if isinstance(one, NoiseFit)]
    spectra = [one for one in channels.values() if isinstance(one, Spectrum)]
    about = {
        "name": SENSOR_NAMES[sensor], "level": 100 * level,
        "units": [_unit(sensor, unit, own, channels) for unit, own in _UNITS[sensor].items()],
        "deviation": KINDS.get(deviations[0].kind, deviations[0].kind) if deviations else "",
        "phase": bool(deviations and deviations[0].unit_of_phase), "sided": spectra[0].sided if spectra else 2, "channels": found,
        "duration": float(f"{_duration(channels, log):.7g}"), "grids": grids.kept,
    }  # fmt: skip
    first, *others = _figures(sensor, about)
    static = tag("div", *others, class_="static")
    return first, tag("div", tag("h3", SENSOR_NAMES[sensor]), data(about), static, class_="explore", data_sensor=sensor)


def _unit(sensor: str, unit: str, own: Mapping[str, str], channels: Mapping[str, Any]) -> dict[str, Any]:
    """Label and SI value of a unit, for the readings and for the coefficients."""
    names = dict.fromkeys(term for one in channels.values() for term in getattr(one, "terms", ()))
    terms = {}
    for term in names:
        listed = noise_units(term, sensor)
        chosen = own.get(term) or (listed[-1] if unit == si_unit(sensor) else listed[0])
        chosen = unit if term == "B" else chosen
        terms[term] = [noise_factor(term, sensor, chosen), unit_label(chosen)]
    return {"label": unit_label(unit), "scale": noise_factor("B", sensor, unit) if unit else 1.0, "terms": terms}


def _duration(channels: Mapping[str, Any], log: Log | None) -> float:
    return log.duration if log is not None else max((getattr(one, "duration", 0.0) for one in channels.values()), default=0.0)


def _channel(name: str, result: Any, log: Log | None, grids: _Grids, level: float) -> dict[str, Any]:
    found: dict[str, Any] = {"name": name, "axis": name.partition("_")[2] or name}
    fit = result if isinstance(result, NoiseFit) else None
    deviation = result if isinstance(result, Deviation) else None if fit is None else fit.deviation
    values = None if log is None else log.channels().get(name)
    if deviation is not None:
        found["allan"] = _allan(deviation, fit, grids)
    if fit is not None and deviation is not None:
        found["terms"] = {term: _term(fit, term) for term in fit.terms if term in fit.presence}
        low, at = floor_of(fit)
        found["floor"] = short([at.value, bound_of(low)], 5)
        found["events"] = [[float(f"{start:.5g}"), float(f"{stop:.5g}"), words] for start, stop, words in fit.events]
        fitted = fit.spectrum if fit.spectrum is not None else _of_record(fit, values, deviation.rate)
        if fitted is not None:
            found["spectrum"] = _spectrum(fitted, fit, deviation.rate, grids, level)
    elif isinstance(result, Spectrum):
        points = _extremes(np.asarray(result.frequency), np.asarray(result.density))
        found["spectrum"] = {
            "f": grids.place(result.frequency[points]), "value": short(result.density[points]),
            **{key: grids.place(_ratio(result, key)[points]) for key in ("lower", "upper")},
        }  # fmt: skip
    if values is not None:
        found["signal"] = _signal(values, log.rate, grids)  # type: ignore[union-attr]
    return found


def _ratio(result: Spectrum, key: str) -> np.ndarray:
    """Ratio of the density to a limit of its interval, which is the same for every channel."""
    other = {"lower": result.upper, "upper": result.lower}[key]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.round(np.asarray(result.density) / np.asarray(other), 9)


def _extremes(f: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Indices of all values, or of the lowest and highest value in each range of frequencies, so that spectral lines stay visible."""
    if len(f) <= MOST:
        return np.arange(len(f))
    edges = np.searchsorted(f, np.geomspace(f[0], f[-1], MOST // 2 + 1)[1:-1])
    parts = [(a, values[a:b]) for a, b in zip([0, *edges], [*edges, len(f)], strict=True) if b > a]
    return np.unique([0, len(f) - 1, *(a + int(pick) for a, part in parts for pick in (part.argmin(), part.argmax()))])


def thinned(count: int, most: int = MOST) -> np.ndarray:
    """Indices of at most `most` values, evenly spaced on a logarithmic scale."""
    return np.arange(count) if count <= most else np.unique(np.round(np.geomspace(1, count, most)).astype(int) - 1)


def _allan(deviation: Deviation, fit: NoiseFit | None, grids: _Grids) -> dict[str, Any]:
    points = thinned(len(deviation.tau))
    values = {key: np.asarray(getattr(deviation, key))[points] for key in ("tau", "deviation", "lower", "upper")}
    kept = np.isfinite(values["deviation"]) & (values["deviation"] > 0)
    found: dict[str, Any] = {"tau": grids.place(values["tau"][kept])}
    found |= {name: short(values[key][kept]) for name, key in (("value", "deviation"), ("low", "lower"), ("high", "upper"))}
    if fit is not None:
        found["used"] = grids.place(np.asarray(fit.used, dtype=float)[points][kept])
        m = np.unique(np.round(np.geomspace(deviation.m.min(), deviation.m.max(), FINE)))
        curves = _curves(fit, lambda noise: np.sqrt(np.asarray(noise.avar(m / deviation.rate, dt=1.0 / deviation.rate))))
        found["model"] = {"x": grids.place(m / deviation.rate), **curves}
    return found


def _curves(fit: NoiseFit, curve: Any) -> dict[str, Any]:
    """The curve of the whole model and of each term; an undetected term is drawn at its upper limit."""
    terms = {}
    for term in fit.terms:
        detected = fit.presence.get(term) != "not detected"
        value = float(fit.noise.coefficient(term) if detected else fit.upper_limit[term])
        if 0 < value < math.inf:
            terms[term] = [int(detected), short(curve(fit.noise.only(term, value)))]
    return {"total": short(curve(fit.noise)), "terms": terms}


def _term(fit: NoiseFit, term: str) -> dict[str, Any]:
    low, high = fit.interval[term]
    values = (fit.noise.coefficient(term), low, high, fit.upper_limit[term])
    named = zip(("value", "low", "high", "limit"), short([float(value) for value in values], 6), strict=True)
    return {**dict(named), "verdict": str(fit.presence[term])}


def _of_record(fit: NoiseFit, values: Any, rate: float) -> FittedSpectrum | None:
    """The spectrum of the record with the model, for methods that do not fit a spectrum; None if the record has gaps."""
    if values is None:
        return None
    try:
        found = density(values, rate, method="dct", average="log", keep_tail=True)
    except DataError:  # omit this view; the summary of the log reports the gaps
        return None
    f = np.asarray(found.frequency)
    model = np.asarray(fit.noise.psd(f, dt=1.0 / rate))
    used = (f <= 0.5 / fit.band[0] * (1 + 1e-9)) & (f >= 0.5 / fit.band[1] * (1 - 1e-9))
    return FittedSpectrum(frequency=f, density=np.asarray(found.density), model=model, edf=np.asarray(found.edf), used=used, columns={})


def _spectrum(fitted: FittedSpectrum, fit: NoiseFit, rate: float, grids: _Grids, level: float) -> dict[str, Any]:
    """A few points, each the mean of three or more ordinates, with the chi-square limits of measured over fitted density."""
    f, measured, model, edf, used = (np.asarray(getattr(fitted, key)) for key in ("frequency", "density", "model", "edf", "used"))
    place = np.floor(np.log10(f / f[0]) * _PER_DECADE)
    starts, held = [0], 0.0
    for i in range(len(f)):
        if held >= _FEWEST and (place[i] != place[i - 1] or used[i] != used[i - 1]):
            starts.append(i)
            held = 0.0
        held += edf[i]
    total = np.add.reduceat(edf, starts)

    def mean(values: np.ndarray) -> np.ndarray:
        return np.add.reduceat(edf * values, starts) / total

    ends = [2.0 * scipy.special.gammaincinv(total / 2.0, tail) / total for tail in ((1.0 - level) / 2.0, (1.0 + level) / 2.0)]
    fine = np.geomspace(f[0], min(f[-1], 0.5 * rate), FINE)
    curves = _curves(fit, lambda noise: np.asarray(noise.psd(fine, dt=1.0 / rate)))
    return {
        "f": grids.place(mean(f)), "value": short(mean(measured)), "fit": short(mean(model)), "ratio": short(mean(measured / model)),
        **{key: grids.place(np.round(end, 6)) for key, end in zip(("lower", "upper"), ends, strict=True)},
        "used": grids.place(np.minimum.reduceat(used.astype(float), starts)), "model": {"x": grids.place(fine), "terms": curves["terms"]},
    }  # fmt: skip


def _signal(values: np.ndarray, rate: float, grids: _Grids) -> dict[str, Any]:
    """Lowest, mean and highest value of each stretch minus the mean of the record, in thousandths of the largest."""
    size = -(-len(values) // MOST)
    padded = np.concatenate([values, np.full(-len(values) % size, np.nan)]).reshape(-1, size)
    known = np.isfinite(padded)
    middle = float(np.mean(values[np.isfinite(values)]))
    count = known.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count, np.where(known, padded - middle, 0.0).sum(axis=1) / count, np.nan)
    ends = (np.where(known, padded, np.inf).min(axis=1), np.where(known, padded, -np.inf).max(axis=1))
    low, high = (np.where(count, end - middle, np.nan) for end in ends)
    step = float(max(np.nanmax(high), -np.nanmin(low))) / 1000 or 1.0
    time = (np.arange(len(padded)) + 0.5) * size / rate
    parts = {"low": low, "mean": mean, "high": high}
    whole = {name: [None if x != x else round(x / step) for x in part.tolist()] for name, part in parts.items()}
    return {"t": grids.place(time), "step": float(f"{step:.6g}"), "middle": float(f"{middle:.6g}"), "length": size / rate, **whole}


def _figures(sensor: str, about: dict[str, Any]) -> list[Markup]:
    """The views as static figures in the default unit."""
    unit, channels, grids = about["units"][0], about["channels"], about["grids"]
    scale, label, name = unit["scale"], unit["label"], about["name"]
    names, found = [one["axis"] for one in channels], []

    def get(values: Any, by: float = 1.0) -> np.ndarray:
        values = grids[values] if isinstance(values, int) else values
        return np.array([math.nan if value is None else value for value in values], dtype=float) / by

    if curves := [(i, one["allan"]) for i, one in enumerate(channels) if "allan" in one]:
        unit_y = label + (" s" if about["phase"] else "")
        marks = [Mark("band", get(c["tau"]), get(c["low"], scale), i, get(c["high"], scale)) for i, c in curves]
        for i, c in curves:
            used = get(c["used"]) > 0 if "used" in c else np.ones(len(get(c["tau"])), dtype=bool)
            for there, look in ((used, ""), (~used, "faint")):
                if there.any():
                    marks.append(Mark("dots", get(c["tau"])[there], get(c["value"], scale)[there], i, look=look))
            if "model" in c:
                marks.append(Mark("line", get(c["model"]["x"]), get(c["model"]["total"], scale), i))
        floors = [(i, one["floor"]) for i, one in enumerate(channels) if "floor" in one]
        marks += [Mark("dots", get(at[:1]), get(at[1:], scale), i, look="large faint") for i, at in floors]
        x = log_axis("Cluster time τ (s)", [get(c["tau"]) for _, c in curves])
        y = log_axis(f"{about['deviation']} ({unit_y})", [get(c["value"], scale) for _, c in curves], 2.0)
        said = f"Points: measured, with {about['level']:g} % intervals." + " Lines: fitted model." * any("model" in c for _, c in curves)
        said += " Large: the floor, or its upper limit." * bool(floors)
        found.append(figure(f"{sensor}-allan", f"{name}: {about['deviation']}", said, x, y, marks, names))
    if curves := [(i, one["spectrum"]) for i, one in enumerate(channels) if "spectrum" in one]:
        area = scale**2
        fitted = [(i, c) for i, c in curves if "fit" in c]
        marks = [Mark("line", get(c["f"]), get(c["value"], area), i, look="thin" if fitted else "") for i, c in curves]
        marks += [Mark("line", get(c["f"]), get(c["fit"], area), i) for i, c in fitted]
        x = log_axis("Frequency (Hz)", [get(c["f"]) for _, c in curves], 1.15)
        root = f"({label})" if set(label) & set("/ ") else label
        y = log_axis(f"Density ({root}²/Hz)", [get(c["value"], area) for _, c in curves])
        said = f"{'One' if about['sided'] == 1 else 'Two'}-sided density." + " Thin: measured. Thick: fitted." * bool(fitted)
        found.append(figure(f"{sensor}-spectrum", f"{name}: spectrum", said, x, y, marks, names))
        if fitted:
            first = fitted[0][1]
            marks = [Mark("band", get(first["f"]), get(first["lower"]), "shade", get(first["upper"]))]
            marks += [Mark("line", [x.low, x.high], [1.0, 1.0], "ink", look="thin")]
            marks += [Mark("line", get(c["f"]), get(c["ratio"]), i, look="thin") for i, c in fitted]
            y = log_axis("Measured over fitted density", [[0.4, 2.5], *(get(c["ratio"]) for _, c in fitted)], 1.1)
            said = f"Shaded: {about['level']:g} % of the values, were the model true."
            found.append(figure(f"{sensor}-residual", f"{name}: residual of the fit", said, x, y, marks, names))
    return found
