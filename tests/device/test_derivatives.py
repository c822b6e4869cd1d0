"""The closed derivatives of a window's residuals against those that JAX finds in the same formulas, written again."""

import jax
import jax.numpy as jnp
import numpy as np

from jaxcal._arrays import from_vector
from jaxcal.device._model import AT, NAMES, model_of, template, vector_of
from jaxcal.device._normal import inertial, rows
from jaxcal.device._windows import Grid, windows

STEPS, STEP, GRAVITY = 5, 0.04, 9.81


def skew(v):
    return jnp.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def turn(v):
    """Rotation by a vector, by its series, which has derivatives at zero."""
    cross, term, total = skew(v), jnp.eye(3), jnp.eye(3)
    for n in range(1, 8):
        term = term @ cross / n
        total = total + term
    return total


def angles(r):
    """Rotation vector of a small rotation, by the series of the logarithm."""
    x, term, total = r - jnp.eye(3), jnp.eye(3), jnp.zeros((3, 3))
    for n in range(1, 8):
        term = term @ x
        total = total - (-1) ** n * term / n
    return jnp.array([total[2, 1] - total[1, 2], total[0, 2] - total[2, 0], total[1, 0] - total[0, 1]]) / 2


def residuals(vector, change, begin, end, w, late, mag_late, made_for):
    """One window: `change` are nine changes at each end; `late`, `mag_late`, `made_for` the delays and the pole for which it was made."""
    model = model_of(vector)
    gyro, accel = jnp.linalg.inv(model.gyro.matrix), jnp.linalg.inv(model.accel.matrix)
    # readings at other delays, to first order
    moved, pole = model.gyro_delay - late, model.gyro_pole - made_for
    rate = (w["rate"] + moved * w["slope"] - pole * w["curve"] - model.gyro.bias) @ gyro.T
    spin = (w["slope"] + moved * w["curve"]) @ gyro.T
    force = (w["force"] - model.accel.bias) @ accel.T
    force = force - model.accel_pole * (jnp.cross(rate, jnp.cross(rate, force)) - jnp.cross(spin, force))
    for axis, arm in ((1, model.lever[0]), (2, model.lever[1])):
        force = force.at[:, axis].add(-(jnp.cross(spin, arm) + jnp.cross(rate, jnp.cross(rate, arm)))[:, axis])
    raw = (w["turn"] + moved * jnp.diff(w["rate"], axis=0) - pole * jnp.diff(w["slope"], axis=0) - STEP * model.gyro.bias) @ gyro.T
    small = raw + STEP**2 / 12 * jnp.cross(rate[:-1], rate[1:])
    r, turned = jnp.eye(3), [jnp.eye(3)]
    for i in range(STEPS):
        r = r @ turn(small[i])
        turned.append(r)
    pushed = jnp.stack([turned[i] @ force[i] for i in range(STEPS + 1)])
    half = jnp.full(STEPS + 1, STEP).at[jnp.array([0, -1])].set(STEP / 2)
    twice = STEP**2 * (STEPS - jnp.arange(STEPS + 1.0))
    twice = twice.at[0].set(STEP**2 * (2 * STEPS - 1) / 4).at[-1].set(STEP**2 / 4)
    (r0, v0, p0), (r1, v1, p1) = begin, end
    r0, v0, p0 = r0 @ turn(change[0:3]), v0 + change[3:6], p0 + change[6:9]
    r1, v1, p1 = r1 @ turn(change[9:12]), v1 + change[12:15], p1 + change[15:18]
    time, down = STEP * STEPS, jnp.array([0.0, 0.0, GRAVITY])
    swept0, swept1 = jnp.cross(rate[0], model.arm), jnp.cross(rate[-1], model.arm)
    first = r0.T @ (v1 - v0 + time * down) + r0.T @ r1 @ swept1 - swept0 - half @ pushed
    second = r0.T @ (p1 - p0 - time * v0 + time**2 / 2 * down) + r0.T @ r1 @ model.arm - model.arm - time * swept0 - twice @ pushed
    earlier = mag_late - model.mag_delay
    fields = []
    for i in range(STEPS):
        part = w["field_turn"][i] + earlier * w["field_rate"][i] + moved * (w["field_rate"][i] - w["rate"][i])
        part = part - pole * w["field_time"][i] / STEP * (w["slope"][i + 1] - w["slope"][i])
        part = (part - (w["field_time"][i] + earlier) * model.gyro.bias) @ gyro.T
        at = (turned[i] @ turn(part)).T @ r0.T @ model.world_field
        fields.append(model.magnetometer.soft_iron @ at + model.magnetometer.hard_iron - w["field"][i])
    return jnp.concatenate([angles(turned[-1].T @ r0.T @ r1), first, second, jnp.stack(fields).ravel()])


