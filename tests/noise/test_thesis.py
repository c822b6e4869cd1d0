"""The noise analysis of the thesis: its tables as simulated cases, its results compared with the joint fit, and its curves.

Cases and curves are read from the cells of notebooks/thesis.ipynb with the tags "cases" and "curves"; the true values are in this file.
"""

import json
import pathlib

import numpy as np
import pytest

from jaxcal.noise import Noise, fit

RATE, SAMPLES = 100.0, 2**17
RAD = np.pi / 180
NOTEBOOK = pathlib.Path(__file__).resolve().parents[2] / "notebooks" / "thesis.ipynb"

#: tables 7.1 to 7.4 in m and s, and in deg and s: N, B, K
ACCELEROMETERS = {
    ("7.1", "X"): (1.25525e-3, 2.94200e-4, 4.19907e-5), ("7.1", "Y"): (1.25525e-3, 2.94200e-4, 0.0),
    ("7.1", "Z"): (1.96133e-3, 4.31493e-4, 0.0), ("7.2", "X"): (1.19641e-3, 2.39282e-4, 4.58333e-6),
    ("7.2", "Y"): (1.19641e-3, 2.39282e-4, 0.0), ("7.2", "Z"): (1.96133e-3, 4.51106e-4, 0.0),
}  # fmt: skip
GYROSCOPES = {
    ("7.3", "X"): (4.08333e-3, 2.1e-3, 5e-4), ("7.3", "Y"): (4.53333e-3, 2.2e-3, 0.0), ("7.3", "Z"): (5.73333e-3, 8.5e-4, 0.0),
    ("7.4", "X"): (4.0e-3, 1.2e-3, 1e-4), ("7.4", "Y"): (4.4e-3, 1.6e-3, 0.0), ("7.4", "Z"): (5.7e-3, 1.0e-3, 0.0),
}  # fmt: skip
PRINTED = ACCELEROMETERS | {key: tuple(RAD * np.array(row)) for key, row in GYROSCOPES.items()}
#: B if the column is the minimum of the curve: for X of the Allan tables without the contributions of N and K, else column/0.664
RAW = {
    ("7.1", "X"): 0.0246 * 9.80665e-3, ("7.1", "Y"): 2.94200e-4 / 0.664, ("7.1", "Z"): 4.31493e-4 / 0.664,
    ("7.3", "X"): 7.76 * RAD / 3600, ("7.3", "Y"): 2.2e-3 * RAD / 0.664, ("7.3", "Z"): 8.5e-4 * RAD / 0.664,
}  # fmt: skip
EXPECTED = {(*key, "as printed"): row for key, row in PRINTED.items()}
EXPECTED |= {(*key, "raw minimum"): (PRINTED[key][0], b, PRINTED[key][2]) for key, b in RAW.items()}


def cell(tag):
    """Execute the notebook's cell with this tag; returns the names that it defines."""
    cells = json.loads(NOTEBOOK.read_text(encoding="utf-8"))["cells"]
    (source,) = ["".join(c["source"]) for c in cells if tag in c["metadata"].get("tags", [])]
    names = {}
    exec(compile(source, f"{NOTEBOOK.name}, cell {tag}", "exec"), names)
    return names


@pytest.fixture(scope="module")
def cases():
    return cell("cases")["cases"]()


@pytest.fixture(scope="module")
def gyro_x(cases):
    return cases["7.3", "X", "as printed"]


def test_the_notebook_has_these_cases_and_no_other(cases):
    assert set(cases) == set(EXPECTED)
    assert len(cases) == 18


@pytest.mark.parametrize("key", EXPECTED, ids=lambda key: "-".join(key).replace(" ", "_"))
def test_case(cases, key):
    noise = cases[key]
    rounded = 3e-3 if key[2] == "raw minimum" else 1e-5  # as many digits as the thesis prints
    np.testing.assert_allclose([noise.N, noise.B, noise.K], EXPECTED[key], rtol=rounded)
    record = noise.simulate(2**14, RATE, seed=0)
    # first differences contain white noise twice and determine N to 0.7 %; the limit is six of these; B and K add less than 0.3 %
    np.testing.assert_allclose(np.sqrt(np.mean(np.diff(record) ** 2) / (2 * RATE)), noise.N, rtol=0.045)


