"""Simulated records of the specification, a smooth record, and errors of a model against the truth in mdeg/s."""

import numpy as np

from jaxcal.temperature import reference_bias, simulate

MDEG = np.deg2rad(1e-3)


def pair(jump, seed, thermometer=0.02):
    """Simulate a training ramp and an independent test ramp with a jump in deg/s."""
    random = np.random.default_rng(seed)
    return tuple(simulate(jump=np.deg2rad(jump), thermometer=thermometer, seed=random) for _ in range(2))


def errors(model, test, jump):
    """Rms error, rms error in 24-25 degC and largest error on the test ramp, without their median, mdeg/s."""
    t = test.true_temperature
    off = (model.curve.value(np.clip(t, model.low, model.high)) - reference_bias(t, np.deg2rad(jump))) / MDEG
    off = off - np.median(off)
    near = (t >= 24) & (t <= 25)
    return np.array([np.sqrt(np.mean(off**2)), np.sqrt(np.mean(off[near] ** 2)), np.abs(off).max()])


def smooth_record(n=1500, degree=2, seed=0, low=10.0, high=40.0, noise=1e-4):
    """Temperature, bias and true bias of a polynomial with white noise."""
    t = np.linspace(low, high, n)
    truth = np.polynomial.polynomial.polyval((t - 25) / 15, [0.01, 0.004, -0.002, 0.001][: degree + 1])
    return t, truth + noise * np.random.default_rng(seed).standard_normal(n), truth
