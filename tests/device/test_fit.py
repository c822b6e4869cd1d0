"""`jaxcal.device.fit` on simulated devices: errors, parameters that the motion does not determine, disturbed fields, files."""

import functools

import equinox as eqx
import numpy as np
import pytest
import scipy.signal
from scipy.spatial.transform import Rotation

import jaxcal
from jaxcal.device import fit, simulate
from jaxcal.device._findings import Facts, findings_of


def leaf(model, name):
    """Value of a parameter of a model, by its name."""
    path, _, entry = name.partition("[")
    for part in path.split("."):
        model = getattr(model, part)
    return float(np.asarray(model)[tuple(int(i) for i in entry.rstrip("]").split(","))] if entry else model)


def errors(found, true):
    """Errors of all determined parameters, divided by their standard errors."""
    known = {
        name: error for name, error in zip(found.estimate.names, found.estimate.error, strict=True) if name not in found.estimate.states
    }
    return np.array([(found.estimate[name].value - leaf(true, name)) / error for name, error in known.items()])


def error_of(found, *patterns):
    """Standard errors of the parameters whose names match."""
    return found.estimate.select(*patterns).error


def is_open(found):
    """Names of the parameters without a number."""
    return {name for name, state in found.estimate.states.items() if state == "open"}


def assert_covered(z):
    """Check that normalised errors are plausible for normal variables with any correlation."""
    assert np.sqrt(np.mean(z**2)) < 2.0
    assert np.abs(z).max() < 4.5


@functools.cache
def free():
    log, true, motion = simulate(60.0, 50.0, seed=11)
    return log, true, motion, fit(log)


def test_free_motion_determines_all_sensors_within_their_errors():
    _, true, motion, found = free()
    z = errors(found, true)
    assert len(z) == 37
    assert not is_open(found)
    assert {name for name, state in found.estimate.states.items() if state == "held"} == {
        f"accel.matrix[{i}]" for i in ("1,0", "2,0", "2,1")
    }
    assert_covered(z)
    assert 0.1 < found.reach < 0.5
    # parts of the recording predict each other
    assert found.held_out["magnetometer"] == pytest.approx(1.0, abs=0.12)
    assert max(found.held_out.values()) < 1.1
    assert "held_out.gyro" in found.numbers
    # the attitude agrees with the truth
    index = np.round(found.time * 50).astype(int)
    away = np.einsum("kji,kjl->kil", motion.attitude[index], found.attitude)
    assert np.rad2deg(np.arccos(np.clip((np.trace(away, axis1=1, axis2=2) - 1) / 2, -1, 1))).max() < 0.6


def test_rests_make_the_accelerometer_several_times_better():
    # a bias of 5 deg/s is no rotation
    model = eqx.tree_at(lambda m: m.gyro.bias, free()[1], np.deg2rad([4.0, -2.0, 2.5]))
    log, true, motion = simulate(60.0, 50.0, seed=11, rests=8, still=3.0, model=model)
    found = fit(log)
    assert_covered(errors(found, true))
    assert error_of(found, "accel.bias*").max() < error_of(free()[-1], "accel.bias*").max() / 4
    # the reported rests are true rests
    inside = np.zeros(len(log.time), dtype=bool)
    for start, stop in found.rests:
        inside |= (log.time > start) & (log.time < stop)
    assert np.mean(motion.resting[inside]) > 0.98
    assert np.mean(inside[motion.resting]) > 0.5


def apart(log, every):
    """The log with every n-th reading of each sensor, at times of its own."""
    kept = {name: slice(first, None, step) for name, (first, step) in every.items()}
    readings = {name: getattr(log, name)[own] for name, own in kept.items()}
    main = max(kept, key=lambda name: len(readings[name]))
    own_time = {name: log.time[own] for name, own in kept.items() if name != main}
    return jaxcal.Log(log.time[kept[main]], **readings, own_time=own_time)