@pytest.mark.parametrize(
    ("key", "floor", "digit", "at", "unit"),
    [(("7.3", "X"), 5.53, 0.005, 14.1, RAD / 3600), (("7.1", "X"), 0.0252, 0.00005, 51.8, 9.80665e-3)],
    ids=["gyroscope", "accelerometer"],
)
def test_the_x_axes_as_printed_cannot_be_readings_of_the_minimum(cases, key, floor, digit, at, unit):
    noise = cases[*key, "as printed"]
    tau = np.geomspace(1.0, 1000.0, 20_001)
    without = np.sqrt(Noise(N=noise.N, K=noise.K).avar(tau))
    assert abs(without.min() / unit - floor) < digit
    assert abs(tau[without.argmin()] - at) < 0.05
    assert without.min() > 0.664 * noise.B
    # the minimum of the other variant equals the value of the column
    np.testing.assert_allclose(np.sqrt(cases[*key, "raw minimum"].avar(tau)).min(), noise.B, rtol=1e-6)


@pytest.fixture(scope="module")
def records(gyro_x):
    return [gyro_x.simulate(SAMPLES, RATE, seed=s) for s in range(8)]


def test_the_joint_fit_recovers_every_coefficient(gyro_x, records):
    fits = [fit(y, RATE) for y in records]
    for found in fits:
        for term in ("N", "B"):
            # the covariance is that of squared coefficients
            miss = float(getattr(found.noise, term)) ** 2 - getattr(gyro_x, term) ** 2
            assert abs(miss) < 3 * np.sqrt(found.covariance[term, term]), (term, miss)
    # the estimate of K^2 is far from Gaussian; three or more of eight intervals miss in six of a thousand tries
    assert sum(found.interval["K"][0] < gyro_x.K < found.interval["K"][1] for found in fits) >= 6
    error = np.array([float(found.noise.B) for found in fits]) / gyro_x.B - 1
    # the bias is -2 % and the scatter 11.4 % per record, which is 4.0 % for the mean of eight; the limits are three of these
    assert -0.14 < error.mean() < 0.10


def test_readings_give_b_44_percent_too_high(gyro_x, records):
    readings = [fit(y, RATE, method="slope").noise for y in records]
    error = np.array([float(noise.B) for noise in readings]) / gyro_x.B - 1
    # the scatter is 13 % per record, which is 4.7 % for the mean of eight; the limits are three of these
    assert 0.30 < error.mean() < 0.58
    assert np.all(error > 0)
    white = np.array([float(noise.N) for noise in readings]) / gyro_x.N - 1
    np.testing.assert_allclose(white, 0.0, atol=0.03)


#: relative rms error of each curve fitted to the exact deviation for N = 0.25 deg/sqrt(h), B = 7.6 deg/h, K = 1.8 deg/h/sqrt(s)
CURVES = {
    "polynomial 5, linear": 1.1, "polynomial 10, linear": 0.82, "polynomial 20, linear": 0.49, "rational 4/2, linear": 0.017,
    "polynomial 5, log-log": 0.010, "polynomial 10, log-log": 0.0004, "polynomial 20, log-log": 8e-7, "rational 4/2, log-log": 0.0019,
}  # fmt: skip


def test_curves_through_the_exact_deviation():
    names = cell("curves")
    tau = np.unique(np.round(np.geomspace(1, SAMPLES // 4, 60))) / RATE
    truth = np.sqrt(np.asarray(Noise(N=0.25 / 60, B=7.6 / 3600, K=1.8 / 3600).avar(tau, dt=1 / RATE)))
    found, poles = names["curves"](tau, truth)
    assert poles == []
    assert set(found) == set(CURVES)
    for name, rms in CURVES.items():
        assert rms / 1.5 < names["relative"](found[name], truth) < 1.5 * rms, name


def test_a_polynomial_is_that_of_numpy():
    random = np.random.default_rng(0)
    u, v = np.sort(random.uniform(-3, 5, 30)), random.standard_normal(30)
    np.testing.assert_allclose(cell("curves")["polynomial"](u, v, 4), np.polyval(np.polyfit(u, v, 4), u), rtol=1e-9, atol=1e-12)


def test_a_rational_function_is_found_and_its_pole_named():
    rational = cell("curves")["rational"]
    u = np.linspace(0.0, 2.0, 41)
    for b, expected in (((0.5, 0.1), False), ((-1.0, 0.0), True)):  # the pole of the second is at 1.0, near a point of the grid
        grid = u + 0.01
        v = (1 + grid**4) / (1 + b[0] * grid + b[1] * grid**2)
        value, pole = rational(grid, v)
        np.testing.assert_allclose(value, v, rtol=1e-6)
        assert pole == expected
