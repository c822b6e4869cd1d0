"""Options shared by the commands."""

import dataclasses
import datetime
import difflib
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from .._errors import JaxcalError
from .._units import ON_EARTH, known_units
from ._advice import TASKS, not_a_calibration, not_a_log

TABLE, READING, WRITING, RUNNING = (
    Group(name, sort_key=place) for place, name in enumerate(("The table", "Reading the log", "Output", "Running"))
)


class CallError(JaxcalError):
    """The command line is wrong whatever the data; exit status 2. The code of a wrong value is the name of its option."""


def checked(name: str, holds: Callable[[Any], bool], expected: str | Callable[[Any], str], help: str | None = None) -> Parameter:
    """Parameter of an option with its help, unless a docstring has it, and a check of its value: `holds` false ends with status 2."""

    def validate(_: Any, value: Any) -> None:
        if value is not None and not holds(value):
            text = f"{value:g}" if isinstance(value, float) else " ".join(value) if isinstance(value, tuple) else value
            raise CallError(
                f"{name} {text}: expected {expected if isinstance(expected, str) else expected(value)}".strip(), name.strip("-")
            )

    return Parameter(validator=validate) if help is None else Parameter(validator=validate, help=help)


def log_file(name: str = "--out", help: str = "File to write: FILE.csv or FILE.npz, in SI units.") -> Parameter:
    """An option for a log that the command writes."""
    return checked(name, lambda path: path.suffix in (".csv", ".npz"), "a name that ends in .csv or .npz", help)


# One definition of each option that several commands have: its type, unit, help and check.

Quiet = Annotated[bool, Parameter(name=("--quiet", "-q"), help="Print nothing but errors.")]
Seed = Annotated[int, Parameter(help="Seed of what is simulated; the same seed gives the same log.")]
Config = Annotated[Path | None, Parameter(help='TOML file with options: a table for each command, as [noise] units = ["gyro=deg/s"].')]
Log = Annotated[Path, Parameter(help="The log: any file that can be read, a folder, or a zip file.")]
LogFile = Annotated[Path, log_file()]
Name = Annotated[str | None, Parameter(name="--name", help="Name of the device, kept in the calibration.")]
Noise = Annotated[Path | None, Parameter(help="Noise of the sensors: calibration.json of jaxcal noise. Else the log gives the noise.")]


def _within(option: str, limits: tuple[float, float], unit: str, help: str) -> Parameter:
    """Parameter of a number with limits."""
    low, high = limits
    return checked(f"--{option}", lambda value: low <= value <= high, f"{low:g} to {high:g} {unit}".strip(), help)


Level = Annotated[float, _within("confidence", (0.01, 0.9999), "", "Level of the intervals.")]
Latitude = Annotated[float, _within("latitude", (-90.0, 90.0), "degrees", "Latitude of the place, in degrees.")]
Height = Annotated[float, _within("height", (-500.0, 9000.0), "m above sea level", "Height of the place, in m.")]
Dip = Annotated[
    float, _within("inclination", (-89.9, 89.9), "degrees, positive downwards", "Dip of the Earth's field at the place, in degrees.")
]  # fmt: skip
Gravity = Annotated[
    float, _within("gravity", ON_EARTH["gravity"], "m/s^2; --latitude gives it",
                   "Gravity at the place, in m/s^2; else from --latitude and --height, else standard gravity."),
]  # fmt: skip
Field = Annotated[
    float, _within("field", (1e6 * ON_EARTH["field"][0], 1e6 * ON_EARTH["field"][1]), "uT",
                   "Norm of the Earth's field at the place, in uT; without it, corrected readings keep their size."),
]  # fmt: skip
Plot = Annotated[
    Path | None,
    checked("--plot", lambda path: path.suffix.lower() in (".png", ".svg", ".pdf"), "a name that ends in .png, .svg or .pdf",
            "Picture: FILE.png, FILE.svg or FILE.pdf."),
]  # fmt: skip
CalibrationFile = Annotated[Path | None, Parameter(help="Calibration file, for jaxcal apply and jaxcal export.")]


