"""Every kind of page in a real browser: wide and narrow, light and dark, and on paper."""

import pathlib

import pytest

from jaxcal.report import write

from . import browser, made

SCRIPT = (pathlib.Path(__file__).parent / "look.js").read_text(encoding="utf-8")
LOOKS = [(1280, "light", "screen"), (1280, "dark", "screen"), (360, "light", "screen"), (360, "dark", "screen"), (680, "dark", "print")]
LEAST = {"noise": 100, "thermal": 30, "imu": 40, "mag": 100, "north": 40, "device": 350}  # pieces of text in the figures


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
    """What the script finds with everything opened; on paper details stay closed."""
    tab.look(width, scheme, media)
    tab.run(f"document.querySelectorAll('details').forEach((d) => {{ d.open = {str(media == 'screen').lower()} }})")
    return tab.run(SCRIPT)


@pytest.mark.parametrize("kind", LEAST)
def test_page(tab, pages, kind):
    tab.open((pages / f"{kind}.html").as_uri())
    for look in LOOKS:
        found = looked_at(tab, *look)
        assert found["wrong"] == [], look
        assert (found["letters"] > LEAST[kind]) or look[2] == "print", look
        # the letters of a dark page would be unreadable on paper
        assert (max(found["paper"][:3]) < 50) == (look[1] == "dark" and look[2] == "screen"), look
    assert tab.complaints() == []


FAULTS = {
    "reaches from": "<div style='width: 2000px'>wide</div>",
    "holds wider text": "<table style='table-layout: fixed; width: 40px'><tr><td>unbreakable-and-very-long_word</td></tr></table>",
    "is empty": "<p> </p>",
    "has a contrast of 1": "<p style='color: #eee'>pale</p>",
    "the text holds NaN": "<p>NaN m/s</p>",
    "text_1 is cut": "<svg viewBox='0 0 9 9' width='90'><g id='text_1'><path d='M 8 1 h 5 v 3 z'/></g></svg>",
    "text_2 lies on text_1": "<svg viewBox='0 0 9 9' width='90'><g id='text_1'><path d='M 1 1 h 5 v 3 z'/></g>"
    "<g id='text_2'><path d='M 2 1 h 5 v 3 z'/></g></svg>",
}


@pytest.mark.parametrize("fault", FAULTS)
def test_faults_are_seen(tab, tmp_path, fault):
    path = tmp_path / "fault.html"
    path.write_text(f"<!DOCTYPE html><html lang='en'><head><meta charset='utf-8'></head><body>{FAULTS[fault]}</body></html>")
    tab.open(path.as_uri())
    assert fault in " ".join(looked_at(tab, *LOOKS[0])["wrong"])


def test_errors_and_requests_are_seen(tab, tmp_path):
    path = tmp_path / "fault.html"
    path.write_text(
        "<!DOCTYPE html><html><head></head><body><img src='missing.png'><script>console.log('here'); oops()</script></body></html>"
    )
    tab.open(path.as_uri())
    told = " ".join(tab.complaints())
    assert "here" in told
    assert "Uncaught" in told
    assert "ERR_FILE_NOT_FOUND" in told
