"""Every kind of page in a real browser: in wide and narrow windows, light and dark, and in print."""

import csv
import json
import pathlib
import re

import numpy as np
import pytest
import yaml

from jaxcal.report import write
from jaxcal.report._fleet import write_fleet

from . import browser, made

SCRIPT = (pathlib.Path(__file__).parent / "look.js").read_text(encoding="utf-8")
LOOKS = [(1280, "light", "screen"), (1280, "dark", "screen"), (390, "light", "screen"), (360, "dark", "screen"), (680, "dark", "print")]
#: least number of texts in the figures; interactive charts draw theirs on a canvas, except in print
LEAST = {"noise": 0, "allan": 0, "psd": 0, "thermal": 0, "imu": 0, "mag": 20, "joint": 0, "north": 0, "device": 20}


@pytest.fixture(scope="module")
def tab():
    path = browser.executable()
    if path is None:
        pytest.skip(f"no browser: none of {', '.join(browser.NAMES)} is installed (Debian: apt-get install chromium)")
    found = browser.Browser(path)
    yield found
    found.close()


@pytest.fixture(scope="module")
def results():
    return {kind: make() for kind, make in made.KINDS.items()}


@pytest.fixture(scope="module")
def pages(results, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for kind, (result, log) in results.items():
        write(result, folder / f"{kind}.html", log=log)
    write(list(results.values()), folder / "device.html", device="unit 7")
    return folder


def looked_at(tab, width, scheme, media):
    """Findings of look.js with all details opened; in print the page opens them itself."""
    tab.look(width, scheme, media)
    tab.run(f"document.querySelectorAll('details').forEach((d) => {{ d.open = {str(media == 'screen').lower()} }})")
    if tab.run("document.querySelectorAll('.views').length"):
        settled(tab)  # until the charts have their new width
    return tab.run(SCRIPT)


@pytest.mark.parametrize(
    "kind", [pytest.param(kind, marks=[pytest.mark.long] * (kind not in ("noise", "imu", "device"))) for kind in LEAST]
)
def test_page(tab, pages, kind):
    tab.open((pages / f"{kind}.html").as_uri())
    for look in LOOKS:
        found = looked_at(tab, *look)
        assert found["wrong"] == [], look
        assert found["letters"] >= LEAST[kind], look
        assert found["letters"] > 12 or look[2] == "screen", look
        # a dark page must be printed on a light background
        assert (max(found["paper"][:3]) < 50) == (look[1] == "dark" and look[2] == "screen"), look
    assert tab.complaints() == []


@pytest.mark.parametrize("kind", sorted(set(LEAST) - {"device"}))
@pytest.mark.parametrize(("width", "height"), [(1400, 900), (390, 844)])
def test_the_first_screen_has_verdict_picture_and_numbers(tab, pages, kind, width, height):
    tab.look(width, height=height)
    tab.open((pages / f"{kind}.html").as_uri())
    settled(tab)
    ends = "[...document.querySelectorAll('.said, .first > :first-child :is(svg, canvas), .beside tbody tr:nth-child(-n + 3)')]"
    ends = tab.run(f"{ends}.filter((one) => one.checkVisibility()).map((one) => one.getBoundingClientRect().bottom)")
    assert len(ends) >= 4
    assert sorted(ends)[4 if len(ends) > 4 else -1] <= height
    assert tab.run("document.documentElement.scrollWidth") == width


@pytest.mark.parametrize("kind", sorted(set(LEAST) - {"device"}))
def test_a_page_is_small_on_disk_and_on_paper(tab, pages, kind):
    tab.look(1280)
    tab.open((pages / f"{kind}.html").as_uri())
    assert 1 <= len(re.findall(rb"/Type\s*/Page[^s]", tab.paper())) <= 4
    assert (pages / f"{kind}.html").stat().st_size <= 350e3


READ = "[...document.querySelectorAll('.views')[0].querySelectorAll('.readout')].map((one) => one.textContent)"
CLICK = "[...document.querySelectorAll('{where}')].find((one) => one.textContent === '{text}').click()"
INK = """(() => {  // how many pixels of a chart have the colour of the first axis
  const pixels = (PIXELS), [r, g, b] = [0, 114, 178];
  let count = 0;
  for (let i = 0; i < pixels.length; i += 4) {
    const near = Math.abs(pixels[i] - r) + Math.abs(pixels[i + 1] - g) + Math.abs(pixels[i + 2] - b) < 60;
    if (near && pixels[i + 3] > 200) count += 1;
  }
  return count;
})()"""

SUM = """(() => {  // changes with every pixel of a chart
  return (PIXELS).reduce((sum, v) => (31 * sum + v) % 1000003, 0);
})()"""


def pixels(tab, script, number):
    """Result of a script that is applied to the pixels of a chart."""
    copy = (
        f"(() => {{ const chart = document.querySelectorAll('.chart canvas')[{number}], copy = document.createElement('canvas');"
        "[copy.width, copy.height] = [chart.width, chart.height]; const to = copy.getContext('2d', {willReadFrequently: true});"
        "to.drawImage(chart, 0, 0); return to.getImageData(0, 0, copy.width, copy.height).data; })()"
    )
    return tab.run(script.replace("(PIXELS)", copy))


@pytest.fixture
def noise_page(tab, pages):
    tab.look(1280)
    tab.open((pages / "noise.html").as_uri())
    return tab


def chart(tab, number):
    """Left, top, width and height of a chart's plotting area in the window."""
    return tab.run(
        f"(() => {{ const over = document.querySelectorAll('.chart .u-over')[{number}]; over.scrollIntoView({{block: 'center'}});"
        "const box = over.getBoundingClientRect(); return [box.left, box.top, box.width, box.height]; })()"
    )


def hover(tab, number, across, kind="mouseMoved"):
    left, top, width, height = chart(tab, number)
    tab.call("Input.dispatchMouseEvent", type=kind, x=left + across * width, y=top + height / 2, button="left", clickCount=1, buttons=1)


def settled(tab):
    """Wait until the browser has drawn the next frame."""
    tab.call("Runtime.evaluate", expression="new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))", awaitPromise=True)


def test_the_pointer_reads_values_with_intervals_in_all_views(noise_page):
    tab = noise_page
    assert all("Move over the chart" in text for text in tab.run(READ))
    tab.run("document.querySelector('.chart').focus()")
    for kind in ("keyDown", "keyUp"):
        tab.call("Input.dispatchKeyEvent", type=kind, key="ArrowRight")
    settled(tab)
    assert tab.run(READ)[0].startswith("τ = ")
    hover(tab, 0, 0.5)
    settled(tab)
    allan, spectrum, residual, signal = tab.run(READ)
    found = re.fullmatch(r"τ = ([\d.]+) s x ([\d.]+) \(([\d.]+) to ([\d.]+)\) °/h y .* °/h z .* °/h", allan)
    tau, value, low, high = map(float, found.groups())
    deviation = made.noise()[0]["gyro_x"].deviation
    index = int(abs(deviation.tau - tau).argmin())
    expected = [np.rad2deg(getattr(deviation, key)[index]) * 3600 for key in ("deviation", "lower", "upper")]
    assert [value, low, high] == pytest.approx(expected, rel=0.02)
    assert float(spectrum.split()[2]) == pytest.approx(0.5 / tau, rel=0.5)  # the spectrum shows the corresponding frequency
    assert "(°/h)²/Hz" in spectrum
    assert "expected" in residual
    assert "Move over" in signal


def test_switches_of_axes_lines_and_units(noise_page):
    tab = noise_page
    with_x = pixels(tab, INK, 0)
    tab.run(CLICK.format(where=".toggle", text="x"))
    settled(tab)
    assert pixels(tab, INK, 0) < 0.05 * with_x
    hover(tab, 0, 0.5)
    settled(tab)
    assert re.search(r" s y [\d.]+", tab.run(READ)[0])
    tab.run(CLICK.format(where=".toggle", text="x"))
    for line in ("fit", "Q", "N", "B", "K"):
        tab.run(CLICK.format(where=".toggle", text=line))
    settled(tab)
    assert 0 < pixels(tab, INK, 0) < with_x
    cell = "[...document.querySelectorAll('[data-number=\"gyro_x.N\"]')].map((one) => one.textContent)"
    assert tab.run(cell)[0].startswith("0.344 ± 0.0340.3094 to 0.3782")
    tab.run("(() => { const unit = document.querySelector('.bar select'); unit.value = 2; unit.dispatchEvent(new Event('change')); })()")
    assert tab.run(cell)[0].startswith("1.0\u00d710⁻⁴ ± 1.0\u00d710⁻⁵9\u00d710⁻⁵ to 1.1\u00d710⁻⁴")
    assert tab.run("document.querySelector('[data-number=\"gyro_x.N\"]').parentElement.querySelector('td.small').textContent") == "rad/√s"
    hover(tab, 0, 0.5)
    settled(tab)
    assert "rad/s" in tab.run(READ)[0]
    assert tab.complaints() == []


def test_zoom_is_common_to_views_of_one_abscissa(noise_page):
    tab = noise_page
    labels = "[...document.querySelectorAll('.zoom button')].map((one) => one.getAttribute('aria-label'))"
    names = tab.run(labels)
    assert "Zoom in, Allan deviation" in names
    before = [pixels(tab, SUM, number) for number in (1, 2)]
    hover(tab, 1, 0.4, "mousePressed")
    hover(tab, 1, 0.6)
    hover(tab, 1, 0.6, "mouseReleased")
    settled(tab)
    zoomed = [pixels(tab, SUM, number) for number in (1, 2)]
    assert zoomed[0] != before[0]
    assert zoomed[1] != before[1]  # the chart of the residual zooms with the spectrum
    tab.run(f"document.querySelectorAll('.zoom button')[{names.index('Show all, Residual of the fit')}].click()")
    settled(tab)
    assert [pixels(tab, SUM, number) for number in (1, 2)] == before


@pytest.mark.parametrize("form", ["CSV", "YAML", "JSON"])
def test_copies(noise_page, form):
    tab = noise_page
    tab.run("navigator.clipboard.writeText = (text) => { window.copied = text; return Promise.resolve(); }")
    tab.run(CLICK.format(where=".bar button", text=form))
    text = tab.run("window.copied")
    read = {"CSV": lambda t: list(csv.DictReader(t.splitlines())), "YAML": yaml.safe_load, "JSON": json.loads}[form]
    row = next(row for row in read(text) if row["channel"] == "gyro_x" and row["term"] == "N")
    assert float(row["value"]) == pytest.approx(np.rad2deg(1e-4) * 60, rel=1e-4)
    assert row["unit"] == "°/√h"
    assert row["verdict"] == "present"


def test_a_browser_that_refuses_the_clipboard_shows_the_text(noise_page):
    tab = noise_page
    tab.run("navigator.clipboard.writeText = () => Promise.reject(new Error('no'))")
    tab.run(CLICK.format(where=".bar button", text="CSV"))
    settled(tab)
    assert tab.run("document.querySelector('textarea').value").startswith("channel,term,value,low,high,upper_limit,verdict,unit")


def test_without_script_figures_and_tables_are_there(tab, pages):
    tab.look(1280)
    tab.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        tab.open((pages / "noise.html").as_uri())
        assert tab.run("document.querySelectorAll('.views').length") == 0
        for look in LOOKS[:4]:
            found = looked_at(tab, *look)
            assert found["wrong"] == [], look
            assert found["letters"] > 50, look
    finally:
        tab.call("Emulation.setScriptExecutionDisabled", value=False)


def test_paper_shows_the_answer_and_no_numbers_of_curves(tab, pages):
    tab.open((pages / "noise.html").as_uri())
    tab.look(680, "light", "print")
    settled(tab)
    shown = "[...document.querySelectorAll('{} table')].filter((one) => one.checkVisibility({{contentVisibilityAuto: true}})).length"
    assert tab.run(shown.format("section")) == 2  # gyroscope and accelerometer
    assert tab.run(shown.format("details")) == 0
    assert tab.run("[...document.querySelectorAll('.live-part')].some((one) => one.checkVisibility())") is False


def test_the_policy_refuses_other_scripts(tab, pages, tmp_path):
    text = (pages / "noise.html").read_text(encoding="utf-8")
    path = tmp_path / "changed.html"
    path.write_text(text.replace("</main>", "<script>window.intruder = 1</script></main>"), encoding="utf-8")
    tab.look(1280)
    tab.open(path.as_uri())
    assert tab.run("window.intruder === undefined")
    assert "Content Security Policy" in " ".join(tab.complaints())


def test_the_sphere_turns_under_the_finger_and_tells_its_residuals(tab, pages):
    tab.look(390)
    tab.open((pages / "mag.html").as_uri())
    tab.run("document.querySelector('.sphere canvas').scrollIntoView({block: 'center'})")
    picture = "document.querySelector('.sphere canvas').toDataURL()"
    box = tab.run("document.querySelector('.sphere canvas').getBoundingClientRect().toJSON()")
    left, top, width, height = (box[name] for name in ("left", "top", "width", "height"))
    before = tab.run(picture)
    points = [(left + width * part, top + height / 2) for part in (0.4, 0.6)]
    for kind, (x, y) in (("Pressed", points[0]), ("Moved", points[1]), ("Released", points[1])):
        tab.call("Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, button="left", buttons=1, clickCount=1)
    turned = tab.run(picture)
    assert turned != before
    for name in ("as measured", "residuals", "missing directions"):
        tab.run(CLICK.format(where=".sphere .toggle", text=name))
        changed = tab.run(picture)
        assert changed != turned
        turned = changed
    told = set()
    for across in np.linspace(0.2, 0.8, 13):
        tab.call("Input.dispatchMouseEvent", type="mouseMoved", x=left + across * width, y=top + height / 2)
        told.add(tab.run("document.querySelector('.sphere .readout').textContent"))
    words = r"Reading \d+: longitude -?[\d.]+°, latitude -?[\d.]+°, residual -?[\d.]+ uT of a field of [\d.]+ uT"
    assert any(re.match(words, one) for one in told), told
    assert tab.complaints() == []


FIGURE = "document.querySelectorAll('.charts .views figure')[{}]"
PRESS = FIGURE + ".querySelector('.chart').dispatchEvent(new KeyboardEvent('keydown', {{key: '{}', bubbles: true}}))"
SAID = FIGURE + ".querySelector('.readout').textContent"


def test_the_motion_of_a_device_is_replayed(tab, pages):
    tab.open((pages / "joint.html").as_uri())
    replay = "document.querySelector('.replay').sphere"
    assert tab.run(f"{replay}.go(7); {replay}.readout.textContent") == f"{tab.run(f'{replay}.data.time[7]'):g} s"
    assert np.allclose(np.linalg.det(np.reshape(tab.run(f"{replay}.data.frames"), (-1, 3, 3))), 1, atol=0.02)
    assert tab.run("document.querySelector('.replay button').click(); document.querySelector('.replay button').textContent") == "pause"
    assert tab.complaints() == []


def test_a_log_of_a_fleet_stands_out_and_leads_to_its_result(tab, tmp_path):
    curves = {"gyro_x": {i: ([0.1, 1.0], [2e-4 + i * 1e-5, 1e-4]) for i in range(2)}}
    known = {"names": ["a.csv", "b.csv"], "files": ["results/a.json", "results/b.html"], "curves": curves, "failed": [], "warnings": []}
    write_fleet({"task": {"name": "noise"}, "logs": 2, "spread": {}} | known, tmp_path / "overview.html")
    tab.open((tmp_path / "overview.html").as_uri())
    over = """document.querySelector('[data-log="b.csv"]').dispatchEvent(new PointerEvent('pointerenter'))"""
    link = "document.getElementById('result')"
    shown = tab.run(f"{over}; [document.getElementById('log').value, {link}.getAttribute('href'), {link}.textContent]")
    assert shown == ["b.csv", "results/b.html", "its page"]


def test_residuals_of_poses_are_explored(tab, pages, results):
    tab.look(1280)
    tab.open((pages / "imu.html").as_uri())
    assert "Move over the chart" in tab.run(SAID.format(1))
    tab.run(PRESS.format(1, "ArrowRight"))
    first = -1e3 * results["imu"][0].residual_norm[0]
    assert tab.run(SAID.format(1)).startswith("Pose: 1.000 norm ")
    assert float(re.search(r"norm (-?[\d.]+) mm/s²", tab.run(SAID.format(1)))[1]) == pytest.approx(first, rel=1e-3)
    # change the unit, and switch off one of three axes
    tab.run(FIGURE.format(2) + ".querySelector('select').value = 1")
    tab.run(FIGURE.format(2) + ".querySelector('select').dispatchEvent(new Event('change'))")
    tab.run(FIGURE.format(2) + ".querySelector('.toggle').click()")
    tab.run(PRESS.format(2, "ArrowRight"))
    said = tab.run(SAID.format(2))
    rest = 1e3 * np.rad2deg(results["imu"][0].residual_rest[0])
    assert " x " not in said
    assert float(re.search(r"y (-?[\d.]+) mdeg/s", said)[1]) == pytest.approx(rest[1], rel=1e-3)
    assert tab.complaints() == []
