"""`jaxcal mag`: hard and soft iron of a magnetometer from a log in many attitudes."""

import contextlib
import dataclasses
import difflib
import importlib.util
import inspect
import math
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from .._answer import things_to_know
from . import _options as opt
from ._apply import save_sensors
from ._cache import keep_compiled
from ._export import FILES
from ._flown import each, flown, of_place
from ._outputs import FINDINGS, standard
from ._screen import Screen
from ._shots import COUNTS, NO_TIMES, Shots, ready, shots
from ._work import carry_out

_MICRO = 1e-6
_NO_MAG = "the log has no magnetometer of three axes; name its columns with --columns mag=mx,my,mz"
#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("motioncal", "c", "csv")}
_MODELS = ("auto", "sphere", "diagonal", "symmetric", "planar")
#: formats that --against reads
_PARAMETERS = ("ardupilot", "px4", "motioncal")


@dataclass(frozen=True, kw_only=True)
class Writing(opt.Calibrated):
    """Where results go. By default all except the corrected log go into the folder LOG-mag."""

    plot: opt.Plot = None
    corrected: Annotated[Path | None, opt.log_file("--corrected", "Corrected log: FILE.csv or FILE.npz.")] = None
    export: Annotated[tuple[str, ...] | None, opt.exported(*_EXPORTS)] = None