def test_sensors_may_be_mounted_in_different_directions(refuses):
    log = simulate(40.0, 25.0, seed=3, rests=4, still=2.0)[0]
    gyro, mag = np.diag([-1.0, -1.0, 1.0]), np.eye(3)[[1, 2, 0]]
    found, turned = fit(log), fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro @ gyro, mag=log.mag @ mag.T, rate=25.0))
    assert not is_open(turned)
    said = [(*one.subject, one.facts["axes"], one.facts["typed"]) for one in turned.findings if one.code == "other_axes"]
    assert said == [("gyro", "-x,-y,z", "gyro=-x,-y,z"), ("magnetometer", "y,z,x", "mag=z,x,y")]
    assert "range" not in turned.codes
    error = error_of(found, "gyro.matrix[0,1]")[0]
    np.testing.assert_allclose(turned.model.gyro.matrix, gyro @ found.model.gyro.matrix, atol=0.1 * error)
    np.testing.assert_allclose(turned.model.magnetometer.soft_iron, mag @ found.model.magnetometer.soft_iron, atol=0.1 * error)
    with refuses("mirrored"):
        fit(jaxcal.Log(None, accel=log.accel, gyro=-log.gyro @ mag.T, mag=log.mag, rate=25.0))


def test_a_drift_of_the_gyroscope_is_named_and_the_bias_is_its_mean():
    log, true, _ = simulate(60.0, 50.0, seed=11, rests=8, still=3.0)
    ramp = np.linspace(-0.5, 0.5, len(log.time))[:, None] * np.deg2rad([0.08, 0.0, 0.06])
    found = fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro + ramp, mag=log.mag, rate=50.0))
    size = next(one.facts["drift"].value for one in found.findings if one.code == "drift")
    assert size == pytest.approx(np.deg2rad(0.1), rel=0.3)  # the standard error is 0.011 deg/s
    assert_covered(errors(found, true))
    assert free()[-1].codes == {"gravity_assumed"}


def test_a_low_pass_of_the_accelerometer_is_no_delay_and_its_cut_off_is_said():
    # the low-pass alone delays by 32 ms, and the fit looks for delays up to 50
    model = eqx.tree_at(lambda m: (m.gyro_delay, m.mag_delay), free()[1], (0.0, 0.01))
    log, true, _ = simulate(
        60.0, 250.0, seed=11, rests=8, still=3.0, model=model, noise={"accel": 0.0, "gyro": np.deg2rad(0.002)}
    )  # fmt: skip
    keep = np.exp(-2 * np.pi * 5.0 / 250.0)
    late = scipy.signal.lfilter([(1 - keep) / 2] * 2, [1.0, -keep], log.accel - log.accel[0], axis=0) + log.accel[0]
    part = {"gyro": log.gyro[::5], "mag": log.mag[::5]}
    noise = 1e-3 * np.sqrt(50.0) * np.random.default_rng(1).normal(size=part["gyro"].shape)
    found = fit(jaxcal.Log(None, accel=late[::5] + noise, rate=50.0, **part))
    said = [(one.subject, one.facts["hertz"]) for one in found.findings if one.code == "low_pass"]
    assert said == [(("accel",), pytest.approx(5.0, rel=0.15))]
    own = found.estimate.select("*.matrix*", "*.bias*", "magnetometer.*")
    z = np.array([(value - leaf(true, name)) / error for name, value, error in zip(own.names, own.values, own.error, strict=True) if error])
    assert_covered(z)


def test_turns_about_the_wrist_are_no_error_of_the_accelerometer():
    arm = np.array([0.1, -0.1, 0.05])
    log, true, _ = simulate(60.0, 50.0, seed=11, reach=0.1, arm=arm)
    found = fit(log)
    assert_covered(errors(found, true))
    np.testing.assert_allclose(found.model.arm, arm, atol=0.03)


def bent(log, true):
    """The log with errors of all sensors that wander."""
    rng = np.random.default_rng(5)

    def wandering(size, seconds):
        keep = np.exp(-1 / (log.rate * seconds))
        steps = size * np.sqrt(1 - keep**2) * rng.normal(size=(len(log.time), 3))
        return scipy.signal.lfilter([1.0], [1.0, -keep], steps, axis=0)

    return jaxcal.Log(
        None, accel=log.accel + wandering(0.02, 2.0), gyro=log.gyro + wandering(np.deg2rad(0.05), 1.0),
        mag=log.mag + wandering(0.005 * float(true.field), 2.0), rate=log.rate,
    )  # fmt: skip


def test_errors_that_are_not_white_make_the_intervals_wider():
    log, true, _ = simulate(60.0, 50.0, seed=11)
    found, plain = fit(bent(log, true)), free()[-1]
    assert_covered(errors(found, true))
    assert np.mean(error_of(found, "*.matrix*")) > 1.3 * np.mean(error_of(plain, "*.matrix*"))
    # what the sensors err by is not taken for a hand that goes away
    assert found.reach < 0.6


