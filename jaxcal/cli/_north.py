"""`jaxcal north`: roll, pitch and azimuth of a turntable from its readings."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

import jaxcal

from .._answer import Finding, tables, things_to_know
from .._units import STANDARD_GRAVITY
from ._cache import keep_compiled
from ._noise_file import read_noise
from ._options import WRITING, CallError, Gravity, Latitude, Noise, Reading, Running, must_be_log, picture
from ._outputs import File, figure, outputs, save_json, save_report, staged
from ._readings import holds_positions, read_readings, read_table_log
from ._screen import Screen, progress, show_written
from ._simulate import noises

TABLE = Group("The table", sort_key=5)


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go; by default they are only printed."""

    json: Annotated[Path | None, Parameter(help="The result as JSON, in SI units.")] = None
    report: Annotated[Path | None, Parameter(help="The report: one HTML file.")] = None
    plot: Annotated[Path | None, picture("Readings with the fitted sinusoid: FILE.png, FILE.svg or FILE.pdf.")] = None


@Parameter(name="*", group=TABLE)
@dataclass(frozen=True, kw_only=True)
class TableOptions:
    """The table and its positions.

    Parameters
    ----------
    angle_column
        Raw log: name of the column with the table angle, in deg unless its name says rad; by default a column called angle.
    angles
        Raw log: table angle in degrees of every rest in order, as 0,90,180,270.
    angle_std
        Standard deviation of each table angle in degrees.
    gyro_scale
        Raw log: standard deviation of the gyroscope's scale factor in ppm, used if its integral gives the angles.
    least
        Raw log: shortest rest in s.
    """

    angle_column: str | None = None
    angles: tuple[str, ...] | None = None
    angle_std: float = 0.0
    gyro_scale: float = 1000.0
    least: float = 5.0


