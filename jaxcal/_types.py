"""Shape and dtype aliases for annotations, checked at run time in the tests (jaxtyping, beartype)."""

import os
from collections.abc import Hashable, Mapping, Sequence
from typing import TYPE_CHECKING, Annotated, Any, Protocol, TypeAlias, TypeVar

import numpy as np
from jaxtyping import Array, ArrayLike, Bool, Float, Int, Num

AnyArray = Array | np.ndarray

#: a result that is a JAX array in a trace, and a NumPy number or array outside of it
Value = Array | np.ndarray | np.number

#: one recording of one channel, or of several channels with time first
Series = Num[AnyArray, " n"] | Num[AnyArray, "n channels"]

Scalar = Float[AnyArray, ""] | float

if TYPE_CHECKING:
    from equinox import Module

    T = TypeVar("T")
    Checked = Annotated[T, "refused in a sentence"]
else:

    class Checked:
        """`Checked[T]` is T for a type checker, and anything at run time: there the function itself refuses what is no T, in a sentence.

        It also types the fields of models, in which JAX's transformations place axes, flags and objects of their own.
        """

        def __class_getitem__(cls, kind):
            return Any


#: what NumPy makes an array of numbers of
Numbers = ArrayLike | Sequence[Any]

#: a number, or an array of them or that stands for one, which may be traced
Real = int | float | np.number | AnyArray

#: the group of each of many items: a number or a word
Groups = Sequence[Hashable] | AnyArray


class Frame(Protocol):
    """A data frame of pandas or polars."""

    @property
    def columns(self) -> Any:
        """Names of the columns."""
        ...


#: readings, or other numbers by sample
Samples = Checked[Numbers]

#: a number of a model or a result, or an array of them
Leaf = Checked[Real]

#: an array that a model or a result holds
Held = Checked[AnyArray]

#: noise as its N, as a model or a fit of it, or one of these for each axis or sensor
NoiseLike: TypeAlias = Checked["Real | Module | Sequence[Any] | Mapping[str, Any]"]

#: a model or a result of jaxcal, or several by name
Given: TypeAlias = Checked["Module | Mapping[str, Any]"]

#: any tree of arrays, such as a dictionary or a module
Tree = object

PathLike = str | os.PathLike[str]

#: cluster sizes: the name of a grid, or whole numbers of samples
Sizes = Checked[str | Numbers]

Seed = Checked[int | np.random.Generator]

#: options of reading: the columns of each quantity by number or name, the unit of each, and axes such as "y,x,-z"; as text "gyro=1:3"
ColumnsOf = Mapping[str, int | str | Sequence[int | str] | None] | str
UnitsOf = Mapping[str, str | float | int] | str
AxesOf = Mapping[str, str | Sequence[str]] | str

__all__ = [
    "Any", "AnyArray", "Array", "ArrayLike", "AxesOf", "Bool", "Checked", "ColumnsOf", "Float", "Frame", "Given", "Groups", "Held", "Int",
    "Leaf", "NoiseLike", "Num", "Numbers", "PathLike", "Real", "Samples", "Scalar", "Seed", "Series", "Sizes", "Tree", "UnitsOf", "Value",
]  # fmt: skip
