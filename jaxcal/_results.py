"""`Result`: the common part of all results. A new kind of result only needs fields and, if wanted, a table."""

import dataclasses
import html
import importlib
import importlib.metadata
import math
import os
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

import equinox as eqx
import jax
import numpy as np

from ._errors import DataError
from ._files import json_text, write_atomically
from ._precision import is_traced
from ._units import number

_WIDTH = 100  # characters per line of text
_FEW = 12  # number of rows in a `repr`
#: attributes that `summary` lists below the verdict, with their unit
_FACTS = {"method": "", "kind": "", "convention": "", "rate": " Hz", "duration": " s", "used": " readings"}


class Row(NamedTuple):
    """One number in the table of `Result.summary`, with its interval if known."""

    name: str
    value: Any
    low: Any = math.nan
    high: Any = math.nan
    unit: str = ""
    remark: str = ""


class Result(eqx.Module):
    """Base of all results. A subclass has the three attributes below, as fields or properties, and lists its numbers in `_rows`.

    A result prints its numbers with intervals and units; a notebook shows them as a table. It cannot be hashed, because it holds arrays.

    Attributes
    ----------
    verdict : "good", "weak" or "refused"; for noise, "present", "hint" or "not detected" for every term.
    reason : one or more sentences that explain the verdict.
    warnings : sentences.
    """

    if not TYPE_CHECKING:  # a type checker would treat them as arguments of every subclass
        verdict: eqx.AbstractVar[Any]
        reason: eqx.AbstractVar[str]
        warnings: eqx.AbstractVar[tuple[Any, ...]]
        __hash__ = None

    #: function of `jaxcal.plot` that draws the result, and whether it needs the readings before the result
    _figure: ClassVar[tuple[str, bool] | None] = None

    def _rows(self) -> list[Row]:
        """Numbers that `summary` shows."""
        return []

    def _columns(self) -> dict[str, Any]:
        """Columns of `to_dataframe`: those of the table in `summary`, unless a subclass defines longer ones."""
        rows = [row._replace(value=float(row.value), low=float(row.low), high=float(row.high)) for row in self._rows()]
        return {name: [row[i] for row in rows] for i, name in enumerate(Row._fields)}

    def _head(self) -> str:
        judged: Any = self
        verdict = f"{judged.verdict}: " if isinstance(judged.verdict, str) else ""
        return f"{type(self).__name__}: {verdict}{judged.reason}"

    def _header(self) -> tuple[str, ...]:
        return "", "value", f"{100 * getattr(self, 'confidence', 0.95):g} % interval", "unit", ""

    def __repr__(self) -> str:
        """The verdict, and the first numbers with interval and unit."""
        if is_traced(self):
            return eqx.tree_pformat(self)
        rows = self._rows()
        lines = [textwrap.shorten(self._head(), _WIDTH, placeholder=" ...")]
        lines += _aligned([_cells(row) for row in rows[:_FEW]])
        if len(rows) > _FEW:
            lines.append(f"  ... {len(rows) - _FEW} more numbers: print(result.summary())")
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """The verdict and a table of all numbers, for notebooks."""
        if is_traced(self):
            return f"<pre>{html.escape(repr(self))}</pre>"
        judged: Any = self
        head = "".join(f"<th style='text-align:left'>{name}</th>" for name in self._header())
        rows = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in _cells(row)) + "</tr>" for row in self._rows())
        said = "".join(f"<li>{html.escape(str(sentence))}</li>" for sentence in jax.tree.leaves(judged.warnings))
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>" if rows else ""
        return f"<p>{html.escape(self._head())}</p>{table}" + (f"<ul>{said}</ul>" if said else "")

    def summary(self) -> str:
        """The verdict, a table with units and intervals, and the warnings, as plain text (host only).

        Examples
        --------
        >>> import jaxcal
        >>> from jaxcal.magnetometer import body_field, scenario
        >>> print(jaxcal.magnetometer.fit(body_field(scenario("all"), 50e-6), field=50e-6).summary().splitlines()[0][:12])
        MagFit: good
        """
        judged: Any = self
        lines = textwrap.wrap(self._head(), _WIDTH, subsequent_indent="  ")
        known = {name: getattr(self, name, None) for name in _FACTS}
        facts = [f"{name} {f'{value:.6g}' if isinstance(value, float) else value}{_FACTS[name]}" for name, value in known.items()
                 if isinstance(value, str | int | float) and value != ""]  # fmt: skip
        lines += textwrap.wrap(", ".join(facts), _WIDTH, initial_indent="  ", subsequent_indent="  ")
        if rows := self._rows():
            table = _aligned([_cells(row) for row in rows], self._header())
            rule = "  " + "-" * (max(map(len, table)) - 2)
            lines += [rule, table[0], rule, *table[1:], rule]
        for sentence in jax.tree.leaves(judged.warnings):
            lines += textwrap.wrap(f"Warning: {sentence}", _WIDTH, subsequent_indent="  ")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Every field, and the verdict with its reason, in a form for JSON: SI units, and None for infinite or unknown numbers.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> found = jaxcal.allan.deviation(noise, rate=100.0, m=[1, 2]).to_dict()
        >>> found["schema"], found["m"]
        ('jaxcal.Deviation/1', [1, 2])
        """
        head = {"schema": f"jaxcal.{type(self).__name__}/1", "version": importlib.metadata.version("jaxcal")}
        judged = {name: plain(getattr(self, name)) for name in ("verdict", "reason", "warnings")}
        return head | plain(self) | judged

    def to_dataframe(self) -> Any:
        """The numbers as a data frame of polars, or of pandas if polars is not installed.

        A fit has one row per number: name, value, low, high, unit, remark. A curve has one row per point.

        Raises
        ------
        DataError
            If neither polars nor pandas is installed.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> frame = jaxcal.allan.deviation(noise, rate=100.0, m=[1, 2]).to_dataframe()
        >>> frame.shape, frame["tau"].to_list()
        ((2, 9), [0.01, 0.02])
        """
        for library in ("polars", "pandas"):
            try:
                module: Any = importlib.import_module(library)
            except ImportError:
                continue
            return module.DataFrame(self._columns())
        raise DataError("to_dataframe() needs polars or pandas, and neither is installed: pip install polars")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as JSON; an existing file is replaced in one step.

        Raises
        ------
        ExportError
            If the file cannot be written.

        Examples
        --------
        >>> import pathlib, tempfile
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     path = pathlib.Path(folder, "deviation.json")
        ...     jaxcal.allan.deviation(noise, rate=100.0, m=[1, 2]).save(path)
        ...     path.read_text().splitlines()[1].strip()
        '"schema": "jaxcal.Deviation/1",'
        """
        write_atomically(path, json_text(self.to_dict()))

    def plot(self, *readings: Any, ax: Any = None) -> Any:
        """Draw the result with the function of `jaxcal.plot` for this kind of result.

        Parameters
        ----------
        readings : the fitted readings, for results that do not hold them: (n, 3) readings of a `MagFit`, `Readings` of an `AlignmentFit`.
        ax : matplotlib axes to draw into; None makes a figure.

        Returns
        -------
        The axes.

        Raises
        ------
        DataError
            If the readings are missing, or there is no figure for this kind of result.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> jaxcal.allan.deviation(noise, rate=100.0).plot().get_xscale()
        'log'
        """
        name = type(self).__name__
        if self._figure is None:
            raise DataError(f"there is no figure of a {name}; its numbers are in to_dataframe()")
        function, wanted = self._figure
        if len(readings) != wanted:
            call = f"plot({'readings' if wanted else ''})"
            raise DataError(f"a {name} is drawn by {call}, with {'the readings that were fitted' if wanted else 'nothing else'}")
        # load `plot` only now, because it depends on this module
        draw = getattr(importlib.import_module(f"{__package__}.plot"), function)
        return draw(*readings, self, ax)


