"""Text tables (CSV, TSV, blanks), plain or gzipped."""

import pathlib

from ._blocks import gather, polars
from ._sniff import sniff
from ._table import Table
from ._text import open_text


def read_csv(path: pathlib.Path) -> Table:
    """Columns of a text table.

    Rows with the wrong number of fields are left out, and text in a column of numbers is a missing value; both are counted, and
    more than 1 % of either is an error that shows the first.
    """
    polars()
    text = open_text(path)
    layout = sniff(text.head)
    warnings: list[str] = []
    columns = gather(text, layout, warnings)
    integer = {j for j, kind in enumerate(layout.kinds) if kind in ("int", "long")}
    return Table(columns, layout.names, integer, warnings=warnings)
