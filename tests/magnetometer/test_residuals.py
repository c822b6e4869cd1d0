"""Distances to the ellipsoid against a numerical search for the nearest point, and their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.optimize

from jaxcal.magnetometer import MagModel, residuals
from jaxcal.magnetometer._orthogonal import curvature

from . import cases

SEMI = np.array([1.0, 1.4, 2.5])
TURN = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
SHAPE = TURN @ np.diag(1 / SEMI**2) @ TURN.T


def searched(z):
    """Distance to the ellipsoid, found by a search over its parameter angles from a grid of starts."""
    a, b = np.meshgrid(np.linspace(0.05, np.pi - 0.05, 40), np.linspace(0, 2 * np.pi, 80))

    def point(angles):
        x = np.stack([np.sin(angles[0]) * np.cos(angles[1]), np.sin(angles[0]) * np.sin(angles[1]), np.cos(angles[0])])
        return np.tensordot(TURN * SEMI, x, axes=1)

    grid = np.linalg.norm(point(np.stack([a.ravel(), b.ravel()])) - z[:, None], axis=0)
    begin = np.array([a.ravel()[grid.argmin()], b.ravel()[grid.argmin()]])
    found = scipy.optimize.minimize(lambda x: np.sum((point(x) - z) ** 2), begin, method="BFGS", options={"gtol": 1e-12})
    return np.sqrt(found.fun) * np.sign(z @ SHAPE @ z - 1)


@pytest.mark.filterwarnings("default")
def test_distance_is_that_to_the_nearest_point():
    z = (TURN * SEMI @ cases.directions(30, 0).T).T * np.random.default_rng(0).uniform(0.6, 1.8, (30, 1))
    found = np.asarray(residuals(MagModel(TURN * SEMI, np.zeros(3)), (z, 1.0)))
    np.testing.assert_allclose(found, [searched(row) for row in z], atol=1e-6)


def test_distance_to_a_sphere_and_along_the_axes():
    sphere = residuals(MagModel(np.eye(3), np.zeros(3)), (np.array([[3.0, 0, 0], [0, 0.5, 0], [0, 0, 2.0]]), 2.0))
    np.testing.assert_allclose(sphere, [1.0, -1.5, 0.0], atol=1e-12)
    model = MagModel(np.diag([1.0, 2.0, 1.0]), np.array([1.0, 0.0, 0.0]))
    m = jnp.array([[1.0, 11.0, 0.0], [5.0, 0.0, 0.0]])
    np.testing.assert_allclose(residuals(model, (m, 5.0)), [1.0, -1.0], atol=1e-12)


def test_mean_curvature_of_an_ellipsoid_at_its_poles():
    # at the end of semi-axis c the principal curvatures are c/a^2 and c/b^2
    a, b, c = SEMI
    found = curvature(np.diag(1 / SEMI**2), np.array([[0.0, 0.0, c]]))
    assert float(found[0]) == pytest.approx((c / a**2 + c / b**2) / 2, rel=1e-12)


def test_residuals_alone_under_jit_vmap_and_grad():
    model = MagModel(jnp.asarray(cases.MILD.soft_iron), jnp.asarray(cases.MILD.hard_iron))
    m = jnp.asarray(cases.readings(cases.MILD, cases.directions(12, 2), 0.05, 0))
    eager = residuals(model, (m, 1.0))
    np.testing.assert_allclose(jax.jit(residuals)(model, (m, 1.0)), eager, rtol=1e-10, atol=1e-13)
    batch = jax.vmap(lambda rows: residuals(model, (rows, 1.0)))(m.reshape(3, 4, 3))
    np.testing.assert_allclose(batch.ravel(), eager, rtol=1e-10, atol=1e-13)

    @jax.jit
    def cost(soft, hard, rows):
        return jnp.sum(residuals(MagModel(soft, hard), (rows, 1.0)) ** 2)

    arguments = (model.soft_iron, model.hard_iron, m)
    slopes = jax.grad(cost, (0, 1, 2))(*arguments)
    for which in range(3):
        slope = np.asarray(slopes[which])
        for index in list(np.ndindex(slope.shape))[:9]:
            ends = []
            for step in (1e-6, -1e-6):
                changed = list(arguments)
                changed[which] = changed[which].at[index].add(step)
                ends.append(float(cost(*changed)))
            assert slope[index] == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=2e-6, abs=1e-8)


def test_second_derivative_of_the_distance():
    # the derivatives that differentiating a fit with respect to its data needs
    z = jnp.asarray((TURN * SEMI @ cases.directions(6, 4).T).T * 1.1)

    slope = jax.jit(jax.grad(lambda soft: jnp.sum(residuals(MagModel(soft, jnp.zeros(3)), (z, 1.0)) ** 2)))
    soft, change = jnp.asarray(TURN * SEMI), jnp.asarray(np.random.default_rng(1).normal(size=(3, 3)))
    exact = jax.jvp(slope, (soft,), (change,))[1]
    finite = (slope(soft + 1e-6 * change) - slope(soft - 1e-6 * change)) / 2e-6
    np.testing.assert_allclose(exact, finite, rtol=1e-5, atol=1e-6)


@pytest.mark.filterwarnings("ignore::jaxcal.PrecisionWarning")  # the warning says that the fit is traced in float32
def test_float32_stays_float32():
    with jax.enable_x64(False):
        model = MagModel(jnp.eye(3), jnp.zeros(3))
        m = jnp.array([[2.0, 0.0, 0.0]], dtype=jnp.float32)
        assert residuals(model, (m, 1.0)).dtype == jnp.float32
        assert float(residuals(model, (m, 1.0))[0]) == pytest.approx(1.0, rel=1e-5)
