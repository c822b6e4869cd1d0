"""If the smaller model is chosen for lack of evidence, its predicted errors include the parameters that it leaves out."""

import numpy as np
import pytest

from jaxcal.magnetometer import MagModel, fit

from . import cases

SMALL = MagModel(np.array([[1.03, 0.01, -0.01], [0.01, 0.98, 0.01], [-0.01, 0.01, 1.0]]), np.array([0.3, -0.2, 0.1]))
ROUND = MagModel(np.eye(3), np.array([0.3, -0.2, 0.1]))


def cap(seed, lowest, count=300):
    u = np.concatenate([cases.directions(count, 10 * seed + k) for k in range(10)])
    return u[u[:, 2] > lowest][:count]


def heading_error(found, sensor):
    return np.deg2rad(cases.rms(cases.heading_errors(found.model, sensor, 1.0, steep=True, headings=np.arange(24) * np.pi / 12)))


@pytest.mark.parametrize(("sensor", "low", "high"), [(SMALL, 0.75, 1.35), (ROUND, 0.6, 1.1)])
def test_the_predicted_heading_error_counts_the_soft_iron_left_out(sensor, low, high):
    """With a soft iron of 3 %, a third of the sphere and 2 % noise, BIC chooses the smaller model, whose heading error is 0.6 degrees.

    The covariance of that model alone predicts 0.3 degrees. Without any soft iron, the prediction must not be far too large.
    """
    real, predicted, kinds = [], [], []
    for seed in range(40):
        found = fit(cases.readings(sensor, cap(seed, 0.4), 0.02, seed), inclination=cases.DIP)
        kinds.append(found.kind)
        real.append(heading_error(found, sensor))
        predicted.append(found.heading_error[0])
    assert sum(kind != "symmetric" for kind in kinds) > 25
    # forty errors with about two degrees of freedom each determine the rms to 8 %
    assert low < cases.rms(real) / cases.rms(predicted) < high


def test_a_model_that_is_asked_for_is_taken_at_its_word():
    m = cases.readings(ROUND, cap(1, 0.4), 0.02, 1)
    auto, asked = fit(m), fit(m, model="sphere")
    assert auto.kind == "sphere"
    np.testing.assert_allclose(auto.model.hard_iron, asked.model.hard_iron, atol=1e-5)
    # here the omitted parameters do not matter: both fits have the same result from two starts
    assert auto.heading_error[0] == pytest.approx(asked.heading_error[0], rel=1e-6)
    m = cases.readings(ROUND, cap(3, 0.4), 0.02, 3)
    auto, asked = fit(m), fit(m, model="sphere")
    assert auto.kind == "sphere"
    assert auto.heading_error[0] > 1.05 * asked.heading_error[0]


def test_what_could_not_be_seen_is_not_called_absent():
    """A small cap cannot distinguish a sphere from an ellipsoid."""
    for seed in range(5):
        small = fit(cases.readings(SMALL, cap(seed, 0.8, 100), 0.02, seed))
        assert small.verdict != "good"
        assert small.kind == "none" or (small.kind == "symmetric") != ("small_model" in small.codes)
        assert small.model is None or small.field < 2.0  # a surface without an end is a plane
