"""Several results of one device on one page."""

import dataclasses
import itertools
import re

import numpy as np
import pytest

from jaxcal import Log
from jaxcal.imu._findings import FINDINGS
from jaxcal.magnetometer import fit
from jaxcal.noise import NoiseFits
from jaxcal.report import write
from jaxcal.report._html import inside, tag
from jaxcal.temperature import TemperatureFits

from . import made


@pytest.fixture(scope="module")
def parts():
    return [made.noise(), made.thermal(), made.imu(), made.north()]


def written(results, path, **options):
    write(results, path, **options)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def text(parts, tmp_path_factory):
    return written(parts, tmp_path_factory.mktemp("device") / "a.html", device=f"unit {made.EVIL}")


def test_every_id_is_there_once_and_every_reference_finds_it(text):
    ids = re.findall(r'<[^>]* id="([^"]*)"', text)
    assert len(ids) == len(set(ids)) > 50
    referred = [word for names in re.findall(r'aria-(?:labelledby|describedby)="([^"]*)"', text) for word in names.split()]
    referred += re.findall(r'href="#([^"]*)"', text) + re.findall(r"url\(#([^)]*)\)", text)
    assert len(referred) > 50
    assert set(referred) <= set(ids)


def test_verdicts_come_first_and_lead_to_their_parts(text, parts):
    head = text[text.index("<h2") : text.index("<article")]
    table = [re.sub("<[^>]*>", "", cell) for cell in re.findall(r"<t[hd].*?</t[hd]>", head)[3:]]
    titles = ["Noise", "Bias and temperature", "Calibration", "Alignment on a turntable"]
    assert [title.partition(" of ")[0] for title in table[0::3]] == titles
    found = [NoiseFits(parts[0][0]), TemperatureFits(parts[1][0]), parts[2][0], parts[3][0]]
    assert table[1::3] == [one.verdict for one in found]
    assert table[2::3] == [one.headline for one in found]
    assert re.findall('href="#(part-[0-9])"', head) == ["part-1", "part-2", "part-3", "part-4"]


def test_headings_go_down_one_level_at_a_time(text):
    levels = [int(level) for level in re.findall(r"<h([1-6])[ >]", text)]
    assert levels[:2] == [1, 2]
    assert levels.count(1) == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert levels.count(2) == 5  # verdicts and four parts


def test_a_common_log_is_described_once(parts, tmp_path):
    noise, log = parts[0]
    page = written([noise, parts[1][0], (parts[2][0], None)], tmp_path / "a.html", log=log)
    assert page.count(log.summary().splitlines()[0]) == 1
    assert "<h1>Device</h1>" in page
    assert "Noise of a_rather_long_name" in page


def test_every_figure_has_its_numbers(text, parts):
    # a deviation for each sensor; spectrum, residual and signal of the sensor in the log; four thermal; residuals, signals; alignment
    assert text.count("<svg") == 2 + 3 + 4 + 3 + 2 + 4
    tables = re.findall(r"<caption>((?:Numbers|Every)[^<]*)", text)
    assert [name.partition(":")[0] for name in tables] == [
        *(f"Numbers of Allan deviation of {sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"),
        *(f"Numbers of {channel}" for channel in ("gyro x", "gyro y", "accel x")), "Numbers of the poses", "Numbers of the turns",
        "Every reading",
    ]  # fmt: skip
    imu = parts[2][0]
    assert f"<td>{imu.residual_norm[7]:.4g}</td>" in text
    assert f"<td>{np.rad2deg(imu.residual_turn[7]):.4g}</td>" in text
    for channel, count in (("gyro_x", 2), ("accel_x", 1)):  # gyro y has the fit of x
        assert text.count(f'<th scope="row">{parts[1][0][channel].bins.t[50]:.4g}</th>') >= count


def test_the_page_of_a_refused_calibration_says_why(tmp_path):
    found, _ = made.imu()
    few = FINDINGS("few_turns_left", kept=3)
    refused = dataclasses.replace(found, accel=None, gyro=None, findings=(few,))
    assert str(few) in written(refused, tmp_path / "a.html")
    assert str(few) in written([refused], tmp_path / "a.html")
    empty = fit(np.tile([1.0, 0, 0], (30, 1)))
    assert empty.verdict == "refused"
    assert "There are 1 distinct readings" in written([empty], tmp_path / "b.html")


def test_lists_that_make_no_page(parts, tmp_path, refuses):
    log = Log(None, accel=np.zeros((5, 3)), rate=10.0)
    for code, wrong in (("no_results", []), ("no_results", (parts[0][0], log)), ("no_results", {}), ("kinds", parts[1][0] | {"gyro_z": 1})):
        with refuses(code):
            write(wrong, tmp_path / "a.html")
    assert list(tmp_path.iterdir()) == []


def test_only_elements_are_moved():
    text = tag("p", 'url(#a) id="b"', tag("a", "<h2>", href="#c", aria_labelledby="d e"), title='id="f"')
    assert inside("x-", text) == (
        '<p title="id=&quot;f&quot;">url(#a) id=&quot;b&quot;<a href="#x-c" aria-labelledby="x-d x-e">&lt;h2&gt;</a></p>'
    )
