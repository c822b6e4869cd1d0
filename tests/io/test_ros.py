"""ROS 1 bags, and ROS 2 recordings in sqlite3 and MCAP, which the tests write with rosbags."""

import numpy as np
import pytest

from jaxcal import DataError, read

START = 1_700_000_000_000_000_000
STORAGES = ["ros1", "sqlite3", "mcap"]
DEG, G = np.pi / 180.0, 9.80665


def ns(n=400, rate=100.0, start=START):
    return start + np.round(np.arange(n) * 1e9 / rate).astype(np.int64)


def imu(still):
    return np.column_stack([still.gyro, still.accel])


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("frame", ["imu", "", "a/longer frame", "abc", "abcd"])
def test_an_imu_topic_is_read_exactly(storage, frame, still, write_bag):
    log = read(write_bag(storage, {"/imu/data_raw": ("Imu", ns(), imu(still))}, frame=frame), quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    np.testing.assert_array_equal(log.accel, still.accel)
    assert (log.rate, log.warnings) == (100.0, ())
    assert log.provenance["epoch_ns"] == START
    assert log.provenance["columns"] == {"topics": ["/imu/data_raw"]}
    assert log.provenance["units"] == {"gyro": "rad/s", "accel": "m/s^2"}


def test_a_file_of_a_recording_can_be_read_alone(still, write_bag):
    folder = write_bag("mcap", {"/imu": ("Imu", ns(), imu(still))})
    np.testing.assert_array_equal(read(folder / "record.mcap", quiet=True).gyro, still.gyro)
    (folder / "metadata.yaml").unlink()
    np.testing.assert_array_equal(read(folder, quiet=True).gyro, still.gyro)
    database = write_bag("sqlite3", {"/imu": ("Imu", ns(), imu(still))}, name="other") / "other.db3"
    np.testing.assert_array_equal(read(database, quiet=True).gyro, still.gyro)


@pytest.mark.parametrize("storage", STORAGES)
def test_field_and_temperature_come_on_topics_of_their_own(storage, still, write_bag):
    topics = {
        "/imu/data_raw": ("Imu", ns(), imu(still)),
        "/imu/mag": ("MagneticField", ns(40, 10.0) + 1_000_000, still.mag[:40]),
        "/imu/temperature": ("Temperature", ns(5, 1.0), 20.0 + np.arange(5.0)),
        "/chatter": ("String", ns(3), np.zeros(3)),
    }
    log = read(write_bag(storage, topics), quiet=True)
    np.testing.assert_array_equal(log.mag[::10], still.mag[:40])
    assert np.isnan(np.delete(log.mag, np.arange(0, 400, 10), axis=0)).all()
    np.testing.assert_allclose(log.temperature, 20.0 + np.arange(400) / 100, rtol=1e-12)
    assert log.gaps == ()
    assert "sparse" in log.codes
    alone = read(write_bag(storage, topics, name="again"), topics="/imu/mag", quiet=True)
    np.testing.assert_array_equal(alone.mag, still.mag[:40])
    assert (alone.rate, alone.gyro) == (10.0, None)


def test_stamps_out_of_order_keep_their_samples(still, write_bag):
    order = np.arange(400)
    order[[100, 101]] = [101, 100]
    topics = {"/imu": ("Imu", ns()[order], imu(still)[order]), "/mag": ("MagneticField", ns(), still.mag)}
    log = read(write_bag("mcap", topics, received=ns()), quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    np.testing.assert_array_equal(log.mag, still.mag)


# choice of topics


def test_several_topics_of_a_type_are_listed(still, write_bag, refuses):
    path = write_bag("mcap", {"/a/imu": ("Imu", ns(), imu(still)), "/b/imu": ("Imu", ns(200), imu(still)[:200])})
    with refuses("several") as caught:
        read(path, quiet=True)
    assert "/a/imu (Imu, 400 messages, 100 Hz); /b/imu (Imu, 200 messages, 49.87 Hz)" in str(caught.value)
    assert len(read(path, topics=["/b/imu"], quiet=True).time) == 200
    with refuses("topics"):
        read(path, topics="/c", quiet=True)
    with refuses("several"):
        read(path, topics="/a/imu,/b/imu", quiet=True)


def test_the_raw_topic_is_preferred(still, write_bag, finding):
    path = write_bag("sqlite3", {"/imu/data": ("Imu", ns(), 2 * imu(still)), "/imu/data_raw": ("Imu", ns(), imu(still))})
    log = read(path, quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    assert finding(log, "topics").facts == {"chosen": "/imu/data_raw", "others": "/imu/data"}


@pytest.mark.parametrize("storage", STORAGES)
def test_gyro_and_accel_on_two_topics_are_joined_on_request(storage, still, write_bag, refuses):
    zero = np.zeros((400, 3))
    topics = {
        "/camera/gyro/sample": ("Imu", ns(), np.column_stack([still.gyro, zero])),
        "/camera/accel/sample": ("Imu", ns(200, 50.0), np.column_stack([zero, still.accel])[:200]),
    }
    path = write_bag(storage, topics)
    with refuses("several"):
        read(path, quiet=True)
    log = read(path, topics=list(topics), quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    np.testing.assert_array_equal(log.accel[::2], still.accel[:200])
    assert read(path, topics="/camera/accel/sample", quiet=True).rate == 50.0


def test_a_measurement_marked_as_absent_is_left_out(still, write_bag, finding, refuses):
    log = read(write_bag("ros1", {"/imu": ("Imu", ns(), imu(still))}, covariance=(-1.0, 0.0)), quiet=True)
    assert log.gyro is None
    assert finding(log, "not_read").subject == ("gyro",)
    with refuses("no_rows"):
        read(write_bag("ros1", {"/imu": ("Imu", ns(), imu(still))}, covariance=(-1.0, -1.0), name="none"), quiet=True)


def test_a_recording_of_other_topics_lists_them(write_bag, refuses):
    with refuses("no_sensor"):
        read(write_bag("mcap", {"/chatter": ("String", ns(3), np.zeros(3))}), quiet=True)


# doubtful contents


@pytest.mark.parametrize(
    ("topic", "attitude", "why"),
    [
        ("/imu/data", (0.0, 0.0, 0.0, 1.0), "its name"),
        ("/imu/filtered", (0.0,) * 4, "its name"),
        ("/imu", (0.1, 0.0, 0.0, 0.99), "the attitude that it carries"),
    ],
)
def test_a_filtered_topic_is_warned_about(topic, attitude, why, still, write_bag, finding, doubts):
    log = read(write_bag("mcap", {topic: ("Imu", ns(), imu(still))}, attitude=attitude), quiet=True)
    assert doubts(log) == ["filtered"]
    assert why in finding(log, "filtered").facts["what"]


@pytest.mark.parametrize(("name", "unit", "size"), [("accel", "g", G), ("gyro", "deg/s", 1e-4), ("mag", "uT", 1e-6), ("mag", "G", 1e-4)])
def test_values_in_another_unit_are_warned_about_and_can_be_mended(name, unit, size, still, write_bag, finding):
    values = {"gyro": still.gyro, "accel": still.accel, "mag": still.mag}
    values[name] = values[name] / size
    topics = {"/imu": ("Imu", ns(), np.column_stack([values["gyro"], values["accel"]])), "/mag": ("MagneticField", ns(), values["mag"])}
    path = write_bag("mcap", topics)
    log = read(path, quiet=True)
    assert finding(log, "against_values").facts["unit"] != unit
    mended = read(path, units={name: unit}, quiet=True)
    assert "against_values" not in mended.codes
    if name != "gyro":
        np.testing.assert_allclose(getattr(mended, name), getattr(still, name), rtol=1e-12)


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("stamp", [0, 5_000_000_000])
def test_constant_header_stamps_give_way_to_the_times_of_reception(storage, stamp, still, write_bag, doubts):
    log = read(write_bag(storage, {"/imu": ("Imu", np.full(400, stamp), imu(still))}, received=ns()), quiet=True)
    assert (log.rate, log.provenance["epoch_ns"]) == (100.0, START)
    assert doubts(log)[0] == "reception"


def test_a_dropout_is_a_gap(still, write_bag):
    keep = np.ones(400, bool)
    keep[100:120] = False
    log = read(write_bag("ros1", {"/imu": ("Imu", ns()[keep], imu(still)[keep])}), quiet=True)
    assert [(g.start, g.samples) for g in log.gaps] == [(1.0, 20)]


# damage


@pytest.mark.parametrize("storage", STORAGES)
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_recording_cut_off_is_an_error(storage, share, still, write_bag):
    path = write_bag(storage, {"/imu": ("Imu", ns(), imu(still))})
    file = path if storage == "ros1" else next(f for f in path.iterdir() if f.suffix != ".yaml")
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    with pytest.raises(DataError) as caught:
        read(path, quiet=True)
    assert caught.value.code in ("damaged", "unreadable")


@pytest.mark.parametrize(
    "text",
    ["", "a: [b\n", "!!python/object/apply:os.system ['true']\n", *(f"rosbag2_bagfile_information: {x}\n" for x in ("3", "{version: 99}"))],
)
def test_a_damaged_description_is_an_error(text, still, write_bag, refuses):
    path = write_bag("mcap", {"/imu": ("Imu", ns(), imu(still))})
    (path / "metadata.yaml").write_text(text)
    with refuses("damaged"):
        read(path, quiet=True)


@pytest.mark.parametrize(
    ("change", "said"),
    [(lambda it: bytes(it) + bytes(8), "324 bytes, 316 expected"), (lambda it: bytes(it)[:200], "200 bytes, too few for its type")],
)
def test_a_message_of_the_wrong_length_is_an_error(change, said, still, write_bag, refuses):
    with refuses("damaged"):
        read(write_bag("mcap", {"/imu": ("Imu", ns(), imu(still))}, change=change), quiet=True)


def test_big_endian_messages(still, write_bag):
    log = read(write_bag("mcap", {"/imu": ("Imu", ns(), imu(still))}, order="big"), quiet=True)
    np.testing.assert_array_equal(log.gyro, still.gyro)
    np.testing.assert_array_equal(log.accel, still.accel)
    assert log.provenance["epoch_ns"] == START