def mag(
    log: opt.Log | None = None,
    /,
    *,
    model: Annotated[
        str,
        Parameter(
            help="What to fit: sphere (hard iron), diagonal, symmetric (soft iron), or planar for turns about one axis. Or FILE.py:CLASS, "
            "a MagModel of your own; its measure takes temperature, time and --currents by their names."
        ),
    ] = "auto",
    field: opt.Field | None = None,
    inclination: Annotated[
        opt.Dip | None,
        Parameter(help="Dip of the field in degrees, for the heading error; else that of --place, or what the accelerometer shows."),
    ] = None,
    place: Annotated[
        tuple[float, float] | None, Parameter(help="Latitude and longitude in degrees: field and dip by the World Magnetic Model.")
    ] = None,
    date: Annotated[str | None, Parameter(help="Day of the log for --place, as 2026-05-31.")] = None,
    align: Annotated[
        Literal["none", "accel", "gyro", "attitude"] | None,
        Parameter(
            help="Fit with a second sensor, which shows the rotation: by poses at rest (accel), rates (gyro), or the attitudes in a flight "
            "log (attitude; its default)."
        ),
    ] = None,
    headings: Annotated[
        str | None,
        Parameter(help="Column of known magnetic headings, or heading,roll,pitch, in degrees: for vehicles that stay level too."),
    ] = None,
    heading_error: Annotated[
        float,
        opt.checked("--heading-error", lambda off: 0 <= off < 90, "degrees from 0 on", "By what all known headings may be off (1 sigma)."),
    ] = 0.0,
    currents: Annotated[
        str | None, Parameter(help="Columns of motor currents or throttles, such as I1,I2; or time or temperature: fits the field of each.")
    ] = None,
    check: Annotated[
        int | None,
        opt.checked(
            "--check", lambda n: n >= 2, "a number from 2 on", "Hold every Nth reading (or known heading) back, and check the fit on them."
        ),
    ] = None,
    against: Annotated[
        Path | None, Parameter(help="What the device has now, as JSON or parameters of ArduPilot or PX4: by how much headings would turn.")
    ] = None,
    next: Annotated[bool, Parameter(help="Only say which attitude to take next, or to stop; nothing is written.")] = False,
    limit: Annotated[
        float,
        opt.checked("--limit", lambda limit: 0 < limit < 90, "degrees above 0", "Heading error in degrees at which to stop."),
    ] = 1.0,
    live: Annotated[
        str | None,
        Parameter(
            allow_leading_hyphen=True,
            help="Record LOG (else mag-DATE.csv) from a serial port, as /dev/ttyUSB0, or a pipe (-), with a page that says where to turn, "
            "until the heading error is below --limit.",
        ),
    ] = None,
    baud: Annotated[int, Parameter(help="Speed of the serial port of --live.")] = 115200,
    reading: opt.Reading = opt.Reading(),
    writing: Writing = Writing(),
    running: opt.Running = opt.Running(),
) -> None:
    """Calibrate a magnetometer (hard and soft iron) from a log in all attitudes.

    The result has the matrix and the offset that correct a reading, the
    expected heading error and a verdict. A refused fit ends with status 1.
    """
    if headings is not None and align not in (None, "none"):
        raise opt.CallError("--headings gives the rotation itself: leave out --align", "headings_alone")
    if currents is not None and model == "planar":
        raise opt.CallError("--currents goes with fits of magnitudes in all attitudes: leave out --model planar", "currents_in_plane")
    wanted = _wanted(model)
    opt.must_exist(against, option="--against")
    if log is None and live is None:
        raise opt.CallError("jaxcal mag needs LOG: jaxcal mag tumble.csv", "no_log")
    if live is not None:
        from ._live import recorded  # a system without serial ports of this kind has no termios

        dip = None if inclination is None else math.radians(inclination)
        target = log or Path(f"mag-{time.strftime('%Y%m%d-%H%M%S')}.csv")
        log = recorded(live, target, baud, math.radians(limit), dip, Screen(running.quiet), running.force)
    assert log is not None
    if next:
        _advise(log, reading, running, limit, inclination)
        return
    present, flight = None if against is None else _present(against), flown(log, align, headings is not None)
    align = (align or "none") if flight is None else "attitude"
    options = {
        "model": model, "field": field, "inclination": inclination, "place": place, "date": date, "align": align,
        "headings": headings, "heading_error": heading_error, "currents": currents, "check": check,
    }  # fmt: skip
    earth, notes = _earth(field, place, date), list[str]()
    if flight is not None and earth is None and inclination is None:
        earth, notes = of_place(flight, options)
    chosen = {"model": wanted, "field": earth, "inclination": None if inclination is None else math.radians(inclination)}

    def one(reading: opt.Reading, writing: Writing, default: str, device: Any) -> None:
        fields: dict[str, Any] = {}

        def compute(recording: Any, _: Any) -> Any:
            if recording.mag is None or recording.mag.shape[1] != 3:
                raise jaxcal.DataError(_NO_MAG, code="no_mag")
            if align == "gyro" and "no_clock" in recording.codes:
                raise jaxcal.DataError("--align gyro needs times, and the log has none: give --rate", code="no_rate")
            given = shots(log, reading, recording, headings, currents, check)
            fields.update(given.currents)
            found = _fit(recording, align, chosen, given, flight, math.radians(heading_error))
            return found if present is None or found.model is None else _compared(against, present, found)

        plan = standard(
            writing, "mag", log, ("corrected", "", partial(_corrected, fields)), part="magnetometer", device=device,
            default="" if writing.corrected else default, formats=_EXPORTS, readings=_readings,
        )  # fmt: skip
        reading, said = ready(log, reading, align == "gyro")
        change = partial(_noted, [*said, *notes], "" if flight is None else ", ".join(reading.topics or ()))
        carry_out(log, reading, running, plan, compute, change=change, command="mag", options=options).end()

    each(one, flight, reading, writing, opt.folder(log, "mag"))


def _wanted(model: str) -> Any:
    """A model of jaxcal by its name, or the start of an own one, whose further fields begin at their defaults, or else at zero."""
    import numpy as np

    if model in _MODELS:
        return model
    name, _, wanted = model.rpartition(":")
    if not name.endswith(".py"):
        close = difflib.get_close_matches(model, _MODELS, 1)
        meant = f'. Did you mean "{close[0]}"?' if close else ""
        raise opt.CallError(f"--model {model}: expected {', '.join(_MODELS)}, or FILE.py:CLASS{meant}", "model")
    opt.must_exist(Path(name), option="--model")
    spec: Any = importlib.util.spec_from_file_location(f"jaxcal_model_{Path(name).stem}", name)
    sys.modules[spec.name] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever the file of the user does
        raise opt.CallError(f"--model {model}: {name} does not run: {type(error).__name__}: {error}", "model_file") from error
    kind = getattr(module, wanted, None)
    if kind is None:
        raise opt.CallError(f"--model {model}: {name} has no class {wanted}", "model_class")
    if not (isinstance(kind, type) and issubclass(kind, jaxcal.magnetometer.MagModel)):
        raise opt.CallError(f"--model {model}: {wanted} is no subclass of jaxcal.magnetometer.MagModel", "model_kind")
    further = [one for one in dataclasses.fields(kind)[2:] if one.default is one.default_factory is dataclasses.MISSING]
    return kind(np.eye(3), np.zeros(3), **{one.name: np.zeros(3) for one in further})


