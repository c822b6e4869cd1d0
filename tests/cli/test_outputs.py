"""Output files are checked before the computation, and then either all or none are written."""

import os
import subprocess
import sys

import jaxcal

from .conftest import listing, save, table

ALLAN = ("allan", "imu.csv", "--m", "1", "--quiet")


def test_files_appear_together(call, folder, log, monkeypatch):
    def save(axes, place):
        assert not (folder / "a.json").exists()
        place.write_text("picture")

    monkeypatch.setattr("jaxcal.plot.save", save)
    assert call(*ALLAN, "--json", "a.json", "--plot", "b.png").status == 0
    assert listing(folder) == ["a.json", "b.png", "imu.csv"]
    assert (folder / "b.png").read_text() == "picture"


def test_a_failure_leaves_nothing_and_keeps_what_was_there(call, folder, log, monkeypatch):
    (folder / "a.json").write_text("before")
    monkeypatch.setattr("jaxcal.plot.save", lambda axes, place: 1 / 0)
    assert call(*ALLAN, "--json", "a.json", "--plot", "b.png", "--force").status == 3
    assert listing(folder) == ["a.json", "imu.csv"]
    assert (folder / "a.json").read_text() == "before"


def test_a_file_of_the_user_or_of_another_log_is_replaced_only_by_force(call, folder, log):
    (folder / "mine.json").write_text("[1, 2]")
    found = call(*ALLAN, "--json", "mine.json")
    assert (found.status, found.code) == (2, "not_ours")
    assert "--force" in found.reason
    assert (folder / "mine.json").read_text() == "[1, 2]"
    assert call(*ALLAN, "--report", "a.html").status == 0
    assert call(*ALLAN, "--report", "a.html").status == 0  # the same log once more
    save(log, table(seed=1))
    before = (folder / "a.html").read_bytes()
    found = call(*ALLAN, "--report", "a.html")
    assert (found.status, found.code) == (2, "other_log")
    assert (folder / "a.html").read_bytes() == before
    assert call(*ALLAN, "--report", "a.html", "--force").status == 0
    assert (folder / "a.html").read_bytes() != before


def test_a_link_keeps_pointing_at_the_file_that_is_replaced(call, folder, log):
    real, link = folder / "real", folder / "link"
    real.write_text("before")
    link.symlink_to(real)
    assert call(*ALLAN, "--json", "link", "--force").status == 0
    assert link.is_symlink()
    assert real.read_text().startswith("{")


def test_a_folder_made_for_nothing_goes_again(call, folder, log, monkeypatch):
    monkeypatch.setattr("jaxcal.noise.characterise", lambda *args, **options: jaxcal.noise.NoiseFits({}))
    assert call("noise", "imu.csv", "--json", "a.json", "--out", "deep/er").status == 0
    assert listing(folder) == ["a.json", "imu.csv"]


def test_what_a_killed_run_left_is_removed_by_the_next(call, folder, log):
    from jaxcal._files import hidden_name

    code = "import os; print(os.getpid())"
    gone = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip()
    own = hidden_name()
    left = own.replace(f"-{os.getpid()}-", f"-{gone}-")
    for name in (own, left):
        (folder / name).mkdir()
        (folder / name / "half.json").write_text("{")
    assert call(*ALLAN, "--json", "a.json").status == 0
    assert listing(folder) == [own, f"{own}/half.json", "a.json", "imu.csv"]  # the folder of a running process is kept
