"""The sections of a calibration: what each must hold, and what its numbers must allow."""

import math
from typing import Any

import numpy as np

from .._errors import DataError
from .._units import si_unit
from . import _thermal
from ._form import Nullable, checked, free, wrong

#: a number above this is damage; raw counts per SI unit stay far below it
_LARGEST = 1e15
_CONDITION = 1e10
_VERDICT = {"verdict?": str, "verdict_reason?": str}
_COVARIANCE = Nullable({"parameters": [str], "values": (None, None)})
_INTERVAL = {"low": (None,), "high": (None,)}
_FORMS: dict[str, dict[str, Any]] = {
    "imu": {
        "accel?": {
            "unit": si_unit("accel"), "matrix": (3, 3), "bias": (3,), "covariance": _COVARIANCE, "interval?": _INTERVAL,
        },
        "gyro?": {
            "unit": si_unit("gyro"), "matrix": (3, 3), "bias": (3,), "g_sensitivity": (3, 3), "covariance": _COVARIANCE,
            "interval?": _INTERVAL,
        },
        **_VERDICT,
    },
    "magnetometer": {
        "unit": si_unit("mag"),
        "soft_iron": (3, 3),
        "hard_iron": (3,),
        "field": Nullable(float),
        "covariance": _COVARIANCE,
        **_VERDICT,
    },
    "temperature": _thermal.FORM,
}  # fmt: skip


def section(value: Any, name: str) -> dict[str, Any] | None:
    """A section that holds what it must, or None.

    Raises
    ------
    DataError
        If a key is missing or holds something else than it should; the message names it.
    """
    if value is None:
        return None
    found = checked(value, _FORMS[name], name)
    if name == "imu":
        for sensor in ("accel", "gyro"):
            if sensor in found:
                _check_triad(found[sensor], f"imu.{sensor}")
    elif name == "magnetometer":
        _check_matrix(found["soft_iron"], "magnetometer.soft_iron")
        _check_finite(found["hard_iron"], "magnetometer.hard_iron")
        field = found["field"]
        if field is not None and (math.isinf(field) or field <= 0):
            raise wrong(field, "the norm of the field in tesla, or None", "magnetometer.field")
        _check_covariance(found["covariance"], "magnetometer.covariance")
    else:
        _thermal.check(found)
    return found


def free_section(value: Any, name: str) -> dict[str, Any] | None:
    """A dictionary of the user's own, or None."""
    if value is not None and not isinstance(value, dict):
        raise wrong(value, "a dictionary", name)
    return free(value, name)


def _check_triad(part: dict[str, Any], path: str) -> None:
    _check_matrix(part["matrix"], f"{path}.matrix")
    _check_finite(part["bias"], f"{path}.bias")
    if "g_sensitivity" in part:
        _check_finite(part["g_sensitivity"], f"{path}.g_sensitivity")
    _check_covariance(part["covariance"], f"{path}.covariance")


def _check_matrix(matrix: np.ndarray, path: str) -> None:
    _check_finite(matrix, path)
    if not np.linalg.cond(matrix) < _CONDITION:
        raise wrong(matrix.tolist(), "a matrix that has an inverse", path)


def _check_finite(values: np.ndarray, path: str) -> None:
    if not np.all(np.abs(values) < _LARGEST):
        raise wrong(values.tolist(), f"finite numbers below {_LARGEST:g}", path)


def _check_covariance(covariance: dict[str, Any] | None, path: str) -> None:
    if covariance is None:
        return
    size = len(covariance["parameters"])
    if covariance["values"].shape != (size, size):
        rows, columns = covariance["values"].shape
        raise DataError(f"{path}.values has {rows} rows and {columns} columns; expected {size} of each, as {path}.parameters names")
