"""Derivatives of fitted parameters by the readings, from the implicit function theorem at the solution."""

import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._arrays import CROSS, skew
from .._errors import FitError
from ..fitting import Chain
from ._model import NAMES, model_of
from ._normal import LINK
from ._solve import spread_of
from ._state import SIZES, Solution
from ._windows import GYRO_DELAY, MAG_DELAY, TAPS, Record, integral_weights, lagrange

_EXACT = 1e-8  # the refinement ends with a step of this size relative to the largest
_MOST = 60  # steps of the refinement
#: parameters (p,) and links (K + 1, LINK)
Unknowns = tuple[Any, Any]


def gradients(found: Solution, record: Record, slope: np.ndarray, strength: float) -> list[dict[str, np.ndarray]]:
    """Sensor -> (n, 3) derivatives by the readings, for each row of `slope` (q, p), the derivative of a value by the free parameters.

    The unknowns z (free parameters and trajectory) solve g(z, y) = J'P r + (priors) = 0, where r are the residuals of the readings y, J is
    their derivative by z, and P is the inverse of their covariance. So dz = -H^-1 (dg/dy) dy with H = dg/dz. H includes the second
    derivatives of the residuals and the dependence of P on z. The derivative for a row s of `slope` is -(dg/dy)'x, where H'x = s. The
    Gauss-Newton matrix of the fit is close to H, so a few steps of iterative refinement with it solve this system.

    Constant: noise levels, weights of the windows, rests, reach and speed of the hand, and the centre of the wide prior.
    """
    filters, free, way = _filters(record, found), found.free, found.way
    readings = {"accel": record.accel, "gyro": record.gyro, "mag": record.mag}
    fed = {name: own.of(readings[own.sensor]) for name, own in filters.items()}
    weight, whiten = found.weight, found.whiten
    level = [np.broadcast_to(noise, len(whiten)) * ~record.broken for noise in (found.noise.gyro, found.noise.accel)]
    later = 0.0 if record.mag_later is None else record.mag_later[record.grid.inner[:, :-1] - found.back][..., None]
    fixed = {
        "vector": found.vector, "free": free, "way": (way.rotation, way.velocity, way.place), "earth": record.earth,
        "gravity": record.gravity, "step": record.grid.step, "later": later, "late": filters["field_turn"].length + later, "noise": level,
        "prior": [tuple(tie) for tie in found.prior[:3]],  # those that are linear in the links
        "turn": found.rests.windows[:, None] / found.rests.turn, "size": SIZES[free],
    }  # fmt: skip
    # P r of the inertial and of the magnetometer's residuals
    left = np.swapaxes(whiten, 1, 2) @ found.rows.inertial[..., None], weight[..., None] * found.rows.field
    there = np.zeros(len(free)), np.zeros((len(way.velocity), LINK))

    def products(x: Unknowns) -> tuple[Unknowns, dict[str, Any]]:
        """H'x, and (dg/dy)'x with the outputs of the filters in place of the readings y."""
        own = [np.broadcast_to(x[0], (len(whiten), len(free))), x[1][:-1, :9], x[1][1:, :9]]
        columns = np.append(free, np.arange(len(NAMES), len(NAMES) + 18))
        felt = found.rows.inertial_by[..., columns] @ np.concatenate(own, axis=1)[..., None]
        columns = columns[: len(free) + 3]
        seen = np.einsum("kiap,kp->kia", found.rows.field_by[..., columns], np.concatenate([own[0], own[1][:, :3]], axis=1))
        along = (np.swapaxes(whiten, 1, 2) @ felt)[..., 0], weight[..., None] * seen
        with jax.numpy_rank_promotion("allow"):  # the formulas broadcast as those in NumPy do, whatever the caller's configuration
            return jax.tree.map(np.asarray, _by(there, fed, x, (left[0][..., 0], left[1]), along, fixed))

    out: list[dict[str, np.ndarray]] = []
    for row in slope:
        x = _refined(found.chain, lambda x: products(x)[0], row)
        by = products(x)[1]
        total: dict[str, Any] = {name: np.zeros_like(y) for name, y in readings.items()}
        for name, own in filters.items():
            total[own.sensor] -= own.back(by[name], len(total[own.sensor]))
        out.append({name: value / (strength if name == "mag" else 1.0) for name, value in total.items()})
    return out


def _refined(chain: Chain, transposed: Callable[[Unknowns], Unknowns], row: np.ndarray) -> Unknowns:
    """Solve H'x = (row, 0) by iterative refinement with the Gauss-Newton matrix."""
    x, first, size = (np.zeros(len(row)), np.zeros_like(chain.link_score)), 0.0, 0.0
    left: Unknowns = row, np.zeros_like(chain.link_score)
    for _ in range(_MOST):
        links, steps = chain.steps(-left[1][..., None], -left[0][:, None])
        step = steps[:, 0], links[..., 0]
        x = x[0] + step[0], x[1] + step[1]
        size = math.sqrt(max(step[0] @ left[0] + np.sum(step[1] * left[1]), 0.0))
        first = max(first, size)
        if size <= _EXACT * first:
            return x
        product = transposed(x)
        left = row - product[0], -product[1]
    raise FitError(
        f"the derivatives by the readings were not found in {_MOST} steps: the recording determines too little; record longer and turn the "
        "device through all attitudes, or leave out derivatives=",
        code="derivatives_not_found",
    )


