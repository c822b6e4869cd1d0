"""A small example of each kind of calibration. All tests use these residual functions, so that each is compiled only once."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

LN2 = 2 * np.log(2) / np.pi


class Coefficients(eqx.Module):
    """Squared noise coefficients, in which the Allan variance is linear; they may be zero."""

    Q2: float
    N2: float
    B2: float
    K2: float


def allan_columns(tau):
    return jnp.stack([3 / tau**2, 1 / tau, jnp.full_like(tau, LN2), tau / 3], axis=1)


def noise(model, data):
    """Whitened residuals of the Allan variance of quantisation, white noise, bias instability and random walk."""
    squares = jnp.stack([model.Q2, model.N2, model.B2, model.K2])
    return (allan_columns(data["tau"]) @ squares - data["avar"]) / data["sigma"]


def noise_data(squares, seed=0, relative=0.05):
    tau = np.logspace(-1, 3, 25)
    avar = np.asarray(allan_columns(jnp.asarray(tau)) @ jnp.asarray(squares))
    sigma = relative * avar
    return {"tau": tau, "avar": avar + sigma * np.random.default_rng(seed).normal(size=tau.size), "sigma": sigma}


class Iron(eqx.Module):
    """Magnetometer model with the inverse of a symmetric soft iron, and hard iron."""

    upper: jnp.ndarray
    hard: jnp.ndarray

    def correct(self, m):
        a, b, c, d, e, f = self.upper
        return (m - self.hard[None, :]) @ jnp.stack([jnp.stack([a, b, c]), jnp.stack([b, d, e]), jnp.stack([c, e, f])])


def magnetometer(model, data):
    return (jnp.linalg.norm(model.correct(data["m"]), axis=1) - 1) / data["sigma"]


IRON = Iron(np.array([1.1, 0.05, -0.02, 0.9, 0.03, 1.05]), np.array([0.2, -0.1, 0.3]))
IRON_START = Iron(np.array([1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), np.zeros(3))


def magnetometer_data(count=None, sigma=0.005, seed=0, points=60):
    """Simulate readings; noise is added to the corrected field, so that its magnitude has the standard deviation sigma."""
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=(points, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    a, b, c, d, e, f = IRON.upper
    inverse = np.linalg.inv(np.array([[a, b, c], [b, d, e], [c, e, f]]))
    field = direction + sigma * rng.normal(size=(*(() if count is None else (count,)), points, 3))
    return {"m": field @ inverse + IRON.hard, "sigma": sigma if count is None else np.full(count, sigma)}


def thermal(model, data):
    powers = jnp.stack([jnp.ones_like(data["t"]), data["t"], data["t"] ** 2, data["t"] ** 3], axis=1)
    return (powers @ model["c"] - data["y"]) / data["sigma"]


def thermal_data(seed=0, n=120):
    rng = np.random.default_rng(seed)
    t = np.linspace(-1, 1, n)
    return {"t": t, "y": 0.3 - 0.5 * t + 0.2 * t**2 + 0.1 * t**3 + 0.01 * rng.standard_t(2, size=n), "sigma": 0.01}
