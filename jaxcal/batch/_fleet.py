"""`Fleet`: the results of a run for each log, the spread over all logs, outliers, and trends."""

import dataclasses
import datetime
import functools
import json
import pathlib
import re
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Number
from .._files import shown
from .._special import NORMAL95
from ..noise._sections import bound_of
from ._findings import FEWEST

_FALSE_ALARM = 0.05  # probability that a fleet of Gaussian coefficients has any outlier, or any trend
_FILTER = ".filter_"  # in the names of what a filter takes, which repeat the coefficient of the worst axis
#: coefficients that are sizes, whose scatter is relative
_SIZES = re.compile(r"\.(?:[QNBKR]|[a-z0-9]+dev\([^)]*\))$")


@dataclasses.dataclass(frozen=True)
class Entry:
    """One log of a run.

    Attributes
    ----------
    path : path of the log.
    status : "done" or "failed".
    reason : for a failure, a sentence; otherwise None.
    again : whether the reason may be gone the next time.
    coefficients : name -> value, low and high limit (NaN if there is none), unit and state of the number. A limit has no value.
    findings : what to know about the log and its result, each with "code", "severity", "subject" and "text".
    sha256 : hash of the log; None if it could not be read.
    date : date of the recording (ISO 8601), from its stamps or from the time of its file; None if it could not be read.
    seconds : computing time in s; None if the result was not computed in this run.
    kept : whether the result comes from an earlier run.
    file : result file; None without a folder.
    topics : for a log with several IMUs, the topics of the IMU that this entry is about; "" for the first or only one.
    typed : the reason with options spelt for the command line; None if it names none.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import pathlib, tempfile
    >>> rng = np.random.default_rng(0)
    >>> with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as pool:
    ...     for i in range(3):
    ...         np.savez(pathlib.Path(folder, f"unit{i}.npz"), gyro=1e-3 * rng.standard_normal((500, 1)), rate=100.0)
    ...     fleet = jaxcal.batch.run(folder, "allan", executor=pool, options={"m": [1, 10]})
    >>> fleet.done[0].path.name, round(fleet.done[0].coefficients["gyro_x.oadev(0.1 s)"].value * 1e3, 1)
    ('unit0.npz', 0.3)
    """

    path: pathlib.Path
    status: str
    reason: str | None
    again: bool
    coefficients: dict[str, Number]
    findings: tuple[dict[str, Any], ...]
    sha256: str | None
    date: str | None
    seconds: float | None
    file: pathlib.Path | None
    kept: bool = False
    topics: str = ""
    typed: str | None = None
    _text: str | None = dataclasses.field(default=None, repr=False)

    @property
    def name(self) -> str:
        """Name of the log as printable text, with the IMU unless it is the first."""
        return shown(self.path) + (f" {self.topics}" if self.topics else "")

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences of the findings on which you should act."""
        return tuple(one["text"] for one in self.findings if one["severity"] != "note")

    @property
    def document(self) -> dict[str, Any]:
        """The whole result as in its file; `result` holds the results of the task."""
        return json.loads((self._text or "") if self.file is None else self.file.read_text(encoding="utf-8"))


@dataclasses.dataclass(frozen=True)
class Outlier:
    """A log that stands out: name, path, value, distance from the median in robust standard deviations, and a sentence.

    Examples
    --------
    >>> from jaxcal.batch._fleet import Outlier
    >>> Outlier("unit7", "unit7.csv", 0.02, 6.1, "unit7: gyro_x.N is twice the median").reason
    'unit7: gyro_x.N is twice the median'
    """

    name: str
    path: str
    value: float
    score: float
    reason: str


@dataclasses.dataclass(frozen=True)
class Trend:
    """A trend of a coefficient along "serial number", "place in the list" or "date": slope per step or day, Kendall's tau, p value.

    `at` is the position of each log along the trend, in the order of `Spread.values`.

    Examples
    --------
    >>> from jaxcal.batch._fleet import Trend
    >>> Trend("serial number", (1.0, 2.0, 3.0), 1e-4, 0.8, 0.002, "gyro_x.N grows with the serial number").along
    'serial number'
    """

    along: str
    at: tuple[float, ...]
    slope: float
    tau: float
    p: float
    reason: str


@dataclasses.dataclass(frozen=True)
class Spread:
    """The spread of one coefficient over the fleet.

    Attributes
    ----------
    unit : unit of the coefficient.
    count : number of logs that have it.
    median, sigma : median and robust standard deviation (1.4826 times the median absolute deviation).
    low, high : limits that contain 90 % of the logs.
    own : median of the standard errors of the single logs; NaN if they have none. If sigma is not larger than this, it is the scatter of
        the estimates, not of the sensors.
    values : value of each log, NaN if it has none, in the order of the run.
    scores : distance of each value from the median in robust standard deviations.
    limit : score above which a log is an outlier; infinite for fewer than 5 logs.
    outliers, trends : logs that stand out, and trends.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import pathlib, tempfile
    >>> rng = np.random.default_rng(0)
    >>> with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as pool:
    ...     for i in range(3):
    ...         np.savez(pathlib.Path(folder, f"unit{i}.npz"), gyro=1e-3 * rng.standard_normal((500, 1)), rate=100.0)
    ...     fleet = jaxcal.batch.run(folder, "allan", executor=pool, options={"m": [1, 10]})
    >>> one = fleet.spread["gyro_x.oadev(0.1 s)"]
    >>> one.count, one.unit, one.outliers
    (3, 'rad/s', ())
    """

    unit: str
    count: int
    median: float
    sigma: float
    low: float
    high: float
    own: float
    values: tuple[float, ...]
    scores: tuple[float, ...]
    limit: float
    outliers: tuple[Outlier, ...]
    trends: tuple[Trend, ...]


@dataclasses.dataclass(frozen=True)
class Fleet:
    """The logs of a run with their results, in natural order of their names.

    Attributes
    ----------
    entries : one `Entry` for each log.
    out : folder of the results, or None.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from concurrent.futures import ThreadPoolExecutor
    >>> import pathlib, tempfile
    >>> rng = np.random.default_rng(0)
    >>> with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(1) as pool:
    ...     for i in range(3):
    ...         np.savez(pathlib.Path(folder, f"unit{i}.npz"), gyro=1e-3 * rng.standard_normal((500, 1)), rate=100.0)
    ...     fleet = jaxcal.batch.run(folder, "allan", executor=pool, options={"m": [1, 10]})
    >>> len(fleet), len(fleet.done), sorted(fleet.spread)[0]
    (3, 3, 'gyro_x.floor')
    """

    entries: tuple[Entry, ...]
    out: pathlib.Path | None = None

    def __len__(self) -> int:
        return len(self.entries)

    def __iter__(self) -> Iterator[Entry]:
        return iter(self.entries)

    @property
    def done(self) -> tuple[Entry, ...]:
        """The logs with a result."""
        return tuple(entry for entry in self.entries if entry.status == "done")

    @property
    def failed(self) -> tuple[Entry, ...]:
        """The logs without a result, each with its reason."""
        return tuple(entry for entry in self.entries if entry.status == "failed")

    @functools.cached_property
    def spread(self) -> dict[str, Spread]:
        """Name of a coefficient -> its spread over the logs with a result.

        The score of a log is its distance from the median, divided by the root of the sum of squares of the fleet's robust standard
        deviation and the log's own standard error. A log is an outlier if the largest score of a Gaussian fleet would exceed its score in
        less than 5 % of fleets. Noise coefficients and deviations are compared by their logarithms.
        """
        done = self.done
        names = list(dict.fromkeys(name for entry in done for name in entry.coefficients if _FILTER not in name))
        compared = len(
            {name for name in names for entry in done if name in entry.coefficients and np.isfinite(entry.coefficients[name].value)}
        )
        along = _along(done)
        return {name: _one(name, done, compared, along) for name in names}

    @property
    def for_filters(self) -> list[tuple[str, str, int, float, float]]:
        """The noise that a filter for any of these devices needs, in SI: name, unit, number of logs, and their median and 95 % quantile.

        Each log counts with its worst axis; where a term is not present, with its upper limit.
        """
        found = []
        for name in dict.fromkeys(name for entry in self.done for name in entry.coefficients if _FILTER in name):
            rows = [entry.coefficients[name] for entry in self.done if name in entry.coefficients]
            median, high = np.quantile([bound_of(one) for one in rows], [0.5, 0.95])
            found.append((name.replace(_FILTER, " "), rows[0].unit, len(rows), float(median), float(high)))
        return found


def _one(name: str, done: Sequence[Entry], number: int, along: dict[str, np.ndarray]) -> Spread:
    rows = [entry.coefficients.get(name) for entry in done]
    values = np.array([np.nan if row is None else row.value for row in rows])
    errors = np.array([np.nan if row is None else row.half / NORMAL95 for row in rows])
    unit = next((row.unit for row in rows if row is not None), "")
    here = np.isfinite(values)
    n = int(here.sum())
    if not n:
        nothing = (np.nan,) * len(values)
        return Spread(unit, 0, np.nan, np.nan, np.nan, np.nan, np.nan, nothing, nothing, np.inf, (), ())
    by_factors = bool(_SIZES.search(name)) and bool(np.all(values[here] > 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        x = np.log(values) if by_factors else values
        own = errors / np.abs(values) if by_factors else errors
    middle = float(np.median(x[here]))
    apart = np.abs(x[here] - middle)
    # the second if more than half of the values are equal
    sigma = 1.4826 * float(np.median(apart)) or float(np.sqrt(np.mean(apart**2)))
    total = np.sqrt(sigma**2 + np.where(np.isfinite(own), own, 0.0) ** 2)
    with np.errstate(invalid="ignore", divide="ignore"):
        scores = np.where(np.abs(x - middle) > 0, (x - middle) / total, np.where(here, 0.0, np.nan))
    # Student's t with half the degrees of freedom, because the median absolute deviation of few values is itself uncertain: for simulated
    # Gaussian fleets of 5 to 300 logs the probability of a false alarm is 4 to 6 %
    limit = np.inf if n < FEWEST else float(scipy.special.stdtrit((n - 1) / 2, 1 - _FALSE_ALARM / (2 * n * number)))
    median = float(np.median(values[here]))
    low, high = (float(end) for end in np.quantile(values[here], [0.05, 0.95]))
    found = []
    for i in np.flatnonzero(here & (np.abs(scores) > limit)).tolist():
        side = "above" if scores[i] > 0 else "below"
        reason = (
            f"{name} = {values[i]:.4g}{' ' * bool(unit)}{unit}, {abs(scores[i]):.1f} robust standard deviations {side} the "
            f"median {median:.4g} of {n} logs (limit {limit:.1f})"
        )
        found.append(Outlier(done[i].name, str(done[i].path), float(values[i]), float(scores[i]), reason))
    trends = [trend for what, at in along.items() if (trend := _trend(name, what, at, values, unit, number * len(along)))]
    known = own[np.isfinite(own)] * (median if by_factors else 1.0)
    return Spread(
        unit=unit, count=n, median=median, sigma=sigma * (median if by_factors else 1.0), low=low, high=high,
        own=float(np.median(known)) if known.size else np.nan, values=tuple(values.tolist()), scores=tuple(scores.tolist()),
        limit=limit, outliers=tuple(found), trends=tuple(trends),
    )  # fmt: skip


def _trend(name: str, along: str, places: np.ndarray, all_values: np.ndarray, unit: str, number: int) -> Trend | None:
    here = np.isfinite(all_values)
    at, values = places[here], all_values[here]
    if len(values) < FEWEST or np.ptp(at) == 0 or np.ptp(values) == 0:
        return None
    tau, p = (float(value) for value in np.asarray(scipy.stats.kendalltau(at, values)))
    if not p * number < _FALSE_ALARM:
        return None
    slope = float(np.asarray(scipy.stats.theilslopes(values, at))[0])
    what = "day" if along == "date" else "step"
    reason = (
        f"{name} {'rises' if slope > 0 else 'falls'} with the {along}: {abs(slope):.3g}{' ' * bool(unit)}{unit} per {what}, "
        f"{abs(slope) * float(np.ptp(at)):.3g} over the fleet (Kendall's tau {tau:.2f}, p = {p:.1g})"
    )
    return Trend(along, tuple(places.tolist()), slope, tau, p, reason)


def _along(done: Sequence[Entry]) -> dict[str, np.ndarray]:
    """The quantities along which a trend is tested: serial numbers, or places in the list, and dates."""
    found = {}
    numbers = [re.findall(r"\d+", entry.path.stem) for entry in done]
    serial = [int(each[-1]) for each in numbers if each and len(each[-1]) < 16]
    if len(serial) == len(done) and len(set(serial)) == len(serial):
        found["serial number"] = np.array(serial, dtype=float)
    else:
        found["place in the list"] = np.arange(len(done), dtype=float)
    days = np.array([np.nan if entry.date is None else datetime.datetime.fromisoformat(entry.date).timestamp() / 86400 for entry in done])
    # logs with dates within one minute were written by one program, so their dates tell nothing
    if len(days) and np.all(np.isfinite(days)) and np.ptp(days) > 1 / 1440:
        found["date"] = days - days.min()
    return found


def _curves(done: Sequence[Entry]) -> dict[str, dict[int, tuple[list[float], list[float]]]]:
    """Channel -> number of the log -> cluster times and deviations, of results that have them."""
    found: dict[str, dict[int, tuple[list[float], list[float]]]] = {}
    for number, entry in enumerate(done):
        result = entry.document["result"]
        channels = result.get("channels", result) if isinstance(result, dict) else {}
        for channel, one in channels.items():
            curve = one.get("deviation", one) if isinstance(one, dict) else None
            if isinstance(curve, dict) and "tau" in curve:
                found.setdefault(channel, {})[number] = curve["tau"], curve["deviation"]
    return found


def _address(file: pathlib.Path | None) -> str | None:
    """Where the page of a log is, or without one its result file, seen from the overview."""
    best = None if file is None else page if (page := file.with_suffix(".html")).exists() else file
    return best and f"{best.parent.name}/{best.name}"


def overview(fleet: Fleet, identity: dict[str, Any]) -> dict[str, Any]:
    """The data of the overview page."""
    said: dict[str, dict[str, str]] = {}  # code, or the sentence of a task of one's own -> log -> sentence
    for entry in fleet.done:
        for one in (finding for finding in entry.findings if finding["severity"] != "note"):
            said.setdefault(one["text"] if one["code"] == "said" else one["code"], {}).setdefault(entry.name, one["text"])
    return {
        "task": identity, "logs": len(fleet), "names": [entry.name for entry in fleet.done],
        "dates": [entry.date for entry in fleet.done], "failed": [(entry.name, entry.typed or entry.reason) for entry in fleet.failed],
        "files": [_address(entry.file) for entry in fleet.done], "curves": _curves(fleet.done), "filters": fleet.for_filters,
        "warnings": [(next(iter(logs.values())), list(logs)) for logs in sorted(said.values(), key=len, reverse=True)],
        "spread": {name: dataclasses.asdict(one) for name, one in fleet.spread.items()},
    }  # fmt: skip
