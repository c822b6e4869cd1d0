"""The folder of compiled programs is shown, limited in size and cleared; other files in it are kept."""

import os
import pathlib

import numpy as np
import pytest

from jaxcal.cli._cache import bound


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """A cache of ten programs of 100 bytes, of which the first was used longest ago, and a file that does not belong to jaxcal."""
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "cache" / "jaxcal" / "xla"
    folder.mkdir(parents=True)
    (folder / "notes.txt").write_text("mine")
    for i in range(10):
        (folder / f"jit_{i}-cache").write_bytes(bytes(100))
        os.utime(folder / f"jit_{i}-cache", (1e9 + i, 1e9 + i))
    return folder


def test_the_folder_is_shown_and_cleared(call, programs):
    found = call("cache")
    assert found.status == 0
    assert str(programs) in found.out
    assert "10 files, 0.0 MB of at most 200 MB" in found.out
    assert call("cache", "--clear").status == 0
    assert [path.name for path in programs.iterdir()] == ["notes.txt"]
    assert "0 files" in call("cache").out


def test_a_folder_of_the_users_own_is_left_alone(call, programs, monkeypatch):
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", str(programs))
    assert "neither bounds nor clears" in " ".join(call("cache").out.split())
    found = call("cache", "--clear")
    assert found.status == 2
    assert "remove its files yourself" in found.reason
    assert len(list(programs.iterdir())) == 11


def test_beyond_the_bound_the_oldest_programs_go(programs):
    bound(programs, 1000)
    assert len(list(programs.iterdir())) == 11
    bound(programs, 999)
    assert sorted(path.name for path in programs.iterdir()) == [*(f"jit_{i}-cache" for i in range(1, 10)), "notes.txt"]


# those of north need LAPACK, whose routines a command loads with them
@pytest.mark.parametrize("words", ["allan imu.csv", pytest.param("north table.csv --latitude 35", marks=pytest.mark.long)])
def test_a_second_command_finds_its_programs_without_a_trace(tmp_path, shell, log, monkeypatch, words):
    """A traced program is stored in a file; a truncated file is replaced and can be used again, and the result is the same each time."""
    monkeypatch.setitem(shell.environment, "XDG_CACHE_HOME", str(tmp_path / "cache"))
    turned = [(angle, np.deg2rad(angle)) for angle in (0, 90, 180, 270)]
    rows = "".join(f"{angle},60,{-0.1 * np.sin(a):.4g},{12 * np.cos(a):.4g}\n" for angle, a in turned)
    (tmp_path / "table.csv").write_text("angle [deg],dwell [s],accel [m/s^2],gyro [deg/h]\n" + rows)
    folder = pathlib.Path(shell.environment["XDG_CACHE_HOME"]) / "jaxcal" / "xla"
    answers, kept, compiled = [], [], []
    for cut in (False, True, False):
        for path in folder.glob("program-*-cache") if cut else ():
            path.write_bytes(path.read_bytes()[:100])
        found = shell(*words.split(), "--json", "a.json", "--force", cwd=tmp_path)
        assert (found.status, found.err) == (0, "")
        answers.append(found.out)
        kept.append({path.name: path.stat().st_size for path in folder.glob("program-*-cache")})
        compiled.append({path.name for path in folder.glob("*-cache")})
    assert kept[0]
    assert set(kept[1]) == set(kept[0])
    assert min(kept[1].values()) > 1000
    assert kept[2] == kept[1]
    assert compiled[2] == compiled[1]  # nothing that is in the cache is compiled again
    assert answers == answers[:1] * 3


def test_a_model_of_the_users_own_is_not_kept(tmp_path):
    """Users can change a class without changing its name, so that a fit of it is traced in every process."""
    from jaxcal import fitting
    from jaxcal._compile import _stores, keep_programs

    keep_programs(tmp_path)
    try:
        fitting.solve(own_residuals, {"level": 0.0}, np.array([1.0, 2.0, 4.0]))
        assert not list(tmp_path.iterdir())
    finally:
        _stores.clear()


def own_residuals(model, data):
    """Residuals of a user-defined model, whose level is fitted to the mean of the data."""
    return model["level"] - data
