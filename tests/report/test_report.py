"""The HTML report, and the JSON document of noise results."""

import base64
import hashlib
import html
import html.parser
import json
import math
import re

import numpy as np
import pytest

import jaxcal
from jaxcal import Log
from jaxcal.report import write

from ..made_fit import made_deviation, made_fit
from . import made

EVIL = "<script>alert('x')</script>"


class Page(html.parser.HTMLParser):
    """Contents of an HTML page; parsing fails if an element is not closed or has the end tag of another."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.tags, self.attributes, self.words = [], [], [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, name, attributes):
        self.handle_startendtag(name, attributes)
        if name not in ("meta", "br", "hr"):
            self.open.append(name)

    def handle_startendtag(self, name, attributes):
        self.tags.append(name)
        self.attributes += [(name, key, value) for key, value in attributes]

    def handle_endtag(self, name):
        assert self.open.pop() == name

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).split())

    def values(self, key):
        return [value for _, name, value in self.attributes if name == key]


@pytest.fixture(scope="module")
def log():
    return made.noise()[1]


def written(results, path, log=None):
    write(results, path, log=log)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def text(log, tmp_path_factory):
    results = made.noise()[0] | {f"gyro_{EVIL}": made_fit(3.0, goodness=math.nan)}
    return written(results, tmp_path_factory.mktemp("report") / "a.html", log)


def test_page_is_well_formed(text):
    page = Page(text)
    assert text.startswith("<!DOCTYPE html>")
    assert ("html", "lang", "en") in page.attributes
    assert {"header", "main", "footer", "h1", "figure", "figcaption", "table", "caption", "details", "svg"} <= set(page.tags)
    ids = page.values("id")
    assert len(ids) == len(set(ids))
    referred = [word for key in ("aria-labelledby", "aria-describedby") for value in page.values(key) for word in value.split()]
    referred += [value[1:] for value in page.values("href") if value.startswith("#")]
    referred += re.findall(r"url\(#([^)]+)\)", text)
    assert referred
    assert set(referred) <= set(ids)


def hashed(text):
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_page_needs_nothing_from_outside_and_runs_nothing_but_its_own(text):
    page = Page(text)
    assert not {"link", "img", "iframe", "object", "base"} & set(page.tags)
    assert not page.values("src")
    assert not page.values("style")
    assert not [key for _, key, _ in page.attributes if key.startswith("on")]
    assert "@import" not in text
    assert all(value.startswith("#") for value in page.values("href"))
    (policy,) = [value for value in page.values("content") if "default-src" in value]
    rules = dict(rule.split(" ", 1) for rule in policy.split("; "))
    scripts = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    assert rules["default-src"] == rules["base-uri"] == rules["form-action"] == "'none'"
    assert rules["script-src"].split() == [hashed(script) for script in scripts]
    assert len(scripts) == 3
    assert rules["style-src"].split() == [hashed(style) for style in re.findall(r"<style>(.*?)</style>", text, re.DOTALL)]


def test_the_library_is_named_with_its_version_and_licence(text):
    assert "uPlot 1.6.32 (MIT License, Copyright (c) 2022 Leon Sorokin)" in Page(text).text
    assert "https://github.com/leeoniya/uPlot (v1.6.32)" in text
    assert "The above copyright notice and this permission notice shall be included" in text


def test_names_and_sentences_of_a_log_stay_text(text, log):
    page = Page(text)
    assert "<script>alert" not in text
    assert f"Method a & {EVIL} gives" in page.text
    assert f"3 samples {EVIL}" in page.text
    assert f"gyro_{EVIL}" in page.text
    assert log.notes[0] in page.text


def documents(text):
    return re.findall(r'<script type="application/json">(.*?)</script>', text, re.DOTALL)


def test_no_number_is_nan(text):
    assert re.search(r"\b(nan|inf|None)\b", Page(text).text) is None
    for data in documents(text):
        json.loads(data, parse_constant=pytest.fail)


def test_verdict_comes_first_and_is_complete(text):
    page = Page(text)
    places = [
        page.text.index(one) for one in ("weak N to 10 % on every axis", "Points: measured", "N angle random walk", "Fit with method")
    ]
    assert places == sorted(places)  # verdict, picture, numbers, what to know
    # gyro_x: N = 1e-4 rad/sqrt(s) = 0.34377 deg/sqrt(h), +- 10 %
    assert "N angle random walk °/√h 0.344 ± 0.034 0.3094 to 0.3782" in page.text
    assert "K rate random walk °/h/√s < 0.41 < 0.41" in page.text  # 2e-6 rad/s/sqrt(s) = 0.41253 deg/h/sqrt(s)
    assert "0.688 ± 0.069 hint" in page.text
    assert "no_intervals" in page.values("data-code")


def test_numbers_for_other_tools_are_those_of_an_export(tmp_path):
    found, log = made.mag()
    jaxcal.export.write(jaxcal.Calibration(magnetometer=found, provenance=log.provenance), tmp_path / "fusion.c", format="fusion")
    assert html.escape((tmp_path / "fusion.c").read_text(encoding="utf-8")) in written(found, tmp_path / "a.html", log)


def test_figures_say_what_they_show_and_have_their_numbers(text):
    page = Page(text)
    # an Allan deviation for each sensor; the log has one of them, for which there are also spectrum, residual and signal
    assert page.tags.count("svg") == page.values("role").count("img") == 2 + 3
    assert page.tags.count("details") >= 7
    fit = made_fit(1.0)
    first = fit.deviation.deviation[0] * 180 / np.pi * 3600
    assert f"{first:.1f}" in page.text
    assert [len(json.loads(data)["channels"]) for data in documents(text)] == [4, 3]
    assert page.text.count("tau (s)") >= 7


def test_provenance_and_summary(text, log):
    page = Page(text)
    assert "ab" * 32 in page.text
    assert f"jaxcal {jaxcal.__version__}" in page.text
    assert "gls, terms Q N B K, 95 % intervals" in page.text
    assert " ".join(log.summary().split()) in page.text
    assert "Options units gyro deg/s" in page.text  # options that were not given are omitted
    head = page.text[: page.text.index("weak N to")]
    assert "File logs/" in head
    assert f"Version jaxcal {jaxcal.__version__}" in head


def test_the_date_of_the_recording_stands_at_the_top_where_it_is_known(tmp_path):
    log = Log(1.78e9 + np.arange(500) / 200.0, gyro=np.random.default_rng(0).normal(size=(500, 3)), provenance={"command": "jaxcal noise"})
    page = Page(written({"gyro_x": made_fit()}, tmp_path / "a.html", log))
    assert "Recorded 2026-05-28 20:26:40 UTC Written" in page.text
    assert "Command jaxcal noise Version" in page.text
    assert "First sample 2026-05-28 20:26:40 UTC" in page.text


def test_long_tables_are_thinned(tmp_path):
    noise = jaxcal.noise.Noise(N=1e-4)
    dense = made_deviation(noise, clusters=2000, largest=100_000)
    fit = made_fit(deviation=dense, used=np.ones(len(dense.tau), dtype=bool))
    assert Page(written({"gyro_x": fit}, tmp_path / "a.html")).tags.count("tr") < 400


def test_curves_without_a_model(tmp_path):
    curves, log = made.allan()
    text = written(curves, tmp_path / "a.html", log)
    page = Page(text)
    assert "Allan deviation of a_rather_long_name" in page.text
    assert f" {format(np.rad2deg(curves['gyro_y'].deviation[3]) * 3600, '.4g')} " in page.text
    (data,) = map(json.loads, documents(text))
    assert [sorted(channel) for channel in data["channels"]] == [["allan", "axis", "name", "signal"]] * 2
    assert jaxcal.allan.Deviations(curves).to_dict(log)["channels"]["gyro_x"]["kind"] == "oadev"


def test_lines_of_a_long_spectrum_are_kept(tmp_path):
    found, log = made.psd()
    text = written(found, tmp_path / "a.html", log)
    (data,) = map(json.loads, documents(text))
    (channel,) = data["channels"]
    assert len(channel["spectrum"]["value"]) <= 302 < len(found["gyro_x"].density)
    assert max(channel["spectrum"]["value"]) == pytest.approx(found["gyro_x"].density.max(), rel=1e-3)


def test_a_report_of_six_axes_is_small(tmp_path):
    rng = np.random.default_rng(0)
    log = Log(None, gyro=1e-3 * rng.normal(size=(20_000, 3)), accel=1e-2 * rng.normal(size=(20_000, 3)), rate=100.0)
    assert len(written(jaxcal.noise.characterise(log, terms=("N",)), tmp_path / "a.html", log).encode()) < 300_000


def test_fit_of_several_channels_is_refused(tmp_path, refuses):
    pair = jaxcal.noise.Noise(N=np.array([1e-3, 2e-3])).simulate(2000, rate=100.0, seed=1)
    with refuses("several_channels"):
        write({"gyro_x": jaxcal.noise.fit(pair, rate=100.0)}, tmp_path / "a.html")


def test_a_calibration_needs_intervals(tmp_path, refuses):
    y = jaxcal.noise.Noise(N=1e-3).simulate(2000, rate=100.0, seed=1)
    slope = jaxcal.noise.fit(y, rate=100.0, method="slope")
    assert "no_intervals" in written({"gyro_x": slope}, tmp_path / "a.html")
    with refuses("no_intervals"):
        jaxcal.Calibration(noise={"gyro_x": slope})
    labels = jaxcal.plot.allan(slope).get_legend_handles_labels()[1]
    assert any(label.startswith("N = ") for label in labels)


def test_a_device_says_what_it_does_not_determine(tmp_path):
    found, log = made.joint()
    text = Page(written(found, tmp_path / "device.html", log=log)).text
    for words in ("open", "30.5 to 35.5 s", "18.0 to 22.0 s", "The motion leaves parameters without a number", "gyroscope <script>"):
        assert words in text
    told = json.loads(json.dumps(found.to_dict(log), allow_nan=False))
    assert told["schema"] == "jaxcal.DeviceFit/1"
    assert (told["numbers"]["mag_delay"]["value"], told["numbers"]["mag_delay"]["state"]) == (None, "open")
    assert told["numbers"]["dip"]["low"] < found.model.dip < told["numbers"]["dip"]["high"]
