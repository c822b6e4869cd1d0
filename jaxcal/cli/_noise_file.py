"""Read the noise of a device from the noise.json or the calibration.json of `jaxcal noise`."""

import json
from pathlib import Path
from typing import Any

from .._errors import DataError
from ._options import CallError


def read_noise(path: Path) -> Any:
    """Read channel -> `Noise`, or a `Calibration`.

    Raises
    ------
    CallError
        If the file does not exist.
    DataError
        If the file has no noise.
    """
    if not path.exists():
        raise CallError(f"{path} does not exist; --noise takes the noise.json of jaxcal noise, or a calibration")
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise DataError(f"{path} is no JSON; --noise takes the noise.json of jaxcal noise, or a calibration") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema == "jaxcal.calibration/1":
        from ..calibration import Calibration

        return Calibration.load(path)
    if schema != "jaxcal.NoiseFits/1":
        raise DataError(f"{path} has the schema {schema!r}; --noise takes the noise.json of jaxcal noise, or a calibration")
    try:
        return {name: _noise(channel) for name, channel in document["channels"].items()}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise DataError(f"{path} is damaged ({error}); write it again with jaxcal noise") from error


def _noise(channel: dict[str, Any]) -> Any:
    from ..noise import Noise
    from ..noise._terms import PowerLaw

    known = channel["noise"]
    further = tuple((float(coefficient), PowerLaw(**shape)) for coefficient, shape in known.pop("further"))
    known.pop("cutoff", None)  # files of earlier versions have one
    return Noise(**known, further=further)
