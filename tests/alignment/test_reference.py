"""Readings, closed forms and all roots agree with the reference file, which was computed with 50 digits and rounded to double."""

import numpy as np
import pytest

from jaxcal.alignment import Positions, Turntable, azimuth, level, simulate

from . import cases
from .cases import apart, outcome, unmatched

EARTH = 7.292115e-5


@pytest.fixture(scope="module")
def data(reference):
    return cases.vectors(reference)


@pytest.fixture(scope="module")
def configurations(data):
    return [*data["configurations"], data["paper_case"]["configuration"]]


def test_forward_model(data, configurations):
    places = cases.positions(data["positions"])
    worst = np.zeros(2)
    for case in configurations:
        for kind, accel, gyro in (("ideal", {}, {}), ("real", case["accel"], case["gyro"])):
            errors = {"accel": cases.sensor(accel), "gyro": cases.sensor(gyro)} if accel else {}
            found = simulate(places, case["attitude"], case["latitude"], gravity=case["gravity"], **errors)
            worst[0] = max(worst[0], np.max(np.abs(found.accel - case[f"accel_{kind}"])) / case["gravity"])
            worst[1] = max(worst[1], np.max(np.abs(found.gyro - case[f"gyro_{kind}"]) / (EARTH + abs(gyro.get("bias", 0.0)))))
    assert np.all(worst < 1e-14)


def test_earth_rate_in_table_axes(configurations):
    for case in configurations:
        table = Turntable(*case["attitude"], latitude=case["latitude"])
        w, down = table.earth_rate, table.matrix[:, 2]
        np.testing.assert_allclose(w, case["earth_rate_table"], atol=1e-15)
        assert np.linalg.norm(w) == pytest.approx(1, abs=1e-14)
        assert w @ down == pytest.approx(-np.sin(case["latitude"]), abs=1e-14)


def test_moving_table(data):
    for case in data["moving_table"]:
        place = Positions([case["tau"]], rate=case["table_rate"], acceleration=case["table_acceleration"])
        table = Turntable(*case["attitude"], latitude=case["latitude"])
        # components along body x, y, z, which are the axes of mounting "x"
        force, rate = table.truth(place, lever_arm=case["lever_arm"])
        np.testing.assert_allclose(force[0], case["specific_force"], atol=1e-14 * 9.80665)
        np.testing.assert_allclose(rate[0], case["angular_rate"], atol=1e-14 * max(abs(case["table_rate"]), EARTH))


@pytest.mark.parametrize("method", ["four_point_x", "least_squares_x", "four_point_y", "least_squares_y"])
def test_levels(data, configurations, method):
    for case in configurations:
        expected = case["expected"]["level"]
        found = level(cases.readings(data, case, "ideal"), method=method, gravity=case["gravity"])
        assert apart(found.theta, expected["theta"]) <= expected["tol_theta"], case["name"]
        assert unmatched(expected["phi_roots"], found.phi_roots) <= expected["tol_phi"], case["name"]
        # the z reading selects the correct root
        assert apart(found.phi, case["attitude"][0]) <= expected["tol_phi"], case["name"]
        if expected["status"] == "double_root":
            assert outcome(found) in ("double_root", "clipped"), case["name"]


