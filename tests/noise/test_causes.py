"""Effects that look like B or K are named instead: steps, warm-ups, sinusoids, other exponents, Gauss-Markov processes."""

import numpy as np
import pytest
import scipy.fft

import jaxcal

RATE, SAMPLES, RUNS = 100.0, 2**15, 5
T = np.arange(SAMPLES) / SAMPLES


def density(processes=(), exponent=0.0, corner=0.0):
    """Density of DCT-II ordinates: white noise of 1, processes of (level, correlation time), and a power law."""
    angle, dt = np.pi * np.arange(1, SAMPLES) / SAMPLES, 1 / RATE
    total = 1.0 + (corner / (2 * np.sin(angle / 2) / (2 * np.pi * dt))) ** exponent * (exponent > 0)
    for level, time in processes:
        a = np.exp(-dt / time)
        total = total + level * (1 - a) ** 2 / (1 + a * a - 2 * a * np.cos(angle))
    return total


def drawn(level, seed):
    """Simulate a record by drawing its ordinates, independently of `Noise.simulate`."""
    ordinates = np.sqrt(np.broadcast_to(level, SAMPLES - 1) * RATE) * np.random.default_rng(seed).standard_normal(SAMPLES - 1)
    return scipy.fft.idct(np.concatenate([[0.0], ordinates]), norm="ortho")


SD = np.sqrt(RATE)
MEANS = {
    "step": lambda u: 0.5 * SD * (0.2 + 0.6 * u < T),
    "warm_up": lambda u: SD * np.exp(-T / (0.03 + 0.1 * u)),
    "sinusoid": lambda u: 0.15 * SD * np.sin(2 * np.pi * ((1 + 5 * u) * T + u)),
    "ramp": lambda u: (0.5 + u) * SD * T,
}
SPECTRA = {
    "noise of exponent": density(exponent=0.75, corner=3.0),
    "Gauss-Markov process": density(processes=((30.0, 0.2), (3000.0, 10.0))),
}


@pytest.mark.parametrize("cause", [*MEANS, *SPECTRA])
def test_what_passes_for_slow_noise_is_named_and_no_b_or_k_is_present(cause):
    named = false = covered = 0
    for seed in range(RUNS):
        y = drawn(SPECTRA.get(cause, 1.0), seed)
        y = y + MEANS[cause](np.random.default_rng([seed, 1]).uniform()) if cause in MEANS else y
        found = jaxcal.noise.fit(y, RATE)
        named += cause in found.codes or any(cause in one.facts.get("model", "") for one in found.findings if one.code == "other_noise")
        false += [found.presence[term] for term in "BK"].count("present")
        covered += found.interval["N"][0] <= 1.0 <= found.interval["N"][1]
    assert named >= RUNS - 1
    assert false <= 1  # of ten verdicts, each of which is false with a probability of 1 %
    assert covered >= RUNS - 2


RIVALS = {
    "K": ("noise of exponent", density(exponent=1.2, corner=0.3)),
    "B": ("Gauss-Markov process", density(processes=((1.0, 1.0), (1.0, 20.0)))),
}


@pytest.mark.parametrize("term", RIVALS)
def test_what_another_spectrum_explains_as_well_is_a_hint_that_names_it(term):
    cause, level = RIVALS[term]
    false = hints = covered = 0
    for seed in range(8):
        found = jaxcal.noise.fit(drawn(level, seed), RATE)
        false += found.presence[term] == "present"
        covered += found.interval["N"][0] <= 1.0 <= found.interval["N"][1]
        if found.presence[term] == "hint" and found.significance[term] > 5.41:
            hints += 1
            assert cause in next(one.facts["model"] for one in found.findings if one.code in ("rival", "other_noise"))
            assert found.interval[term][0] == 0.0
    assert false <= 2  # for records twice as long, 3 % of the verdicts are false
    assert hints >= 2
    assert covered >= 6  # of 8 intervals of 95 %


