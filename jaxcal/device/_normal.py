"""Residuals of all windows and their derivatives in closed form (host, NumPy: nothing needs compilation)."""

import dataclasses
from typing import Any

import numpy as np

from .._arrays import from_vector, left_jacobian, skew, to_vector
from ..fitting import Chain
from ._model import AT, NAMES, DeviceModel
from ._windows import MAG_DELAY, Windows

#: unknowns of a link: rotation, velocity, position, and the acceleration of the Matern process, which no residual of a sensor contains
TURN, VELOCITY, PLACE, PULL = (slice(3 * i, 3 * i + 3) for i in range(4))
LINK = PULL.stop
#: columns of the gyroscope's parameters, in the order of NAMES: the delay and the pole come last
_TURNING = np.r_[AT["gyro.matrix"], AT["gyro.bias"], AT["gyro.g_sensitivity"], AT["gyro_delay"], AT["gyro_pole"]]


@dataclasses.dataclass
class Inertial:
    """Integrals of the inertial readings over every window, with their derivatives by the parameters.

    Rotations and integrals are in the frame of the device at the beginning of the window. A derivative of a rotation is a rotation vector
    in this frame.
    """

    rotation: np.ndarray  # (K, m + 1, 3, 3) attitude at each sample relative to the beginning
    speed: np.ndarray  # (K, 3) integral of the specific force
    place: np.ndarray  # (K, 3) its second integral
    rate: np.ndarray  # (K, m + 1, 3)
    to_reading: np.ndarray  # (K, m, 3, 3) attitude at each reading of the magnetometer relative to the beginning
    turned_by: np.ndarray  # (K, 3, q) derivative of the rotation, over the columns of the gyroscope
    reading_by: np.ndarray  # (K, m, 3, q)
    reading_late: np.ndarray  # (K, m, 3) derivative by the magnetometer's delay
    speed_by: np.ndarray  # (K, 3, p) derivatives by all parameters
    place_by: np.ndarray
    swept: np.ndarray  # (K, 2, 3) velocity relative to the centre of rotation, at the beginning and at the end, in device axes
    swept_by: np.ndarray  # (K, 2, 3, q)
    columns: np.ndarray  # (q,) of the gyroscope's parameters


