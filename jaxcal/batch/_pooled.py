"""`pool`: the populations of a run, from its results."""

import csv
import dataclasses
import json
import os
import pathlib
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from .._errors import DataError
from .._files import json_text, write_atomically
from .._special import NORMAL95
from ._findings import FINDINGS
from ._fleet import Entry, Fleet, overview
from ._leaves import Recording, released
from ._population import Population, population


@dataclasses.dataclass
class _Estimate:
    """Coefficients of one log, with the variances that follow from their intervals of 95 %."""

    names: tuple[str, ...]
    values: list[float]
    covariance: np.ndarray


def pool(
    fleet: Fleet, *, table: Any = None, names: str | None = None, axes: bool = False, confidence: float = 0.95, false_alarm: float = 0.05
) -> dict[str, Population]:
    """Populations of the logs of a run: the middle device, the spread between devices, and a pooled value for each log.

    For the task "noise" there is one population per channel, from the likelihoods in the results; with `axes` there is one per sensor, with
    its axes as a level within the device. For other tasks there is one population of all coefficients that have intervals. If the run has
    a folder, the function also writes `population.json` there, and adds the populations to the overview.

    Parameters
    ----------
    fleet : the result of `run`.
    table : further data about the logs: name -> column, or a CSV file with one line per log. Column "log" holds names of logs, with or
        without extension; "device" tells which logs are from the same device; all other columns are covariates, numbers or words.
    names : pattern of the names of the logs, as "unit{device}_{temperature}C": each pair of braces marks the device, a covariate, or, as
        {_}, text to ignore. Without `table` and `names` every log is from a device of its own.
    axes : whether axes are a level of one population, rather than separate populations.
    confidence, false_alarm : as for `population`.

    Returns
    -------
    dict
        Name -> `Population`.

    Raises
    ------
    DataError
        If a log is not in the table or does not fit the pattern, or there is nothing to pool; see `population`.
    ExportError
        If the folder of the run cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import numpy as np
    >>> import jaxcal
    >>> sizes = 1e-3 * np.exp(0.2 * np.random.default_rng(0).standard_normal(6))
    >>> with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
    ...     for i, size in enumerate(sizes):
    ...         y = jaxcal.noise.Noise(N=size).simulate(1000, 100.0, seed=i)
    ...         np.savez(pathlib.Path(folder, f"unit{i}_{20 + i % 3}C.npz"), gyro=y[:, None], rate=100.0)
    ...     fleet = jaxcal.batch.run(folder, executor=executor, options={"terms": ("N",)})
    ...     found = jaxcal.batch.pool(fleet, names="unit{device}_{temperature}C")
    >>> found["gyro_x"].covariates, len(found["gyro_x"].devices)
    (('temperature',), 6)
    """
    entries = fleet.done
    if not entries:
        raise DataError("no log was answered: there is nothing to pool", code="nothing")
    about = _about(entries, table, names)
    devices = about.pop("device", [entry.name for entry in entries])
    covariates, same = _covariates(about)
    parts = _noise(entries) or {"": _estimates(entries)}
    sensors = {} if not axes else {name.partition("_")[0] for name in parts if "_" in name}
    found = {}
    asked: dict[str, Any] = {"confidence": confidence, "false_alarm": false_alarm}
    for name, leaves in () if sensors else parts.items():
        here = [i for i, leaf in enumerate(leaves) if leaf is not None]
        chosen = {key: [column[i] for i in here] for key, column in covariates.items()}
        found[name or "all"] = population([leaves[i] for i in here], devices=[devices[i] for i in here], covariates=chosen, **asked)
    for sensor in sorted(sensors):
        mine = {name: leaves for name, leaves in parts.items() if name.startswith(f"{sensor}_")}
        found[sensor] = _with_axes(mine, devices, covariates, asked)
    said = [FINDINGS("same", name=name) for name in same]
    found = {name: dataclasses.replace(one, findings=(*one.findings, *said)) for name, one in found.items()}
    if fleet.out is not None:
        _write(fleet, found)
    return found


def _with_axes(parts: dict[str, list], devices: list, covariates: dict[str, list], asked: dict[str, Any]) -> Population:
    """One population for a sensor, with its axes as a level within the device and as a covariate."""
    where = [(name, i) for name, leaves in parts.items() for i, leaf in enumerate(leaves) if leaf is not None]
    axis, log = [name.partition("_")[2] for name, _ in where], [i for _, i in where]
    several = {"recording": log, "axis": axis} if len(set(devices)) < len(devices) else None
    found = population(
        [parts[name][i] for name, i in where], devices=[devices[i] for i in log], levels=several,
        covariates={name: [column[i] for i in log] for name, column in covariates.items()} | ({"axis": axis} if len(set(axis)) > 1 else {}),
        **asked,
    )  # fmt: skip
    return found if several else dataclasses.replace(found, levels=("device", "axis")[: len(found.levels)])