#: processes of (level, correlation time) or exponent and corner, and seed: before results were means over models, the loss of one sample in
#: a hundred admitted another model or excluded it, and moved B by 2.5, 4.8 and 8.4 standard errors
UNDECIDED = [(density(exponent=0.75, corner=0.5), 22), (TWO := density(processes=((5.0, 0.5), (60.0, 8.0))), 1), (TWO, 5)]


def moved(y, seed):
    """Changes of the squared coefficients in standard errors if one sample in a hundred is lost, and the result of the complete record."""
    whole, masked = jaxcal.noise.fit(y, RATE), y.copy()
    masked[np.random.default_rng([seed, 0]).choice(len(y), len(y) // 100, replace=False)] = np.nan
    part, errors = jaxcal.noise.fit(masked, RATE), np.sqrt(np.diag(whole.covariance))
    squares = [np.array([float(getattr(one.noise, term)) ** 2 for term in one.terms]) for one in (whole, part)]
    return np.where(errors > 0.0, np.abs(squares[1] - squares[0]) / np.where(errors > 0.0, errors, 1.0), 0.0), whole


@pytest.mark.parametrize("case", range(len(UNDECIDED)))
def test_a_record_that_does_not_decide_does_not_jump_between_models(case):
    level, seed = UNDECIDED[case]
    apart, whole = moved(drawn(level, seed), seed)
    assert apart.max() < 0.25
    assert any(one.facts["shares"] for one in whole.findings if one.code in ("rival", "other_noise"))


@pytest.mark.long
def test_means_over_models_cover_and_do_not_jump():
    covered = false = 0
    changes = []
    for seed in range(100, 140):
        apart, found = moved(drawn(TWO, seed), seed)
        covered += found.interval["N"][0] <= 1.0 <= found.interval["N"][1]
        false += [found.presence[term] for term in "BK"].count("present")
        changes.append(apart)
    assert covered >= 35  # of 40 intervals of 95 %; fewer have a probability of 1.4 %
    assert false <= 3  # of 80 verdicts, each of which may be false with a probability of 1 %
    # the lost samples themselves move each coefficient by about 0.1, and the largest of 120 changes by three times that
    assert np.sqrt(np.mean(np.square(changes))) < 0.15
    assert np.max(changes) < 0.5


@pytest.mark.long
def test_noise_of_the_model_alone_has_no_other_cause():
    truth = jaxcal.noise.Noise(N=0.25 / 60, B=7.6 / 3600, K=1.8 / 3600)
    records = np.stack([truth.simulate(SAMPLES, RATE, seed=seed) for seed in range(15)], axis=1)
    causes = {"step", "ramp", "warm_up", "sinusoid", "other_noise"}
    assert (
        sum(one.code in causes for one in jaxcal.noise.fit(records, RATE).findings) <= 2
    )  # a cause is named by chance in about 2 % of the records


@pytest.mark.long
def test_the_size_of_a_step_has_an_interval_that_holds_it():
    inside = 0
    for seed in range(10):
        y = drawn(1.0, seed) + 3.0 * (T > 0.5)
        ((_, size, error),) = next(one.facts["steps"] for one in jaxcal.noise.fit(y, RATE).findings if one.code == "step")
        inside += abs(size - 3.0) <= 1.96 * error
    assert inside >= 8


def test_a_channel_with_another_spectrum_is_stacked_with_the_others():
    y = np.stack([drawn(1.0, 0), drawn(SPECTRA["noise of exponent"], 0), drawn(SPECTRA["Gauss-Markov process"], 0)], axis=1)
    found = jaxcal.noise.fit(y, RATE)
    tau = found.deviation.tau
    assert found.terms == ("Q", "N", "B", "K")
    ratio = np.sqrt(np.asarray(found.noise.avar(tau, dt=1 / RATE))) / found.deviation.deviation
    assert np.all(np.abs(ratio[: len(tau) // 2] - 1.0) < 0.1)  # short cluster times have many degrees of freedom
