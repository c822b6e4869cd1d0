"""The formats: who writes them, what they hold, and how their files are called."""

import pathlib
from collections.abc import Callable

import equinox as eqx

from .._errors import ExportError
from ._ardupilot import ardupilot
from ._c import header
from ._csv import table
from ._filters import gtsam, orbslam3, vins
from ._imu_tk import SUFFIXES, imu_tk
from ._kalibr import kalibr
from ._motioncal import motioncal
from ._openvins import openvins
from ._options import Options, Product
from ._px4 import px4
from ._ros import ros


class Format(eqx.Module):
    """One format.

    Attributes
    ----------
    make : function of (calibration, options); of a list of calibrations where there are `many`.
    sections : of the calibration that it uses.
    options : names of the options that mean something to it.
    mark : of its comments; "" where it has no place for them.
    after : number of lines before the first comment.
    many : whether it holds several instances of a sensor.
    """

    make: Callable[..., Product]
    sections: tuple[str, ...]
    options: tuple[str, ...] = ()
    mark: str = "#"
    after: int = 0
    many: bool = False


_NOISE = ("axis", "inflate", "density", "random_walk")
#: accepted by every format, for callers that pass them to all
_ALWAYS = ("density", "random_walk")
_FIELDS = ("imu", "magnetometer", "temperature")
FORMATS: dict[str, Format] = {
    "kalibr": Format(kalibr, ("noise",), (*_NOISE, "topic", "rate")),
    "openvins": Format(openvins, ("noise", "imu"), (*_NOISE, "topic", "rate", "model"), after=1),
    "vins": Format(vins, ("noise",), (*_NOISE, "topic", "rate", "gravity", "convention")),
    "orbslam3": Format(orbslam3, ("noise",), (*_NOISE, "rate")),
    "gtsam": Format(gtsam, ("noise",), (*_NOISE[1:], "gravity", "frame")),
    "px4": Format(px4, _FIELDS, ("instance",), many=True),
    "ardupilot": Format(ardupilot, _FIELDS, ("instance", "gyro_bias"), many=True),
    "ros": Format(ros, ("noise", *_FIELDS), ("flavour", "inflate", "rate")),
    "imu_tk": Format(imu_tk, ("imu",), mark=""),
    "motioncal": Format(motioncal, ("magnetometer",), mark=""),
    "c": Format(header, _FIELDS, ("prefix", "accumulator"), mark="//"),
    "csv": Format(table, ("noise", *_FIELDS), mark=""),
}


def format_of(name: str) -> Format:
    """The format of that name.

    Raises
    ------
    ExportError
        If there is none.
    """
    if name not in FORMATS:
        raise ExportError(f"unknown format {name!r}; expected one of {', '.join(FORMATS)}")
    return FORMATS[name]


def check_options(name: str, options: Options) -> None:
    """Refuse options that mean nothing to a format.

    Raises
    ------
    ExportError
        Naming the formats for which the option is.
    """
    kind = format_of(name)
    for option in options.chosen():
        if option not in (*kind.options, *_ALWAYS):
            known = [other for other, one in FORMATS.items() if option in one.options]
            raise ExportError(f"{option}={getattr(options, option)!r} means nothing to {name}; it is for {', '.join(known)}")


def files_of(path: pathlib.Path, name: str) -> dict[str, pathlib.Path]:
    """Suffix of the name -> file, for the files that a format may write at `path`; most write `path` itself, under ""."""
    if name != "imu_tk":
        return {"": path}
    stem = path.stem if path.suffix == ".calib" else path.name
    for suffix in SUFFIXES.values():
        stem = stem.removesuffix(suffix)
    return {suffix: path.with_name(f"{stem}{suffix}.calib") for suffix in SUFFIXES.values()}