def exported(*formats: str) -> Parameter:
    """The option --export, for these formats."""
    more = f"File for another tool: {', '.join(formats)}, or such as {formats[0]}=FILE. Repeatable; jaxcal export writes the other formats."
    return Parameter(name="--export", help=more)


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Files:
    """Where results go; without any of these options they are only printed. A command adds its own files."""

    json: Annotated[Path | None, Parameter(help="Numbers, findings and fields of the result as JSON, in SI units.")] = None
    report: Annotated[
        Path | None,
        checked("--report", lambda path: path.suffix.lower() in ("", ".html", ".htm"),
                "a name that ends in .html; a browser prints it as PDF", "Report as one HTML file."),
    ] = None  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Pictured(Files):
    """Where results with a picture go."""

    plot: Plot = None


@dataclass(frozen=True, kw_only=True)
class Folder(Files):
    """Where results go: a folder for all of them, or single files."""

    out: Annotated[Path | None, Parameter(help="Folder for the files, made if missing. Default: LOG-COMMAND, such as imu-noise.")] = None


@dataclass(frozen=True, kw_only=True)
class Calibrated(Folder):
    """Where the results of a calibration go."""

    calibration: CalibrationFile = None


#: command that takes only measurements -> whether of a sensor that should be at rest; the others take a log as it is, and have no --keep
SET_ASIDE = {"noise": True, "allan": True, "psd": True, "temperature": False, "mag": False, "imu": False, "device": False}


@Parameter(name="*", group=READING)
@dataclass(frozen=True, kw_only=True)
class Source:
    """How a file is read. jaxcal infers what is not given, and prints it.

    Attributes
    ----------
    columns
        Columns of a quantity, by name or number from 0: time=0,gyro=wx,wy,wz. Repeatable.
    units
        Units of the file: time=us,gyro=deg/s,accel=g,mag=uT,temperature=K. Repeatable.
    rate
        Sampling rate in Hz, for a log without time stamps.
    topics
        Topics to read: /imu0,/mag of a ROS bag, sensor_gyro:1 of a ULog, IMU:1 of a DataFlash log. Repeatable.
    data
        rate, or phase for a file of time integrals (angles, velocities, the phase in files of Stable32), which are differenced.
    missing
        Number that marks a missing value in a table, such as 0 or -999.
    format
        Format of the file, such as csv or ulog, if its content does not show it; a wrong one is answered with all.
    axes
        Axes of a sensor that are exchanged or reversed: gyro=y,x,-z says that the device's x is the gyroscope's y. Repeatable.
    """

    columns: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    rate: Annotated[float | None, checked("--rate", lambda rate: 0.0 < rate < float("inf"), "a positive number of Hz")] = None
    topics: tuple[str, ...] | None = None
    data: Literal["rate", "phase"] = "rate"
    missing: float | None = None
    format: str | None = None
    axes: tuple[str, ...] | None = None

    def asked(self) -> dict[str, Any]:
        """Options that differ from their defaults, by name."""
        plain = {field.name: field.default for field in fields(self)}
        return {name: value for name, value in vars(self).items() if value != plain[name]}


@dataclass(frozen=True, kw_only=True)
class Part(Source):
    """How a part of a log is read."""

    start: Annotated[float | None, Parameter(help="Ignore samples before this time, in s after the first sample.")] = None
    stop: Annotated[float | None, Parameter(help="Ignore samples after this time, in s; negative times count from the end.")] = None


@dataclass(frozen=True, kw_only=True)
class Reading(Part):
    """How the measurements in a log are read."""

    keep: Annotated[
        tuple[Literal["knock", "moving", "step", "held", "zeroed", "stuck", "clipped", "all"], ...],
        Parameter(help="Kind of evidence that is not set aside. Repeatable."),
    ] = ()


