"""`ferraris`: calibrate triads from the faces of a box and turns about its axes; labels of regions from files."""

import csv
import dataclasses
import itertools
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, FATAL, Quantity
from .._errors import DataError
from .._log import Log, LogLike
from .._precision import host_float64
from .._types import Checked, PathLike
from ..evidence._rests import still_intervals
from ..fitting import Estimate
from ._findings import FINDINGS
from ._known import checked_gravity, levelled
from ._model import Imu, Triad, entries, values
from ._observability import NEAR
from ._recording import LEAST_SAMPLES, Recording, means, recording, rests_of
from ._result import POOR, UNKNOWN, ImuFit, assumed_gravity, matrix_error, quantities

_LABEL = re.compile(r"([xyz])[ _-]?(?:(p|up)|(a|down)|rot|turn)", re.IGNORECASE)
_REST = re.compile(r"(rest|still|pose|static)[ _-]?\d*", re.IGNORECASE)
_SENSORS = ("accel", "gyro")
_EXPECTED = (
    "expected x_p, x_a, y_p, y_a, z_p, z_a for an axis up or down, and x_rot, y_rot, z_rot for a turn about it; or rest for each rest"
)
_NAMES = {"label": ("label", "name", "region"), "start": ("start", "begin", "from"), "stop": ("stop", "end", "to")}

FEW = 24  # samples: a log with fewer is a table of means

#: label, first sample, and the sample after the last
Region = tuple[str, int, int]


def regions_of(regions: Any, rate: float) -> list[Region]:
    """Labelled regions in samples, from a list, a mapping or a file; see `ferraris`."""
    where = "regions"
    if isinstance(regions, str | Path):
        where = str(regions)
        try:
            regions = _read(Path(regions), rate)
        except (OSError, KeyError, TypeError, ValueError) as error:
            raise DataError(f"{where} holds no regions: {error}; expected JSON, or CSV with label,start,stop", code="region") from error
    if isinstance(regions, Mapping):
        regions = list(regions.items())
    found = []
    for region in regions if isinstance(regions, Iterable) else ():
        ends: Any
        try:
            label, *ends = region if not isinstance(region, Mapping) else (region["label"], region)
            ends = ends[0] if len(ends) == 1 else ends
            start, stop = (ends["start"], ends.get("end", ends.get("stop"))) if isinstance(ends, Mapping) else ends
            found.append((str(label), round(float(start)), round(float(stop))))
        except (TypeError, ValueError, KeyError) as error:
            raise DataError(f"{where}: {region!r} is no region; expected (label, start, stop) in samples", code="region") from error
    if not found:
        raise DataError(f"{where} holds no region; {_EXPECTED}", code="region")
    return found


def _read(path: Path, rate: float) -> Any:
    """Regions of a JSON or CSV file."""
    text = path.read_text(encoding="utf-8-sig")
    if text.lstrip().startswith(("{", "[")):
        return json.loads(text)
    rows = list(csv.DictReader(text.splitlines()))
    columns = {re.sub(r"\W.*", "", str(name).strip().lower()): str(name) for name in (rows[0] if rows else {})}
    named = {key: next((columns[word] for word in words if word in columns), "") for key, words in _NAMES.items()}
    if not named["start"] and not named["stop"]:
        # a label for each sample; rows without a label belong to no region
        labels = [str(row[named["label"]] or "").strip() for row in rows]
        edges = [0, *(i for i in range(1, len(labels)) if labels[i] != labels[i - 1]), len(labels)]
        return [(labels[i], i, j) for i, j in itertools.pairwise(edges) if j > i and labels[i]]
    factor = rate if "[s]" in named["start"] else 1.0
    return [(row[named["label"]], *(factor * float(row[named[end]]) for end in ("start", "stop"))) for row in rows]


def joined(logs: Mapping[str, Any] | Sequence[Any]) -> tuple[Log, list[Region]]:
    """One log of logs with one region each, and the regions."""
    if not logs:
        raise DataError("there is no log; expected a mapping from labels to logs, or a list of logs", code="region")
    named = logs if isinstance(logs, Mapping) else dict(enumerate(logs, 1))
    parts = list(named.values())
    first = parts[0]
    for label, log in named.items():
        apart = abs(log.rate / first.rate - 1) * min(len(log.time), len(first.time))  # of the last samples, if both began together
        if apart > 1 or any((getattr(log, x) is None) != (getattr(first, x) is None) for x in _SENSORS):
            said = f"the log {label} has another rate or other sensors than {next(iter(named))}; a session has one device at one rate"
            raise DataError(said, code="unlike")
    ends = np.cumsum([0, *(len(log.time) for log in parts)]).tolist()
    sensors: dict[str, Any] = {x: np.concatenate([getattr(log, x) for log in parts]) for x in _SENSORS if getattr(first, x) is not None}
    found = [(str(label), i, j) for label, (i, j) in zip(named, itertools.pairwise(ends), strict=True)]
    return Log(None, **sensors, rate=first.rate, provenance=first.provenance), found


