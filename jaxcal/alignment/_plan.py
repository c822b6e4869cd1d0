"""`plan`: choose table angles and dwells that give the most accurate azimuth."""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Number, Result, Section, listed
from .._compile import filter_jit
from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array, Leaf, NoiseLike, Numbers, Real
from ._bound import given_noise, jacobian_at
from ._model import NAMES, Table, Turntable, padded, turntable
from ._noise import IDEAL, covariance_of, joined, weight_of
from ._positions import GRAVITY, SMALL, Positions, check_gravity, check_latitude, checked_attitude, geometry, table_from_nav
from ._start import free_of, priors_of

_STARTS, _NUDGE = 4, 0.1  # number of starts of the search, and their scatter in rad and in logarithms of shares


class Plan(Result):
    """A measurement plan: table angles and dwells.

    Attributes
    ----------
    positions : `Positions` in the order of measurement, with their dwells and starts.
    azimuth_std : (k,) bound of the azimuth's standard deviation for each attitude, rad.
    criterion : minimised root of the mean variance over the attitudes, rad.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import plan
    >>> found = plan(240.0, 0.6, attitude=np.deg2rad([1.0, 2.0, 88.0]), accel_noise=5e-4, gyro_noise=3e-6)
    >>> len(found.positions), round(float(found.positions.dwell.sum()))
    (6, 240)
    """

    positions: Positions
    azimuth_std: Leaf
    criterion: float
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """The standard deviation of the azimuth."""
        return f"azimuth to {math.degrees(self.criterion):.3g} deg (1 sigma)"

    def sections(self) -> list[Section]:
        """The positions."""
        places = zip(np.rad2deg(self.positions.angle), self.positions.mounting, self.positions.dwell.tolist(), strict=True)
        rows = [(f"{angle:.2f} deg, {word}", Number(f"dwell[{i}]", x, quantity="time")) for i, (angle, word, x) in enumerate(places)]
        return [listed("plan", "time at each position", rows)]


@host_float64
def plan(
    total_time: Real,
    latitude: Real,
    *,
    attitude: Numbers = (0.0, 0.0, 0.0),
    accel_noise: NoiseLike,
    gyro_noise: NoiseLike,
    mountings: Sequence[str] = ("x",) * 6,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    gravity: Real = GRAVITY,
    seed: int = 0,
) -> Plan:
    r"""Choose table angles and dwells that minimise the bound of the azimuth for a given total time.

    .. math:: \min_{\tau, z} \log\sigma_\psi(\tau, T),\qquad T_k = T\,\mathrm{softmax}(z)_k

    The search follows the gradient of the Cramer-Rao bound of the joint fit from several starts.

    Parameters
    ----------
    total_time : s, of all dwells.
    latitude : rad.
    attitude : (3,) approximate roll, pitch and azimuth, rad; or (k, 3) possible attitudes. The best angles depend on the azimuth, so
        estimate it by a short first measurement, or plan for several azimuths.
    accel_noise, gyro_noise : see `crlb`.
    mountings : one word per position.
    free, priors : see `fit`; by default angles, biases and scale errors are free, with priors of 1e-4 on the scale errors.
    gravity : m/s^2. seed : seed of the starts.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        If the time is not positive, a name is unknown, or no such positions determine the free parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import plan
    >>> arw = np.deg2rad(0.01) / 60
    >>> found = plan(240.0, np.deg2rad(35.0), attitude=np.deg2rad([1.0, 2.0, 88.0]), accel_noise=5e-4, gyro_noise=arw)
    >>> print(np.rad2deg(found.criterion).round(3))
    0.18

    References
    ----------
    A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, 2007, chapters 9 and 17 (designs for one
    parameter of a nonlinear model).
    """
    check_latitude(latitude)
    check_gravity(gravity)
    if is_traced(total_time, latitude, attitude):
        raise DataError("`plan` searches on the host and cannot be traced; differentiate `crlb` instead.", code="traced")
    attitudes = np.stack([checked_attitude(one) for one in np.atleast_2d(attitude)])
    noise = [given_noise(accel_noise, "accelerometer noise"), given_noise(gyro_noise, "gyro noise")]
    # a zero coefficient stays a Python number, so that the compiled program omits its term
    noise = jax.tree.map(lambda value: jnp.asarray(float(value)) if float(value) else 0.0, noise)
    if priors is None and free is None:
        free, priors = ("phi", "theta", "psi", "b_a", "s_a", "b_g", "s_g"), {"s_a": 1e-4, "s_g": 1e-4}
    given = priors_of(priors, NAMES)[1]
    certainty = jnp.asarray([float(given.get(name, 0.0)) for name in NAMES])
    models = [turntable(one, float(latitude), IDEAL, IDEAL) for one in attitudes]
    bound = jax.tree.map(lambda *leaves: jnp.asarray(leaves), *models), noise, certainty, jnp.asarray(float(gravity))
    # the horizontal part of the Earth's rate rotates with the azimuth, so its derivative is its value a quarter turn further
    phi, theta, psi = attitudes[0]
    slope, words = table_from_nav(phi, theta, psi + np.pi / 2)[:, 0], tuple(mountings)
    tau = float(np.arctan2(slope[1], slope[0]))  # the angle at which a reading is most sensitive to the azimuth
    chosen = free_of(free, priors, Positions(np.zeros(len(words)), words), latitude, (True, True), NAMES)
    return _searched(words, tuple(name in chosen for name in NAMES), float(total_time), bound, tau, seed)


