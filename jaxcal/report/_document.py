"""The noise of every channel as JSON can say it."""

import importlib.metadata
import math
from typing import Any

import numpy as np

from .._errors import DataError
from .._log import Log
from .._results import plain
from .._units import noise_units
from ..noise import NoiseFit

SCHEMA = "jaxcal.noise/1"


def noise_document(results: dict[str, NoiseFit], log: Log | None = None) -> dict[str, Any]:
    """Noise of every channel as a dictionary for JSON."""
    check_results(results)
    first = next(iter(results.values()))
    return {
        "schema": SCHEMA,
        "version": importlib.metadata.version("jaxcal"),
        "rate": number(first.deviation.rate),
        "duration": number(first.duration if log is None else log.duration),
        "provenance": None if log is None else plain(log.provenance),
        "notes": [] if log is None else list(log.notes),
        "warnings": [] if log is None else list(log.warnings),
        "channels": {name: _channel(fit, sensor_of(name)) for name, fit in results.items()},
    }


def check_results(results: Any) -> None:
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
    """Sensor that a channel belongs to: gyro_x -> gyro."""
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
    return {
        **terms,
        "method": fit.method,
        "confidence": number(fit.confidence),
        "band": [number(end) for end in fit.band],
        "left_out": [str(sentence) for sentence in fit.left_out],
        "goodness": number(fit.goodness),
        "warnings": [str(sentence) for sentence in fit.warnings],
        "notes": [str(sentence) for sentence in fit.notes],
        "markov": [[number(strength), number(time)] for strength, time in fit.noise.markov],
        "sinusoid": [[number(amplitude), number(frequency)] for amplitude, frequency in fit.noise.sinusoid],
        **(
            {"shapes": {term.name: {"class": type(term).__name__, **plain(term)} for _, term in fit.noise.further}}
            if fit.noise.further
            else {}
        ),
    }


def number(value: Any) -> float | None:
    """A number as JSON has it: None where it is infinite or not known."""
    value = float(value)
    return value if math.isfinite(value) else None