def _faces(record: Recording, apart: list[Region] | None) -> list[Region]:
    """The rests in which a block lies on one of its six faces, with their labels; other rests are left out.

    `apart` are logs of one face each. A log of a few samples has the mean of a face in each.
    """
    if len(record.time) < FEW:
        ends = np.stack([np.arange(len(record.time)), np.arange(len(record.time)) + 1], axis=1)
    elif apart is not None:
        ends = np.array([region[1:] for region in apart])
    else:
        ends = still_intervals(record.sensors, record.rate).ends
    if not len(ends):
        raise DataError("The log never rests; lay the block on each of its six faces for 3 s or more", code="missing")
    reading = means(record.accel, *ends.T)
    # readings in counts have their zero elsewhere
    reading = reading - (reading.min(axis=0) + reading.max(axis=0)) / 2
    axis = np.argmax(np.abs(reading), axis=1)
    size = reading[np.arange(len(axis)), axis]
    near = np.abs(size) > NEAR * np.linalg.norm(reading, axis=1)
    found = [
        (f"{'xyz'[i]}_{'p' if up > 0 else 'a'}", int(start), int(stop))
        for i, up, (start, stop) in zip(axis[near], size[near], ends[near], strict=True)
    ]
    if missing := sorted({f"{i}_{kind}" for i in "xyz" for kind in "pa"} - {label for label, _, _ in found}):
        said = f"None of {len(ends)} rests is on the face {', '.join(missing)} (p up, a down); lay the block on its six faces for 3 s each"
        raise DataError(said, code="missing")
    return found


def rests_among(regions: list[Region]) -> list[tuple[int, int]] | None:
    """Start and stop of the regions if every label names a rest; else None."""
    return [(start, stop) for _, start, stop in regions] if all(_REST.fullmatch(label.strip()) for label, _, _ in regions) else None


#: (label, start, stop) of each region, or label -> (start, stop), or a file with them
Regions = PathLike | Sequence[tuple[str, int, int]] | Mapping[str, tuple[int, int]]


