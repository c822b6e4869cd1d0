"""All rules by which `read` infers columns and units."""

import shlex
import types

import numpy as np
import pytest

from jaxcal import read

DEG, G = np.pi / 180.0, 9.80665
STILL = np.random.default_rng(0).normal(scale=0.01, size=(400, 3))
Z = np.array([0.0, 0.0, 1.0])


@pytest.fixture
def save(tmp_path):
    def write(values, names=None, form="%.10g"):
        path = tmp_path / "log.csv"
        head = "" if names is None else ",".join(names) + "\n"
        path.write_text(head + "".join(",".join(v if isinstance(v, str) else form % v for v in row) + "\n" for row in values))
        return path

    return write


@pytest.fixture
def guess(tmp_path):
    """``guess(name, rate=None, gyro=..., time=...)`` returns the inferred unit of a sensor or of time, the reason, and an alternative."""

    def run(name, rate=None, units=None, **arrays):
        np.savez(tmp_path / "log.npz", **arrays)
        log = read(tmp_path / "log.npz", rate=rate, units=units, quiet=True)
        one = next(one for one in log.findings if one.code in ("read_as", "assumed") and one.subject == (name,))
        unit, reason = one.facts["unit"], one.facts["why"].removeprefix(" (").removesuffix(")")
        assert unit == log.provenance["units"][name]
        assert "--units " + shlex.quote(f"{name}={one.facts['other']}") in one.spelt("terminal")
        return types.SimpleNamespace(unit=unit, reason=reason, other=one.facts["other"], sure=one.code == "read_as")

    return run


# the unit of time


@pytest.mark.parametrize(
    ("start", "step", "unit", "certain"),
    [
        (10, 10, "ms", True), (7, 2500, "us", False), (7, 10_000, "us", True), (7, 2_500_000, "ns", False), (1007, 2, "ms", False),
        (7, 40, "ms", True), (7, 400, "ms", False), (7, 40_000, "us", True), (7, 400_000, "us", False), (7.25, 0.005, "s", True),
        (7.25, 0.1, "s", True), (7.25, 1.5, "s", False), (10.25, 10.0, "ms", True), (0, 1000, "us", False), (0, 1001, "us", False),
        (752, 1001, "ms", False), (5_000_000, 10_000, "us", True), (90_000_000, 1500, "us", False), (2_100_000_000, 5000, "us", False),
    ],
)  # fmt: skip
def test_start_and_step_tell_the_unit_of_time(start, step, unit, certain, guess):
    found = guess("time", time=start + step * np.arange(100), gyro=STILL[:100])
    assert found.unit == unit
    assert ("uncertain, could be" in found.reason) == (not certain) == (not found.sure)
    assert found.other != unit


@pytest.mark.parametrize(("rate", "unit"), [(1000, "us"), (1, "ms")])
def test_turns_tell_the_unit_of_time(rate, unit, guess):
    """Gravity turns with 0.3 rad a sample or a thousandth of it; the same stamps then are ms or us."""
    angle = np.cumsum(np.sin(np.arange(3000) / 200)) * 0.02
    accel = 9.8 * np.column_stack([np.sin(angle), 0 * angle, np.cos(angle)]) + 0.02 * np.random.default_rng(0).normal(size=(3000, 3))
    gyro = np.column_stack([0 * angle, -np.gradient(angle) * rate, 0 * angle])
    found = guess("time", time=7_000_000 + 1000 * np.arange(3000), gyro=gyro, accel=accel, units="gyro=rad/s")
    assert (found.unit, found.sure) == (unit, True)


@pytest.mark.parametrize("start", [0, 1, 7.0])
def test_a_column_that_counts_rows_is_no_time_whatever_it_is_called(start, guess, refuses):
    with refuses("no_rate"):
        guess("time", time=start + np.arange(100), gyro=STILL[:100])


