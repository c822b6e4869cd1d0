"""Noise with heavy tails or changing level: N of the core, of Student's t, and of each part."""

import numpy as np
import pytest

import jaxcal

RATE, SAMPLES, RUNS = 100.0, 2**14, 8


LAWS = {
    "contaminated": (1.0, lambda random: random.standard_normal(SAMPLES) * np.where(random.random(SAMPLES) < 0.09, 12.0, 1.0)),
    "another contamination": (
        1.0,
        lambda random: random.standard_normal(SAMPLES) + (random.random(SAMPLES) < 0.09) * random.laplace(0, 15, SAMPLES),
    ),
    "uniform bursts": (
        1.0,
        lambda random: random.standard_normal(SAMPLES) + (random.random(SAMPLES) < 0.09) * random.uniform(-10, 10, SAMPLES),
    ),
    "Student": (3.0**0.5, lambda random: random.standard_t(3, SAMPLES)),
    "normal": (1.0, lambda random: random.standard_normal(SAMPLES)),
}


@pytest.mark.parametrize("law", [pytest.param(law, marks=[pytest.mark.long] * (law != "contaminated")) for law in LAWS])
def test_n_of_the_core_is_found_and_covered(law):
    truth, draw = LAWS[law]
    found = [jaxcal.noise.fit(draw(np.random.default_rng(seed)), RATE, robust=True) for seed in range(RUNS)]
    values = np.array([float(one.noise.N) for one in found]) * RATE**0.5 / truth
    assert abs(np.median(values) - 1.0) < 0.03
    inside = [one.interval["N"][0] <= truth / RATE**0.5 <= one.interval["N"][1] for one in found]
    assert sum(inside) >= RUNS - 2  # of eight intervals of 95 %, three or more miss the truth with a probability of 1 in 175
    said = ["heavy" in one.codes for one in found]
    assert sum(said) == (0 if law == "normal" else RUNS)


def test_tails_leave_slow_noise():
    slow = jaxcal.noise.Noise(B=1.0, K=0.3)
    ratios = []
    for seed in range(4):
        y = LAWS["contaminated"][1](np.random.default_rng(seed)) + slow.simulate(SAMPLES, RATE, seed=seed)
        ratios.append(float(jaxcal.noise.fit(y, RATE, robust=True).noise.B))
    assert 0.6 < np.mean(ratios) < 1.4


@pytest.mark.parametrize("share", [0.5, 0.3])
def test_a_level_that_doubles_is_two_levels_and_n_is_present(share):
    for seed in range(4):
        y = np.random.default_rng(seed).standard_normal(SAMPLES)
        y[int(share * SAMPLES) :] *= 2.0
        found = jaxcal.noise.fit(y, RATE)
        assert found.presence["N"] == "present"
        (told,) = [one for one in found.findings if one.code == "level"]
        levels = np.array(told.facts["ratios"]) * float(found.noise.N) * RATE**0.5
        assert np.allclose(levels, [1.0, 2.0], rtol=0.03)  # a part of 5,000 samples has a standard error of 1 %
        assert found.presence["B"] != "present"
        assert found.presence["K"] != "present"


def test_a_robust_fit_refuses_what_it_cannot_do(refuses):
    y = np.random.default_rng(0).standard_normal(4096)
    with refuses("only_whittle"):
        jaxcal.noise.fit(y, RATE, method="gls", robust=True)