def _noted(said: list[str], compass: str, log: Any) -> Any:
    """The log with notes on how the command read it, and the name of the compass of a flight."""
    named: dict[str, Any] = {"quantity": f"magnetometer {compass}"} if compass else {}
    found = log.findings
    if COUNTS in said:  # which the reader takes as tesla
        named["units"] = {**log.provenance["units"], "mag": "counts"}
        found = tuple(one for one in found if (one.code, one.subject) != ("read_as", ("mag",)))
    return log._replaced(
        findings=(*found, *(FINDINGS("no_times" if one == NO_TIMES else "read_so", said=one) for one in said)),
        provenance={**log.provenance, **named},
    )


def _advise(path: Path, reading: opt.Reading, running: opt.Running, limit: float, inclination: float | None) -> None:
    """Print the next attitude to take."""
    reading, _ = ready(path, reading, False)
    log = opt.read_log(path, reading, "mag")
    if log.mag is None or log.mag.shape[1] != 3:
        raise jaxcal.DataError(_NO_MAG, code="no_mag")
    keep_compiled()
    dip = None if inclination is None else math.radians(inclination)
    found = jaxcal.magnetometer.guide(_readings(None, log), limit=math.radians(limit), inclination=dip)
    screen = Screen(running.quiet)
    screen.line(found.reason)
    if found.fit is not None:
        screen.lines(things_to_know(found.fit.findings, **running.how))


def _present(path: Path) -> Any:
    """Read the magnetometer's model from a calibration as JSON, or from a file of another tool."""
    if path.suffix.lower() == ".json":
        part = jaxcal.Calibration.load(path).magnetometer
        if part is None:
            raise opt.CallError(f"--against {path}: the calibration has no magnetometer")
        return part.model
    for format in _PARAMETERS:
        with contextlib.suppress(jaxcal.DataError):
            part = jaxcal.export.read(path, format=format).magnetometer
            if part is not None:
                return part.model
    raise opt.CallError(f"--against {path}: expected a calibration as JSON, or a file of {', '.join(_PARAMETERS)} with a magnetometer")


def _compared(path: Path | None, present: Any, found: Any) -> Any:
    """The fit, with a finding on how much it changes headings and hard iron."""
    import numpy as np

    from .._answer import Quantity
    from ..magnetometer._findings import FINDINGS as OF_MAG
    from ..magnetometer._judge import heading_change
    from ..magnetometer._model import quantity_of

    turns = heading_change(present, found.model, float(found.field), inclination=float(found.inclination), down=found.down)
    rms, moved = np.sqrt(np.mean(turns**2)), np.linalg.norm(np.asarray(found.model.hard_iron) - np.asarray(present.hard_iron))
    facts: dict[str, Any] = {"rms": Quantity(float(rms), "angle"), "most": Quantity(float(np.abs(turns).max()), "angle"),
             "moved": Quantity(float(moved), quantity_of(found.field))}  # fmt: skip
    code = "changed" if rms > 2 * found.heading_error[0] else "unchanged"
    return dataclasses.replace(found, findings=(*found.findings, OF_MAG(code, cost=rms, file=str(path), **facts)))


