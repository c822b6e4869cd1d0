"""`jaxcal imu`: calibrate both triads from a log of still poses and the turns between them."""

import dataclasses
import json
import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

import jaxcal

from . import _options as opt
from ._export import FILES
from ._outputs import standard
from ._work import carry_out

#: format of --export -> default name of the file
_EXPORTS = {name: FILES[name] for name in ("c", "csv")}


@dataclass(frozen=True, kw_only=True)
class ImuWriting(opt.Calibrated):
    """Where results go. By default all go into the folder LOG-imu."""

    plot: opt.Plot = None
    export: Annotated[tuple[str, ...] | None, opt.exported(*_EXPORTS)] = None


def imu(
    log: opt.Log,
    /,
    *,
    gravity: opt.Gravity | None = None,
    latitude: opt.Latitude | None = None,
    height: opt.Height = 0.0,
    convention: Annotated[Literal["upper", "lower", "full"], Parameter(help="Frame of the result: upper, lower or full.")] = "upper",
    method: Annotated[
        Literal["joint", "six_position"],
        Parameter(help="joint; six_position: a block on its six faces, in one log, in a folder of six, or as a table of means."),
    ] = "joint",
    regions: Annotated[
        Path | None, Parameter(help="JSON or CSV of labelled regions: faces and turns of a box (x_p, x_a, ..., z_rot), or rests.")
    ] = None,
    noise: opt.Noise = None,
    prior: Annotated[
        Path | None, Parameter(help="What is known before: an earlier calibration, or a data sheet as JSON; fewer poses then suffice.")
    ] = None,
    terms: Annotated[
        str, Parameter(help="Further terms: auto for what the log asks for, or names such as accel.quadratic,gyro.cubic.")
    ] = "",
    name: opt.Name = None,
    counts: Annotated[bool, Parameter(help="The log holds counts; their scale is found from the data.")] = False,
    without_g_sensitivity: Annotated[bool, Parameter(help="Leave out the gyroscope's sensitivity to acceleration.")] = False,
    earth_rate: Annotated[bool, Parameter(help="Account for the Earth's rate, with --latitude; for tactical units.")] = False,
    reading: opt.Reading = opt.Reading(),
    writing: ImuWriting = ImuWriting(),
    running: opt.Running = opt.Running(),
) -> None:
    """Calibrate accelerometer and gyroscope by hand, without a turntable.

    Leave the sensor alone for 30 s. Then hold it still for 3 s or more on
    each face, each edge and some corners, 18 to 50 poses, and turn it
    smoothly from one to the next.
    """
    options = opt.asked(locals())
    if earth_rate and latitude is None:
        raise opt.CallError("--earth-rate needs --latitude")
    if counts:
        reading = opt.in_counts(reading, "accel", "gyro")
    plan = standard(writing, "imu", log, part="imu", device=name, formats=_EXPORTS)
    opt.must_exist(regions, prior)
    asked = tuple(word for word in terms.replace(" ", "").split(",") if word)
    known = ({} if noise is None else {"noise": opt.read_noise(noise)}) | ({} if prior is None else {"prior": _prior(prior)})
    known |= {} if not asked else {"terms": "auto" if asked == ("auto",) else asked}
    place = None if latitude is None else math.radians(latitude)

    def compute(data: Any, _: Any) -> Any:
        from ..imu._session import regions_of, rests_among  # imported here, so that the help of a command need not wait for JAX

        here = float(jaxcal.imu.gravity(place, height)) if gravity is None and place is not None else gravity
        labelled = None if regions is None else regions_of(regions, data.rate)
        rests = None if labelled is None else rests_among(labelled)
        if method == "six_position" and rests is not None:
            raise opt.CallError("--method six_position needs regions of faces (x_p, x_a, ...); those of --regions are rests")
        if rests is None and (method == "six_position" or labelled is not None):
            if convention != "upper" or earth_rate or without_g_sensitivity or known:
                words = "--convention, --earth-rate, --without-g-sensitivity, --noise, --prior and --terms"
                raise opt.CallError(f"faces of a box take none of {words}")
            return jaxcal.imu.ferraris(apart or data, labelled, gravity=here, raw=counts)
        found = jaxcal.imu.multi_position(
            data, gravity=here, convention=convention, raw=counts, rests=rests, g_sensitivity=not without_g_sensitivity,
            latitude=place if earth_rate else None, **known,
        )  # fmt: skip
        return _with_delay(found, data)

    apart: list[Any] = []  # the logs of a folder with one face each
    read = partial(_read_faces, log, reading, apart) if method == "six_position" and regions is None else None
    carry_out(log, reading, running, plan, compute, read=read, command="imu", options=options).end()


def _read_faces(path: Path, reading: opt.Reading, apart: list[Any]) -> Any:
    """Read a log, a table of means, which has no time, or the logs of a folder, which are added to `apart`, as one log."""
    from ..imu._session import FEW, joined

    try:
        return opt.read_log(path, reading, "imu")
    except jaxcal.DataError as error:
        if error.code == "no_rate":
            table = opt.read_log(path, dataclasses.replace(reading, rate=1.0), "imu")
            if len(table.time) < FEW:
                return table
        if error.code != "several_logs":
            raise
    apart += [opt.read_log(file, reading, "imu") for file in sorted(path.iterdir()) if not file.name.startswith(".")]
    return joined(apart)[0]


def _with_delay(found: Any, data: Any) -> Any:
    """The result with a finding on the delay between the sensors, if the turns show one."""
    from .._answer import Quantity
    from ..imu._findings import FINDINGS
    from ..imu._motion import LEAST

    if found.verdict == "refused" or found.method != "joint" or len(found.residual_turn) < LEAST:
        return found
    delay = jaxcal.imu.motion(data, found).estimate["delay"]
    side, size = "later" if delay.value > 0 else "earlier", Quantity(abs(delay.value), "delay")
    late = FINDINGS.over("delay", max(delay.low, -delay.high), delay=size, side=side, half=Quantity(delay.half, "delay"))
    return dataclasses.replace(found, findings=(*found.findings, *late))


def _prior(path: Path) -> Any:
    """Read an earlier calibration, or a data sheet from a JSON file."""
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, ValueError) as error:
        raise jaxcal.DataError(f"{path} is no JSON; --prior takes a calibration, or a data sheet") from error
    return jaxcal.Calibration.load(path) if isinstance(document, dict) and "schema" in document else document
