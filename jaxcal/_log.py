"""`Log`: one recording in SI units on a uniform time grid."""

import copy
import html
import importlib
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeAlias

import equinox as eqx
import numpy as np

from ._answer import NOTE, Finding
from ._errors import DataError
from ._own_time import at_nearest, common_length, equal_rows, on_grid, own_stamps, placed_alone, stamps_of
from ._precision import real_numbers
from ._quality import checked_rate, mark_missing, shown_unit
from ._timebase import counted, place, span
from ._types import AnyArray, Checked, Frame, PathLike, Samples
from ._units import si_unit
from .evidence._find import find, set_aside
from .evidence._findings import said_of, seen_in
from .evidence._gaps import Gap, gaps_of
from .evidence._stretch import Stretch
from .evidence._values import masked, of_values, unwrapped

#: a recording, or what `jaxcal.read` takes: a path, a data frame, a dataset, arrays by name
LogLike: TypeAlias = Checked["Log | PathLike | Mapping[Any, Any] | Frame"]

#: sensor field -> channel name suffixes
_AXES = {"gyro": ("_x", "_y", "_z"), "accel": ("_x", "_y", "_z"), "mag": ("_x", "_y", "_z"), "temperature": ("",)}
_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer", "temperature": "temperature"}


class Log(eqx.Module):
    """One recording in SI units on a uniform time grid; missing samples are rows of NaN.

    The stamps are sorted, and their steps compared with the sampling period. Samples that repeat both a stamp and its values are dropped,
    a wrapped counter is unwrapped, and stamps in bursts or of low resolution are spaced evenly. A step longer than 1.5 periods that later
    steps do not make up becomes a gap of NaN rows. The rate is the number of steps divided by their length, without gaps. Infinite values,
    and a frozen sensor (50 repeats or more), become NaN. `findings` reports each repair.

    Parameters
    ----------
    time : (n,) stamps in s (or datetime64), or None if `rate` is given. Only differences matter.
    gyro : (n, 3) angular rate, rad/s. Like `accel` and `mag` it may also be (n,) or have fewer columns: x, then y.
    accel, mag : (n, 3) specific force, m/s^2, and magnetic field, T.
    temperature : (n,) degC.
    rate : Hz. With stamps, it is checked against them (0.5 %) and kept; without stamps, it defines the grid.
    own_time : sensor -> (m,) stamps in s of a sensor that has stamps of its own, by the same clock as `time`. The readings of this sensor
        are (m, 3). Each reading goes to the nearest sample of the grid, and `offset` keeps the difference to its own time.
    findings : what the reader of the recording found; it comes before what is found here.
    provenance : origin of the recording. `epoch_ns`, the stamp of the first sample, is filled in.

    Attributes
    ----------
    time : (n,) s from the first sample.
    gyro, accel, mag, temperature : as given, on the grid; None if not recorded.
    rate : Hz.
    offset : sensor -> (n,) s. `time` plus `offset` is when the sensor took each reading; NaN where there is no reading. Only for sensors
        that have stamps of their own.
    gaps : tuple of `Gap`: stretches in which a sensor is missing.
    findings : tuple of `Finding`: how the recording was read, what was repaired, and what makes results from it doubtful.
    notes, warnings : the findings as sentences: those for information only (quantisation steps, warm-up, gaps), and the others.
    provenance : dict.

    Raises
    ------
    DataError
        If there are fewer than 2 samples, a channel contains only NaN, the stamps do not belong to a regular recording, `rate`
        contradicts them, or more samples are missing than a log can hold (a gap of years).

    Examples
    --------
    A recording with a gap of two samples:

    >>> import numpy as np
    >>> import jaxcal
    >>> log = jaxcal.Log([0.0, 0.1, 0.2, 0.5, 0.6], temperature=[20.0, 20.1, 20.2, 20.5, 20.6])
    >>> log.rate, len(log.time), log.gaps[0].samples
    (10.0, 7, 2)
    >>> list(log.channels())
    ['temperature']

    A magnetometer with stamps of its own:

    >>> stamps = np.array([0.03, 0.13, 0.23])
    >>> log = jaxcal.Log(np.arange(30) / 100, gyro=np.zeros((30, 3)), mag=np.eye(3) * 5e-5, own_time={"mag": stamps + 0.002})
    >>> np.flatnonzero(np.isfinite(log.mag[:, 0])).tolist(), log.offset["mag"][[3, 13, 23]].round(6).tolist()
    ([3, 13, 23], [0.002, 0.002, 0.002])
    """

    time: AnyArray
    gyro: AnyArray | None
    accel: AnyArray | None
    mag: AnyArray | None
    temperature: AnyArray | None
    rate: float
    offset: dict[str, AnyArray]
    gaps: tuple[Gap, ...]
    findings: tuple[Finding, ...]
    provenance: dict[str, Any]

    def __init__(
        self, time: Samples | None, gyro: Samples | None = None, accel: Samples | None = None, mag: Samples | None = None,
        temperature: Samples | None = None, rate: float | int | None = None, *, own_time: Mapping[str, Any] | None = None,
        findings: Iterable[Finding] = (), provenance: Mapping[str, Any] | None = None,
    ):  # fmt: skip
        found, provenance = list(findings), dict(provenance or {})
        given = {"gyro": gyro, "accel": accel, "mag": mag, "temperature": temperature}
        sensors = {name: _columns(name, values) for name, values in given.items() if values is not None}
        stamps, epoch = stamps_of(time)
        own = own_stamps(own_time or {}, sensors, epoch)
        size = common_length(stamps, {name: values for name, values in sensors.items() if name not in own})
        rate = None if rate is None else checked_rate(rate)
        for name, values in sensors.items():
            sensors[name] = mark_missing(name, _channel_names(name, values), values, found)

        apart = {name: sensors.pop(name) for name in own}
        placed = {name: placed_alone(name, own[name], apart[name]) for name in own}
        grid = counted(size, rate) if stamps is None else place(stamps, rate, equal_rows(sensors))
        sensors = {name: on_grid(values, grid) for name, values in sensors.items()}
        rate, size = grid.rate, grid.size
        epoch += round(grid.start * 1e9)
        found += grid.findings
        offset = {}
        for name, own_grid in placed.items():
            found += [one.of(name) for one in own_grid.findings if one.severity > NOTE]
            sensors[name], offset[name] = at_nearest(name, apart[name], own_grid, grid, found)

        undone: list[Stretch] = []
        stopped: list[Stretch] = []
        known: dict[str, list[Stretch]] = {}
        for name, values in sensors.items():
            unit = shown_unit(name, values)
            values, wrapped = unwrapped(name, values, rate, unit)
            undone += wrapped
            seen = wrapped + (own := of_values(name, values, rate, unit))
            found += seen_in(name, _channel_names(name, values), values, rate, unit, seen)
            if unit == si_unit(name) and not any(one.kind == "stuck" for one in seen):  # the readings stay, and what is said of them
                known[name] = own
            for stuck in (one for one in seen if one.kind == "stuck" and len(one.axes) == values.shape[1]):
                values = np.where(masked(stuck, values, rate), np.nan, values)
            stopped += [one for one in seen if one.kind == "stuck" and len(one.axes) < values.shape[1]]
            sensors[name] = values
        self.gaps = gaps_of(sensors, offset, rate, found)
        for one in stopped:  # no gap: the other axes go on
            sensors[one.sensor] = np.where(masked(one, sensors[one.sensor], rate), np.nan, sensors[one.sensor])
        self.time = np.arange(size) / rate
        self.gyro, self.accel, self.mag, self.temperature = _fields(sensors).values()
        self.rate = rate
        self.offset = offset
        self.findings = tuple(found)
        self.provenance = provenance | {"epoch_ns": int(provenance.get("epoch_ns", 0)) + epoch}
        vars(self).update(_undone=(*undone, *stopped), _seen=known)  # what can no longer be seen in the readings, and what is seen

    @property
    def duration(self) -> float:
        """Length of the recording, s: samples / rate."""
        return len(self.time) / self.rate

    def channels(self) -> dict[str, np.ndarray]:
        """Every channel as a dictionary name -> (n,) array: gyro_x .. mag_z, temperature (SI units)."""
        found = {}
        for name, values in self._sensors().items():
            found |= dict(zip(_channel_names(name, values), values.T, strict=True))
        return found

    def select(self, start: float | int | None = None, stop: float | int | None = None) -> "Log":
        """Part of the recording between two times.

        Parameters
        ----------
        start, stop : s from the start of the recording; None means its start and its end. Negative times count from the end.

        Returns
        -------
        Log
            With its own time from 0 and its own gaps. `findings` are those of the whole recording, and
            `provenance["selected"]` gives the selected part in s.

        Raises
        ------
        DataError
            If fewer than 2 samples lie between `start` and `stop`, or a channel has no value there.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> log = jaxcal.Log(None, gyro=np.random.default_rng(0).normal(size=(1000, 3)), rate=100.0)
        >>> log.select(2.0, 5.0).duration
        3.0
        """
        bounds = [0.0 if start is None else float(start), self.duration if stop is None else float(stop)]
        bounds = [bound + self.duration if bound < 0 else bound for bound in bounds]
        # a bound at a sample means that sample, in spite of rounding errors of its time
        first, last = (int(np.clip(np.ceil(bound * self.rate - 1e-6), 0, len(self.time))) for bound in bounds)
        if last - first < 2:
            held = f"there are {max(last - first, 0)} samples; the recording is {self.duration:.6g} s long at {self.rate:.6g} Hz"
            raise DataError(f"from {bounds[0]:g} s to {bounds[1]:g} s {held}. Choose another start and stop", code="empty_part")
        sensors = {name: values[first:last] for name, values in self._sensors().items()}
        for name, values in sensors.items():
            mark_missing(name, _channel_names(name, values), values, [])
        offset = self.provenance.get("selected", (0.0, 0.0))[0]
        provenance = self.provenance | {
            "selected": (offset + first / self.rate, offset + last / self.rate),
            "epoch_ns": self.provenance["epoch_ns"] + round(first / self.rate * 1e9),
        }
        later = {name: values[first:last] for name, values in self.offset.items()}
        time, gaps = self.time[: last - first], gaps_of(sensors, later, self.rate, [])
        return self._replaced(time=time, offset=later, gaps=gaps, provenance=provenance, **_fields(sensors))

    if not TYPE_CHECKING:
        __hash__ = None

    @property
    def notes(self) -> tuple[str, ...]:
        """The findings for information only, as sentences."""
        return tuple(str(one) for one in self.findings if one.severity == NOTE)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The findings that make results from these data doubtful, as sentences."""
        return tuple(str(one) for one in self.findings if one.severity > NOTE)

    @property
    def codes(self) -> tuple[str, ...]:
        """The codes of the findings, each once."""
        return tuple(dict.fromkeys(one.code for one in self.findings))

    @property
    def evidence(self) -> tuple[Stretch, ...]:
        """What in the recording is not the sensor under test, in the order of time; see `jaxcal.evidence`. Found at first use.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> gyro = np.random.default_rng(0).normal(size=(20_000, 3)) * 1e-3
        >>> gyro[5_000:5_100] += 0.05 * np.sin(np.linspace(0, np.pi, 100))[:, None]
        >>> [(one.kind, one.sensor, round(one.start)) for one in jaxcal.Log(None, gyro=gyro, rate=100.0).evidence]
        [('knock', 'gyro', 50)]
        """
        if (known := vars(self).get("_evidence")) is None:
            raw, keep = vars(self).get("_raw", (None, ()))
            seen = vars(self).get("_seen")
            known = (*vars(self).get("_undone", ()), *find(self._sensors(), self.rate, self.gaps, seen)) if raw is None else raw.evidence
            known = tuple(one for one in known if one.kind not in keep)
            object.__setattr__(self, "_evidence", known)
        return known

    @property
    def recorded(self) -> "Log":
        """The log as it was before `cleaned`."""
        return vars(self).get("_raw", (self, ()))[0]

    def usable(self, sensor: str, still: bool = False, keep: Iterable[str] = ()) -> np.ndarray:
        """Readings of a sensor, with NaN where they are no measurement.

        Parameters
        ----------
        sensor : "gyro", "accel", "mag" or "temperature".
        still : whether the sensor should be at rest: knocks, movement and steps are set aside too.
        keep : kinds of `Stretch` that stay, such as ("knock", "clipped").

        Returns
        -------
        (n, axes) or (n,) array

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> mag = np.repeat(np.random.default_rng(0).normal(size=(50, 3)), 4, axis=0) * 1e-5
        >>> int(np.isfinite(jaxcal.Log(None, mag=mag, rate=40.0).usable("mag")).all(axis=1).sum())
        50
        """
        values = self._sensors()[sensor]
        known = still or "_evidence" in vars(self.recorded)  # events take longest, and are not looked for without need
        found = self.evidence if known else of_values(sensor, values, self.rate, si_unit(sensor))
        out = set_aside(sensor, values, self.rate, found, still, (*keep, *vars(self).get("_raw", (None, ()))[1]))
        return out[:, 0] if sensor == "temperature" else out

    def cleaned(self, still: bool = False, keep: Iterable[str] = (), left: Iterable[str] = ()) -> "Log":
        """The log with the readings of `usable` for all sensors, and a finding that says what was set aside.

        Kinds to `keep` are no evidence any more, for any estimator. Those `left` stay in the readings too, and each estimator judges them.

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> gyro = np.random.default_rng(0).normal(size=(20_000, 3)) * 1e-3
        >>> gyro[5_000:5_100] += 0.05 * np.sin(np.linspace(0, np.pi, 100))[:, None]
        >>> print(jaxcal.Log(None, gyro=gyro, rate=100.0).cleaned(still=True).head())
        gyroscope, 100 Hz, 3 min 20 s (0.51 % set aside: something moved at 0:49)
        """
        sensors = {name: self.usable(name, still, (*keep, *left)).reshape(len(self.time), -1) for name in self._sensors()}
        said = said_of((one for one in self.evidence if one.kind not in keep), len(self.time), self.rate) if still else []
        log = self._replaced(**_fields(sensors), findings=(*self.findings, *said))
        object.__setattr__(log, "_raw", (self, tuple(keep)))  # what was found in it stays known, and is not searched again
        return log

    def head(self) -> str:
        """Sensors, rate and duration in a line, and what was set aside, as in the example of `cleaned`."""
        names = [_SENSORS[name] for name in self._sensors()]
        sensors = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
        sensors = str(self.provenance.get("quantity", sensors))  # such as fractional frequencies of a clock
        lost = 100 * sum(gap.samples for gap in self.gaps) / len(self.time)
        said = [one.facts for one in self.findings if one.code == "set_aside"]
        aside = "".join(f" ({facts['percent']:.2g} % set aside: {facts['what']})" for facts in said)
        untimed = {"no_clock", "no_times"} & set(self.codes)
        clock = f"{len(self.time)} readings without a clock" if untimed else f"{self.rate:.6g} Hz, {span(self.duration)}"
        return f"{sensors}, {clock}" + (f", {lost:.2g} % missing" if self.gaps else "") + aside

    def __repr__(self) -> str:
        """The text of `summary`."""
        return f"Log: {self.summary()}"

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"

    def summary(self) -> str:
        """A few readable lines: length, rate, gaps, and mean and standard deviation of every channel.

        Examples
        --------
        >>> import jaxcal
        >>> print(jaxcal.Log(None, temperature=[20.0, 20.5, 21.0, 21.5], rate=10.0).summary())
        4 samples at 10 Hz, 0.4 s, no gaps
        temperature  mean 20.75  std 0.559  degC
        """
        lost = sum(gap.samples for gap in self.gaps)
        share = f"{lost} samples ({100 * lost / len(self.time):.2g} %) missing"
        gaps = f"{len(self.gaps)} gap{'s' * (len(self.gaps) != 1)}, {share}" if self.gaps else "no gaps"
        lines = [f"{len(self.time)} samples at {self.rate:.6g} Hz, {span(self.duration)}, {gaps}"]
        channels = self.channels()
        width = max(map(len, channels))
        clock = self.provenance.get("quantity") == "clock"  # fractional frequencies stand in the columns of a sensor
        for name, column in channels.items():
            present = column[np.isfinite(column)]
            sensor, _, axis = name.partition("_")
            name, unit = (f"clock_{axis}", "fractions of the frequency") if clock else (name, shown_unit(sensor, present))
            lines.append(f"{name:<{width}}  mean {present.mean():.4g}  std {present.std():.4g}  {unit}")
        return "\n".join(lines)

    def _sensors(self) -> dict[str, np.ndarray]:
        """The recorded sensors as (n, channels) arrays."""
        present = {name: getattr(self, name) for name in _AXES if getattr(self, name) is not None}
        return {name: values.reshape(len(values), -1) for name, values in present.items()}

    def _replaced(self, **changes: Any) -> "Log":
        """A copy with other fields, without any check."""
        log = copy.copy(self)
        for found in ("_evidence", "_raw", "_undone", "_seen") if changes.keys() & _AXES.keys() else ():
            vars(log).pop(found, None)
        for name, value in changes.items():
            object.__setattr__(log, name, value)
        return log


def as_log(source: LogLike, rate: float | int | None = None) -> Log:
    """The log that an estimator receives: a `Log`, or anything that `jaxcal.read` accepts.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal._log import as_log
    >>> as_log({"gyro": np.random.default_rng(0).normal(size=(500, 3)) * 0.01}, rate=100.0).duration
    5.0
    """
    if isinstance(source, Log) and rate is None:
        return source
    # the readers depend on the estimators, so load them only if something must be read
    return importlib.import_module(f"{__package__}.io").read(source, rate=rate, quiet=True)


def _fields(sensors: dict[str, np.ndarray]) -> dict[str, np.ndarray | None]:
    """The sensors in the form of the fields of a log."""
    fields = {name: sensors.get(name) for name in _AXES}
    if (temperature := sensors.get("temperature")) is not None:
        fields["temperature"] = temperature[:, 0]
    return fields


def _channel_names(sensor: str, values: np.ndarray) -> list[str]:
    return [sensor + suffix for suffix in _AXES[sensor][: values.shape[1]]]


def _columns(sensor: str, values: Any) -> np.ndarray:
    """Values of one sensor as (n, channels) in float64; each channel is contiguous, because channels are examined one by one."""
    axes = len(_AXES[sensor])
    array = real_numbers(values, sensor)
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2 or not 1 <= array.shape[1] <= axes:
        wanted = "(n,)" if axes == 1 else "(n, 3)"
        hint = "; time is the first axis: transpose it" if array.ndim == 2 and array.shape[0] <= axes else ""
        raise DataError(f"{sensor} has shape {np.shape(values)}; expected {wanted}{hint}", code="shape")
    return array if array.strides[0] == array.itemsize else np.asfortranarray(array)