def _searched(words: tuple[str, ...], free: tuple[bool, ...], total: float, bound: Any, tau: float, seed: int) -> Plan:
    """Find the best angles and shares of the time for one list of mountings.

    `free` flags the estimated parameters. `bound` has further data: models (k,), noise, certainty of the priors, gravity. `tau` is the
    best angle of a pair.
    """
    count, places = len(words), padded(Positions(np.zeros(len(words)), words))
    if not total > 0:
        raise DataError(f"The time is {total:g} s; it is positive.", code="too_short")

    def objective(p: np.ndarray) -> tuple[float, np.ndarray]:
        """Logarithm of the criterion, and its gradient with respect to angles and logarithms of shares."""
        value, slope = _gradient(jnp.asarray(p), places, jnp.asarray(total), free, *bound)
        return float(value), np.asarray(slope)

    # near uniform angles from tau on for every mounting; at exactly uniform ones the gradient may vanish
    rng, angles = np.random.default_rng(seed), np.zeros(count)
    for word in set(words):
        here = [i for i, other in enumerate(words) if other == word]
        angles[here] = tau + 2 * np.pi * np.arange(len(here)) / len(here)
    nudges = _NUDGE * rng.normal(size=(_STARTS, 2, count))
    starts = [(angles + nudge, scipy.special.softmax(share)) for nudge, share in nudges]
    best, value = starts[0], np.log(np.pi * 1e3)  # more than any azimuth: not determined
    for first in starts:
        start = np.concatenate([first[0], np.log(first[1])])
        options = {"maxiter": 400, "ftol": 1e-12, "gtol": 1e-7}
        found = scipy.optimize.minimize(objective, start, jac=True, method="L-BFGS-B", options=options)
        if np.isfinite(found.fun) and found.fun < value:
            best, value = (found.x[:count], scipy.special.softmax(found.x[count:])), found.fun
    if best is starts[0]:
        raise DataError("These mountings do not determine every free parameter; add positions or priors.", code="undetermined")
    positions = Positions(np.mod(best[0], 2 * np.pi), words, total * _at_least(best[1]))
    stds = np.sqrt(np.asarray(_variances(padded(positions), len(positions), free, *bound)))
    return Plan(positions, stds, float(np.exp(value)))


def _at_least(share: Any) -> Any:
    """Shares of the time, none of them zero."""
    return SMALL / share.size + (1 - SMALL) * share


@filter_jit
def _variances(places: Positions, count: Any, free: tuple[bool, ...], models: Any, noise: Any, certainty: Array, gravity: Array) -> Array:
    """(k,) variance of the azimuth for every attitude if the first `count` positions are measured."""
    here = jnp.arange(places.angle.size) < count
    weight = weight_of(joined([covariance_of(one, places, here) for one in noise]), jnp.tile(here, 2))
    table = Table(geometry(places, gravity), jnp.zeros((2, here.size)), weight, 0 * certainty, certainty)
    index = np.flatnonzero(free)

    def one(model: Turntable) -> Array:
        jacobian = jacobian_at(model, table)[:, index]
        column = jax.lax.stop_gradient(jnp.sqrt(jnp.sum(jacobian**2, axis=0)))
        column = jnp.where(column > 0, column, 1)
        triangle = jnp.linalg.qr(jacobian / column[None, :], mode="r")
        unit = jnp.asarray(index == NAMES.index("psi"), dtype=column.dtype)
        root = jax.scipy.linalg.solve_triangular(triangle, unit / column, trans=1)
        return root @ root

    return jax.lax.map(one, models)


@filter_jit
def _gradient(p: Array, places: Any, time: Array, *others: Any) -> tuple[Array, Array]:
    """Half the logarithm of the variance, and its gradient by angles and logarithms of shares."""
    n = p.size // 2

    def objective(p: Array) -> Array:
        times = time * _at_least(jax.nn.softmax(p[n:]))
        begin = jnp.cumsum(times) - times
        full, start = (leaf.at[:n].set(new).at[n:].set(new[0]) for leaf, new in ((places.dwell, times), (places.start, begin)))
        moved = dataclasses.replace(places, angle=places.angle.at[:n].set(p[:n]), dwell=full, start=start)
        return 0.5 * jnp.log(jnp.mean(_variances(moved, n, *others)))

    return jax.value_and_grad(objective)(p)
