"""Undo the calibration that a flight controller applied before logging, with the parameters in the log."""

from collections.abc import Mapping

import numpy as np

from ..._errors import DataError
from ..._message import Message


def _cannot(why: str) -> DataError:
    """Error for a calibration that cannot be undone."""
    return DataError(Message("{option.raw:True}: {why}; read it without, or record the raw topics", why=why), code="raw")


def undo_px4(name: str, values: np.ndarray, device: int | None, parameters: Mapping[str, float], changed: set[str]) -> np.ndarray:
    """Values (n, 3) of a PX4 sensor before calibration: ``scale^-1 R^T x + offset``.

    `device` is the id of the sensor, or None if it is unknown; then the log must have a single calibration. `changed` are the names of the
    parameters that changed during the log.
    """
    group, thermal = {"gyro": ("CAL_GYRO", "TC_G_ENABLE"), "accel": ("CAL_ACC", "TC_A_ENABLE"), "mag": ("CAL_MAG", "TC_M_ENABLE")}[name]
    slots = {int(found): f"{group}{slot}_" for slot in range(4) if (found := parameters.get(f"{group}{slot}_ID", 0))}
    if device is None and len(slots) == 1:
        device = next(iter(slots))
    if device not in slots:
        raise _cannot(f"the log holds no {group}n_ID for {name} (device {device}; there are {sorted(slots)})")
    prefix = slots[device]
    if parameters.get(thermal, 0):
        raise _cannot(f"the thermal compensation of {name} was on ({thermal}), and its temperature is not in the topic")
    odd = [*(f"SENS_BOARD_{axis}_OFF" for axis in "XYZ"), *(f"{prefix}{axis}COMP" for axis in "XYZ")]
    odd = [key for key in odd if parameters.get(key, 0)]
    if odd:
        raise _cannot(f"{', '.join(odd)} cannot be undone")
    _constant([key for key in changed if key.startswith((prefix, "SENS_BOARD"))])
    own = parameters.get(f"{prefix}ROT", -1)
    values = values @ _rotation(int(own if own >= 0 else parameters.get("SENS_BOARD_ROT", 0)))
    if name == "mag":
        values = np.linalg.solve(_symmetric(parameters, prefix + "{}SCALE", prefix + "{}ODIAG"), values.T).T
    elif name == "accel":
        values = values / _vector(parameters, prefix + "{}SCALE", 1.0)
    return values + _vector(parameters, prefix + "{}OFF", 0.0)


def undo_ardupilot(name: str, values: np.ndarray, instance: int, parameters: Mapping[str, float], changed: set[str]) -> np.ndarray:
    """Values (n, 3) of an ArduPilot IMU before calibration: ``R^T x / scale + offset``; for the arguments see `undo_px4`."""
    base = f"INS_{'ACC' if name == 'accel' else 'GYR'}{_number(instance)}"
    needed = [f"{base}{kind}_{axis}" for kind in (("OFFS", "SCAL") if name == "accel" else ("OFFS",)) for axis in "XYZ"]
    _complete(needed, parameters)
    _constant([key for key in changed if key in needed or key == "AHRS_ORIENTATION"])
    if parameters.get(f"INS_TCAL{instance + 1}_ENABLE", 0) == 1:
        raise _cannot(f"the thermal compensation was on (INS_TCAL{instance + 1}_ENABLE)")
    values = values @ _rotation(int(parameters.get("AHRS_ORIENTATION", 0)))
    if name == "accel":
        values = values / _vector(parameters, f"{base}SCAL_{{}}", 1.0)
    return values + _vector(parameters, f"{base}OFFS_{{}}", 0.0)


def undo_compass(field: np.ndarray, added: np.ndarray, instance: int, parameters: Mapping[str, float], changed: set[str]) -> np.ndarray:
    """ArduPilot's field (n, 3) before correction: ``D^-1 field / scale - added``; `added` (n, 3) is the sum of the logged offsets."""
    number = _number(instance)
    names = [f"COMPASS_{kind}{number}_{axis}" for kind in ("DIA", "ODI") for axis in "XYZ"]
    _complete(names, parameters)
    _constant([key for key in changed if key in names])
    matrix = _symmetric(parameters, f"COMPASS_DIA{number}_{{}}", f"COMPASS_ODI{number}_{{}}")
    if not matrix.any():
        matrix = np.eye(3)  # all zeros: the compass was never calibrated, and the firmware applies no matrix
    scale = parameters.get(f"COMPASS_SCALE{number}", 0.0) or 1.0
    return np.linalg.solve(matrix, field.T).T / scale - added


def _number(instance: int) -> str:
    """Number of an instance in ArduPilot's parameter names; the first has none."""
    return "" if instance == 0 else str(instance + 1)


def _complete(names: list[str], parameters: Mapping[str, float]) -> None:
    missing = [name for name in names if name not in parameters]
    if missing:
        raise _cannot(f"the log does not hold {', '.join(missing)}")


def _constant(changed: list[str]) -> None:
    if changed:
        raise _cannot(f"{', '.join(sorted(changed))} changed while the log ran")


def _vector(parameters: Mapping[str, float], name: str, default: float) -> np.ndarray:
    vector = np.array([parameters.get(name.format(axis), default) for axis in "XYZ"])
    if default and not (np.isfinite(vector).all() and vector.all()):
        raise _cannot(f"{name.format('*')} is {vector.tolist()}, by which nothing can be divided")
    return vector


def _symmetric(parameters: Mapping[str, float], diagonal: str, other: str) -> np.ndarray:
    matrix = np.diag([parameters.get(diagonal.format(axis), 1.0) for axis in "XYZ"])
    x, y, z = (parameters.get(other.format(axis), 0.0) for axis in "XYZ")
    matrix += np.array([[0.0, x, y], [x, 0.0, z], [y, z, 0.0]])
    if matrix.any() and not (np.isfinite(matrix).all() and abs(np.linalg.det(matrix)) > 1e-6):
        raise _cannot(f"{diagonal.format('*')} and {other.format('*')} hold a matrix that has no inverse")
    return matrix


def _rotation(number: int) -> np.ndarray:
    """Matrix R in ``body = R sensor`` for rotations 0 to 7, yaw by multiples of 45 degrees, the same in both flight controllers."""
    if not 0 <= number <= 7:
        raise _cannot(f"the board is mounted by rotation {number}; only turns about z (0 to 7) are undone")
    cosine, sine = np.cos(number * np.pi / 4), np.sin(number * np.pi / 4)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