def _earth(field: float | None, place: tuple[float, float] | None, date: str | None) -> Any:
    """Magnitude of the field in tesla, its vector, or None."""
    if (place is None) != (date is None):
        raise opt.CallError("--place and --date go together: --place 39.93 32.86 --date 2026-05-31")
    if place is None or date is None:
        return None if field is None else field * _MICRO
    if field is not None:
        raise opt.CallError("--field and --place exclude one another: the place gives the field")
    if abs(place[0]) > 90 and abs(place[1]) <= 90:
        raise opt.CallError(f"--place {place[0]:g} {place[1]:g}: the latitude comes first: --place {place[1]:g} {place[0]:g}")
    when = opt.day(date)
    try:
        return jaxcal.magnetometer.earth_field(*place, when)
    except (ValueError, jaxcal.DataError) as error:  # nothing was read yet
        raise opt.CallError(f"--place {place[0]:g} {place[1]:g} --date {date}: {error}") from error


def _fit(log: Any, align: str, options: dict[str, Any], given: Shots, flight: Any, off: float) -> Any:
    import numpy as np

    if align in ("accel", "gyro") and getattr(log, align) is None:
        raise jaxcal.DataError(f"--align {align}: the log has no {align}; name its columns with --columns {align}=...")
    from .._frozen import replaced
    from ..magnetometer import Accelerometer, Attitude, Gyroscope, Headings

    flown = None if flight is None else flight.at(log)
    up = (log.accel if flown is None else Attitude(flown).accel) if given.up is None else given.up
    there = np.isfinite(log.mag).all(axis=1)
    kept, held = there & ~given.held, there & given.held
    # rates are integrated over all samples
    rows = np.ones_like(kept) if align == "gyro" else kept
    # without --align the accelerometer is used for the dip only, not for the rotation
    accel = log.accel if log.accel is not None and log.accel.shape[1] == 3 else None
    aid: Any = None if accel is None else Accelerometer(accel[rows], turns=align == "accel")
    if align == "gyro":
        aid = Gyroscope(log.gyro, log.rate)
    if flown is not None:
        aid = Attitude(flown[rows])
    if given.headings is not None:
        aid = Headings(given.headings[rows], None if up is None else up[rows], error=off)
    own = not isinstance(options["model"], str)

    def conditions_of(rows: Any) -> dict[str, Any]:
        warmth = {} if log.temperature is None else _conditions(log.temperature[rows])
        if not own:
            return {} if given.currents else warmth
        known = warmth | {name: values[rows] for name, values in ({"time": log.time} | given.currents).items()}
        return {name: known[name] for name in inspect.signature(options["model"].measure).parameters if name in known}

    recorded = conditions_of(kept)
    currents = {name: values[rows] for name, values in given.currents.items() if name not in recorded}
    m = np.where(kept[:, None], log.mag, np.nan)[rows]
    found: Any = jaxcal.magnetometer.fit(m, conditions=recorded, aid=aid, currents=currents, **options)
    if found.model is None:
        return found
    tried_on = held if given.held.any() else kept & np.isfinite(given.headings) if given.headings is not None else held
    if tried_on.any() and found.kind != "planar":
        known = None if given.headings is None else given.headings[tried_on]
        mag = log.mag
        for name in currents:  # readings without the fields of the currents that the fit has found
            mag = mag - given.currents[name][:, None] * [[found.estimate[f"currents.{name}[{i}]"].value for i in range(3)]]
        aside = {"headings": known, "conditions": conditions_of(tried_on) if own else {}}
        seen = jaxcal.magnetometer.check(found, mag[tried_on], accel=None if up is None else up[tried_on], **aside)
        found = replaced(found, check=seen, findings=(*found.findings, *seen.findings))
    return found


def _conditions(temperature: Any) -> dict[str, Any]:
    """The temperature as a condition, if every reading has one."""
    import numpy as np

    return {"temperature": np.ravel(temperature)} if np.isfinite(temperature).all() and temperature.size == len(temperature) else {}


def _readings(found: Any, log: Any) -> Any:
    import numpy as np

    return log.mag[np.isfinite(log.mag).all(axis=1)]


def _corrected(currents: dict[str, Any], place: Path, found: Any, log: Any) -> None:
    save_sensors(jaxcal.Calibration(magnetometer=found, provenance=log.provenance).correct(log, currents=currents), place)
