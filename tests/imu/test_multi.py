"""`multi_position` with both sensors: scatter of simulated runs against truth and the Cramer-Rao bound, options, refusals and reasons."""

import dataclasses
import re
from types import SimpleNamespace

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import MEMS, Poses, Triad, estimate, multi_position
from jaxcal.imu._result import judged, matrix_error

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


def test_small_residuals_do_not_make_intervals_narrower_than_the_noise_does(found):
    quiet = fit(cases.recording(0, noise={sensor: size / 10 for sensor, size in NOISE.items()}), noise=KNOWN)
    known = found.estimate.error[:21] > 0
    assert np.all(quiet.estimate.error[:21][known] > 0.75 * found.estimate.error[:21][known])


def gyro_known_to(found, error):
    """The estimate with another largest relative standard error of the gyroscope's matrix."""
    known = found.estimate
    size = [error / matrix_error(known, "gyro") if name.startswith("gyro.matrix") else 1.0 for name in known.names]
    return {"estimate": jaxcal.fitting.Estimate(known.names, known.values, np.outer(size, size) * known.matrix, states=known.states)}


@pytest.mark.parametrize(
    ("change", "codes"),
    [
        (lambda found: {}, set()),
        (lambda found: {"down_weighted": (np.arange(4), np.arange(4))}, set()),
        (lambda found: {"down_weighted": (np.arange(5), np.arange(0))}, {"disagree"}),
        (lambda found: {"residual_norm": found.residual_norm[:11]}, {"few_poses"}),
        (lambda found: {"sigma": np.array([0.21, 1e-3, 1e-3])}, {"scatter"}),
        (lambda found: {"residual_turn": np.full(23, 0.09)}, {"turns_disagree"}),
        (lambda found: gyro_known_to(found, 0.009), set()),
        (lambda found: gyro_known_to(found, 0.02), {"poor"}),
        (lambda found: gyro_known_to(found, 0.2), {"gyro_open"}),
    ],
)
def test_findings_begin_at_their_limits(found, change, codes):
    plain = dataclasses.replace(found, findings=())
    fit = estimate(Poses(cases.GRAVITY * cases.UP, np.full(cases.POSES, 2e-3)), gravity=cases.GRAVITY).fit
    options = SimpleNamespace(prior=None, misalignment=True)
    assert judged(dataclasses.replace(plain, **change(found)), fit, options, (), list).codes == codes


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


@pytest.mark.parametrize(("scale", "axes"), [([1, 0.95, 1], ""), ([1, 0.507, 1], "y"), ([0.5, 0.49, 0.51], "xyz")])
def test_an_axis_whose_range_is_set_wrong_is_named(scale, axes):
    log = cases.recording(1)
    found = fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro * scale, rate=log.rate), noise=KNOWN)
    assert found.verdict == ("weak" if axes else "good")
    assert [one.subject for one in found.findings if one.code == "range"] == [(f"gyro_{axis}",) for axis in axes]
    np.testing.assert_allclose(np.diag(found.gyro.matrix), np.diag(MEMS.gyro.matrix) * scale, rtol=0.02)


def test_saturated_turns_are_left_out_and_said_and_saturated_poses_refused():
    log = cases.recording(2)
    limit = 0.97 * np.abs(log.gyro).max()
    clipped = jaxcal.Log(None, accel=log.accel, gyro=np.clip(log.gyro, -limit, limit), rate=log.rate)
    found = fit(clipped)
    assert "turns_lost" in found.codes
    truth = cases.turned_truth()
    assert np.all(np.abs(found.estimate.values - truth) <= 5 * found.estimate.error + 1e-9)
    low = fit(jaxcal.Log(None, accel=log.accel, gyro=np.clip(log.gyro, -0.3, 0.3), rate=log.rate))
    assert low.verdict == "refused"
    assert {"few_turns_left", "turns_lost"} <= low.codes
    poses = fit(jaxcal.Log(None, accel=np.clip(log.accel, -6.0, 6.0), gyro=log.gyro, rate=log.rate))
    assert (poses.verdict, poses.codes) == ("refused", {"few_rests"})


