"""Shape and dtype aliases for annotations, checked at run time in the tests (jaxtyping, beartype)."""

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Num, PyTree

AnyArray = Array | np.ndarray

#: A result that is an array of JAX in a trace, and a number or array of NumPy outside of it.
Value = Array | np.ndarray | np.number

#: One recording of one channel, or several channels with time first.
Series = Num[AnyArray, " n"] | Num[AnyArray, "n channels"]

Scalar = Float[AnyArray, ""] | float

#: a group, which is a number or a word, for each of many
Groups = Sequence[Hashable] | AnyArray

__all__ = ["Any", "AnyArray", "Array", "ArrayLike", "Bool", "Float", "Groups", "Int", "Num", "PyTree", "Scalar", "Series", "Value"]
