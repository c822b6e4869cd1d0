"""A user-defined accelerometer model with a quadratic term is fitted, plotted and applied without a change of the package.

The readings are computed with NumPy from the formula and do not use the model class.
"""

import dataclasses
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.stats

import jaxcal
from jaxcal.imu import Imu, Poses, Triad, Turns, estimate, multi_position, residuals, weighted

from . import cases

G = 9.81
SQUARE = np.array([2e-4, -3e-4, 1e-4])  # reading per (m/s^2)^2: 0.02 m/s^2 at 1 g
MATRIX = np.array([[1.012, 0.004, -0.006], [0.0, 0.991, 0.009], [0.0, 0.0, 1.005]])
BIAS = np.array([0.12, -0.08, 0.2])
SIGMA = 1e-3


class Quadratic(Triad):
    """y = M f + b + k f^2, where every axis is squared separately."""

    square: Any = eqx.field(default_factory=lambda: np.zeros(3))

    def measure(self, x, accel=None):
        return super().measure(x, accel) + self.square * x**2

    def correct(self, y, accel=None):
        square = jnp.broadcast_to(jnp.asarray(self.square), jnp.shape(y))
        x = super().correct(y, accel)
        for _ in range(2):  # each leaves 0.6 % of the error of 0.03 m/s^2 that there is without
            x = super().correct(y - square * x**2, accel)
        return x


START = Quadratic(np.eye(3), np.zeros(3))
TRUTH = np.concatenate([MATRIX.ravel(), BIAS, SQUARE])
_UP = np.random.default_rng(3).normal(size=(40, 3))
UP = _UP / np.linalg.norm(_UP, axis=1, keepdims=True)


def readings(seed, up=UP, sigma=SIGMA):
    """Mean readings of the poses, computed from the formula, with noise."""
    force = G * up
    return force @ MATRIX.T + BIAS + SQUARE * force**2 + sigma * np.random.default_rng(seed).normal(size=force.shape)


@jax.jit
def fitted(y):
    """Parameter values and standard errors of one set of poses, compiled by JAX."""
    found = estimate(Poses(y, jnp.full(len(UP), SIGMA)), gravity=G, model=START)
    return found.estimate.values, found.estimate.matrix.diagonal(), found.fit.usable


@pytest.mark.long
def test_the_intervals_of_a_model_of_ones_own_hold_the_truth():
    """200 runs in one compiled program: the 95 % intervals of nine triad parameters and three of the term contain 93 to 97 %."""
    runs = np.stack([readings(seed) for seed in range(200)])
    values, variances, usable = (np.asarray(x) for x in jax.jit(jax.vmap(fitted))(runs))
    assert usable.all()
    errors = np.sqrt(variances)
    free = errors[0] > 0
    assert free.sum() == 12
    half = scipy.stats.t.ppf(0.975, len(UP) - 12) * errors
    inside = (np.abs(values - TRUTH) <= half)[:, free]
    assert 0.93 <= inside.mean() <= 0.97
    assert 0.93 <= inside[:, -3:].mean() <= 0.97
    # the standard errors equal the scatter, which 200 runs determine to 5 %
    np.testing.assert_allclose(np.std(values, axis=0)[free] / np.sqrt(np.mean(errors**2, axis=0))[free], 1, atol=0.2)
    found = estimate(Poses(runs[0], np.full(len(UP), SIGMA)), gravity=G, model=START)
    assert found.estimate.names[-3:] == ("accel.square[0]", "accel.square[1]", "accel.square[2]")
    np.testing.assert_allclose(found.estimate.values, values[0], rtol=1e-7, atol=1e-10)
    assert isinstance(found.model.accel, Quadratic)


@pytest.fixture(scope="module")
def recorded():
    """A recording of a linear accelerometer and gyroscope, to which the quadratic term of the accelerometer is added."""
    log = cases.recording(0)
    force = np.linalg.solve(cases.ACCEL.matrix, (log.accel - cases.ACCEL.bias).T).T
    return jaxcal.Log(None, accel=log.accel + SQUARE * force**2, gyro=log.gyro, rate=log.rate)


@pytest.fixture(scope="module")
def found(recorded):
    # the rests are given, since a search for them would need a fit for each threshold
    return multi_position(recorded, gravity=G, model=START, held_out=False, rests=cases.rests())