def test_units_and_axes_are_recognised(refuses):
    log = cases.recording(4)
    for size, unit in ((9.80665, "g"), (9.80665e-3, "mg")):
        found = fit(jaxcal.Log(None, accel=log.accel / size, gyro=log.gyro, rate=log.rate))
        assert (found.verdict, found.accel, found.findings[0].facts["unit"]) == ("refused", None, unit)
    known = {"rests": cases.rests()}  # a search for them would fit each threshold
    degrees = fit(jaxcal.Log(None, accel=log.accel, gyro=np.rad2deg(log.gyro), rate=log.rate), **known)
    assert (degrees.verdict, "gyro_unit" in degrees.codes, "range" in degrees.codes) == ("refused", True, False)
    assert any("--units gyro=deg/s" in one.spelt("terminal") for one in degrees.findings)
    turned = fit(jaxcal.Log(None, accel=log.accel, gyro=np.asarray(log.gyro)[:, [1, 0, 2]] * [1, -1, 1], rate=log.rate), **known)
    assert turned.verdict == "refused"
    assert "--axes gyro=-y,x,z" in next(one for one in turned.findings if one.code == "gyro_axes").spelt("terminal")
    with refuses("gravity"):
        multi_position(log, gravity=1.0)


# with y reversed no fit succeeds
@pytest.mark.parametrize(("axis", "axes"), [("z", "x,y,-z"), pytest.param("y", "x,-y,z", marks=pytest.mark.long)])
def test_a_mirrored_axis_is_named(axis, axes, finding):
    log, signs = cases.recording(4), [-1 if one == axis else 1 for one in "xyz"]
    found = fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro * signs, rate=log.rate), rests=cases.rests())
    assert finding(found, "gyro_axes").facts == {"what": f"{axis} is reversed", "axes": axes}


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
    both = fit(cases.recording(0, up=faces), rests=cases.rests())
    assert both.verdict == "good"  # the turns determine the misalignment, which the magnitudes on six faces do not
    assert np.mean(cases.inside(both, cases.turned_truth())[both.estimate.error > 0]) > 0.8
    six = fit(_accel_only(cases.recording(0, up=faces)))
    assert (six.verdict, six.codes) == ("refused", {"attitudes"})
    assert six.observability.weakest == ("misalignment of x and y", "misalignment of x and z", "misalignment of y and z")
    diagonal = multi_position(_accel_only(cases.recording(0, up=faces)), gravity=cases.GRAVITY, model="diagonal")
    assert diagonal.verdict != "refused"
    ten = fit(cases.recording(0, poses=10, up=cases.UP[:10]))
    assert ten.verdict != "good"


def _accel_only(log):
    return jaxcal.Log(None, accel=log.accel, rate=log.rate)


def test_an_accelerometer_alone():
    log = cases.recording(0)
    found, both = fit(_accel_only(log)), fit(log)
    assert (found.gyro, found.verdict, fit(log.select(29.0, None)).verdict) == (None, "good", "good")
    np.testing.assert_allclose(found.estimate.values, both.estimate.values[:12], atol=3 * both.estimate.error[:12].max())
    assumed = multi_position(_accel_only(log), held_out=False)
    assert (assumed.gravity, assumed.verdict, "gravity_assumed" in assumed.codes) == (9.80665, "weak", True)
    assert assumed.headline == "accelerometer scale to 0.3 %, since gravity is assumed"


def test_the_earths_rate_is_taken_off():
    """A tactical-grade unit at latitude 40: without the latitude, the vertical Earth's rate appears as a g-sensitivity of 9.67 deg/h/g."""
    quiet = {"accel": 1e-4, "gyro": 2e-6}
    log = cases.recording(0, latitude=np.deg2rad(40.0), noise=quiet)
    truth = cases.turned_truth()[24:]
    plain, told = (fit(log, rests=cases.rests(), **known) for known in ({}, {"latitude": np.deg2rad(40.0)}))
    bias = np.rad2deg((plain.estimate.values[24:] - truth) * cases.GRAVITY).reshape(3, 3) * 3600
    assert np.mean(np.diag(bias)) == pytest.approx(9.67, abs=1.0)
    left = np.rad2deg((told.estimate.values[24:] - truth) * cases.GRAVITY) * 3600
    assert np.abs(left).max() < 0.7
    assert np.mean(np.abs(told.estimate.values - cases.turned_truth())[12:] <= 3 * told.estimate.error[12:] + 1e-12) > 0.9


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


def test_a_fit_is_drawn_and_a_refused_one_is_not(found, tmp_path, refuses):
    axes = jaxcal.plot.imu(found)
    jaxcal.plot.save(axes, tmp_path / "imu.png")
    assert (tmp_path / "imu.png").stat().st_size > 10_000
    refused = fit(cases.recording(0, poses=7, up=cases.UP[:7]))
    with refuses("refused"):
        jaxcal.plot.imu(refused)
    with refuses("refused"):
        jaxcal.Calibration(imu=refused)
