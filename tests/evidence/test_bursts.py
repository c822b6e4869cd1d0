"""What is no noise of a sensor at rest is found, and noise is not. `benchmarks/evidence.py` makes the records, and has more."""

import importlib.util
import pathlib
import warnings

import numpy as np
import pytest

import jaxcal
from jaxcal.batch._tasks import deviations
from jaxcal.evidence import bursts, find
from jaxcal.evidence._findings import percent

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "evidence.py"
_SPEC = importlib.util.spec_from_file_location("benchmark_of_evidence", _PLACE)
records = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(records)
N, RATE = 1.4e-4, 100.0


def seconds(found, rate=RATE):
    return [(first / rate, last / rate) for first, last in found]


@pytest.mark.parametrize("seeds", [range(4), range(4, 8), range(8, 12), (*range(12, 16), 68)])  # 68: values that hardly ever change
def test_noise_has_no_evidence(seeds):
    for seed in seeds:
        y, rate, kind = records.clean(seed, 200_000)
        assert [one.kind for one in find({"gyro": y}, rate) if one.kind != "coarse"] == [], (seed, kind)


@pytest.mark.long
def test_false_alarms_are_rare():
    found = [bool(bursts(y, rate)) for y, rate, _ in map(records.clean, range(1000, 1200))]
    assert sum(found) <= 5  # 1 % of 200, and three standard deviations


@pytest.mark.parametrize("where", ["start", "middle", "end", "twice"])
@pytest.mark.parametrize(("height", "length"), [(0.01, 0.5), (0.03, 1.0), (0.15, 0.2), (0.5, 2.0)])
def test_a_knock_is_found_where_it_is(height, length, where):
    rate, y, known = records.disturbed(7, height, length, where)
    found = seconds(bursts(y, rate), rate)
    np.testing.assert_allclose(found, known, rtol=0, atol=0.5)
    assert {one.kind for one in find({"gyro": y}, rate)} == {"knock"}


def test_putting_down_and_lifting_are_found():
    t = np.arange(60_000) / RATE
    y = records.noise(np.random.default_rng(1), len(t), RATE, n=N)
    y += records.put_down(t)[:, None] * records.AXES
    y[30_000:31_000] += np.cumsum(np.random.default_rng(2).normal(size=(1000, 3)), axis=0) * 4e-3
    (start, stop), (first, last) = seconds(bursts(y, RATE))
    assert start == 0.0
    assert 2.0 < stop < 8.0
    assert first == pytest.approx(300.0, abs=0.5)
    assert last == pytest.approx(310.0, abs=1.0)
    assert [one.kind for one in find({"gyro": y}, RATE)] == ["knock", "moving"]
    t = np.arange(240_000) / 400.0  # more than ten swings above the noise are no tails of it
    y = records.noise(np.random.default_rng(0), len(t), 400.0, n=N) + records.put_down(t, 0.315, 0.8, 2.8)[:, None] * records.AXES
    assert bursts(y, 400.0)[0][1] / 400.0 > 3.5


def test_a_swing_that_dies_away_ends_where_noise_hides_it():
    """Of 1,400 such records the ends are off by 0.48 s at most, with a standard deviation of 0.13 s."""
    for seed in range(12):
        rng = np.random.default_rng([seed, 9])
        rate, height = float(rng.choice([50.0, 100.0, 400.0])), np.exp(rng.uniform(np.log(0.05), np.log(0.5)))
        _, y, _ = records.disturbed(5000 + seed, 0.0, 1.0, "start", rate, 120.0, N)
        y += records.put_down(np.arange(len(y)) / rate, height, frequency=rng.uniform(1.0, 3.0))[:, None] * records.AXES
        # its energy is 36 N^2 there: a signal-to-noise ratio of 6
        assert bursts(y, rate)[0][1] / rate == pytest.approx(0.4 * np.log(0.8 / 4 * (height / N) ** 2 / 36.0), abs=0.5)


def test_a_fifth_of_the_record_may_move():
    t = np.arange(60_000) / RATE
    y = records.noise(np.random.default_rng(3), len(t), RATE, n=N)
    y[48_000:] += 0.3 * np.sin(2 * t[48_000:])[:, None] * records.AXES
    ((first, last),) = seconds(bursts(y, RATE))
    assert first == pytest.approx(480.0, abs=1.0)
    assert last == pytest.approx(600.0, abs=0.1)