def inertial(model: DeviceModel, w: Windows, sensitivity: bool = False, lever: bool = False) -> Inertial:
    """Integrate all windows. Derivatives by the g-sensitivity and by lever arms are zero unless the options ask for them."""
    columns = _TURNING if sensitivity else np.setdiff1d(_TURNING, np.r_[AT["gyro.g_sensitivity"]])
    h, (count, steps) = float(w.step[0]), w.field_time.shape
    gyro, accel = np.linalg.inv(model.gyro.matrix), np.linalg.inv(model.accel.matrix)
    arms, g = np.asarray(model.lever), np.asarray(model.gyro.g_sensitivity)
    rate = np.asarray(w.rate - model.gyro.bias) @ gyro.T
    force = (w.force - model.accel.bias) @ accel.T
    plain_force, spin = force.copy(), w.slope @ gyro.T
    # what a low-pass takes from gravity, which turns: its second derivative. That of the readings would contain the hand's motion, of which
    # less is always more probable
    bowed = np.cross(rate, np.cross(rate, force)) - np.cross(spin, force)
    force -= float(model.accel_pole) * bowed
    bent = skew(spin) if lever or arms.any() else None
    if bent is not None:
        whirl = skew(rate)
        bent = bent + whirl @ whirl
        for axis in (1, 2):
            force[..., axis] -= bent[..., axis, :] @ arms[axis - 1]
    pull = force @ g.T
    rate = rate - pull @ gyro.T
    raw = np.asarray(w.turn - h * (model.gyro.bias + (pull[:, 1:] + pull[:, :-1]) / 2))
    plain = raw @ gyro.T
    small = plain + h**2 / 12 * np.cross(rate[:, :-1], rate[:, 1:])
    by = from_vector(small)
    rotation = np.empty((count, steps + 1, 3, 3))
    rotation[:, 0] = np.eye(3)
    for i in range(steps):
        rotation[:, i + 1] = rotation[:, i] @ by[:, i]
    pushed = np.einsum("kiab,kib->kia", rotation, force)
    half = np.full(steps + 1, h)
    half[[0, -1]] = h / 2
    # weights of the double integral: the trapezoidal rule applied twice
    left = steps - np.arange(steps + 1)
    twice = h**2 * left.astype(float)
    twice[0], twice[-1] = h**2 * (2 * steps - 1) / 4, h**2 / 4
    speed, place = np.einsum("i,kia->ka", half, pushed), np.einsum("i,kia->ka", twice, pushed)

    # derivatives of the rate and of the rotation in each step, by the columns TURNING
    many = len(columns)
    rate_by, raw_by = np.zeros((count, steps + 1, 3, many)), np.zeros((count, steps, 3, many))
    by_matrix = lambda x: -np.einsum("ca,kib->kicab", gyro, x).reshape(*x.shape, 9)  # noqa: E731
    rate_by[..., :9], raw_by[..., :9] = by_matrix(rate), by_matrix(plain)
    if sensitivity:
        rate_by[..., 12:21], raw_by[..., 12:21] = by_matrix(force), by_matrix(h / 2 * (force[:, 1:] + force[:, :-1]))
    rate_by[..., 9:12], raw_by[..., 9:12] = -gyro, -h * gyro
    rate_by[..., -2], raw_by[..., -2] = w.slope @ gyro.T, (w.rate[:, 1:] - w.rate[:, :-1]) @ gyro.T
    rate_by[..., -1], raw_by[..., -1] = -w.curve @ gyro.T, -np.diff(w.slope, axis=1) @ gyro.T
    raw_by += h**2 / 12 * (skew(rate[:, :-1]) @ rate_by[:, 1:] - skew(rate[:, 1:]) @ rate_by[:, :-1])
    turn_by = np.zeros((count, steps + 1, 3, many))
    moved = (rotation[:, :-1] @ left_jacobian(small)) @ raw_by
    for i in range(steps):  # a cumulative sum takes six times as long
        np.add(turn_by[:, i], moved[:, i], out=turn_by[:, i + 1])

    # readings of the magnetometer
    late = w.field_time[..., None]
    part = np.asarray(w.field_turn - late * (model.gyro.bias + pull[:, :-1])) @ gyro.T
    part_by = late[..., None] * rate_by[:, :-1]
    part_by[..., :9] = by_matrix(part)
    part_by[..., -2] = (w.field_rate - w.rate[:, :-1]) @ gyro.T
    part_by[..., -1] = -late / h * np.diff(w.slope, axis=1) @ gyro.T
    ahead = rotation[:, :-1] @ left_jacobian(part)
    to_reading = rotation[:, :-1] @ from_vector(part)
    reading_by = turn_by[:, :-1] + ahead @ part_by
    reading_late = -np.einsum("kiab,kib->kia", ahead, (w.field_rate - model.gyro.bias - pull[:, :-1]) @ gyro.T)

    # derivatives of both integrals of the specific force
    force_by = np.zeros((count, 2, 3, len(NAMES)))
    weights = np.stack([half, twice])
    turning = -np.einsum("wi,kiab->kwiab", weights, skew(pushed), optimize=True)
    force_by[..., columns] = np.einsum("kwiab,kibq->kwaq", turning, turn_by, optimize=True)
    carried = rotation @ accel
    weighted = np.einsum("wi,kiab,kic->kwabc", weights, carried, plain_force, optimize=True)
    force_by[..., AT["accel.matrix"]] = -weighted.reshape(count, 2, 3, 9)
    force_by[..., AT["accel.bias"]] = -np.einsum("wi,kiab->kwab", weights, carried, optimize=True)
    force_by[..., AT["accel_pole"]] = -np.einsum("wi,kiab,kib->kwa", weights, rotation, bowed, optimize=True)[..., None]
    if lever and bent is not None:
        for axis in (1, 2):
            own = np.arange(len(NAMES))[AT["lever"]].reshape(2, 3)[axis - 1]
            force_by[..., own] = -np.einsum("wi,kia,kic->kwac", weights, rotation[..., axis], bent[..., axis, :], optimize=True)
        # derivatives, over the columns of the gyroscope, of the accelerations of the elements relative to that of x
        swung_by, spin_by = np.zeros_like(rate_by), np.zeros_like(rate_by)
        spin_by[..., :9] = by_matrix(spin)
        spin_by[..., -2] = w.curve @ gyro.T
        for axis, arm in enumerate(arms, start=1):
            swing = skew(np.cross(rate, arm)) @ rate_by + skew(rate) @ skew(arm) @ rate_by + skew(arm) @ spin_by
            swung_by[..., axis, :] = -swing[..., axis, :]
        whirled = np.einsum("wi,kiax,kixq->kwaq", weights, rotation, swung_by, optimize=True)
        force_by[..., columns] -= whirled
    arm, ends = np.asarray(model.arm), [0, -1]
    return Inertial(
        rotation, speed, place, rate, to_reading, turn_by[:, -1], reading_by, reading_late, force_by[:, 0], force_by[:, 1],
        np.cross(rate[:, ends], arm), -skew(arm) @ rate_by[:, ends], columns,
    )  # fmt: skip


