"""From a log to the start of the fit: readings with gaps filled and their noise, then rests, parameters and an attitude."""

import dataclasses
import functools
import math
from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .. import magnetometer
from .._arrays import axis_fault, axis_turns, axis_words, from_vector, skew
from .._errors import DataError, FitError
from .._message import Message
from ..imu._model import EARTH_RATE
from ..magnetometer._beside import clearest
from ._model import AT, DeviceModel, model_of, template, vector_of
from ._noise_floor import Floor, noise_floor
from ._normal import inertial
from ._state import UNSEEN, Rests, Way
from ._windows import REACH, Grid, Record

#: s: shortest recording; fewest readings of a sensor; readings: longest gap that is interpolated; samples: least distance of two readings
_BRIEF, _READINGS, _GAP, _CLOSE = 20.0, 100, 2, 0.2
#: s: time constants of the corrections of the attitude by field and specific force; the test of the axes: s of a step; rad by which the
#: rates turn in a segment, and its limits in s
_FIELD, _FORCE, _THIN, _TURN, _SEGMENT = 1.0, 10.0, 0.03, 4.0, (0.6, 5.0)
#: sensor with a dead axis -> what calibrates the others
_WITHOUT = {
    "gyro": "jaxcal imu calibrates the accelerometer, and jaxcal mag the magnetometer",
    "accel": "jaxcal mag calibrates the magnetometer", "mag": "jaxcal imu calibrates accelerometer and gyroscope",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class _Sensor:
    """Readings of a sensor at the samples of the log."""

    filled: np.ndarray  # (n, 3) at the samples
    lost: np.ndarray  # (n,) whether a sample lies in a gap too long for an interpolation
    index: np.ndarray  # (m,) samples that have a reading
    at: np.ndarray  # (m,) when it was taken, in samples
    own: np.ndarray  # (m, 3) the readings

    @staticmethod
    def of(log: Any, name: str) -> "_Sensor":
        """The readings are interpolated in short gaps, and where they were not taken at a sample (`Log.offset`)."""
        # readings at the end of the range stay: they widen the noise of the motion, and without them the trajectory would break there
        y = log.usable(name, keep=("clipped",))
        count, index = len(y), np.flatnonzero(np.isfinite(y).all(axis=1))
        at, moved = index.astype(float), name in log.offset
        if moved:
            at += log.offset[name][index] * log.rate
            apart = np.append(True, np.diff(at) > _CLOSE)
            index, at = index[apart], at[apart]
        if len(index) < _READINGS:
            return _Sensor(np.zeros_like(y), np.ones(count, dtype=bool), index, at, y[index])
        edges, rows = np.concatenate([[-1], index, [count]]), np.arange(count)
        before, after = edges[np.searchsorted(edges, rows, "right") - 1], edges[np.searchsorted(edges, rows)]
        lost = after - before > (_GAP + 1) * np.median(np.diff(index))
        filled = scipy.interpolate.CubicSpline(at, y[index])(rows) if moved or len(index) < count else y
        return _Sensor(np.where(lost[:, None], np.median(y[index], axis=0), filled), lost, index, at, y[index])

    def floor(self, rate: float) -> Floor:
        """The noise. It is that of the readings themselves where most samples are interpolated, because interpolation filters noise."""
        step = float(np.median(np.diff(self.at)))
        if np.array_equal(self.at, self.index) and step == 1.0:
            return noise_floor(self.filled, rate, self.lost)
        return noise_floor(self.own, rate / step, np.zeros(len(self.own), dtype=bool))


def recorded(log: Any, gravity: float, latitude: float | None = None) -> tuple[Record, tuple[Floor, Floor], np.ndarray]:
    """The record, the noise of gyroscope and accelerometer, and the readings of the magnetometer in their own unit."""
    if log.duration < _BRIEF:
        raise DataError(f"the recording lasts {log.duration:.3g} s; {_BRIEF:g} s are needed, and three minutes are advised", code="short")
    for name in ("accel", "gyro", "mag"):
        value = getattr(log, name, None)
        if value is None or np.shape(value)[1:] != (3,):
            said = f"the log has no {name} with three axes; a device is fitted from accelerometer, gyroscope and magnetometer"
            raise DataError(said, code="no_sensor")
    sensors = {name: _Sensor.of(log, name) for name in ("gyro", "accel")}
    (gyro, no_gyro), (accel, no_accel) = ((sensor.filled, sensor.lost) for sensor in sensors.values())
    mag = log.usable("mag")
    there = np.isfinite(mag).all(axis=1)
    rate = float(log.rate)
    grid = Grid.of(len(accel), rate, REACH)
    wide = math.ceil(REACH * rate) + 4
    lost = no_accel | (np.convolve(no_gyro, np.ones(2 * wide + 1), mode="same") > 0)
    broken = np.asarray(np.any(lost[grid.inner], axis=1))
    if (span := grid.steps * grid.step * float(np.sum(~broken))) < _BRIEF:
        raise DataError(f"accelerometer and gyroscope have readings without gaps for {span:.3g} s; {_BRIEF:g} s are needed", code="gaps")
    if there.sum() < _READINGS:
        raise DataError(f"the magnetometer has {there.sum()} readings; {_READINGS} are needed, and several per second are advised",
                        code="few")  # fmt: skip
    spin = np.zeros(3) if latitude is None else EARTH_RATE * np.array([np.cos(latitude), 0.0, np.sin(latitude)])
    earth = from_vector(spin * grid.steps * grid.step)
    for name, values in (("gyro", gyro), ("accel", accel), ("mag", mag[there])):
        if dead := [f"{name}_{axis}" for axis, span in zip("xyz", np.ptp(values, axis=0), strict=True) if span == 0]:
            said = "never changes: it is dead, or its column is wrong. Without it, "
            raise DataError(f"{', '.join(dead)} {said}{_WITHOUT[name]}", code="dead")
    floors = sensors["gyro"].floor(rate), sensors["accel"].floor(rate)
    later = np.where(there, log.offset["mag"], 0.0) if "mag" in log.offset else None
    return Record(accel, gyro, np.where(there[:, None], mag, 0.0), later, there, broken, grid, gravity, earth), floors, mag


@dataclasses.dataclass(frozen=True)
class Start:
    """Start of the fit.

    Attributes
    ----------
    vector, way, rests : parameters, trajectory, and windows at rest.
    strength : of the field, in the unit of the readings.
    axes : matrices (3, 3) that rotate vectors from the axes of the accelerometer to those of gyroscope and magnetometer.
    """

    vector: np.ndarray
    way: Way
    rests: Rests
    strength: float
    axes: tuple[np.ndarray, np.ndarray]


def started(record: Record, mag: np.ndarray) -> Start:
    """Start of the fit to a record, whose magnetometer is divided by the strength of the field."""
    vector = vector_of(template())
    gyro = axes_of(record.accel, record.gyro, 1 / record.grid.step, ("gyroscope", "accelerometer")).T
    vector[AT["gyro.matrix"]] = gyro.ravel()
    rates = record.gyro @ gyro
    iron, hard, strength, axes = _ellipsoid(record, mag, rates) or _turned(record, mag, rates)
    vector[AT["magnetometer.soft_iron"]], vector[AT["magnetometer.hard_iron"]] = iron.ravel(), hard / strength
    record.mag = record.mag / strength
    way, dip = followed(record, vector)
    vector[AT["dip"]] = dip
    return Start(vector, way, Rests(record.resting()), strength, (gyro, axes))


def _ellipsoid(record: Record, mag: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray] | None:
    """Soft iron, hard iron, strength and axes. None without an ellipsoid."""
    there, rate = record.there, 1 / record.grid.step
    try:
        found = magnetometer.fit(mag[there], model="symmetric")
    except FitError:
        return None
    if found.model is None or found.verdict == "refused":
        return None
    index = np.flatnonzero(there)
    fields = np.asarray(found.model.correct(mag[index]))
    fields = np.stack([np.interp(np.arange(len(mag)), index, x) for x in fields.T], axis=1)
    axes = axes_of(fields, rates, rate, ("gyroscope", "magnetometer"))
    return np.asarray(found.model.soft_iron) @ axes, np.asarray(found.model.hard_iron), float(found.field), axes


def _turned(record: Record, mag: np.ndarray, rates: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """The same from the rotation of the readings about the hard iron, which stays at the mean reading along directions without rotation."""
    index = np.flatnonzero(record.there)
    index = index[:: max(round(0.1 / record.grid.step), 1)]
    total = np.cumsum(np.concatenate([np.zeros((1, 3)), rates[1:] + rates[:-1]]), axis=0) * record.grid.step / 2
    back = from_vector(-np.diff(total[index], axis=0))
    mean, turns, tried = mag[index].mean(axis=0), axis_turns(), []
    y = mag[index] - mean
    for turn in turns:
        rows = np.eye(3) - turn @ back @ turn.T
        left = y[1:] - y[:-1] + np.einsum("kab,kb->ka", rows, y[:-1])
        normal = np.einsum("kba,kbc->ac", rows, rows)
        # directions in which the readings hardly change keep the mean
        centre = np.linalg.pinv(normal, UNSEEN**2, hermitian=True) @ np.einsum("kba,kb->a", rows, left)
        tried.append((float(np.sqrt(np.mean((left - rows @ centre) ** 2))), centre))
    best = clearest(np.array([scatter for scatter, _ in tried]), alone=True)
    centre, axes = tried[best][1], turns[best]
    strength = float(np.sqrt(np.mean(np.sum((y - centre) ** 2, axis=1))))
    if not strength > 0:
        raise DataError("the magnetometer's readings are all alike; turn the device through all attitudes", code="dead")
    return axes, mean + centre, strength, axes


def followed(record: Record, vector: np.ndarray) -> tuple[Way, float]:
    """Trajectory and dip: rates integrated forwards and then backwards, corrected towards field and, slowly, towards the vertical."""
    back = record.back(vector)
    model, w = model_of(vector), record.windows(vector, back)
    seen = inertial(model, w)
    fields = (w.field - model.magnetometer.hard_iron) @ np.linalg.inv(model.magnetometer.soft_iron).T
    kept = record.kept(back)
    ahead = np.einsum("kiab,kib->kia", seen.to_reading, fields) * kept[..., None]
    count = np.maximum(kept.sum(axis=1), 1)
    field, force = ahead.sum(axis=1) / count[:, None], seen.speed / record.time
    some = kept.any(axis=1)
    dip = float(np.arcsin(np.clip(-np.mean(np.sum(field * force, axis=1)[some]) / record.gravity, -0.999, 0.999)))
    world, up = np.asarray(DeviceModel(model.accel, model.gyro, model.magnetometer, 1.0, dip).world_field), np.array([0.0, 0.0, 1.0])
    step = seen.rotation[:, -1]
    # the cross products with the field and with the vertical, times the shares of their angles that are corrected
    gain = np.where(some, -record.time / _FIELD, 0.0)[:, None, None] * skew(world), -record.time / _FORCE / record.gravity * skew(up)
    first = int(np.argmax(some))
    turn = _triad(force[first], field[first], dip) @ functools.reduce(np.matmul, step[:first], np.eye(3)).T
    total = len(step)
    turns = np.empty((total + 1, 3, 3))

    def corrected(turn, k):
        return from_vector(np.clip(gain[0][k] @ (turn @ field[k]) + gain[1] @ (turn @ force[k]), -0.3, 0.3)) @ turn

    for k in range(total):
        turn = corrected(turn, k) @ step[k]
    turns[total] = turn
    for k in range(total - 1, -1, -1):
        turn = corrected(turn @ step[k].T, k)
        turns[k] = turn
    turns = scipy.spatial.transform.Rotation.from_matrix(turns).as_matrix()
    still = np.zeros((total + 1, 3))
    return Way(turns, still, still.copy(), still.copy()), dip


def _triad(force: np.ndarray, field: np.ndarray, dip: float) -> np.ndarray:
    """Attitude for which `force` points up and `field` lies in the plane of north and down."""
    up = force / np.linalg.norm(force)
    west = np.cross(up, field)
    west /= max(np.linalg.norm(west), 1e-12)
    return np.stack([np.cross(west, up), west, up])


def axes_of(vectors: np.ndarray, rates: np.ndarray, rate: float, names: tuple[str, str]) -> np.ndarray:
    """(3, 3) matrix Q, a permutation of axes with signs, that rotates `rates` to the axes of the `vectors`.

    A vector that is constant in the world, such as gravity or the field, stands still where the rates turn it back. Q is the identity
    unless another matrix makes the vectors scatter clearly less than all others do. If Q mirrors, the rates turn the other way.
    """
    rates = rates - np.median(rates, axis=0)
    length = float(np.clip(_TURN / np.sqrt(np.mean(np.sum(rates**2, axis=1))), *_SEGMENT))
    size = max(round(_THIN * rate), 1)  # samples of a step; the mean of a fifth of a segment has less of the acceleration of the hand
    fifth = max(round(length / 5 * rate / size), 1)
    count = len(rates) // (5 * fifth * size)
    v, w = (y[: count * 5 * fifth * size].reshape(count, 5 * fifth, size, 3).mean(axis=2) for y in (vectors, rates))
    turns, scatter = axis_turns(), []
    for sign in (1.0, -1.0):
        step = from_vector(sign * size / rate * (w[:, 1:] + w[:, :-1]) / 2)
        attitude = [np.broadcast_to(np.eye(3), (count, 3, 3))]
        for k in range(step.shape[1]):
            attitude.append(attitude[-1] @ step[:, k])
        back = np.einsum("msij,tsmj->tsmi", np.array(attitude), v @ turns[:, None])
        back = back.reshape(len(turns), count, 5, fifth, 3).mean(axis=3)
        scatter.append(np.sqrt(np.mean(np.var(back, axis=2), axis=2)))
    matrices = np.concatenate([turns, -turns])
    # the acceleration of the hand differs between segments, so each counts beside its own least scatter
    turned = np.linalg.norm(w, axis=2).sum(axis=1) * size / rate > _TURN / 4
    each = np.log(np.maximum(np.concatenate(scatter)[:, turned], 1e-12))
    best = clearest(np.exp(each.mean(axis=1)), alone=True) if turned.any() else 0
    if np.linalg.det(matrices[best]) < 0:
        said = "the {sensor} is mirrored against the {other}: {what}. Give {option.axes:gyro={axes}}"
        facts = {"sensor": names[0], "other": names[1], "what": axis_fault(matrices[best].T), "axes": axis_words(matrices[best])}
        raise DataError(Message(said, **facts), code="mirrored")
    return matrices[best]
