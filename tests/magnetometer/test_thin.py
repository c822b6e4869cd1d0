"""Long logs are thinned by direction for the fit, and evaluated with all readings."""

import numpy as np
import pytest
import scipy.spatial

from jaxcal import DataError
from jaxcal.magnetometer import fit
from jaxcal.magnetometer._ellipsoid._select import candidates

from . import cases


def long_log(count=21_000):
    """A log with nine tenths of its readings within 20 degrees of one direction, as when the sensor rests for a long time."""
    u = cases.directions(count, 0)
    rest = np.array([0.0, 0.0, 1.0]) + 0.1 * np.random.default_rng(1).normal(size=(count * 9 // 10, 3))
    u[: len(rest)] = rest / np.linalg.norm(rest, axis=1, keepdims=True)
    return u, cases.readings(cases.MILD, u, 0.01, 0)


def test_a_long_log_is_fitted_from_all_directions_alike():
    _, m = long_log()
    m[5] += 0.3
    found = fit(m, per_direction=8)
    assert found.verdict == "good"
    assert found.numbers["used"].value < 500 * 8 < found.numbers["readings"].value
    assert np.all(np.abs(found.model.hard_iron - cases.MILD.hard_iron) < 4 * found.estimate.select("hard_iron*").error)
    # residuals, outliers and coverage are those of every reading
    assert found.residual.shape == (21_000,)
    assert np.std(np.delete(found.residual, 5)) == pytest.approx(0.01, rel=0.03)
    assert 5 in found.outliers
    assert found.coverage.counts.sum() == 21_000


def test_thinning_keeps_so_many_in_each_direction():
    """The 500 cells of equal area are the regions nearest to the points of a Fibonacci lattice."""
    u, m = long_log()
    k = np.arange(500) + 0.5
    z, angle = 1 - k / 250, np.pi * (1 + np.sqrt(5)) * k
    lattice = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    count = np.bincount(scipy.spatial.KDTree(lattice).query(u)[1], minlength=500)
    # cells of the rough fit differ from the true ones only for readings near their edges
    assert fit(m, per_direction=8).numbers["used"].value == pytest.approx(np.minimum(count, 8).sum(), rel=0.03)


def test_thinning_spreads_over_time():
    """Both halves have the same directions, with fields of 1.02 and 0.98; thinning gives them equal weight."""
    u = cases.directions(12_000, 0)
    found = fit(np.concatenate([1.02 * u, 0.98 * u]), model="sphere", per_direction=8)
    assert found.numbers["used"].value <= 500 * 8
    assert found.field == pytest.approx(1.0, abs=1e-3)


def test_short_logs_are_left_whole():
    _, m = long_log(1000)
    assert fit(m).numbers["used"].value == 1000
    _, m = long_log()
    with pytest.raises(DataError, match="at least one is needed"):
        fit(m, per_direction=0)


def test_models_that_the_largest_excludes_are_not_tried():
    for soft, left in (("symmetric", {"symmetric"}), ("sphere", {"symmetric", "diagonal", "sphere"})):
        sensor = cases.MILD if soft == "symmetric" else None
        u = cases.directions(300, 3)
        m = cases.readings(sensor, u, 0.01, 0) if sensor is not None else u + 0.01 * np.random.default_rng(0).normal(size=u.shape)
        assert set(candidates(m - m.mean(axis=0), ("sphere", "diagonal", "symmetric"), 300)[0]) == left
