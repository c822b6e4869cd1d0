"""Shape and dtype aliases for annotations, checked at run time in the tests (jaxtyping, beartype)."""

from collections.abc import Hashable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Num, PyTree

AnyArray = Array | np.ndarray

#: a result that is a JAX array in a trace, and a NumPy number or array outside of it
Value = Array | np.ndarray | np.number

#: one recording of one channel, or of several channels with time first
Series = Num[AnyArray, " n"] | Num[AnyArray, "n channels"]

Scalar = Float[AnyArray, ""] | float

#: what NumPy makes an array of numbers of
Numbers = ArrayLike | Sequence[Any]

#: a number, or an array of them or that stands for one, which may be traced
Real = int | float | np.number | AnyArray

#: the group of each of many items: a number or a word
Groups = Sequence[Hashable] | AnyArray

#: options of reading: the columns of each quantity by number or name, the unit of each, and axes such as "y,x,-z"; as text "gyro=1:3"
ColumnsOf = Mapping[str, int | str | Sequence[int | str] | None] | str
UnitsOf = Mapping[str, str | float | int] | str
AxesOf = Mapping[str, str | Sequence[str]] | str

__all__ = [
    "Any", "AnyArray", "Array", "ArrayLike", "AxesOf", "Bool", "ColumnsOf", "Float", "Groups", "Int", "Num", "Numbers", "PyTree", "Real",
    "Scalar", "Series", "UnitsOf", "Value",
]  # fmt: skip
