"""Noise fits written by hand, so that every field has a chosen value."""

import math

import numpy as np

from jaxcal.allan import Deviation
from jaxcal.fitting import Estimate
from jaxcal.noise import Noise, NoiseFit, NoiseFits

TERMS = ("Q", "N", "B", "K")


def made_deviation(noise, rate=200.0, clusters=40, largest=50_000, **changes):
    """The Allan deviation that the model predicts, with an interval that widens with the cluster time."""
    m = np.unique(np.round(np.geomspace(1, largest, clusters)))
    tau = m / rate
    value = np.sqrt(np.asarray(noise.avar(tau, dt=1 / rate)))
    edf = 2 * largest / m
    fields = {
        "tau": tau, "m": m, "deviation": value, "lower": value / (1 + 1 / np.sqrt(edf)), "upper": value * (1 + 1 / np.sqrt(edf)),
        "edf": edf, "count": edf, "alpha": np.zeros_like(tau), "skipped": np.zeros_like(tau),
        "kind": "oadev", "rate": rate, "confidence": 0.95,
    }  # fmt: skip
    return Deviation(**(fields | changes))


def made_fit(scale=1.0, rate=200.0, **changes):
    """A fit with N present, a hint of B, and neither Q nor K."""
    value = {"Q": 0.0, "N": 1e-4 * scale, "B": 1 / 3 * 1e-5, "K": 0.0}
    noise = changes.get("noise", Noise(**value))
    deviation = changes.get("deviation", made_deviation(noise, rate))
    fields = {
        "noise": noise,
        "interval": {term: (0.9 * value[term], 1.1 * value[term]) for term in TERMS},
        "upper_limit": {"Q": 1e-9, "N": 1.05e-4 * scale, "B": 4e-6, "K": 2e-6},
        "presence": {"Q": "not detected", "N": "present", "B": "hint", "K": "not detected"},
        "significance": dict.fromkeys(TERMS, 1.0),
        "covariance": Estimate(TERMS, np.zeros(4), np.arange(16.0).reshape(4, 4) * 1e-12).covariance,
        "goodness": 0.5,
        "longer_record": {"Q": math.inf, "N": 1.0, "B": 1e6, "K": math.inf},
        "band": (float(deviation.tau[5]), float(deviation.tau[-5])),
        "deviation": deviation,
        "used": (np.arange(len(deviation.tau)) >= 5) & (np.arange(len(deviation.tau)) <= len(deviation.tau) - 5),
        "duration": 3600.0,
        "terms": TERMS,
        "confidence": 0.95,
        "method": "gls",
    }
    return NoiseFit(**(fields | changes))


def made_results():
    """Fits of a gyroscope and an accelerometer."""
    return NoiseFits({f"{sensor}_{axis}": made_fit(1.0 + i) for sensor in ("gyro", "accel") for i, axis in enumerate("xyz")})