@pytest.mark.parametrize("size", [1.0, 3.0, 10.0])
def test_a_step_is_no_knock(size):
    y = records.noise(np.random.default_rng(4), 60_000, RATE, n=N)
    y[30_000:] += size * N * RATE**0.5 * records.AXES
    (one,) = find({"gyro": y}, RATE)
    assert one.kind == "step"
    assert one.start == pytest.approx(300.0, abs=2.0)
    assert one.size == pytest.approx(size * N * RATE**0.5 * 0.74, rel=0.25)


def test_tails_are_no_events_and_single_outliers_are():
    y = np.random.default_rng(5).standard_t(5, size=(60_000, 3))
    assert bursts(y, RATE) == []
    y = np.random.default_rng(5).normal(size=(60_000, 3))
    y[[1000, 20_000]] += 30.0
    assert [first for first, _ in bursts(y, RATE)] == [pytest.approx(1000, abs=4), pytest.approx(20_000, abs=4)]


def test_gaps_and_dead_axes_are_no_events():
    y = records.noise(np.random.default_rng(6), 60_000, RATE, n=N)
    y[10_000:10_500] = np.nan
    y[np.random.default_rng(7).choice(60_000, 600, replace=False), 0] = np.nan
    assert bursts(y, RATE) == []
    y[:, 2] = 0.0
    y[30_000:30_050, 0] += 0.1
    assert len(bursts(y, RATE)) == 1
    assert bursts(np.full((1000, 3), np.nan), RATE) == bursts(np.zeros((1000, 3)), RATE) == bursts(np.zeros((1, 3)), RATE) == []


def test_the_slow_and_the_repeated_count_once():
    y = np.random.default_rng(8).normal(size=(2000, 3)) * 1e-5
    slow = jaxcal.Log(None, mag=np.repeat(y, 20, axis=0), rate=200.0)
    np.testing.assert_array_equal(slow.usable("mag")[np.isfinite(slow.usable("mag")[:, 0])], y)
    packets = np.random.default_rng(9).normal(size=(20_000, 3))
    again = np.zeros(len(packets), bool)
    for start in range(1000, 20_000, 2000):
        packets[start : start + 15] = packets[start]
        again[start + 1 : start + 15] = True
    log = jaxcal.Log(None, gyro=packets, rate=RATE)
    np.testing.assert_array_equal(np.isnan(log.usable("gyro")[:, 0]), again)
    few = np.where(np.random.default_rng(9).random((100_000, 3)) < 0.003, 1.0, 0.0)
    few[5000] = 1.0  # all axes at once among some 900 changes of one
    for coarse in (np.round(0.4 * packets), few):  # rows are equal by chance
        assert not {"held", "stuck"} & {one.kind for one in jaxcal.Log(None, accel=coarse, rate=RATE).evidence}


def test_coarse_rests_are_neither_held_nor_clipped():
    """Steps of 15 mg, rests in six attitudes and turns between: rows are equal at rest, and extremes are frequent."""
    rng = np.random.default_rng(10)
    faces = np.concatenate([np.eye(3), -np.eye(3)]) * 9.81
    parts = [np.linspace(faces[i], faces[(i + 1) % 6], 300) if turn else np.tile(faces[i], (1000, 1)) for i in range(6) for turn in (0, 1)]
    accel = np.concatenate(parts) + 0.02 * rng.normal(size=(7800, 3))
    step = 0.015 * 9.80665
    log = jaxcal.Log(None, accel=np.round(accel / step) * step, rate=RATE)
    assert not {"held", "stuck", "clipped", "zeroed"} & {one.kind for one in log.evidence}
    assert np.isfinite(log.usable("accel")).all()


def test_zeros_of_a_dead_band_are_no_readings():
    gyro = np.random.default_rng(11).normal(size=(20_000, 3)) * 0.003
    gyro[5000:15_000] += np.sin(np.arange(10_000) / 300)[:, None] * [0.5, 1.0, -0.7]
    cut = np.where(np.abs(gyro) < 0.007, 0.0, gyro)
    log = jaxcal.Log(None, gyro=cut, rate=RATE)
    assert {one.kind for one in log.evidence} >= {"zeroed"}
    assert "zeroed" in log.codes
    np.testing.assert_array_equal(np.isnan(log.usable("gyro")), cut == 0.0)
    assert "zeroed" not in jaxcal.Log(None, gyro=np.round(gyro / 0.001) * 0.001, rate=RATE).codes
    accel = gyro + np.array([0.0, 0.0, 9.81])
    accel[-1] = 0.0
    assert np.isnan(jaxcal.Log(None, accel=accel, rate=RATE).usable("accel")[-1]).all()


