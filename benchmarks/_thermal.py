"""Records of a sensor whose bias depends on temperature, made without jaxcal, and results of `jaxcal.temperature.fit` for them.

Units are arbitrary: a curve of about 15, and noise at one sample per second. Steps are error functions, which the estimator does not
assume, and flicker is a sum of first-order processes.
"""

import math

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.special import erf

from jaxcal.temperature import fit

LOW, HIGH, PERIOD = 20.0, 45.0, 4500
JUMPS = {"none": (), "one": ((3.0, 24.0, 0.12),), "two": ((3.0, 24.0, 0.12), (-2.0, 36.0, 0.25))}
#: N, B and K for the cases with jumps, and for the comparison of models, unit/sqrt(Hz) and so on
QUIET, LOUD = (0.3, 0.1, 0.003), (1.0, 0.3, 0.01)
TAUS = 10 ** np.arange(-0.5, 6.5, 0.25)
LENGTH, SPREAD = 8.0, 4.0  # degC and unit: length and standard deviation of random curves


def temperature(count, period=PERIOD):
    """A sine between LOW and HIGH."""
    return (LOW + HIGH) / 2 + (HIGH - LOW) / 2 * np.sin(2 * np.pi * np.arange(count) / period)


def flicker_variance(b):
    """Variance of each first-order process, such that the sum of their densities is B^2/(2 pi f)."""
    return b**2 * 0.25 * math.log(10) / math.pi


def noise(count, level, rng):
    """White noise, flicker and a random walk."""
    n, b, k = level
    total = n * rng.standard_normal(count) + np.cumsum(k * rng.standard_normal(count))
    for tau in TAUS if b else ():
        keep = math.exp(-1 / tau)
        steps = rng.standard_normal(count) * math.sqrt(flicker_variance(b) * (1 - keep**2))
        steps[0] = rng.standard_normal() * math.sqrt(flicker_variance(b))
        total += lfilter([1.0], [1.0, -keep], steps)
    return total


def kernel(a, b):
    """Covariance of random curves."""
    return SPREAD**2 * np.exp(-0.5 * ((a[:, None] - b) / LENGTH) ** 2)


def smooth(rng=None):
    """A curve of about 15 between LOW and HIGH: a fixed one, or with `rng` a random one with covariance `kernel`."""
    if rng is None:
        return lambda t: (
            5 * (t - 32.5) / 12.5 - 2.5 * ((t - 32.5) / 12.5) ** 2 + 1.5 * ((t - 32.5) / 12.5) ** 3 + 0.8 * np.exp((t - 32.5) / 12.5)
        )
    grid = np.linspace(LOW - 1, HIGH + 1, 200)
    size, axes = np.linalg.eigh(kernel(grid, grid))
    return CubicSpline(grid, axes @ (np.sqrt(np.maximum(size, 0)) * rng.standard_normal(len(grid))))


def steps(t, jumps):
    """The sum of the jumps (height, centre, width)."""
    return sum((0.5 * h * (1 + erf((t - c) / (w * math.sqrt(2)))) for h, c, w in jumps), np.zeros(len(t)))


def counted(case, run, *, thermometer=0.01, random=True):
    """Number of jumps found minus true number, and errors of the heights of true jumps over their standard errors."""
    rng = np.random.default_rng([21, run])
    curve, true = smooth(rng if random else None), temperature(PERIOD)
    bias = curve(true) + steps(true, JUMPS[case]) + noise(PERIOD, QUIET, rng)
    found = fit(true + thermometer * rng.standard_normal(PERIOD), bias, time=np.arange(PERIOD))
    errors = []
    for height, centre, _ in JUMPS[case]:
        near = [step for step in found.steps if abs(step.centre - centre) < 0.5]
        if len(near) == 1:
            errors.append((near[0].height - height) / near[0].height_error)
    return len(found.steps) - len(JUMPS[case]), errors


def rate(run, thermometer=0.02):
    """Rms residuals on the next cycle, without their mean: of a static model, and of the default fit, for a bias that follows dT/dt."""
    rng, count = np.random.default_rng([22, run]), 2 * PERIOD
    true = temperature(count)
    change = np.gradient(true)
    truth = smooth()(true) + 4.2 / np.std(change) * change
    measured = true + thermometer * rng.standard_normal(count)
    bias, time = truth + noise(count, QUIET, rng), np.arange(count)
    first, last = slice(0, PERIOD), slice(PERIOD, count)
    found = fit(measured[first], bias[first], time=time[first])
    static = fit(measured[first], bias[first], time=time[first], model="polynomial", degree=5)
    return tuple(np.std((bias - one.model.correct(bias, measured, time=time) - truth)[last]) for one in (static, found))


