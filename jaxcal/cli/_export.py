"""`jaxcal export`: write a calibration as a file for another tool. The table of formats makes its options."""

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

import jaxcal

from .._answer import things_to_know
from ..export._formats import FORMATS, OPTIONS, checked_options
from ._options import WRITING, CallError, Plain, Reading, amounts, must_be_calibration, read_log
from ._outputs import replaceable, staged
from ._screen import Screen, show_written

#: format -> default name of its file
FILES = {name: one.file for name, one in FORMATS.items()}
#: format -> its sensors that have ids
IDS = {"px4": ("accel", "gyro", "mag"), "ardupilot": ("accel", "compass")}
#: options that are files
_FILES = {"motion": "--for", "earlier": "--earlier"}
_CALIBRATION = Annotated[
    list[Path],
    Parameter(
        consume_multiple=True, help="Calibration as JSON, as other commands write it; for px4 and ardupilot several, one for each instance."
    ),
]  # fmt: skip
_TO = Annotated[Literal[tuple(FORMATS)], Parameter(help="The tool. Its own options: jaxcal export --to TOOL --help.")]
_OUT = Annotated[Path | None, Parameter(group=WRITING, help="File to write; by default one with the usual name, here.")]
_ABOUT = """Write a calibration in the units, signs and order of another tool.

It says what the tool cannot represent, and the resulting error.
"""


def export_to(format: str) -> Callable[..., None]:
    """The command `jaxcal export` with the options of one format, or with those of all formats alone if it is ""."""

    def export(calibration=(), /, *, to, out=None, ids=None, running=Plain(), **options):
        _write(calibration, to, out, ids, running, options)

    group = Group(f"Of {format}", sort_key=5)
    own = {name: _annotation(name, group) for name in (FORMATS[format].options if format else ())}
    if format in IDS:
        pairs = ",".join(f"{sensor}=NUMBER" for sensor in IDS[format])
        own["ids"] = Annotated[str | None, Parameter(group=group, help=f"Ids by which the vehicle finds its sensors: {pairs}.")]
    types = {"to": _TO, "out": _OUT, **own, "running": Plain}
    defaults = {"to": inspect.Parameter.empty, "running": Plain(), **{name: False for name in own if own[name].__origin__ is bool}}
    alone = {"default": ()} if "solver" in own else {}  # the code for a device needs no calibration
    known = [inspect.Parameter("calibration", inspect.Parameter.POSITIONAL_ONLY, annotation=_CALIBRATION, **alone)]
    known += [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=defaults.get(name), annotation=one) for name, one in types.items()
    ]
    export.__signature__ = inspect.Signature(known)  # type: ignore[attr-defined]
    export.__annotations__ = {one.name: one.annotation for one in known}
    export.__doc__ = _ABOUT
    return export


def _annotation(name: str, group: Group) -> Any:
    default, right, _, help = OPTIONS[name]
    kind: Any = Literal[right] if isinstance(right, tuple) else float if name == "rate" else type(default)
    shown = "" if default in (None, False) else f" Default: {default}."
    if name in _FILES:
        return Annotated[Path | None, Parameter(name=_FILES[name], group=group, help=help)]
    return Annotated[bool if kind is bool else kind | None, Parameter(group=group, help=help + shown, show_default=False)]


def _write(calibration: list[Path], to: str, out: Path | None, ids: str | None, running: Plain, options: dict[str, Any]) -> None:
    must_be_calibration(*calibration, *([options["earlier"]] if options.get("earlier") else []))
    if not calibration and not options.get("solver"):
        raise CallError("export needs a calibration, as other commands write it, or --solver", "no_calibration")
    given = ids_of(ids, IDS.get(to, ()))
    options = {name: value for name, value in options.items() if value is not None and value is not False}
    if walk := options.get("random_walk"):
        options["random_walk"] = amounts("--random-walk", walk, "gyro=2e-6") if "=" in walk else None if walk == "none" else walk
    motion, earlier = options.pop("motion", None), options.pop("earlier", None)
    try:
        checked_options(to, options)
    except jaxcal.ExportError as error:  # not the calibration: nothing was read yet
        raise CallError(error.args[0], error.code) from error
    if len(calibration) > 1 and not FORMATS[to].many:
        raise CallError(f"--to {to} takes one calibration", "several")
    target = out or Path(FILES[to])
    screen = Screen(running.quiet)
    with staged([target], inputs=calibration, force=running.force) as places:
        devices = [_with_ids(jaxcal.Calibration.load(path), given, to) for path in calibration] or [jaxcal.Calibration()]
        digest = (devices[0].provenance or {}).get("sha256") if len(devices) == 1 else ""
        replaceable([target], digest or "", force=running.force)
        options |= {"earlier": jaxcal.Calibration.load(earlier)} if earlier else {}
        if motion is not None:
            options["motion"] = motion_of(motion, devices[0])
        found = jaxcal.export.write(devices if len(devices) > 1 else devices[0], places[target], format=to, force=running.force, **options)
    screen.lines(things_to_know(found, reader="terminal", verbose=True))
    show_written(screen, [target])


def motion_of(path: Path, device: Any) -> Any:
    """The motion in a log, corrected by the calibration of the device where that has its sensors."""
    log = read_log(path, Reading(), "export")
    return jaxcal.budget.Motion.of(log if device.imu is None else device.correct(log))


def ids_of(text: str | None, sensors: tuple[str, ...]) -> dict[str, int]:
    """Parse ids of `sensors` from SENSOR=NUMBER,...; the keys are their names in a calibration."""
    found = {}
    for word in text.split(",") if text else ():
        sensor, _, value = word.partition("=")
        if sensor not in sensors or not (value.isascii() and value.isdigit()):
            expected = ",".join(f"{name}=NUMBER" for name in sensors)
            raise CallError(f"--ids {text}: expected {expected}, as in the parameter list of the vehicle", "ids")
        found[f"{sensor}_id"] = int(value)
    return found


def _with_ids(calibration: Any, ids: dict[str, int], tool: str) -> Any:
    if not ids:
        return calibration
    import equinox as eqx

    device = dict(calibration.device or {})
    device[tool] = (device[tool] if isinstance(device.get(tool), dict) else {}) | ids
    return eqx.tree_at(lambda one: one.device, calibration, device, is_leaf=lambda x: x is None or x is calibration.device)