def test_a_recording_is_fitted_drawn_stored_and_applied(recorded, found, tmp_path, refuses):
    assert found.verdict != "refused"
    assert isinstance(found.accel, Quadratic)
    own = found.estimate.select("accel.square*")
    np.testing.assert_array_equal(own.values, found.accel.square)
    assert np.all(np.abs(own.values - SQUARE) <= 5 * own.error)
    assert len(jaxcal.plot.imu(found)) == 3

    jaxcal.Calibration(imu=found).save(tmp_path / "device.json")
    again = jaxcal.Calibration.load(tmp_path / "device.json")
    part = again.imu.accel
    assert isinstance(part.model, Quadratic)
    np.testing.assert_array_equal(part.model.square, found.accel.square)
    assert part.estimate.names[-3:] == ("square[0]", "square[1]", "square[2]")
    np.testing.assert_array_equal(part.estimate.matrix[-3:, -3:], own.matrix)
    # the magnitude at every rest is gravity to 5e-3 m/s^2, whereas the quadratic term is 0.02 m/s^2
    force = again.correct(recorded).accel
    rests = np.array([np.linalg.norm(force[i:j].mean(axis=0)) for i, j in zip(found.still.start, found.still.stop, strict=True)])
    np.testing.assert_allclose(rests, G, atol=5e-3)
    with refuses("full_of_own_model"):
        multi_position(recorded, gravity=G, model=START, convention="full")


def test_a_field_of_ones_own_is_in_every_output(recorded, found, tmp_path):
    """The class above is the only place that names the field."""
    assert any(line.startswith("square ") for line in found.summary().splitlines())
    assert any(line.startswith("square ") for line in repr(found).splitlines())
    assert "accel.square[2]" in found._repr_html_()
    jaxcal.report.write(found, tmp_path / "report.html", log=recorded)
    assert 'data-number="accel.square[2]"' in (tmp_path / "report.html").read_text(encoding="utf-8")
    document = found.to_dict(recorded)
    assert document["numbers"]["accel.square[2]"]["value"] == document["accel"]["square"][2] == found.accel.square[2]
    frame = found.to_dataframe()
    assert "accel.square[2]" in list(frame["name"])
    moved = jaxcal.Calibration(imu=dataclasses.replace(found, accel=dataclasses.replace(found.accel, square=2 * found.accel.square)))
    changed = jaxcal.calibration.difference(jaxcal.Calibration(imu=found), moved)
    assert "square[2]" in changed[0].parameters
    np.savez(tmp_path / "unit1.npz", time=recorded.time, accel=recorded.accel)
    options = {"gravity": G, "model": START, "held_out": False, "rests": cases.rests()}
    with ThreadPoolExecutor(1) as pool:  # a process would compile the model again
        fleet = jaxcal.batch.run([tmp_path / "unit1.npz"], "imu", executor=pool, options=options)
    assert next(iter(fleet)).coefficients["accel.square[2]"].value == pytest.approx(SQUARE[2], abs=2e-5)


def test_poses_that_do_not_determine_the_term_are_refused():
    faces = np.kron(np.eye(3), np.array([[1.0], [-1.0]]))
    found = estimate(Poses(readings(0, faces), np.full(6, SIGMA)), gravity=G, misalignment=False)
    assert bool(found.fit.usable)
    open_ = estimate(Poses(np.tile(readings(0, faces), (2, 1)), np.full(12, SIGMA)), gravity=G, model=START, misalignment=False)
    assert not bool(open_.fit.usable)
    assert np.isinf(open_.estimate.matrix).any()


def test_residuals_are_pure_and_public():
    """A turn that the gyroscope measures exactly has residuals of zero; with a scale error of 1 % the residual is 1 % of the angle."""
    n, angle = 64, 1.2
    up = np.array([[0.0, 0.0, 1.0], [0.0, np.sin(angle), np.cos(angle)]])
    rate = np.zeros((1, n + 1, 3))
    rate[..., 0] = angle / n / 0.01
    poses = Poses(G * up, np.full(2, 0.01), np.zeros((2, 3)), np.full((2, 3), 1e-3))
    turns = Turns(rate, np.zeros((1, n + 1, 3)), np.full((1, n), 0.01), np.full(1, 1e-3))
    model = Imu(Triad(np.eye(3), np.zeros(3)), Triad(np.eye(3), np.zeros(3)))
    data = weighted(model, poses, turns, gravity=G)
    left = np.asarray(residuals(model, data))
    np.testing.assert_allclose(left, 0, atol=1e-10)
    other = eqx.tree_at(lambda m: m.gyro.matrix, model, 1.01 * np.eye(3))
    spread = np.sqrt(1e-3**2 + 2 * (0.01 / G) ** 2)
    assert np.linalg.norm(residuals(other, data)[2:4]) == pytest.approx(angle * (1 - 1 / 1.01) / spread, rel=1e-3)
    of_gravity = jax.jit(jax.grad(lambda g: jnp.sum(residuals(model, eqx.tree_at(lambda d: d.gravity, data, g)))))(jnp.asarray(G))
    assert float(of_gravity) == pytest.approx(200.0, rel=1e-9)