@host_float64
def ferraris(
    log: Checked[LogLike | Mapping[str, Log] | Sequence[Log]], regions: Checked[Regions] | None = None, *,
    gravity: float | int | None = None, angle: float = 2 * np.pi, raw: bool = False,
) -> ImuFit:  # fmt: skip
    r"""Calibrate accelerometer and gyroscope from a Ferraris session: a box at rest on six faces, and one turn about each axis.

    Without turns this is the six-position test of the accelerometer, and the result has no gyroscope.

    .. math:: \bar y_a = M_a f + b_a,\quad f = \pm g e_j;\qquad \bar y_g = b_g + G f;\qquad
              \int (y_g - b_g - G f)\,dt = \pm M_g e_j\,\alpha

    The equations are solved by least squares; regions with the same label are repetitions. The frame of the result is that of the box.
    The sign of a turn is taken from the gyroscope itself, so a gyroscope mounted upside down is not detected.

    The residuals of the six faces show how exactly the box lies on a face, see `six_position`. The fit assumes that the axis of a turn is
    as exact, and that each end of a turn has the same error, because only repetitions can show the error of a turn.

    Parameters
    ----------
    log : `jaxcal.Log` with accelerometer and gyroscope; or, for a session of several logs, label -> log of that region; or a list of logs
        of one face each. A log of fewer than 24 samples is a table: each sample is the mean of a face.
    regions : list of (label, start, stop) in samples, `stop` excluded; or a mapping from label to (start, stop). The labels are x_p, y_p,
        z_p for an axis up, x_a, y_a, z_a for an axis down, and x_rot, y_rot, z_rot for the turns. Or the path of a file with them: JSON as
        imucal writes it; CSV with the columns label, start and stop, in samples, or in s if the header is `start [s]`; or CSV with one
        row for each sample and a column label, empty outside of the regions. None finds the rests on six faces in the log, for the
        accelerometer alone; rests more than 25 degrees away from every face are left out.
    gravity : local gravity, m/s^2. None takes standard gravity, which may be wrong by 0.3 %, as a finding says.
    angle : angle of each turn, rad.
    raw : True if the log holds counts; the fit then estimates the scales.

    Returns
    -------
    ImuFit

    Raises
    ------
    DataError
        If a region is missing or outside the log, or if the readings contradict its label.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng = np.random.default_rng(0)
    >>> f, w, regions = [], [], []
    >>> for j, axis in enumerate("xyz"):
    ...     for kind, up, rate in (("p", j, 0.0), ("a", j, 0.0), ("rot", j, 2 * np.pi / 5)):
    ...         regions.append((f"{axis}_{kind}", 500 * len(f), 500 * len(f) + 500))
    ...         f.append(np.tile((-9.81 if kind == "a" else 9.81) * np.eye(3)[up], (500, 1)))
    ...         w.append(np.tile(rate * np.eye(3)[j], (500, 1)))
    >>> noisy = [np.concatenate(x) + 1e-3 * rng.normal(size=(4500, 3)) for x in (f, w)]
    >>> found = jaxcal.imu.ferraris(jaxcal.Log(None, accel=noisy[0], gyro=noisy[1], rate=100.0), regions, gravity=9.81)
    >>> print(found.verdict, found.gyro.matrix.diagonal().round(3))
    good [1. 1. 1.]

    References
    ----------
    F. Ferraris, U. Grimaldi and M. Parvis, Sensors and Materials 7 (1995) 311.
    """
    gravity, assumed = assumed_gravity(gravity)
    apart = None
    if isinstance(log, Mapping | list | tuple):
        labelled = isinstance(log, Mapping)
        log, apart = joined(log)
        regions = apart if labelled else regions
    record, size = recording(log), checked_gravity(gravity)
    sides, turns = _sorted(_faces(record, apart) if regions is None else regions_of(regions, record.rate), len(record.time))
    if turns and record.gyro is None:
        raise DataError("The log has no gyroscope, which the turns are for; leave out their regions.", code="no_gyro")
    up = np.array([sign * np.eye(3)[axis] for axis, sign, _, _ in sides])
    start, stop = (np.array([side[i] for side in sides]) for i in (2, 3))
    readings, force = means(record.accel, start, stop), size * up
    low, high = readings.min(axis=0), readings.max(axis=0)
    middle, reach = ((low + high) / 2, (high - low) / 2) if raw else (np.zeros(3), np.full(3, size))
    for (axis, sign, i, j), reading in zip(sides, readings, strict=True):
        if not sign * (reading - middle)[axis] > 0.5 * reach[axis]:
            side = "up" if sign > 0 else "down"
            said = f"Samples {i} to {j} are labelled {'xyz'[axis]} {side}, but read {reading.round(2).tolist()}. Check label and unit."
            raise DataError(said, code="label")
    rests = rests_of(record, start, stop) if np.all(stop - start >= LEAST_SAMPLES) else None
    # one rest is too short to show its noise well
    noise = None if rests is None else np.average(rests.accel_scatter, axis=0, weights=rests.duration) * np.ones((len(up), 1, 1))
    accel = levelled(readings, force, noise, assumed, exact=bool(turns))
    tilt, known = accel.level, accel.estimate.renamed("accel.{}".format)
    found = ImuFit(
        record.rate, size, record.temperature, "box", "ferraris" if turns else "six_position", accel.findings,
        accel=accel.triad, estimate=Estimate(known.names, known.values, known.matrix, known.freedom, None, quantities(raw)),
        sigma=np.array([np.mean(accel.sigma / np.diag(np.abs(accel.triad.matrix))), np.nan, np.nan]),
        residual_norm=size - np.linalg.norm(accel.triad.correct(readings), axis=1),
    )  # fmt: skip
    if not turns or rests is None:
        return _judged(found, tilt)
    columns = np.concatenate([np.ones((len(up), 1)), force], axis=1)
    beta = np.linalg.lstsq(columns, rests.gyro)[0]
    left = rests.gyro - columns @ beta
    freedom = 3 * (len(up) - 4)
    still = np.linalg.inv(columns.T @ columns) * np.sum(left**2) / freedom
    corrected = np.asarray(accel.triad.correct(np.nan_to_num(np.asarray(record.bridged)[:, 3:])))
    sums, seen = _turned(record, corrected, turns, beta, angle, raw)
    matrix = np.stack([np.mean(sums[seen == axis], axis=0) for axis in range(3)], axis=1) / angle
    error = sums - angle * matrix.T[seen]
    gyro = Triad(matrix, beta[0], beta[1:].T)
    variance = _turn_variance(record, corrected, turns, still, rests, tilt, matrix, angle, seen)
    names = entries(Imu(None, gyro))[0]
    # the matrix is hardly correlated with bias and g-sensitivity, whose errors are equal for the three axes: (axis, column of `still`)
    covariance = scipy.linalg.block_diag(accel.estimate.matrix, np.diag(variance.ravel()), np.zeros((12, 12)))
    place = {name: i for i, name in enumerate((*known.names, *names))}
    for axis in range(3):
        rows = [place[f"gyro.bias[{axis}]"], *(place[f"gyro.g_sensitivity[{axis},{i}]"] for i in range(3))]
        covariance[np.ix_(rows, rows)] = still
    values_ = np.concatenate([known.values, values(Imu(None, gyro))])
    degrees = np.concatenate([known.freedom, np.full(len(names), float(freedom))])
    result = dataclasses.replace(
        found, gyro=gyro, estimate=Estimate(tuple(place), values_, covariance, degrees, None, quantities(raw)),
        residual_turn=np.linalg.norm(error, axis=1), residual_rest=left @ np.linalg.inv(matrix).T,
        sigma=np.array([found.sigma[0], np.sqrt(2) * tilt, np.sqrt(np.sum(left**2) / freedom)]),
    )  # fmt: skip
    return _judged(result, tilt)


