"""Long logs are thinned by direction for the fit, and evaluated with all readings."""

import numpy as np
import pytest

from jaxcal.magnetometer import _surface, fit
from jaxcal.magnetometer._quadric import thinned

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
    found = fit(m)
    assert found.verdict == "good"
    assert found.numbers["used"].value < 15_000 < found.numbers["readings"].value
    assert np.all(np.abs(found.model.hard_iron - cases.MILD.hard_iron) < 4 * found.estimate.select("hard_iron*").error)
    # residuals, outliers and coverage are those of every reading
    assert found.residual.shape == (21_000,)
    assert np.std(np.delete(found.residual, 5)) == pytest.approx(0.01, rel=0.03)
    assert 5 in found.outliers
    assert found.coverage.counts.sum() == 21_000


def test_short_logs_are_left_whole():
    _, m = long_log(1000)
    assert fit(m).numbers["used"].value == 1000


def test_thinning_is_even_over_cells_and_over_time():
    u = np.tile(cases.directions(30_000, 0), (2, 1))
    kept = thinned(u)
    cell = np.unique(np.floor(u[kept] * 10).astype(int), axis=0, return_counts=True)[1]
    assert cell.max() <= 8 * 32
    # both halves of the log have the same directions; of each cell they keep as many readings, but for one of 32
    assert np.mean(kept < 30_000) == pytest.approx(0.5, abs=0.005)


def test_models_that_the_largest_excludes_are_not_tried(monkeypatch):
    tried, maximised = [], _surface.maximised
    monkeypatch.setattr(_surface, "maximised", lambda surface, *more: tried.append(surface.kind) or maximised(surface, *more))
    for soft, left in (("symmetric", {"symmetric"}), ("sphere", {"symmetric", "diagonal", "sphere"})):
        sensor = cases.MILD if soft == "symmetric" else None
        u = cases.directions(300, 3)
        m = cases.readings(sensor, u, 0.01, 0) if sensor is not None else u + 0.01 * np.random.default_rng(0).normal(size=u.shape)
        tried.clear()
        fit(m)
        assert set(tried) == left
