"""Options that the commands share."""

from collections.abc import Callable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

READING = Group("Reading the log", sort_key=10)
WRITING = Group("Output", sort_key=20)
RUNNING = Group("Running", sort_key=30)


class CallError(Exception):
    """The command line asks for something that cannot be done with any data; exit status 2."""


def checked(name: str, holds: Callable[[Any], bool], expected: str, help: str | None = None) -> Parameter:
    """The help of an option, unless a docstring has it, and a check of its value: where `holds` is false the call ends with status 2."""

    def validate(_: Any, value: Any) -> None:
        if value is not None and not holds(value):
            text = f"{value:g}" if isinstance(value, float) else value
            raise CallError(f"{name} {text}: expected {expected}".strip())

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


def must_exist(*paths: Path | None) -> None:
    """Raise a `CallError` for a file that is not there."""
    for path in paths:
        if path is not None and not path.exists():
            raise CallError(f"{path} does not exist")


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


def read_log(path: Path, options: Reading) -> Any:
    """The log at `path`, read with `options`.

    Raises
    ------
    CallError
        If there is no such file, or an option has no meaning.
    """
    must_exist(path)
    import jaxcal

    log = jaxcal.read(path, quiet=True, **reading_options(options))
    return log if options.start is None and options.stop is None else log.select(options.start, options.stop)


def stem(path: Path) -> str:
    """Name of a log without its suffix, for the names of files made from it."""
    path = path.absolute()
    return Path(path.stem).stem if path.suffix == ".gz" else path.stem