def test_noise_of_the_accelerometer_that_the_hand_hides_is_seen_above_its_band():
    # AR(1): at low frequencies the density is (1 + keep) / (1 - keep) = 5.7 times that of samples with this deviation, at the
    # highest frequency less by the same factor. White noise behind a filter is that of the filter's band
    deviation, keep, rng = 0.02, 0.7, np.random.default_rng(1)
    log, *_ = simulate(40.0, 100.0, seed=11, noise={"accel": 0.0})
    white = rng.normal(size=(len(log.time) + 500, 3))
    cases = {
        "white": (white, 1.0, 0.05), "AR(1)": (scipy.signal.lfilter([np.sqrt(1 - keep**2)], [1.0, -keep], white, axis=0), 2.38, 0.4),
        "filter": (scipy.signal.lfilter(*scipy.signal.butter(2, 20.0, fs=100.0), white, axis=0), 1.0, 1.0),
    }  # fmt: skip
    for name, (noise, level, within) in cases.items():
        found = fit(jaxcal.Log(None, accel=log.accel + deviation * noise[500:], gyro=log.gyro, mag=log.mag, rate=log.rate))
        assert found.noise["accel"] / (deviation / np.sqrt(log.rate)) == pytest.approx(level, rel=within), name


def test_turns_about_one_axis_leave_parameters_without_numbers():
    found = fit(simulate(40.0, 25.0, seed=3, turns="one axis")[0])
    assert (found.verdict, found.verdicts["gyro"]) == ("refused", "refused")
    assert "undetermined" in found.codes
    lost = is_open(found)
    assert lost >= {"gyro.matrix[0,0]", "magnetometer.soft_iron[0,0]"}
    document = found.to_dict()
    assert all(document["numbers"][name]["value"] is None and document["numbers"][name]["state"] == "open" for name in lost)
    # undetermined parameters of the model keep their nominal values
    assert leaf(found.model, "gyro.matrix[0,0]") == 1
    assert leaf(found.model, "magnetometer.soft_iron[0,0]") == 1
    with pytest.raises(jaxcal.DataError):
        jaxcal.Calibration(magnetometer=found)


def test_a_stretch_beside_iron_is_named_and_left_out():
    log, true, _ = simulate(60.0, 50.0, seed=11, iron=(25.0, 32.0, 0.3))
    found = fit(log)
    assert all(24.8 < start < stop < 32.2 for start, stop in found.disturbed)
    assert sum(stop - start for start, stop in found.disturbed) > 4
    assert "disturbed" in found.codes
    assert np.abs(errors(found, true)).max() < 4.5


def test_a_field_that_varies_with_the_place_and_a_loose_magnetometer_are_said():
    log, true, motion, _ = free()
    found = fit(simulate(60.0, 50.0, seed=11, gradient=0.05)[0])
    assert (found.verdicts["magnetometer"], "gradient" in found.codes) == ("weak", True)
    # a mount of 10 Hz lags by the angular acceleration over the squared natural frequency
    lag = Rotation.from_rotvec(motion.angular_acceleration / (2 * np.pi * 10.0) ** 2)
    mag = true.magnetometer.measure(lag.apply(true.magnetometer.correct(log.mag)))
    found = fit(jaxcal.Log(None, accel=log.accel, gyro=log.gyro, mag=np.asarray(mag), rate=50.0))
    assert (found.verdicts["magnetometer"], "loose" in found.codes) == ("weak", True)


def test_a_calibration_takes_the_sensors_and_corrects_the_log(tmp_path):
    log, _, motion, found = free()
    calibration = jaxcal.Calibration(imu=found, magnetometer=found)
    calibration.save(tmp_path / "device.json")
    corrected = jaxcal.Calibration.load(tmp_path / "device.json").correct(log)
    assert np.abs(np.mean(corrected.accel - motion.force, axis=0)).max() < 0.03
    assert abs(np.median(np.linalg.norm(corrected.mag, axis=1)) / found.model.field - 1) < 1e-3
    document = found.to_dict()
    assert (document["schema"], set(document["numbers"]) >= {"gyro_delay", "dip"}) == ("jaxcal.DeviceFit/1", True)


def test_missing_samples_and_a_slow_magnetometer_cost_little():
    log, true, _, found = free()
    accel, gyro, mag = (np.array(x) for x in (log.accel, log.gyro, log.mag))
    mag[np.arange(len(mag)) % 5 != 0] = np.nan
    mag[:250] = np.nan  # the magnetometer begins late
    accel[700:701], gyro[900:940] = np.nan, np.nan
    part = fit(jaxcal.Log(None, accel=accel, gyro=gyro, mag=mag, rate=50.0))
    assert_covered(errors(part, true))
    assert error_of(part, "accel.*").max() < 1.5 * error_of(found, "accel.*").max()


