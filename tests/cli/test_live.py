"""`jaxcal mag --live`: a recording from a pseudo-terminal, its page, and who may see it."""

import json
import os
import pty
import re
import subprocess
import sys
import time
import tty
import urllib.error
import urllib.request

import numpy as np
import pytest

from jaxcal.cli._live import parsed


@pytest.mark.parametrize(
    ("line", "values"),
    [
        ("1,2,-3.5\n", [1, 2, -3.5]), ("1 2\t3", [1, 2, 3]), ('{"mag": [1, 2, 3], "t": 4}', [1, 2, 3]),
        ('{"mx": 1, "my": 2, "mz": 3}', [1, 2, 3]), ("Raw:0,0,8192,1,2,3,100,-200,300\r\n", [10, -20, 30]),
        ("mx,my,mz", None), ("1,2", None), ("1,2,nan", None), ("{", None), ("", None),
    ],
)  # fmt: skip
def test_lines_of_a_sensor(line, values):
    assert parsed(line) == values


def fetched(url, method="GET", **headers):
    with urllib.request.urlopen(urllib.request.Request(url, headers=headers, method=method), timeout=20) as answer:
        return answer.read().decode()


# the second is never reached: the page says stop, while the sensor is silent
@pytest.mark.parametrize("limit", ["0.3", pytest.param("0.001", marks=pytest.mark.long)])
def test_a_recording_ends_when_the_error_is_small_and_gives_what_the_log_gives(tmp_path, limit):
    master, slave = pty.openpty()
    tty.setraw(slave)
    command = [sys.executable, "-m", "jaxcal", "mag", "a.csv"]
    words = ["--live", os.ttyname(slave), "--limit", limit, "--out", "live"]
    how = {"cwd": tmp_path, "env": {**os.environ, "COLUMNS": "200"}, "stdout": subprocess.PIPE, "stderr": subprocess.STDOUT, "text": True}
    with subprocess.Popen([*command, *words], **how) as running:
        try:
            log = recorded(running, master, limit)
        finally:
            running.kill()
            os.close(master)
            os.close(slave)
    assert log < 4000
    again = subprocess.run([*command, "--out", "again"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert again.stderr == ""
    assert len((tmp_path / "a.csv").read_text().splitlines()) - 1 <= log
    one, two = (json.loads((tmp_path / name / "mag.json").read_text()) for name in ("live", "again"))
    assert one == two


def recorded(running, master, limit):
    """Number of readings sent until the page says that they are enough; meanwhile others are refused."""
    running.stdout.readline()
    url = re.search(r"http://127.0.0.1:\d+/\S+/", running.stdout.readline())[0]
    page = fetched(url)
    assert 'id="live"' in page
    assert "connect-src" in page
    for other, headers in (
        (url + "state", {"Origin": "http://example.org"}), (url + "state", {"Host": "example.org"}), (url.rsplit("/", 2)[0] + "/state", {}),
    ):  # fmt: skip
        with pytest.raises(urllib.error.HTTPError) as refused:
            fetched(other, **headers)
        assert refused.value.code == 403
        refused.value.close()
    rng, sent = np.random.default_rng(0), 0
    for block in range(200):  # blocks of 20 readings, until the page says that they are enough
        u = rng.standard_normal((20, 3))
        for x, y, z in 47 * u / np.linalg.norm(u, axis=1, keepdims=True) + [10, -20, 5] + 0.2 * rng.standard_normal((20, 3)):
            os.write(master, f"{x:.2f},{y:.2f},{z:.2f}\n".encode())
            sent += 1
        try:
            state = json.loads(fetched(url + "state"))
        except (urllib.error.URLError, ConnectionError):
            break  # it has ended
        if state["done"]:
            assert state["error"] < 0.3
            break
        if block == 20 and limit == "0.001":
            fetched(url + "stop", "POST")
            break
        time.sleep(0.1)
    out = running.communicate(timeout=120)[0]
    assert running.returncode == 0, out
    return sent


def test_what_cannot_be_recorded_is_a_sentence(call, tmp_path):
    (tmp_path / "a.csv").write_text("mine")
    for words, code in (
        (("a.csv", "--live", "-"), "exists"), (("b.csv", "--live", "nowhere"), "live"), (("b.csv", "--live", "x", "--baud", "7"), "baud"),
    ):  # fmt: skip
        found = call("mag", *words)
        assert (found.status, found.code) == (2, code)
    assert (tmp_path / "a.csv").read_text() == "mine"