def _known_unit(units: tuple[str, ...]) -> str:
    """Expected value of --unit; "gyro=deg/s" is meant for --units, the units of the file."""
    wrong = next(one for one in units if one not in known_units())
    near = ", ".join(difflib.get_close_matches(wrong, known_units(), 5, 0.3)) or "deg/h, mg, nT"
    return f"--units {wrong} for a unit of the file, or a unit to show, such as {near}" if "=" in wrong else f"a unit such as {near}"


@Parameter(name="*", group=RUNNING)
@dataclass(frozen=True, kw_only=True)
class Plain:
    """How a command runs that writes files and has no numbers to show."""

    quiet: Quiet = False
    force: Annotated[
        bool, Parameter(help="Replace files that jaxcal did not write, or wrote for another log; write a refused result too.")
    ] = False
    config: Config = None


@Parameter(name="*", group=RUNNING)
@dataclass(frozen=True, kw_only=True)
class Simulating(Plain):
    """How a simulation runs."""

    seed: Seed = 0


@Parameter(name="*", group=RUNNING)
@dataclass(frozen=True, kw_only=True)
class Running(Plain):
    """How a command runs that shows numbers."""

    verbose: Annotated[bool, Parameter(name=("--verbose", "-v"), help="Print everything: tables of detail, and all findings.")] = False
    unit: Annotated[
        tuple[str, ...],
        checked("--unit", lambda units: all(one in known_units() for one in units), _known_unit,
                "Show quantities in this unit, such as deg/h, mg or nT. Repeatable."),
    ] = ()  # fmt: skip

    @property
    def how(self) -> dict[str, Any]:
        """How sentences and tables are printed."""
        return {"reader": "terminal", "wanted": self.unit, "verbose": self.verbose}


