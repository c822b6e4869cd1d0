"""Every estimator under every transform of JAX: the same values as without one, and the derivatives of central differences."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxcal import PrecisionWarning, alignment, allan, budget, imu, magnetometer, noise, spectrum, temperature
from jaxcal.alignment import Readings, Sensor
from jaxcal.noise import Noise

from .magnetometer import cases

RNG = np.random.default_rng(0)
RECORD = Noise(N=1e-3, B=1e-4, K=1e-5).simulate(512, 10.0, seed=3)
TUMBLE = cases.paper_readings("all", 0.2, 0)[:60]
TIME = np.linspace(-1.0, 1.0, 60)
UP = np.random.default_rng(1).normal(size=(18, 3))
FORCE = 9.81 * UP / np.linalg.norm(UP, axis=1, keepdims=True)
WARM = np.linspace(10.0, 40.0, 600)
ATTITUDE, LATITUDE = np.deg2rad([2.0, -1.0, 40.0]), 0.6
SENSORS = {"accel": Sensor(bias=1e-3, white=1e-6), "gyro": Sensor(bias=5e-8, white=1e-8)}
TABLE = alignment.simulate(np.arange(0, 2 * np.pi, np.pi / 4), ATTITUDE, LATITUDE, **SENSORS)
FOUR = alignment.simulate(np.arange(0, 2 * np.pi, np.pi / 2), ATTITUDE, LATITUDE, **SENSORS)


class Drifting(magnetometer.MagModel):
    """A hard iron in proportion to the time, for a class that takes any condition."""

    rate: jax.Array

    def measure(self, h, **conditions):
        return jnp.asarray(h) @ self.soft_iron.T + self.hard_iron[None] + conditions["time"][:, None] * self.rate[None]

    def correct(self, m, **conditions):
        return (jnp.asarray(m) - self.hard_iron[None] - conditions["time"][:, None] * self.rate[None]) @ jnp.linalg.inv(self.soft_iron).T


def hard_iron(m, **options):
    return magnetometer.fit(m, **options).model.hard_iron


def coefficients(y):
    found = noise.fit(y, 10.0, terms=("N", "B", "K")).noise
    return jnp.stack([jnp.asarray(getattr(found, term)) for term in "NBK"])


def aligned(angle):
    moved = alignment.Positions(angle, TABLE.positions.mounting, TABLE.positions.dwell)
    found = alignment.fit(Readings(moved, TABLE.accel, TABLE.gyro, accel_noise=TABLE.accel_noise, gyro_noise=TABLE.gyro_noise), LATITUDE)
    return jnp.stack([jnp.asarray(found.psi), jnp.asarray(found.phi)])


def heading(size):
    found = budget.propagate({"gyro": Noise(N=size[0], B=2e-5), "accel": Noise(N=size[1])}, budget.Motion.rest(60.0), at=[60.0])
    return found.std("heading")


#: estimator -> function of one array to another, where it is tried, and a step for differences
FITS = {
    "allan.deviation": (lambda y: allan.deviation(y, 10.0, m=[1, 2, 5, 12]).deviation, RECORD[:200], 1e-6),
    **{
        f"spectrum.density, {method}": (lambda y, method=method: spectrum.density(y, 10.0, method=method).density, RECORD[:300], 1e-6)
        for method in ("periodogram", "welch", "dct")
    },
    "noise.fit": (coefficients, RECORD, 1e-6),
    "magnetometer.fit, sphere": (functools.partial(hard_iron, model="sphere"), TUMBLE, 1e-3),
    "magnetometer.fit, diagonal": (functools.partial(hard_iron, model="diagonal"), TUMBLE, 1e-3),
    "magnetometer.fit, symmetric": (functools.partial(hard_iron, model="symmetric"), TUMBLE, 1e-3),
    "magnetometer.fit, own model": (
        functools.partial(hard_iron, model=Drifting(np.eye(3), np.zeros(3), np.zeros(3)), field=cases.FIELD, conditions={"time": TIME}),
        TUMBLE, 1e-3,
    ),
    "imu.estimate": (
        lambda y: imu.estimate(imu.Poses(y, np.full(18, 2e-3)), gravity=9.81).model.accel.bias,
        imu.MEMS.accel.measure(FORCE) + 2e-3 * RNG.normal(size=(18, 3)), 1e-4,
    ),
    "temperature.fit, polynomial": (
        lambda b: temperature.fit(WARM, b, model="polynomial", degree=3).model.bias_at(np.array([15.0, 30.0])),
        0.01 + 2e-4 * WARM + 1e-4 * RNG.normal(size=600), 1e-5,
    ),
    "temperature.fit, table": (
        lambda b: temperature.fit(WARM, b, model="table").model.bias_at(np.array([15.0, 30.0])),
        0.01 + 2e-4 * WARM + 1e-4 * RNG.normal(size=600), 1e-5,
    ),
    "alignment.fit": (aligned, TABLE.positions.angle, 1e-5),
    "budget.propagate": (heading, np.array([1e-4, 1e-3]), 1e-7),
}  # fmt: skip
CLOSED = {
    "alignment.level": (
        lambda f: (lambda found: jnp.stack([jnp.asarray(found.phi), jnp.asarray(found.theta)]))(
            alignment.level(Readings(FOUR.positions, accel=f), hint=0.0)
        ),
        FOUR.accel, 1e-4,
    ),
    "alignment.azimuth": (
        lambda w: jnp.reshape(alignment.azimuth(Readings(FOUR.positions, gyro=w), ATTITUDE[:2], LATITUDE, hint=0.7).psi, (1,)),
        FOUR.gyro, 1e-9,
    ),
}  # fmt: skip


@functools.cache
def expected(name):
    """Values, a direction, weights of the values, and the change of the values along the direction."""
    function, x, step = (FITS | CLOSED)[name]
    along = np.random.default_rng(2).normal(size=x.shape)
    value = np.asarray(function(x))
    return value, along, np.linspace(1, 2, value.size), (np.asarray(function(x + step * along)) - function(x - step * along)) / (2 * step)


#: transform -> what it makes of a function and where it is tried: values of the function, or the gradient of its weighted sum
VALUES = {"jit": lambda f, x: jax.jit(f)(x), "vmap": lambda f, x: jax.vmap(f)(jnp.stack([x, x]))[1]}
SLOPES = {
    "grad": lambda f, x: jax.grad(f)(x),
    "value_and_grad": lambda f, x: jax.value_and_grad(f)(x)[1],
    "jit(grad)": lambda f, x: jax.jit(jax.grad(f))(x),
    "vmap(grad)": lambda f, x: jax.vmap(jax.grad(f))(jnp.stack([x, x]))[1],
    "under an outer jit": lambda f, x: jax.jit(lambda x: jax.lax.map(jax.grad(f), jnp.stack([x, x])))(x)[1],
}
JACOBIANS = {"jacfwd": jax.jacfwd, "jacrev": jax.jacrev}
TRANSFORMS = (*VALUES, *SLOPES, *JACOBIANS, "float32", "x64 off")
CELLS = [(name, transform) for name in FITS | CLOSED for transform in TRANSFORMS]


def is_long(name, transform):
    """All but the cheapest cells: the others take 2 to 10 s of compilation each."""
    if (name, transform) == ("magnetometer.fit, own model", "jit"):
        return False
    return transform != "float32" and (transform != "grad" or name.startswith("magnetometer") or "table" in name)


@pytest.mark.parametrize(("name", "transform"), [pytest.param(*cell, marks=[pytest.mark.long] * is_long(*cell)) for cell in CELLS])
def test_every_fit_under_every_transform(name, transform):
    function, x, _ = (FITS | CLOSED)[name]
    value, along, weights, change = expected(name)
    if transform == "x64 off":
        # what the caller gives in float64 of NumPy meets float32
        mixed = jax.numpy_dtype_promotion("standard")
        with jax.enable_x64(False), mixed, pytest.warns(PrecisionWarning, match="jax_enable_x64"):
            single = jax.jit(function)(jnp.asarray(x, jnp.float32))
        assert single.dtype == jnp.float32
        found, wanted, exact = single, value, 1e-2
    elif transform == "float32":
        single = np.asarray(x, np.float32)
        found, wanted, exact = function(single), np.asarray(function(single.astype(float))), 1e-12
    elif transform in VALUES:
        found, wanted, exact = VALUES[transform](function, jnp.asarray(x)), value, 1e-6
    else:
        exact = 1e-6 if name in CLOSED else 1e-4
        if transform in SLOPES:
            slope = SLOPES[transform](lambda x: jnp.sum(jnp.asarray(weights) * function(x)), jnp.asarray(x))
            found, wanted = np.sum(np.asarray(slope) * along), weights @ change
        else:
            found = np.asarray(JACOBIANS[transform](function)(jnp.asarray(x))).reshape(value.size, -1) @ along.ravel()
            wanted = change
    np.testing.assert_allclose(found, wanted, rtol=exact, atol=exact * np.abs(wanted).max())


@pytest.mark.parametrize("function", [lambda y: imu.six_position(y, 9.81), lambda y: imu.rate_table(y, np.ones((6, 3)))])
def test_what_the_host_decides_is_refused(function, refuses):
    with refuses("traced"):
        jax.grad(lambda y: function(y).triad.bias[0])(jnp.ones((6, 3)))