def _noise(entries: tuple[Entry, ...]) -> dict[str, list[Recording | None]]:
    """Channel -> the recording of each log; empty if the task was not "noise"."""
    found: dict[str, list[Recording | None]] = {}
    for i, entry in enumerate(entries):
        result = entry.document["result"]
        likelihoods = result.get("likelihoods") if isinstance(result, dict) else None
        for channel, kept in (likelihoods or {}).items():
            one = result["channels"][channel]
            value = {term: float(size) for term, size in one["coefficients"].items()}
            limits = {term: (low or 0.0, np.inf if high is None else high) for term, (low, high) in one["interval"].items()}
            seen = {term: size > 0.0 and one["presence"][term] != "not detected" for term, size in value.items()}
            found.setdefault(channel, [None] * len(entries))[i] = Recording(released(kept), value, limits, seen)
    return found


def _estimates(entries: tuple[Entry, ...]) -> list[_Estimate]:
    """The coefficients that have intervals in all logs."""
    known = [
        {name: (one.value, one.half / NORMAL95) for name, one in entry.coefficients.items() if np.isfinite(one.value) and one.half > 0}
        for entry in entries
    ]
    names = tuple(name for name in known[0] if all(name in each for each in known))
    if not names:
        raise DataError("no coefficient has an interval in all logs to pool; run the task noise, mag or imu", code="nothing")
    return [_Estimate(names, [each[name][0] for name in names], np.diag([each[name][1] ** 2 for name in names])) for each in known]


def _about(entries: tuple[Entry, ...], table: Any, names: str | None) -> dict[str, list[Any]]:
    """Column -> its value for each log."""
    found: dict[str, list[Any]] = {}
    if names is not None:
        pattern = _pattern(names)
        for entry in entries:
            match = pattern.fullmatch(entry.path.stem) or pattern.fullmatch(entry.path.name)
            if match is None:
                raise DataError(f"{entry.name} does not fit the pattern {names!r}; mend the pattern, or give a table", code="pattern")
            for key, word in match.groupdict().items():
                found.setdefault(key, []).append(word)
    if table is not None:
        columns = dict(table) if isinstance(table, Mapping) else _read(table)
        if "log" not in columns:
            raise DataError(f"the table has no column 'log'; it has {', '.join(columns) or 'none'}", code="table")
        rows = {str(name): i for i, name in enumerate(columns["log"])}
        for entry in entries:
            row = next((rows[key] for key in (str(entry.path), entry.path.name, entry.path.stem) if key in rows), None)
            if row is None:
                raise DataError(f"{entry.name} is not in the table; its column 'log' has {', '.join(list(rows)[:3])} ...", code="table")
            for key, column in columns.items():
                if key != "log":
                    found.setdefault(key, []).append(column[row])
    return found


def _pattern(names: str) -> re.Pattern[str]:
    pieces = re.split(r"\{(\w+)\}", names)
    fields = pieces[1::2]
    kept = [name for name in fields if name != "_"]
    if not kept or len(set(kept)) < len(kept) or not all(name.isidentifier() for name in kept):
        raise DataError(f"pattern {names!r}: expected fields that differ in braces, as unit{{device}}_{{temperature}}C", code="pattern")
    groups = (f"(?P<{name}>.+?)" if name != "_" else ".*?" for name in fields)
    return re.compile("".join(part for i, text in enumerate(pieces[::2]) for part in (re.escape(text), next(groups, ""))))


def _read(table: str | os.PathLike[str]) -> dict[str, list[str]]:
    path = pathlib.Path(table)
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            lines = [line for line in csv.reader(file) if line]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"the table {path} cannot be read ({error}); give a CSV file with a column 'log'", code="table") from error
    if len(lines) < 2 or any(len(line) != len(lines[0]) for line in lines):
        raise DataError(f"the table {path} needs a line of names and lines of as many fields, one for each log", code="table")
    return {name.strip(): [line[i].strip() for line in lines[1:]] for i, name in enumerate(lines[0])}


def _covariates(about: dict[str, list[Any]]) -> tuple[dict[str, list[Any]], list[str]]:
    """Columns, as numbers if all are; and the names of columns that are the same in all logs, which are left out."""
    found: dict[str, list[Any]] = {}
    same = [name for name, column in about.items() if len({str(one) for one in column}) < 2]
    for name, column in about.items():
        if name not in same:
            try:
                found[name] = [float(one) for one in column]
            except (TypeError, ValueError):
                found[name] = [str(one) for one in column]
    return found, same


def _write(fleet: Fleet, found: dict[str, Population]) -> None:
    from ..report._fleet import write_fleet

    assert fleet.out is not None
    write_atomically(fleet.out / "population.json", json_text({name: one.to_dict() for name, one in found.items()}))
    identity = json.loads((fleet.out / "manifest.json").read_text(encoding="utf-8"))["task"]
    write_fleet(overview(fleet, identity) | {"populations": found}, fleet.out / "overview.html")
