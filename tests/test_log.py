"""The time grid of a `Log`, and checks of its values."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxcal import DataError, Log
from jaxcal._answer import Quantity

RATE = 100.0


@pytest.fixture
def rng():
    return np.random.default_rng(1)


def stamps(n=1000, rate=RATE):
    return np.arange(n) / rate


def noise(n=1000, axes=3, seed=2):
    return np.random.default_rng(seed).normal(size=(n, axes))


def test_a_clean_log_is_as_given():
    gyro, accel = noise(), noise(seed=3)
    log = Log(stamps() + 5.0, gyro, accel, temperature=noise(axes=1)[:, 0])
    assert log.rate == RATE
    assert log.duration == 10.0
    assert (log.gaps, log.warnings) == ((), ())
    np.testing.assert_array_equal(log.gyro, gyro)
    np.testing.assert_array_equal(log.accel, accel)
    np.testing.assert_allclose(log.time, stamps(), rtol=0, atol=1e-12)
    assert log.mag is None
    assert log.provenance["epoch_ns"] == 5 * 10**9
    assert list(log.channels()) == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z", "temperature"]
    assert all(column.shape == (1000,) for column in log.channels().values())


def test_a_rate_makes_the_grid_where_there_are_no_stamps_and_one_axis_is_enough():
    log = Log(None, gyro=noise(axes=1)[:, 0], rate=50)
    assert list(log.channels()) == ["gyro_x"]
    assert log.rate == 50.0
    assert log.time[-1] == pytest.approx(999 / 50)


@pytest.mark.parametrize("n", range(2, 12))
@pytest.mark.parametrize("rate", [1.0, 97.3, 1e4])
def test_a_few_samples_are_enough(n, rate):
    log = Log(stamps(n, rate), noise(n))
    assert (len(log.time), log.gaps) == (n, ())
    assert log.rate == pytest.approx(rate)


@pytest.mark.parametrize("epoch", [0.0, 1.7e9])
def test_the_rate_carries_no_more_digits_than_the_stamps(epoch):
    assert Log(epoch + stamps(), noise()).rate == RATE


def test_dates_are_stamps(rng):
    start = np.datetime64("2024-05-01T12:00:00.000000001", "ns")
    time = start + (np.arange(100) * 5_000_000).astype("timedelta64[ns]")
    log = Log(time, noise(100))
    assert log.rate == 200.0
    assert log.provenance["epoch_ns"] == start.astype(np.int64)


# gaps


def test_dropouts_become_missing_rows(rng, finding):
    keep = np.ones(1000, bool)
    keep[[200, 500, 501, 502]] = False
    gyro = noise()
    log = Log(stamps()[keep], gyro[keep])
    assert [(g.start, g.length, g.samples) for g in log.gaps] == [(2.0, 0.01, 1), (5.0, pytest.approx(0.03), 3)]
    assert np.isnan(log.gyro[~keep]).all()
    np.testing.assert_array_equal(log.gyro[keep], gyro[keep])
    assert finding(log, "gaps").facts == {"count": 4, "total": 1000, "gaps": 2, "longest": pytest.approx(0.03), "at": pytest.approx(5.0)}
    assert "2 gaps, 4 samples (0.4 %) missing" in log.summary()


@given(
    lost=st.sets(st.integers(1, 398), max_size=40),
    jitter=st.sampled_from([0.0, 0.02, 0.05]),
    rate=st.sampled_from([10.0, 97.3, 1000.0]),
    seed=st.integers(0, 10),
)
@settings(max_examples=60, deadline=None)
def test_samples_find_their_place_whatever_is_lost(lost, jitter, rate, seed):
    n = 400
    keep = np.ones(n, bool)
    keep[sorted(lost)] = False
    moved = np.random.default_rng(seed).uniform(-jitter, jitter, n) / rate
    gyro = noise(n)
    log = Log((np.arange(n) / rate + moved)[keep], gyro[keep])
    assert log.rate == pytest.approx(rate, rel=2e-3)
    assert len(log.time) == n
    np.testing.assert_array_equal(log.gyro[keep], gyro[keep])
    assert np.isnan(log.gyro[~keep]).all()


@pytest.mark.parametrize("loss", [0.1, 0.3, 0.5])
def test_heavy_random_loss_is_loss_not_a_lower_rate(rng, loss):
    keep = rng.random(5000) > loss
    keep[[0, -1]] = True
    log = Log(stamps(5000)[keep], noise(5000)[keep])
    assert log.rate == RATE
    assert np.array_equal(np.isfinite(log.gyro[:, 0]), keep)


def test_missing_rows_of_one_sensor_are_gaps():
    accel = noise(seed=4)
    accel[300:310] = np.nan
    log = Log(stamps(), noise(), accel)
    assert [(g.start, g.samples) for g in log.gaps] == [(3.0, 10)]
    assert np.isfinite(log.gyro).all()


def test_a_slow_sensor_is_no_gap(finding):
    mag = np.full((1000, 3), np.nan)
    mag[::10] = noise(100)
    log = Log(stamps(), noise(), mag=mag)
    assert log.gaps == ()
    assert finding(log, "sparse").subject == ("mag",)


def test_long_pauses_between_batches_are_gaps_even_where_they_fill_most_of_the_time():
    time = np.concatenate([np.arange(1024) * 1e-3 + 3.5 * k for k in range(5)])
    log = Log(time, noise(len(time)))
    assert log.rate == 1000.0
    assert len(log.gaps) == 4
    assert log.gaps[0].length == pytest.approx(3.5 - 1.024)


def test_a_gap_of_years_asks_for_a_split(refuses):
    time = stamps()
    time[500:] += 4e8
    with refuses("too_many_missing"):
        Log(time, noise())


# stamps that can be repaired


def shared(time):
    time[500] = time[499]
    return time


@pytest.mark.parametrize(
    ("rows", "change", "code", "fact"),
    [
        ([*range(400), 402, 400, 401, *range(403, 1000)], lambda time: time, "unsorted", {"back": pytest.approx(0.02)}),
        (sorted([*range(1000), 100, 700]), lambda time: time, "copies", {"count": 2}),
        (range(1000), shared, "same_stamp", {"count": 1}),
    ],
)
def test_stamps_are_repaired_and_the_values_stay(rows, change, code, fact, finding):
    gyro = noise()
    log = Log(change(stamps())[list(rows)], gyro[list(rows)])
    np.testing.assert_array_equal(log.gyro, gyro)
    assert fact.items() <= dict(finding(log, code).facts).items()


@pytest.mark.parametrize(("tick", "bits"), [(1e-6, 32), (1e-6, 31), (1e-3, 16)])
def test_a_wrapped_counter_is_unwrapped(tick, bits, finding):
    span = 2.0**bits * tick
    time = np.mod(span - 2.0 + stamps(), span)
    log = Log(time, noise())
    assert (len(log.time), log.gaps) == (1000, ())
    assert log.rate == pytest.approx(RATE, rel=1e-9)
    assert finding(log, "wraps").facts == {"count": 1, "bits": bits, "tick": tick}


def test_stamps_in_bursts_are_spaced_evenly(rng, doubts):
    time = np.repeat(np.arange(100) * 0.1 + rng.normal(scale=2e-3, size=100), 10) + np.tile(np.arange(10) * 1e-5, 100)
    gyro = noise()
    log = Log(time, gyro)
    np.testing.assert_array_equal(log.gyro, gyro)
    assert log.rate == pytest.approx(RATE, rel=0.01)
    assert doubts(log)[0] == "bursts"


def test_a_late_batch_is_no_gap():
    time = stamps()
    time[500:504] += [0.03, 0.021, 0.012, 0.003]
    log = Log(time, noise())
    assert (len(log.time), log.gaps) == (1000, ())


def test_single_precision_stamps_are_rebuilt(finding):
    time = (1.3e5 + stamps(rate=200.0)).astype(np.float32)
    assert np.unique(np.diff(time)).size < 4
    log = Log(time, noise())
    assert (len(log.time), log.gaps) == (1000, ())
    assert log.rate == pytest.approx(200.0, rel=2e-3)
    assert finding(log, "coarse_stamps").facts["resolution"] == pytest.approx(0.0078125, rel=1e-3)
    assert "single precision" in finding(log, "coarse_stamps").facts["single"]


@pytest.mark.parametrize(("share", "doubtful"), [(0.05, ["jitter"]), (0.005, [])])
def test_jitter_works_and_is_told(share, doubtful, rng, finding, doubts):
    gyro = noise(20_000)
    log = Log(stamps(20_000) + rng.normal(scale=share / np.sqrt(2) / RATE, size=20_000), gyro)
    np.testing.assert_array_equal(log.gyro, gyro)
    assert log.rate == pytest.approx(RATE, rel=1e-4)
    assert finding(log, "jitter").facts["percent"] == pytest.approx(100 * share, rel=0.1)
    assert doubts(log) == doubtful


def test_samples_without_a_stamp_are_left_out(finding):
    time = stamps()
    time[10] = np.nan
    log = Log(time, noise())
    assert finding(log, "no_stamp").facts["count"] == 1
    assert np.isnan(log.gyro[10]).all()


# a rate given together with stamps


def test_a_given_rate_within_half_a_percent_is_kept(finding):
    log = Log(stamps(), noise(), rate=100.4)
    assert log.rate == 100.4
    assert finding(log, "rate_given").facts == {"rate": 100.4, "estimate": 100.0}


# stamps that cannot be repaired


@pytest.mark.parametrize(
    ("time", "said"),
    [
        (np.zeros(50), "equal_stamps"), (np.zeros(3), "equal_stamps"), (np.random.default_rng(0).normal(size=500), "irregular"),
        (np.cumsum(np.random.default_rng(0).exponential(size=2000)), "irregular"), (np.full(50, np.nan), "too_short"),
        (np.array([0.0, 1e308, -1e308, 1e308]), "time_unit"), (np.array([0.0, 1e-320, 2e-320]), "time_unit"),
    ],
)  # fmt: skip
def test_stamps_of_no_recording_are_refused(time, said, refuses):
    with refuses(said):
        Log(time, noise(len(time)))


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"time": None}, "no_sensor"), ({"time": None, "gyro": noise()}, "no_rate"), ({"time": stamps(), "gyro": noise(999)}, "lengths"),
        ({"time": stamps(3), "gyro": np.ones((3, 1000))}, "shape"), ({"time": stamps(), "temperature": np.ones((1000, 2))}, "shape"),
        ({"time": np.ones((10, 2)), "gyro": noise(10)}, "shape"), ({"time": ["a", "b"], "gyro": noise(2)}, "stamps"),
        ({"time": stamps(2), "gyro": [["a"] * 3] * 2}, "not_numbers"),
        *(({"time": stamps(), "gyro": noise(), "rate": rate}, "rate_contradicts") for rate in (200, 99.0)),
        *(({"time": None, "gyro": noise(), "rate": rate}, "rate") for rate in (0.0, -1.0, np.nan, np.inf)),
        *(({"time": time, "gyro": np.ones((1, 3)), "rate": 1.0}, "too_short") for time in (None, [0.0])),
    ],
)  # fmt: skip
def test_arrays_that_do_not_fit_are_refused(arguments, said, refuses):
    with refuses(said):
        Log(**arguments)


# values


def test_infinite_values_are_missing_and_counted(finding):
    gyro = noise()
    gyro[5, 1], gyro[9, 2] = np.inf, -np.inf
    log = Log(stamps(), gyro)
    assert finding(log, "infinite").facts["count"] == 2
    assert np.isnan(log.gyro[5, 1])
    assert [g.samples for g in log.gaps] == [1, 1]
    assert np.isinf(gyro[5, 1]), "the caller's array is left alone"


def test_a_channel_of_nothing_is_named(refuses):
    accel = noise()
    accel[:, 2] = np.nan
    with refuses("no_values"):
        Log(stamps(), noise(), accel)


def test_a_frozen_stretch_is_missing(finding):
    gyro = noise()
    gyro[400:480] = gyro[400]
    log = Log(stamps(), gyro)
    facts = finding(log, "frozen").facts
    assert (facts["count"], facts["length"], facts["at"]) == (1, pytest.approx(0.79), pytest.approx(4.0))
    assert [(g.start, g.samples) for g in log.gaps] == [(4.01, 79)]
    assert np.isfinite(log.gyro[400]).all()


@pytest.mark.parametrize(("equal", "frozen"), [(50, False), (51, True)])
@pytest.mark.parametrize("start", [0, 13, 25, 949])
def test_frozen_is_more_than_fifty_wherever_it_starts(equal, frozen, start):
    gyro = noise()
    gyro[start : start + equal] = gyro[start]
    assert bool(Log(stamps(), gyro).gaps) == frozen


def test_a_constant_log_is_said_to_be_constant(finding, doubts):
    log = Log(stamps(), np.ones((1000, 3)))
    assert doubts(log) == ["constant"]
    assert finding(log, "constant").subject == ("gyro_x", "gyro_y", "gyro_z")
    assert log.gaps == ()


def test_clipping_is_counted():
    accel = 20 * noise(5000)
    accel = np.round(accel / 0.01) * 0.01
    accel[:, 0] = np.clip(accel[:, 0], -39.2, 39.2)
    log = Log(stamps(5000), accel=accel)
    top, bottom = np.sum(accel[:, 0] == 39.2), np.sum(accel[:, 0] == -39.2)
    clipped = [(*one.subject, one.facts["count"], one.facts["size"].value) for one in log.findings if one.severity]
    assert clipped == [("accel_x", bottom, -39.2), ("accel_x", top, 39.2)]


def test_the_quantisation_step_is_noted(finding):
    log = Log(stamps(), np.round(noise() / 0.01) * 0.01 * np.pi / 180, accel=noise(seed=5))
    assert finding(log, "steps").facts == {"step": Quantity(0.0001745, "gyro")}


def test_warm_up_is_noted_not_removed(finding):
    time = stamps(9000, 10.0)
    gyro = 0.01 * noise(9000)
    gyro[:300] += 0.02
    log = Log(time, gyro)
    assert str(finding(log, "warm_up")).endswith("log.select(60, None) leaves them out.")
    assert finding(log, "warm_up").spelt("terminal").endswith("--start 60 leaves them out.")
    assert len(log.time) == 9000
    assert "warm_up" not in Log(time, 0.01 * noise(9000)).codes


# parts of a log


def test_a_part_has_its_own_time_and_gaps():
    keep = np.ones(1000, bool)
    keep[[250, 800]] = False
    log = Log((100.0 + stamps())[keep], noise()[keep])
    part = log.select(2.0, 5.0)
    np.testing.assert_array_equal(part.gyro, log.gyro[200:500])
    assert (part.duration, part.rate, part.time[0]) == (3.0, RATE, 0.0)
    assert [g.start for g in part.gaps] == [0.5]
    assert part.provenance["epoch_ns"] == 102 * 10**9
    again = part.select(1.0, None)
    np.testing.assert_array_equal(again.gyro, log.gyro[300:500])
    assert again.provenance["selected"] == (3.0, 5.0)
    assert log.select(-1.0).duration == 1.0


def test_an_empty_part_is_refused(refuses):
    log = Log(stamps(), noise())
    with refuses("empty_part"):
        log.select(20, 30)


def test_a_corrected_log_can_be_built_on_the_grid_of_another():
    keep = np.ones(1000, bool)
    keep[100:140] = False
    log = Log(stamps(rate=97.0)[keep], noise()[keep])
    again = Log(log.time, gyro=2 * log.gyro, rate=log.rate)
    assert (again.rate, again.gaps) == (log.rate, log.gaps)
    np.testing.assert_array_equal(again.gyro, 2 * log.gyro)


def test_the_summary_is_a_few_lines():
    lines = Log(stamps(), noise(), temperature=np.linspace(20, 30, 1000)).summary().splitlines()
    assert lines[0] == "1000 samples at 100 Hz, 10 s, no gaps"
    assert [line.split()[0] for line in lines[1:]] == ["gyro_x", "gyro_y", "gyro_z", "temperature"]
    assert lines[1].endswith("rad/s")


@given(
    st.lists(st.sampled_from([0.0, 1e-3, 0.5, 1.0, 1.0, 1.0, 2.0, 7.0, -1.0, -3.0, 1e6, np.nan]), max_size=60),
    st.lists(st.sampled_from([0.0, 1.0, 2.0, np.nan, np.inf]), min_size=60, max_size=60),
)
@settings(max_examples=200, deadline=None)
def test_any_stamps_are_a_log_or_a_sentence(steps, values):
    time = np.cumsum(np.nan_to_num(steps)) + np.where(np.isnan(steps), np.nan, 0.0)
    try:
        log = Log(time, np.array(values)[: len(time)])
    except DataError:
        return
    assert log.rate > 0
    assert np.isfinite(log.rate)
    assert len(log.time) == len(log.gyro)
    assert np.isnan(log.gyro[:, 0]).sum() == sum(gap.samples for gap in log.gaps)


def test_sensors_with_stamps_of_their_own_keep_their_times(rng):
    # two clocks, both stamped late by up to a tenth of a sample, of which one begins later and stops earlier
    mag_at = 0.5 + np.arange(200) / 23.7
    late = lambda n: rng.uniform(0, 1e-3, n)  # noqa: E731
    log = Log(7.0 + stamps() + late(1000), noise(), mag=noise(200), own_time={"mag": 7.0 + mag_at + late(200)})
    there = np.isfinite(log.mag[:, 0])
    np.testing.assert_array_equal(log.mag[there], noise(200))
    np.testing.assert_array_equal(there, np.isfinite(log.offset["mag"]))
    # the median of the stamps is even; what it is late by is the same for both sensors
    np.testing.assert_allclose((stamps() + log.offset["mag"])[there], mag_at, atol=2e-4)
    assert np.nanmax(np.abs(log.offset["mag"])) < 0.51 / RATE
    part = log.select(2.0, 5.0)
    np.testing.assert_array_equal(part.offset["mag"], log.offset["mag"][200:500])


def test_a_gap_of_half_a_sample_more_does_not_move_the_other_sensors():
    time = stamps()
    time[500:] += 0.1245
    own = np.arange(300) * 0.033
    log = Log(time, noise(), accel=noise(300), own_time={"accel": own})
    row = np.flatnonzero(np.isfinite(log.accel[:, 0]))
    grid = np.concatenate([time[:500], np.full(len(log.time) - 1000, np.nan), time[500:]])
    there = np.isfinite(grid[row])
    np.testing.assert_allclose((grid[row] + log.offset["accel"][row])[there], own[: len(row)][there], atol=5e-4)


def test_a_sensor_at_another_rate_has_no_gaps_but_where_its_stamps_have(rng):
    own = np.delete(np.arange(989) / 99 + 0.003, [100, 500, 501, 502])
    log = Log(stamps(), noise(), accel=noise(len(own)), own_time={"accel": own})
    assert [gap.samples for gap in log.gaps] == [1, 3]
    assert [round(gap.start, 1) for gap in log.gaps] == [1.0, 5.0]


def test_of_two_readings_at_one_sample_the_later_one_stays(finding):
    log = Log(stamps(100, 10.0), noise(100), mag=noise(190), own_time={"mag": np.arange(190) / 19.0})
    assert finding(log, "crowded").subject == ("mag",)
    assert np.isfinite(log.mag).all()


@pytest.mark.parametrize(
    ("own_time", "message"),
    [
        ({"mag": np.arange(20.0)}, "own_time"), ({"accel": np.arange(20.0)}, "own_time"),
        ({"gyro": stamps(), "accel": stamps()}, "own_time"), ({"accel": 1e6 + stamps()}, "other_clock"),
        ({"accel": np.zeros(1000)}, "equal_stamps"),
    ],
)  # fmt: skip
def test_stamps_that_are_not_those_of_the_sensor(own_time, message, refuses):
    with refuses(message):
        Log(stamps(), noise(), noise(seed=3), own_time=own_time)


def test_stamps_of_several_sensors_may_be_dates():
    start = np.datetime64("2026-03-01T12:00:00", "ns")
    ns = lambda t: start + (t * 1e9).round().astype("timedelta64[ns]")  # noqa: E731
    log = Log(ns(stamps()), noise(), mag=noise(300), own_time={"mag": ns(0.032 + np.arange(300) / 40)})
    assert np.flatnonzero(np.isfinite(log.mag[:, 0]))[:3].tolist() == [3, 6, 8]
    np.testing.assert_allclose(log.offset["mag"][[3, 6]], [0.002, -0.003], atol=1e-6)
