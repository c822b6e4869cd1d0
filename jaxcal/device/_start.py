"""Where the fit begins: the single-sensor estimators, and an attitude that follows all three sensors."""

import numpy as np
import scipy  # loads its parts when they are first used

from .. import magnetometer
from .._errors import DataError
from ._model import DeviceModel
from ._normal import GYRO_DELAY, MAG_DELAY, exponential, inertial
from ._solve import Record, Way
from ._windows import NAMES, template, vector_of

_FIELD, _FORCE = 1.0, 10.0  # s, time constants with which the attitude follows field and specific force
_FIRST = 2.0  # s whose mean gives the first attitude


def started(record: Record, mag: np.ndarray) -> tuple[np.ndarray, Way, float]:
    """Parameters, the way, and the strength of the field in the unit of `mag`, by which the record's is divided from here on."""
    there = record.there
    rate = 1 / record.grid.step
    found = magnetometer.fit(mag[there], method="ml", model="symmetric")
    if found.model is None:
        raise DataError(f"The magnetometer's readings give no ellipsoid to begin with: {found.reason}")
    readings = np.where(there[:, None], mag, np.nan)
    turned = magnetometer.align(readings, found.model, magnetometer.Gyroscope(record.gyro, rate))
    iron = np.asarray(turned.model.soft_iron)
    strength = float(found.field)
    vector = vector_of(template())
    vector[[NAMES.index(f"magnetometer.soft_iron[{i},{j}]") for i in range(3) for j in range(3)]] = iron.ravel()
    vector[[NAMES.index(f"magnetometer.hard_iron[{i}]") for i in range(3)]] = np.asarray(turned.model.hard_iron) / strength
    vector[[NAMES.index(f"gyro.bias[{i}]") for i in range(3)]] = turned.bias
    vector[MAG_DELAY] = np.clip(turned.delay, -0.045, 0.045) if np.isfinite(turned.delay) else 0.0
    record.mag = record.mag / strength
    way, dip = followed(record, vector)
    vector[NAMES.index("dip")] = dip
    return vector, way, strength


def followed(record: Record, vector: np.ndarray) -> tuple[Way, float]:
    """Attitude by the gyroscope, drawn to the field and slowly to the vertical, forwards and then backwards; and the dip."""
    from ._windows import model_of

    model, w = model_of(vector), record.windows(vector)
    seen = inertial(model, w)
    fields = (w.field - model.magnetometer.hard_iron) @ np.linalg.inv(model.magnetometer.soft_iron).T
    kept = record.there[record.grid.inner[:, :-1]]
    ahead = np.einsum("kiab,kib->kia", seen.to_reading, fields) * kept[..., None]
    count = np.maximum(kept.sum(axis=1), 1)
    field, force = ahead.sum(axis=1) / count[:, None], seen.speed / record.time
    some = kept.any(axis=1)
    dip = float(np.arcsin(np.clip(-np.mean(np.sum(field * force, axis=1)[some]) / record.gravity, -0.999, 0.999)))
    world, up = np.asarray(DeviceModel(model.accel, model.gyro, model.magnetometer, 1.0, dip).world_field), np.array([0.0, 0.0, 1.0])
    step = seen.rotation[:, -1]
    gain = np.where(some, record.time / _FIELD, 0.0), record.time / _FORCE
    first = max(round(_FIRST / record.time), 1)
    turn = _triad(_gathered(step, force, first), _gathered(step, field, first), dip)
    total = len(step)
    turns = np.empty((total + 1, 3, 3))

    def corrected(turn, k):
        wrong = gain[0][k] * np.cross(turn @ field[k], world) + gain[1] * np.cross(turn @ force[k] / record.gravity, up)
        return exponential(np.clip(wrong, -0.3, 0.3)) @ turn

    for k in range(total):
        turn = corrected(turn, k) @ step[k]
    turns[total] = turn
    for k in range(total - 1, -1, -1):
        turn = corrected(turn @ step[k].T, k)
        turns[k] = turn
    turns = scipy.spatial.transform.Rotation.from_matrix(turns).as_matrix()
    still = np.zeros((total + 1, 3))
    return Way(turns, still, still.copy(), still.copy()), dip


def _gathered(step: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Sum of the first vectors, in the frame of the first."""
    turn, total = np.eye(3), np.zeros(3)
    for k in range(min(count, len(values))):
        total += turn @ values[k]
        turn = turn @ step[k]
    return total


def _triad(force: np.ndarray, field: np.ndarray, dip: float) -> np.ndarray:
    """Attitude in which one vector points up and the other north and down."""
    up = force / np.linalg.norm(force)
    west = np.cross(up, field)
    west /= max(np.linalg.norm(west), 1e-12)
    return np.stack([np.cross(west, up), west, up])
