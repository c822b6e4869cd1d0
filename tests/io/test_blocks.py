"""Text tables longer than a block are read as in one piece, whatever is at the boundary of two blocks."""

import gzip

import numpy as np
import pytest

import jaxcal
from jaxcal.io._readers._csv import read_csv
from jaxcal.io._table import interpret

HEADER = "time [s],gyro_x [rad/s],gyro_y [rad/s],gyro_z [rad/s]"


def rows(n=600, seed=0):
    """Stamps at 100 Hz and three channels, as text and as numbers."""
    values = np.column_stack([np.arange(n) / 100, np.round(np.random.default_rng(seed).normal(size=(n, 3)), 6)])
    return [",".join(repr(value) for value in row) for row in values.tolist()], values


def read(path, lines, ending="\n", pack=False, **options):
    content = ending.join(lines).encode()
    path.write_bytes(gzip.compress(content) if pack else content)
    return jaxcal.read(path, quiet=True, **options)


@pytest.mark.parametrize("length", [64, 1000, 4096, 10**6])
@pytest.mark.parametrize("pack", [False, True])
@pytest.mark.parametrize("ending", ["\n", "\r\n", "\r"])
def test_every_row_once_and_in_order(tmp_path, blocks_of, length, pack, ending):
    blocks_of(length)
    lines, values = rows()
    log = read(tmp_path / "log.csv", [HEADER, *lines], ending, pack)
    np.testing.assert_array_equal(log.gyro, values[:, 1:])
    np.testing.assert_array_equal(log.time, np.arange(600) / 100)
    assert not log.warnings


def test_faults_in_several_blocks_are_counted_and_the_first_is_shown(tmp_path, blocks_of):
    blocks_of(2000)
    lines, values = rows(3000)
    for i in (700, 1900, 2500):
        lines[i] += ",1.0"  # too wide
    for i, j in ((900, 2), (901, 2), (2800, 2), (40, 3)):
        fields = lines[i].split(",")
        fields[j] = "bad"
        lines[i] = ",".join(fields)
    lines[1000:1000] = ["", "# a comment"]
    log = read(tmp_path / "log.csv", [HEADER, *lines])
    held = [(one.code, *(one.facts[name] for name in ("count", "rows", "line", "shown"))) for one in log.findings if "line" in one.facts]
    assert held == [
        ("rows_left_out", 3, 3000, 702, lines[700]),
        ("text_missing", 3, 2997, 902, "bad"),
        ("text_missing", 1, 2997, 42, "bad"),
    ]
    expected = values[:, 1:].copy()
    expected[[700, 1900, 2500]] = np.nan  # a gap in time
    expected[[900, 901, 2800], 1] = np.nan
    expected[40, 2] = np.nan
    np.testing.assert_array_equal(log.gyro, expected)


def test_faults_are_measured_by_the_whole_table(tmp_path, blocks_of, refuses):
    """A long table with one damaged block is read; a table with damaged rows in all blocks is refused."""
    blocks_of(500)
    lines, _ = rows(3000)
    damaged = [line + ",1" if 1000 <= i < 1025 else line for i, line in enumerate(lines)]
    assert "rows_left_out" in read(tmp_path / "log.csv", [HEADER, *damaged]).codes
    damaged = [line + ",1" if i % 90 == 50 else line for i, line in enumerate(lines)]
    with refuses("rows_left_out"):
        read(tmp_path / "log.csv", [HEADER, *damaged])


def test_rows_cut_short_all_through_a_block(tmp_path, blocks_of, refuses):
    """Rows that lack their last field are reported, even if all rows of a block do; the column is not treated as empty."""
    blocks_of(500)
    lines, _ = rows(3000)
    damaged = [line.rpartition(",")[0] if 600 <= i < 650 else line for i, line in enumerate(lines)]
    with refuses("rows_left_out"):
        read(tmp_path / "log.csv", [HEADER, *damaged])


def test_nanoseconds_and_dates_and_missing_values_across_blocks(tmp_path, blocks_of):
    blocks_of(700)
    lines, values = rows(1000)
    start = 1_700_000_000_123_456_789
    stamps = [start + 10_000_000 * i for i in range(1000)]
    cut = [line.partition(",")[2] for line in lines]
    log = read(tmp_path / "log.csv", ["t [ns]," + HEADER.partition(",")[2], *(f"{t},{c}" for t, c in zip(stamps, cut, strict=True))])
    assert log.provenance["epoch_ns"] == start
    assert log.rate == 100.0
    some = [line if i != 300 else "NA,1.5,-" for i, line in enumerate(cut)]
    moments = np.datetime64("2024-05-06T07:08:09") + np.arange(1000) * np.timedelta64(10, "ms")
    log = read(tmp_path / "log.csv", ["time," + HEADER.partition(",")[2], *(f"{t}Z,{c}" for t, c in zip(moments, some, strict=True))])
    assert log.rate == 100.0
    expected = values[:, 1:].copy()
    expected[300] = np.nan, 1.5, np.nan
    np.testing.assert_array_equal(log.gyro, expected)


def test_a_column_taken_twice_is_not_converted_twice(tmp_path):
    """Adjacent columns are converted in place, but not if another sensor uses the same columns."""
    lines, values = rows(300)
    log = read(
        tmp_path / "log.csv", lines, columns={"time": 0, "gyro": [1, 2, 3], "accel": [1, 2, 3]}, units={"gyro": "deg/s", "accel": "g"}
    )
    np.testing.assert_allclose(log.gyro, np.radians(values[:, 1:]), rtol=1e-14)
    np.testing.assert_allclose(log.accel, values[:, 1:] * 9.80665, rtol=1e-14)


def test_a_table_stands_in_memory_once(tmp_path):
    """The columns of a text table are converted where the reader put them."""
    path = tmp_path / "log.csv"
    path.write_text("\n".join([HEADER.replace("rad/s", "deg/s"), *rows(3000)[0]]))
    table = read_csv(path)
    place = table.columns[1].ctypes.data
    assert interpret(table, {}, {}, None).sensors["gyro"].ctypes.data == place
