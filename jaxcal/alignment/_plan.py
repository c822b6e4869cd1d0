"""`plan`: at which table angles to measure, and how long, for the best azimuth."""

import dataclasses
from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import jax.scipy.linalg
import numpy as np
import scipy.optimize

from .._compile import filter_jit
from .._errors import DataError
from .._precision import array_module, host_float64, is_traced
from .._types import Array
from ._bound import jacobian_at, noise_of
from ._frames import GRAVITY, table_from_nav
from ._model import NAMES, Turntable, geometry, turntable
from ._options import free_of, priors_of
from ._positions import IDEAL, Positions, check_gravity, check_latitude
from ._table import Places, Table, padded, whitening

_STARTS = 4
_NUDGE = 0.1
_LEAST = 1e-7  # share of the time that a position keeps


class Plan(eqx.Module):
    """Table angles and dwells.

    Attributes
    ----------
    positions : `Positions` in the order to measure them, with their dwells and starts.
    azimuth_std : bound of the azimuth, rad, per attitude (k,).
    compared : name -> the same bound, by the criterion, of other plans with the same time: uniform turns and the best pair.
    criterion : the value that was minimised, rad. gain : that of uniform four positions over it.
    pair : best angle tau0 of a pair tau0, tau0 + 180 degrees for the first attitude, rad, in [0, pi).
    """

    positions: Positions
    azimuth_std: Any
    compared: dict[str, float]
    criterion: float
    gain: float
    pair: float


def best_angle(attitude: Any, latitude: Any) -> Any:
    r"""Table angle at which the sensitive axis feels the azimuth most.

    .. math:: \tau_0 = \mathrm{atan2}(\partial W_y/\partial\psi,\ \partial W_x/\partial\psi)

    Parameters
    ----------
    attitude : (roll, pitch, azimuth) of the table, rad.
    latitude : rad, north positive.

    Returns
    -------
    The angle, rad; the best pair of positions is this one and the opposite.

    Examples
    --------
    A level table whose x axis points north: best is the axis towards east or west.

    >>> import math
    >>> import numpy as np
    >>> import jaxcal
    >>> round(abs(math.degrees(jaxcal.alignment.best_angle(np.zeros(3), 0.6))), 3)
    90.0

    References
    ----------
    The derivative of the rate in table axes, equations (36) to (38) of the north-finding paper in corrected form.
    """
    phi, theta, psi = attitude
    # the horizontal part of the Earth's rate turns with the azimuth: its slope is what it is a quarter turn on
    slope = table_from_nav(phi, theta, psi + np.pi / 2)[:, 0]
    return array_module(slope).arctan2(slope[1], slope[0])


