"""Options that the commands share."""

import contextlib
import dataclasses
import datetime
from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

from ._advice import TASKS, not_a_calibration, not_a_log

READING = Group("Reading the log", sort_key=10)
WRITING = Group("Output", sort_key=20)
RUNNING = Group("Running", sort_key=30)
#: forms of a date that are recognised, and refused with the one that is meant
_DATES = ("%d.%m.%Y", "%d.%m.%y", "%Y/%m/%d", "%Y.%m.%d", "%d/%m/%Y", "%m/%d/%Y", "%d-%m-%Y", "%d %B %Y", "%d %b %Y", "%B %d, %Y",
          "%b %d, %Y", "%B %d %Y", "%Y-%m-%d %H:%M:%S", "%Y-%m-%dT%H:%M:%S", "%Y-%m-%dT%H:%M:%SZ", "%Y-%j")  # fmt: skip


class CallError(Exception):
    """The command line asks for something that cannot be done with any data; exit status 2."""


def checked(name: str, holds: Callable[[Any], bool], expected: str | Callable[[Any], str], help: str | None = None) -> Parameter:
    """The help of an option, unless a docstring has it, and a check of its value: where `holds` is false the call ends with status 2."""

    def validate(_: Any, value: Any) -> None:
        if value is not None and not holds(value):
            text = f"{value:g}" if isinstance(value, float) else value
            raise CallError(f"{name} {text}: expected {expected if isinstance(expected, str) else expected(value)}".strip())

    return Parameter(validator=validate) if help is None else Parameter(validator=validate, help=help)


def picture(help: str = "Picture: FILE.png, FILE.svg or FILE.pdf.") -> Parameter:
    """The option --plot."""
    return checked("--plot", lambda path: path.suffix.lower() in (".png", ".svg", ".pdf"), "a name that ends in .png, .svg or .pdf", help)


def log_file(name: str = "--out", help: str = "File to write: FILE.csv or FILE.npz, in SI units.") -> Parameter:
    """An option for a log to be written."""
    return checked(name, lambda path: path.suffix in (".csv", ".npz"), "a name that ends in .csv or .npz", help)


Quiet = Annotated[bool, Parameter(help="Print nothing but errors.")]
Log = Annotated[Path, Parameter(help="The log: any file that can be read, a folder, or a zip file.")]
LogFile = Annotated[Path, log_file()]
Level = Annotated[
    float, checked("--confidence", lambda level: 0 < level < 1, "a level between 0 and 1; 0.95 is 95 %", "Level of the intervals.")
]
Latitude = Annotated[float, checked("--latitude", lambda angle: abs(angle) <= 90, "degrees between -90 and 90")]
GRAVITIES = (9.76, 9.84)  # m/s^2, from the highest mountain at the equator to the poles


def _on_earth(value: float) -> str:
    """What is expected of --gravity, with the likely unit of a number that is none in m/s^2."""
    likely = {"g": 1.0, "mg": 1e3, "cm/s^2": 980.665, "ft/s^2": 32.174}
    unit, size = min(likely.items(), key=lambda item: abs(value / item[1] - 1.0))
    seems = f"; {value:g} looks like {unit}" if abs(value / size - 1.0) < 0.02 else ""
    return f"m/s^2, and gravity is {GRAVITIES[0]} to {GRAVITIES[1]} on Earth{seems}. --latitude and --height give it"


Gravity = Annotated[float, checked("--gravity", lambda value: GRAVITIES[0] <= value <= GRAVITIES[1], _on_earth)]


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Files:
    """Where results go: a folder for all of them, or single files. A command adds its own files and says what its JSON holds."""

    out: Annotated[Path | None, Parameter(help="Folder for the files, made if it is missing.")] = None
    json: Path | None = None
    report: Annotated[Path | None, Parameter(help="Report as one HTML file.")] = None
    plot: Annotated[Path | None, picture()] = None


@Parameter(name="*", group=READING)
@dataclass(frozen=True, kw_only=True)
class Reading:
    """How a log is read. What is not given is guessed, and the guess is printed.

    Attributes
    ----------
    columns
        Columns of a quantity, by name or number from 0: time=0,gyro=wx,wy,wz. Repeatable.
    units
        Units of the file: time=us,gyro=deg/s,accel=g,mag=uT,temperature=K. Repeatable.
    rate
        Sampling rate in Hz, where the log has no time stamps.
    topics
        Topics to read: /imu0,/mag of a ROS bag, sensor_gyro:1 of a ULog, IMU:1 of a DataFlash log. Repeatable.
    raw
        Undo the calibration that a flight controller applied before logging, with the parameters in the log.
    data
        rate, or phase where the file holds time integrals (angles, velocities, the phase in files of Stable32): differences are taken.
    missing
        Number that stands for a missing value in a table, such as 0 or -999.
    format
        Format of the file, where its content does not tell: csv, json, npy, npz, parquet, rosbag1, rosbag2, mat, hdf5, ulog, dataflash,
        zip.
    start
        Leave out what comes before this time, in s after the first sample.
    stop
        Leave out what comes after this time; negative times count from the end.
    """

    columns: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    rate: Annotated[float | None, checked("--rate", lambda rate: 0.0 < rate < float("inf"), "a positive number of Hz")] = None
    topics: tuple[str, ...] | None = None
    raw: bool = False
    data: Literal["rate", "phase"] = "rate"
    missing: float | None = None
    format: str | None = None
    start: float | None = None
    stop: float | None = None

    def asked(self) -> dict[str, Any]:
        """Options that were given, by name."""
        plain = {field.name: field.default for field in fields(self)}
        return {name: value for name, value in vars(self).items() if value != plain[name]}


