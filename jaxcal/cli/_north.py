"""`jaxcal north`: roll, pitch and azimuth of a turntable from its readings."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .._units import STANDARD_GRAVITY
from ._options import TABLE, CallError, Gravity, Latitude, Noise, Part, Pictured, Running, asked, must_be_log, numbers, read_noise
from ._outputs import standard
from ._readings import ReadingsTable, holds_positions, read_readings, read_table_log
from ._simulate import noises
from ._work import carry_out


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
        Standard deviation of each table angle in degrees, 0 for exact angles; without it, the intervals allow for what the residuals leave
        open.
    gyro_scale
        Raw log: standard deviation of the gyroscope's scale factor in ppm, used if its integral gives the angles.
    least
        Raw log: shortest rest in s.
    """

    angle_column: str | None = None
    angles: tuple[str, ...] | None = None
    angle_std: float | None = None
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
    gravity: Annotated[Gravity | None, Parameter(help="Gravity at the place, in m/s^2; else standard gravity.")] = None,
    table: TableOptions = TableOptions(),
    reading: Part = Part(),
    writing: Pictured = Pictured(),
    running: Running = Running(),
) -> None:
    """Estimate roll, pitch and azimuth from readings on a turntable at rest.

    The table of readings is CSV with one row per position:
    angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]
    Mountings are x (normal), z and -z (the same sensor remounted).
    A raw log is any log of the table's moves and rests. jaxcal finds the
    rests; their angles come from a column angle, --angles, or the gyroscope.
    """
    given = asked(locals())
    place = None if latitude is None else math.radians(latitude)
    doubt = None if table.angle_std is None else math.radians(table.angle_std)
    angles = None if table.angles is None else [*map(math.radians, numbers("--angles", ",".join(table.angles), "0,90,180,270"))]
    options: dict[str, Any] = {
        "priors": _priors(prior), "hemisphere": hemisphere, "gravity": STANDARD_GRAVITY if gravity is None else gravity,
        "hint": None if hint is None else math.radians(hint),
    }  # fmt: skip
    if free is not None:
        options["free"] = ",".join(free).split(",")
    if azimuth is not None:
        options["start"] = {"psi": math.radians(azimuth)}
    source, told = read_noise(noise), noises(gyro, accel)
    column: list[Any] = [None]

    def read() -> Any:
        must_be_log(readings, "north")
        if readings.is_dir():
            raise CallError(f"{readings} is a folder; jaxcal north takes one file, a table of readings or a raw log", "folder")
        if angles is None and table.angle_column is None and holds_positions(readings):
            return read_readings(readings)
        log, column[0] = read_table_log(readings, reading, table.angle_column)
        return log

    def compute(data: Any, _: Any) -> Any:
        from ..alignment import Positions, Readings, fit, from_log, noise_of

        positions = isinstance(data, ReadingsTable)
        several = not positions and any(values is not None and values.shape[1] > 1 for values in (data.gyro, data.accel))
        known = {} if source is None else noise_of(source, None if several else axis)
        known |= {f"{name}_noise": one for name, one in told.items()}
        if positions:
            values = data.values
            places = Positions(values["angle"], values["mounting"], values["dwell"], values.get("start"), angle_std=doubt)
            if azimuth is not None and "free" not in options:
                options["free"] = [*(("phi", "theta", "b_a") if "accel" in values else ()), "b_g", "s_g"]
            return fit(Readings(places, values.get("accel"), values.get("gyro"), **known), place, **options)
        held = {name.removesuffix("_noise"): one for name, one in known.items() if one is not None}
        found = from_log(
            data, angle=column[0], angles=angles, noise=held or None, axis=axis, angle_std=doubt,
            gyro_scale=1e-6 * table.gyro_scale, least=table.least,
        )  # fmt: skip
        if azimuth is not None and "free" not in options:
            options["free"] = [name for name in found.free if name != "psi"] + ["s_g"]
        return found.fit(place, **options)

    plan = standard(writing, "north", readings, readings=lambda found, _: found.readings)
    carry_out(readings, reading, running, plan, compute, read=read, command="north", options=given).end()


def _priors(words: tuple[str, ...] | None) -> dict[str, Any] | None:
    priors: dict[str, Any] = {}
    for part in ",".join(words).split(",") if words else ():
        name, _, value = part.partition("=")
        try:
            numbers = tuple(float(number) for number in value.split(":"))
        except ValueError:
            numbers = ()
        if len(numbers) not in (1, 2):
            raise CallError(f"--prior {part}: expected NAME=STANDARD_DEVIATION or NAME=MEAN:STANDARD_DEVIATION in SI, such as s_a=1e-4")
        priors[name.strip()] = numbers[0] if len(numbers) == 1 else numbers
    return priors or None
