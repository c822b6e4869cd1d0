"""The accelerometer from norms alone: in every attitude at rest the corrected specific force has the length of gravity."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import Array

#: entries of the angles: upper triangle by rows, for an upper triangular correction
_UPPER = ((0, 1), (0, 2), (1, 2))
_OFF = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))


class AccelParameters(eqx.Module):
    """D = T K upper triangular, and the bias: x = D (y - bias). `angle` holds T_12, T_13, T_23; `scale` the diagonal of K."""

    angle: Any
    scale: Any
    bias: Any

    def correction(self) -> Array:
        a, b, c = self.angle
        one, zero = jnp.ones_like(a), jnp.zeros_like(a)
        unit = jnp.stack([jnp.stack([one, a, b]), jnp.stack([zero, one, c]), jnp.stack([zero, zero, one])])
        return unit * self.scale[None, :]


class GyroParameters(eqx.Module):
    """D = T K full, bias and g-sensitivity: w = D (y - bias - G f). `angle` holds the entries of T off its diagonal, by rows."""

    angle: Any
    scale: Any
    bias: Any
    g_sensitivity: Any

    def correction(self) -> Array:
        unit = jnp.eye(3, dtype=self.scale.dtype)
        for entry, value in zip(_OFF, self.angle, strict=True):
            unit = unit.at[entry].set(value)
        return unit * self.scale[None, :]


class Norms(eqx.Module):
    """What a fit of norms is given: readings (n, 3), weights (n,), zero for padding, gravity, and the standard deviation."""

    reading: Any
    weight: Any
    gravity: Any
    sigma: Any


def corrected(parameters: AccelParameters, reading: Array) -> Array:
    """Specific force of readings (..., 3), m/s^2."""
    matrix, rest = parameters.correction(), reading - jnp.broadcast_to(parameters.bias, reading.shape)
    return jnp.einsum("ij,...j->...i", matrix, rest)


@jax.jit
def norm_residuals(parameters: AccelParameters, data: Norms) -> Array:
    """(gravity - |D (y - b)|) / sigma, weighted."""
    force = corrected(parameters, data.reading)
    return data.weight * (data.gravity - jnp.sqrt(jnp.sum(force**2, axis=-1))) / data.sigma


def nominal_start(mean: np.ndarray, gravity: float, raw: bool) -> AccelParameters:
    """Without misalignment: the unit triad for readings in SI; else scale and bias from the extremes of the means."""
    if not raw:
        return AccelParameters(np.zeros(3), np.ones(3), np.zeros(3))
    low, high = mean.min(axis=0), mean.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-3 * np.abs(high - low).max())
    # the axis that was never vertical shows less than its range; the others tell what it would be
    half = np.maximum(half, 0.7 * half.max())
    return AccelParameters(np.zeros(3), gravity / half, (low + high) / 2)
