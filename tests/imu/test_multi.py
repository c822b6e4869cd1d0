"""`multi_position` with both sensors: scatter of simulated runs against truth and the Cramer-Rao bound, options, refusals and reasons."""

import dataclasses
import itertools
import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import jaxcal
from jaxcal.imu import MEMS, Imu, Poses, Triad, multi_position, residuals, weighted
from jaxcal.imu._model import in_convention

from . import cases
from .cases import NOISE

RUNS = 40
KNOWN = {sensor: {"N": value} for sensor, value in NOISE.items()}


def fit(log, **options):
    return multi_position(log, **({"gravity": cases.GRAVITY, "held_out": False} | options))


@pytest.fixture(scope="module")
def found():
    """The fit of one recording with given noise coefficients."""
    return fit(cases.recording(0), noise=KNOWN)


@pytest.fixture(scope="module")
def repeated(found):
    """Fits of recordings of the same motion, each with its own noise; the noise coefficients are given."""
    return [found, *(fit(cases.recording(seed), noise=KNOWN) for seed in range(1, RUNS))]


@pytest.mark.long
def test_intervals_hold_the_truth(repeated):
    truth = cases.turned_truth()
    free = repeated[0].estimate.error > 0
    inside = np.array([cases.inside(f, truth) for f in repeated])[:, free]
    assert free.sum() == 30
    # 40 fits of 30 parameters in correlated groups: the coverage has a standard error of about 1 %, that of ten parameters 1.8 %
    assert 0.925 <= inside.mean() <= 0.975
    for part in (slice(0, 9), slice(9, 18), slice(18, 30)):
        assert 0.905 <= inside[:, part].mean() <= 0.995


@pytest.mark.long
def test_the_scatter_is_the_information_bound(repeated):
    free, inverse = cases.bound(repeated[0])
    errors = np.array([f.estimate.values for f in repeated])[:, free] - cases.turned_truth()[free]
    ratio = np.sqrt(np.mean(errors**2, axis=0) / np.diag(inverse))
    # with 40 runs, one ratio has a standard error of 11 %, and the mean of thirty ratios about 3.5 %
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.12)
    assert ratio.max() < 1.42
    predicted = np.sqrt(np.mean([f.estimate.error[free] ** 2 for f in repeated], axis=0) / np.diag(inverse))
    np.testing.assert_allclose(predicted, 1.0, atol=0.1)


def test_a_good_record_is_called_good_and_says_how_good(found):
    assert (found.verdict, len(found.still), found.convention) == ("good", cases.POSES, "upper")
    assert re.fullmatch(r"accelerometer scale to \d+ ppm, gyroscope scale to \d+ ppm", found.headline)
    assert found.numbers["gyro.bias[0]"].unit == "rad/s"
    np.testing.assert_allclose(found.sigma[0], NOISE["accel"] / np.sqrt(2.0), rtol=0.6)
    assert found.observability.condition < 12


def test_conventions_are_one_calibration(found):
    upper = found
    for convention in ("lower", "full"):
        other = fit(cases.recording(0), noise=KNOWN, convention=convention)
        turned = in_convention(Imu(upper.accel, upper.gyro), convention)
        np.testing.assert_allclose(other.accel.matrix, turned.accel.matrix, atol=1e-12)
        np.testing.assert_allclose(other.gyro.matrix, turned.gyro.matrix, atol=1e-12)
        np.testing.assert_allclose(other.gyro.g_sensitivity, turned.gyro.g_sensitivity, atol=1e-14)
        held = {name for name in other.estimate.names if other.estimate[name].state == "held"}
        assert held == ({"accel.matrix[0,1]", "accel.matrix[0,2]", "accel.matrix[1,2]"} if convention == "lower" else set())


