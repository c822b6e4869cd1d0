"""Degenerate cases of section 11 of the method: each is reported by its verdict, and no result is NaN."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.alignment import Positions, Readings, Sensor, azimuth, level, simulate
from jaxcal.alignment._azimuth import AZIMUTH_METHODS
from jaxcal.alignment._level import LEVEL_METHODS

from .cases import ARW, DEG, VRW, outcome

EVERY = Positions(np.array([0, 90, 180, 270, 60, 120, 0, 90, 180, 270, 0]) * DEG, ["x"] * 6 + ["y"] * 4 + ["z"], dwell=60.0)
X4 = Positions(np.array([0, 90, 180, 270]) * DEG, dwell=60.0)


def at(phi, theta, psi, latitude, places=EVERY, **options):
    return simulate(places, np.array([phi, theta, psi]) * DEG, latitude * DEG, **options)


def north(method, phi, theta, psi, latitude, **options):
    return azimuth(at(phi, theta, psi, latitude), np.array([phi, theta]) * DEG, latitude * DEG, method=method, **options)


@pytest.mark.parametrize(
    ("case", "method", "expected"),
    [
        ((0, 0, 37, 35), "maximum", "degenerate"), ((180, 0, 37, 35), "maximum", "degenerate"), ((10, 20, 0, 35), "opposed", "double_root"),
        ((10, 20, 180, 35), "opposed", "double_root"), ((30, 20, -78.829771, 25), "quadrature", "clipped double_root"),
        ((90, 20, 70, 35), "four_point", "degenerate"), ((90, 20, 70, 35), "scale_first", "degenerate"),
        ((30, 20, 10.124563, 25), "maximum", "clipped double_root"), ((0, 50, 0, -40), "bias_and_scale", "degenerate"),
        ((0, 50, 0, -40), "scale_first", "degenerate"), ((50, 30, 88, 35), "bias_and_scale", "scale_chosen"),
        ((50, 30, 88, 35), "scale_first", "scale_chosen"), ((90, 20, 70, 35), "bias_and_scale", "undecided"),
        ((10, 90, 30, 35), "opposed", "degenerate"), ((10, 90, 30, 35), "four_point", "degenerate"),
        ((50, 30, 88, 35), "opposed", "undecided"),
    ],
)  # fmt: skip
def test_geometry(case, method, expected):
    found = north(method, *case)
    assert outcome(found) in expected.split()
    if outcome(found) in ("degenerate", "undecided", "infeasible"):
        assert found.psi is None
        assert found.std is None


@pytest.mark.parametrize("method", AZIMUTH_METHODS)
@pytest.mark.parametrize("latitude", [90.0, -90.0, 89.95])
def test_poles(method, latitude):
    found = north(method, 5, 3, 40, latitude)
    assert "pole" in found.codes
    assert found.psi is None
    assert found.roots.size == 0


def test_roots_closer_than_the_hint():
    # the paper's attitude at a table angle of 120 degrees has roots at 71.4 and 88 degrees
    found = north("single_reading", 50, 30, 88, 35, angle=120 * DEG, hint=85 * DEG)
    assert found.psi == pytest.approx(88 * DEG, abs=1e-9)
    np.testing.assert_allclose(np.rad2deg(found.roots), [71.37179, 88.0], atol=1e-5)
    assert outcome(found) == "ok"


def test_arc_cosines_that_exceed_one():
    readings = at(2, 3, 0, 35, places=X4)
    large = Readings(X4, gyro=readings.gyro * 1.01)
    found = azimuth(large, np.array([2, 3]) * DEG, 35 * DEG, method="opposed")
    assert (outcome(found), found.psi, found.std) == ("infeasible", None, None)
    # an excess within five standard deviations of the readings gives the double root with the verdict "clipped"
    noisy = Readings(X4, gyro=readings.gyro * 1.01, gyro_noise=100 * ARW)
    found = azimuth(noisy, np.array([2, 3]) * DEG, 35 * DEG, method="opposed")
    assert "clipped" in found.codes
    assert found.psi == pytest.approx(0, abs=1e-12)
    assert np.isfinite(found.std)
    raised = Readings(EVERY, gyro=at(50, 30, 88, 35).gyro * 1.1)
    assert outcome(azimuth(raised, np.array([50, 30]) * DEG, 35 * DEG, method="maximum")) == "infeasible"


def test_a_wrong_latitude_is_told_by_triad():
    readings = at(5, 3, 40, 35, gyro=Sensor(white=ARW), accel=Sensor(white=VRW))
    flat = level(readings, method="bias_and_scale")
    assert outcome(azimuth(readings, flat, 35 * DEG, method="triad")) == "ok"
    assert outcome(azimuth(readings, flat, 37 * DEG, method="triad")) == "integrity"


@pytest.mark.parametrize("method", ["four_point_x", "least_squares_x", "four_point_y", "least_squares_y"])
def test_levels(method):
    found = level(at(10, 90, 0, 35), method=method)
    assert (outcome(found), found.phi) == ("degenerate", None)
    assert found.theta == pytest.approx(np.pi / 2, abs=1e-7)
    found = level(at(90, 20, 0, 35), method=method)
    assert outcome(found) in ("double_root", "clipped")
    readings = at(10, 80, 0, 35)
    found = level(Readings(EVERY, readings.accel * 1.05, accel_noise=VRW), method=method)
    assert "clipped" in found.codes
    assert not np.isnan([found.phi if found.phi is not None else 0, found.theta, *found.phi_roots, *found.covariance.ravel()]).any()


@pytest.mark.parametrize("method", ["least_squares_x", "least_squares_y"])
def test_too_few_angles(method):
    mounting = method[-1]
    two = Positions(np.array([0, 90]) * DEG, mounting)
    readings = simulate(two, np.array([3, 4, 5]) * DEG, 35 * DEG)
    found = level(readings, method=method)
    assert (outcome(found), found.phi, found.theta) == ("degenerate", None, None)
    if method[-1] == "x":
        assert azimuth(readings, [0.05, 0.07], 0.6, method="maximum").psi is None


@pytest.mark.parametrize("method", [*LEVEL_METHODS, *AZIMUTH_METHODS])
def test_missing_positions_are_named(refuses, method):
    one = Positions([10 * DEG], "-z")
    readings = simulate(one, np.array([3, 4, 5]) * DEG, 35 * DEG)
    with refuses("no_position"):
        level(readings, method=method) if method in LEVEL_METHODS and method != "bias_and_scale" else azimuth(
            readings, [0.0, 0.0], 0.6, method=method
        )


def test_without_a_sensor(refuses):
    gyro = Readings(X4, gyro=np.zeros(4))
    with refuses("no_sensor"):
        level(gyro)
    with refuses("no_sensor"):
        azimuth(Readings(X4, accel=np.zeros(4)), [0.0, 0.0], 0.6)
    with refuses("method"):
        azimuth(gyro, [0.0, 0.0], 0.6, method="best")
    with refuses("no_level"):
        azimuth(at(10, 90, 0, 35), level(at(10, 90, 0, 35)), 0.6)


def test_gradients_are_finite_at_double_roots():
    """The gradient is finite even where the arc cosine has an infinite slope."""
    chosen = lambda w: azimuth(Readings(X4, gyro=w), jnp.asarray([0.1, 0.2]), 0.6, method="opposed", hint=0.1).psi  # noqa: E731
    for psi in (0.0, np.pi):
        gyro = jnp.asarray(simulate(X4, np.array([0.1, 0.2, psi]), 0.6).gyro)
        assert np.isfinite(np.asarray(jax.grad(chosen)(gyro))).all()


@pytest.mark.parametrize("method", [pytest.param(x, marks=[pytest.mark.long] * (x not in ("maximum", "opposed"))) for x in AZIMUTH_METHODS])
def test_traced_as_on_the_host_and_differentiable(method):
    readings = at(20, -10, 60, 35)
    angles = jnp.asarray(np.array([20, -10]) * DEG)

    def psi(gyro):
        return azimuth(Readings(EVERY, gyro=gyro), angles, 35 * DEG, method=method, hint=60 * DEG).psi

    host = azimuth(readings, np.asarray(angles), 35 * DEG, method=method, hint=60 * DEG).psi
    direction = 1e-9 * np.random.default_rng(0).normal(size=11)
    value, slope = jax.jit(lambda w, v: jax.jvp(psi, (w,), (v,)))(jnp.asarray(readings.gyro), jnp.asarray(direction))
    assert float(value) == pytest.approx(host, abs=1e-12)
    change = (psi(readings.gyro + direction) - psi(readings.gyro - direction)) / 2
    assert float(slope) == pytest.approx(change, rel=1e-4)


@pytest.mark.parametrize("method", ["opposed", "quadrature", "four_point", "bias_and_scale", "triad"])
def test_first_order_standard_deviations(method):
    """For a known level the variance is the sum of the squared effects of each reading's noise."""
    level_, lat, psi = np.array([20, -10]) * DEG, 35 * DEG, 60 * DEG
    made, total = at(20, -10, 60, 35), 0.0
    found = azimuth(Readings(EVERY, made.accel, made.gyro, gyro_noise=ARW), level_, lat, method=method, hint=psi)
    for i in (*range(4), 10):
        step = 1e-4 * ARW / np.sqrt(60) * (np.arange(11) == i)
        up, down = (azimuth(Readings(EVERY, gyro=made.gyro + x), level_, lat, method=method, hint=psi).psi for x in (step, -step))
        total += ((up - down) / 2e-4) ** 2
    assert found.std == pytest.approx(np.sqrt(total), rel=1e-5)


def test_level_standard_deviations():
    """For four points the standard deviations equal the closed form in section 4 of the method."""
    phi, theta = 50 * DEG, 30 * DEG
    made = at(50, 30, 88, 35)
    sigma = VRW / np.sqrt(60) / 9.80665
    found = level(Readings(EVERY, made.accel, accel_noise=VRW))
    expected = np.array([np.sqrt(1 + (np.sin(phi) * np.tan(theta)) ** 2) / np.cos(phi), 1]) * sigma / (np.sqrt(2) * np.cos(theta))
    np.testing.assert_allclose(found.std, expected, rtol=1e-9)
