"""Theo1 against its double sum; its grid, bias and degrees of freedom."""

import numpy as np
import pytest

from jaxcal.allan import degrees_of_freedom, deviation
from jaxcal.allan._uncertainty._bias import bias_factors, phase_covariance

from .definition import records


def double_sum(theta, m):
    """Double sum of the definition, term by term over offsets."""
    theta, half = np.asarray(theta, dtype=np.longdouble), m // 2
    i = np.arange(len(theta) - m)
    total = np.longdouble(0)
    for d in range(half):
        total += np.sum((theta[i] - theta[i - d + half] + theta[i + m] - theta[i + d + half]) ** 2) / (half - d)
    return total


def theo1_sum(theta, m):
    """The same sum, recovered from the deviation that jaxcal returns."""
    return deviation(theta, 1.0, kind="theo1", m=[m], data="phase").deviation[0] ** 2 * (0.75 * (len(theta) - m) * m**2)


SIZES = (2, 4, 6, 10, 62, 64, 66, 68, 100, 126, 128, 130, 254, 258, 514, 770, 1000, 1134, 1136, 1138, 1198, 1200)


@pytest.mark.parametrize(("name", "error"), [("white", 1e-13), ("walk", 1e-12), ("integrated walk", 1e-10)])
@pytest.mark.parametrize(("length", "sizes", "more"), [(1201, SIZES, 1.0), (30_000, (66, 100, 1000), 100.0)], ids=["short", "cut"])
def test_the_sum_is_the_double_sum(name, error, length, sizes, more):
    """Cluster sizes are near the limit of direct summation, near powers of two, and up to the whole record; a long record is cut."""
    theta = records(length, 3)[name]
    for m in sizes:
        np.testing.assert_allclose(theo1_sum(theta, m), float(double_sum(theta, m)), rtol=more * error, err_msg=str(m))


