"""Currents, known attitudes, earlier calibrations, several sensors, and the field of a place."""

import datetime
import sys

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcal import DataError
from jaxcal.magnetometer import (
    Accelerometer,
    MagModel,
    body_field,
    earth_field,
    fit,
    fit_attitudes,
    fit_current,
    fit_offset,
    fit_several,
    motor_terms,
    scenario,
)

from . import cases

K = np.array([[0.03, -0.01], [0.0, 0.02], [-0.02, 0.01]])


def powered(seed, sigma=0.01, count=300):
    rng = np.random.default_rng([seed, 9])
    current = rng.uniform(0, 10, (count, 2))
    u = cases.directions(count, seed)
    return cases.MILD.measure(u) + current @ K.T + sigma * rng.normal(size=(count, 3)), current


def test_motor_terms_are_a_regression():
    rng = np.random.default_rng(0)
    away = []
    for _ in range(50):
        current = rng.uniform(0, 10, (200, 2))
        found = motor_terms([20.0, 0.0, 40.0] + current @ K.T + 0.05 * rng.normal(size=(200, 3)), current)
        away.append((found.terms - K) / found.error)
    # 300 standard normal numbers
    assert np.std(away) == pytest.approx(1.0, abs=4 / np.sqrt(600))
    np.testing.assert_allclose(found.correct(np.ones((200, 3)), current), 1 - current @ found.terms.T)
    with pytest.raises(DataError, match="does not vary by itself"):
        motor_terms(np.ones((50, 3)), np.ones(50))
    with pytest.raises(DataError, match="for 50 readings"):
        motor_terms(np.ones((50, 3)), np.ones(49))


def test_currents_in_a_fit_of_norms():
    away = []
    for seed in range(6):
        m, current = powered(seed)
        found = fit_current(m, current)
        away.append((found.terms - K) / found.error)
    # 36 numbers
    assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1.0, abs=0.45)
    assert found.noise == pytest.approx(0.01, rel=0.12)
    assert np.all(np.abs(found.fit.model.hard_iron - cases.MILD.hard_iron) < 0.02)
    assert found.correlation.max() < 0.3
    # without the terms the residual noise is far larger
    assert fit(m, model="symmetric").noise > 4 * found.noise
    with pytest.raises(DataError, match="constant"):
        fit_current(m, np.ones(300))


def test_known_attitudes_give_the_whole_matrix():
    turn = Rotation.from_rotvec([0.02, -0.05, 0.08]).as_matrix()
    sensor = MagModel(np.asarray(cases.MILD.soft_iron) @ turn, cases.MILD.hard_iron)
    field, rng = body_field(scenario("three_turns", samples=40)), np.random.default_rng(1)
    current = rng.uniform(0, 10, 120)
    away = []
    for _ in range(30):
        m = sensor.measure(field) + np.outer(current, K[:, 0]) + 0.01 * rng.normal(size=(120, 3))
        found = fit_attitudes(m, field, current=current)
        whole = np.concatenate([found.model.soft_iron, found.model.hard_iron[:, None], found.currents], axis=1)
        true = np.concatenate([sensor.soft_iron, sensor.hard_iron[:, None], K[:, :1]], axis=1)
        away.append((whole - true) / found.error)
    assert np.std(away) == pytest.approx(1.0, abs=0.12)
    assert found.noise == pytest.approx(0.01, rel=0.2)
    with pytest.raises(DataError, match="do not determine"):
        fit_attitudes(m[:20], np.ones((20, 3)))
    with pytest.raises(DataError, match="one for each"):
        fit_attitudes(m, field[:5])


