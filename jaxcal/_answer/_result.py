"""`Result`: the common part of all results; `Results`: the results of several channels."""

import dataclasses
import difflib
import html
import importlib
import os
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar, Generic, TypeVar

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._files import json_text, version_of, write_atomically
from .._frozen import direct
from .._precision import is_traced
from ._data import data_frame, plain
from ._findings import CAUTION, NOTE, Finding, joined, merged, ordered, verdict_of
from ._html import answer_html
from ._sections import Curve, Number, Section, flat, numbers_of
from ._text import tables, things_to_know

_WIDTH = 100  # characters a line of text in Python


class _Said:
    """What every result can do with its numbers and findings; a subclass has `findings`, `headline` and `sections()`."""

    #: function of `jaxcal.plot` that draws the result, and whether it needs the readings before the result
    _figure: ClassVar[tuple[str, bool] | None] = None
    #: fields that are not written to JSON
    _unlisted: ClassVar[tuple[str, ...]] = ()
    #: class of the results of several channels, for results that come by channel
    _several: ClassVar[Any] = None
    #: whether a data frame has a row for each point of its curves, and not for each number
    _curve: ClassVar[bool] = False

    if TYPE_CHECKING:
        findings: tuple[Finding, ...]

    @property
    def headline(self) -> str:
        """The one number that matters for the job, in a short sentence."""
        return ""

    def sections(self) -> list[Section]:
        """Tables and curves of the result, as data. Every output is rendered from them."""
        return []

    @property
    def verdict(self) -> Any:
        """The worst severity of the findings: "good", "weak" or "refused"."""
        return verdict_of(self.findings)

    @property
    def usable(self) -> bool:
        """Whether a part of the result can be used: whether commands write files of it."""
        return self.verdict != "refused"

    @property
    def reason(self) -> str:
        """The headline, and the findings that make the verdict, in sentences."""
        worst = [str(one) for one in joined(self.findings) if one.severity > NOTE and verdict_of([one]) == self.verdict]
        return " ".join(filter(None, [self.headline, *worst]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings on which you should act, the worst first."""
        return tuple(str(one) for one in ordered(self.findings) if one.severity >= CAUTION)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences of the findings that ask for no action."""
        return tuple(str(one) for one in self.findings if one.severity == NOTE)

    @property
    def codes(self) -> frozenset[str]:
        """Codes of the findings."""
        return frozenset(one.code for one in self.findings)

    @property
    def numbers(self) -> dict[str, Number]:
        """Every number of the tables by name, with interval, quantity and state."""
        return numbers_of(self.sections())

    def summary(self) -> str:
        """Verdict, tables with units and intervals, and all findings, as plain text (host only).

        Examples
        --------
        >>> import jaxcal
        >>> from jaxcal.magnetometer import body_field, scenario
        >>> print(jaxcal.magnetometer.fit(body_field(scenario("all"), 50e-6), field=50e-6).summary().splitlines()[0][:12])
        MagFit: good
        """
        return "\n".join(self._lines(verbose=True))

    def _lines(self, verbose: bool) -> list[str]:
        name = f"{type(self).__name__}: {self.verdict}"
        more = "print(result.summary())"
        lines = tables(name, self.headline, self.sections(), self.findings, verbose=verbose, width=_WIDTH)
        return lines + things_to_know(self.findings, verbose=verbose, width=_WIDTH, more=more)

    def __repr__(self) -> str:
        """The verdict, the tables, and the most important findings."""
        return eqx.tree_pformat(self) if is_traced(self) else "\n".join(self._lines(verbose=False))

    def _repr_html_(self) -> str:
        """The verdict, the tables and all findings, for notebooks."""
        if is_traced(self):
            return f"<pre>{html.escape(repr(self))}</pre>"
        return answer_html(f"{type(self).__name__}: {self.verdict}", self.headline, self.sections(), self.findings)

    def to_dict(self, log: Any = None) -> dict[str, Any]:
        """Verdict, headline, findings, numbers and every field, for JSON: SI units, and None for infinite or unknown numbers.

        `save`, the commands and fleets write the same keys for the same kind of result.

        Parameters
        ----------
        log : the recording; its findings and provenance stand under "log", which is None without it.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> found = jaxcal.allan.deviation(noise, rate=100.0, m=[1, 2]).to_dict()
        >>> found["schema"], found["m"]
        ('jaxcal.Deviation/1', [1, 2])
        """
        return self._document(log, self.sections())

    def _document(self, log: Any, sections: list[Section]) -> dict[str, Any]:
        head = {
            "schema": f"jaxcal.{type(self).__name__}/1", "version": version_of("jaxcal"), "verdict": self.verdict,
            "headline": self.headline, "findings": [one.to_dict() for one in merged(self.findings)],
            "numbers": {name: one.to_dict() for name, one in numbers_of(sections).items()},
        }  # fmt: skip
        about = None if log is None else {"findings": [one.to_dict() for one in log.findings], "provenance": log.provenance}
        return plain(head) | self._fields() | {"log": plain(about)}

    def _fields(self) -> dict[str, Any]:
        """Fields of the result for JSON."""
        known: Any = self
        without = ("findings", *self._unlisted)
        names = [field.name for field in dataclasses.fields(known) if not field.name.startswith("_") and field.name not in without]
        return {name: plain(getattr(self, name)) for name in names}

    def to_dataframe(self) -> Any:
        """The numbers as a data frame of polars, or of pandas if polars is not installed.

        A fit has one row per number: name, value, low, high, unit, state. A curve has one row per point, and a column `channel` if there
        are several curves.

        Raises
        ------
        DataError
            If neither polars nor pandas is installed.

        Examples
        --------
        >>> import jaxcal
        >>> noise = jaxcal.noise.Noise(N=0.01).simulate(2000, rate=100.0, seed=1)
        >>> frame = jaxcal.allan.deviation(noise, rate=100.0, m=[1, 2]).to_dataframe()
        >>> frame["tau"].to_list()
        [0.01, 0.02]
        """
        sections = self.sections()
        curves = [one for one in sections if isinstance(one, Curve)]
        if curves and (self._curve or not numbers_of(sections)):
            columns = {name: np.concatenate([np.asarray(one.columns[name][1]) for one in curves]) for name in curves[0].columns}
            sizes = [len(next(iter(one.columns.values()))[1]) for one in curves]
            channel = {"channel": np.repeat([one.key for one in curves], sizes)} if len(curves) > 1 else {}
            return data_frame(channel | columns)
        rows = list(flat(sections))
        names = ("name", "value", "low", "high", "unit", "state")
        return data_frame({name: [row[name] for row in rows] for name in names})

    def save(self, path: str | os.PathLike[str], log: Any = None) -> None:
        """Write `to_dict` as JSON, with the recording `log` if given; an existing file is replaced in one step.

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
        write_atomically(path, json_text(self.to_dict(log)))

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
            raise DataError(f"there is no figure of a {name}; its numbers are in to_dataframe()", code="no_figure")
        function, wanted = self._figure
        if len(readings) != wanted:
            call = f"plot({'readings' if wanted else ''})"
            what = "the readings that were fitted" if wanted else "nothing else"
            raise DataError(f"a {name} is drawn by {call}, with {what}", code="figure_needs_readings")
        # load `plot` only now, because it depends on this module
        draw = getattr(importlib.import_module(f"{__name__.partition('.')[0]}.plot"), function)
        return draw(*readings, self, ax)


class Result(_Said, eqx.Module):
    """Base of all results: a subclass has the fields of its kind and `findings`, a `headline`, and lists its numbers in `sections`.

    A result prints its numbers with intervals and units; a notebook shows them as tables. It cannot be hashed, because it holds arrays.

    Attributes
    ----------
    findings : `Finding`s: what to know about the result. The worst severity is the `verdict`.
    """

    if not TYPE_CHECKING:  # a checker knows no type of the first, and takes the others for arguments of every subclass
        __getattribute__ = direct
        findings: eqx.AbstractVar[tuple[Finding, ...]]
        __hash__ = None


R = TypeVar("R")


class Results(_Said, Mapping[str, R], Generic[R]):
    """Results of several channels, by the name of the channel: a mapping that is rendered as one result.

    Parameters
    ----------
    results : channel -> result.
    left_out : findings on channels without a result.

    Examples
    --------
    >>> from jaxcal._answer import Results
    >>> try:
    ...     Results({"gyro_x": 1, "gyro_y": 2})["gyrox"]
    ... except KeyError as error:
    ...     print(error.args[0])
    no channel 'gyrox'; did you mean 'gyro_x' or 'gyro_y'?
    """

    def __init__(self, results: Mapping[str, R], left_out: Iterable[Finding] = ()):
        self._results = dict(results)
        self._left_out = tuple(left_out)

    def __getitem__(self, name: str) -> R:
        if name not in self._results:
            near = difflib.get_close_matches(str(name), list(self._results), 3, 0.4)
            raise KeyError(f"no channel {name!r}; did you mean {' or '.join(map(repr, near)) or 'one of ' + ', '.join(self._results)}?")
        return self._results[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._results)

    def __len__(self) -> int:
        return len(self._results)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings of all channels, each with its channel as subject, and on channels without a result."""
        found = [one if one.subject else one.of(name) for name, result in self.items() for one in getattr(result, "findings")]  # noqa: B009
        return (*found, *self._left_out)

    def _fields(self) -> dict[str, Any]:
        return {"channels": {name: getattr(result, "_fields")() for name, result in self.items()}}  # noqa: B009
