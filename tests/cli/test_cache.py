"""The folder of compiled programs: shown, bounded, cleared; other files in it stay."""

import os

import pytest

from jaxcal.cli._cache import bound


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """A cache of ten programs of 100 bytes, the first used longest ago, and a file of someone else's."""
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
    assert sorted(path.name for path in programs.iterdir()) == ["jit_3-cache", *(f"jit_{i}-cache" for i in range(4, 10)), "notes.txt"]