@pytest.mark.parametrize(("unit", "ticks"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_an_epoch_tells_the_unit_of_time(unit, ticks, guess):
    found = guess("time", time=1.7e9 * ticks + 0.01 * ticks * np.arange(100), gyro=STILL[:100])
    assert (found.unit, found.reason) == (unit, f"starts at {1.7e9 * ticks:.4g}, as time since 1970 does")


@pytest.mark.parametrize(("rate", "unit"), [(100.0, "us"), (100_000.0, "ms")])
def test_a_given_rate_settles_the_unit_of_time(rate, unit, guess):
    step = {"us": 10_000.0, "ms": 0.01}[unit]
    assert guess("time", rate, time=step * np.arange(100), gyro=STILL[:100]).unit == unit


# units of sensors


@pytest.mark.parametrize(("unit", "gravity"), [("m/s^2", 9.80665), ("g", 1.0), ("mg", 1000.0)])
@pytest.mark.parametrize("share", [0.9, 1.0, 1.1])
def test_gravity_tells_the_unit_of_the_accelerometer(unit, gravity, share, guess):
    found = guess("accel", 100.0, accel=gravity * (STILL * 0.1 + [0.6 * share, 0.0, -0.8 * share]))
    assert (found.unit, "uncertain" in found.reason) == (unit, False)


def test_a_gyroscope_beyond_35_is_in_degrees(guess):
    values = STILL.copy()
    values[100, 1] = -36.0
    assert guess("gyro", 100.0, gyro=values).unit == "deg/s"


def turns(rate=100.0):
    """Simulate turns of 90 degrees about x and about y in 2 s each, with rests before, between and after; rad/s and m/s^2."""
    rng = np.random.default_rng(3)
    gyro, accel, down = [], [], np.array([0.0, 0.0, 1.0])
    for axis in (None, 0, None, 1, None):
        for _ in range(int(2 * rate) if axis is not None else int(4 * rate)):
            w = np.zeros(3)
            if axis is not None:
                w[axis] = np.pi / 4
                down = down - np.cross(w, down) / rate
                down /= np.linalg.norm(down)
            gyro.append(w)
            accel.append(G * down)
    gyro, accel = np.array(gyro), np.array(accel)
    return gyro + 0.002 * rng.normal(size=gyro.shape), accel + 0.02 * rng.normal(size=accel.shape)


@pytest.mark.parametrize(("unit", "size"), [("rad/s", 1.0), ("deg/s", DEG)])
def test_turns_between_still_stretches_tell_the_unit_of_the_gyroscope(unit, size, guess):
    gyro, accel = turns()
    # the turns are so slow that the size of the rates does not determine the unit
    found = guess("gyro", 100.0, gyro=gyro / size * (1.0 if unit == "rad/s" else 0.7), accel=accel)
    assert (found.unit, found.sure) == (unit, True)
    assert "times the turns of gravity" in found.reason


def directions(n=500):
    v = np.random.default_rng(5).normal(size=(n, 3))
    return v / np.linalg.norm(v, axis=1, keepdims=True)


@pytest.mark.parametrize(("unit", "size"), [("T", 1e-6), ("G", 1e-2), ("uT", 1.0), ("mG", 10.0), ("nT", 1e3)])
@pytest.mark.parametrize("field", [23.0, 48.0, 66.0])
def test_the_field_behind_hard_iron_tells_the_unit_of_the_magnetometer(unit, size, field, guess):
    # the hard iron is three times the field, so that the magnitude of raw readings would suggest another unit
    found = guess("mag", 100.0, mag=size * (field * directions() + [150.0, -20.0, 90.0]))
    assert (found.unit, found.reason) == (unit, f"sphere radius {field * size:.3g}")


@pytest.mark.parametrize(
    ("name", "values"),
    [("accel", np.round(16384 * (STILL + Z))), ("accel", STILL + 3.0), ("gyro", np.round(300 * STILL + 20)),
     ("mag", np.round(1000 * directions()))],
)  # fmt: skip
def test_counts_and_values_of_unknown_size_are_asked_about(name, values, guess, refuses):
    with refuses("unit_unknown"):
        guess(name, 100.0, **{name: values})


@pytest.mark.parametrize(("values", "unit"), [([298.0, 299.0], "K"), ([25.0, 26.0], "degC"), ([-40.0, 85.0], "degC")])
def test_temperature(values, unit, guess):
    assert guess("temperature", 100.0, temperature=np.array(values)).unit == unit


# columns without names


def data(still, order):
    return {"gyro": still.gyro, "accel": still.accel / G, "mag": still.mag * 1e6, "time": still.time[:, None]}[order]


@pytest.mark.parametrize("order", ["gyro accel", "accel gyro", "gyro accel mag", "accel gyro mag", "gyro", "accel", "mag"])
@pytest.mark.parametrize("at", [0, None])
def test_triples_are_told_apart_by_their_norm(order, at, still, save):
    order = order.split()
    parts = [data(still, name) for name in order]
    if at is not None:
        parts.insert(at, still.time[:, None])
    log = read(save(np.column_stack(parts)), rate=None if at is not None else 100.0, quiet=True)
    for name in ("gyro", "accel", "mag"):
        if name in order:
            np.testing.assert_allclose(getattr(log, name), getattr(still, name), rtol=1e-8, atol=1e-12)
        else:
            assert getattr(log, name) is None


@pytest.mark.parametrize(
    ("width", "names", "code"),
    [*((width, None, "columns_unclear") for width in (2, 4, 5, 8)), (6, None, "no_gravity"), (2, ["time", "gx", "gz"], "axes")],
)
def test_columns_that_do_not_say_which_they_are_are_asked_about(width, names, code, still, save, refuses):
    with refuses(code):
        read(save(np.column_stack([still.time, np.tile(still.gyro, (1, 3))[:, :width]]), names), quiet=True)


def test_names_alike_but_for_a_letter_are_those_of_one_device_unless_they_hold_biases(still, save, refuses):
    names = ["t", *(f"X{sensor}{axis}" for sensor in "gam" for axis in "xyz")]
    values = np.column_stack([still.time, still.gyro, still.accel, 48.0 + still.gyro])
    log = read(save(values, names), quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-8)
    assert log.provenance["columns"] == {"time": [0], "gyro": [1, 2, 3], "accel": [4, 5, 6], "mag": [7, 8, 9]}
    with refuses("columns_unclear"):
        read(save(np.column_stack([still.time, 0.1 * still.gyro, 0.2 * still.gyro]), names[:7]), quiet=True)


def test_what_is_suggested_for_a_guess_from_the_values_changes_it(still, save):
    path = save(np.column_stack([still.time, still.accel]), ["t", "foo_x", "foo_y", "foo_z"])
    given = next(one for one in read(path, quiet=True).findings if one.code == "roles").facts["given"]
    assert given == "gyro=1,2,3"
    assert "roles" not in read(path, columns=given, units="gyro=deg/s", quiet=True).codes


def test_a_rising_column_of_unknown_name_is_time(still, save):
    log = read(save(np.column_stack([still.gyro, still.time]), ["gx", "gy", "gz", "tow"]), quiet=True)
    assert log.provenance["columns"]["time"] == [3]


# notes and warnings, and options that override them


def test_every_guess_is_one_sentence_with_its_override(still, save):
    ns = [str(10_000_000 * i) for i in range(400)]
    path = save([[t, *row] for t, row in zip(ns, np.column_stack([still.gyro, still.accel]).tolist(), strict=True)])
    log = read(path, quiet=True)
    assert [(one.code, one.subject, one.kind.guess) for one in log.findings] == [
        ("roles", (), True), ("read_as", ("time",), False), ("assumed", ("gyro",), True), ("read_as", ("accel",), False),
    ]  # fmt: skip
    said = [one.spelt("terminal") for one in log.findings]
    assert said[1].endswith("If the unit is wrong: --units time=us.")
    assert said[2].endswith("If the unit is wrong: --units gyro=deg/s.")
    assert str(log.findings[2]).endswith("If the unit is wrong: units={'gyro': 'deg/s'}.")
    assert max(map(len, said)) < 200
    assert log.rate == 100.0


def test_explicit_options_switch_every_guess_off(still, save):
    path = save(np.column_stack([still.time * 1e3, still.gyro, still.accel]))
    log = read(path, columns="time=0,gyro=4:6,accel=1:3", units="time=ms,gyro=deg/s,accel=g", quiet=True)
    assert log.codes == ("against_values",)
    assert log.rate == pytest.approx(100.0)
    np.testing.assert_allclose(log.gyro, still.accel * DEG, rtol=1e-8)
    np.testing.assert_allclose(log.accel, still.gyro * G, rtol=1e-8)
    assert log.provenance["units"] == {"time": "ms", "gyro": "deg/s", "accel": "g"}


def test_an_explicit_unit_wins_over_the_header(still, save):
    path = save(np.column_stack([still.time, still.gyro]), ["time_s", "gx_dps", "gy_dps", "gz_dps"])
    log = read(path, units={"gyro": "rad/s"}, quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-8)


def test_named_columns_select_the_sensors(still, save):
    path = save(np.column_stack([still.time, still.gyro, still.accel]), ["t", "gx", "gy", "gz", "ax", "ay", "az"])
    log = read(path, columns={"accel": ["ax", "ay", "az"]}, quiet=True)
    assert log.gyro is None
    assert log.provenance["columns"] == {"accel": [4, 5, 6], "time": [0]}
    single = read(path, columns={"gyro": "gz"}, quiet=True)
    np.testing.assert_allclose(single.gyro[:, 0], still.gyro[:, 2], rtol=1e-8)


def test_stamps_can_be_left_out(still, save):
    path = save(np.column_stack([still.time, still.gyro]), ["t", "gx", "gy", "gz"])
    assert read(path, columns={"time": None}, rate=7.0, quiet=True).rate == 7.0
    assert read(path, columns="time=none,gyro=1:3", rate=7.0, quiet=True).rate == 7.0


def test_a_rate_that_contradicts_the_stamps_is_refused(still, save, refuses):
    path = save(np.column_stack([still.time, still.gyro]), ["time_s", "gx", "gy", "gz"])
    with refuses("rate_contradicts"):
        read(path, rate=102, quiet=True)