@pytest.mark.long
def test_errors_common_to_a_still_interval_are_in_the_intervals():
    """Each pose has its own error, three times the error of its mean by white noise: intervals must be treated as units of data."""
    white = NOISE["accel"] / np.sqrt(cases.STILL - 1)
    truth = cases.turned_truth()[:12]
    inside, naive = [], []
    for seed in range(12):
        log = cases.recording(seed)
        still = fit(log).still if seed == 0 else still
        rng = np.random.default_rng([seed, 5])
        accel = np.array(log.accel)
        middle = np.r_[0, (still.stop[:-1] + still.start[1:]) // 2, len(accel)]
        for i, j in itertools.pairwise(middle):
            accel[i:j] += 3 * white * rng.normal(size=3)
        found = fit(jaxcal.Log(None, gyro=log.gyro, accel=accel, rate=log.rate), rests=still.ends)
        accel = found.estimate.select("accel.*")
        keep = accel.error > 0
        inside.append((np.abs(accel.values - truth) <= accel.intervals()[:, 1] - accel.values)[keep])
        # intervals that treat every sample as independent data
        naive.append((np.abs(accel.values - truth) < 1.96 * accel.error * white / found.sigma[0])[keep])
    # 108 intervals of nine correlated parameters: the coverage has a standard error of 3 %
    assert np.mean(inside) == pytest.approx(0.95, abs=0.07)
    assert np.mean(naive) < 0.7


def test_counts_without_a_nominal_scale():
    accel, gyro = MEMS.accel, MEMS.gyro
    counts = [Triad(s * t.matrix, s * t.bias + 32768, s * t.g_sensitivity) for s, t in ((400.0, accel), (4800.0, gyro))]
    log = cases.recording(3)
    raw = jaxcal.Log(None, accel=400 * log.accel + 32768, gyro=4800 * log.gyro + 32768, rate=log.rate)
    plain, found = fit(log), fit(raw, raw=True)
    truth = cases.turned_truth(*counts)
    assert np.all(np.abs(found.estimate.values - truth) <= 5 * found.estimate.error + 1e-9)
    np.testing.assert_allclose(found.accel.matrix, 400 * plain.accel.matrix, atol=400 * 1e-6)
    np.testing.assert_allclose(found.gyro.matrix, 4800 * plain.gyro.matrix, atol=4800 * 1e-6)
    refused = fit(raw)
    assert (refused.verdict, refused.codes) == ("refused", {"unit_unknown"})
    assert found.numbers["gyro.bias[0]"].unit == "counts"


@pytest.mark.long
def test_a_disturbed_pose_hardly_matters():
    log = cases.recording(1)
    clean = fit(log)
    accel = np.array(log.accel)
    accel[clean.still.start[5] - 20 : clean.still.stop[5] + 20] *= 1.03
    bumped = jaxcal.Log(None, accel=accel, gyro=log.gyro, rate=log.rate)
    robust, plain = fit(bumped), fit(bumped, loss=None)
    error = [np.abs(f.estimate.values[:12] - clean.estimate.values[:12]).max() for f in (robust, plain)]
    assert error[0] < 0.3 * error[1]
    assert robust.down_weighted[0].tolist() == [5]


def test_saturated_turns_are_left_out_and_said():
    log = cases.recording(2)
    limit = 0.97 * np.abs(log.gyro).max()
    clipped = jaxcal.Log(None, accel=log.accel, gyro=np.clip(log.gyro, -limit, limit), rate=log.rate)
    found = fit(clipped)
    assert "turns_saturated" in found.codes
    truth = cases.turned_truth()
    assert np.all(np.abs(found.estimate.values - truth) <= 5 * found.estimate.error + 1e-9)
    low = fit(jaxcal.Log(None, accel=log.accel, gyro=np.clip(log.gyro, -0.3, 0.3), rate=log.rate))
    assert low.verdict == "refused"
    assert {"few_turns_left", "turns_saturated"} <= low.codes


def test_saturated_poses_are_refused():
    log = cases.recording(2)
    accel = np.clip(log.accel, -6.0, 6.0)
    found = fit(jaxcal.Log(None, accel=accel, gyro=log.gyro, rate=log.rate))
    assert (found.verdict, found.codes) == ("refused", {"saturated"})


def test_units_and_axes_are_recognised(refuses):
    log = cases.recording(4)
    for size, unit in ((9.80665, "g"), (9.80665e-3, "mg")):
        found = fit(jaxcal.Log(None, accel=log.accel / size, gyro=log.gyro, rate=log.rate))
        assert (found.verdict, found.accel, found.findings[0].facts["unit"]) == ("refused", None, unit)
    degrees = fit(jaxcal.Log(None, accel=log.accel, gyro=np.rad2deg(log.gyro), rate=log.rate))
    assert degrees.verdict == "refused"
    assert {"turns_disagree", "gyro_unit"} <= degrees.codes
    assert any("--units gyro=deg/s" in one.spelt("terminal") for one in degrees.findings)
    turned = fit(jaxcal.Log(None, accel=log.accel, gyro=np.asarray(log.gyro)[:, [1, 0, 2]] * [1, -1, 1], rate=log.rate))
    assert turned.verdict == "refused"
    assert next(one for one in turned.findings if one.code == "gyro_axes").facts["axes"] == "-y, +x, +z"
    with refuses("gravity"):
        multi_position(log, gravity=1.0)


def test_too_little_is_refused_and_the_missing_is_named():
    few = fit(cases.recording(0, poses=7, up=cases.UP[:7]))
    assert (few.verdict, few.codes) == ("refused", {"few_rests"})
    assert (few.findings[0].facts["count"], few.findings[0].facts["needed"]) == (7, 9)
    rng = np.random.default_rng(0)
    near = np.array([0.0, 0.1, 1.0]) + 0.02 * rng.normal(size=(cases.POSES, 3))
    alike = fit(cases.recording(0, up=near))
    assert (alike.verdict, alike.codes) == ("refused", {"attitudes_alike"})
    assert "up" in alike.findings[0].facts["missing"]
    faces = np.kron(np.eye(3), np.array([[1.0], [-1.0]]))[np.arange(cases.POSES) % 6]
    both = fit(cases.recording(0, up=faces))
    assert both.verdict == "good"  # the turns determine the misalignment, which the magnitudes on six faces do not
    assert np.mean(cases.inside(both, cases.turned_truth())[both.estimate.error > 0]) > 0.8
    six = fit(_accel_only(cases.recording(0, up=faces)))
    assert (six.verdict, six.codes) == ("refused", {"attitudes"})
    assert six.observability.weakest == ("misalignment of x and y", "misalignment of x and z", "misalignment of y and z")
    diagonal = multi_position(_accel_only(cases.recording(0, up=faces)), gravity=cases.GRAVITY, model="diagonal")
    assert diagonal.verdict != "refused"
    ten = fit(cases.recording(0, poses=10, up=cases.UP[:10]))
    assert ten.verdict != "good"


def test_gravity_that_is_assumed_is_the_uncertainty_of_the_scale():
    found = multi_position(_accel_only(cases.recording(0)), held_out=False)
    assert (found.gravity, found.verdict, "gravity_assumed" in found.codes) == (9.80665, "weak", True)
    assert found.headline == "accelerometer scale to 0.3 %, since gravity is assumed"


def _accel_only(log):
    return jaxcal.Log(None, accel=log.accel, rate=log.rate)


def test_an_accelerometer_alone():
    log = cases.recording(0)
    found, both = fit(_accel_only(log)), fit(log)
    assert found.gyro is None
    assert found.verdict == "good"
    np.testing.assert_allclose(found.estimate.values, both.estimate.values[:12], atol=3 * both.estimate.error[:12].max())


def test_a_record_without_a_rest_at_its_beginning():
    assert fit(cases.recording(0).select(29.0, None)).verdict == "good"


def test_the_earths_rate_is_taken_off():
    """A tactical-grade unit at latitude 40: without the latitude, the vertical Earth's rate appears as a g-sensitivity of 9.67 deg/h/g."""
    quiet = {"accel": 1e-4, "gyro": 2e-6}
    log = cases.recording(0, latitude=np.deg2rad(40.0), noise=quiet)
    truth = cases.turned_truth()[24:]
    plain, told = fit(log), fit(log, latitude=np.deg2rad(40.0))
    bias = np.rad2deg((plain.estimate.values[24:] - truth) * cases.GRAVITY).reshape(3, 3) * 3600
    assert np.mean(np.diag(bias)) == pytest.approx(9.67, abs=1.0)
    left = np.rad2deg((told.estimate.values[24:] - truth) * cases.GRAVITY) * 3600
    assert np.abs(left).max() < 0.7
    assert np.mean(np.abs(told.estimate.values - cases.turned_truth())[12:] <= 3 * told.estimate.error[12:] + 1e-12) > 0.9


def test_a_drifting_bias_is_seen():
    log = cases.recording(0)
    drift = np.array([2e-5, -1e-5, 0.0])
    gyro = log.gyro + drift * (log.time - log.time[-1] / 2)[:, None]
    found = fit(jaxcal.Log(None, accel=log.accel, gyro=gyro, rate=log.rate))
    assert "gyro_drift" in found.codes
    np.testing.assert_allclose(found.drift, drift, atol=2e-6)
    assert np.mean(np.abs(found.estimate.values - cases.turned_truth()) <= 3 * found.estimate.error + 1e-12) > 0.9


def test_options_that_are_no_options(refuses):
    log = cases.recording(0)
    for options, code in (
        ({"convention": "sideways"}, "option"),
        ({"loss": "cubic"}, "option"),
        ({"model": "cubic"}, "option"),
        ({"latitude": 40.0}, "latitude"),
        ({"noise": 3.0}, "noise"),
        ({"noise": {"gyro": {"N": -1.0}}}, "noise"),
    ):
        with refuses(code):
            fit(log, **options)
    with refuses("no_accel"):
        fit(jaxcal.Log(None, gyro=log.gyro, rate=log.rate))


def test_residuals_of_norms_are_traced_and_their_derivatives_exact():
    matrix = np.linalg.inv(np.array([[1.0, 0.01, -0.02], [0.0, 1.1, 0.03], [0.0, 0.0, 0.9]]))
    y, bias = jnp.asarray(cases.UP * 9.7), jnp.array([0.1, 0.2, -0.1])
    data = weighted(Imu(Triad(matrix, bias)), Poses(y, jnp.ones(len(y))), gravity=9.81)

    @jax.jit
    def of(x, reading=data.poses.accel):
        poses = dataclasses.replace(data.poses, accel=reading)
        return residuals(Imu(Triad(x[:9].reshape(3, 3), x[9:])), dataclasses.replace(data, poses=poses))

    flat = jnp.concatenate([jnp.ravel(matrix), bias])
    slope = jax.jit(jax.jacfwd(of))(flat)
    for i in range(12):
        step = 1e-6 * np.eye(12)[i]
        np.testing.assert_allclose(slope[:, i], (of(flat + step) - of(flat - step)) / 2e-6, atol=1e-7)
    # the formulas of the specification: dr/db = n'D
    force = (y - bias[None, :]) @ np.linalg.inv(matrix).T
    n = force / np.linalg.norm(force, axis=1, keepdims=True)
    np.testing.assert_allclose(slope[:, 9:], n @ np.linalg.inv(matrix), atol=1e-12)
    many = jax.jit(jax.vmap(lambda z: of(flat, z)))(jnp.stack([y, 1.01 * y]))
    np.testing.assert_allclose(many[1], of(flat, 1.01 * y), atol=1e-12)


def test_a_fit_is_drawn_and_stored(found, tmp_path, refuses):
    axes = jaxcal.plot.imu(found)
    assert [len(ax.collections[-1].get_offsets()) for ax in axes[:1]] == [0]  # none is weighed down
    drawn = np.concatenate([np.asarray(part.get_offsets()) for part in axes[0].collections if len(part.get_offsets())])
    np.testing.assert_allclose(np.sort(drawn[-cases.POSES :, 1]), np.sort(-1e3 * found.residual_norm), atol=1e-9)
    jaxcal.plot.save(axes, tmp_path / "imu.png")
    assert (tmp_path / "imu.png").stat().st_size > 10_000
    refused = fit(cases.recording(0, poses=7, up=cases.UP[:7]))
    with refuses("refused"):
        jaxcal.plot.imu(refused)
    with refuses("refused"):
        jaxcal.Calibration(imu=refused)
    with pytest.raises(jaxcal.DataError, match="2 Axes for 3 panels"):
        jaxcal.plot.imu(found, ax=axes[:2])
    with refuses("not_a_result"):
        jaxcal.plot.imu(3)
    calibration = jaxcal.Calibration(imu=found)
    calibration.save(tmp_path / "device.json")
    again = jaxcal.Calibration.load(tmp_path / "device.json")
    np.testing.assert_array_equal(again.imu.accel.model.matrix, found.accel.matrix)
    np.testing.assert_array_equal(again.imu.gyro.covariance.values, found.estimate.select("gyro.*").matrix)


@pytest.mark.long
def test_laws_of_constants_and_axes():
    """A constant of the gyroscope is its bias; with the convention "full" no axis is better than another, so that axes exchanged in a
    circle turn all matrices from both sides."""
    log = cases.recording(0)
    gyro, accel = np.asarray(log.gyro), np.asarray(log.accel)
    swap = np.roll(np.eye(3), 1, axis=0)
    found = [
        fit(jaxcal.Log(None, gyro=g, accel=a, rate=log.rate), noise=KNOWN, convention="full")
        for g, a in ((gyro, accel), (gyro + np.array([0.01, -0.02, 0.03]), accel), (gyro @ swap.T, accel @ swap.T))
    ]
    before, moved, turned = found
    np.testing.assert_allclose(moved.gyro.bias, before.gyro.bias + np.array([0.01, -0.02, 0.03]), rtol=1e-5, atol=1e-7)
    np.testing.assert_allclose(moved.gyro.matrix, before.gyro.matrix, rtol=1e-5, atol=1e-6)
    for name in ("accel", "gyro"):
        one, other = getattr(before, name), getattr(turned, name)
        np.testing.assert_allclose(other.matrix, swap @ one.matrix @ swap.T, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(other.bias, swap @ one.bias, rtol=1e-5, atol=1e-7)
