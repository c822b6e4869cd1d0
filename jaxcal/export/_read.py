"""`read`: read a calibration from another tool's file."""

import os
import pathlib

from .._errors import DataError
from ..calibration import Calibration
from ._formats import FORMATS, check_option


def read(path: str | os.PathLike[str], *, format: str, instance: int = 0) -> Calibration:
    """Read what a device has now, from a file of its own tool or one written by `write`.

    The result has only the numbers in the file.

    Parameters
    ----------
    path : the file.
    format : "px4", "ardupilot" or "motioncal".
    instance : index of the sensors on the vehicle, from 0; MotionCal has one.

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
    check_option("instance", instance, DataError)
    path = pathlib.Path(path)
    try:
        content = path.read_bytes() if format == "motioncal" else _text(path)
        return FORMATS[format].function(f"read_{format}")(content, {"instance": instance})
    except OSError as error:
        raise DataError(f"{path}: {(error.strerror or str(error)).lower()}", code="unreadable") from error
    except DataError as error:
        raise error.of(os.fspath(path)) from error.__cause__


def _text(path: pathlib.Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise DataError(f"it cannot be read as text: {str(getattr(error, 'strerror', error)).lower()}", code="unreadable") from error