def _sorted(regions: list[Region], samples: int) -> tuple[list[Any], list[Any]]:
    """Split the regions into faces (axis, sign, start, stop) and turns, which have the sign zero."""
    found = []
    for label, start, stop in regions:
        match = _LABEL.fullmatch(label.strip())
        if match is None:
            raise DataError(f"The label {label!r} says nothing of an axis; {_EXPECTED}", code="label")
        if not 0 <= start < stop <= samples:
            raise DataError(f"The region {label} goes from sample {start} to {stop}; the log has the samples 0 to {samples}", code="region")
        if stop - start < LEAST_SAMPLES and samples >= FEW:
            raise DataError(f"The region {label} has {stop - start} samples; expected a second or more", code="region")
        found.append(("xyz".index(match[1].lower()), bool(match[2]) - bool(match[3]), start, stop))
    there = {region[:2] for region in found}
    kinds = ((1, "p"), (-1, "a"), (0, "rot")) if any(sign == 0 for _, sign in there) else ((1, "p"), (-1, "a"))
    missing = [f"{'xyz'[axis]}_{word}" for axis in range(3) for sign, word in kinds if (axis, sign) not in there]
    if missing:
        raise DataError(f"The session lacks {', '.join(missing)}; it takes six faces and, for the gyroscope, three turns", code="missing")
    return [region for region in found if region[1]], [region for region in found if not region[1]]


def _turned(
    record: Recording, force: np.ndarray, turns: list[Any], beta: np.ndarray, angle: float, raw: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Integrals (n, 3) of the readings minus their value at rest, with the sign that is positive about the axis of the turn; the axes."""
    sums = []
    for axis, _, i, j in turns:
        rate = np.asarray(record.bridged)[i:j, :3] - beta[0] - force[i:j] @ beta[1:]
        if not np.isfinite(rate).all():
            said = f"The turn about {'xyz'[axis]} (samples {i} to {j}) lacks more samples than can be interpolated; record it again"
            raise DataError(said)
        total = rate.sum(axis=0) / record.rate
        if np.argmax(np.abs(total)) != axis or not (raw or 0.7 < abs(total[axis]) / angle < 1.4):
            said = f"Samples {i} to {j} are labelled a turn about {'xyz'[axis]} by {np.rad2deg(angle):.4g} degrees, but the gyroscope "
            said += f"turned by {np.rad2deg(total).round(1).tolist()} degrees about x, y, z. Check label and unit."
            raise DataError(said, code="label")
        sums.append(np.sign(total[axis]) * total)
    return np.array(sums), np.array([turn[0] for turn in turns])


def _turn_variance(
    record: Recording, force: np.ndarray, turns: list[Any], still: np.ndarray, rests: Any, tilt: float, matrix: np.ndarray, angle: float,
    seen: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """(3, 3) variance of the entries of the gyroscope's matrix."""
    density = np.median(rests.gyro_scatter * rests.duration[:, None], axis=0)
    size = np.abs(np.diag(matrix))
    variance = np.zeros((3, 3))
    for axis, _, i, j in turns:
        weight = np.concatenate([[j - i], force[i:j].sum(axis=0)]) / record.rate
        placed = (tilt * size) ** 2
        placed[axis] = 2 * (tilt * size[axis] / angle) ** 2
        variance[:, axis] += (weight @ still @ weight + density * (j - i) / record.rate) / angle**2 + placed
    return variance / np.bincount(seen, minlength=3) ** 2


def _judged(result: ImuFit, tilt: float) -> ImuFit:
    """Add the findings to the result."""
    worst = max(matrix_error(result.estimate, sensor) for sensor in _SENSORS if getattr(result, sensor) is not None)
    found = []
    if worst > POOR:
        severity = FATAL if worst > UNKNOWN else CAUTION
        found.append(FINDINGS("box", severity=severity, tilt=Quantity(tilt, "angle")))
    if len(result.residual_turn) == 3:
        found.append(FINDINGS("turned_once", "gyro"))
    return dataclasses.replace(result, findings=(*result.findings, *found))
