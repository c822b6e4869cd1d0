"""What a result shows: tables of numbers and curves, as data. Renderers make text, HTML, JSON, a data frame or a row of a fleet of them.

A result lists each of its numbers once, in `Result.sections`. So a new number appears in every output by itself.
"""

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Literal, NamedTuple

from .._units import si_unit_of

#: estimated: with an interval; held: fixed by an option or convention; open: the data do not determine it; limit: only `high` is known
State = Literal["estimated", "held", "open", "limit"]


class Number(NamedTuple):
    """One number of a result.

    Attributes
    ----------
    name : its name in JSON, data frames and fleets, such as "gyro.bias[0]" or "gyro_x.N".
    value, low, high : the number and its 95 % interval, in SI; NaN where unknown. A limit has only `high`.
    quantity : "gyro", "accel", "mag", "angle", "N.gyro", ...: a name in the table of units, or a unit by itself.
    state : "estimated", "held", "open" or "limit".
    remark : a word for readers, such as "hint"; "" if there is nothing to say.
    """

    name: str
    value: float
    low: float = math.nan
    high: float = math.nan
    quantity: str = "ratio"
    state: State = "estimated"
    remark: str = ""

    @property
    def unit(self) -> str:
        """SI unit of the number."""
        return si_unit_of(self.quantity)

    @property
    def half(self) -> float:
        """Half of the 95 % interval."""
        return (self.high - self.low) / 2

    def to_dict(self) -> dict[str, Any]:
        """The number for JSON, in SI."""
        return {"value": self.value, "low": self.low, "high": self.high, "unit": self.unit, "state": self.state}


class Grid(NamedTuple):
    """A table of numbers: one row for each parameter, one column for each axis.

    Attributes
    ----------
    key : name of the table, for links and programs.
    title : heading.
    columns : headings of the columns of cells; ("",) for a list of numbers.
    rows : (label, cells): as many cells as columns, each a `Number`, a text, or None for an empty one.
    detail : True for what the terminal shows only with `-v`.
    note : a sentence below the table; "" for none.
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, tuple[Number | str | None, ...]], ...]
    detail: bool = False
    note: str = ""


class Curve(NamedTuple):
    """Columns of equal length, such as a deviation by cluster time; shown in reports, data frames and JSON.

    Attributes
    ----------
    key : name of the curve, for links and programs.
    title : heading.
    columns : name -> (quantity, values); the first is the abscissa.
    """

    key: str
    title: str
    columns: Mapping[str, tuple[str, Any]]


Section = Grid | Curve


def numbers_of(sections: Iterable[Section]) -> dict[str, Number]:
    """All numbers of the tables, by name."""
    cells = (cell for one in sections if isinstance(one, Grid) for _, row in one.rows for cell in row)
    return {cell.name: cell for cell in cells if isinstance(cell, Number)}


def listed(key: str, title: str, labelled: Iterable[tuple[str, Number]], **options: Any) -> Grid:
    """A table of one number a row, with their labels."""
    return Grid(key, title, ("",), tuple((label, (cell,)) for label, cell in labelled), **options)


def by_axis(key: str, title: str, numbers: Sequence[Number], labels: Mapping[str, str] | None = None, **options: Any) -> Grid:
    """A table of the parameters of a sensor: a vector is a row, a matrix is three rows, a scalar is a row with one cell.

    The names of the numbers end in their place, as in "gyro.matrix[0,1]" and "gyro.bias[2]"; a name without one is a scalar. So a new
    field of a model gets its rows by itself.

    Parameters
    ----------
    key, title : of the table.
    numbers : the numbers, with the entries of a field in order.
    labels : last part of a field's name ("hard_iron") -> label of its rows; else the name with blanks for underscores.

    Examples
    --------
    >>> from jaxcal._answer import Number, by_axis
    >>> vector = [Number(f"gyro.bias[{i}]", 0.1 * i) for i in range(3)]
    >>> found = by_axis("gyro", "gyroscope", [*vector, Number("gyro.delay", 3.0)])
    >>> found.columns, [label for label, _ in found.rows]
    (('x', 'y', 'z'), ['bias', 'delay'])
    """
    rows: list[tuple[str, tuple[Number | str | None, ...]]] = []
    for field, group in itertools.groupby(numbers, lambda one: one.name.partition("[")[0]):
        cells = list(group)
        name = field.rpartition(".")[2]
        label = (labels or {}).get(name, name.replace("_", " "))
        size = _columns_of(cells)
        for i in range(0, len(cells), size):
            part = cells[i : i + size]
            axis = "" if len(cells) <= size else f" {'xyz'[i // size]}" if len(cells) == 9 else f" {i // size + 1}"
            rows.append((label + axis, (*part, *[None] * (3 - len(part)))))
    return Grid(key, title, ("x", "y", "z"), tuple(rows), **options)


def _columns_of(cells: Sequence[Number]) -> int:
    """Number of cells in a row of a field: three for vectors and matrices, one for scalars."""
    return 3 if "[" in cells[0].name else 1


def flat(sections: Iterable[Section]) -> Iterator[dict[str, Any]]:
    """One row for each number, for a data frame."""
    for one in numbers_of(sections).values():
        yield {"name": one.name, "value": float(one.value), "low": float(one.low), "high": float(one.high), "unit": one.unit,
               "state": one.state}  # fmt: skip