def test_level_by_bias_and_scale(data, configurations):
    for kind, tolerance in (("ideal", 1e-13), ("real", 1e-10)):
        for case in configurations:
            expected = case["expected" if kind == "ideal" else "expected_real"]["level_bias_and_scale"]
            found = level(cases.readings(data, case, kind), method="bias_and_scale", gravity=case["gravity"])
            assert abs(found.bias - expected["bias"]) < 1e-10 * case["gravity"]
            assert abs(found.scale - expected["scale"]) < tolerance
            assert abs(found.scale_approx - expected["scale_approx"]) < 1e-10
            if kind == "ideal":
                assert apart(found.theta, expected["theta"]) < 1e-11, case["name"]
                assert apart(found.phi, expected["phi"]) < 1e-11 / np.cos(expected["theta"]), case["name"]
    for case in configurations[0::2][: len(data["configurations"]) // 2]:
        found = level(cases.readings(data, case, "real"), method="bias_and_scale", gravity=case["gravity"])
        assert abs(found.scale - 1 - case["accel"]["scale_error"]) < 1e-10
        assert abs(found.bias - case["accel"]["bias"]) < 1e-10 * case["gravity"]


def _azimuth(data, case, method, kind="ideal", **options):
    return azimuth(cases.readings(data, case, kind), np.array(case["attitude"][:2]), case["latitude"], method=method, **options)


def _agrees(found, expected, name):
    """Check the status, then every root."""
    status = expected.get("status", "ok")
    if status == "degenerate":
        assert "degenerate" in found.codes, name
        assert found.psi is None, name
        assert found.roots.size == 0, name
        return
    if status == "infeasible":
        assert "infeasible" in found.codes, name
        return
    assert unmatched(expected["roots"], found.roots) <= expected["tol"], name
    # every root found must be an expected one
    assert unmatched(found.roots, expected["roots"]) <= max(expected["tol"], 2e-6 if status == "double_root" else 0), name
    if status == "double_root":
        assert outcome(found) in ("double_root", "clipped", "undecided"), name


@pytest.mark.parametrize("method", ["opposed", "quadrature", "maximum"])
def test_azimuths_with_several_roots(data, configurations, method):
    for case in configurations:
        expected = case["expected"]["azimuth"][method]
        found = _azimuth(data, case, method)
        _agrees(found, expected, case["name"])
        if method == "maximum":
            assert abs(found.rho - expected["rho"]) < 1e-14


@pytest.mark.parametrize("angle", [0, 45, 120])
def test_azimuths_by_a_single_reading(data, configurations, angle):
    for case in configurations:
        expected = case["expected"]["azimuth"]["single_reading"][str(angle)]
        _agrees(_azimuth(data, case, "single_reading", angle=angle * cases.DEG), expected, case["name"])


def test_azimuths_by_four_points(data, configurations):
    for case in configurations:
        expected = case["expected"]["azimuth"]["four_point"]
        found = _azimuth(data, case, "four_point")
        if expected["status"] == "degenerate":
            assert (outcome(found), found.psi) == ("degenerate", None)
        else:
            assert apart(found.psi, expected["psi"]) <= expected["tol"], case["name"]
        if (real := case["expected_real"]["four_point"]) is not None:
            allowed = 1e-9 if expected["status"] == "ok" else np.inf
            assert apart(_azimuth(data, case, "four_point", "real").psi or 0.0, real) <= max(allowed, expected.get("tol", 0)), case["name"]


@pytest.mark.parametrize("method", ["bias_and_scale", "scale_first"])
def test_azimuths_with_bias_and_scale(data, configurations, method):
    for case in configurations:
        expected = case["expected"]["azimuth"][method]
        found = _azimuth(data, case, method)
        _agrees(found, expected, case["name"])
        if expected["status"] != "ok":
            continue
        if expected["psi"] is None:
            assert (outcome(found), found.psi) == ("undecided", None), case["name"]
        else:
            assert apart(found.psi, expected["psi"]) <= expected["tol"], case["name"]
        for root, scale in zip(expected["roots"], expected["scale"], strict=True):
            near = int(np.argmin(apart(root, found.roots)))
            assert abs(found.scale[near] - scale) <= 1e3 * expected["tol"] * max(abs(scale), 1) ** 2, case["name"]
        if method == "scale_first" and expected.get("scale_approx") is not None:
            assert abs(found.scale_approx - expected["scale_approx"]) < 1e-9, case["name"]
        if method == "bias_and_scale":
            assert abs(found.bias - expected["bias"]) < 1e-15
            positive = expected["positive_roots"]
            assert np.sum(found.scale > 0) == len(positive), case["name"]
            if len(positive) == 2 and expected["psi"] is not None:
                assert outcome(found) in ("scale_chosen", "weak", "double_root"), case["name"]


def test_azimuth_by_triad(data, configurations):
    for case in configurations:
        expected = case["expected"]["azimuth"]["triad"]
        found = _azimuth(data, case, "triad")
        assert apart(found.psi, expected["psi"]) <= expected["tol"], case["name"]
        assert abs(found.latitude - expected["lat"]) <= 1e-11
        assert abs(found.scale[0] - expected["scale"]) <= 1e-13
        assert abs(found.scale_approx - expected["scale_approx"]) <= 1e-13


def test_sensor_errors_without_misalignment_come_back_exactly(data):
    """Configurations of even index have no misalignment: bias, scale and angles equal the truth."""
    for case in data["configurations"][0::2]:
        expected = case["expected"]["azimuth"]["bias_and_scale"]
        for method in ("bias_and_scale", "triad"):
            found = _azimuth(data, case, method, "real")
            if found.psi is None:
                assert expected["status"] != "ok" or expected["psi"] is None, case["name"]
                continue
            chosen = int(np.argmin(apart(found.roots, found.psi)))
            assert abs(found.bias - case["gyro"]["bias"]) < 1e-10 * EARTH
            assert abs(found.scale[chosen] - 1 - case["gyro"]["scale_error"]) < max(1e-10, 1e3 * expected.get("tol", 0)), case["name"]
            assert apart(found.psi, case["attitude"][2]) < max(1e-9, expected.get("tol", 0)), case["name"]


def test_azimuths_of_real_readings(data, configurations):
    for case in configurations:
        expected = case["expected_real"]
        if expected["triad"] is not None:
            found = _azimuth(data, case, "triad", "real")
            assert apart(found.psi, expected["triad"]["psi"]) < 1e-9
            assert abs(found.latitude - expected["triad"]["lat"]) < 1e-10
            assert abs(found.scale[0] - expected["triad"]["scale"]) < 1e-11
        if expected["bias_and_scale"] is not None and expected["bias_and_scale"].get("psi") is not None:
            found = _azimuth(data, case, "bias_and_scale", "real")
            tolerance = max(1e-9, 10 * case["expected"]["azimuth"]["bias_and_scale"].get("tol", np.inf))
            assert unmatched([expected["bias_and_scale"]["psi"]], found.roots) < tolerance, case["name"]
