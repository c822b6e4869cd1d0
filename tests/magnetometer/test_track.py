"""A hard iron that drifts along a long log, beside the posterior bound of the linear model with the true parameters."""

import importlib.util
import pathlib

import numpy as np
import pytest

import jaxcal
from jaxcal.magnetometer import MagModel, track

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "_flight.py"
_SPEC = importlib.util.spec_from_file_location("flight", _PLACE)
flights = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(flights)


@pytest.mark.parametrize("given", [pytest.param(True, marks=pytest.mark.long), False])
def test_the_path_is_nearly_as_good_as_possible_and_its_error_true(given):
    off, least, inside, walks = [], [], [], []
    for seed in range(6):
        dive = flights.dived(seed, hours=4.0)
        found = track(dive.m, dive.time, **({"model": MagModel(dive.soft, np.zeros(3)), "field": 1.0} if given else {}))
        assert found.codes == {"drifts"}
        off.append(np.mean((found.at(dive.time) - dive.hard) ** 2))
        least.append(np.mean(flights.least(dive) ** 2))
        errors = found.hard_iron - np.stack([np.interp(found.time, dive.time, axis) for axis in dive.hard.T], axis=1)
        inside.append(np.mean(np.abs(errors) < 1.96 * np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))))
        walks.append(60 * found.walk)
        assert found.noise == pytest.approx(0.005, rel=0.05)
    assert np.sqrt(np.mean(off) / np.mean(least)) < (1.1 if given else 1.2)
    assert np.mean(inside) > 0.9
    assert np.mean(walks) == pytest.approx(0.01, rel=0.15)


def test_steady_iron_and_a_trend():
    still, moving = flights.dived(1, drift=0.0), flights.dived(1, trend=True)
    found = track(still.m, still.time, inclination=flights.DIP)
    assert (found.verdict, found.codes) == ("good", {"steady"})
    np.testing.assert_allclose(found.hard_iron, still.hard[: len(found.hard_iron)], atol=2e-3)
    found = track(moving.m, moving.time, inclination=flights.DIP)
    rate = np.linalg.solve(moving.soft, (moving.hard[-1] - moving.hard[0]) / 2) / np.cos(flights.DIP)  # rad in an hour, by axis
    assert found.interval / 3600 == pytest.approx(np.deg2rad(1.0) / np.sqrt(np.mean(rate**2)), rel=0.1)
    assert found.cost == pytest.approx(2 / np.sqrt(12) * np.sqrt(np.mean(rate**2)), rel=0.1)
    np.testing.assert_allclose(found.hard_iron[-1], moving.hard[-1], atol=5e-3)


def test_a_level_vehicle_with_a_known_soft_iron_and_spikes():
    dive = flights.dived(2, tilt=0.05, count=5000)
    m = dive.m.copy()
    m[::50] += 3.0
    found = track(m, dive.time, model=MagModel(dive.soft, dive.hard[0] + 0.2), field=1.0)
    assert set(range(0, 5000, 50)) <= set(found.outliers)
    assert np.sqrt(np.mean((found.at(dive.time) - dive.hard) ** 2)) < 1.2 * np.sqrt(np.mean(flights.least(dive) ** 2))
    assert np.median(np.linalg.norm(found.correct(m, dive.time), axis=1)) == pytest.approx(1.0, abs=1e-3)


def test_logs_and_what_is_refused(refuses):
    dive = flights.dived(3, count=3000)
    log = jaxcal.Log(dive.time, mag=5e-5 * dive.m)
    one, other = track(log), track(5e-5 * dive.m, dive.time)
    np.testing.assert_allclose(one.hard_iron[-1], other.hard_iron[-1], rtol=1e-3)
    assert one.numbers["hard_iron[0]"].unit == "T"
    assert "calibrate again every" in one.headline
    with refuses("time"):
        track(dive.m, dive.time[::-1])
    with refuses("bad_shape"):
        track(dive.m, dive.time[:-1])
    with refuses("no_field"):
        track(dive.m, dive.time, model=MagModel(dive.soft, np.zeros(3)))
    with refuses("undetermined"):
        track(np.tile(dive.m[:1], (3000, 1)), dive.time)