@host_float64
def plan(
    total_time: Any,
    latitude: Any,
    *,
    attitude: Any = (0.0, 0.0, 0.0),
    accel_noise: Any,
    gyro_noise: Any,
    mountings: Any = ("x",) * 6,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    criterion: str = "mean",
    minimum_dwell: float = 0.0,
    slew: float = 0.0,
    mirrored: bool = False,
    gravity: Any = GRAVITY,
    seed: int = 0,
) -> Plan:
    r"""Angles and dwells that minimise the bound of the azimuth under a total time.

    .. math:: \min_{\tau, z} \log\sigma_\psi(\tau, T),\qquad T_k = T\,\mathrm{softmax}(z)_k

    by the gradient of the Cramer-Rao bound of the joint fit, from several starts; never worse than the plans in `compared`.

    Parameters
    ----------
    total_time : s, moves included.
    latitude : rad.
    attitude : (3,) rough roll, pitch and azimuth, rad; or (k, 3) possible ones. The best angles depend on the azimuth: plan from a
        first short turn, or over several azimuths.
    accel_noise, gyro_noise : as of `crlb`.
    mountings : one word per position, or several such lists, of which the best is taken.
    free, priors : as of `fit`; by default angles, biases and scale errors are free, with priors of 1e-4 on the scale errors.
    criterion : "mean" variance or "largest" variance over the attitudes.
    minimum_dwell : s per position. slew : s per move between positions.
    mirrored : measure forth and back, which cancels a linear drift of the biases.
    gravity : m/s^2. seed : of the starts.

    Returns
    -------
    Plan

    Raises
    ------
    DataError
        For a time that the moves and least dwells use up, unknown names, or parameters that no such positions determine.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import plan
    >>> arw = np.deg2rad(0.01) / 60
    >>> found = plan(240.0, np.deg2rad(35.0), attitude=np.deg2rad([1.0, 2.0, 88.0]), accel_noise=5e-4, gyro_noise=arw)
    >>> print(round(found.gain, 3))
    1.414

    References
    ----------
    A. C. Atkinson, A. N. Donev and R. D. Tobias, Optimum Experimental Designs, with SAS, 2007, chapters 9 and 17 (designs for one
    parameter of a nonlinear model).
    """
    check_latitude(latitude)
    check_gravity(gravity)
    if is_traced(total_time, latitude, attitude):
        raise DataError("`plan` searches on the host and cannot be traced; differentiate `crlb` instead.")
    attitudes = np.atleast_2d(np.asarray(attitude, dtype=float))
    if attitudes.shape[1] != 3 or not np.isfinite(attitudes).all():
        raise DataError(f"The attitudes have shape {attitudes.shape}; give (roll, pitch, azimuth) in rad, one or (k, 3).")
    if criterion not in ("mean", "largest"):
        raise DataError(f"There is no criterion {criterion!r}; known are 'mean' and 'largest'.")
    lists = [mountings] if isinstance(mountings[0], str) and mountings[0] in ("x", "z", "-z", "y") else list(mountings)
    noise = (noise_of(accel_noise, "accelerometer noise"), noise_of(gyro_noise, "gyro noise"))
    if priors is None and free is None:
        free, priors = ("phi", "theta", "psi", "b_a", "s_a", "b_g", "s_g"), {"s_a": 1e-4, "s_g": 1e-4}
    certainty = priors_of(priors, NAMES)[1]
    options = _Options(
        total=float(total_time), attitudes=attitudes, latitude=float(latitude), noise=tuple((float(n), float(k)) for n, k in noise),
        largest=criterion == "largest", minimum=float(minimum_dwell), slew=float(slew), mirrored=bool(mirrored), gravity=float(gravity),
        certainty=np.array([float(certainty.get(name, 0.0)) for name in NAMES]),
    )  # fmt: skip
    return min((_one(tuple(words), free, priors, options, seed) for words in lists), key=lambda found: found.criterion)


class _Options(eqx.Module):
    total: float
    attitudes: Any
    latitude: float
    noise: Any
    largest: bool
    minimum: float
    slew: float
    mirrored: bool
    gravity: float
    certainty: Any


def _one(words: tuple[str, ...], free: Any, priors: Any, o: _Options, seed: int) -> Plan:
    """Best plan with one list of mountings."""
    count = len(words)
    visits = count * (2 if o.mirrored else 1)
    moving = o.slew * (visits - (2 if o.mirrored else 1))
    time = o.total - moving
    if not time > visits * o.minimum or not time > 0:
        raise DataError(
            f"{o.total:g} s do not hold {visits} dwells of {o.minimum:g} s and {moving:g} s of moves; take more time or fewer positions."
        )
    chosen = free_of(free, priors, Positions(np.zeros(count), words), o.latitude, (True, True), NAMES)
    arguments = (tuple(name in chosen for name in NAMES), o, words)
    listed = _listed(words, o)
    values = {name: _value(*pair, *arguments) for name, pair in listed.items()}
    starts = _starts(words, seed)
    if not np.isfinite(_value(*starts[0], *arguments)):
        raise DataError(
            "These mountings do not determine every free parameter; add positions (three table angles or more, 'z' for scales), or priors."
        )
    best, value = starts[0], np.inf
    for angles, shares in [*starts, *listed.values()]:
        if not np.isfinite(_value(angles, shares, *arguments)):
            continue
        start = np.concatenate([angles, np.log(np.maximum(shares, 1e-3))])
        found = scipy.optimize.minimize(
            lambda p: _objective(p, *arguments), start, jac=True, method="L-BFGS-B", options={"maxiter": 400, "ftol": 1e-12, "gtol": 1e-7}
        )
        if np.isfinite(found.fun) and found.fun < value:
            best, value = (found.x[:count], _softmax(found.x[count:])), found.fun
    # a listed plan that the search did not reach is as good as any
    for name, pair in listed.items():
        if np.log(values[name]) < value:
            best, value = pair, np.log(values[name])
    positions = _positions(*best, words, o)
    stds = np.sqrt(np.asarray(_variances(padded(positions), len(positions), arguments[0], *_arrays(o))))
    criterion = float(np.exp(value))
    pair = float(np.mod(best_angle(o.attitudes[0], o.latitude), np.pi))
    return Plan(positions, stds, values, criterion, values["uniform 4"] / criterion, pair)


