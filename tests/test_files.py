import contextlib
import json
import os
import threading

import matplotlib.pyplot as plt
import numpy as np
import pytest

import jaxcal
from jaxcal import ExportError, Log
from jaxcal._files import check_replaceable, json_text, write_atomically
from jaxcal.io._saved import save


def test_replaces_and_keeps_permissions(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o640)
    write_atomically(path, "new")
    assert path.read_text() == "new"
    assert path.stat().st_mode & 0o777 == 0o640


def test_link_stays_a_link(tmp_path):
    (tmp_path / "real.txt").write_text("old")
    (tmp_path / "link.txt").symlink_to("real.txt")
    write_atomically(tmp_path / "link.txt", "new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch, step, refuses):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def fail(*args):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(f"jaxcal._files.os.{step}", fail)
    with refuses("not_written", ExportError):
        write_atomically(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_interruption_is_not_swallowed_and_leaves_nothing(tmp_path, monkeypatch):
    def interrupt(*args):
        raise KeyboardInterrupt

    monkeypatch.setattr("jaxcal._files.os.fsync", interrupt)
    with pytest.raises(KeyboardInterrupt):
        write_atomically(tmp_path / "a.txt", "new")
    assert os.listdir(tmp_path) == []


def test_folders_that_cannot_be_written(tmp_path, monkeypatch, refuses):
    def refuse(*args):
        raise PermissionError(13, "Permission denied")

    with refuses("not_written", ExportError):
        write_atomically(tmp_path / "nowhere" / "a.txt", "x")
    monkeypatch.setattr("builtins.open", refuse)
    with refuses("not_written", ExportError):
        write_atomically(tmp_path / "a.txt", "x")


def test_pipe_is_written_to_and_not_replaced(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)
    received = []
    reader = threading.Thread(target=lambda: received.append(path.read_bytes()))
    reader.start()
    write_atomically(path, "x")
    reader.join(timeout=10)
    assert received == [b"x"]
    assert path.is_fifo()


def test_json_is_exact_and_keeps_order():
    document = {"b": [0.1 + 0.2, 1e-300, -0.0, 3], "a": {"text": '\u03c3 "quoted"', "none": None, "flag": True, "empty": {}, "no": []}}
    text = json_text(document)
    assert json.loads(text) == document
    assert list(json.loads(text)) == ["b", "a"]
    assert "0.30000000000000004" in text
    assert text.endswith("}\n")


def test_json_has_lists_in_one_line_unless_they_hold_objects():
    lines = json_text({"words": ["a" * 60, "b" * 60], "numbers": [[0.1] * 60] * 2, "things": [{"a": 1}]}).splitlines()
    assert lines[1] == '  "words": ["' + "a" * 60 + '", "' + "b" * 60 + '"],'
    assert lines[2].startswith('  "numbers": [[0.1, ')
    assert lines[2].endswith("]],")
    assert lines[5] == '      "a": 1'


def test_json_refuses_what_json_cannot_say():
    with pytest.raises(ValueError):  # noqa: PT011
        json_text({"a": float("nan")})


@pytest.mark.parametrize(
    ("content", "digest", "code"),
    [
        ("rate: 200\n", "", "not_ours"),
        ("import jaxcal\n", "", "not_ours"),
        ("", "a" * 64, None),
        ("# kalibr file written by jaxcal 1.0\n", "a" * 64, None),
        (f"# kalibr file written by jaxcal 1.0\n# recording: a.csv, SHA-256 {'a' * 64}\n", "a" * 64, None),
        (f"# kalibr file written by jaxcal 1.0\n# recording: a.csv, SHA-256 {'a' * 64}\n", "b" * 64, "other_log"),
        (json_text({"schema": "jaxcal.MagFit/1", "provenance": {"sha256": "a" * 64}}), "b" * 64, "other_log"),
        (json_text({"schema": "jaxcal.MagFit/1", "provenance": {"sha256": "a" * 64}}), "", None),
        (json_text({"schema": "other.MagFit/1"}), "", "not_ours"),
    ],
)
def test_only_files_of_jaxcal_from_the_same_log_are_replaced(tmp_path, refuses, content, digest, code):
    path = tmp_path / "a.txt"
    path.write_text(content)
    with refuses(code, ExportError) if code else contextlib.nullcontext():
        check_replaceable(path, digest)
    check_replaceable(path, digest, force=True)


@pytest.mark.parametrize("name", ["a.png", "a.svg", "a.pdf", "a.npz", "a.parquet"])
def test_pictures_and_converted_logs_are_known(tmp_path, refuses, name):
    log = Log(None, gyro=np.eye(3), rate=10.0)
    if name.endswith(("npz", "parquet")):
        save(log, tmp_path / name)
    else:
        jaxcal.plot.save(plt.figure(), tmp_path / name)
    check_replaceable(tmp_path / name)
    (tmp_path / name).write_bytes((tmp_path / name).read_bytes().replace(b"jaxcal", b"others"))
    with refuses("not_ours", ExportError):
        check_replaceable(tmp_path / name)