def compared(run, random, level=LOUD, block=5):
    """Rms error of each model on the next cycle, without its mean, and shares of truth and of readings inside the intervals."""
    rng, count = np.random.default_rng([23, run]), 2 * PERIOD
    curve, true = smooth(rng if random else None), temperature(count)
    wander = noise(count, level, rng)
    measured, bias, time = true + 0.01 * rng.standard_normal(count), curve(true) + wander, np.arange(count)
    t, b, test = measured[:PERIOD], bias[:PERIOD], true[PERIOD::10]
    found = fit(t, b, time=time[:PERIOD])
    values = {"auto": found.model.curve.value(np.clip(test, found.model.low, found.model.high))}
    for name, degree in (("polynomial 3", 3), ("polynomial 5", 5), ("table", None)):
        values[name] = fit(t, b, time=time[:PERIOD], model=name.split()[0], degree=degree).model.curve.value(test)
    values.update(processes(t, b, test, level, block))
    errors = {name: float(np.std(value - curve(test))) for name, value in values.items()}
    grid = np.linspace(LOW + 0.2, HIGH - 0.2, 99)
    low, high = found.interval_at(grid)
    truth = curve(grid) + wander[:PERIOD].mean()
    place = np.floor((true[PERIOD:] - true.min()) / 0.1 + 1e-9).astype(int)
    readings = np.bincount(place, bias[PERIOD:]) / np.bincount(place)
    bottom, top = found.prediction_at(np.bincount(place, true[PERIOD:]) / np.bincount(place))
    return errors, float(np.mean((low <= truth) & (truth <= high))), float(np.mean((bottom <= readings) & (readings <= top)))


def processes(t, b, test, level, block):
    """Gaussian processes that know the kernel of the curve, with N, B and K by maximum likelihood, and with the true N, B and K."""
    size = len(t) // block
    middle = (np.arange(size) + 0.5) * block
    t, b = (x.reshape(size, block).mean(axis=1) for x in (t, b))
    walk, flicker, curve = np.minimum(middle[:, None], middle), np.zeros((size, size)), kernel(t, t)
    for tau in TAUS:
        each = np.exp(-np.abs(middle[:, None] - middle) / tau) if tau > 1 else np.eye(size) * 2 * tau / block
        flicker += flicker_variance(1.0) * each

    def factor(n, b, k):
        return cho_factor(np.eye(size) * n**2 / block + b**2 * flicker + k**2 * walk + 1e4 + curve)

    def cost(logarithms):
        root = factor(*np.exp(logarithms))
        return 0.5 * b @ cho_solve(root, b) + np.sum(np.log(np.diag(root[0])))

    best = minimize(cost, np.log(np.maximum(level, 1e-9)), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.02, "maxiter": 150})
    known = {"true kernel": np.exp(best.x), "true kernel and noise": level}
    return {name: kernel(test, t) @ cho_solve(factor(*noises), b) for name, noises in known.items()}


def late(true, tau):
    """What a sensor feels that follows with a time constant in s, at one sample per second."""
    return lfilter([1 - math.exp(-1 / tau)], [1.0, -math.exp(-1 / tau)], true - true[0]) + true[0]


def doubtful(case, run):
    """Share of the curve inside its intervals, rms left on the next cycle, verdict and findings, for what no model of the package has."""
    rng, count = np.random.default_rng([25, run]), 2 * PERIOD
    true, time, curve = temperature(count), np.arange(count), smooth(rng)
    felt = [true] if case != "two lags" else [late(true, tau) for tau in (30.0, 120.0)]
    wander = noise(count, QUIET, rng) + (2.0 * time / count if case == "ageing" else 0.0)
    bias = np.mean([curve(one) for one in felt], axis=0) + wander
    measured = true + 0.01 * rng.standard_normal(count)
    measured = np.round(measured * 4) / 4 if case == "coarse thermometer" else measured
    found = fit(measured[:PERIOD], bias[:PERIOD], time=time[:PERIOD])
    grid = np.linspace(LOW + 0.5, HIGH - 0.5, 99)
    low, high = found.interval_at(grid)
    truth = curve(grid) + wander[:PERIOD].mean()
    left = found.model.correct(bias, measured, time=time) - wander
    return float(np.mean((low <= truth) & (truth <= high))), float(np.std(left[PERIOD:])), found.verdict, sorted(found.codes)


def lagging(run, thermometer=0.02, tau=60.0):
    """Rms error in mdeg/s on the second cycle of the case "lag" (jump of 300 mdeg/s, noise of 4, lag of 60 s), and the lag found."""
    rng, count = np.random.default_rng([24, run]), 2 * PERIOD
    true = temperature(count)
    felt = late(true, tau)
    x = (felt - 32.5) / 12.5
    truth = 50 + 120 * x - 60 * x**2 + 40 * x**3 + 300 / (1 + np.exp(-(felt - 24.5) / 0.08))
    bias, time = truth + 4 * rng.standard_normal(count), np.arange(count)
    measured = true + thermometer * rng.standard_normal(count)
    found = fit(measured[:PERIOD], bias[:PERIOD], time=time[:PERIOD])
    left = (bias - found.model.correct(bias, measured, time=time) - truth)[PERIOD:]
    return float(np.sqrt(np.mean(left**2))), float(found.model.lag)
