"""Combine the noise of three axes to the single density and random walk that most filters use."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import ExportError
from .._types import AnyArray
from .._units import si_unit
from ..calibration import Calibration, DeviceNoise, SensorNoise
from ._options import SENSORS, UNITS, Options, is_positive, number, numbers

#: a filter's name -> term of the noise model, and its name in messages
_QUANTITIES = {"density": ("N", "noise density"), "random_walk": ("K", "random walk")}
_DROPPED = {"Q": "quantisation", "B": "bias instability", "R": "ramp", "markov": "Gauss-Markov", "sinusoid": "sinusoid"}


class Isotropic(eqx.Module):
    """Noise for most filters: one density (N) and one random walk (K) for each sensor, SI per sqrt(Hz), after `inflate`."""

    values: dict[tuple[str, str], float]  # (quantity, sensor) -> number
    rate: float
    facts: tuple[str, ...]  # origin of the values; the accelerometer comes first, also in the warnings
    warnings: tuple[str, ...]


def isotropic(calibration: Calibration, options: Options, why: str) -> Isotropic:
    """Density and random walk of both sensors, and the rate; refused if one is unknown. `why` says what depends on the rate."""
    noise = noise_of(calibration)
    combine = np.max if options.axis == "worst" else lambda values: np.sqrt(np.mean(values**2))
    values, facts, warnings = {}, [], []
    for sensor, name in SENSORS.items():
        n, k, how, said = per_axis(noise, sensor, options)
        values |= {("density", sensor): float(combine(n)), ("random_walk", sensor): float(combine(k))}
        facts = [f"{name}: {options.axis} axis; {how}", *facts]
        warnings = [*said, *warnings]
    rate, said = rate_of(noise, calibration, options, why)
    return Isotropic(values, rate, tuple(facts), (*warnings, *said))


def stored_noise(sensor: str, **terms: Any) -> dict[str, Any]:
    """Noise of a sensor with these terms, in the form for `Calibration`."""
    return {"unit": si_unit(sensor), **dict.fromkeys("QNBKR"), **terms}


def noise_of(calibration: Calibration) -> DeviceNoise:
    """Noise of the device; refused if the calibration has none."""
    if calibration.noise is None:
        raise ExportError(
            "the calibration holds no noise; run jaxcal noise on a log of the sensor at rest, whose calibration.json holds it",
            code="no_noise",
        )
    return calibration.noise


def per_axis(noise: DeviceNoise, sensor: str, options: Options) -> tuple[AnyArray, AnyArray, str, tuple[str, ...]]:
    """N and K of the three axes of a sensor after `inflate`, their origin, and warnings."""
    n, n_source, n_warnings = _axes(noise, sensor, "density", options)
    k, k_source, k_warnings = _axes(noise, sensor, "random_walk", options)
    about = f"per axis N = {numbers(n)}{n_source}; K = {numbers(k)}{k_source}"
    about += f"; multiplied by {number(options.inflate)}" if options.inflate != 1 else ""
    warnings = (*n_warnings, *k_warnings, *_dropped(_measured(noise, sensor), sensor))
    return n * options.inflate, k * options.inflate, about, warnings


def rate_of(noise: DeviceNoise, calibration: Calibration, options: Options, why: str) -> tuple[float, list[str]]:
    """Sampling rate to write in Hz, with a warning if it was only estimated; `why` says what depends on it."""
    if options.rate is not None:
        return float(options.rate), []
    if (calibration.provenance or {}).get("rate") == "given":
        return noise.rate, []
    return noise.rate, [
        f"the rate {number(noise.rate)} Hz is that of the log, estimated from its stamps; {why}: give the rate if you know it"
    ]


def _measured(noise: DeviceNoise, sensor: str) -> SensorNoise:
    found = getattr(noise, sensor)
    if found is None:
        raise ExportError(
            f"the calibration holds no {SENSORS[sensor]} noise; characterise a static log that has {sensor} readings", code="no_noise"
        )
    return found


def _axes(device: DeviceNoise, sensor: str, quantity: str, options: Options) -> tuple[np.ndarray, str, list[str]]:
    """N or K of the three axes, its origin if it is not the fit, and warnings."""
    noise, (term, name) = _measured(device, sensor), _QUANTITIES[quantity]
    missing = _not_found(noise, term)
    asked: Any = getattr(options, quantity)
    if isinstance(asked, dict):
        asked = asked.get(sensor, "upper_limit")
    elif is_positive(asked):
        asked = _for_one_sensor(device, asked, sensor, quantity)
    if is_positive(asked):
        warning = f"the {name} of the {SENSORS[sensor]} is the value given: {asked:g} {UNITS[quantity][sensor]}"
        return np.full(3, float(asked)), " (given, not measured)", [warning]
    values = np.full(3, np.nan) if getattr(noise, term) is None else np.array(getattr(noise, term))
    if not missing:
        return values, "", []
    names = ", ".join(f"{sensor}_{'xyz'[i]}" for i in missing)
    if asked is None:
        flicker = "" if term == "N" else ". Bias instability B is not a random walk and is not written as one"
        raise ExportError(
            f'no {name} {term} was found on {names}; fit a longer record, or give {quantity}="upper_limit" or a value in '
            f"{UNITS[quantity][sensor]}{flicker}",
            code="not_detected",
        )
    limits = (noise.upper_limit or {}).get(term, np.full(3, np.nan))
    values[missing] = limits[missing]
    if not np.all(np.isfinite(values) & (values > 0)):
        raise ExportError(f"no upper limit of {term} is known on {names}; give a value, {quantity}={{{sensor!r}: ...}}", code="no_limit")
    limit = f"{100 * noise.confidence:g} % upper limit" if noise.confidence else "upper limit"
    return values, f" ({limit} on {names})", [f"{term} was not found on {names}: its {limit} is written"]


def _not_found(noise: SensorNoise, term: str) -> list[int]:
    """Axes on which a term is zero, unknown, or not certain."""
    values = getattr(noise, term)
    if values is None:
        return [0, 1, 2]
    verdict = (noise.verdict or {}).get(term, ("present",) * 3)
    return [i for i in range(3) if verdict[i] != "present" or not values[i] > 0]


def _for_one_sensor(device: DeviceNoise, value: float | int, sensor: str, quantity: str) -> float | int | None:
    """Return a single number for the one sensor without this quantity, else None; refuse it if the sensor is ambiguous."""
    term, name = _QUANTITIES[quantity]
    lacking = [other for other in SENSORS if _not_found(_measured(device, other), term)]
    if len(lacking) != 1:
        state = f"both sensors lack a {name}" if lacking else f"both sensors have a {name} of their own"
        raise ExportError(f'{quantity}={value!r}: {state}; say for which it is, as {{"gyro": ...}} or {{"accel": ...}}', code="ambiguous")
    return value if lacking == [sensor] else None


def _dropped(noise: SensorNoise, sensor: str) -> list[str]:
    found = []
    for name, words in _DROPPED.items():
        values = getattr(noise, name)
        verdict = (noise.verdict or {}).get(name, ("present",) * 3)
        known = () if values is None or name in ("markov", "sinusoid") else zip(values, verdict, strict=True)
        if any(v > 0 and kind != "not detected" for v, kind in known) or (values is not None and len(name) > 1):
            found.append(f"{words} {name}" if len(name) == 1 else words)
    if not found:
        return []
    return [f"{SENSORS[sensor]}: {', '.join(found)} not written, for there is no place for it; a larger inflate can cover it"]
