"""`Result`: what every estimator returns has in common, so that a new result is a class with fields and, at most, a table."""

import dataclasses
import importlib.metadata
import math
import os
import statistics
import textwrap
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import numpy as np

from ._files import json_text, write_atomically
from ._units import number

#: half of a 95 % interval in standard deviations
NORMAL95 = statistics.NormalDist().inv_cdf(0.975)
_WIDTH = 100  # characters of a line of text


class Row(NamedTuple):
    """One number of the table in `Result.summary`, with its interval where one is known."""

    name: str
    value: Any
    low: Any = math.nan
    high: Any = math.nan
    unit: str = ""
    remark: str = ""


class Result(eqx.Module):
    """Base of all results. A subclass has the three attributes below, as fields or properties, and says its numbers by `_rows`.

    Attributes
    ----------
    verdict : "good", "weak" or "refused"; of noise, for every term, "present", "hint" or "not detected".
    reason : why, in a sentence or more.
    warnings : sentences.
    """

    if not TYPE_CHECKING:  # a type checker would take them for arguments of every subclass
        verdict: eqx.AbstractVar[Any]
        reason: eqx.AbstractVar[str]
        warnings: eqx.AbstractVar[tuple[Any, ...]]

    def _rows(self) -> list[Row]:
        """Numbers that `summary` shows."""
        return []

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
        verdict = f"{judged.verdict}: " if isinstance(judged.verdict, str) else ""
        lines = textwrap.wrap(f"{type(self).__name__}: {verdict}{judged.reason}", _WIDTH, subsequent_indent="  ")
        cells = [_cells(row) for row in self._rows()]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines += ["  " + "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True) if width).rstrip() for row in cells]
        for sentence in jax.tree.leaves(judged.warnings):
            lines += textwrap.wrap(f"Warning: {sentence}", _WIDTH, subsequent_indent="  ")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Every field, and the verdict with its reason, as JSON can say it: SI units; None for what is infinite or not known.

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

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `to_dict` as JSON; an existing file is replaced in one step.

        Raises
        ------
        ExportError
            If the file cannot be written.
        """
        write_atomically(path, json_text(self.to_dict()))


class Unjudged(Result):
    """A result that decides nothing: good, or weak where it comes with warnings."""

    @property
    def verdict(self) -> str:
        """The word "good", or "weak" where there are warnings."""
        return "weak" if getattr(self, "warnings") else "good"  # noqa: B009

    @property
    def reason(self) -> str:
        """How many warnings there are."""
        count = len(getattr(self, "warnings"))  # noqa: B009
        return f"{count} warning{'s' * (count != 1)}." if count else "No warnings."


def rows_of(curve: Any, field: str, name: Callable[[int], str], unit: str) -> list[Row]:
    """At most twelve rows of a curve with `lower` and `upper`, channels one after the other."""
    values, low, high = (np.asarray(getattr(curve, key)).reshape(len(curve.lower), -1) for key in (field, "lower", "upper"))
    picked = np.unique(np.linspace(0, len(values) - 1, min(len(values), 12)).astype(int)).tolist()
    channels = [""] if values.shape[1] == 1 else [f", channel {k}" for k in range(values.shape[1])]
    return [Row(name(i) + text, values[i, k], low[i, k], high[i, k], unit) for k, text in enumerate(channels) for i in picked]


def channel_of(result: Any, name: str, index: int, axes: int = 2) -> Any:
    """A result for one of several channels, which are the last of the `axes` axes of its array `name` and of others with as many."""
    if getattr(result, name).ndim < axes:
        raise IndexError(f"this {name} is of a single channel; there is nothing to pick")
    return jax.tree.map(lambda leaf: leaf[..., index] if leaf.ndim == axes else leaf, result)


def replaced(module: Any, **fields: Any) -> Any:
    """A frozen module with other values in some of its fields, made without its `__init__`."""
    new = object.__new__(type(module))
    for field in dataclasses.fields(module):
        object.__setattr__(new, field.name, fields.get(field.name, getattr(module, field.name)))
    return new


def by_channel(sentences: Mapping[str, Any]) -> list[str]:
    """Sentences of several channels, each once with the channels it is true of.

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
    """Any value as JSON can say it: modules as dictionaries, arrays as lists, infinite or unknown numbers as None.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._results import plain
    >>> plain({"low": np.array([1.0, np.inf]), 2: ("a", None)})
    {'low': [1.0, None], '2': ['a', None]}
    """
    if hasattr(value, "__array__"):
        value = np.asarray(value).tolist()
    if hasattr(value, "_enumeration"):  # an item of an Enumeration of Equinox, by its name
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


def _cells(row: Row) -> list[str]:
    value, low, high = (float(x) for x in row[1:4])
    half = (high - low) / 2
    return [row.name, number(value, half), f"{number(low, half)} to {number(high, half)}" if half > 0 else "", row.unit, row.remark]