def _softmax(z: np.ndarray) -> np.ndarray:
    e = np.exp(z - z.max())
    return e / e.sum()


def _starts(words: tuple[str, ...], seed: int) -> list[tuple[np.ndarray, np.ndarray]]:
    """The uniform turn of every mounting, slightly moved: at the uniform turn itself the gradient may vanish."""
    rng, angles = np.random.default_rng(seed), np.zeros(len(words))
    for word in set(words):
        here = [i for i, other in enumerate(words) if other == word]
        angles[here] = 2 * np.pi * np.arange(len(here)) / len(here)
    nudge = lambda: _NUDGE * rng.normal(size=angles.size)  # noqa: E731
    return [(angles + nudge(), _softmax(nudge())) for _ in range(_STARTS)]


def _listed(words: tuple[str, ...], o: _Options) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rules of thumb with these mountings: uniform turns, and the best pair after a short uniform turn."""
    count = len(words)
    plane = [i for i, word in enumerate(words) if word == "x"]
    n = len(plane)
    made = {}
    base = np.zeros(count)
    others = np.full(count, 1 / count)
    for name, size in (("uniform 3", 3), ("uniform 4", 4), (f"uniform {n}", n)):
        angles, shares = base.copy(), others.copy()
        angles[plane] = 2 * np.pi * (np.arange(n) % size) / size
        visits = np.bincount(np.arange(n) % size, minlength=size)[np.arange(n) % size] if n else np.ones(0)
        shares[plane] = n / count / size / visits if n else 0.0
        made[name] = (angles, shares / shares.sum())
    if n >= 6:
        tau = float(best_angle(o.attitudes[0], o.latitude))
        for turn in (0.0, 0.1, 0.3):
            angles, shares = base.copy(), others.copy()
            angles[plane[:4]] = tau + np.pi / 2 * np.arange(4)
            angles[plane[4:]] = tau + np.pi * np.arange(n - 4)
            shares[plane[:4]] = n / count * max(turn, 4e-6) / 4
            shares[plane[4:]] = n / count * (1 - max(turn, 4e-6)) / (n - 4)
            made["pair" if turn == 0 else f"pair after {100 * turn:.0f} % of a uniform turn"] = (angles, shares / shares.sum())
    return made


def _shared(o: _Options, count: int) -> tuple[int, float, float]:
    """Number of dwells, time for all of them, s, and least share of a position."""
    visits = count * (2 if o.mirrored else 1)
    time = o.total - o.slew * (visits - (2 if o.mirrored else 1))
    return visits, time, max(o.minimum * visits / time, _LEAST) / count


def _positions(angles: Any, shares: Any, words: tuple[str, ...], o: _Options) -> Positions:
    """In the order of their angles, mounting by mounting; forth and back where asked for."""
    order = np.lexsort((np.mod(angles, 2 * np.pi), np.array([("x", "y", "z", "-z").index(word) for word in words])))
    _, time, least = _shared(o, len(words))
    dwell = time * (least + (1 - least * len(words)) * shares)
    angles, dwell, words = np.mod(angles[order], 2 * np.pi), dwell[order], tuple(words[i] for i in order)
    if o.mirrored:
        angles, words = np.concatenate([angles, angles[::-1]]), words + words[::-1]
        dwell = np.concatenate([dwell, dwell[::-1]]) / 2
    step = np.full(len(words), o.slew)
    if o.mirrored:
        step[len(words) // 2 - 1] = 0.0
    start = np.concatenate([[0.0], np.cumsum(dwell + step)[:-1]])
    return Positions(angles, words, dwell, start)


def _arrays(o: _Options) -> tuple[Turntable, Any, Any, Any]:
    """What the bound needs beside the positions: models (k,), noise, certainty of the priors, gravity."""
    models = [turntable(attitude, o.latitude, IDEAL, IDEAL) for attitude in o.attitudes]
    # without a random walk the number zero is part of the program, which is then smaller
    noise = [(jnp.asarray(white), jnp.asarray(walk) if walk else 0.0) for white, walk in o.noise]
    return jax.tree.map(lambda *leaves: jnp.asarray(leaves), *models), noise, jnp.asarray(o.certainty), jnp.asarray(o.gravity)


@filter_jit
def _variances(places: Places, count: Any, free: tuple[bool, ...], models: Any, noise: Any, certainty: Array, gravity: Array) -> Array:
    """Variance of the azimuth for every attitude, (k,), where the first `count` places are measured."""
    here, zeros = jnp.arange(places.angle.size) < count, jnp.zeros_like(places.angle)
    weights = [whitening(white, walk, places, here) for white, walk in noise]
    table = Table(geometry(places, gravity), zeros, zeros, weights[0], weights[1], 0 * certainty, certainty)
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
def _gradient(p: Array, places: Places, index: Array, dwell: Any, largest: Array, *others: Any) -> tuple[Array, Array]:
    """Half the logarithm of the variance, and its gradient by angles and logarithms of shares; `index` is the order of measuring."""
    least, time, halves = dwell

    def objective(p: Array) -> Array:
        angles, share = p[: p.size // 2], jax.nn.softmax(p[p.size // 2 :])
        times = (time * (least + (1 - least * share.size) * share) / halves)[index]
        full, end = (leaf.at[: index.size].set(new) for leaf, new in ((places.dwell, times), (places.start, jnp.cumsum(times))))
        middle = places.time.at[: index.size].set(end[: index.size] - times / 2 - jnp.sum(times) / 2)
        moved = dataclasses.replace(
            places, angle=places.angle.at[: index.size].set(angles[index]), dwell=full, start=end - full, time=middle
        )
        variance = _variances(moved, index.size, *others)
        return 0.5 * jnp.log(jnp.where(largest, jnp.max(variance), jnp.mean(variance)))

    return jax.value_and_grad(objective)(p)


def _objective(p: np.ndarray, free: tuple[bool, ...], o: _Options, words: tuple[str, ...]) -> tuple[float, np.ndarray]:
    count = len(words)
    index = np.concatenate([np.arange(count), np.arange(count)[::-1]]) if o.mirrored else np.arange(count)
    places = padded(Positions(np.zeros(len(index)), tuple(words[i] for i in index)))
    visits, time, least = _shared(o, count)
    dwell = (jnp.asarray(least), jnp.asarray(time), jnp.asarray(visits / count))
    value, slope = _gradient(jnp.asarray(p), places, jnp.asarray(index), dwell, jnp.asarray(o.largest), free, *_arrays(o))
    return float(value), np.asarray(slope)


def _value(angles: np.ndarray, shares: np.ndarray, *arguments: Any) -> float:
    """Standard deviation of the azimuth by the criterion; infinite where the positions do not determine it."""
    value = _objective(np.concatenate([angles, np.log(np.maximum(shares, 1e-300))]), *arguments)[0]
    return float(np.exp(value)) if np.isfinite(value) and np.exp(value) < np.pi * 1e3 else np.inf
