"""Pooling over many devices, with records drawn from densities in this file and not by the simulation of jaxcal."""

import dataclasses

import numpy as np
import pytest
import scipy.fft

import jaxcal
from jaxcal.batch import population
from jaxcal.batch._leaves import of_estimates
from jaxcal.magnetometer import body_field, fit, scenario

RATE = 100.0
SAMPLES = 2**14
#: N in unit/sqrt(Hz), and a bias instability B that only some records of this length show
N, B = 1.0, 0.35


def record(n, b, rng):
    k = np.arange(1, SAMPLES)
    s = 2 * np.sin(np.pi * k / (2 * SAMPLES))
    density = n**2 + b**2 / (RATE * s) * (1 - 2 / (np.pi**2 * k))
    return scipy.fft.idct(np.concatenate([[0.0], np.sqrt(density * RATE) * rng.standard_normal(SAMPLES - 1)]), norm="ortho")


def fleet(seed, devices=16, recordings=1, spread=0.15, repeat=0.0, odd=0.0):
    """Simulate recordings of many devices: true coefficients (all recordings, 2), the fits, and the device of each."""
    rng = np.random.default_rng(seed)
    truth, names = [], []
    for device in range(devices):
        own = np.log([N, B]) + np.array([0.1, spread]) * rng.standard_normal(2)
        if device == 0 and odd:
            own[0] = np.log(N) + 0.1 * odd
        for _ in range(recordings):
            truth.append(np.exp(own + repeat * rng.standard_normal(2)))
            names.append(f"unit {device}")
    return np.array(truth), [jaxcal.noise.fit(record(*row, rng), RATE, terms="NB") for row in truth], names


@pytest.fixture(scope="module")
def one():
    truth, fits, _ = fleet(0)
    return truth, fits, population(fits, terms=("N", "B"))


def test_the_population_halves_the_error_of_what_a_record_hardly_shows(one):
    _, _, found = one
    square = {"raw": [], "pooled": []}
    for truth, fits, _ in (fleet(seed) for seed in range(3)):
        of = population(fits, terms=("N", "B"))
        for name, kept in square.items():
            kept.append(np.log(np.maximum(getattr(of, name), 0.1) / truth) ** 2)
    alone, pooled = (np.sqrt(np.mean(np.concatenate(kept), axis=0)) for kept in square.values())
    assert pooled[1] < 0.6 * alone[1]
    assert pooled[0] < 1.05 * alone[0]  # each record determines N well
    assert np.all((found.median_interval[:, 0] <= [N, B]) & (found.median_interval[:, 1] >= [N, B]))
    assert found.spread_interval[0, 0] < 0.1 < found.spread_interval[0, 1]
    assert found.verdict == "good"
    assert "16 recordings of 16 devices" in found.summary()
    assert found.to_dict()["terms"] == ["N", "B"]


@pytest.mark.long
def test_pooled_intervals_hold_the_truth():
    inside, around, named = [], [], []
    for seed in range(25):
        truth, fits, _ = fleet(seed)
        found = population(fits, terms=("N", "B"), seed=seed)
        inside.append((found.pooled_interval[..., 0] <= truth) & (truth <= found.pooled_interval[..., 1]))
        around.append([low <= true <= high for (low, high), true in zip(found.spread_interval, (0.1, 0.15), strict=True)])
        around[-1] += [low <= true <= high for (low, high), true in zip(found.median_interval, (N, B), strict=True)]
        named.append(np.mean(found.chance < 0.05, axis=0))
    # 400 intervals of 95 % for each coefficient; those of the same devices are correlated
    np.testing.assert_array_less(np.abs(np.mean(inside, axis=(0, 1)) - 0.95), 0.04)
    assert np.mean(around) > 0.95 - 0.07  # 100 intervals of spread and median
    np.testing.assert_array_less(np.abs(np.mean(named, axis=0) - 0.05), 0.04)  # usual devices


def test_an_odd_unit_is_named_and_not_drawn_in():
    _, fits, _ = fleet(3, odd=8.0)
    found = population(fits, terms=("N", "B"), devices=[f"unit {i}" for i in range(16)])
    assert ("unit 0", "N") in found.outliers
    low, high = found.raw_interval[0, 0]
    assert abs(found.raw[0, 0] - found.pooled[0, 0]) < 0.5 * (high - low) / 3.92
    assert ("unit 0", "N") in {(one.facts["device"], one.facts["term"]) for one in found.findings if one.code == "odd"}


@dataclasses.dataclass
class Estimate:
    """A result of another kind of fit, with the attributes that pooling needs."""

    names: tuple
    values: list
    covariance: list