class _Filter:
    """A filter that is evaluated at each sample of every window, or at each but the last one."""

    def __init__(self, record: Record, sensor: str, weights: np.ndarray, shift: int, last: bool = True, length: float = 0.0):
        self.sensor, self.weights, self.length = sensor, weights, length
        self.index = record.grid.inner[:, : None if last else -1] + shift + (TAPS[0] if len(weights) > 1 else 0)

    def of(self, y: np.ndarray) -> np.ndarray:
        return sum(weight * y[self.index + i] for i, weight in enumerate(self.weights))  # type: ignore[return-value]

    def back(self, by: np.ndarray, count: int) -> np.ndarray:
        """Derivative by the readings (count, 3), from the derivative by the outputs."""
        at, out = np.zeros((count, 3)), np.zeros((count, 3))
        np.add.at(at, self.index, by)
        for i, weight in enumerate(self.weights):
            out[i:] += weight * at[: count - i]
        return out


def _filters(record: Record, found: Solution) -> dict[str, _Filter]:
    """The filters that `windows` applies, and time derivatives of the rate, which second derivatives by the delays need."""
    h = record.grid.step
    late, early = found.vector[GYRO_DELAY] / h, -found.vector[MAG_DELAY] / h
    shift = math.floor(late)
    x = late - shift
    end = x + early - found.back
    over = int(end >= 1)
    rate = [math.factorial(n) * lagrange(x)[:, n] / h**n for n in range(4)]
    field = [math.factorial(n) * lagrange(end - over)[:, n] / h**n for n in range(2)]

    def two(first: np.ndarray, second: np.ndarray) -> np.ndarray:
        return h * (np.append(first, 0.0) + np.append(0.0, second))

    start, stop = (1.0, end - 1) if over else (end, 0.0)
    out = {name: _Filter(record, "gyro", rate[n], shift) for n, name in enumerate(("rate", "slope", "curve", "third"))}
    out |= {name: _Filter(record, "gyro", field[n], shift + over, False) for n, name in enumerate(("field_rate", "field_slope"))}
    out["turn"] = _Filter(record, "gyro", two(integral_weights(x, 1.0), integral_weights(0.0, x)), shift, False)
    weights = two(integral_weights(x, start), integral_weights(0.0, stop))
    out["field_turn"] = _Filter(record, "gyro", weights, shift, False, h * (end - x))
    out["force"] = _Filter(record, "accel", np.ones(1), 0)
    out["field"] = _Filter(record, "mag", np.ones(1), -found.back, False)
    return out


@jax.jit
def _by(change: Unknowns, fed: dict[str, Any], x: Unknowns, left: tuple, along: tuple, fixed: dict[str, Any]) -> tuple:
    """Derivatives of x'g by the unknowns, and by the outputs of the filters.

    x'g = x'J'P r has the same derivative as u'r + v'J x - u'P^-1 v, in which v = P r and u = P J x are constant.
    """

    def total(change: Unknowns, fed: dict[str, Any]) -> Any:
        own, by = jax.jvp(lambda c: _residuals(c, fed, fixed), (change,), (x,))
        inertial, field, spread, *prior = own
        value = jnp.sum(along[0] * inertial) + jnp.sum(left[0] * by[0]) + jnp.sum(along[1] * field) + jnp.sum(left[1] * by[1])
        value -= jnp.sum(along[0] * (spread @ left[0][..., None])[..., 0])
        value += sum(jnp.sum(slope * row) for row, slope in zip(prior, by[3:], strict=True))
        return value + jnp.sum(x[0] * change[0] / fixed["size"] ** 2)

    return jax.grad(total, argnums=(0, 1))(change, fed)


