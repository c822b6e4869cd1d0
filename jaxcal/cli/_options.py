"""Options that the commands share."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Literal

from cyclopts import Group, Parameter

READING = Group("Reading the log", sort_key=10)
WRITING = Group("Output", sort_key=20)
RUNNING = Group("Running", sort_key=30)


class CallError(Exception):
    """The command line asks for something that cannot be done with any data; exit status 2."""


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
        Format of the file, where its content does not tell: csv, npy, npz, parquet, rosbag1, rosbag2, mat, hdf5, ulog, dataflash.
    start
        Leave out what comes before this time, in s after the first sample.
    stop
        Leave out what comes after this time; negative times count from the end.
    """

    columns: tuple[str, ...] | None = None
    units: tuple[str, ...] | None = None
    rate: float | None = None
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
    """How a command runs.

    Attributes
    ----------
    quiet
        Print nothing but errors.
    seed
        Seed of everything random in the command; estimates draw nothing.
    config
        TOML file with options: a table for each command, as [noise] units = ["gyro=deg/s"].
    """

    quiet: bool = False
    seed: int = 0
    config: Path | None = None


def read_log(path: Path, options: Reading) -> Any:
    """The log at `path`, read with `options`.

    Raises
    ------
    CallError
        If there is no such file, or an option has no meaning.
    """
    if not path.exists():
        raise CallError(f"{path} does not exist")
    import jaxcal

    from ..io._detect import FORMATS
    from ..io._options import parse_columns, parse_topics, parse_units

    if options.format is not None and options.format not in FORMATS:
        raise CallError(f"--format {options.format}: expected one of {', '.join(FORMATS)}")
    try:
        columns = parse_columns(_joined(options.columns))
        units = parse_units(_joined(options.units))
        topics = parse_topics(_joined(options.topics))
    except jaxcal.DataError as error:  # not the data: nothing was read yet
        raise CallError(f"--{error}") from error
    if options.rate is not None and not 0.0 < options.rate < float("inf"):
        raise CallError(f"--rate {options.rate:g}: expected a positive number of Hz")
    log = jaxcal.read(
        path, format=options.format, columns=columns or None, units=units or None, rate=options.rate, topics=topics, raw=options.raw,
        data=options.data, missing=options.missing, quiet=True,
    )  # fmt: skip
    if options.start is None and options.stop is None:
        return log
    return log.select(options.start, options.stop)


def _joined(words: tuple[str, ...] | None) -> str | None:
    return ",".join(words) if words else None


def stem(path: Path) -> str:
    """Name of a log without its suffix, for the names of files made from it."""
    path = path.absolute()
    return Path(path.stem).stem if path.suffix == ".gz" else path.stem


def distinct(asked: list[tuple[Path, Any]]) -> dict[Path, Any]:
    """Target -> what makes it, where no two targets are the same file."""
    if len({target.resolve() for target, _ in asked}) < len(asked):
        raise CallError("two outputs have the same file name; give each a name of its own")
    return dict(asked)
