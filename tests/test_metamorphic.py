"""Relations between the results of changed data: other units, axes, order, time and constants, and records that are joined.

Deviations, spectra and the six-position test have no part here: other tests compare them with their definitions, from which these follow.
These relations need no known truth: each follows from the definition of the estimated quantity, as its comment explains. All tests use
the same shapes, so that few programs are compiled.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from jaxcal import alignment, magnetometer, noise, temperature
from jaxcal.alignment import Positions, Readings, Sensor
from jaxcal.noise import Noise

# ruff: noqa: RUF005 (sums of arrays)

RATE = 100.0


def close(found, expected, rtol=1e-9, atol=0.0):
    np.testing.assert_allclose(np.asarray(found), np.asarray(expected), rtol=rtol, atol=atol)


# --- Noise


@pytest.fixture(scope="module", params=["whittle", "gls"])
def fitted(request):
    """A simulated record with N and K, the options of a fit, and the fit."""
    made = noise.Noise(N=1.0, K=2.0).simulate(4096, rate=RATE, seed=1)
    options = {"method": request.param, "terms": ("N", "K")}
    return made, options, noise.fit(made, rate=RATE, **options)


def alike(found, before, factors, rtol):
    """Check that coefficients and intervals are multiplied by the factor of their term, and that verdicts are unchanged."""
    for term, factor in factors.items():
        close(getattr(found.noise, term), factor * getattr(before.noise, term), rtol)
        close(found.interval[term], factor * np.array(before.interval[term]), rtol)
    assert found.verdict == before.verdict


def test_noise(fitted):
    """The fit depends on the record only through its spectrum or its Allan variance."""
    made, options, before = fitted
    assert before.presence == {"N": "present", "K": "present"}
    # coefficients scale with the unit and do not depend on the sign
    alike(noise.fit(1e-3 * made, rate=RATE, **options), before, {"N": 1e-3, "K": 1e-3}, 1e-5)
    alike(noise.fit(-made, rate=RATE, **options), before, {"N": 1.0, "K": 1.0}, 1e-6)
    # neither the spectrum nor the Allan variance depends on a constant
    alike(noise.fit(made + 9.81, rate=RATE, **options), before, {"N": 1.0, "K": 1.0}, 1e-5)
    # nor do they depend on the direction of time
    alike(noise.fit(made[::-1], rate=RATE, **options), before, {"N": 1.0, "K": 1.0}, 1e-5)
    # at a rate c times as high, N^2 is power per Hz and is divided by c; K^2 = S (2 pi f)^2 is multiplied by c^2 / c
    c = 4.0
    alike(noise.fit(made, rate=c * RATE, **options), before, {"N": c**-0.5, "K": c**0.5}, 1e-5)


def test_noise_channels_have_units_of_their_own(fitted):
    """Channels are looked at together for changes of the mean only, so that others move a channel by little of its error."""
    made, options, before = fitted
    both = noise.fit(np.stack([2.0 * made, made], axis=1), rate=RATE, **options)
    for term in ("N", "K"):
        found, (low, high) = np.asarray(getattr(both.noise, term)), before.interval[term]
        close(found[0], 2.0 * found[1], 1e-6)
        assert abs(found[1] - float(getattr(before.noise, term))) < 0.05 * (high - low)
    swapped = noise.fit(np.stack([made, 2.0 * made], axis=1), rate=RATE, **options)
    close(swapped.noise.K, np.asarray(both.noise.K)[::-1], 1e-6)


def test_noise_of_two_records_put_together():
    """Joined records of white noise are white noise: the variance is the mean of both, and the interval is sqrt(2) times narrower."""
    a, b = noise.Noise(N=1.0).simulate(4096, rate=RATE, seed=5), noise.Noise(N=1.0).simulate(4096, rate=RATE, seed=6)
    parts = [noise.fit(x, rate=RATE, terms=("N", "K")) for x in (a, b)]
    both = noise.fit(np.concatenate([a, b]), rate=RATE, terms=("N", "K"))
    close(both.noise.N**2, np.mean([float(part.noise.N) ** 2 for part in parts]), 5e-3)
    width = lambda fit: float(np.diff(fit.interval["N"])[0])  # noqa: E731
    close(width(both), np.mean([width(part) for part in parts]) / np.sqrt(2), 0.05)


# --- Magnetometers


@pytest.fixture(scope="module")
def ball():
    rng = np.random.default_rng(0)
    u = rng.standard_normal((400, 3))
    model = magnetometer.MagModel(np.array([[1.1, 0.05, -0.02], [0.05, 0.95, 0.03], [-0.02, 0.03, 1.0]]), np.array([12.0, -7.0, 30.0]))
    return model.measure(47.0 * u / np.linalg.norm(u, axis=1, keepdims=True)) + 0.2 * rng.standard_normal((400, 3))


@pytest.mark.parametrize("method", ["ml", "constrained"])
def test_magnetometer(ball, method):
    """The readings lie on an ellipsoid; moving, rotating or scaling them does the same to its centre and its matrix."""
    options = {"method": method, "model": "symmetric"}
    before = magnetometer.fit(ball, **options)
    matrix, centre = np.asarray(before.model.soft_iron), np.asarray(before.model.hard_iron)
    tight = 1e-6

    def check(m, soft, hard, rtol=tight):
        found = magnetometer.fit(m, **options)
        close(found.model.hard_iron, hard, rtol, rtol * np.abs(hard).max())
        close(found.model.soft_iron, soft, rtol, rtol)
        assert found.verdict == before.verdict
        return found

    # another unit: the centre scales with it; the shape and the error in degrees do not change
    found = check(1e-6 * ball, matrix, 1e-6 * centre)
    close(found.heading_error, before.heading_error, 1e-4)
    # an additional hard iron: conditions on the quadratic part do not depend on the centre
    check(ball + [5.0, -3.0, 2.0], matrix, centre + [5.0, -3.0, 2.0], 1e-5)
    # a rotated sensor: a symmetric soft iron is rotated from both sides. Traces, the invariants of Li and Griffiths, and distances do not
    # change under a rotation; the condition 4ac - b^2 = 1 is on the section z = const and is unchanged only by rotations about z
    turn = Rotation.from_rotvec([0.0, 0.0, 0.7] if method == "constrained" else [0.3, -1.1, 0.7]).as_matrix()
    check(ball @ turn.T, turn @ matrix @ turn.T, turn @ centre, 1e-5)
    # two axes are exchanged, and one is reversed
    swap = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
    if method == "constrained":
        swap = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    check(ball @ swap.T, swap @ matrix @ swap.T, swap @ centre, 1e-5)
    # a fit of field magnitudes does not depend on time or order
    check(ball[::-1], matrix, centre)
    check(np.random.default_rng(1).permutation(ball), matrix, centre)
    # if every reading is repeated, the ellipsoid is the same
    check(np.concatenate([ball, ball]), matrix, centre, 1e-5)


def test_magnetometer_readings_twice_are_half_the_variance(ball):
    """If every reading is repeated, the formula halves the covariance; noise is per reading, and 9 degrees of freedom are used once.

    The order is random: where the second half repeats the first, parts of the log are not independent, and the errors allow for it.
    """
    twice = np.random.default_rng(0).permutation(np.concatenate([ball, ball]))
    once, twice = (magnetometer.fit(m, model="symmetric") for m in (ball, twice))
    close(twice.estimate.error / once.estimate.error, np.sqrt(0.5), 0.02)


# --- Thermal models


@pytest.mark.parametrize("model", ["polynomial", pytest.param("table", marks=pytest.mark.long)])
def test_temperature(model):
    """Curves are linear in the biases; a polynomial does not depend on the zero of the temperature scale."""
    rng = np.random.default_rng(0)
    t = np.linspace(20.0, 45.0, 3000)
    bias = 1e-3 * (t - 30) + 2e-5 * (t - 30) ** 2 + 1e-3 * rng.standard_normal(3000)
    options = {"model": model} | ({"degree": 3} if model == "polynomial" else {})
    at = np.linspace(21.0, 44.0, 24)

    def curve(t, bias, at=at):
        return np.asarray(temperature.fit(t, bias, **options).model.bias_at(at))

    before = curve(t, bias)
    size = np.ptp(before)
    close(curve(t, -1e3 * bias), -1e3 * before, 1e-7, 1e-7 * 1e3 * size)
    close(curve(t, bias + 2.0), before + 2.0, 1e-7)
    # a static curve does not depend on the direction of time
    close(curve(t[::-1], bias[::-1]), before, 1e-7, 1e-7 * size)
    # a repeated record has the same curve, since all weights double
    close(curve(np.tile(t, 2), np.tile(bias, 2)), before, 1e-7, 1e-7 * size)
    # a shift of the temperature by whole bins changes neither polynomials nor bins
    close(curve(t - 5.0, bias, at - 5.0), before, 1e-6, 1e-6 * size)


# --- Alignment


def test_alignment():
    """The fit is least squares over readings at table angles."""
    angles = np.deg2rad([0.0, 90.0, 180.0, 270.0, 45.0, 200.0])
    positions = Positions(angles, dwell=60.0)
    accel, gyro = Sensor(bias=1e-3, white=5e-4), Sensor(bias=5e-8, white=3e-6)
    latitude = np.deg2rad(40.0)
    made = alignment.simulate(positions, np.deg2rad([3.0, -2.0, 40.0]), latitude, accel=accel, gyro=gyro, seed=3)

    def changed(angles=angles, accel=made.accel, gyro=made.gyro, noise=1.0):
        louder = [Noise(N=noise * float(one.N)) for one in (made.accel_noise, made.gyro_noise)]
        exact = Positions(angles, dwell=60.0, angle_std=0.0)  # errors of the table do not grow with the noise
        return Readings(exact, np.asarray(accel), np.asarray(gyro), accel_noise=louder[0], gyro_noise=louder[1])

    fit = lambda readings: alignment.fit(readings, latitude)  # noqa: E731
    before = fit(changed())
    attitude = np.array([before.phi, before.theta, before.psi])
    # a constant changes the biases, which are free
    moved = fit(changed(gyro=made.gyro + 1e-6, accel=made.accel + 0.01))
    close([moved.phi, moved.theta, moved.psi], attitude, 1e-7)
    close(moved.parameters["b_g"] - before.parameters["b_g"], 1e-6, 1e-6)
    close(moved.parameters["b_a"] - before.parameters["b_a"], 0.01, 1e-6)
    # a sum over positions does not depend on their order
    order = np.array([3, 0, 5, 1, 4, 2])
    shuffled = fit(changed(angles[order], made.accel[order], made.gyro[order]))
    close([shuffled.phi, shuffled.theta, shuffled.psi], attitude, 1e-8)
    # if the zero of the table angle moves, the table's attitude rotates back about its axis
    delta = 0.3
    turned = fit(changed(angles + delta))
    back = Rotation.from_rotvec([0.0, 0.0, delta]).as_matrix()
    matrices = [f.model.matrix for f in (before, turned)]
    ways = [back @ matrices[0], back.T @ matrices[0]]
    close(min(ways, key=lambda way: np.abs(way - matrices[1]).max()), matrices[1], 0.0, 1e-8)
    # noise determines the weights of the sensors; twice the noise in all readings changes only the standard errors
    clean = before.model.measure(positions)
    louder = fit(changed(accel=2 * made.accel - clean[0], gyro=2 * made.gyro - clean[1], noise=2.0))
    close([louder.phi, louder.theta, louder.psi], attitude, 1e-8)
    close(louder.azimuth_std, 2.0 * before.azimuth_std, 1e-6)
