"""`jaxcal north`: roll, pitch and azimuth of a turntable from its readings."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

import jaxcal

from ._cache import keep_compiled
from ._options import WRITING, CallError, Latitude, Running, picture
from ._outputs import File, figure, outputs, save_json, save_report, staged
from ._readings import read_readings
from ._screen import Screen, progress, show_written
from ._simulate import noise_from_text

#: parameter -> (name, unit, its size in SI)
_DEG = math.pi / 180
_ROWS = {
    "phi": ("roll", "deg", _DEG), "theta": ("pitch", "deg", _DEG), "psi": ("azimuth", "deg", _DEG),
    "b_a": ("accelerometer bias", "ug", 9.80665e-6), "s_a": ("accelerometer scale error", "ppm", 1e-6),
    "b_g": ("gyro bias", "deg/h", _DEG / 3600), "s_g": ("gyro scale error", "ppm", 1e-6),
    "ma_a_xy": ("accelerometer misalignment 1", "arcsec", _DEG / 3600), "ma_a_xz": ("accelerometer misalignment 2", "arcsec", _DEG / 3600),
    "ma_g_xy": ("gyro misalignment 1", "arcsec", _DEG / 3600), "ma_g_xz": ("gyro misalignment 2", "arcsec", _DEG / 3600),
    "b_a_rate": ("accelerometer drift", "ug/h", 9.80665e-6 / 3600), "b_g_rate": ("gyro drift", "deg/h/h", _DEG / 3600 / 3600),
    "latitude": ("latitude", "deg", _DEG),
    **{f"b_a_{axis}": (f"accelerometer bias {axis}", "ug", 9.80665e-6) for axis in "yz"},
    **{f"b_g_{axis}": (f"gyro bias {axis}", "deg/h", _DEG / 3600) for axis in "yz"},
}  # fmt: skip


@Parameter(name="*", group=WRITING)
@dataclass(frozen=True, kw_only=True)
class Writing:
    """Where results go; without any of these they are only printed."""

    json: Annotated[Path | None, Parameter(help="The result as JSON, in SI units.")] = None
    report: Annotated[Path | None, Parameter(help="The report: one HTML file.")] = None
    plot: Annotated[Path | None, picture("Readings with the fitted sinusoid: FILE.png, FILE.svg or FILE.pdf.")] = None


def north(
    readings: Annotated[Path, Parameter(help="The table.")],
    /,
    *,
    latitude: Annotated[Latitude | None, Parameter(help="Latitude in degrees, north positive; without it, it is estimated.")] = None,
    gyro: Annotated[
        str | None, Parameter(help="Noise of the gyro, as N=0.01deg/sqrt(h); N and K count. Without it the residuals give the noise.")
    ] = None,
    accel: Annotated[str | None, Parameter(help="Noise of the accelerometer, as N=0.03m/s/sqrt(h).")] = None,
    free: Annotated[tuple[str, ...] | None, Parameter(help="Parameters to estimate: phi,theta,psi,b_a,s_a,b_g,s_g,... Repeatable.")] = None,
    prior: Annotated[
        tuple[str, ...] | None, Parameter(help="Standard deviation of a parameter about zero, SI: s_a=1e-4. Repeatable.")
    ] = None,
    hint: Annotated[float | None, Parameter(help="Rough azimuth in degrees, where two fit.")] = None,
    hemisphere: Annotated[str | None, Parameter(help="north or south, for a latitude that is estimated.")] = None,
    gravity: Annotated[float, Parameter(help="Local gravity in m/s^2.")] = 9.80665,
    writing: Writing = Writing(),
    running: Running = Running(),
) -> None:
    """Roll, pitch and azimuth from readings on a turntable at rest.

    The table is CSV with one row per position:
    angle [deg],mounting,dwell [s],accel [m/s^2],gyro [deg/h]
    Mountings are x (normal), z and -z (the same sensor remounted).
    """
    priors = _priors(prior)
    files: list[File] = [
        ("json", "", save_json), ("report", "", save_report), ("plot", "", figure(lambda plot, found, data: plot.north(data, found))),
    ]  # fmt: skip
    plan, _ = outputs(writing, files)
    screen = Screen(running.quiet)
    with staged(plan, inputs=[readings]) as places:
        table, notes = read_readings(readings)
        with progress("fitting", running.quiet):
            keep_compiled()
            from jaxcal.alignment import Positions, Readings, fit

            positions = Positions(table["angle"], table["mounting"], table["dwell"], table.get("start"))
            noise = {
                f"{name}_noise": None if text is None else noise_from_text(text, name) for name, text in (("gyro", gyro), ("accel", accel))
            }
            data = Readings(positions, table.get("accel"), table.get("gyro"), **noise)
            names = None if free is None else ",".join(free).split(",")
            place, azimuth = (None if angle is None else math.radians(angle) for angle in (latitude, hint))
            found = fit(data, place, free=names, priors=priors, hemisphere=hemisphere, gravity=gravity, hint=azimuth)
            said = [sentence for target, make in plan.items() for sentence in make(places[target], found, data) or ()]
    screen.line(f"{readings.name}: {len(positions)} positions, {positions.dwell.sum():g} s in all")
    screen.sentences("How it was read", notes)
    _table(screen, found)
    chi_square = [] if found.p_value is None else [
        f"chi-square {float(found.chi_square):.3g} with {int(found.degrees_of_freedom)} degrees of freedom, p = {found.p_value:.2g}."
    ]  # fmt: skip
    screen.sentences("Notes", [found.observability, *chi_square, *found.notes])
    show_written(screen, list(plan))
    if found.psi is None:
        raise jaxcal.DataError(f"no azimuth: {found.reason}")
    screen.sentences("Warnings", [*said, *([] if bool(found.verdict == jaxcal.alignment.Verdict.ok) else [found.reason])])


def _priors(words: tuple[str, ...] | None) -> dict[str, float] | None:
    priors = {}
    for part in ",".join(words).split(",") if words else ():
        name, _, value = part.partition("=")
        try:
            priors[name.strip()] = float(value)
        except ValueError:
            raise CallError(f"--prior {part}: expected NAME=STANDARD_DEVIATION in SI units, such as s_a=1e-4") from None
    return priors or None


def _table(screen: Screen, found: Any) -> None:
    rows, interval = [], found.interval
    for name, value in found.parameters.items():
        label, unit, size = _ROWS.get(name, (name, "SI", 1.0))
        low, high = interval.get(name, (-math.inf, math.inf))
        half = (high - low) / 2 / size
        if value is None or not math.isfinite(half):
            rows.append([label, "not determined", "", unit])
            continue
        digits = max(0, 1 - math.floor(math.log10(half))) if half > 0 else 6
        value = value / size
        rows.append([label, f"{value:.{digits}f}", f"{value - half:.{digits}f} to {value + half:.{digits}f}", unit])
    screen.table("joint least-squares fit", ["", "value", "95 % interval", "unit"], rows)
