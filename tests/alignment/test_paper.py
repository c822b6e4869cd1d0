"""The example of the north-finding paper, to the digits that section 13 of the method states."""

import numpy as np
import pytest

from jaxcal.alignment import Positions, Sensor, azimuth, level, simulate

from .cases import DEG

ARCSEC = DEG / 3600
ATTITUDE, LATITUDE = np.array([50.0, 30.0, 88.0]) * DEG, 35 * DEG
ACCEL = Sensor(50e-6, np.full(2, 10 * ARCSEC), 100e-6 * 9.80665)
GYRO = Sensor(20e-6, np.full(2, 5 * ARCSEC), 0.01 * ARCSEC)
PLACES = Positions(np.array([0, 45, 90, 135, 180, 225, 270, 315, 0, 90, 180, 270, 0]) * DEG, ["x"] * 8 + ["y"] * 4 + ["z"], dwell=10.0)


@pytest.fixture(scope="module")
def readings():
    return simulate(PLACES, ATTITUDE, LATITUDE, accel=ACCEL, gyro=GYRO)


@pytest.mark.parametrize(
    ("method", "phi", "theta"),
    [("four_point_x", 50.0055833, 29.9995261), ("least_squares_x", 50.0055833, 29.9995261), ("four_point_y", 50.0035218, 30.0037820),
     ("least_squares_y", 50.0035218, 30.0037820)],
)  # fmt: skip
def test_tables_1_and_2(readings, method, phi, theta):
    found = level(readings, method=method)
    np.testing.assert_allclose(np.rad2deg([found.phi, found.theta]), [phi, theta], atol=5.1e-8)


def test_tables_3_and_4(readings):
    found = level(readings, method="bias_and_scale")
    assert found.bias / 9.80665e-6 == pytest.approx(73.0119, abs=5e-5)
    assert found.scale == pytest.approx(1.0000664, abs=5e-8)


@pytest.mark.parametrize(
    ("method", "expected"),
    [
        ("opposed", 88.0012513),
        ("quadrature", 88.0043963),
        ("maximum", 88.0135),
        ("bias_and_scale", 88.0016916),
        ("scale_first", 88.0016916),
    ],
)
def test_table_9(readings, method, expected):
    found = azimuth(readings, ATTITUDE[:2], LATITUDE, method=method, hint=88 * DEG)
    assert np.rad2deg(found.psi) == pytest.approx(expected, abs=5e-5 if method == "maximum" else 5.1e-8)


@pytest.mark.parametrize(("angle", "expected"), [(0, 87.9469), (45, 87.9499), (90, 87.8885)])
def test_table_9_single_reading(readings, angle, expected):
    found = azimuth(readings, ATTITUDE[:2], LATITUDE, method="single_reading", angle=angle * DEG, hint=88 * DEG)
    assert np.rad2deg(found.psi) == pytest.approx(expected, abs=5e-5)


def test_tables_10_to_12(readings):
    by_angle, by_scale, triad = (
        azimuth(readings, ATTITUDE[:2], LATITUDE, method=name) for name in ("bias_and_scale", "scale_first", "triad")
    )
    assert by_angle.bias == pytest.approx(4.904175e-8, abs=5e-15)
    assert by_angle.scale[1] == pytest.approx(1.0000175, abs=5e-8)
    assert by_scale.scale[1] == pytest.approx(1.0000175, abs=5e-8)
    assert by_scale.scale_approx == pytest.approx(1.0000175, abs=5e-8)
    assert triad.scale[0] == pytest.approx(1.0000083, abs=5e-8)
    # the paper attitude has two roots with a positive scale factor
    assert np.rad2deg(by_angle.roots[0]) == pytest.approx(-113.2217823, abs=1e-7)
    assert by_angle.scale[0] == pytest.approx(44.03007, abs=1e-5)


def test_angles_of_four_points_in_place_of_the_true_ones(readings):
    measured = level(readings)
    expected = {
        "opposed": 88.0009288,
        "quadrature": 88.0093890,
        "four_point": 88.0011149,
        "bias_and_scale": 88.0021133,
        "triad": 88.0046317,
    }
    for method, value in expected.items():
        assert np.rad2deg(azimuth(readings, measured, LATITUDE, method=method, hint=88 * DEG).psi) == pytest.approx(value, abs=5.1e-8)


def test_transfer_of_level_errors():
    """Section 5 of the method states the error of azimuth in degrees per degree of roll and of pitch."""
    clean = simulate(PLACES, ATTITUDE, LATITUDE)
    listed = {
        "opposed": (0.000, 0.680), "quadrature": (0.955, 0.719), "four_point": (0.021, 0.681), "maximum": (3.714, 0.830),
        "bias_and_scale": (0.134, 0.686), "triad": (0.479, 0.700),
    }  # fmt: skip
    step = 1e-5
    for method, expected in listed.items():
        for i in range(2):
            up, down = ATTITUDE[:2].copy(), ATTITUDE[:2].copy()
            up[i], down[i] = up[i] + step, down[i] - step
            psi = [azimuth(clean, pair, LATITUDE, method=method, hint=88 * DEG).psi for pair in (up, down)]
            assert abs(psi[0] - psi[1]) / (2 * step) == pytest.approx(expected[i], abs=6e-4), method
