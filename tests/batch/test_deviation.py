"""`batch.deviation` agrees with `allan.deviation` for files, arrays and lists of any length; compilations, bad input."""

import jax
import numpy as np
import polars as pl
import pytest

import jaxcal
from jaxcal.batch import deviation

RATE = 100.0


@pytest.fixture(scope="module")
def y():
    y = 9.81 + np.random.default_rng(0).standard_normal((30_000, 3))
    y[12_000:12_010, 1] = np.nan
    return y


def same(found, whole):
    for name in ("m", "count", "skipped", "alpha"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    for name in ("tau", "deviation", "lower", "upper", "edf"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), rtol=1e-12)


@pytest.mark.parametrize("chunk", [7_000, 30_000])
@pytest.mark.parametrize("source", ["array", "memmap", "npy", "parquet", "text path"])
def test_every_source_gives_the_deviation_of_the_record(y, tmp_path, source, chunk):
    whole = jaxcal.allan.deviation(y, RATE, m=[1, 3, 50, 900])
    path = tmp_path / ("log.parquet" if source == "parquet" else "log.npy")
    if source == "parquet":
        columns = {"time_s": np.arange(len(y)) / RATE, **{f"gyro_{a}": y[:, i] for i, a in enumerate("xyz")}, "name": ["a"] * len(y)}
        pl.DataFrame(columns).write_parquet(path, row_group_size=5_000)
    else:
        np.save(path, y)
    given = {"array": y, "npy": path, "parquet": path, "text path": str(path)}.get(source)
    given = np.load(path, mmap_mode="r") if given is None else given
    same(deviation(given, RATE, m=[1, 3, 50, 900], chunk=chunk), whole)


def test_the_grid_is_that_of_the_record_and_columns_are_chosen(y, tmp_path):
    whole = jaxcal.allan.deviation(y[:, 0], RATE)
    for chunk in (4_000, 100_000):
        found = deviation(y[:, 0], RATE, chunk=chunk)
        np.testing.assert_array_equal(found.m, whole.m)
        np.testing.assert_allclose(found.deviation, whole.deviation, rtol=1e-12)
        assert deviation(y, RATE, columns=[2, 0], chunk=chunk).deviation.shape == (len(whole.m), 2)
        single = deviation(y[:, :1], RATE, chunk=chunk)
        assert single.deviation.shape == single.edf.shape == (len(whole.m), 1)
        same(single.channel(0), whole)
        assert single.channel(0).edf.shape == (len(whole.m),)
    path = tmp_path / "log.parquet"
    pl.DataFrame({"t": np.arange(3000), "gx": [None, *y[1:3000, 0]], "gy": y[:3000, 2]}).write_parquet(path)
    found = deviation(path, RATE, columns="gx", m=[1, 10])
    assert found.skipped.tolist() == [1, 1]
    same(found, jaxcal.allan.deviation(np.where(np.arange(3000) == 0, np.nan, y[:3000, 0]), RATE, m=[1, 10]))
    assert deviation(path, RATE, m=[1]).deviation.shape == (1, 2)


