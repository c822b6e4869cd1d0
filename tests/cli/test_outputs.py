"""Output files: checked first, then all or none."""

import pytest

from jaxcal.cli._outputs import CallError, staged

from .conftest import listing


def test_files_appear_when_the_block_ends(tmp_path):
    a, b = tmp_path / "a", tmp_path / "deep" / "er" / "b"
    with staged([a, b], folder=b.parent) as places:
        places[a].write_text("1")
        places[b].write_text("2")
        assert not a.exists()
        assert not b.exists()
    assert listing(tmp_path) == ["a", "deep", "deep/er", "deep/er/b"]
    assert (a.read_text(), b.read_text()) == ("1", "2")


def test_a_failure_leaves_nothing_and_keeps_what_was_there(tmp_path):
    old, new = tmp_path / "old", tmp_path / "made" / "new"
    old.write_text("before")
    with pytest.raises(ZeroDivisionError), staged([old, new], folder=new.parent) as places:  # noqa: PT012
        places[old].write_text("after")
        places[new].write_text("after")
        _ = 1 / 0
    assert listing(tmp_path) == ["old"]
    assert old.read_text() == "before"


def test_a_target_that_is_not_written_is_left_out(tmp_path):
    with staged([tmp_path / "a", tmp_path / "b"]) as places:
        places[tmp_path / "a"].write_text("1")
    assert listing(tmp_path) == ["a"]


def test_a_link_keeps_pointing_at_the_file_that_is_replaced(tmp_path):
    real, link = tmp_path / "real", tmp_path / "link"
    real.write_text("before")
    link.symlink_to(real)
    with staged([link]) as places:
        places[link].write_text("after")
    assert link.is_symlink()
    assert real.read_text() == "after"


def test_a_folder_made_for_nothing_goes_again(tmp_path):
    with staged([], folder=tmp_path / "empty"):
        pass
    assert listing(tmp_path) == []


@pytest.mark.parametrize("name", ["missing/a", "file/a"])
def test_a_folder_that_is_not_there_is_refused_before_the_work(tmp_path, name):
    (tmp_path / "file").write_text("")
    with pytest.raises(CallError, match=r"cannot write into .*; give a path in another folder"), staged([tmp_path / name]):
        pytest.fail("the work must not begin")


def test_a_folder_that_cannot_be_made_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CallError, match=r"cannot make the folder .*file/out: .*; give another with --out"):
        staged([tmp_path / "file" / "out" / "a"], folder=tmp_path / "file" / "out").__enter__()
    assert listing(tmp_path) == ["file"]


def test_a_folder_that_may_not_be_written_is_refused(tmp_path, monkeypatch):
    def refuse(**kwargs):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.mkdtemp", refuse)
    with pytest.raises(CallError, match=r"cannot write into .*: permission denied; give a path in another folder"):
        staged([tmp_path / "a"]).__enter__()


def test_the_input_is_never_overwritten(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("1")
    with pytest.raises(CallError, match="is the log that is read"):
        staged([tmp_path / "." / "log.csv"], inputs=[log]).__enter__()


def test_a_folder_is_no_file(tmp_path):
    with pytest.raises(CallError, match="is a folder; give the name of a file in it"):
        staged([tmp_path]).__enter__()
