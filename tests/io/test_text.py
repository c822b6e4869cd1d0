"""Text tables: all layouts of the same data give the same log."""

import gzip

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from jaxcal import read
from jaxcal.io._names import parse_name

DEG, G = np.pi / 180.0, 9.80665
NAMES = ["time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]


def rows(still, time=None):
    return np.column_stack([still.time if time is None else time, still.gyro, still.accel])


def table(values, delimiter=",", form="%.12g", end="\n"):
    return "".join(delimiter.join(form % v for v in row) + end for row in values)


@pytest.fixture
def save(tmp_path):
    def write(text, name="log.csv"):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def besides_guesses(log):
    """Warnings other than those on inferred units and columns, which every table without units causes."""
    return [one.code for one in log.findings if one.severity and not one.kind.guess]


def check(log, still):
    assert log.rate == pytest.approx(100.0, rel=1e-9)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(log.accel, still.accel, rtol=1e-9, atol=1e-11)
    assert besides_guesses(log) == []


# layouts

LAYOUTS = {
    "comma": lambda v: ",".join(NAMES) + "\n" + table(v),
    "semicolon": lambda v: ";".join(NAMES) + "\n" + table(v, ";"),
    "tab": lambda v: "\t".join(NAMES) + "\n" + table(v, "\t"),
    "space": lambda v: " ".join(NAMES) + "\n" + table(v, " "),
    "aligned": lambda v: "  ".join(NAMES) + "\n" + table(v, "  ", "%18.10e"),
    "comma and space": lambda v: ", ".join(NAMES) + "\n" + table(v, ", "),
    "padded": lambda v: ",".join(NAMES) + "\n" + table(v, " , ", end=" \n"),
    "decimal comma": lambda v: ";".join(NAMES) + "\n" + table(v, ";").replace(".", ","),
    "decimal comma, tabs": lambda v: "\t".join(NAMES) + "\n" + table(v, "\t").replace(".", ","),
    "hash comments": lambda v: "# a log\n" + ",".join(NAMES) + "\n" + table(v[:9]) + "# paused\n" + table(v[9:]),
    "percent comments": lambda v: "% a log\n" + ",".join(NAMES) + "\n" + table(v[:9]) + "% paused\n" + table(v[9:]),
    "slash comments": lambda v: "// a log\n" + ",".join(NAMES) + "\n" + table(v[:9]) + "// paused\n" + table(v[9:]),
    "mixed comments": lambda v: ",".join(NAMES) + "\n" + table(v[:9]) + "% paused\n# here\n" + table(v[9:]),
    "commented header": lambda v: "# " + " ".join(NAMES) + "\n" + table(v, " "),
    "commented header, other delimiter": lambda v: "# " + " ".join(NAMES) + "\n" + table(v),
    "preamble": lambda v: "Device: X1\nStarted 12:00\n\n" + ",".join(NAMES) + "\n" + table(v),
    "trailing delimiter": lambda v: ",".join(NAMES) + ",\n" + table(v, end=",\n"),
    "trailing delimiter in rows only": lambda v: ",".join(NAMES) + "\n" + table(v, end=",\n"),
    "quoted": lambda v: ",".join(f'"{n}"' for n in NAMES) + "\n" + table(v, '","').replace("\n", '"\n"').join(['"', ""])[:-1],
    "windows": lambda v: (",".join(NAMES) + "\n" + table(v)).replace("\n", "\r\n"),
    "old mac": lambda v: (",".join(NAMES) + "\n" + table(v)).replace("\n", "\r"),
    "byte order mark": lambda v: "\ufeff" + ",".join(NAMES) + "\n" + table(v),
    "utf-16": lambda v: (",".join(NAMES) + "\r\n" + table(v, end="\r\n")).encode("utf-16"),
    "latin-1": lambda v: ("# Temperatur 25 \u00b0C\n" + ",".join(NAMES) + "\n" + table(v)).encode("latin-1"),
    "gzip": lambda v: gzip.compress((",".join(NAMES) + "\n" + table(v)).encode()),
    "gzip in pieces": lambda v: b"".join(gzip.compress(s.encode()) for s in (",".join(NAMES) + "\n", table(v[:50]), table(v[50:]))),
    "blank lines": lambda v: "\n" + ",".join(NAMES) + "\n\n" + table(v[:9]) + "\n" + table(v[9:]) + "\n\n",
    "no newline at the end": lambda v: ",".join(NAMES) + "\n" + table(v)[:-1],
    "no header": lambda v: table(v),
    "units in a line of their own": lambda v: ",".join(NAMES) + "\ns,rad/s,rad/s,rad/s,m/s^2,m/s^2,m/s^2\n" + table(v),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_layout_is_recognised(layout, still, save):
    for name in ("log.csv", "record.log"):  # the suffix says nothing
        check(read(save(LAYOUTS[layout](rows(still)), name), quiet=True), still)


UNITS = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "gyro": {"rad/s": 1.0, "deg/s": DEG, "dps": DEG, "mdps": DEG / 1e3},
    "accel": {"m/s^2": 1.0, "m/s2": 1.0, "g": G, "mg": G / 1e3},
}
SUFFIXES = {"rad/s": "rad_s", "deg/s": "deg_s", "m/s^2": "m_s2", "m/s2": "mps2"}


@given(
    order=st.permutations(range(7)),
    delimiter=st.sampled_from([",", ";", "\t", " "]),
    comma=st.booleans(),
    styles=st.sampled_from(["brackets", "parentheses", "suffix", "option"]),
    units=st.fixed_dictionaries({k: st.sampled_from(sorted(v)) for k, v in UNITS.items()}),
    zipped=st.booleans(),
    seed=st.integers(0, 5),
)
@settings(max_examples=80, deadline=None)
def test_columns_in_any_order_delimiter_and_unit(tmp_path_factory, make, order, delimiter, comma, styles, units, zipped, seed):
    still = make(n=60, seed=seed)
    quantity = [name.split("_")[0] for name in NAMES]
    values = rows(still) / [UNITS[q][units[q]] for q in quantity]
    if styles == "suffix":
        names = [f"{name}_{SUFFIXES.get(units[q], units[q])}" for name, q in zip(NAMES, quantity, strict=True)]
    else:
        glue = "" if delimiter == " " else " "
        shape = {"brackets": f"{{}}{glue}[{{}}]", "parentheses": f"{{}}{glue}({{}})", "option": "{}"}[styles]
        names = [shape.format(name, units[q]) for name, q in zip(NAMES, quantity, strict=True)]
    text = delimiter.join(names[i] for i in order) + "\n" + table(values[:, order], delimiter, "%.15g")
    if comma and delimiter in ";\t":
        head, body = text.split("\n", 1)
        text = head + "\n" + body.replace(".", ",")
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    path.write_bytes(gzip.compress(text.encode()) if zipped else text.encode())
    log = read(path, units=units if styles == "option" else None, quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-12, atol=1e-13)
    np.testing.assert_allclose(log.accel, still.accel, rtol=1e-12, atol=1e-13)
    assert log.rate == pytest.approx(100.0, rel=1e-9)


# time


def stamped(still, stamps):
    lines = zip(stamps, rows(still)[:, 1:].tolist(), strict=True)
    return "".join(f"{stamp}," + ",".join(map(repr, row)) + "\n" for stamp, row in lines)


def test_nanoseconds_since_1970_lose_nothing(still, save):
    first = 1_700_000_000_123_456_789
    ns = [first + 10_000_000 * i for i in range(400)]
    text = "time," + ",".join(NAMES[1:]) + "\n"
    text += stamped(still, ns)
    log = read(save(text), quiet=True)
    check(log, still)
    assert log.provenance["epoch_ns"] == first


def test_seconds_and_nanoseconds_are_joined(still, save):
    ns = 1_700_000_000_990_000_000 + 10_000_000 * np.arange(400)
    text = "header.stamp.sec,header.stamp.nanosec," + ",".join(NAMES[1:]) + "\n"
    text += stamped(still, [f"{t // 10**9},{t % 10**9}" for t in ns.tolist()])
    log = read(save(text), quiet=True)
    check(log, still)
    assert log.provenance["epoch_ns"] == ns[0]
    assert (log.findings[0].facts["columns"], log.findings[0].facts["unit"]) == ("0:1", "s + ns")


@pytest.mark.parametrize(
    "form",
    [
        "2024-05-01T12:00:{:09.6f}", "2024-05-01 12:00:{:09.6f}", "2024-05-01T12:00:{:09.6f}Z", "2024/05/01 12:00:{:06.3f}",
        "2024-05-01T14:00:{:012.9f}+02:00", "2024-05-01 10:30:{:06.3f}-0130", "2024-05-01 12:00:{:06.3f} UTC",
    ],
)  # fmt: skip
def test_dates_are_read_in_utc(form, still, save):
    text = ",".join(NAMES) + "\n"
    text += stamped(still, [form.format(t) for t in still.time])
    log = read(save(text), quiet=True)
    check(log, still)
    assert log.provenance["epoch_ns"] == 1714564800 * 10**9


def test_a_rate_replaces_stamps(still, save):
    text = ",".join(NAMES[1:]) + "\n" + table(rows(still)[:, 1:])
    check(read(save(text), rate=100, quiet=True), still)


def test_a_row_counter_is_no_time(still, save, refuses):
    text = "PacketCounter," + ",".join(NAMES[1:]) + "\n" + table(np.column_stack([np.arange(400), rows(still)[:, 1:]]))
    with refuses("no_rate"):
        read(save(text), quiet=True)
    check(read(save(text), rate=100, quiet=True), still)


# damaged rows


def test_rows_of_the_wrong_width_are_skipped_and_counted(still, save, finding):
    lines = (",".join(NAMES) + "\n" + table(rows(still))).splitlines()
    lines[10] = lines[10].rsplit(",", 2)[0]
    lines[20] += ",1.0"
    log = read(save("\n".join(lines)), quiet=True)
    assert (finding(log, "rows_left_out").facts["count"], finding(log, "rows_left_out").facts["line"]) == (2, 11)
    assert np.isnan(log.gyro[[9, 19]]).all()
    keep = np.ones(400, bool)
    keep[[9, 19]] = False
    np.testing.assert_allclose(log.accel[keep], still.accel[keep], rtol=1e-11)


def test_a_last_row_cut_off_is_skipped(still, save, finding):
    text = (",".join(NAMES) + "\n" + table(rows(still)))[:-30]
    log = read(save(text), quiet=True)
    assert len(log.time) == 399
    assert (finding(log, "rows_left_out").facts["count"], finding(log, "rows_left_out").facts["line"]) == (1, 401)


@pytest.mark.parametrize(("count", "field", "code"), [(10, None, "rows_left_out"), (100, 4, "text_missing")])
def test_too_much_damage_is_an_error(count, field, code, still, save, refuses):
    lines = (",".join(NAMES) + "\n" + table(rows(still))).splitlines()
    for i in range(40, 40 + count):
        fields = lines[i].split(",")
        lines[i] = "garbled" if field is None else ",".join([*fields[:field], "low", *fields[field + 1 :]])
    with refuses(code):
        read(save("\n".join(lines)), quiet=True)


@pytest.mark.parametrize("kind", ["ERR", "1.2.3", "12:30", "0x1F"])
def test_text_among_numbers_is_a_missing_value(kind, still, save, finding):
    lines = (",".join(NAMES) + "\n" + table(rows(still))).splitlines()
    fields = lines[8].split(",")
    lines[8] = ",".join([*fields[:2], kind, *fields[3:]])
    log = read(save("\n".join(lines)), quiet=True)
    facts = {"column": "column 2 (gyro_y)", "count": 1, "rows": 400, "line": 9, "shown": kind}
    assert finding(log, "text_missing").facts == facts
    assert np.isnan(log.gyro[7, 1])
    np.testing.assert_allclose(log.gyro[7, [0, 2]], still.gyro[7, [0, 2]], rtol=1e-11)


@pytest.mark.parametrize("word", ["ok", '"ok, all well"'])
def test_words_beside_the_numbers_are_left_alone(word, still, save, finding):
    text = ",".join(NAMES) + ",state\n" + table(rows(still), end=f",{word}\n")
    log = read(save(text), quiet=True)
    check(log, still)
    assert finding(log, "not_read").facts["what"] == "column state"


@pytest.mark.parametrize("word", ["", "nan", "NaN", "NA", "null", "-"])
def test_missing_values_are_gaps(word, still, save):
    lines = (",".join(NAMES) + "\n" + table(rows(still))).splitlines()
    lines[8] = ",".join([lines[8].split(",")[0], *[word] * 6])
    log = read(save("\n".join(lines)), quiet=True)
    assert [(g.start, g.samples) for g in log.gaps] == [(pytest.approx(0.07), 1)]
    assert besides_guesses(log) == []
    assert log.codes.count("gaps") == 1


# names


@pytest.mark.parametrize(
    ("name", "meaning"),
    [
        *[(name, ("time", "", None)) for name in ("t", "Time", "timestamp", "stamp", "ts")],
        ("sec", ("time", "", "s")), ("secs", ("time", "", "s")), ("ms", ("time", "", "ms")), ("us", ("time", "", "us")),
        ("ns", ("time", "", "ns")), ("TimeUS", ("time", "", "us")), ("t_us", ("time", "", "us")), ("time_s", ("time", "", "s")),
        ("timestamp [ns]", ("time", "", "ns")), ("SampleTimeFine", ("time", "", "1e-4 s")), ("%time", ("time", "", None)),
        ("/imu/angular_velocity/x", ("gyro", "x", None)), ("gyro_dps_y", ("gyro", "y", "deg/s")), ("ax_mg", ("accel", "x", "mg")),
        ("linear_acceleration.y", ("accel", "y", None)), ("bx (nT)", ("mag", "x", "nT")), ("magnetic_field.z", ("mag", "z", None)),
        *[(name, ("temperature", "", None)) for name in ("temp", "temperature", "imu_temp")],
        ("t_c", ("temperature", "", "degC")), ("tempc", ("temperature", "", "degC")), ("Temperature [K]", ("temperature", "", "K")),
        *[(name, None) for name in ("notes", "frame_id", "orientation.x", "latitude", "gyro", "status_x", "x")],
    ],
)  # fmt: skip
def test_column_names(name, meaning):
    assert parse_name(name) == meaning


def test_the_first_of_two_sensors_wins_and_the_other_is_told(still, save, finding):
    names = ["time_s", *NAMES[1:], "gyro2_x", "gyr_x", "gyr_y", "gyr_z"]
    text = ",".join(names) + "\n" + table(np.column_stack([rows(still), still.gyro[:, 0], 7 * still.gyro]))
    log = read(save(text), quiet=True)
    np.testing.assert_allclose(log.gyro, still.gyro, rtol=1e-11)
    assert finding(log, "several_columns").facts["names"] == "gyro_x,gyro_y,gyro_z"
    assert finding(log, "several_columns").facts["others"] == "gyr_x,gyr_y,gyr_z"
    assert finding(log, "not_read").facts["what"] == "columns gyro2_x, gyr_x, gyr_y, gyr_z"


def test_xsens_ticks_are_tenths_of_a_millisecond(still, save):
    names = ["PacketCounter", "SampleTimeFine", *NAMES[1:]]
    text = "\t".join(names) + "\n" + table(np.column_stack([np.arange(400), 100 * np.arange(400), rows(still)[:, 1:]]), "\t")
    check(read(save(text), quiet=True), still)


def test_a_unit_in_brackets_that_is_not_understood_is_not_guessed_over(still, save, refuses):
    text = "time_s,gx [LSB],gy [LSB],gz [LSB]\n" + table(np.column_stack([still.time, np.round(1e4 * still.gyro)]))
    with refuses("unit_unknown"):
        read(save(text), quiet=True)
    log = read(save(text), units={"gyro": "1e-4 rad/s"}, quiet=True)
    np.testing.assert_allclose(log.gyro, np.round(1e4 * still.gyro) * 1e-4)