@pytest.mark.parametrize("step", [1.0, 4.9e-4])
@pytest.mark.parametrize(("bits", "level"), [(16, -20.0), (16, 32_750.0), (32, 30.0), (15, 5.0)])
def test_overflows_of_a_counter_are_undone(bits, level, step):
    """Signed readings stored as unsigned ones, and readings beyond the range of a signed counter."""
    y = np.round(records.noise(np.random.default_rng(15), 20_000, RATE, n=3.0)) + level
    low = 0.0 if level < 1000 else -(2.0 ** (bits - 1))
    given = (low + (y - low) % 2.0**bits) * step
    log = jaxcal.Log(None, gyro=given, rate=RATE)
    np.testing.assert_allclose(log.gyro / step, y, atol=1e-4)
    assert "wrapped" in log.codes
    assert {one.kind for one in log.evidence} - {"coarse"} == {"wrapped"}
    assert {one.kind for one in find({"gyro": given}, RATE)} - {"coarse"} == {"wrapped"}
    assert not {"wrapped"} & set(jaxcal.Log(None, gyro=y, rate=RATE).codes)


@pytest.mark.parametrize(("slower", "later"), [(1, 0), (2, 0), (2, 1000)])
def test_of_two_recordings_in_a_file_the_longer_is_read(slower, later):
    y = np.random.default_rng(16).normal(size=(25_000, 3))
    stamps = np.concatenate([np.arange(15_000), slower * np.arange(10_000) + 100 * later]) / RATE
    log = jaxcal.Log(stamps, gyro=y)
    assert log.rate == pytest.approx(RATE, rel=1e-9)
    np.testing.assert_array_equal(log.gyro, y[:15_000])
    assert "recordings" in log.codes
    late = np.arange(25_000) / RATE
    late[2000], late[20_000:] = 1.0, late[20_000:] + 100.0
    assert "recordings" not in jaxcal.Log(late, gyro=y).codes  # a late stamp, and a gap


def test_a_dead_gyroscope_axis_does_not_cost_the_accelerometer():
    log = jaxcal.imu.simulate(18, rate=50, still=3, turn=2, seed=0)
    dead = jaxcal.Log(None, accel=log.accel, gyro=log.gyro * [1.0, 0.0, 1.0], rate=log.rate)
    found, alone = (jaxcal.imu.multi_position(one, gravity=9.81) for one in (dead, jaxcal.Log(None, accel=log.accel, rate=log.rate)))
    assert "gyro_dead" in found.codes
    assert found.verdict == "weak"
    np.testing.assert_array_equal(found.estimate.select("accel*").values, alone.estimate.select("accel*").values)


def test_interpolated_readings_are_named():
    y = np.random.default_rng(18).normal(size=(20_000, 3))
    for rate in (60.0, 200.0, 250.0, 390.0):
        log = jaxcal.Log(None, gyro=records.resampled(y, "interpolated", rate), rate=400.0)
        (one,) = [one for one in log.findings if one.code == "resampled"]
        assert one.facts["size"] == pytest.approx(rate, rel=1e-3)
    assert "repeats" in jaxcal.Log(None, gyro=records.resampled(y, "copied"), rate=400.0).codes
    t = np.arange(20_000)
    hum, quarter = np.sin(0.9 * t)[:, None], 2.0 * np.sin(2 * np.pi * 0.2515 * t)[:, None]
    for plain in (y, np.round(y), np.cumsum(y, axis=0), y + hum, y + quarter, y * (2.0 + np.sin(0.01 * t))[:, None]):
        assert not {"resampled", "repeats"} & set(jaxcal.Log(None, gyro=plain, rate=400.0).codes)