def north(
    readings: Annotated[Path, Parameter(help="The table of readings, or the raw log.")],
    /,
    *,
    latitude: Annotated[Latitude | None, Parameter(help="Latitude in degrees, north positive; without it, it is estimated.")] = None,
    noise: Noise = None,
    axis: Annotated[
        Literal["x", "y", "z"], Parameter(help="Axis of --noise that the sensor is; a log with three axes takes all of them.")
    ] = "x",
    gyro: Annotated[str | None, Parameter(help="Noise of the gyro, as N=0.01deg/sqrt(h),B=0.02deg/h.")] = None,
    accel: Annotated[str | None, Parameter(help="Noise of the accelerometer, as N=0.03m/s/sqrt(h).")] = None,
    free: Annotated[tuple[str, ...] | None, Parameter(help="Parameters to estimate: phi,theta,psi,b_a,s_a,b_g,s_g,... Repeatable.")] = None,
    prior: Annotated[
        tuple[str, ...] | None,
        Parameter(help="Standard deviation of a parameter about zero, or its mean and standard deviation, SI: s_a=1e-4,phi=0.002:1e-5."),
    ] = None,
    azimuth: Annotated[
        float | None, Parameter(help="Azimuth in degrees where it is known: the Earth's rate then gives the gyro's scale error too.")
    ] = None,
    hint: Annotated[float | None, Parameter(help="Rough azimuth in degrees, where two fit.")] = None,
    hemisphere: Annotated[Literal["north", "south"] | None, Parameter(help="north or south, for a latitude that is estimated.")] = None,
    gravity: Gravity | None = None,
    table: TableOptions = TableOptions(),
    reading: Reading = Reading(),
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Estimate roll, pitch and azimuth from readings on a turntable at rest.

    The table of readings is CSV with one row per position:
    angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]
    Mountings are x (normal), z and -z (the same sensor remounted).
    A raw log is any log of the table's moves and rests. jaxcal finds the
    rests; their angles come from a column angle, --angles, or the gyroscope.
    """
    files: list[File] = [
        ("json", "", lambda place, found, data: save_json(place, found, data[0])),
        ("report", "", lambda place, found, data: save_report(place, found, data[0])),
        ("plot", "", figure(lambda plot, found, data: plot.north(data[1], found))),
    ]  # fmt: skip
    plan, _ = outputs(writing, files)
    screen, place = Screen(running.quiet), None if latitude is None else math.radians(latitude)
    options = {
        "priors": _priors(prior),
        "hemisphere": hemisphere,
        "gravity": STANDARD_GRAVITY if gravity is None else gravity,
        "hint": None if hint is None else math.radians(hint),
    }
    if free is not None:
        options["free"] = ",".join(free).split(",")
    if azimuth is not None:
        options["start"] = {"psi": math.radians(azimuth)}
    if table.angles is not None:
        _angles(",".join(table.angles))  # before anything is read
    source, told = None if noise is None else read_noise(noise), noises(gyro, accel)
    must_be_log(readings, "north")
    if readings.is_dir():
        raise CallError(f"{readings} is a folder; jaxcal north takes one file, a table of readings or a raw log", "folder")
    with staged(plan, inputs=[readings], force=running.force) as places:
        raw = table.angles is not None or table.angle_column is not None or not holds_positions(readings)
        with progress(f"reading {readings.name}", running.quiet):
            given = read_table_log(readings, reading, table.angle_column) if raw else read_readings(readings)
        with progress("fitting", running.quiet):
            keep_compiled()
            make = _from_log if raw else _from_table
            data, found, head, notes = make(given, place, table, source, told, axis, azimuth, options)
        log: Any = given[0] if raw else None
        known = [*(() if log is None else log.findings), *notes, *found.findings]
        told_to = {"reader": "terminal", "wanted": running.unit, "verbose": running.verbose}
        screen.line(f"{readings.name}: {head}")
        screen.lines(["", *tables(found.verdict, found.headline, found.sections(), known, **told_to)])
        usable = "psi" not in found.parameters or found.psi is not None
        if usable or running.force:
            with progress("writing", running.quiet):
                known += [one for target, write in plan.items() for one in write(places[target], found, (log, data)) or ()]
    screen.lines(things_to_know(known, more="-v", **told_to))
    if not (usable or running.force):
        raise jaxcal.DataError("there is no azimuth; the reason stands above", code="no_azimuth")
    show_written(screen, list(plan))
    screen.end()


def _from_table(
    given: Any, latitude: Any, table: TableOptions, source: Any, told: dict[str, Any], axis: str, azimuth: Any, options: dict[str, Any]
) -> tuple[Any, Any, str, list[Finding]]:
    """Readings, their fit, a headline, and notes, from a table of readings."""
    from jaxcal.alignment import Positions, Readings, fit, noise_of

    values, notes = given
    error = {"angle_std": math.radians(table.angle_std)} if table.angle_std else {}
    positions = Positions(values["angle"], values["mounting"], values["dwell"], values.get("start"), **error)
    noise = ({} if source is None else noise_of(source, axis)) | {f"{name}_noise": one for name, one in told.items()}
    data = Readings(positions, values.get("accel"), values.get("gyro"), **noise)
    if azimuth is not None and "free" not in options:
        options |= {"free": [*(("phi", "theta", "b_a") if "accel" in values else ()), "b_g", "s_g"]}
    found = fit(data, latitude, **options)
    return data, found, f"{len(positions)} positions, {positions.dwell.sum():g} s in all", notes


def _from_log(
    given: Any, latitude: Any, table: TableOptions, source: Any, told: dict[str, Any], axis: str, azimuth: Any, options: dict[str, Any]
) -> tuple[Any, Any, str, list[Finding]]:
    """Readings, their fit, a headline, and notes, from a raw log."""
    from jaxcal.alignment import from_log, noise_of

    log, column, notes = given
    angles = None if table.angles is None else _angles(",".join(table.angles))
    several = any(values is not None and values.shape[1] > 1 for values in (log.gyro, log.accel))
    known = ({} if source is None else noise_of(source, None if several else axis)) | {f"{name}_noise": one for name, one in told.items()}
    noise = {name.removesuffix("_noise"): one for name, one in known.items() if one is not None}
    found = from_log(
        log, angle=column, angles=angles, noise=noise or None, axis=axis, angle_std=math.radians(table.angle_std),
        gyro_scale=1e-6 * table.gyro_scale, least=table.least,
    )  # fmt: skip
    if azimuth is not None and "free" not in options:
        options |= {"free": [name for name in found.free if name != "psi"] + ["s_g"]}
    fitted = found.fit(latitude, **options)
    angle = ", ".join(f"{math.degrees(x):.4g}" for x in found.angle[:16])
    seconds = float((found.stop - found.start).sum()) / log.rate
    head = f"{len(found.angle)} rests, {seconds:.4g} s in all, at {angle}{' ...' if len(found.angle) > 16 else ''} deg"
    return found.readings, fitted, head, notes


def _angles(text: str) -> list[float]:
    try:
        return [math.radians(float(word)) for word in text.split(",")]
    except ValueError:
        raise CallError(f"--angles {text}: expected degrees with commas between them, such as 0,90,180,270") from None


def _priors(words: tuple[str, ...] | None) -> dict[str, Any] | None:
    priors: dict[str, Any] = {}
    for part in ",".join(words).split(",") if words else ():
        name, _, value = part.partition("=")
        try:
            numbers = tuple(float(number) for number in value.split(":"))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 2):
            raise CallError(
                f"--prior {part}: expected NAME=STANDARD_DEVIATION or NAME=MEAN:STANDARD_DEVIATION in SI units, such as s_a=1e-4"
            )
        priors[name.strip()] = numbers[0] if len(numbers) == 1 else numbers
    return priors or None
