"""`Triad`, its conversion to the forms of other programs, rotations and gravity: closed forms and exact inverses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from jaxcal.imu import Triad, gravity
from jaxcal.imu._integrate import attitude
from jaxcal.imu._model import turned_to


def triads(seed):
    """Accelerometer and gyroscope with errors of a few per cent, in readings per SI unit."""
    rng = np.random.default_rng(seed)
    near = [np.eye(3) + 0.05 * rng.normal(size=(3, 3)) for _ in range(2)]
    return Triad(near[0], rng.normal(size=3)), Triad(near[1], 0.1 * rng.normal(size=3), 1e-3 * rng.normal(size=(3, 3)))


def test_measure_is_equation_5_1_and_5_2_and_correct_undoes_it(precision):
    accel, gyro = triads(0)
    rng = np.random.default_rng(1)
    f, w = 9.8 * rng.normal(size=(50, 3)), rng.normal(size=(50, 3))
    y, z = accel.measure(f), gyro.measure(w, f)
    np.testing.assert_allclose(y, f @ accel.matrix.T + accel.bias, rtol=1e-13)
    np.testing.assert_allclose(z, w @ gyro.matrix.T + gyro.bias + f @ gyro.g_sensitivity.T, rtol=1e-12)
    np.testing.assert_allclose(accel.correct(y), f, atol=1e-12)
    np.testing.assert_allclose(gyro.correct(z, accel.correct(y)), w, atol=1e-12)
    np.testing.assert_allclose(gyro.correct(z[3], f[3]), w[3], atol=1e-12)


def test_a_triad_refuses_what_it_cannot_undo(refuses):
    with refuses("singular"):
        Triad(np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 1e-3]]), np.zeros(3)).correct(np.ones(3))
    gyro = triads(0)[1]
    with refuses("no_force"):
        gyro.measure(np.ones((4, 3)))
    for shape in ((3, 2), (2, 3)):
        with refuses("shapes"):
            gyro.correct(np.ones(shape), np.ones((3, shape[1])))


def test_a_triad_is_traced_like_any_function():
    _, gyro = triads(2)
    gyro = jax.tree.map(jnp.asarray, gyro)
    y, f = jnp.ones((5, 3)), jnp.full((5, 3), 2.0)
    eager = np.asarray(gyro.correct(y, f))
    np.testing.assert_allclose(jax.jit(lambda t, a, b: t.correct(a, b))(gyro, y, f), eager, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(gyro.correct)(y, f), eager, rtol=1e-12)
    slope = jax.jit(jax.grad(lambda t: jnp.sum(t.correct(y, f)[:, 0])))(gyro)
    np.testing.assert_allclose(slope.bias, -5 * np.linalg.inv(gyro.matrix)[0], rtol=1e-12)


def test_conventions_are_the_three_factors_of_one_product():
    correction = np.linalg.inv(triads(4)[0].matrix) * 2e-3
    gram = correction.T @ correction
    upper, lower, full = (np.asarray(turned_to(correction, name)) for name in ("upper", "lower", "full"))
    for factor in (upper, lower, full):
        np.testing.assert_allclose(factor.T @ factor, gram, rtol=1e-12)
        assert (np.diag(factor) > 0).all()
    np.testing.assert_allclose(np.tril(upper, -1), 0, atol=1e-17)
    np.testing.assert_allclose(np.triu(lower, 1), 0, atol=1e-17)
    np.testing.assert_allclose(full, scipy.linalg.sqrtm(gram), rtol=1e-9)
    for name in ("upper", "lower", "full"):
        slope = jax.jit(jax.jacfwd(lambda d, name=name: turned_to(d, name)))(jnp.asarray(correction))
        change = 1e-3 * np.random.default_rng(0).normal(size=(3, 3)) * np.abs(correction).max()
        step = 1e-3
        finite = (turned_to(correction + step * change, name) - turned_to(correction - step * change, name)) / (2 * step)
        np.testing.assert_allclose(np.einsum("ijkl,kl->ij", slope, change), finite, atol=1e-7 * np.abs(finite).max())


@pytest.mark.long
def test_attitude_converges_to_that_of_a_coning_motion():
    """Coning motion q(t) = exp(Omega t z) exp(a (cos, sin, 0)) has a known rate at every instant."""
    cone, spin, length = 0.2, 12.0, 1.0

    def attitude_at(t):
        return Rotation.from_rotvec(cone * np.array([np.cos(spin * t), np.sin(spin * t), 0.0]))

    def rate(t):
        c, s = np.cos(spin * t), np.sin(spin * t)
        return np.stack([-np.sin(cone) * spin * s, np.sin(cone) * spin * c, np.full_like(t, -(1 - np.cos(cone)) * spin)], axis=-1)

    truth = attitude_at(0.0).inv() * attitude_at(length)
    errors = []
    for n in (32, 64):
        t = np.linspace(0, length, n + 1)
        q = attitude(jnp.eye(3), jnp.asarray(rate(t))[None], jnp.full((1, n), length / n))[0]
        found = Rotation.from_matrix(q)
        errors.append((truth.inv() * found).magnitude())
    assert errors[1] < 2e-3
    # the integrator assumes rates that are linear between samples; the curvature of this rate reduces the convergence to second order
    assert errors[0] / errors[1] > 3.5


def test_derivatives_of_the_attitude():
    rng = np.random.default_rng(0)
    matrix, column, dt = (jnp.asarray(x) for x in (rng.normal(size=(3, 4)), rng.normal(size=(2, 9, 4)), np.full((2, 8), 0.05)))
    along = tuple(jnp.asarray(rng.normal(size=x.shape)) for x in (matrix, column, dt))
    turned = jax.jit(attitude)
    value, slope = jax.jit(lambda *x: jax.jvp(turned, x, along))(matrix, column, dt)
    np.testing.assert_allclose(value, turned(matrix, column, dt), rtol=0, atol=1e-14)
    step = 1e-5
    ends = [turned(*(x + s * a for x, a in zip((matrix, column, dt), along, strict=True))) for s in (step, -step)]
    np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * step), atol=1e-7)
    back = jax.jit(jax.grad(lambda a: jnp.sum(turned(a, column, dt)[:, 1])))(matrix)
    forward = jax.jit(lambda a: jax.jvp(lambda a: jnp.sum(turned(a, column, dt)[:, 1]), (a,), (along[0],))[1])(matrix)
    assert float(jnp.sum(back * along[0])) == pytest.approx(float(forward), rel=1e-10)
    # padding with steps of zero length changes nothing
    longer = jnp.concatenate([column, column[:, -1:]], axis=1)
    same = turned(matrix, longer, jnp.concatenate([dt, jnp.zeros((2, 1))], axis=1))
    np.testing.assert_allclose(same, value, atol=1e-14)


def test_gravity_is_that_of_the_ellipsoid():
    """WGS 84 publishes 9.7803253359 m/s^2 at the equator and 9.8321849378 m/s^2 at the pole."""
    assert float(gravity(0.0)) == pytest.approx(9.7803253359, abs=1e-10)
    assert float(gravity(np.pi / 2)) == pytest.approx(9.8321849378, abs=1e-9)
    assert float(gravity(0.0) - gravity(0.0, 1000.0)) == pytest.approx(3.086e-3, rel=1e-9)