def whitened(found: Inertial, gyro: Any, accel: Any, time: float, broken: np.ndarray) -> np.ndarray:
    """(K, 9, 9) matrices that whiten the inertial residuals, for white noise of gyroscope and accelerometer, one density or (K,)."""
    mean, end = found.speed / time, np.swapaxes(found.rotation[:, -1], 1, 2)
    # an error of attitude rotates the specific force: its products with the vector, whose cross product is that of each row
    eye, across = np.eye(3), np.cross(end, mean[:, None])
    square = np.sum(mean**2, axis=1)[:, None, None] * eye - mean[:, :, None] * mean[:, None]
    g, a = (np.broadcast_to(level, len(mean))[:, None, None] ** 2 for level in (gyro, accel))
    speed, place = g * time**2 / 2 * across, g * time**3 / 6 * across
    both = a * time**2 / 2 * eye + g * time**4 / 8 * square
    rows = (
        (g * time * eye, speed, place),
        (np.swapaxes(speed, 1, 2), a * time * eye + g * time**3 / 3 * square, both),
        (np.swapaxes(place, 1, 2), np.swapaxes(both, 1, 2), a * time**3 / 3 * eye + g * time**5 / 20 * square),
    )
    matrix = np.concatenate([np.concatenate(row, axis=2) for row in rows], axis=1)
    matrix[broken] = np.diag(np.repeat([1.0, 10.0, 1.0], 3) ** 2)
    return np.linalg.inv(np.linalg.cholesky(matrix))


@dataclasses.dataclass
class Rows:
    """Residuals in standard deviations and their derivatives.

    The columns of `inertial_by` are the p parameters, then rotation, velocity and position at the beginning and at the end of the window.
    The columns of `field_by` are the parameters and the rotation at the beginning.
    """

    inertial: np.ndarray  # (K, 9)
    field: np.ndarray  # (K, m, 3)
    inertial_by: np.ndarray  # (K, 9, p + 18)
    field_by: np.ndarray  # (K, m, 3, p + 3)