@Parameter(name="*", group=RUNNING)
@dataclass(frozen=True, kw_only=True)
class Running:
    """How a command runs."""

    quiet: Quiet = False
    seed: Annotated[int, Parameter(help="Seed of what is simulated; estimates use no random numbers.")] = 0
    config: Annotated[
        Path | None, Parameter(help='TOML file with options: a table for each command, as [noise] units = ["gyro=deg/s"].')
    ] = None


def must_exist(*paths: Path | None, option: str = "") -> None:
    """Raise a `CallError` for a file that is not there."""
    for path in paths:
        if path is not None and not path.exists():
            raise CallError(f"{option} {path}: {path} does not exist" if option else f"{path} does not exist")


def must_be_log(path: Path, command: str) -> None:
    """Raise a `CallError`, with the call that was meant, for what is no file or folder, and for files of jaxcal's own."""
    if wrong := not_a_log(path, command):
        raise CallError(wrong)


def must_be_calibration(*paths: Path | None, option: str = "") -> None:
    """The same for files that are no calibration."""
    for path in paths:
        if path is not None and (wrong := not_a_calibration(path, option)):
            raise CallError(wrong)


def day(text: str) -> datetime.date:
    """The day that --date names, as year-month-day; a `CallError` shows how another form is written so.

    Examples
    --------
    >>> from jaxcal.cli._options import day
    >>> day("2026-05-31")
    datetime.date(2026, 5, 31)
    """
    with contextlib.suppress(ValueError):
        return datetime.date.fromisoformat(text)
    found: list[datetime.date] = []
    for form in _DATES:
        with contextlib.suppress(ValueError):
            found.append(datetime.datetime.strptime(text.strip(), form).date())
    days = list(dict.fromkeys(found))
    if len(days) == 1:
        raise CallError(f"--date {text}: write year, month, day: --date {days[0]}")
    if days:
        raise CallError(
            f"--date {text} may be {' or '.join(f'{one:%d %B %Y}' for one in days)}; write --date {' or --date '.join(map(str, days))}"
        )
    raise CallError(f"--date {text} is no day; write year, month, day: --date 2026-05-31")


def in_counts(options: Reading, *sensors: str) -> Reading:
    """The options with one count as the unit of these sensors, where they have no unit."""
    from .._units import si_unit

    given = options.units or ()
    units = tuple(f"{sensor}=1 {si_unit(sensor)}" for sensor in sensors if not any(sensor in unit for unit in given))
    return dataclasses.replace(options, units=(*given, *units) or None)


def reading_options(options: Reading) -> dict[str, Any]:
    """Options of `jaxcal.read`, but for its `quiet`.

    Raises
    ------
    CallError
        If an option has no meaning.
    """
    import jaxcal

    from ..io._columns import parse_columns, parse_topics, parse_units
    from ..io._find import FORMATS

    if options.format is not None and options.format not in FORMATS:
        raise CallError(f"--format {options.format}: expected one of {', '.join(FORMATS)}")
    parsers = {"columns": parse_columns, "units": parse_units, "topics": parse_topics}
    try:
        named: dict[str, Any] = {name: parse(",".join(words)) for name, parse in parsers.items() if (words := getattr(options, name))}
    except jaxcal.DataError as error:  # not the data: nothing was read yet
        raise CallError(f"--{error}") from error
    return named | {name: getattr(options, name) for name in ("format", "rate", "raw", "data", "missing")}


def read_log(path: Path, options: Reading, command: str) -> Any:
    """The log at `path` for a command, read with `options`.

    Raises
    ------
    CallError
        If there is no such file, the file is no log, or an option has no meaning.
    DataError
        If it cannot be read.
    """
    must_be_log(path, command)
    if options.start is not None and options.stop is not None and options.start >= options.stop > 0:
        raise CallError(f"--start {options.start:g} --stop {options.stop:g}: nothing lies between; the start comes first")
    import jaxcal

    given = reading_options(options)
    try:
        log = jaxcal.read(path, quiet=True, **given)
    except jaxcal.DataError as error:
        if not path.is_dir() or command not in TASKS:
            raise
        raise jaxcal.DataError(f"{error}. For all logs of a folder: jaxcal batch {path} --task {command} --out fleet") from error
    return log if options.start is None and options.stop is None else log.select(options.start, options.stop)


def stem(path: Path) -> str:
    """Name of a log without its suffix, for the names of files made from it."""
    path = path.absolute()
    return Path(path.stem).stem if path.suffix == ".gz" else path.stem
