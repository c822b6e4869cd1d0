"""Sessions with labelled regions: imucal's example against imucal's own result, intervals against truth, and refusals."""

import json

import numpy as np
import pytest

import jaxcal
from jaxcal.imu import Triad, ferraris, multi_position

from . import cases, world

REGIONS = [(f"{axis}_{kind}", 600 * i, 600 * i + 500) for i, (axis, kind) in enumerate((a, k) for a in "xyz" for k in ("p", "a", "rot"))]
ACCEL = Triad(np.array([[1.01, 0.01, 0.0], [-0.005, 0.99, 0.002], [0.0, 0.004, 1.02]]), np.array([0.1, -0.2, 0.05]))
GYRO = Triad(np.array([[0.98, 0.01, 0.0], [0.0, 1.01, -0.02], [0.003, 0.0, 1.0]]), np.array([0.01, 0.0, -0.02]), 1e-4 * np.eye(3))

FACES = [f"{axis}_{kind}" for axis in "xyz" for kind in "pa"]


def session(seed, levelling=0.0):
    """Simulate nine labelled regions of 5 s at 100 Hz with 1 s between them, in which the device keeps the attitude without turning."""
    rng = np.random.default_rng(seed)
    f, w = np.zeros((5400, 3)), np.zeros((5400, 3))
    for label, start, _ in REGIONS:
        axis = "xyz".index(label[0])
        up = (-1.0 if label.endswith("a") else 1.0) * np.eye(3)[axis] + levelling * rng.normal(size=3)
        f[start : start + 600] = 9.81 * up / np.linalg.norm(up)
        if label.endswith("rot"):
            f[start : start + 600] = 9.81 * np.eye(3)[(axis + 1) % 3]  # the axis of a turn need not be vertical
            w[start : start + 500] = -2 * np.pi / 5 * np.eye(3)[axis]
    accel, gyro = ACCEL.measure(f) + 0.01 * rng.normal(size=f.shape), GYRO.measure(w, f) + 1e-3 * rng.normal(size=f.shape)
    return jaxcal.Log(None, accel=accel, gyro=gyro, rate=100.0)


def test_the_session_of_imucal(reference):
    folder = reference / "data" / "imu" / "imucal"
    expected = json.loads((folder / "imucal_result.json").read_text())
    log = jaxcal.read(folder / "example_ferraris_session.csv", rate=102.4)
    found = ferraris(log, folder / "example_ferraris_session_list.json", gravity=9.81)
    np.testing.assert_allclose(found.accel.matrix, expected["K_a_R_a"], atol=1e-4)
    np.testing.assert_allclose(found.gyro.matrix, expected["K_g_R_g"], atol=1e-4)
    np.testing.assert_allclose(np.rad2deg(found.gyro.g_sensitivity), expected["K_ga"], atol=1e-4)
    # imucal computes the bias of an axis from two of the faces, jaxcal from all six
    for sensor, bias in (("accel", expected["b_a"]), ("gyro", np.deg2rad(expected["b_g"]))):
        low, high = found.estimate.select(f"{sensor}.bias*").intervals().T
        assert np.all((low <= bias) & (bias <= high))
    assert (found.verdict, found.convention, found.method) == ("good", "box", "ferraris")
    assert found.codes == {"turned_once"}


@pytest.mark.long
def test_intervals_of_a_session_hold_the_truth(tmp_path):
    """The faces are off by 2 mrad. The turns have no such error, so that their intervals are wider than necessary."""
    truth = np.concatenate([np.ravel(part) for part in (ACCEL.matrix, ACCEL.bias, GYRO.matrix, GYRO.bias, GYRO.g_sensitivity)])
    fits = [ferraris(session(seed, 2e-3), REGIONS, gravity=9.81) for seed in range(40)]
    inside = np.array([cases.inside(f, truth) for f in fits])
    # 40 runs of twelve parameters, only a few of them independent: the coverage has a standard error of about 2 %
    assert 0.90 <= inside[:, :12].mean() <= 0.99
    assert 0.89 <= inside[:, 21:].mean() <= 0.99
    assert inside[:, 12:21].mean() >= 0.93
    jaxcal.Calibration(imu=fits[0]).save(tmp_path / "device.json")
    np.testing.assert_array_equal(jaxcal.Calibration.load(tmp_path / "device.json").imu.gyro.model.matrix, fits[0].gyro.matrix)
    # turns that are repeated average their errors and also show how well they repeat
    both = jaxcal.Log(None, accel=np.tile(session(0).accel, (2, 1)), gyro=np.tile(session(0).gyro, (2, 1)), rate=100.0)
    again = ferraris(both, REGIONS + [(label, i + 5400, j + 5400) for label, i, j in REGIONS], gravity=9.81)
    assert not again.codes
    assert len(again.residual_turn) == 6