def rows(
    states: tuple, w: Windows, found: Inertial, model: DeviceModel, whiten: np.ndarray, weight: np.ndarray, gravity: float,
    earth: np.ndarray,
) -> Rows:  # fmt: skip
    """Rows of the least squares: `whiten` (K, 9, 9) multiplies the inertial part, `weight` (K, m) each reading of the magnetometer."""
    turn, velocity, place = states
    count, steps = weight.shape
    back, size, columns = np.swapaxes(turn[:-1], 1, 2), len(NAMES), found.columns
    time, down = float(w.step[0]) * steps, np.array([0.0, 0.0, gravity])
    # the states are those of the point about which the hand rotates the device
    swept, arm, apart, relative = found.swept, np.asarray(model.arm), back @ turn[1:], np.swapaxes(back @ earth @ turn[1:], 1, 2)
    turned = to_vector(np.swapaxes(relative @ found.rotation[:, -1], 1, 2))
    speed = np.einsum("kab,kb->ka", back, np.diff(velocity, axis=0) + time * down) + np.einsum("kab,kb->ka", apart, swept[:, 1])
    moved = np.einsum("kab,kb->ka", back, np.diff(place, axis=0) - time * velocity[:-1] + time**2 / 2 * down) + apart @ arm
    residual = np.concatenate([turned, speed - swept[:, 0] - found.speed, moved - arm - time * swept[:, 0] - found.place], axis=1)
    by = np.zeros((count, 9, size + 18))
    # carry rotations from the device axes at the beginning to those at the end
    bend = np.eye(3) + skew(residual[:, :3]) / 2
    by[:, :3, columns] = -bend @ relative @ found.turned_by
    by[:, :3, size : size + 3], by[:, :3, size + 9 : size + 12] = -bend @ relative, bend
    by[:, 3:6, :size], by[:, 6:, :size] = -found.speed_by, -found.place_by
    by[:, 3:6, size : size + 3], by[:, 6:, size : size + 3] = skew(speed), skew(moved)
    by[:, 3:6, size + 3 : size + 6], by[:, 3:6, size + 12 : size + 15] = -back, back
    by[:, 6:, size + 3 : size + 6], by[:, 6:, size + 6 : size + 9], by[:, 6:, size + 15 :] = -time * back, -back, back
    by[:, 3:6, columns] += apart @ found.swept_by[:, 1] - found.swept_by[:, 0]
    by[:, 6:, columns] -= time * found.swept_by[:, 0]
    by[:, 3:6, AT["arm"]] = apart @ skew(found.rate[:, -1]) - skew(found.rate[:, 0])
    by[:, 6:, AT["arm"]] = apart - np.eye(3) - time * skew(found.rate[:, 0])
    by[:, 3:6, size + 9 : size + 12], by[:, 6:, size + 9 : size + 12] = -apart @ skew(swept[:, 1]), -apart @ skew(arm)

    iron = np.asarray(model.magnetometer.soft_iron)
    world = np.asarray(model.world_field)
    inner = np.einsum("kab,b->ka", back, world)
    at = np.swapaxes(found.to_reading, 2, 3)
    seen = np.einsum("kiab,kb->kia", at, inner)
    field = seen @ iron.T + model.magnetometer.hard_iron - w.field
    # the weights multiply the smallest factors
    field_by, scale = np.zeros((count, steps, 3, size + 3)), weight[..., None, None]
    lean = scale * (iron @ at)
    across = lean @ skew(inner)[:, None]
    field_by[..., columns] = across @ found.reading_by
    field_by[..., MAG_DELAY] = np.einsum("kiab,kib->kia", across, found.reading_late)
    field_by[..., AT["magnetometer.soft_iron"]] = np.einsum("ab,kic->kiabc", np.eye(3), scale[..., 0] * seen).reshape(count, steps, 3, 9)
    field_by[..., AT["magnetometer.hard_iron"]] = scale * np.eye(3)
    lower = float(model.field) * np.array([-np.sin(model.dip), 0.0, -np.cos(model.dip)])
    field_by[..., AT["dip"]] = np.einsum("kiab,kb->kia", lean, np.einsum("kab,b->ka", back, lower))[..., None]
    field_by[..., size:] = across
    return Rows(np.einsum("kab,kb->ka", whiten, residual), scale[..., 0] * field, whiten @ by, field_by)


def chain_of(found: Rows, free: np.ndarray) -> Chain:
    """Normal equations of the free parameters and of the states at the K + 1 ends of windows."""
    count, size = len(found.inertial), len(NAMES)
    links, ties = np.zeros((count + 1, LINK, LINK)), np.zeros((count, LINK, LINK))
    border, score = np.zeros((count + 1, LINK, len(free))), np.zeros((count + 1, LINK))

    # one product for each window, see `summed_product`
    def products(by: np.ndarray, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        by = np.take(by, [*range(size, by.shape[-1]), *free], axis=-1).reshape(count, -1, by.shape[-1] - size + len(free))
        back = np.swapaxes(by, 1, 2)
        return back @ by, (back @ residual.reshape(count, -1, 1))[..., 0]

    (moved, push), (turned, pull) = products(found.inertial_by, found.inertial), products(found.field_by, found.field)
    links[:-1, :9, :9], ties[:, :9, :9] = moved[:, :9, :9], moved[:, :9, 9:18]
    links[1:, :9, :9] += moved[:, 9:18, 9:18]
    links[:-1, :3, :3] += turned[:, :3, :3]
    border[:-1, :9], score[:-1, :9] = moved[:, :9, 18:], push[:, :9]
    border[1:, :9] += moved[:, 9:18, 18:]
    border[:-1, :3] += turned[:, :3, 3:]
    score[1:, :9] += push[:, 9:18]
    score[:-1, :3] += pull[:, :3]
    corner = moved[:, 18:, 18:].sum(axis=0) + turned[:, 3:, 3:].sum(axis=0)
    return Chain(links, ties, border, corner, score, push[:, 18:].sum(axis=0) + pull[:, 3:].sum(axis=0))