def test_knocks_and_stamps_leave_the_noise_as_it_is():
    worst, hold, flicker, walk, _ = records.noise_runs(5).T
    assert worst.max() < 0.03
    assert hold.mean() > 0.9
    assert min(flicker.mean(), walk.mean()) >= 0.9


def test_a_log_says_what_was_set_aside_and_keeps_what_is_asked():
    rate, y, _ = records.disturbed(12, 0.1, 1.0, "middle")
    log = jaxcal.Log(None, gyro=y, rate=rate)
    clean = log.cleaned(still=True)
    assert "set_aside" in clean.codes
    assert "something moved at 4:5" in clean.head() or "something moved at 5:00" in clean.head()
    assert clean.evidence == log.evidence
    assert clean.recorded is log
    assert np.isfinite(log.cleaned(still=True, keep=("knock",)).gyro).all()
    assert np.isfinite(log.cleaned().gyro).all()
    part = log.select(0.0, 100.0)
    assert [one.kind for one in part.evidence] == []


def test_of_a_log_of_which_most_is_set_aside_every_answer_at_rest_is_weak():
    y = np.random.default_rng(1).normal(size=(20_000, 3)) * 1e-3
    t = np.arange(13_000) / 100.0
    y[7_000:] += 0.3 * np.sin(2.5 * t + np.sin(0.02 * t))[:, None]
    log = jaxcal.Log(None, gyro=y, rate=100.0).cleaned(still=True)
    for found in (jaxcal.noise.characterise(log), deviations(log)):
        assert (found.verdict, "set_aside" in found.codes) == ("weak", True)
    assert percent(0.998) == 99.0


@pytest.mark.parametrize("rate", [4.37, 5.0, 10.0])
@pytest.mark.parametrize("step", [0.0, 0.5, 3.0])
def test_stamps_of_a_second_lose_no_row(rate, step):
    y = np.random.default_rng(13).normal(size=(20_000, 3))
    y = np.round(y / step) * step if step else y
    log = jaxcal.Log(np.floor(np.arange(20_000) / rate + 0.3), gyro=y)
    assert log.rate == pytest.approx(rate, rel=1e-3)
    assert len(log.time) == 20_000


def test_a_dead_axis_costs_only_itself():
    made = jaxcal.temperature.simulate(jump=0.0)
    gyro = np.stack([made.bias, 0.0 * made.bias, made.bias], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = jaxcal.temperature.characterise(jaxcal.Log(made.time, gyro=gyro, temperature=made.temperature))
    assert sorted(found) == ["gyro_x", "gyro_z"]
    assert [one.subject for one in found.findings if one.code == "constant"] == [("gyro_y",)]
    y = records.noise(np.random.default_rng(17), 20_000, RATE, n=N)
    whole, part = (jaxcal.noise.characterise(jaxcal.Log(None, gyro=y * [1.0, alive, 1.0], rate=RATE)) for alive in (1.0, 0.0))
    assert sorted(part) == ["gyro_x", "gyro_z"]
    assert [one.subject for one in part.findings if one.code == "constant"] == [("gyro_y",)]
    for name in part:
        assert float(part[name].noise.N) == pytest.approx(float(whole[name].noise.N), rel=0.01)


def test_noise_of_a_slow_sensor_is_that_of_its_own_readings():
    y = np.random.default_rng(14).normal(size=(3000, 3)) * 1e-7 + [2e-5, 0.0, 4e-5]
    log = jaxcal.Log(None, mag=np.repeat(y, 20, axis=0), rate=200.0)
    found, own = jaxcal.noise.characterise(log), jaxcal.noise.fit(y, 10.0)
    for axis, name in enumerate(("mag_x", "mag_y", "mag_z")):
        assert float(found[name].noise.N) == pytest.approx(float(own.noise.N[axis]), rel=1e-6)


@pytest.mark.parametrize("value", [0.0, None])
def test_an_axis_that_stops_costs_itself_alone(value):
    y = records.noise(np.random.default_rng(3), 60_000, 100.0)
    dead = y.copy()
    dead[18_000:, 1] = y[18_000, 1] if value is None else value
    log = jaxcal.Log(None, gyro=dead, rate=100.0)
    assert [(one.kind, one.axes) for one in log.evidence] == [("stuck", (1,))]
    assert not log.gaps
    assert [np.isfinite(column).sum() for column in log.gyro.T] == [60_000, 18_001, 60_000]
