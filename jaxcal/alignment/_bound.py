"""`crlb`: the accuracy with which positions can determine attitude, sensor errors and latitude, before any measurement."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._compile import filter_jit
from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._types import Array, NoiseLike, Numbers, Real
from ..fitting import Estimate
from ._model import NAMES, Table, Turntable, in_one_type, residuals, tabulate, turntable, with_angle_errors, with_values
from ._noise import IDEAL, Sensor, as_noise, by_channel, check_noise
from ._positions import GRAVITY, Positions, Readings, as_positions, check_gravity, check_latitude, checked_attitude
from ._result import QUANTITIES, Bound, know, sizes_of
from ._start import free_of, priors_of


def given_noise(noise: Any, name: str) -> Any:
    """Check the noise of one sensor and convert it to `Noise`."""
    if noise is None:
        raise DataError(f"There is no {name}; give its white noise in SI, or a Noise.", code="no_noise")
    found = as_noise(noise, name)
    check_noise(found, name)
    return found


@host_float64
def crlb(
    positions: Positions | Numbers,
    attitude: Numbers,
    latitude: Real,
    *,
    accel_noise: NoiseLike,
    gyro_noise: NoiseLike,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    accel: Sensor = IDEAL,
    gyro: Sensor = IDEAL,
    lever_arm: Real = 0.0,
    gravity: Real = GRAVITY,
) -> Bound:
    r"""Compute the Cramer-Rao bound of the joint fit, :math:`(J^T J)^{-1}` of the whitened Jacobian with the priors.

    Parameters
    ----------
    positions : `Positions`, or table angles in rad.
    attitude : (3,) roll, pitch, azimuth, rad.
    latitude : rad; it counts as known unless "latitude" is in `free`.
    accel_noise, gyro_noise : white noise N (m/s^2 sqrt(s), rad/sqrt(s)), a `jaxcal.noise.Noise`, a `NoiseFit` or a `Sensor`; `noise_of`
        extracts both from a calibration. All noise terms are used, with their exact covariance between the dwells.
    free, priors : see `fit`.
    accel, gyro : sensor errors at which the bound is evaluated.
    lever_arm : m. gravity : m/s^2.

    Returns
    -------
    Bound
        Covariance, rank and the parameters that cannot be separated. You can differentiate it by every numeric argument.

    Raises
    ------
    DataError
        If a name is unknown, or the noise is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions, crlb
    >>> four = Positions(np.deg2rad([0.0, 90.0, 180.0, 270.0]), dwell=60.0)
    >>> arw = np.deg2rad(0.01) / 60
    >>> bound = crlb(four, np.deg2rad([0.0, 0.0, 88.0]), np.deg2rad(35.0), accel_noise=5e-4, gyro_noise=arw)
    >>> print(np.rad2deg(bound.azimuth_std).round(4))
    0.2547

    References
    ----------
    S. M. Kay, Fundamentals of Statistical Signal Processing: Estimation Theory, 1993, section 3.9 (general Gaussian noise).
    """
    positions = as_positions(positions)
    check_latitude(latitude)
    check_gravity(gravity)
    chosen = free_of(free, priors, positions, latitude, (True, True), NAMES)
    certainty = priors_of(priors, NAMES)[1]
    given = (accel_noise, "accelerometer noise"), (gyro_noise, "gyro noise")
    noise = [by_channel(given_noise(*one), positions) for one in given]
    attitude = checked_attitude(attitude)
    zeros = np.zeros(len(positions))
    table = tabulate(Readings(positions, zeros, zeros, lever_arm=lever_arm), gravity, noise)
    model = turntable(attitude, latitude, accel, gyro)
    table = with_angle_errors(table, model, positions, gravity, lever_arm)
    dtype = jax.dtypes.canonicalize_dtype(jnp.result_type(attitude))
    xp = array_module(table, model, certainty)
    weight = xp.stack([xp.asarray(certainty.get(name, 0.0)) for name in NAMES])
    table, model = in_one_type((dataclasses.replace(table, prior=0 * weight, certainty=weight), model), dtype)
    mask = np.array([name in chosen for name in NAMES])
    jacobian = jacobian_at(model, table)
    known = know(jacobian if is_traced(jacobian) else np.asarray(jacobian), table.readings.size, mask, sizes_of(NAMES, gravity, positions))
    states = {name: "held" for name in NAMES if name not in chosen}
    if not is_traced(known.lost):
        states |= {name: "open" for name, lost in zip(NAMES, known.lost, strict=True) if lost}
    values = xp.stack([xp.asarray(leaf, dtype=dtype) for leaf in jax.tree.leaves(model)])
    return Bound(Estimate(NAMES, values, known.covariance, states=states, quantities=QUANTITIES), known.rank, known.hidden, known.lost)


@filter_jit
def jacobian_at(model: Turntable, table: Table) -> Array:
    """Jacobian of the residuals with respect to the parameters, in the order of the model's fields."""
    values = jnp.stack([jnp.asarray(leaf) for leaf in jax.tree.leaves(model)])
    return jax.jacfwd(lambda x: residuals(with_values(model, x), table))(values)