@pytest.mark.parametrize("data", ["rate", "phase"])
def test_deviation(data):
    y = records(300, 3)["walk"]
    m = np.array([2, 10, 66, 100, 298])
    theta = (np.concatenate([[0.0], np.cumsum(y - y.mean())])) if data == "rate" else y * 5.0
    found = deviation(y, 5.0, kind="theo1", m=m, data=data)
    points = len(theta)
    expected = [np.sqrt(float(double_sum(theta, k)) / (0.75 * (points - k) * k**2)) for k in m]
    np.testing.assert_allclose(found.deviation, expected, rtol=1e-9)
    np.testing.assert_allclose(found.tau, 0.75 * m / 5.0)
    np.testing.assert_array_equal(found.count, (points - m) * m // 2)
    assert np.all(found.lower < found.deviation)
    assert np.all(found.deviation < found.upper)
    channels = deviation(np.stack([y, 2.0 * y], axis=1), 5.0, kind="theo1", m=m, data=data)
    np.testing.assert_allclose(channels.deviation, np.outer(found.deviation, [1.0, 2.0]), rtol=1e-9)


def test_grids_are_even():
    y = records(200, 3)["white"]
    assert deviation(y, 1.0, kind="theo1", m="octave").m.tolist() == [2, 4, 8, 16, 32, 64, 128]
    assert deviation(y, 1.0, kind="theo1", m="decade").m.tolist() == [2, 4, 10, 20, 40, 100, 200]
    assert deviation(y[:9], 1.0, kind="theo1", m="all").m.tolist() == [2, 4, 6, 8]
    log = deviation(y, 1.0, kind="theo1").m
    assert (log[0], log[-1]) == (2, 200)
    assert np.all(log % 2 == 0)
    assert np.all(np.diff(log) > 0)


def test_messages(refuses):
    y = records(100, 3)["white"]
    with refuses("m"):
        deviation(y, 1.0, kind="theo1", m=[10, 7])
    for wrong in (0, 1, 102):
        with refuses("m"):
            deviation(y, 1.0, kind="theo1", m=[wrong])
    with refuses("too_short"):
        deviation(y[:1], 1.0, kind="theo1")
    assert np.all(deviation(np.full(300, 9.81), 1.0, kind="theo1").deviation < 1e-12)


def test_gaps():
    y = records(400, 3)["white"]
    y[[150, 151]] = np.nan
    found, alone = (deviation(v, 1.0, kind="theo1", m=[2, 20, 200]) for v in (y, y[152:]))
    np.testing.assert_allclose(found.deviation, alone.deviation)
    np.testing.assert_allclose(found.edf, alone.edf)
    assert (found.codes, found.findings[0].facts["start"]) == ({"longest_stretch"}, 152)
    assert deviation(y, 1.0, kind="theo1", m=[2, 300]).findings[1].facts == {"tau": "225"}
    np.testing.assert_array_equal(found.skipped, (401 - found.m) * found.m // 2 - found.count)


def quadratic_form(points, m):
    form, half, i = np.zeros((points, points)), m // 2, np.arange(points - m)
    for d in range(half):
        places = ((i, 1), (i - d + half, -1), (i + m, 1), (i + d + half, -1))
        for a, sign_a in places:
            for b, sign_b in places:
                np.add.at(form, (a, b), sign_a * sign_b / (half - d))
    return form / (0.75 * (points - m) * m**2)


@pytest.mark.parametrize("m", [10, 16, 32, 64])
def test_bias_and_edf_against_those_of_gaussian_noise(m):
    """Bias and edf follow from mean and variance of the definition as a quadratic form; the published edf has 16 % up to T/tau = 4."""
    points, kind = 193, "theo1"
    form, time = quadratic_form(points, m), np.arange(points)
    tau = 0.75 * m
    for alpha in (2, 1, 0, -1, -2):
        product = form @ phase_covariance(alpha, time[:, None] - time[None, :])
        allan = (6 * phase_covariance(alpha, 0) - 8 * phase_covariance(alpha, tau) + 2 * phase_covariance(alpha, 2 * tau)) / (2 * tau**2)
        np.testing.assert_allclose(bias_factors(m, alpha, kind, points - 1), np.trace(product) / allan, rtol=1e-9)
        edf = np.trace(product) ** 2 / np.sum(product * product.T)
        np.testing.assert_allclose(degrees_of_freedom(m, alpha, kind, points - 1), edf, rtol=0.16, err_msg=f"alpha {alpha}")


def test_bias_near_the_published_fit():
    """The bias agrees with AVAR/Theo1 = a + b/m^c (NIST SP 1065, table 12), to 15 % for phase noise and to 3 % otherwise."""
    table = {2: (0.09, 0.74, 0.40), 1: (0.14, 0.82, 0.30), 0: (1, 0, 0), -1: (1.87, -1.05, 0.79), -2: (2.70, -1.53, 0.85)}
    for alpha, (a, b, c) in table.items():
        for m in (10, 16, 64, 128):
            found = 1.0 / bias_factors(m, alpha, "theo1", 1000)
            np.testing.assert_allclose(found, a + b / m**c, rtol=0.15 if alpha > 0 else 0.03, err_msg=f"alpha {alpha}, m {m}")


def test_corrected_theo1_of_simulated_noise():
    """For 300 records each of white noise and random walk, the mean is the Allan variance at 0.75 m within 5 standard errors."""
    white = np.random.default_rng(6).standard_normal((512, 300))
    for y, alpha, per_tau in ((white, 0, lambda t: 1.0 / t), (np.cumsum(white, axis=0), -2, lambda t: t / 3.0 + 1.0 / (6.0 * t))):
        found = deviation(y, 1.0, kind="theo1", m=[32, 96], alpha=alpha, bias_corrected=True)
        expected = per_tau(found.tau)
        error = np.sqrt(2.0 / found.edf[:, 0] / 300)
        # a random walk of samples differs from the continuous one, for which the bias is corrected, by (1/m)^2
        assert np.all(np.abs((found.deviation**2).mean(axis=1) / expected - 1.0) < 5.0 * error + 0.002)