def test_strides_and_the_end_of_mdev_are_said(y):
    z = y[:, 0]
    found = deviation(z, RATE, m=[1, 2_000], chunk=1_000, exact=100)
    assert found.count.tolist() == [29_999, (30_000 - 4_000) // 8 + 1]  # the power of two up to 2,000/128, which divides 2,000
    assert abs(found.deviation[1] / jaxcal.allan.deviation(z, RATE, m=[2_000]).deviation[0] - 1) < 0.01
    found = deviation(z, RATE, kind="mdev", chunk=1_000, exact=100)
    assert found.m[-1] <= 100
    assert found.codes == {"ends_early"}


@pytest.mark.parametrize("kind", ["oadev", "adev", "mdev", "ohdev"])
def test_logs_taken_together_are_those_taken_alone(kind):
    """Logs of several buckets, with several groups in one of them, gaps and other number types; all fields of the results agree."""
    random = np.random.default_rng(3)
    logs: list = [random.standard_normal(n) for n in (*range(900, 922), 9_000, 40_000)]
    logs[3] = np.cumsum(logs[3]) + 9.81
    logs[4][100:130] = np.nan
    logs[5] = np.diff(logs[5], append=0.0).astype(np.float32)
    logs[6] = np.round(1e4 * logs[6]).astype(np.int32)
    rates = np.linspace(1.0, 200.0, len(logs)).tolist()
    for m in ("log", [7, 1, 30]):
        for found, log, rate in zip(deviation(logs, rates, kind=kind, m=m), logs, rates, strict=True):
            alone = jaxcal.allan.deviation(log, rate, kind=kind, m=m)
            same(found, alone)
            assert (found.kind, found.rate, found.confidence, found.findings) == (kind, rate, 0.95, alone.findings)
            assert [getattr(found, name).dtype for name in ("count", "alpha")] == [np.int64] * 2
    assert [found.rate for found in deviation(logs[:4], [1.0, 2.0, 3.0, 4.0], workers=1)] == [1.0, 2.0, 3.0, 4.0]


def test_one_log_of_a_group_that_is_no_record_is_named(refuses):
    logs = [np.arange(100.0) ** 2, np.where(np.arange(100) == 7, np.inf, 1.0), np.arange(90.0)]
    for code, subject, given, options in (
        ("record", "log 1", logs, {"rate": RATE}), ("rate", "log 2", [logs[0]] * 3, {"rate": [1.0, 2.0, 0.0]}),
        ("confidence", "", [logs[0]] * 3, {"rate": RATE, "confidence": 1.0}),
    ):  # fmt: skip
        with refuses(code) as caught:
            deviation(given, **options)
        assert caught.value.subject == subject


def test_a_hundred_lengths_compile_once():
    """Records that fit into the cache share one compiled program for the sums, for any length and number of cluster sizes."""
    random = np.random.default_rng(2)
    lengths = random.choice(np.arange(10_000, 100_000), 20, replace=False)
    record, compiled = random.standard_normal(100_000), []
    jax.clear_caches()

    def hear(event, duration, fun_name="", **_):
        # other programs, which only move arguments, compile in milliseconds
        if event == "/jax/core/compile/backend_compile_duration" and "sums" in fun_name:
            compiled.append(fun_name)

    jax.monitoring.register_event_duration_secs_listener(hear)
    deviation([record[:n] for n in lengths], RATE)
    for n in lengths:
        jaxcal.allan.deviation(record[: n + 1], RATE)
        jaxcal.allan.deviation(record[: n + 1], RATE, m=np.arange(1, 1 + n % 300))
    assert compiled == ["jit(block_sums)"]


@pytest.mark.parametrize(
    ("source", "options", "code"),
    [
        ([], {}, "empty"), ([np.zeros(5), np.zeros(0)], {}, "empty"), ([np.zeros(5), "nowhere.npy"], {}, "no_file"),
        ([np.zeros(5)], {"rate": [1.0, 2.0]}, "rates"), (np.zeros((2, 2, 2)), {}, "chunks"), (np.array(["a"]), {}, "chunks"),
        (np.zeros(100), {"m": [51]}, "m"), (np.zeros(100), {"m": [51], "chunk": 10}, "m"),
        (np.zeros(100), {"m": "all", "chunk": 10}, "grid"), (np.zeros(100), {"chunk": 0}, "chunk"),
        (np.zeros((100, 2)), {"columns": [2]}, "chunks"), (np.full(100, np.nan), {"chunk": 10}, "no_numbers"),
        (np.array([0.0, 1.0, np.inf] * 9), {"chunk": 10}, "infinite"),
    ],
)  # fmt: skip
def test_messages(source, options, code, refuses):
    with refuses(code):
        deviation(source, **({"rate": 1.0} | options))


def test_messages_about_files(tmp_path, refuses):
    (tmp_path / "log.ulg").write_bytes(b"ULog\x01\x12\x35" + bytes(40))
    pl.DataFrame({"time": [0.0, 1.0], "name": ["a", "b"]}).write_parquet(tmp_path / "log.parquet")
    for name, columns in (("log.ulg", None), ("log.parquet", None), ("log.parquet", ["gyro"])):
        with refuses("chunks"):
            deviation(tmp_path / name, 1.0, columns=columns)
