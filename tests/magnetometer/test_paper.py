"""Tables of the magnetometer paper: agreement between data sets compared with the true accuracy."""

import numpy as np
import pytest

from jaxcal.magnetometer import MagModel, body_field, fit, scenario

from . import cases

#: published headings in degrees: twelve points, three turns, all attitudes
SIMULATED = np.array([
    [2.318, 2.502, 2.416], [77.581, 77.501, 77.266], [115.154, 115.643, 115.737], [167.608, 167.422, 167.465],
    [222.26, 222.931, 222.583], [249.169, 249.542, 249.448], [300.705, 300.182, 300.178], [356.061, 356.02, 356.162],
])  # fmt: skip
EXPERIMENT = np.array([
    [0.313, 0.508, 0.089], [59.277, 58.915, 58.386], [89.771, 89.989, 89.883], [130.130, 130.643, 131.075],
    [194.830, 194.320, 193.496], [250.814, 250.668, 250.656], [315.063, 315.275, 315.444], [359.171, 359.883, 359.989],
])  # fmt: skip
NAMES = ("twelve_points", "three_turns", "all")
HARD_IRON = {"three_turns": (2.3274, 5.3477, 10.5134), "twelve_points": (1.7671, 5.0745, 8.9792)}


def test_published_spreads():
    np.testing.assert_allclose(np.ptp(SIMULATED, axis=1), [0.184, 0.315, 0.583, 0.186, 0.671, 0.373, 0.527, 0.142], atol=1e-9)
    np.testing.assert_allclose(np.ptp(EXPERIMENT, axis=1), [0.419, 0.891, 0.218, 0.945, 1.334, 0.158, 0.381, 0.818], atol=1e-9)
    # the paper's "differences below 1 degree" is not true at the fifth position
    assert np.ptp(EXPERIMENT, axis=1).max() > 1.0


@pytest.fixture(scope="module")
def repeated():
    """Heading errors (runs, scenarios, positions) of the paper's method at 0.1 uT."""
    errors = []
    for seed in range(30):
        fits = [fit(cases.paper_readings(name, 0.1, seed), method="constrained") for name in NAMES]
        errors.append([cases.heading_errors(found.model) for found in fits])
    return np.array(errors)


@pytest.mark.long
def test_spread_between_scenarios_and_true_accuracy(repeated):
    """Reference values at 0.1 uT: median of the largest spread 0.78 degrees; true rms 0.66, 0.081 and 0.043 degrees."""
    spread = np.ptp(repeated, axis=1).max(axis=1)
    # the standard error of a median of 30 is 1.25 times that of a mean; the reference value has a similar standard error
    assert np.median(spread) == pytest.approx(0.78, abs=3 * 1.41 * 1.25 * spread.std() / np.sqrt(30))
    for i, listed in enumerate((0.66, 0.081, 0.043)):
        assert cases.rms(repeated[:, i]) == pytest.approx(listed, rel=0.25)
    # the largest spread of Table I is within the range of these
    assert np.mean(spread > np.ptp(SIMULATED, axis=1).max()) > 0.3


def test_published_hard_irons_are_what_noise_of_a_tenth_of_a_microtesla_gives():
    for name, published in HARD_IRON.items():
        error = fit(cases.paper_readings(name, 0.08, 0), model="symmetric")
        expected = error.estimate.select("hard_iron*").error * 0.08 / error.noise
        assert np.all(np.abs(np.array(published) - cases.PAPER.hard_iron) < 4 * expected)
        # it does not fit noise ten times smaller
        assert np.any(np.abs(np.array(published) - cases.PAPER.hard_iron) > 4 * expected / 10)


def test_standard_deviation_of_the_hard_iron_by_scenario():
    """Standard deviations per uT of noise for C = I: twelve points explain the jump of 400 in the z offset of the experiment."""
    plain = MagModel(np.eye(3), np.zeros(3))
    listed = {"all": (0.10, 0.09, 0.09), "three_turns": (0.45, 0.86, 4.6), "twelve_points": (2.2, 10.8, 20.1)}
    for name, spread in listed.items():
        found = fit(cases.readings(plain, body_field(scenario(name), cases.FIELD, cases.DIP), 0.01, 0), model="symmetric")
        np.testing.assert_allclose(found.estimate.select("hard_iron*").error / found.noise, spread, rtol=0.1)


def test_experimental_matrices_are_nearly_volume_preserving():
    for matrix in (
        [[0.9996, 0.0045, 0.0036], [0.0045, 1.0041, -0.0040], [0.0036, -0.0040, 0.9963]],
        [[1.0073, 0.0024, -0.0036], [0.0024, 1.0042, -0.0098], [-0.0036, -0.0098, 0.9887]],
        [[1.0239, 0.0014, 0.0069], [0.0014, 1.0238, 0.0080], [0.0069, 0.0080, 0.9541]],
    ):
        assert np.linalg.det(matrix) == pytest.approx(1.0, abs=1.5e-4)