SLOWER = {"gyro": (2, 7), "accel": (0, 6), "mag": (3, 31)}


@pytest.mark.parametrize("every", [{"gyro": (0, 6), "accel": (2, 7), "mag": (3, 13)}, pytest.param(SLOWER, marks=pytest.mark.long)])
def test_sensors_with_stamps_of_their_own(every):
    fine, true, _ = simulate(60.0, 360.0, seed=5, swing=2.0)
    log = apart(fine, every)
    found = fit(log)
    assert_covered(errors(found, true))
    # at the nearest samples alone, readings are up to half a sample away from their time
    near = fit(jaxcal.Log(None, **{name: getattr(log, name) for name in every}, rate=log.rate))
    assert error_of(near, "magnetometer.hard_iron[2]")[0] > 1.4 * error_of(found, "magnetometer.hard_iron[2]")[0]


LEFT_OUT = dict.fromkeys(("accel", "gyro", "magnetometer"), 1.1)
PLAIN = Facts(50e-6, None, (np.eye(3), np.eye(3)), np.zeros((5, 3)), {}, {}, 0.0, 100.0, False, None, True, LEFT_OUT)


@pytest.mark.parametrize(
    ("facts", "errors_", "code", "verdict"),
    [
        ({}, {}, None, "good"),
        ({}, {"gyro.bias[0]": 1.1 * np.deg2rad(0.02)}, "inaccurate", "weak"),
        ({}, {"magnetometer.hard_iron[1]": 0.9 * 0.005 * 50e-6}, None, "good"),
        ({}, {"gyro.bias[0]": 21 * np.deg2rad(0.02)}, "inaccurate", "refused"),
        ({}, {"gyro.matrix[1,1]": 1e-4}, "range", "weak"),
        ({"place": np.array([[1.6, 0.0, 0.0], [-1.6, 0.0, 0.0]])}, {}, "far", "weak"),
        ({"place": np.array([[1.4, 0.0, 0.0], [-1.4, 0.0, 0.0]])}, {}, None, "good"),
        ({"disturbed": 19.0}, {}, "disturbed", "good"),
        ({"disturbed": 21.0}, {}, "disturbed", "weak"),
        ({"dead": True}, {}, "dead_band", "weak"),
        ({"disagreement": 4.0}, {}, "disagree", "good"),
        ({"poles": {"accel": 5.0}}, {}, "low_pass", "good"),
        ({"held_out": {"accel": 1.0, "gyro": 1.6, "magnetometer": 1.0}}, {}, "held_out", "weak"),
        ({"converged": False}, {}, "not_converged", "refused"),
    ],
)
def test_findings_begin_at_their_limits(facts, errors_, code, verdict):
    values = [0.51 if "matrix" in name else 0.0 for name in errors_]  # an axis whose range is set wrong by 2
    known = jaxcal.fitting.Estimate(errors_, np.array(values), np.diag(np.square(list(errors_.values())).reshape(-1)))
    found = findings_of(known, PLAIN._replace(**facts))
    assert [one.code for one in found] == ([code] if code else [])
    assert jaxcal._answer.verdict_of(found) == verdict


def test_wrong_calls_are_refused(refuses):
    log = free()[0]
    rare, gone = (np.where(np.arange(len(log.time))[:, None] > least, np.nan, value) for least, value in ((50, log.mag), (600, log.gyro)))
    given = {"accel": log.accel, "gyro": log.gyro, "mag": log.mag}
    for code, change, options in (
        ("gravity", {}, {"gravity": 1.0}), ("few", {"mag": rare}, {}), ("gaps", {"gyro": gone}, {}), ("no_sensor", {"mag": None}, {}),
        ("dead", {"accel": np.tile([0.0, 0.0, 9.8], (len(log.time), 1))}, {}), ("dead", {"gyro": log.gyro * [1.0, 0.0, 1.0]}, {}),
        ("dead", {"mag": log.mag * [1.0, 1.0, 0.0]}, {}),
    ):  # fmt: skip
        with refuses(code):
            fit(jaxcal.Log(None, **given | change, rate=50.0), **options)
    with refuses("short"):
        fit(log.select(0, 10))
