"""How a result is said: numbers and findings as data, and the renderers that make every output of them.

A result lists its numbers once (`Result.sections`) and its doubts once (`Result.findings`). Text, HTML, JSON, a data frame and a row of a
fleet are rendered from these two lists, so nothing can stand in one output and be missing in another.
"""

from typing import TYPE_CHECKING

from .._lazy import install
from .._message import Message as Message, Reader as Reader
from ._common import GRAVITY_ASSUMED as GRAVITY_ASSUMED, WRONG_RANGE as WRONG_RANGE, wrong_ranges as wrong_ranges
from ._findings import (
    CAUTION as CAUTION,
    FATAL as FATAL,
    NOTE as NOTE,
    Finding as Finding,
    Kind as Kind,
    Quantity as Quantity,
    Severity as Severity,
    Table as Table,
    joined as joined,
    joined_names as joined_names,
    merged as merged,
    ordered as ordered,
    table as table,
    verdict_of as verdict_of,
    worst as worst,
)
from ._sections import (
    Curve as Curve,
    Grid as Grid,
    Number as Number,
    Section as Section,
    by_axis as by_axis,
    listed as listed,
    numbers_of as numbers_of,
)
from ._text import cell_text as cell_text, grid_lines as grid_lines, tables as tables, things_to_know as things_to_know

if TYPE_CHECKING:
    from ._data import plain as plain
    from ._result import Result as Result, Results as Results
else:  # these load NumPy and JAX, which the help of the command line does not need
    install(__name__, {"_data": "plain", "_result": "Result Results"})
