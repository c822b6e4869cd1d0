"""`Triad`, its conversion to the forms of other programs, rotations and gravity: closed forms and exact inverses."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from jaxcal import DataError, _rotation
from jaxcal.imu import ArduPilot, ImuTk, Kalibr, OpenVins, Px4, Triad, attitude, gravity, turned_to


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


def test_a_triad_refuses_what_it_cannot_undo():
    flat = Triad(np.array([[1.0, 0, 0], [0, 1, 0], [1, 1, 1e-3]]), np.zeros(3))
    with pytest.raises(DataError, match=r"condition number .* beyond 100"):
        flat.correct(np.ones(3))
    gyro = triads(0)[1]
    with pytest.raises(DataError, match="has a g-sensitivity: give the specific force"):
        gyro.measure(np.ones((4, 3)))
    with pytest.raises(DataError, match=r"shape \(3, 2\) and accel \(3, 2\); expected"):
        gyro.correct(np.ones((3, 2)), np.ones((3, 2)))
    with pytest.raises(DataError, match="the same for both"):
        gyro.correct(np.ones((2, 3)), np.ones((3, 3)))


def test_a_triad_is_traced_like_any_function():
    _, gyro = triads(2)
    gyro = jax.tree.map(jnp.asarray, gyro)
    y, f = jnp.ones((5, 3)), jnp.full((5, 3), 2.0)
    eager = np.asarray(gyro.correct(y, f))
    np.testing.assert_allclose(jax.jit(lambda t, a, b: t.correct(a, b))(gyro, y, f), eager, rtol=1e-12)
    np.testing.assert_allclose(jax.vmap(gyro.correct)(y, f), eager, rtol=1e-12)
    slope = jax.jit(jax.grad(lambda t: jnp.sum(t.correct(y, f)[:, 0])))(gyro)
    np.testing.assert_allclose(slope.bias, -5 * np.linalg.inv(gyro.matrix)[0], rtol=1e-12)


def errors_of(first, second):
    """Largest difference of quantities that do not depend on the frame, between two calibrations of the same device.

    The quantities are the products of force with force, rate with rate, and force with rate.
    """
    rng = np.random.default_rng(3)
    y, z = rng.normal(size=(40, 3)), rng.normal(size=(40, 3))
    f, g = first[0].correct(y), second[0].correct(y)
    w, v = first[1].correct(z, f), second[1].correct(z, g)
    return max(np.abs(np.sum(a * b, axis=1) - np.sum(c * d, axis=1)).max() for a, b, c, d in ((f, f, g, g), (w, w, v, v), (f, w, g, v)))


@pytest.mark.parametrize("seed", range(5))
def test_forms_of_other_programs_are_exact_inverses(seed):
    accel, gyro = triads(seed)
    back = ImuTk.of(accel).triad()
    np.testing.assert_allclose(back.matrix, accel.matrix, atol=1e-12)
    np.testing.assert_allclose(np.diag(ImuTk.of(accel).misalignment), 1, atol=1e-15)
    kalibr = Kalibr.of(accel, gyro)
    for matrix in (kalibr.accel_matrix, kalibr.gyro_matrix):
        np.testing.assert_allclose(np.triu(matrix, 1), 0, atol=1e-13)
    np.testing.assert_allclose(kalibr.rotation @ kalibr.rotation.T, np.eye(3), atol=1e-13)
    assert np.linalg.det(kalibr.rotation) == pytest.approx(1)
    assert errors_of((accel, gyro), kalibr.triads()) < 1e-11
    for model, zero in (("kalibr", np.triu), ("rpng", np.tril)):
        vins = OpenVins.of(accel, gyro, model)
        for matrix in (vins.accel_correction, vins.gyro_correction):
            np.testing.assert_allclose(zero(matrix, 1 if model == "kalibr" else -1), 0, atol=1e-13)
        leading = vins.accel_rotation if model == "kalibr" else vins.gyro_rotation
        np.testing.assert_allclose(leading, np.eye(3), atol=1e-12)
        assert errors_of((accel, gyro), vins.triads()) < 1e-11
        # in the frame of the OpenVINS model the round trip reproduces every element
        again = OpenVins.of(*vins.triads(), model)
        np.testing.assert_allclose(again.gyro_correction, vins.gyro_correction, atol=1e-12)
        np.testing.assert_allclose(again.g_sensitivity, vins.g_sensitivity, atol=1e-12)


def test_formulas_of_the_other_programs_give_what_correct_gives():
    """The formulas are written as in those programs and do not use the inverse of jaxcal."""
    accel, gyro = triads(7)
    y, z = np.array([0.3, -1.2, 9.1]), np.array([0.2, 0.1, -0.4])
    t = ImuTk.of(accel)
    np.testing.assert_allclose(t.misalignment @ np.diag(t.scale) @ (y - t.bias), accel.correct(y), atol=1e-12)
    k = Kalibr.of(accel, gyro)
    first, second = k.triads()
    f, w = np.array([1.0, 2.0, 9.0]), np.array([0.1, -0.3, 0.2])
    np.testing.assert_allclose(k.accel_matrix @ f + k.accel_bias, first.measure(f), atol=1e-12)
    reading = k.gyro_matrix @ k.rotation @ w + k.g_sensitivity @ k.rotation @ f + k.gyro_bias
    np.testing.assert_allclose(reading, second.measure(w, f), atol=1e-12)
    o = OpenVins.of(accel, gyro)
    first, second = o.triads()
    force = o.accel_rotation @ o.accel_correction @ (y - o.accel_bias)
    np.testing.assert_allclose(force, first.correct(y), atol=1e-12)
    rate = o.gyro_rotation @ o.gyro_correction @ (z - o.gyro_bias - o.g_sensitivity @ force)
    np.testing.assert_allclose(rate, second.correct(z, force), atol=1e-12)


def test_flight_controllers_keep_scales_and_say_what_is_lost():
    diagonal = Triad(np.diag([1.1, 0.9, 1.2]), np.array([0.1, 0.2, 0.3]))
    for form in (Px4.of(diagonal), ArduPilot.of(diagonal)):
        np.testing.assert_allclose(form.triad().matrix, diagonal.matrix, atol=1e-14)
        np.testing.assert_allclose(form.lost, 0, atol=1e-14)
    turned = Triad(diagonal.matrix @ Rotation.from_euler("z", 90, degrees=True).as_matrix().T, diagonal.bias)
    form = Px4.of(turned, Rotation.from_euler("z", 90, degrees=True).as_matrix())
    np.testing.assert_allclose(form.triad().matrix, turned.matrix, atol=1e-14)
    accel, gyro = triads(0)
    np.testing.assert_allclose(Px4.of(accel).lost[0, 1], accel.matrix[0, 1] / accel.matrix[0, 0], rtol=1e-12)
    np.testing.assert_array_equal(ArduPilot.of(gyro, "gyro").triad().matrix, np.eye(3))
    with pytest.raises(DataError, match="not positive"):
        Px4.of(Triad(-np.eye(3), np.zeros(3)))
    with pytest.raises(DataError, match="no OpenVINS model"):
        OpenVins.of(accel, gyro, "other")
    with pytest.raises(DataError, match="no sensor"):
        ArduPilot.of(accel, "mag")


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


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 0.5, 3.1])
def test_rotations_are_those_of_scipy_and_have_derivatives_at_the_identity(angle):
    axis = np.array([0.6, 0.0, 0.8])
    v = jnp.asarray(angle * axis)
    q = _rotation.exponential(v)
    np.testing.assert_allclose(_rotation.matrix(q), Rotation.from_rotvec(angle * axis).as_matrix(), atol=1e-14)
    slope = jax.jit(jax.jacfwd(lambda rest: _rotation.exponential(v + rest)))(jnp.zeros(3))
    np.testing.assert_allclose(
        slope.T @ slope, np.outer(axis, axis) / 4 + np.sinc(angle / 2 / np.pi) ** 2 / 4 * (np.eye(3) - np.outer(axis, axis)), atol=1e-7
    )
    second = jax.jit(jax.hessian(lambda v: _rotation.exponential(v)[0]))(v)
    assert np.isfinite(second).all()
    if angle == 0:
        np.testing.assert_allclose(second, -np.eye(3) / 4, atol=1e-12)
    other = _rotation.exponential(jnp.array([0.1, -0.2, 0.3]))
    np.testing.assert_allclose(_rotation.matrix(_rotation.product(q, other)), _rotation.matrix(q) @ _rotation.matrix(other), atol=1e-14)
    turned = _rotation.matrix(_rotation.conjugate(_rotation.normalised(3 * q))) @ jnp.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(turned, Rotation.from_rotvec(-angle * axis).apply([1.0, 2.0, 3.0]), atol=1e-13)


@pytest.mark.long
@pytest.mark.parametrize(("integrator", "order"), [("closed_form", 4), ("runge_kutta", 4)])
def test_attitude_converges_to_that_of_a_coning_motion(integrator, order):
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
        q = attitude(jnp.eye(3), jnp.asarray(rate(t))[None], jnp.full((1, n), length / n), integrator)[0]
        found = Rotation.from_matrix(q)
        errors.append((truth.inv() * found).magnitude())
    assert errors[1] < 2e-3
    # both integrators assume rates that are linear between samples; the curvature of this rate reduces the convergence to second order
    assert errors[0] / errors[1] > 3.5


@pytest.mark.parametrize("integrator", ["closed_form", "runge_kutta"])
def test_derivatives_of_the_attitude(integrator):
    rng = np.random.default_rng(0)
    matrix, column, dt = (jnp.asarray(x) for x in (rng.normal(size=(3, 4)), rng.normal(size=(2, 9, 4)), np.full((2, 8), 0.05)))
    along = tuple(jnp.asarray(rng.normal(size=x.shape)) for x in (matrix, column, dt))
    turned = jax.jit(lambda a, b, d: attitude(a, b, d, integrator))
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
