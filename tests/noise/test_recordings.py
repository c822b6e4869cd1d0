"""Several recordings of one device: the interval contains the coefficient of the next recording."""

import numpy as np
import pytest

import jaxcal

RATE, SAMPLES, DEVICES = 100.0, 4096, 40


@pytest.mark.long
@pytest.mark.parametrize("spread", [0.1, 0.01])
def test_the_interval_of_four_recordings_holds_the_fifth(spread):
    inside, between = [], []
    for device in range(DEVICES):
        random = np.random.default_rng([device, 7])
        truth = np.exp(spread * random.standard_normal(5))
        found = jaxcal.noise.fit_recordings([n * random.standard_normal(SAMPLES) for n in truth[:4]], RATE, terms="NK")
        low, high = found.interval["N"]
        inside.append(low <= truth[4] / RATE**0.5 <= high)
        between.append(found.between["N"])
    assert np.sum(inside) >= 34  # of 40 at 95 %; fewer have a probability of 1 in 300
    if spread == 0.1:
        assert np.mean(between) == pytest.approx(spread, rel=0.25)


def test_a_term_that_one_recording_lacks_has_an_upper_limit():
    random = np.random.default_rng(0)
    walk = np.cumsum(0.2 * random.standard_normal(SAMPLES))
    found = jaxcal.noise.fit_recordings([random.standard_normal(SAMPLES), random.standard_normal(SAMPLES) + walk], RATE)
    assert found.presence["K"] == "hint"
    assert found.interval["K"][0] == 0.0
    assert found.interval["K"][1] >= 0.2 * RATE**0.5
    assert "recordings" in found.summary()
    assert found.to_dict()["presence"]["N"] == "present"


@pytest.mark.parametrize(
    ("records", "said"), [([np.zeros(9)], "two at least"), ([np.zeros((9, 3))] * 2, "one channel"), ([np.zeros(99)] * 2, "recording 0")]
)
def test_what_is_refused(records, said):
    with pytest.raises(jaxcal.DataError, match=said):
        jaxcal.noise.fit_recordings(records, RATE)
