"""Noise of one device: the coefficients of every sensor and, if they were fitted, their uncertainty and verdicts."""

import math
from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from .._errors import DataError
from .._units import si_unit
from ..noise import NoiseFit, Term
from ._codec import LARGEST, checked_unit, document_of, structured, wrong
from ._thermal import AXES, CHANNELS, SENSORS

TERMS = ("Q", "N", "B", "K", "R")
Axes = Float[np.ndarray, "3"]


class NoiseCovariance(eqx.Module):
    """Covariance of squared coefficients, for each axis."""

    parameters: tuple[str, ...]
    values: Float[np.ndarray, "3 _ _"]


class FurtherTerm(eqx.Module):
    """A user's term, and its coefficients on the three axes; NaN for an axis that was not measured."""

    term: Term
    coefficient: Axes

    def to_document(self) -> dict[str, Any]:
        """The term with its class, and the coefficients."""
        return {"term": document_of(self.term, Term, "noise.further.term"), "coefficient": self.coefficient}


class SensorNoise(eqx.Module):
    """Noise of the three axes of one sensor: SI, two-sided densities, as in `jaxcal.noise.Noise`.

    Attributes
    ----------
    unit : SI unit of the readings.
    Q, N, B, K, R : (3,) coefficients, NaN for an axis that was not measured; None if no axis was.
    method, confidence : method of the fit, and level of intervals and limits. These and the fields below are None if the coefficients do
        not come from a fit.
    low, high, upper_limit : term -> (3,).
    verdict : term -> ("present", "hint" or "not detected", None for an axis that was not measured) for the three axes.
    covariance : `parameters` ("N^2", ...) and `values` (3, terms, terms) of the squared coefficients.
    markov, sinusoid : for each axis ((qc, Tc), ...) and ((A, f0), ...).
    further : terms defined by the user (`jaxcal.noise.Term`), with their coefficients.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = {"unit": "rad/s", "Q": None, "N": [1e-4] * 3, "B": None, "K": [2e-6] * 3, "R": None}
    >>> device = jaxcal.Calibration(noise={"rate": 200.0, "gyro": gyro})
    >>> device.noise.gyro.unit, device.noise.gyro.N.tolist()
    ('rad/s', [0.0001, 0.0001, 0.0001])
    """

    unit: str
    Q: Axes | None
    N: Axes | None
    B: Axes | None
    K: Axes | None
    R: Axes | None
    method: str | None = None
    confidence: float | None = None
    low: dict[str, Axes] | None = None
    high: dict[str, Axes] | None = None
    upper_limit: dict[str, Axes] | None = None
    verdict: dict[str, tuple[str | None, ...]] | None = None
    covariance: NoiseCovariance | None = None
    markov: tuple[tuple[tuple[float, ...], ...], ...] | None = None
    sinusoid: tuple[tuple[tuple[float, ...], ...], ...] | None = None
    further: tuple[FurtherTerm, ...] | None = None


class DeviceNoise(eqx.Module):
    """Noise of the sensors of one device, and the sampling rate in Hz of the recording, that of its fastest sensor.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = {"unit": "rad/s", "Q": None, "N": [1e-4] * 3, "B": None, "K": [2e-6] * 3, "R": None}
    >>> device = jaxcal.Calibration(noise={"rate": 200.0, "gyro": gyro})
    >>> device.noise.rate, device.noise.accel
    (200.0, None)
    """

    rate: float
    gyro: SensorNoise | None = None
    accel: SensorNoise | None = None
    mag: SensorNoise | None = None


def device_noise(noise: Any) -> DeviceNoise | None:
    """The noise of a device, from the fits of its channels or from the stored form, checked."""
    if noise is None or isinstance(noise, DeviceNoise):
        return noise
    if isinstance(noise, Mapping) and noise and all(isinstance(fit, NoiseFit) for fit in noise.values()):
        noise = _stored_form(noise)
    found = structured(noise, DeviceNoise, "noise")
    if not 0 < found.rate < LARGEST:
        raise wrong(found.rate, "the sampling rate in Hz", "noise.rate")
    for sensor in SENSORS:
        held = getattr(found, sensor)
        if held is None:
            continue
        checked_unit(noise[sensor], si_unit(sensor), f"noise.{sensor}")
        for term in TERMS:
            values = getattr(held, term)
            if values is not None and np.any((values < 0) | (values > LARGEST)):
                raise wrong(values.tolist(), f"coefficients from 0 to {LARGEST:g}, or None", f"noise.{sensor}.{term}")
    return found


def _stored_form(fits: Mapping[str, NoiseFit]) -> dict[str, Any]:
    for name in fits:
        if name not in CHANNELS:
            raise DataError(f"noise holds a channel {name!r}; expected those of a log: {', '.join(CHANNELS)}", code="channel")
    rates = {name.partition("_")[0]: float(fit.deviation.rate) for name, fit in fits.items()}
    if any(float(fit.deviation.rate) != rates[name.partition("_")[0]] for name, fit in fits.items()):
        raise DataError("the axes of one sensor have different rates; give the fits of one recording", code="rates")
    stored: dict[str, Any] = {"rate": max(rates.values())}  # a sensor may be slower than its log
    for sensor in SENSORS:
        axes = [fits.get(f"{sensor}_{axis}") for axis in AXES]
        if any(fit is not None for fit in axes):
            stored[sensor] = _stored_sensor(sensor, axes)
    return stored


def _stored_sensor(sensor: str, axes: list[NoiseFit | None]) -> dict[str, Any]:
    measured = [fit for fit in axes if fit is not None]
    terms, method, confidence = measured[0].terms, measured[0].method, measured[0].confidence
    if any((fit.terms, fit.method, fit.confidence) != (terms, method, confidence) for fit in measured):
        raise DataError(f"the axes of {sensor} have different terms, methods or confidence; fit them in one call", code="terms_differ")
    if not all(fit.presence for fit in measured):
        raise DataError(f"method {method!r} gives {sensor} no intervals and no verdicts; fit it with whittle or gls", code="no_intervals")

    def per_term(value, missing: Any = math.nan) -> dict[str, list]:
        return {term: [missing if fit is None else value(fit, term) for fit in axes] for term in terms}

    def pairs(process: str) -> list | None:
        found = [[] if fit is None else [[float(x) for x in pair] for pair in getattr(fit.noise, process)] for fit in axes]
        return found if any(found) else None

    coefficients = per_term(lambda fit, term: float(fit.noise.coefficient(term)))
    own = [term for _, term in measured[0].noise.further if term.name in terms]
    unknown = np.full((len(terms), len(terms)), math.nan)
    covariances = [unknown if fit is None else fit.covariance.array for fit in axes]
    known = {term: values for term, values in coefficients.items() if term in TERMS}
    return {
        "unit": si_unit(sensor), **dict.fromkeys(TERMS), **known, "method": method, "confidence": confidence,
        "low": per_term(lambda fit, term: float(fit.interval[term][0])),
        "high": per_term(lambda fit, term: float(fit.interval[term][1])),
        "upper_limit": per_term(lambda fit, term: float(fit.upper_limit[term])),
        "verdict": per_term(lambda fit, term: str(fit.presence[term]), missing=None),
        "covariance": {"parameters": [f"{term}^2" for term in terms], "values": covariances},
        "markov": pairs("markov"), "sinusoid": pairs("sinusoid"),
        "further": [{"term": term, "coefficient": coefficients[term.name]} for term in own] or None,
    }  # fmt: skip
