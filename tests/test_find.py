"""Choice of a calibration from a folder by device and date."""

import datetime

import pytest

import jaxcal
from jaxcal.calibration import find


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "deep").mkdir()
    for name, device, date in (
        ("a", "unit 7", "2026-01-10T08:00:00Z"),
        ("deep/b", "unit 7", "2026-05-01T08:00:00Z"),
        ("c", {"name": "unit 8", "serial": 4711}, None),
    ):
        jaxcal.Calibration(device=device, provenance={} if date is None else {"date": date}).save(tmp_path / f"{name}.json")
    (tmp_path / "other.json").write_text('{"schema": "jaxcal.noise/1"}')
    (tmp_path / "broken.json").write_text("{")
    return tmp_path


def test_the_latest_that_is_not_younger(folder):
    assert find(folder, "unit 7").name == "b.json"
    assert find(folder, "Unit 7", "2026-04-30").name == "a.json"
    assert find(folder, "unit 7", datetime.date(2026, 5, 1)).name == "b.json"
    assert find(folder, "unit 7", "2026-05-01T07:00").name == "a.json"
    assert find(folder, "unit 7", "2026-05-01T09:30+02:00").name == "a.json"
    assert find(folder, "4711").name == "c.json"


@pytest.mark.parametrize(
    ("device", "date", "code"),
    [
        ("unit 9", None, "no_device"),
        ("unit 7", "2025-12-31", "too_young"),
        ("unit 8", "2026-01-01", "no_date"),
        ("unit 7", "yesterday", "date"),
    ],
)
def test_what_cannot_be_told_is_said(folder, device, date, code, refuses):
    with refuses(code):
        find(folder, device, date)


def test_two_of_one_date(folder, refuses):
    jaxcal.Calibration(device="unit 7", provenance={"date": "2026-05-01T08:00:00Z"}).save(folder / "d.json")
    with refuses("two"):
        find(folder, "unit 7")
    with refuses("folder"):
        find(folder / "a.json", "unit 7")