def test_closed_derivatives_are_those_of_automatic_differentiation():
    rng = np.random.default_rng(3)
    vector = vector_of(template()) + 0.02 * rng.normal(size=len(NAMES))
    vector[AT["accel_pole"]] = 0.0  # the other derivatives leave out what the pole adds to them, some 1e-3 of each
    vector[AT["accel.g_sensitivity"]] = vector[AT["gyro.g_sensitivity"]] = 0.0  # sensitivities are options
    time = np.arange(60) * STEP
    wave = lambda size: size * np.sin(time[:, None] * rng.uniform(1, 3, 3) + rng.uniform(0, 6, 3))  # noqa: E731
    accel, gyro, mag = wave(3.0) + np.array([0.0, 0.0, GRAVITY]), wave(1.0), wave(0.6)
    grid = Grid(np.array([24]), STEPS, STEP)
    late, mag_late = vector[NAMES.index("gyro_delay")], vector[NAMES.index("mag_delay")]
    made, model = windows(grid, accel, gyro, mag, late, mag_late), model_of(vector)
    integrated = inertial(model, made, lever=True)
    begin = from_vector(rng.normal(size=3))
    states = (
        np.stack([begin, begin @ integrated.rotation[0, -1] @ from_vector(1e-3 * rng.normal(size=3))]),
        rng.normal(size=(2, 3)), 0.1 * rng.normal(size=(2, 3)),
    )  # fmt: skip
    whiten, weight = np.eye(9)[None], np.ones((1, STEPS))
    own = rows(states, made, integrated, model, whiten, weight, GRAVITY, np.eye(3))
    names = ("force", "rate", "slope", "curve", "turn", "field", "field_turn", "field_rate", "field_time")
    w = {name: jnp.asarray(getattr(made, name)[0]) for name in names}
    ends = [tuple(jnp.asarray(x[k]) for x in states) for k in (0, 1)]
    of = lambda v, c: residuals(v, c, *ends, w, late, mag_late, vector[-1])  # noqa: E731
    at = jnp.asarray(vector), jnp.zeros(18)
    with jax.numpy_rank_promotion("allow"):
        value, by = jax.jit(lambda *at: (of(*at), jax.jacfwd(of, argnums=(0, 1))(*at)))(*at)
    np.testing.assert_allclose(np.concatenate([own.inertial[0], own.field[0].ravel()]), value, atol=1e-9)
    held = ("accel.g_sensitivity", "gyro.g_sensitivity", "field")
    skipped = [i for i, name in enumerate(NAMES) if name.partition("[")[0] in held]
    free = np.setdiff1d(np.arange(len(NAMES)), skipped)
    # turns within a step are taken to third order
    np.testing.assert_allclose(own.inertial_by[0][:, free], by[0][:9, free], atol=2e-5)
    np.testing.assert_allclose(own.inertial_by[0][:, len(NAMES) :], by[1][:9], atol=2e-5)
    field_by = own.field_by[0].reshape(3 * STEPS, -1)
    np.testing.assert_allclose(field_by[:, free], by[0][9:, free], atol=2e-5)
    np.testing.assert_allclose(field_by[:, len(NAMES) :], by[1][9:, :3], atol=2e-5)
