"""`jaxcal export`: write a calibration as a file for another tool."""

from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Group, Parameter

import jaxcal

from .._message import Message
from ._options import WRITING, CallError, Plain, must_be_calibration
from ._outputs import distinct, replaceable, staged
from ._screen import Screen, show_written

Format = Literal["kalibr", "openvins", "vins", "orbslam3", "gtsam", "px4", "ardupilot", "ros", "imu_tk", "motioncal", "c", "csv"]
#: format -> default name of its file
FILES = {
    "kalibr": "imu.yaml", "openvins": "kalibr_imu_chain.yaml", "vins": "vins.yaml", "orbslam3": "orbslam3.yaml", "gtsam": "gtsam_imu.py",
    "px4": "px4.params", "ardupilot": "ardupilot.param", "ros": "calibration.yaml", "imu_tk": "imu.calib", "motioncal": "motioncal.bin",
    "c": "calibration.h", "csv": "calibration.csv",
}  # fmt: skip
_NOISE = Group("Noise", sort_key=5)
_FORMAT = Group("Of single formats", sort_key=6)
_IDS = {"px4": ("accel", "gyro", "mag"), "ardupilot": ("accel", "compass")}


def export(
    calibration: Annotated[
        list[Path],
        Parameter(
            consume_multiple=True,
            help="Calibration as JSON, as the other commands write it; for px4 and ardupilot several, one for each instance.",
        ),
    ],
    /,
    *,
    to: Annotated[Format, Parameter(help="The tool.")],
    out: Annotated[
        Path | None,
        Parameter(
            group=WRITING, help="File to write; by default one with the usual name, here. imu_tk writes NAME_acc.calib and NAME_gyro.calib."
        ),
    ] = None,
    ids: Annotated[
        str | None,
        Parameter(
            help="Ids by which px4 or ardupilot finds the sensors: accel=1310988,gyro=1310988,mag=396825 or accel=2753028,compass=97539."
        ),
    ] = None,
    axis: Annotated[
        Literal["worst", "rms"], Parameter(group=_NOISE, help="One number for three axes: the worst, or their root mean square.")
    ] = "worst",
    inflate: Annotated[float, Parameter(group=_NOISE, help="Factor on the noise.")] = 1.0,
    density: Annotated[
        str | None,
        Parameter(group=_NOISE, help="What to write where no N was found, in place of its limit: gyro=VALUE,accel=VALUE in SI."),
    ] = None,
    random_walk: Annotated[str | None, Parameter(group=_NOISE, help="The same for K.")] = None,
    rate: Annotated[float | None, Parameter(group=_NOISE, help="True sampling rate in Hz; by default that of the log.")] = None,
    topic: Annotated[str, Parameter(group=_FORMAT, help="ROS topic (kalibr, openvins, vins).")] = "/imu0",
    gravity: Annotated[float | None, Parameter(group=_FORMAT, help="Local gravity in m/s^2 (vins, gtsam); by default 9.80665.")] = None,
    convention: Annotated[
        Literal["midpoint", "per_sample"], Parameter(group=_FORMAT, help="Reading of the noise of vins: N sqrt(2 rate), or N sqrt(rate).")
    ] = "midpoint",
    model: Annotated[
        Literal["kalibr", "rpng"], Parameter(group=_FORMAT, help="Triangles of openvins: lower (kalibr) or upper (rpng).")
    ] = "kalibr",
    frame: Annotated[Literal["up", "down"], Parameter(group=_FORMAT, help="Direction of the z axis of gtsam.")] = "up",
    flavour: Annotated[Literal["ros2", "imu_calib", "dlio", "madgwick"], Parameter(group=_FORMAT, help="The reader of ros.")] = "ros2",
    instance: Annotated[int, Parameter(group=_FORMAT, help="Number of the sensors on the vehicle, from 0 (px4, ardupilot).")] = 0,
    gyro_bias: Annotated[
        bool, Parameter(group=_FORMAT, help="Write the gyroscope's bias too, which ardupilot learns at every start.")
    ] = False,
    prefix: Annotated[str, Parameter(group=_FORMAT, help="Of the names in c.")] = "JAXCAL_",
    accumulator: Annotated[bool, Parameter(group=_FORMAT, help="With the sums for the next magnetometer calibration in c.")] = False,
    running: Plain = Plain(),
) -> None:
    """Write a calibration in the units, signs and order of another tool.

    Warnings report what the tool cannot represent, and the resulting error.
    """
    must_be_calibration(*calibration)
    if ids is not None and to not in _IDS:
        raise CallError(f"--ids {ids}: only {' and '.join(_IDS)} find sensors by ids")
    given = ids_of(ids, _IDS.get(to, ()))
    options: dict[str, Any] = {
        "axis": axis, "inflate": inflate, "density": _values("density", density), "random_walk": _values("random-walk", random_walk),
        "rate": rate, "topic": topic, "convention": convention, "model": model, "frame": frame, "flavour": flavour, "instance": instance,
        "gyro_bias": gyro_bias, "prefix": prefix, "accumulator": accumulator,
    }  # fmt: skip
    if gravity is not None:
        options["gravity"] = gravity
    from ..export._formats import FORMATS, check_options, files_of
    from ..export._options import Options

    try:
        check_options(to, Options(**options))
    except jaxcal.ExportError as error:  # not the calibration: nothing was read yet
        raise CallError(Message("--to {to}: {error}", to=to, error=error), code=error.code) from error
    if len(calibration) > 1 and not FORMATS[to].many:
        raise CallError(f"--to {to} takes one calibration")
    target = out or Path(FILES[to])
    targets = files_of(target, to)
    screen = Screen(running.quiet)
    with staged(distinct([(path, None) for path in targets.values()]), inputs=calibration, force=running.force) as places:
        devices = [_with_ids(jaxcal.Calibration.load(path), given, to) for path in calibration]
        digest = (devices[0].provenance or {}).get("sha256") if len(devices) == 1 else ""
        replaceable(targets.values(), digest or "", force=running.force)
        place = places[targets[""]] if "" in targets else next(iter(places.values())).with_name(target.name)
        said = jaxcal.export.write(devices if len(devices) > 1 else devices[0], place, format=to, force=running.force, **options)
        written = [path for path, there in places.items() if there.exists()]
    screen.sentences("Warnings", said)
    show_written(screen, written)


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


def _values(name: str, text: str | None) -> Any:
    if text is None or text == "upper_limit":
        return "upper_limit"
    try:
        if "=" not in text:
            return float(text)
        return {sensor: float(value) for sensor, _, value in (word.partition("=") for word in text.split(","))}
    except ValueError:
        raise CallError(f"--{name} {text}: expected upper_limit, a number, or gyro=VALUE,accel=VALUE") from None
