"""The table of formats: writer, reader, contents, options and file names."""

import pathlib
from collections.abc import Callable

import equinox as eqx

from .._errors import ExportError
from ..calibration import Calibration
from . import _csv, _filters, _flight_controllers, _imu_tk, _motioncal, _ros
from ._c import header
from ._options import Options, Product


class Format(eqx.Module):
    """One format."""

    make: Callable[..., Product]  # takes (calibration, options), or (list of calibrations, options) if `many`
    read: Callable[..., Calibration] | None  # takes (content of a file, options)
    sections: tuple[str, ...]  # sections of the calibration that the format uses
    options: tuple[str, ...] = ()  # options that the format uses
    mark: str = "#"  # mark of a comment line; "" if the format has no comments
    after: int = 0  # number of lines before the first comment
    many: bool = False  # whether a file can hold several instances of a sensor
    counts: bool = False  # whether a magnetometer in counts has a place


_NOISE = ("axis", "inflate", "density", "random_walk")
#: options that every format accepts, so that callers can pass them to all formats
_ALWAYS = ("density", "random_walk")
_FIELDS = ("imu", "magnetometer", "temperature")
FORMATS: dict[str, Format] = {
    "kalibr": Format(_filters.kalibr, _filters.read_kalibr, ("noise",), (*_NOISE, "topic", "rate")),
    "openvins": Format(_filters.openvins, _filters.read_openvins, ("noise", "imu"), (*_NOISE, "topic", "rate", "model"), after=1),
    "vins": Format(_filters.vins, _filters.read_vins, ("noise",), (*_NOISE, "topic", "rate", "gravity", "convention")),
    "orbslam3": Format(_filters.orbslam3, _filters.read_orbslam3, ("noise",), (*_NOISE, "rate")),
    "gtsam": Format(_filters.gtsam, None, ("noise",), (*_NOISE[1:], "gravity", "frame")),
    "px4": Format(_flight_controllers.px4, _flight_controllers.read_px4, _FIELDS, ("instance",), many=True),
    "ardupilot": Format(_flight_controllers.ardupilot, _flight_controllers.read_ardupilot, _FIELDS, ("instance", "gyro_bias"), many=True),
    "ros": Format(_ros.ros, _ros.read_ros, ("noise", *_FIELDS), ("flavour", "inflate", "rate")),
    "imu_tk": Format(_imu_tk.imu_tk, _imu_tk.read_imu_tk, ("imu",), mark=""),
    "motioncal": Format(_motioncal.motioncal, _motioncal.read_motioncal, ("magnetometer",), mark=""),
    "c": Format(header, None, _FIELDS, ("prefix", "accumulator"), mark="//", counts=True),
    "csv": Format(_csv.table, _csv.read_table, ("noise", *_FIELDS), mark="", counts=True),
}


def check_options(name: str, options: Options) -> Format:
    """Return the format of that name; raise an error if it is unknown or does not use one of the given options."""
    if name not in FORMATS:
        raise ExportError(f"unknown format {name!r}; expected one of {', '.join(FORMATS)}", code="format")
    kind = FORMATS[name]
    for option in options.chosen():
        if option not in (*kind.options, *_ALWAYS):
            known = [other for other, one in FORMATS.items() if option in one.options]
            raise ExportError(f"{option}={getattr(options, option)!r} means nothing to {name}; it is for {', '.join(known)}", code="option")
    return kind


def files_of(path: pathlib.Path, name: str) -> dict[str, pathlib.Path]:
    """Suffix of the name -> file, for all files that a format may write at `path`; for most formats {"": path}."""
    if name != "imu_tk":
        return {"": path}
    stem = path.stem if path.suffix == ".calib" else path.name
    for suffix in _imu_tk.SUFFIXES.values():
        stem = stem.removesuffix(suffix)
    return {suffix: path.with_name(f"{stem}{suffix}.calib") for suffix in _imu_tk.SUFFIXES.values()}
