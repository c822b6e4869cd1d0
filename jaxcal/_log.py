"""`Log`: one recording in SI on a uniform time grid."""

from typing import Any

import equinox as eqx
import numpy as np

from ._errors import DataError
from ._types import AnyArray

#: sensor field -> channel name suffixes
_AXES = {"gyro": ("_x", "_y", "_z"), "accel": ("_x", "_y", "_z"), "mag": ("_x", "_y", "_z"), "temperature": ("",)}


class Gap(eqx.Module):
    """A stretch of missing samples: `start` (s, of the first missing sample), `length` (s), `samples` lost."""

    start: float
    length: float
    samples: int


class Log(eqx.Module):
    """One recording in SI on a uniform time grid; missing samples are NaN rows."""

    time: AnyArray
    gyro: AnyArray | None
    accel: AnyArray | None
    mag: AnyArray | None
    temperature: AnyArray | None
    rate: float
    gaps: tuple[Gap, ...]
    notes: tuple[str, ...]
    warnings: tuple[str, ...]
    provenance: dict[str, Any]

    def __init__(self, time, gyro=None, accel=None, mag=None, temperature=None, rate=None, *, notes=(), warnings=(), provenance=None):
        raise DataError("not written yet")

    def channels(self) -> dict[str, np.ndarray]:
        """Every channel as a name -> (n,) array map: gyro_x .. mag_z, temperature."""
        found = {}
        for field, suffixes in _AXES.items():
            values = getattr(self, field)
            if values is None:
                continue
            columns = values.reshape(len(values), -1)
            found |= {field + suffix: columns[:, i] for i, suffix in enumerate(suffixes)}
        return found