def _residuals(change: Unknowns, fed: dict[str, Any], fixed: dict[str, Any]) -> tuple[Any, ...]:
    """Inertial and field residuals, the covariance of the former, and the residuals of the priors."""
    moved = jnp.zeros(len(NAMES)).at[fixed["free"]].add(change[0])
    model, links = model_of(fixed["vector"] + moved), change[1]
    rotation = fixed["way"][0] @ _turn(links[:, :3])
    velocity, place = (now + links[:, 3 * i : 3 * i + 3] for i, now in enumerate(fixed["way"][1:], start=1))
    # readings at other delays, to second order
    late, step = moved[GYRO_DELAY], fixed["step"]
    both = late - moved[MAG_DELAY]
    again = fed["rate"] + late * fed["slope"] + late**2 / 2 * fed["curve"]
    slope = fed["slope"] + late * fed["curve"] + late**2 / 2 * fed["third"]
    turn = fed["turn"] + late * jnp.diff(fed["rate"], axis=1) + late**2 / 2 * jnp.diff(fed["slope"], axis=1)
    part = both + fixed["later"]
    part = fed["field_turn"] + part * fed["field_rate"] + part**2 / 2 * fed["field_slope"]
    part = part - late * fed["rate"][:, :-1] - late**2 / 2 * fed["slope"][:, :-1]

    gyro, accel = jnp.linalg.inv(model.gyro.matrix), jnp.linalg.inv(model.accel.matrix)
    bias, arm, (count, steps) = model.gyro.bias, model.arm, turn.shape[:2]
    rate, force = (again - bias) @ gyro.T, (fed["force"] - model.accel.bias) @ accel.T
    whirl = skew(rate)
    bent = skew(slope @ gyro.T) + whirl @ whirl
    swing = [jnp.zeros((count, steps + 1)), *(bent[:, :, axis] @ model.lever[axis - 1] for axis in (1, 2))]
    force = force - jnp.stack(swing, axis=2)
    pressed = force @ model.gyro.g_sensitivity.T
    rate = rate - pressed @ gyro.T
    small = (turn - step * (bias + (pressed[:, 1:] + pressed[:, :-1]) / 2)) @ gyro.T
    small = small + step**2 / 12 * _times(skew(rate[:, :-1]), rate[:, 1:])
    begin = jnp.broadcast_to(jnp.eye(3), (count, 3, 3))
    _, later = jax.lax.scan(lambda r, by: (r @ by, r @ by), begin, jnp.swapaxes(_turn(small), 0, 1))
    whole = jnp.concatenate([begin[:, None], jnp.swapaxes(later, 0, 1)], axis=1)
    pushed = jnp.einsum("kiab,kib->kia", whole, force)
    half = jnp.full(steps + 1, step).at[jnp.array([0, steps])].set(step / 2)
    twice = step**2 * (steps - jnp.arange(steps + 1.0)).at[0].set((2 * steps - 1) / 4).at[steps].set(0.25)
    time, down = steps * step, jnp.array([0.0, 0.0, 1.0]) * fixed["gravity"]
    back, end = jnp.swapaxes(rotation[:-1], 1, 2), jnp.swapaxes(whole[:, -1], 1, 2)
    swept, relative, pushes = (skew(rate[:, 0]) @ arm, skew(rate[:, -1]) @ arm), back @ rotation[1:], half @ pushed
    speed = _times(back, jnp.diff(velocity, axis=0) + time * down) + _times(relative, swept[1]) - swept[0] - pushes
    went = _times(back, jnp.diff(place, axis=0) - time * velocity[:-1] + time**2 / 2 * down)
    went = went + relative @ arm - arm - time * swept[0] - twice @ pushed
    inertial = jnp.concatenate([_angles(end @ back @ fixed["earth"] @ rotation[1:]), speed, went], axis=1)
    part = (part - (fixed["late"] - moved[MAG_DELAY]) * (bias + pressed[:, :-1])) @ gyro.T
    seen = jnp.einsum("kiba,kb->kia", whole[:, :-1] @ _turn(part), back @ model.world_field)
    field = seen @ model.magnetometer.soft_iron.T + model.magnetometer.hard_iron - fed["field"]

    gyro_level, accel_level = fixed["noise"]
    spread = spread_of(pushes / time, end, gyro_level, accel_level, time, jnp)
    prior = [fixed["turn"] * _angles(relative)]
    for residual, here, after in fixed["prior"]:
        prior.append(residual + _times(here, links[: len(here)]) + (0.0 if after is None else _times(after, links[1:])))
    return inertial, field, spread, *prior


def _times(matrix: Any, vector: Any) -> Any:
    """Products of matrices with vectors."""
    return (matrix @ vector[..., None])[..., 0]


def _turn(v: Any) -> Any:
    """Rotation matrices of vectors below 1 rad: the eighth power of the series for an eighth, which has derivatives at zero."""
    cross = skew(v / 8)
    square = cross @ cross
    turn = jnp.eye(3) + cross + square / 2 + square @ (cross / 6 + square / 24)
    for _ in range(3):
        turn = turn @ turn
    return turn


def _angles(r: Any) -> Any:
    """Rotation vectors of rotations by less than 20 degrees, from the series of the arc sine."""
    half = r.reshape(*r.shape[:-2], 9) @ CROSS.T / 2
    square, factor = jnp.sum(half * half, axis=-1, keepdims=True), 1.0
    for n in range(4, 0, -1):
        factor = 1 + square * (2 * n - 1) ** 2 / (2 * n * (2 * n + 1)) * factor
    return factor * half
