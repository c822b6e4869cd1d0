"""Spread, outliers and trends over the logs of a run."""

import dataclasses
import datetime
import pathlib
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jaxcal._answer import Number
from jaxcal.batch import Fleet, run
from jaxcal.batch._fleet import Entry


def entries(table, *, half=0.0, dates=None, unit=""):
    """Entries of a run, each with the coefficients of one row of `table`."""
    rows = []
    for i, row in enumerate(table):
        limits = lambda v: (v - half, v + half) if half else (np.nan, np.nan)  # noqa: E731
        known = {name: Number(name, float(v), *limits(v), unit) for name, v in row.items()}
        rows.append(Entry(pathlib.Path(f"unit{i}.csv"), "done", None, False, known, (), "0", dates and dates[i], 1.0, None))
    return rows


def spread_of(entries):
    return Fleet(tuple(entries)).spread


def gaussian(n, k, seed):
    rng = np.random.default_rng(seed)
    return [{f"a{j}": x for j, x in enumerate(row)} for row in rng.standard_normal((n, k))]


@pytest.mark.long
@pytest.mark.parametrize(("n", "k"), [(5, 4), (12, 24), (60, 8), (300, 2)])
def test_fleets_without_outliers_or_trends_rarely_have_one(n, k):
    """At most 5 % of the runs have outliers, and 5 % have trends; 150 runs determine these shares to 1.8 %."""
    odd = trends = 0
    runs = 150
    for seed in range(runs):
        found = spread_of(entries(gaussian(n, k, seed))).values()
        odd += any(one.outliers for one in found)
        trends += any(one.trends for one in found)
    assert odd / runs < 0.05 + 3 * 0.0178
    assert trends / runs < 0.05 + 3 * 0.0178


def test_spread_of_a_gaussian_fleet_is_that_of_its_distribution():
    table = [{"a": 5 + 2 * row["a0"]} for row in gaussian(4000, 1, 0)]
    one = spread_of(entries(table, half=0.392))["a"]
    assert one.median == pytest.approx(5.0, abs=0.2)
    assert one.sigma == pytest.approx(2.0, rel=0.06)
    assert (one.low, one.high) == (pytest.approx(5 - 2 * 1.645, abs=0.25), pytest.approx(5 + 2 * 1.645, abs=0.25))
    assert one.own == pytest.approx(0.2, rel=1e-4)


def test_an_outlier_is_named_with_its_reason_and_does_not_hide_behind_another():
    table = gaussian(40, 3, 2)
    table[7]["a1"], table[9]["a1"] = 30.0, -1000.0
    found = spread_of(entries(table, unit="rad/s"))
    assert {o.name for o in found["a1"].outliers} == {"unit7.csv", "unit9.csv"}
    assert not found["a0"].outliers
    high = next(o for o in found["a1"].outliers if o.name == "unit7.csv")
    assert "a1 = 30 rad/s" in high.reason
    assert "above the median" in high.reason
    assert "of 40 logs" in high.reason


def test_a_log_that_knows_its_coefficient_badly_is_no_outlier():
    table = gaussian(40, 1, 1)
    table[7]["a0"] = 30.0
    fleet = entries(table)
    assert spread_of(fleet)["a0"].outliers
    fleet[7] = dataclasses.replace(fleet[7], coefficients={"a0": Number("a0", 30.0, -30.0, 90.0)})
    assert not spread_of(fleet)["a0"].outliers


def test_noise_is_compared_by_factors():
    """A tenth of the median counts as far away as ten times the median, so that a skewed distribution of noise has no outliers."""
    rng = np.random.default_rng(0)
    values = np.exp(rng.standard_normal(200))
    fleet = spread_of(entries([{"gyro_x.N": v, "linear": v} for v in values]))
    assert not fleet["gyro_x.N"].outliers
    assert fleet["linear"].outliers
    low = np.exp(0.1 * rng.standard_normal(40))
    low[3] = 0.1
    assert [o.name for o in spread_of(entries([{"gyro_x.N": v} for v in low]))["gyro_x.N"].outliers] == ["unit3.csv"]


def test_equal_values_missing_values_and_few_logs():
    same = spread_of(entries([{"a": 1.0}] * 10))["a"]
    assert (same.sigma, same.outliers, same.trends) == (0.0, (), ())
    gone = spread_of(entries([{"a": np.nan}] * 10))["a"]
    assert (gone.count, gone.outliers) == (0, ())
    some = spread_of(entries([{"a": float(i) if i % 2 else np.nan} for i in range(12)]))["a"]
    assert some.count == 6
    few = spread_of(entries([{"a": 1.0}, {"a": 2.0}, {"a": 1e9}]))["a"]
    assert np.isinf(few.limit)
    assert spread_of([]) == {}


def test_a_trend_over_serial_number_and_date_has_its_slope():
    rng = np.random.default_rng(0)
    day = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    order = rng.permutation(40)
    dates = [(day + datetime.timedelta(days=int(order[i]))).isoformat() for i in range(40)]
    table = [{"serial": 3.0 + 0.5 * i + rng.standard_normal(), "date": -2.0 * order[i] + rng.standard_normal()} for i in range(40)]
    found = spread_of(entries(table, dates=dates))
    (along,) = found["serial"].trends
    assert (along.along, along.slope) == ("serial number", pytest.approx(0.5, rel=0.1))
    (along,) = found["date"].trends
    assert (along.along, along.slope) == ("date", pytest.approx(-2.0, rel=0.05))
    assert "falls with the date" in along.reason
    assert "per day" in along.reason


def judged(log):
    """A task whose coefficient N depends on the number in the log's name; one log is an outlier."""
    number = int(log.provenance["file"].removeprefix("unit").removesuffix(".npz").removesuffix("<i>"))
    bias = np.random.default_rng(number).standard_normal()
    return {"gyro_x.N": 1.0 + 0.05 * number, "bias": 77.0 if number == 4 else bias}


def test_the_page_shows_spread_outliers_trends_and_failures(tmp_path):
    logs = tmp_path / "logs"
    logs.mkdir()
    for i in range(30):
        time = np.delete(np.arange(60), [20, 21, 22] if i == 7 else []) / 100  # a gap causes a warning
        np.savez(logs / f"unit{i}{'<i>' * (i == 7)}.npz", time=time, gyro=np.random.default_rng(i).standard_normal((len(time), 3)))
    (logs / "bad<b>.csv").write_text("no log & no sense")
    with ThreadPoolExecutor(2) as pool:
        run(logs, judged, executor=pool, out=tmp_path / "out")
        page = (tmp_path / "out" / "overview.html").read_text()
        for text in ("31 logs, 30 answered, 1 not", "1 of 30 logs stand out: unit4.npz", "gyro_x.N rises with the serial number",
                     "bad&lt;b&gt;.csv", "unit7&lt;i&gt;.npz", "bias = 77"):  # fmt: skip
            assert text in page
        assert "<b>.csv" not in page
        assert page.count("<svg") == 2 + 1  # a row of points for each coefficient, and the trend
        run(logs / "bad<b>.csv", judged, executor=pool, out=tmp_path / "none")
    assert "No log was answered" in (tmp_path / "none" / "overview.html").read_text()
