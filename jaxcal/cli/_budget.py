"""`jaxcal budget`: what the errors of a sensor cost; `jaxcal sheet`: the noise of a data sheet for other tools."""

import math
import textwrap
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._answer import NOTE, tables, things_to_know
from .._units import noise_units, si_unit
from ..export._formats import FORMATS
from . import _options as opt
from ._advice import not_a_calibration
from ._export import FILES, motion_of
from ._outputs import File, outputs, save_json, staged
from ._screen import Screen, show_written

_FILTERS = Literal[tuple(name for name, one in FORMATS.items() if "random_walk" in one.options)]
_WALK = 100.0  # s, means of the flicker over which a random walk drifts as much: the time in which a filter learns a bias


def budget(
    source: Annotated[Path, Parameter(help="Calibration as JSON, or a log of the sensor at rest, whose noise is fitted first.")],
    /,
    *,
    motion: str = "rest",
    duration: float = 3600.0,
    rest: float = 0.0,
    aid: float | None = None,
    inclination: opt.Dip = 60.0,
    latitude: opt.Latitude | None = None,
    temperature: float | None = None,
    error: tuple[str, ...] = (),
    require: str | None = None,
    reading: opt.Reading = opt.Reading(),
    writing: opt.Folder = opt.Folder(),
    running: opt.Running = opt.Running(),
) -> None:
    """Attitude, heading, velocity and position errors over time, by cause.

    Parameters
    ----------
    motion
        rest, circle (a vehicle), hand, or a log with the motion.
    duration
        Length of a motion that is not a log, in s.
    rest
        Time at rest before the start, in s: its mean is the gyroscope's bias, and the level. 0: both are known.
    aid
        Time constant in s with which accelerometer and magnetometer correct level and heading (an AHRS).
    temperature
        Temperature of the device in degC, for its thermal models; by default that to which they refer.
    error
        A further error (standard deviation, SI), as gyro.scale=1e-3, accel.bias=0.02, mag.hard_iron=1e-6, temperature=2. Repeatable.
    require
        Limit of an error at the end, as heading=1 or tilt=0.5 (deg), velocity=0.1, position=5: by what the causes may grow.
    """
    from ..budget._result import GROUPS  # loads NumPy, which help does not need

    made = motion in ("rest", "circle", "hand")
    errors, limit = opt.amounts("--error", ",".join(error), "gyro.scale=1e-3"), opt.amounts("--require", require or "", "heading=1")
    if set(limit) - set(GROUPS):
        raise opt.CallError(f"--require {require}: expected one of {', '.join(GROUPS)}", "require")
    opt.must_exist(source)
    if not made and not Path(motion).exists():
        raise opt.CallError(f"--motion {motion}: expected rest, circle (a vehicle), hand, or a log, and there is no such file", "motion")
    files: list[File] = [
        ("report", "report.html", lambda *made: jaxcal.report.write(made[1], made[0], log=made[2], device=source.name, reader="terminal")),
        ("json", "budget.json", save_json),
    ]  # fmt: skip
    screen, (targets, folder) = Screen(running.quiet), outputs(writing, files, f"{opt.stem(source)}-budget")
    with staged(targets, inputs=[source], folder=folder, force=running.force) as places:
        log = None if not_a_calibration(source) is None else opt.read_log(source, reading, "noise")
        device = jaxcal.Calibration.load(source) if log is None else jaxcal.Calibration(noise=jaxcal.noise.characterise(log))
        moved = getattr(jaxcal.budget.Motion, motion)(duration) if made else motion_of(Path(motion), device)
        found = jaxcal.budget.propagate(
            device, moved, rest=rest, errors=errors, aid=aid, dip=math.radians(inclination),
            latitude=None if latitude is None else math.radians(latitude), temperature=temperature,
        )  # fmt: skip
        for target, make in targets.items():
            make(places[target], found, log)
    # how the log was read asks for no action: it stands in the report
    read = [one for one in (() if log is None else log.findings) if running.verbose or one.severity > NOTE]
    told = [*read, *found.findings]
    screen.lines(tables(found.verdict, found.headline, found.sections(), told, **running.how))
    for name, value in limit.items():
        inside = math.radians(value) if GROUPS[name][1] == "angle" else value
        factors = jaxcal.budget.requirement(found, after=float(found.time[-1]), **{name: inside})
        causes = [cause for cause, _ in found.largest(name, found.time[-1])]
        known = [one for one in ("all", "noise", "calibration", "turning", "record", *causes) if one in factors]
        names = {"record": "length of the record"}
        words = (
            f"{names.get(one, one)} {'does not suffice' if math.isnan(factors[one][0]) else f'{factors[one][0]:.3g}'}" for one in known
        )
        said = f"{require} after {found.time[-1]:g} s is reached by one of these, as a multiple of what it is now: {', '.join(words)}"
        screen.lines(["", *textwrap.wrap(said, 80)])
    screen.lines(things_to_know(told, more="-v", **running.how))
    show_written(screen, list(targets))


def sheet(
    text: Annotated[str, Parameter(help='Such as "gyro: ARW 0.3 deg/sqrt(h), BI 2 deg/h; accel: 60 ug/sqrt(Hz), 40 ug".')],
    /,
    *,
    to: Annotated[_FILTERS | None, Parameter(help="The filter, in whose form the noise is written.")] = None,  # type: ignore
    rate: float = 200.0,
    out: Annotated[Path | None, Parameter(help="File to write with --to; by default one with the usual name, here.")] = None,
    calibration: opt.CalibrationFile = None,
    running: opt.Plain = opt.Plain(),
) -> None:
    """Noise of a data sheet in SI, and as a file for a filter.

    Every conversion is printed. For a filter, flicker B becomes the random
    walk that drifts as much between means of 100 s.

    Parameters
    ----------
    rate
        Sampling rate in Hz that the file states.
    """
    from ..noise._sheet import read_sheet

    noises, said = read_sheet(text)
    # means of flicker over T differ by 2 (2 ln 2/pi) B^2 from one to the next, those of a random walk by 2 K^2 T/3
    walks = {name: math.sqrt(6 * math.log(2) / math.pi / _WALK) * one.B for name, one in noises.items() if one.B and not one.K}
    held: dict[str, Any] = {"rate": rate}
    for name, one in noises.items():
        held[name] = {"unit": si_unit(name)} | {term: [float(value)] * 3 if value else None for term, value, _ in one.parts}
    device = jaxcal.Calibration(noise=held, provenance={"command": f"jaxcal sheet {text!r}", "rate": "given"})
    screen, target = Screen(running.quiet), (out or Path(FILES[to])) if to else None
    targets = [path for path in (calibration, target) if path]
    drift = f"a random walk that drifts as much as B between means of {_WALK:g} s"
    screen.lines([*said, *(f"{name} K = {k:.4g} {noise_units('K', name)[-1]}, {drift}" for name, k in walks.items() if to)])
    with staged(targets, force=running.force) as places:
        if calibration:
            device.save(places[calibration])
        if to and target:
            jaxcal.export.write(device, places[target], format=to, force=running.force, random_walk=walks or "upper_limit")
    show_written(screen, targets)