def asked(arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Options of a command for the provenance: its arguments, but not the log and what all commands have (`Reading.asked` adds that)."""
    return {name: value for name, value in arguments.items() if name not in ("log", "readings") and not dataclasses.is_dataclass(value)}


def must_exist(*paths: Path | None, option: str = "") -> None:
    """Raise a `CallError` for a file that does not exist."""
    for path in paths:
        if path is not None and not path.exists():
            raise CallError(f"{option} {path}: {path} does not exist" if option else f"{path} does not exist", "not_there")


def must_be_log(path: Path, command: str) -> None:
    """Raise a `CallError` with the intended call if the path does not exist, or is a file that jaxcal made."""
    if wrong := not_a_log(path, command):
        raise CallError(wrong, "not_a_log")


def must_be_calibration(*paths: Path | None, option: str = "") -> None:
    """Raise a `CallError` for files that are not calibrations."""
    for path in paths:
        if path is not None and (wrong := not_a_calibration(path, option)):
            raise CallError(wrong, "not_a_calibration")


def read_noise(path: Path | None) -> Any:
    """The calibration with the noise of the sensors, for the option --noise."""
    from ..calibration import Calibration

    must_be_calibration(path, option="--noise")
    return None if path is None else Calibration.load(path)


def numbers(option: str, text: str, such: str) -> list[float]:
    """Parse numbers with commas between them."""
    try:
        return [float(word) for word in text.split(",")]
    except ValueError:
        raise CallError(f"{option} {text}: expected numbers with commas between them, such as {such}") from None


def amounts(option: str, text: str, such: str) -> dict[str, float]:
    """Parse NAME=NUMBER,..."""
    try:
        return {name: float(value) for name, _, value in (word.partition("=") for word in text.split(",") if word)}
    except ValueError:
        raise CallError(f"{option} {text}: expected such as {such}", option.strip("-")) from None


def day(text: str) -> datetime.date:
    """Parse the day in --date, as year-month-day.

    Examples
    --------
    >>> from jaxcal.cli._options import day
    >>> day("2026-05-31")
    datetime.date(2026, 5, 31)
    """
    try:
        return datetime.date.fromisoformat(text.strip())
    except ValueError:
        raise CallError(f"--date {text} is no day; write year, month, day: --date 2026-05-31", "date") from None


def in_counts(options: Reading, *sensors: str) -> Reading:
    """The options with one count as the unit of these sensors, where they have no unit."""
    from .._units import si_unit

    given = options.units or ()
    units = tuple(f"{sensor}=1 {si_unit(sensor)}" for sensor in sensors if not any(sensor in unit for unit in given))
    return dataclasses.replace(options, units=(*given, *units) or None)


def reading_options(options: Source) -> dict[str, Any]:
    """Options for `jaxcal.read`, except `quiet`.

    Raises
    ------
    CallError
        If an option is invalid.
    """
    import jaxcal

    from ..io._columns import parse_axes, parse_columns, parse_topics, parse_units
    from ..io._find import FORMATS

    if options.format is not None and options.format not in FORMATS:
        raise CallError(f"--format {options.format}: expected one of {', '.join(FORMATS)}", "format")
    parsers = {"columns": parse_columns, "units": parse_units, "topics": parse_topics, "axes": parse_axes}
    try:
        named: dict[str, Any] = {name: parse(",".join(words)) for name, parse in parsers.items() if (words := getattr(options, name))}
    except jaxcal.DataError as error:  # not the data: nothing was read yet
        raise CallError(error.spelt("terminal"), error.code) from error
    return named | {name: getattr(options, name) for name in ("format", "rate", "data", "missing")}


def read_clock(path: Path, options: Part, nominal: float | None) -> Any:
    """Read the file of a clock at `path` with `options`."""
    from ..io._columns import pairs
    from ..io._oscillator import read_oscillator

    must_be_log(path, "allan")
    columns, units = (
        pairs(",".join(words or ()) or None, name) for name, words in (("columns", options.columns), ("units", options.units))
    )
    known = {name: getattr(options, name) for name in ("rate", "missing", "data", "format")}
    log = read_oscillator(path, columns=columns, units=units, nominal=nominal, **known)
    return log if options.start is None and options.stop is None else log.select(options.start, options.stop)


def read_log(path: Path, options: Part, command: str) -> Any:
    """Read the log at `path` with `options` for a command.

    Raises
    ------
    CallError
        If the file does not exist, is not a log, or an option is invalid.
    DataError
        If the log cannot be read.
    """
    must_be_log(path, command)
    if options.start is not None and options.stop is not None and options.start >= options.stop > 0:
        raise CallError(f"--start {options.start:g} --stop {options.stop:g}: nothing lies between; the start comes first", "start")
    import jaxcal

    from ..evidence._stretch import NO_READING, NOT_STILL
    from ..io._read import read_for

    given = reading_options(options)
    try:
        log = read_for("mag" if command == "mag" else None, path, **given)
    except jaxcal.DataError as error:
        if not path.is_dir() or command not in TASKS:
            raise
        said = f"{error}. For all logs of a folder: jaxcal batch {shlex.quote(str(path))} --task {command} --out fleet"
        raise jaxcal.DataError(said, code=error.code) from error
    log = log if options.start is None and options.stop is None else log.select(options.start, options.stop)
    if not isinstance(options, Reading) or command not in SET_ASIDE:
        return log
    still = SET_ASIDE[command]
    # estimators of a sensor that moves have their own view of the end of the range
    return log.cleaned(still, (*NO_READING, *NOT_STILL) if "all" in options.keep else options.keep, () if still else ("clipped", "zeroed"))


def stem(path: Path) -> str:
    """Name of a log without its suffix, from which the names of output files are made."""
    path = path.absolute()
    return Path(path.stem).stem if path.suffix == ".gz" else path.stem


def folder(path: Path, command: str) -> str:
    """Name of the folder for the results of a command: the log and the command, each once."""
    name = stem(path)
    return name if name.endswith(command) else f"{name}-{command}"