class Unjudged(Result):
    """A result without a decision: good, or weak if it has warnings."""

    @property
    def verdict(self) -> str:
        """The word "good", or "weak" if there are warnings."""
        return "weak" if getattr(self, "warnings") else "good"  # noqa: B009

    @property
    def reason(self) -> str:
        """The number of warnings, as a sentence."""
        count = len(getattr(self, "warnings"))  # noqa: B009
        return f"{count} warning{'s' * (count != 1)}." if count else "No warnings."


def by_channel(sentences: Mapping[str, Any]) -> list[str]:
    """Sentences of several channels, each once, with the channels to which it applies.

    Examples
    --------
    >>> from jaxcal._results import by_channel
    >>> by_channel({"gyro_x": ["short record"], "gyro_y": ["short record", "odd"]})
    ['gyro_x, gyro_y: short record', 'gyro_y: odd']
    """
    channels: dict[str, list[str]] = {}
    for channel, found in sentences.items():
        for sentence in found:
            channels.setdefault(str(sentence), []).append(channel)
    return [f"{', '.join(names)}: {sentence}" for sentence, names in channels.items()]


def plain(value: Any) -> Any:
    """Any value in a form for JSON: modules as dictionaries, arrays as lists, infinite or unknown numbers as None.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._results import plain
    >>> plain({"low": np.array([1.0, np.inf]), 2: ("a", None)})
    {'low': [1.0, None], '2': ['a', None]}
    """
    if hasattr(value, "__array__"):
        value = np.asarray(value).tolist()
    if hasattr(value, "_enumeration"):  # an item of an Equinox Enumeration, by its name
        names = value._enumeration._name_to_item.items()
        return next(name for name, item in names if int(item._value) == int(np.asarray(value._value)))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        value = {field.name: getattr(value, field.name) for field in dataclasses.fields(value) if not field.name.startswith("_")}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | set | frozenset):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def _aligned(cells: list[list[str]], header: Sequence[str] = ()) -> list[str]:
    """Rows of cells as lines with aligned columns; columns without any cell are left out, with their header."""
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    if header:
        widths = [width and max(width, len(name)) for width, name in zip(widths, header, strict=True)]
        cells = [list(header), *cells]
    return ["  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True) if width).rstrip() for row in cells]


def _cells(row: Row) -> list[str]:
    value, low, high = (float(x) for x in row[1:4])
    half = (high - low) / 2
    return [row.name, number(value, half), f"{number(low, half)} to {number(high, half)}" if half > 0 else "", row.unit, row.remark]
