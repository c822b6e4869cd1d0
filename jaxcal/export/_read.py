"""`read`: read a calibration from another tool's file."""

import os
import pathlib

from .._errors import DataError
from ..calibration import Calibration
from ._formats import FORMATS, IMU_TK, check_option, files_of


def read(path: str | os.PathLike[str], *, format: str, rate: float | int | None = None, instance: int = 0) -> Calibration:
    """Read a file that was written by `write` or by the tool itself.

    The result has only the numbers in the file. If the file has one number for three axes, each axis gets this number.

    Parameters
    ----------
    path : the file; for "imu_tk" the name given to `write`, or one of its two files.
    format : "kalibr" (`imu.yaml`, or Kalibr's calibration result with matrices), "openvins", "px4", "ardupilot", "imu_tk" or
        "motioncal".
    rate : sampling rate in Hz; replaces that of the file, and is required if the file does not state it.
    instance : index of the sensors on the vehicle, from 0, for "px4" and "ardupilot".

    Returns
    -------
    Calibration
        With the sections that the file contains.

    Raises
    ------
    DataError
        If the file cannot be read, is not of this format, or holds numbers that no calibration can have.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import jaxcal
    >>> mag = {"unit": "T", "soft_iron": [[1.1, 0, 0], [0, 1, 0], [0, 0, 1]], "hard_iron": [1e-5, 0, 0], "field": 5e-5, "covariance": None}
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "compass.bin")
    ...     findings = jaxcal.export.write(jaxcal.Calibration(magnetometer=mag), path, format="motioncal")
    ...     print(jaxcal.export.read(path, format="motioncal").magnetometer.model.hard_iron)
    [1.e-05 0.e+00 0.e+00]
    """
    if format not in FORMATS or not FORMATS[format].readable:
        readable = ", ".join(name for name, one in FORMATS.items() if one.readable)
        raise DataError(f"format={format!r} cannot be read back; expected one of {readable}", code="format")
    given = {"rate": rate, "instance": instance}
    for name in (name for name, value in given.items() if value is not None):
        check_option(name, given[name], DataError)
    path = pathlib.Path(path)
    try:
        content = {"imu_tk": _imu_tk_texts, "motioncal": pathlib.Path.read_bytes}.get(format, _text)(path)
        return FORMATS[format].function(f"read_{format}")(content, given)
    except OSError as error:
        raise DataError(f"{path}: {(error.strerror or str(error)).lower()}", code="unreadable") from error
    except DataError as error:
        raise error.of(os.fspath(path)) from error.__cause__


def _imu_tk_texts(path: pathlib.Path) -> dict[str, str]:
    for sensor, suffix in IMU_TK.items():
        if path.stem.endswith(suffix) and path.is_file():
            return {sensor: _text(path)}
    files = files_of(path, "imu_tk")
    found = {sensor: _text(files[suffix]) for sensor, suffix in IMU_TK.items() if files[suffix].is_file()}
    if not found:
        raise DataError(f"neither {' nor '.join(str(file) for file in files.values())} is there", code="unreadable")
    return found


def _text(path: pathlib.Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"it cannot be read as text: {str(getattr(error, 'strerror', error)).lower()}", code="unreadable") from error
