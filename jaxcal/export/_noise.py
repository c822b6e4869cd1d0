"""Combine the noise of three axes to the single density (N) and random walk (K) that most filters use."""

from typing import Any, NamedTuple

import numpy as np

from .._answer import Finding
from .._errors import ExportError
from .._message import Message
from .._types import AnyArray
from ..budget import increments
from ..calibration import Calibration, DeviceNoise, SensorNoise
from ._findings import FINDINGS
from ._formats import SENSORS
from ._options import UNITS, numbers

_LEFT_OUT = {"Q": "quantisation Q", "B": "bias instability B", "R": "ramp R", "markov": "Gauss-Markov", "sinusoid": "sinusoid"}


class Isotropic(NamedTuple):
    """Noise for most filters: one N and one K for each sensor, SI per sqrt(Hz), under the motion if one is given."""

    values: dict[tuple[str, str], float]  # (term, sensor) -> number
    rate: float
    facts: tuple[str, ...]  # origin of the values; the accelerometer comes first
    findings: list[Finding]


def isotropic(calibration: Calibration, options: Any, use: str) -> Isotropic:
    """N and K of both sensors, and the rate; refused if one is unknown. `use` says what depends on the rate."""
    noise = noise_of(calibration)
    combine = np.max if options.axis == "worst" else lambda values: np.sqrt(np.mean(values**2))
    values, facts, found = {}, [], []
    for sensor, (n, k, how, said) in per_sensor(calibration, options).items():
        values |= {("N", sensor): float(combine(n)), ("K", sensor): float(combine(k))}
        facts.append(f"{SENSORS[sensor]}: {options.axis} axis; {how}")
        found += said
    rate, said = rate_of(noise, calibration, options, use)
    return Isotropic(values, rate, tuple(facts), [*found, *said])


def noise_of(calibration: Calibration) -> DeviceNoise:
    """Noise of the device; refused if the calibration has none."""
    if calibration.noise is None:
        raise ExportError("the calibration holds no noise; run jaxcal noise on a log of the sensor at rest", code="no_noise")
    return calibration.noise


def per_sensor(calibration: Calibration, options: Any) -> dict[str, tuple[AnyArray, AnyArray, str, list[Finding]]]:
    """Sensor -> N and K of its three axes, N under the motion if one is given, their origin, and findings."""
    found = {sensor: _per_axis(noise_of(calibration), sensor, options) for sensor in ("accel", "gyro")}
    moved = under_motion(calibration, options)
    return {sensor: (moved[sensor][0] * n, k, how + moved[sensor][1], said) for sensor, (n, k, how, said) in found.items()}


def under_motion(calibration: Calibration, options: Any) -> dict[str, tuple[float, str]]:
    """By what N of each sensor that has one has to be multiplied under the motion, and how that came about."""
    groups = {"gyro": "tilt", "accel": "velocity"}
    if options.motion is None:
        return dict.fromkeys(groups, (1.0, ""))
    if options.window > options.motion.duration:
        raise ExportError(f"the motion lasts {options.motion.duration:g} s, less than a window", code="window")
    told, found = increments(calibration, options.motion, windows=[options.window]), {}
    for sensor in (one for one in groups if f"{one} N" in told.contributions):
        times, shares = float(told.factor(sensor)[0]), told.largest(groups[sensor], options.window)
        causes = f"{groups[sensor]} from {', '.join(f'{cause} {100 * share:.0f} %' for cause, share in shares)}"
        found[sensor] = times, f"; N times {times:.4g} for increments over {options.window:g} s under the motion ({causes})"
    return found


def _per_axis(device: DeviceNoise, sensor: str, options: Any) -> tuple[AnyArray, AnyArray, str, list[Finding]]:
    """N and K of the three axes of a sensor, their origin, and findings."""
    noise = getattr(device, sensor)
    if noise is None:
        raise ExportError(f"the calibration holds no noise of the {SENSORS[sensor]}; its log had none", code="no_noise")
    n, n_source, n_said = _or_limit(noise, sensor, "N", "upper_limit")
    k, k_source, k_said = _or_limit(noise, sensor, "K", options.random_walk)
    about = f"per axis N = {numbers(n)}{n_source}; K = {numbers(k)}{k_source}"
    return n, k, about, [*n_said, *k_said, *_left_out(noise, sensor)]


def rate_of(noise: DeviceNoise, calibration: Calibration, options: Any, use: str) -> tuple[float, list[Finding]]:
    """Sampling rate to write in Hz, with a finding if it was only estimated; `use` says what depends on it."""
    if options.rate is not None:
        return float(options.rate), []
    given = (calibration.provenance or {}).get("rate") == "given"
    return noise.rate, [] if given else [FINDINGS("rate_estimated", rate=noise.rate, use=use)]


def _or_limit(noise: SensorNoise, sensor: str, term: str, asked: Any) -> tuple[np.ndarray, str, list[Finding]]:
    """N or K of the three axes, or its upper limit where it was not found; its origin if it is not the fit, and findings."""
    if isinstance(asked, dict) and sensor in asked:
        value = float(asked[sensor])
        return np.full(3, value), " (given, not measured)", [FINDINGS("given", sensor, value=value, unit=UNITS[term][sensor])]
    values = np.full(3, np.nan) if getattr(noise, term) is None else np.array(getattr(noise, term))
    verdict = (noise.verdict or {}).get(term, ("present",) * 3)
    missing = [i for i in range(3) if verdict[i] != "present" or not values[i] > 0]
    if not missing:
        return values, "", []
    channels = [f"{sensor}_{'xyz'[i]}" for i in missing]
    names = ", ".join(channels)
    if asked is None:
        said = 'no {term} was found on {names}; fit a longer record, or give {option.random_walk} "upper_limit" or a number'
        raise ExportError(Message(said, term=term, names=names), code="not_detected")
    limits = (noise.upper_limit or {}).get(term, np.full(3, np.nan))
    values[missing] = limits[missing]
    said = [FINDINGS("dead_axis", f"{sensor}_{'xyz'[i]}", term=term) for i in missing if not np.isfinite(values[i])]
    if len(said) < 3:  # a dead axis costs only itself
        values[~np.isfinite(values)] = np.nanmax(values)
    if not np.all(np.isfinite(values) & (values > 0)):
        said = Message("no upper limit of {term} is known on {names}; give {option.random_walk}", term=term, names=names)
        raise ExportError(said, code="no_limit")
    limit = f"{100 * noise.confidence:g} % upper limit" if noise.confidence else "upper limit"
    known = [name for name in channels if name not in {one.subject[0] for one in said}]
    said += [FINDINGS("limit_written", known, term=term, limit=limit)] if known else []
    return values, f" ({limit} on {', '.join(known)})" if known else "", said


def _left_out(noise: SensorNoise, sensor: str) -> list[Finding]:
    found = []
    for name, words in _LEFT_OUT.items():
        values = getattr(noise, name)
        verdict = (noise.verdict or {}).get(name, ("present",) * 3)
        if values is not None and (name in ("markov", "sinusoid") or np.any((values > 0) & (np.array(verdict) != "not detected"))):
            found.append(words)
    return [FINDINGS("terms_left_out", sensor, terms=", ".join(found))] if found else []
