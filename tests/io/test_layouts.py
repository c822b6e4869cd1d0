"""Hundreds of tables with known contents: none is read wrongly without a warning."""

import pytest

from . import layouts


@pytest.mark.parametrize("numbers", [range(90), pytest.param(range(100_000, 101_500), marks=pytest.mark.long)], ids=["few", "many"])
def test_no_layout_is_silently_wrong_and_nine_of_ten_are_right(numbers, tmp_path):
    tally, wrong = layouts.score(numbers, tmp_path)
    assert not [one for one in wrong if one[1] == "wrong"]
    assert tally["right"] + tally["refused"] >= 0.9 * len(numbers), wrong