def test_calibrations_compose_and_undo():
    second = MagModel(np.diag([1.02, 0.99, 1.0]), np.array([0.01, -0.02, 0.0]))
    both, m = cases.MILD.then(second), cases.directions(20, 0)
    np.testing.assert_allclose(both.correct(m), second.correct(cases.MILD.correct(m)), atol=1e-14)
    np.testing.assert_allclose(cases.MILD.measure(cases.MILD.correct(m)), m, atol=1e-14)
    # a log is corrected by a wrong model and fitted again; the composition equals a fit of the raw readings
    raw = cases.readings(cases.MILD, cases.directions(300, 0), 0.005, 0)
    wrong = MagModel(np.diag([1.05, 1.0, 0.97]), np.array([0.5, 0.0, 0.1]))
    again = wrong.then(fit(wrong.correct(raw), model="symmetric", field=1.0).model)
    np.testing.assert_allclose(again.hard_iron, cases.MILD.hard_iron, atol=2e-3)
    norm = np.linalg.norm(again.correct(raw), axis=1)
    assert norm.std() < 0.006


def test_an_offset_alone_needs_a_part_of_the_sphere():
    away, moved = [], np.array([0.3, 0.2, -0.1])
    for seed in range(25):
        m = cases.readings(cases.MILD, cases.directions(60, seed, "hemisphere"), 0.01, seed) + moved
        found, matrix = fit_offset(m, cases.MILD, field=1.0)
        off = found.hard_iron - cases.MILD.hard_iron - moved
        away.append(off @ np.linalg.solve(matrix, off))
    assert np.mean(away) == pytest.approx(3.0, abs=1.6)
    free, larger = fit_offset(m, cases.MILD)
    # on a hemisphere the mean square of z is 1/3; if the size is free too, only its variance counts, which is 1/12
    assert larger[2, 2] / matrix[2, 2] == pytest.approx(4.0, rel=0.3)
    assert np.abs(free.hard_iron - found.hard_iron).max() < 0.05
    with pytest.raises(DataError, match="fewer than 5"):
        fit_offset(m[:3], cases.MILD)


def test_several_sensors_end_in_the_axes_of_the_first():
    field = body_field(scenario("all"), 1.0)
    up = -9.81 * body_field(scenario("all"), 1.0, np.pi / 2)
    rng, turn = np.random.default_rng(0), Rotation.from_rotvec([0.1, 1.5, -0.3]).as_matrix()
    other = MagModel(turn @ np.asarray(cases.MILD.soft_iron), np.array([3.0, 0.0, 1.0]))
    readings = {name: s.measure(field) + 0.002 * rng.normal(size=field.shape) for name, s in (("mast", cases.MILD), ("hull", other))}
    found = fit_several(readings, field=1.0, aid=Accelerometer(up))
    for name, m in readings.items():
        np.testing.assert_allclose(found[name].model.correct(m), field, atol=0.015)
    assert found["mast"].alignment.verdict == "good"
    with pytest.raises(DataError, match="same times"):
        fit_several({"a": field, "b": field[:10]})
    with pytest.raises(DataError, match="b: "):
        fit_several({"a": field, "b": np.ones_like(field)})


def test_the_field_of_a_place():
    """NOAA's test values of the World Magnetic Model 2025 at 80 N, 0 E, 0 km, 2025.0."""
    pytest.importorskip("pygeomag")
    field = earth_field(80.0, 0.0, 2025.0)
    np.testing.assert_allclose(1e9 * field, [6521.6, 145.9, 54791.5], atol=0.06)
    assert np.linalg.norm(earth_field(80.0, 0.0, datetime.date(2025, 1, 1)) - field) == 0.0
    ankara = earth_field(39.93, 32.86, 2026.5, altitude=900.0)
    found = fit(1e-6 * body_field(scenario("all"), 47.0), field=ankara)
    assert found.field == pytest.approx(np.linalg.norm(ankara))
    assert np.rad2deg(found.inclination) == pytest.approx(59, abs=2)
    for place, words in (((95, 0, 2026), "degrees of latitude"), ((0, 0, 1999), "hold from 2010"), ((0, 0, "today"), "datetime.date")):
        with pytest.raises(DataError, match=words):
            earth_field(*place)


def test_without_the_package_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "pygeomag", None)
    with pytest.raises(DataError, match=r"jaxcal\[geomag\]"):
        earth_field(0, 0, 2026)
