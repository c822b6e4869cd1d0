"""Error budgets beside closed forms, an independent strapdown integration, and one another."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import jaxcal
from jaxcal.budget import Motion, array, increments, propagate, requirement
from jaxcal.calibration import Part, polynomials
from jaxcal.fitting import Estimate
from jaxcal.imu import ThermalTriad
from jaxcal.noise import GaussMarkov, Noise

T, REST, G = 100.0, 60.0, 9.80665
RATIO = REST / T


def last(sensors, group, motion=None, **options):
    """The standard deviation of a group at T."""
    return propagate(sensors, motion or Motion.rest(T), at=[T], **options).std(group)[-1]


@pytest.mark.parametrize(
    ("sensors", "group", "law", "options"),
    [
        (Noise(N=1e-4), "heading", 1e-4 * T**0.5, {}),
        (Noise(K=1e-6), "heading", 1e-6 * (T**3 / 3) ** 0.5, {}),
        (Noise(N=1e-4), "heading", 1e-4 * (T + T**2 / REST) ** 0.5, {"rest": REST}),
        (Noise(K=1e-6), "heading", 1e-6 * (T**3 / 3 + T**2 * REST / 3) ** 0.5, {"rest": REST}),
        (Noise(Q=1e-4), "heading", 1e-4 * 2**0.5, {}),
        # a white process of correlation time tau: K^2 tau^3 (x - 1 + exp(-x))
        (Noise(markov=((1e-5, 5.0),)), "heading", 1e-5 * (125.0 * (T / 5 - 1 + np.exp(-T / 5))) ** 0.5, {}),
        (Noise(further=((1e-5, GaussMarkov(5.0, name="own")),)), "heading", 1e-5 * (125.0 * (T / 5 - 1 + np.exp(-T / 5))) ** 0.5, {}),
        (Noise(R=1e-8), "heading", 1e-8 * T**2 / 2, {}),
        # flicker whose mean over the rest is known
        (
            Noise(B=1e-6), "heading",
            1e-6 * T * np.sqrt((1 + RATIO) / (np.pi * RATIO) * ((1 + RATIO) * np.log(1 + RATIO) - RATIO * np.log(RATIO))), {"rest": REST},
        ),
        ({"accel": Noise(N=1e-3)}, "velocity", 1e-3 * (3 * T) ** 0.5, {}),
        ({"accel": Noise(N=1e-3)}, "position", 1e-3 * T**1.5, {}),
        # a tilt of white noise integrates gravity: two axes of N g sqrt(t^5/20)
        (Noise(N=1e-5), "position", 1e-5 * G * (2 * T**5 / 20) ** 0.5, {}),
        # an accelerometer that shows the level has no error of velocity from its bias in the level axes
        ({}, "tilt", 1e-3 / G * 2**0.5, {"errors": {"accel.bias": [1e-3, 1e-3, 0.0]}, "rest": REST}),
        ({}, "velocity", 1e-3 * T, {"errors": {"accel.bias": [0.0, 0.0, 1e-3]}, "rest": REST}),
        # an attitude filter turns the bias of the accelerometer into a tilt, and the tilt into the heading by the dip
        ({}, "heading", 1e-3 / G * np.tan(1.0), {"errors": {"accel.bias": [1e-3, 0.0, 0.0]}, "aid": 2.0, "dip": 1.0}),
        ({}, "heading", 1e-7 / 5e-5 / np.cos(1.0), {"errors": {"mag.hard_iron": 1e-7}, "aid": 2.0, "dip": 1.0}),
        (Noise(N=1e-4), "heading", 1e-4, {"aid": 2.0, "dip": 0.0}),  # N sqrt(tau/2)
    ],
)  # fmt: skip
def test_closed_forms(sensors, group, law, options):
    assert last(sensors, group, **options) == pytest.approx(law, rel=1e-6)


def test_a_turning_earth_swings_a_velocity():
    """Schuler: at a pole an acceleration error b moves the position by b/w^2 (1 - cos(w t))."""
    swing = (G / 6371e3) ** 0.5
    found = propagate({}, Motion.rest(3600.0), at=[3600.0], latitude=np.pi / 2, errors={"accel.bias": [1e-3, 0.0, 0.0]})
    # the Coriolis acceleration turns the plane of the swing by 15 degrees, which its size hardly feels
    assert np.sqrt(np.trace(found.covariance[-1][6:8, 6:8])) == pytest.approx(1e-3 / swing**2 * (1 - np.cos(swing * 3600)), rel=0.02)


def strapdown(motion, errors):
    """Attitude, velocity and position at the end with constant errors of scale, bias and misalignment: the difference to none."""

    def expm(v):
        return Rotation.from_rotvec(v).as_matrix()

    def end(gyro, accel):
        attitude, v, p = motion.attitude[0] @ expm(-motion.rate[0] * motion.step / 2), np.zeros(3), np.zeros(3)
        for rate, force in zip(motion.rate, motion.force, strict=True):
            w, f = (x + error @ x + bias for x, (error, bias) in ((rate, gyro), (force, accel)))
            a = attitude @ expm(w * motion.step / 2) @ f - [0, 0, G]
            p, v, attitude = p + v * motion.step + a * motion.step**2 / 2, v + a * motion.step, attitude @ expm(w * motion.step)
        return attitude, v, p

    none = (np.zeros((3, 3)), np.zeros(3))
    (c, v, p), (c0, v0, p0) = end(*errors), end(none, none)
    return np.concatenate([Rotation.from_matrix(c @ c0.T).as_rotvec(), v - v0, p - p0])


@pytest.mark.parametrize("motion", [Motion.circle(8.0, period=8.0), Motion.hand(8.0, seed=2)], ids=["circle", "hand"])
@pytest.mark.parametrize("name", ["gyro.scale", "gyro.bias", "accel.scale", "accel.bias"])
def test_an_error_of_calibration_is_integrated(motion, name):
    sensor, _, kind = name.partition(".")
    error, none = np.array([1e-6, 0, 0]), (np.zeros((3, 3)), np.zeros(3))
    own = (np.diag(error), none[1]) if kind == "scale" else (none[0], error)
    truth = np.abs(strapdown(motion, (own, none) if sensor == "gyro" else (none, own)))
    found = np.sqrt(np.diagonal(propagate({}, motion, at=[8.0], errors={name: error}).covariance[-1]))
    np.testing.assert_allclose(found, truth, atol=2e-3 * truth.max() + 1e-12, rtol=2e-2)


SENSORS = {"gyro": Noise(N=1e-4, B=2e-5, K=1e-6), "accel": Noise(N=1e-3, B=2e-4)}


def test_the_shares_make_the_whole_and_the_inverse_agrees():
    motion, errors = Motion.hand(10.0), {"gyro.scale": 1e-3, "accel.misalignment": 1e-3, "gyro.delay": 1e-3, "accel.lever": 0.01}
    found = propagate(SENSORS, motion, rest=5.0, errors=errors, initial=(1e-3, 2e-3))
    whole = np.diagonal(found.covariance, axis1=1, axis2=2)
    np.testing.assert_allclose(sum(found.contributions.values()), whole, rtol=1e-9, atol=1e-30)
    assert len(found.contributions) == 10
    limit = 5 * float(found.std("position")[-1])
    told = requirement(found, after=10.0, position=limit)
    assert told["all"][0] == pytest.approx(5.0)
    turning = {name: size * told["turning"][0] if name != "accel.misalignment" else size for name, size in errors.items()}
    larger = {**SENSORS, "gyro": Noise(N=1e-4 * float(told["gyro N"][0]), B=2e-5, K=1e-6)}
    for sensors, own in ((larger, errors), (SENSORS, turning)):
        again = propagate(sensors, motion, rest=5.0, errors=own, initial=(1e-3, 2e-3))
        assert again.std("position")[-1] == pytest.approx(limit, rel=1e-6)
    assert np.isnan(requirement(found, after=10.0, heading=1e-6)["gyro N"][0])
    assert "large_angles" in propagate(Noise(N=1.0), Motion.rest(1.0)).codes
    with pytest.raises(TypeError):
        requirement(found, after=10.0)


def test_the_uncertainty_of_the_coefficients_is_that_of_repeated_records():
    """Two records of the same sensor: the difference of their budgets is within the intervals."""
    fits = [jaxcal.noise.fit(Noise(N=1e-3).simulate(20_000, rate=100.0, seed=seed), rate=100.0, terms="N") for seed in range(2)]
    budgets = [propagate(jaxcal.Calibration(noise={f"gyro_{axis}": fit for axis in "xyz"}), Motion.rest(60.0)) for fit in fits]
    assert budgets[0].codes == {"no_noise", "exact"}
    numbers = [found.number("heading", found.shown[-1]) for found in budgets]
    assert numbers[0].low < numbers[1].value < numbers[0].high
    limit = 1.001 * numbers[0].value
    length = requirement(budgets[0], after=60.0, heading=limit)["record"][0]  # the interval shrinks with its root
    assert numbers[0].value * (numbers[0].high / numbers[0].value) ** (1 / np.sqrt(length)) == pytest.approx(limit, rel=1e-9)
    assert 2 * numbers[0].half / numbers[0].value == pytest.approx(2 * 1.96 / np.sqrt(2 * 20_000), rel=0.1)


WARM = polynomials(25.0, 0.0, 50.0, gyro=np.outer([0.0, 0.0, 1.0], [1e-6, 1e-8]))
TRIAD = ThermalTriad(
    np.eye(3), np.zeros(3), matrix_powers=1e-4 * np.eye(3)[None], bias_powers=np.array([[0.0, 0.0, 1e-6]]), low=0.0, high=50.0
)


@pytest.mark.parametrize(("imu", "thermal", "errors", "law"), [
    (None, WARM, {"temperature": 2.0}, 2 * (1e-6 + 2 * 10 * 1e-8) * T),  # at 10 degC above the reference
    (None, WARM, {"warming": 0.01}, 0.01 * (1e-6 + 2 * 10 * 1e-8) * T**2 / 2),
    (TRIAD, None, {"temperature": 2.0}, 2 * (1e-4 * 2 * np.pi + 1e-6 * T) / (1 + 1e-3)),
    ("bias_powers[0,2]", None, {}, 1e-3 * 10 * T / (1 + 1e-3)),
    ("matrix_powers[0,2,2]", None, {}, 1e-3 * 10 * 2 * np.pi / (1 + 1e-3)),
])  # fmt: skip
def test_the_thermal_model_is_a_cause(imu, thermal, errors, law):
    known = Estimate((imu,), np.zeros(1), np.array([[1e-6]]), np.inf) if isinstance(imu, str) else None
    part = imu and {"gyro": Part(TRIAD, "rad/s", None, known)}
    motion = Motion.circle(T, period=T)
    found = propagate(jaxcal.Calibration(imu=part, temperature=thermal), motion, at=[T], errors=errors, temperature=35.0)
    assert found.std("heading")[-1] == pytest.approx(law, rel=1e-6)
    assert {cause.split()[-1] for cause in found.contributions} == {"temperature"}


def test_increments_hold_the_errors_of_calibration():
    motion, errors = Motion.hand(6.0, seed=1), {"gyro.scale": 1e-3, "gyro.bias": 1.0}
    found = increments({"gyro": Noise(N=1e-4), "accel": Noise(N=1e-3)}, motion, windows=[1.0, 5.0, 60.0], errors=errors)
    assert found.time.tolist() == [1.0, 5.0]  # the motion is shorter than the last
    alone = increments({"gyro": Noise(N=1e-4)}, motion, windows=[1.0])
    assert alone.factor("gyro")[0] == pytest.approx(1.0)
    assert np.abs(found.contributions["gyro bias"]).max() < 1e-12  # a filter estimates the bias
    assert found.largest("tilt", 5.0)[0][0] == "gyro scale"
    assert found.numbers["gyro.factor[5 s]"].value == pytest.approx(found.factor("gyro")[1])
    np.testing.assert_allclose(found.covariance[0].diagonal(axis1=1, axis2=2).mean(axis=0), sum(found.contributions.values())[0])


def test_an_array_is_its_best_mean():
    noise, weights, _ = array([{"gyro": Noise(N=1.0)}, {"gyro": Noise(N=2.0)}])
    np.testing.assert_allclose(weights["gyro"], [0.8, 0.2])
    assert float(noise["gyro"].N) == pytest.approx(0.8**0.5)
    assert array([{"accel": Noise(N=1.0)}] * 2, lever=[[0, 0, 0], [1, 0, 0]])[2].tolist() == [0.5, 0, 0]


def test_what_is_refused(refuses):
    with refuses("sensors"):
        array([])
    with refuses("no_error"):
        propagate({}, Motion.rest(1.0), errors={"gyro.hard_iron": 1.0})
    with refuses("no_thermal"):
        propagate({}, Motion.rest(1.0), errors={"warming": 1.0})


@pytest.mark.parametrize(("text", "sensor", "term", "value"), [
    ("0.34 °/√hr", "gyro", "N", 9.890e-5), ("0.008 °/sec/√Hz rms", "gyro", "N", 9.873e-5),  # ADIS16470, twice
    ("8 °/hr", "gyro", "B", 5.839e-5), ("13 µg", "accel", "B", 1.919e-4), ("0.037 m/sec/√hr", "accel", "N", 6.167e-4),
    ("3.8 mdps/√Hz", "gyro", "N", 4.690e-5), ("70 ug/rtHz", "accel", "N", 4.854e-4),  # LSM6DSO
    ("0.014 deg/s/sqrt(Hz)", "gyro", "N", 1.728e-4), ("175 µg/√Hz", "accel", "N", 1.2135e-3),  # BMI088
    ("0.05 º/s-rms in 92 Hz", "gyro", "N", 6.433e-5),  # MPU-6050
    ("< 0.04 mg", "accel", "B", 5.905e-4), ("in-run bias stability 10 deg/h", "gyro", "B", 7.298e-5),  # VN-100, MTi
    ("ARW 0.15 deg/sqrt(h)", "gyro", "N", 4.363e-5), ("RRW 0.1 deg/h/sqrt(h)", "gyro", "K", 8.081e-9),  # STIM300
])  # fmt: skip
def test_spellings_of_data_sheets(text, sensor, term, value):
    found = Noise.from_sheet(text)
    assert list(found) == [sensor]
    assert found[sensor].coefficient(term) == pytest.approx(value, rel=1e-3)