def test_sessions_that_are_cut_up_or_labelled_row_by_row(tmp_path, refuses):
    log = session(0)
    parts = {label: jaxcal.Log(None, accel=log.accel[i:j], gyro=log.gyro[i:j], rate=100.0) for label, i, j in REGIONS}
    whole, cut = ferraris(log, REGIONS, gravity=9.81), ferraris(parts, gravity=9.81)
    rows = np.full(5400, "", dtype="<U5")
    for label, i, j in REGIONS:
        rows[i:j] = label
    (tmp_path / "log.csv").write_text("t,label\n" + "\n".join(f"{k},{label}" for k, label in enumerate(rows)))
    for found in (cut, ferraris(log, tmp_path / "log.csv", gravity=9.81)):
        np.testing.assert_allclose(found.accel.matrix, whole.accel.matrix, atol=1e-12)
        np.testing.assert_allclose(found.gyro.matrix, whole.gyro.matrix, atol=1e-12)
    with refuses("unlike"):
        ferraris({"x_p": log, "x_a": jaxcal.Log(None, accel=log.accel, rate=100.0)})
    with refuses("region"):
        ferraris({})


def test_labels_that_say_something_else(tmp_path, refuses):
    log = session(0)
    swapped = [(label.replace("x_p", "x_q").replace("x_a", "x_p").replace("x_q", "x_a"), i, j) for label, i, j in REGIONS]
    wrong = [(f"{'xzy'['xyz'.index(label[0])]}{label[1:]}" if "rot" in label else label, i, j) for label, i, j in REGIONS]
    for regions, code in (
        (REGIONS[1:], "missing"),
        (swapped, "label"),
        (wrong, "label"),
        ([*REGIONS, ("lift", 0, 100)], "label"),
        ([*REGIONS, ("x_p", 5000, 9000)], "region"),
        ([*REGIONS, ("x_p", 5)], "region"),
        ([], "region"),
    ):
        with refuses(code):
            ferraris(log, regions, gravity=9.81)
    with refuses("no_gyro"):
        ferraris(jaxcal.Log(None, accel=log.accel, rate=100.0), REGIONS, gravity=9.81)
    for text in ("{", "label,from\na,1\n", "label,start,stop\na,b,c\n"):
        (tmp_path / "regions").write_text(text)
        for path in (tmp_path / "regions", tmp_path / "none"):
            with refuses("region"):
                ferraris(log, path)


@pytest.mark.long
def test_rests_that_are_known_are_taken(refuses):
    log = cases.recording(0)
    found = multi_position(log, gravity=cases.GRAVITY, held_out=False)
    rests = found.still.ends[2:] + np.array([5, -5])
    told = multi_position(log, gravity=cases.GRAVITY, rests=rests[::-1], held_out=False)
    np.testing.assert_array_equal(told.still.start, rests[:, 0])
    assert told.verdict == "good"
    for bad in (rests[0], [[5, 8]], [[0, 99], [50, 90]]):
        with refuses("rests"):
            multi_position(log, gravity=cases.GRAVITY, rests=bad)


@pytest.mark.parametrize(("level", "bias"), [(world.DEGREE, 4e-3), (1e-5, 5e-4)])
def test_faces_that_are_not_level_give_bias_and_scale(level, bias):
    """The mean of six faces would have errors of 0.057 m/s^2 with levels off by a degree."""
    inside, error = [], []
    for seed in range(40):
        accel, ends, truth = world.six_faces(seed, level=level)
        log = jaxcal.Log(None, accel=accel, rate=world.RATE)
        found = ferraris(log, [(label, i, j) for label, (i, j) in zip(FACES, ends, strict=True)], gravity=world.GRAVITY)
        inside.append(cases.inside(found, truth))
        error.append(found.estimate.values[9:] - truth[9:])
        assert ("no_misalignment" in found.codes) == (level > 1e-3)
    assert np.sqrt(np.mean(np.square(error))) < bias
    # 40 runs of twelve parameters: the coverage has a standard error of about 1.5 %
    assert np.mean(inside) > 0.91


def test_the_same_faces_in_counts_as_separate_logs_as_a_table_and_of_less_than_a_second():
    accel, ends, truth = world.six_faces(0)
    whole = ferraris(jaxcal.Log(None, accel=accel, rate=world.RATE), gravity=world.GRAVITY)
    assert np.abs(whole.estimate.values - truth)[9:].max() < 4e-3
    for found in (
        ferraris([jaxcal.Log(None, accel=accel[i:j], rate=world.RATE) for i, j in ends], gravity=world.GRAVITY),
        ferraris(jaxcal.Log(None, accel=np.array([accel[i:j].mean(axis=0) for i, j in ends]), rate=1.0), gravity=world.GRAVITY),
        ferraris(
            jaxcal.Log(None, accel=accel[::10], rate=10.0),
            [(label, i // 10, i // 10 + 9) for label, (i, _) in zip(FACES, ends, strict=True)],
            gravity=world.GRAVITY,
        ),
    ):
        assert np.all(np.abs(found.estimate.values - truth)[9:] < 4 * found.estimate.error[9:])
    counts = np.round(1000 * accel + 32768)
    raw = ferraris(jaxcal.Log(None, accel=counts, rate=world.RATE), gravity=world.GRAVITY, raw=True)
    np.testing.assert_allclose(raw.accel.matrix / 1000, whole.accel.matrix, atol=2e-4)
    assert raw.estimate["accel.bias[0]"].unit == "counts"
