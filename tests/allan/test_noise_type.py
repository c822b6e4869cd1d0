"""Noise types agree with the definition by the lag-1 autocorrelation, evaluated for one cluster size after another."""

import numpy as np
import pytest

from jaxcal.allan import deviation
from jaxcal.noise import Noise


def lag_one_type(y, m):
    """Noise type by Riley and Greenhall, EFTF 2004: averages without their linear trend are differenced until they are stationary."""
    z = y[: len(y) // m * m].reshape(-1, m).mean(axis=1)
    t = np.arange(len(z)) - (len(z) - 1) / 2
    z = z - z.mean() - t * (t @ z) / (t @ t)
    for differences in range(3):
        z = z - z.mean()
        r1 = (z[1:] @ z[:-1]) / (z @ z) * len(z) / (len(z) - 1)
        rho = r1 / (1 + r1)
        if rho < 0.25 or differences == 2:
            return np.clip(-np.floor(2 * rho + 0.5) - 2 * differences, -2, 2)
        z = np.diff(z)


@pytest.mark.parametrize("noise", [{"N": 1.0}, {"Q": 1.0}, {"K": 1.0}, {"B": 1.0}, {"N": 1e-3, "R": 1.0}], ids=str)
def test_types_are_those_of_the_definition(noise):
    """Records of fewer than 2,048 samples use all averages; the cluster sizes leave at least 30 averages."""
    for seed in range(4):
        samples = 1200 + 211 * seed
        y = Noise(**noise).simulate(samples, 1.0, seed=seed)
        m = np.arange(1, samples // 30 + 1)
        assert deviation(y, 1.0, m=m).alpha.tolist() == [lag_one_type(y, size) for size in m]


@pytest.mark.parametrize("slope", [1.0, 1e3, 1e6])
def test_a_line_that_hides_the_noise_is_taken_off_first(slope):
    y = np.random.default_rng(0).standard_normal(2000)
    m = [1, 2, 5, 10, 20]
    assert deviation(y + slope * np.arange(2000.0), 1.0, m=m).alpha.tolist() == deviation(y, 1.0, m=m).alpha.tolist() == [0] * 5


def test_types_are_held_between_the_cluster_sizes_identified():
    """Types are identified at 512 of 15,000 cluster sizes; each other size has the type of the next smaller one of these."""
    y = Noise(N=1.0, K=0.02).simulate(30_000, 1.0, seed=0)
    held = deviation(y, 1.0, m="all").alpha
    changes = np.flatnonzero(np.diff(held)) + 2  # cluster sizes where a new type begins
    few = changes[np.linspace(0, len(changes) - 1, min(len(changes), 400)).astype(int)]
    np.testing.assert_array_equal(held[few - 1], deviation(y, 1.0, m=few).alpha)
    assert held[0] == 0
    assert held[-1] < 0  # there are few, overlapping averages, which give flicker or random walk
