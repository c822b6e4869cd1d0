"""`estimate` with a gyroscope: it recovers a simulated device, and its derivatives under jit agree with finite differences."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal.imu import Poses, Turns, estimate

from . import cases

LATITUDE = np.deg2rad(40.0)
COUNT = 16


@pytest.fixture(scope="module")
def data():
    """Poses and turns of a simulated recording, cut at the times that the simulation used."""
    log = cases.recording(0, poses=COUNT, up=cases.UP[:COUNT], latitude=LATITUDE)
    turn, (start, stop) = int(cases.TURN * cases.RATE), cases.rests(COUNT).T
    accel, gyro = (np.array([x[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)]) for x in (log.accel, log.gyro))
    root = np.sqrt((stop - start) / cases.RATE)
    poses = Poses(accel, cases.NOISE["accel"] / root, gyro, np.repeat(cases.NOISE["gyro"] / root[:, None], 3, axis=1))
    index = stop[:-1, None] - 1 + np.arange(turn + 2)
    sigma = np.full(COUNT - 1, cases.NOISE["gyro"] * np.sqrt(cases.TURN))
    return poses, Turns(log.gyro[index], log.accel[index], np.full((COUNT - 1, turn + 1), 1 / cases.RATE), sigma)


@jax.jit
def scale(gravity, latitude, poses, turns):
    """A number that depends on all arguments. The fit has no robust loss: finite differences would step across its corners."""
    found = estimate(poses, turns, gravity=gravity, latitude=latitude)
    return found.model.gyro.matrix[0, 1] + 1e3 * found.model.gyro.g_sensitivity[2, 2] + found.model.accel.bias[0], found


def test_both_sensors_from_poses_and_turns(data):
    _, found = scale(jnp.asarray(cases.GRAVITY), jnp.asarray(LATITUDE), *jax.tree.map(jnp.asarray, data))
    assert bool(found.fit.usable)
    error = np.abs(np.asarray(found.estimate.values) - cases.turned_truth())
    free = np.asarray(found.estimate.error) > 0
    assert free.sum() == 30
    assert np.all(error[free] <= 5 * np.asarray(found.estimate.error)[free])
    np.testing.assert_allclose(error[~free], 0, atol=1e-12)


@pytest.mark.long
def test_derivatives_by_held_values_and_readings(data):
    poses, turns = jax.tree.map(jnp.asarray, data)
    at = (jnp.asarray(cases.GRAVITY), jnp.asarray(LATITUDE), poses, turns)
    slope = jax.jit(jax.grad(lambda *x: scale(*x)[0], argnums=(0, 1, 2, 3)))(*at)
    rng = np.random.default_rng(0)
    # NumPy does the arithmetic below, since JAX would compile each operation for each shape
    at, slope = jax.tree.map(np.asarray, (at, slope))
    poses, turns = at[2:]
    zero = jax.tree.map(np.zeros_like, at)
    shaken = rng.normal(size=turns.gyro.shape)
    for along, step in (
        ((np.asarray(1.0), *zero[1:]), 1e-3),
        ((zero[0], np.asarray(1.0), *zero[2:]), 1e-2),
        ((*zero[:2], jax.tree.map(lambda x: rng.normal(size=x.shape) * np.max(np.abs(x)), poses), zero[3]), 1e-5),
        ((*zero[:3], Turns(shaken, shaken, 0.01 * turns.dt, 0.1 * turns.sigma)), 1e-4),
    ):
        expected = sum(float(np.sum(a * b)) for a, b in zip(*map(jax.tree.leaves, (slope, along)), strict=True))
        ends = [float(scale(*jax.tree.map(lambda x, d, s=s * step: x + s * d, at, along))[0]) for s in (1, -1)]
        assert expected == pytest.approx((ends[0] - ends[1]) / (2 * step), rel=1e-4)
