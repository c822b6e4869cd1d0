"""Hundreds of tables with known contents: none is read wrongly without a warning."""

import collections
import importlib.util
import pathlib

import pytest

from . import layouts

_PLACE = pathlib.Path(__file__).resolve().parents[2] / "benchmarks" / "columns.py"


@pytest.mark.parametrize("numbers", [range(40), pytest.param(range(100_000, 101_500), marks=pytest.mark.long)], ids=["few", "many"])
def test_no_layout_is_silently_wrong_and_nine_of_ten_are_right(numbers, tmp_path):
    tally, wrong = layouts.score(numbers, tmp_path)
    assert not [one for one in wrong if one[1] == "wrong"]
    assert tally["right"] + tally["refused"] >= 0.9 * len(numbers), wrong


@pytest.mark.parametrize("step", [41, pytest.param(1, marks=pytest.mark.long)])
def test_headers_after_public_habits_are_read_or_refused_with_a_way_out_that_works(step, tmp_path):
    spec = importlib.util.spec_from_file_location("columns", _PLACE)
    columns = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(columns)
    found = [(out, case["name"], kind) for case, kind, out, _ in columns.outcomes(columns.CASES[::step], tmp_path)]
    tally = collections.Counter(out for out, *_ in found)
    assert [one for one in found if one[0] not in ("right", "refused", "refused, out works", "loud, mended")] == []
    assert tally["right"] + tally["refused"] >= 0.85 * len(found)