def nested(seed, devices=12, error=0.1):
    """Simulate truth, estimates, device, recording, axis and class.

    The standard deviations are 0.2 of devices, 0.1 of recordings, 0.15 of axes and 0.05 of the rest; the classes differ by 0.3.
    """
    rng = np.random.default_rng(seed)
    device, recording, axis = (index.ravel() for index in np.indices((devices, 3, 3)))
    batch = np.where(np.arange(devices) % 2, "b", "a")[device]
    x = 5.0 + 0.2 * rng.standard_normal(devices)[device] + 0.3 * (batch == "b") + 0.05 * rng.standard_normal(9 * devices)
    x = x + 0.1 * rng.standard_normal((devices, 3))[device, recording] + 0.15 * rng.standard_normal((devices, 3))[device, axis]
    fits = [Estimate(("x", "fixed"), [v, 1.0], np.diag([error**2, 0.0])) for v in x + error * rng.standard_normal(len(x))]
    return x, fits, device, recording, axis, batch


@pytest.mark.long
def test_levels_and_classes_of_estimates_of_other_kinds():
    x, fits, device, recording, axis, batch = nested(1)
    found = population(fits, devices=device, levels={"recording": recording, "axis": axis}, covariates={"batch": batch})
    assert found.terms == ("x",)  # terms that are equal in all fits are left out
    assert found.levels == ("device", "recording", "axis", "rest")
    low, high = found.components_interval[:, 0].T
    assert np.all((low < [0.2, 0.1, 0.15, 0.05]) & (high > [0.2, 0.1, 0.15, 0.05]))
    assert found.covariates == ("batch b",)
    assert found.effect_interval[0, 0, 0] < 0.3 < found.effect_interval[0, 0, 1]
    alone, pooled = (np.sqrt(np.mean((values[:, 0] - x) ** 2)) for values in (found.raw, found.pooled))
    assert pooled < 0.9 * alone
    assert found.median_interval[0, 0] < 5.15 < found.median_interval[0, 1]


@pytest.mark.long
def test_intervals_of_levels_effects_and_the_middle_hold():
    held, pooled, false = [], [], []
    for seed in range(30):
        x, fits, device, recording, axis, batch = nested(seed)
        found = population(fits, devices=device, levels={"recording": recording, "axis": axis}, covariates={"batch": batch}, seed=seed)
        limits = np.concatenate([found.components_interval[:, 0], found.effect_interval[:, 0], found.median_interval])
        truth = np.array([0.2, 0.1, 0.15, 0.05, 0.3, 5.15])
        held.append((limits[:, 0] <= truth) & (truth <= limits[:, 1]))
        pooled.append(np.mean((found.pooled_interval[:, 0, 0] <= x) & (x <= found.pooled_interval[:, 0, 1])))
        false.append(np.mean(found.chance < 0.05))
    assert np.all(np.abs(np.mean(held, axis=0) - 0.95) < 0.12)  # three standard errors of 30
    assert abs(np.mean(pooled) - 0.95) < 0.02
    assert abs(np.mean(false) - 0.05) < 0.035  # usual devices, three standard errors of 360


def test_messages(one, refuses):
    _, fits, _ = one
    other = jaxcal.noise.fit(record(N, B, np.random.default_rng(0)), RATE, terms="NB", method="gls")
    devices = list(range(8)) * 2
    for code, given, options in (
        ("few", fits[:4], {}), ("names", fits, {"devices": ["a", "b"]}), ("terms", fits, {"terms": ("K",)}),
        ("covariate", fits, {"covariates": {"age": np.zeros(16)}}), ("fits", [other] * 6, {}), ("fits", [1] * 6, {}),
        ("level", fits, {"devices": devices, "levels": {"axis": [0] * 8 + [1] * 8}}),
        ("level", fits, {"devices": devices, "levels": {"axis": [0] * 16}}), ("names", fits, {"levels": {"axis": [0, 1]}}),
    ):  # fmt: skip
        with refuses(code):
            population(given, **options)


def test_magnetometers_have_the_parameters_of_their_estimate():
    rng, h = np.random.default_rng(0), body_field(scenario("all", samples=60), 50e-6)
    offsets = 1e-5 * rng.normal(size=(4, 3))
    fits = [fit(h + 1e-7 * rng.normal(size=h.shape) + offset, model="symmetric") for offset in offsets]
    names = tuple(f"hard_iron[{i}]" for i in range(3))
    leaves = of_estimates(fits, names, 0.95)
    assert leaves.names == names
    np.testing.assert_allclose(leaves.raw, [one.model.hard_iron for one in fits])
    assert np.mean((leaves.interval[..., 0] < offsets) & (offsets < leaves.interval[..., 1])) > 0.7
