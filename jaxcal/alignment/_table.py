"""`Table` and `residuals`: readings and priors as data of a residual problem."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._precision import array_module
from .._types import AnyArray
from ._frames import AXES, GRAVITY
from ._model import Geometry, geometry
from ._positions import Positions, Readings

_SMALLEST_PAD = 16


class Places(eqx.Module):
    """The arrays of `Positions`, filled up to a power of two with rows that are never measured."""

    angle: Any
    axes: Any
    dwell: Any
    start: Any
    time: Any
    rate: Any
    acceleration: Any
    width: Any


class Table(eqx.Module):
    """Readings with their weights, and priors: the data of `residuals`. `tabulate` makes one.

    Attributes
    ----------
    places : `Geometry` of the positions, of one length for many lists of positions, so that one compiled program serves them.
    accel, gyro : (n,) readings, m/s^2 and rad/s.
    weight_accel, weight_gyro : (n,) one over the standard deviation, zero where nothing was measured; or (n, n) inverse Cholesky factor
        of the covariance, where the bias walks.
    prior, certainty : (p,) prior means and one over their standard deviations, zero where there is none, in the order of the model's
        parameters; None for no priors.
    """

    places: Geometry
    accel: AnyArray
    gyro: AnyArray
    weight_accel: AnyArray
    weight_gyro: AnyArray
    prior: Any = None
    certainty: Any = None

    @property
    def measured(self) -> list[AnyArray]:
        """Which rows the accelerometer measured (n,), and which the gyro."""
        return [(weight if weight.ndim == 1 else weight.diagonal()) > 0 for weight in (self.weight_accel, self.weight_gyro)]


def residuals(model: Any, data: Any) -> Any:
    r"""Residuals of a turntable model in units of their standard deviation: accelerometer, gyro, priors.

    .. math:: r = \left(W_a (\hat a - a),\; W_g (\hat w - w),\; (x - x_0)/\sigma_0\right)

    Pure, and usable under `jit`, `vmap`, `grad` and in `jaxcal.fitting.solve`.

    Parameters
    ----------
    model : `Turntable`, or one of a subclass.
    data : `Table`, or `Readings` with their noise.

    Returns
    -------
    (2 n,) or (2 n + p,) with p parameters, where there are priors; n is the number of positions, padded to a power of two.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Readings, Turntable, residuals
    >>> readings = Readings(np.zeros(1), accel=np.array([1e-3]), accel_noise=1e-3)
    >>> print(residuals(Turntable(), readings)[0].round(6))
    -1.0

    References
    ----------
    As of `fit`.
    """
    table = tabulate(data) if isinstance(data, Readings) else data
    accel, gyro = model.measure(table.places)
    xp = array_module(accel, gyro, table)
    weighted = lambda weight, off: weight * off if weight.ndim == 1 else weight @ off  # noqa: E731
    parts = [weighted(table.weight_accel, accel - table.accel), weighted(table.weight_gyro, gyro - table.gyro)]
    if table.prior is not None:
        parts.append(table.certainty * (xp.stack([xp.asarray(leaf) for leaf in jax.tree.leaves(model)]) - table.prior))
    return xp.concatenate(parts)


def padded(positions: Positions) -> Places:
    """Positions padded to a power of two."""
    xp = array_module(positions)
    count = len(positions)
    more = max(_SMALLEST_PAD, 1 << (count - 1).bit_length()) - count
    pad = lambda value, fill=0.0: xp.concatenate([xp.asarray(value), xp.zeros(more, dtype=value.dtype) + fill])  # noqa: E731
    end = (positions.start + positions.dwell).max()
    axes = np.concatenate([positions.axes, np.broadcast_to(AXES["x"], (more, 3, 3))])
    return Places(
        pad(positions.angle), axes, pad(positions.dwell, 1.0), pad(positions.start, end), pad(positions.time),
        *(pad(getattr(positions, name)) for name in ("rate", "acceleration", "width")),
    )  # fmt: skip


def tabulate(readings: Readings, gravity: Any = GRAVITY, noise: Any = None, prior: Any = None, certainty: Any = None) -> Table:
    """Readings as data of `residuals`.

    Parameters
    ----------
    readings : `Readings`.
    gravity : m/s^2.
    noise : (N, K) of the accelerometer and (N, K) of the gyro, white noise and random walk; by default those of the readings.
    prior, certainty : as of `Table`.
    """
    xp = array_module(readings, gravity, noise, prior, certainty)
    noise = noise or [(readings.white(name), readings.walk(name)) for name in ("accel", "gyro")]
    places = padded(readings.positions)
    values: list[Any] = []
    weights: list[Any] = []
    for name, (white, walk) in zip(("accel", "gyro"), noise, strict=True):
        given = getattr(readings, name)
        size = len(readings.positions)
        given = xp.full(size, xp.nan) if given is None else xp.asarray(given)
        here = xp.concatenate([xp.isfinite(given), xp.zeros(places.dwell.size - size, dtype=bool)])
        value = xp.concatenate([given, xp.zeros(places.dwell.size - size, dtype=given.dtype)])
        values.append(xp.where(here, value, 0))
        weights.append(whitening(white, walk, places, here))
    table = Table(geometry(places, gravity, readings.lever_arm), values[0], values[1], weights[0], weights[1], prior, certainty)
    return in_one_type(table, values[0].dtype if readings.accel is not None else values[1].dtype)


def whitening(white: Any, walk: Any, places: Places, here: AnyArray) -> AnyArray:
    """Weights of one sensor with white noise and, unless it is the number zero, a random walk of the bias."""
    xp = array_module(white, walk, places, here)
    white = 1.0 if white is None else white
    if not isinstance(walk, jax.core.Tracer) and float(walk) == 0:
        return xp.where(here, xp.sqrt(places.dwell) / white, 0)
    both = here[:, None] & here[None, :]
    own = xp.diag(white**2 / places.dwell)
    factor = xp.linalg.cholesky(own + xp.where(both, walk**2 * walk_covariance(places.start, places.dwell), 0))
    return xp.where(both, xp.linalg.solve(factor, xp.eye(here.size, dtype=factor.dtype)), 0)


def walk_covariance(start: Any, dwell: Any) -> AnyArray:
    """Covariance of the means over dwells of a unit random walk that starts with the test, (n, n), s."""
    xp = array_module(start, dwell)
    start = start - start.min()
    earlier = xp.minimum(start[:, None], start[None, :])
    shorter = xp.where(start[:, None] <= start[None, :], dwell[:, None], dwell[None, :])
    return earlier + shorter * xp.where(xp.eye(start.size, dtype=bool), 1 / 3, 1 / 2)


def in_one_type(tree: Any, dtype: Any) -> Any:
    """Every floating number of a tree as an array of one type; NumPy's stay NumPy's."""

    def cast(leaf: Any) -> Any:
        traced = isinstance(leaf, jax.Array)
        leaf = leaf if hasattr(leaf, "dtype") else np.asarray(leaf)
        return leaf if leaf.dtype == bool else (jnp if traced else np).asarray(leaf, dtype=dtype)

    return jax.tree.map(cast, tree)
