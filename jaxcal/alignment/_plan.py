"""`plan`: at which table angles to measure, and how long, for the best azimuth."""

from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.optimize

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ._bound import inverse_information, jacobian_at, noise_of
from ._frames import GRAVITY, earth_rate, table_from_nav
from ._model import Table, tabulate
from ._options import free_of, priors_of
from ._positions import Positions, Readings, check_gravity, check_latitude

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


def best_angle(attitude: Any, latitude: Any) -> Array:
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
    phi, theta, psi = jnp.asarray(attitude)
    latitude = jnp.asarray(latitude, dtype=phi.dtype)
    slope = jax.jacfwd(lambda psi: earth_rate(table_from_nav(phi, theta, psi), latitude))(psi)
    return jnp.arctan2(slope[1], slope[0])


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
    lists = [tuple(words) for words in lists]
    noise = (noise_of(accel_noise, "accelerometer noise"), noise_of(gyro_noise, "gyro noise"))
    if priors is None and free is None:
        free, priors = ("phi", "theta", "psi", "b_a", "s_a", "b_g", "s_g"), {"s_a": 1e-4, "s_g": 1e-4}
    options = _Options(
        total=float(total_time), attitudes=attitudes, latitude=float(latitude), noise=tuple((float(n), float(k)) for n, k in noise),
        largest=criterion == "largest", minimum=float(minimum_dwell), slew=float(slew), mirrored=bool(mirrored), gravity=float(gravity),
        certainty=np.array([float(c) for c in priors_of(priors)[1]]),
    )  # fmt: skip
    best = min((_one(words, free, priors, options, seed) for words in lists), key=lambda found: found.criterion)
    return best


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
    chosen = free_of(free, priors, Positions(np.zeros(count), words), o.latitude, (True, True))
    arguments = (chosen, o, words)
    angles, shares = _starts(words, o, seed)
    listed = {name: _value(a, s, *arguments) for name, (a, s) in _listed(words, o).items()}
    if not np.isfinite(_value(angles[0], shares[0], *arguments)):
        raise DataError(
            "These mountings do not determine every free parameter; add positions (three table angles or more, 'z' for scales), or priors."
        )
    best, value = (angles[0], shares[0]), np.inf
    for a, s in [*zip(angles, shares, strict=True), *_listed(words, o).values()]:
        if not np.isfinite(_value(a, s, *arguments)):
            continue
        begin = np.concatenate([a, np.log(np.maximum(s, 1e-3))])
        found = scipy.optimize.minimize(
            lambda p: _objective(p, *arguments), begin, jac=True, method="L-BFGS-B", options={"maxiter": 400, "ftol": 1e-12, "gtol": 1e-7}
        )
        if np.isfinite(found.fun) and found.fun < value:
            best, value = (found.x[:count], _softmax(found.x[count:])), found.fun
    # a listed plan that the search did not reach is as good as any
    for name, (a, s) in _listed(words, o).items():
        if np.log(listed[name]) < value:
            best, value = (a, s), np.log(listed[name])
    positions = _positions(*best, words, o)
    stds = np.sqrt(np.asarray(_variances(_table(positions, o), jnp.asarray(chosen), _frozen(o))))
    criterion = float(np.exp(value))
    pair = float(np.mod(best_angle(jnp.asarray(o.attitudes[0]), o.latitude), np.pi))
    return Plan(positions, stds, listed, criterion, listed["uniform 4"] / criterion, pair)


def _softmax(z: np.ndarray) -> np.ndarray:
    e = np.exp(z - z.max())
    return e / e.sum()


def _starts(words: tuple[str, ...], o: _Options, seed: int) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """The uniform turn of every mounting, slightly moved: at the uniform turn itself the gradient may vanish."""
    rng, angles = np.random.default_rng(seed), np.zeros(len(words))
    for word in set(words):
        here = [i for i, other in enumerate(words) if other == word]
        angles[here] = 2 * np.pi * np.arange(len(here)) / len(here)
    shares = np.full(len(words), 1 / len(words))
    moved = [(angles + _NUDGE * rng.normal(size=angles.size), _softmax(_NUDGE * rng.normal(size=angles.size))) for _ in range(_STARTS)]
    return [a for a, _ in moved], [s for _, s in moved] if moved else [shares]


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
        tau = float(best_angle(jnp.asarray(o.attitudes[0]), o.latitude))
        for turn in (0.0, 0.1, 0.3):
            angles, shares = base.copy(), others.copy()
            angles[plane[:4]] = tau + np.pi / 2 * np.arange(4)
            angles[plane[4:]] = tau + np.pi * np.arange(n - 4)
            shares[plane[:4]] = n / count * max(turn, 4e-6) / 4
            shares[plane[4:]] = n / count * (1 - max(turn, 4e-6)) / (n - 4)
            made["pair" if turn == 0 else f"pair after {100 * turn:.0f} % of a uniform turn"] = (angles, shares / shares.sum())
    return made


def _dwells(shares: Any, o: _Options, count: int) -> Any:
    visits = count * (2 if o.mirrored else 1)
    time = o.total - o.slew * (visits - (2 if o.mirrored else 1))
    least = max(o.minimum * visits / time, _LEAST) / count
    dwell = time * (least + (1 - least * count) * shares)
    return dwell


def _positions(angles: Any, shares: Any, words: tuple[str, ...], o: _Options) -> Positions:
    """In the order of their angles, mounting by mounting; forth and back where asked for."""
    order = np.lexsort((np.mod(angles, 2 * np.pi), np.array([("x", "y", "z", "-z").index(word) for word in words])))
    angles, dwell, words = np.mod(angles[order], 2 * np.pi), _dwells(shares, o, len(words))[order], tuple(words[i] for i in order)
    if o.mirrored:
        angles, words = np.concatenate([angles, angles[::-1]]), words + words[::-1]
        dwell = np.concatenate([dwell, dwell[::-1]]) / 2
    step = np.full(len(words), o.slew)
    if o.mirrored:
        step[len(words) // 2 - 1] = 0.0
    start = np.concatenate([[0.0], np.cumsum(dwell + step)[:-1]])
    return Positions(angles, words, dwell, start)


def _table(positions: Positions, o: _Options) -> Table:
    zeros = np.zeros(len(positions))
    return jax.tree.map(jnp.asarray, tabulate(Readings(positions, zeros, zeros), o.gravity))


class _Frozen(eqx.Module):
    """What the objective needs beside the positions, as arrays."""

    values: Any
    certainty: Any
    noise: Any
    correlated: bool = eqx.field(static=True)


def _frozen(o: _Options) -> _Frozen:
    values = np.zeros((len(o.attitudes), 14))
    values[:, :3], values[:, 13] = o.attitudes, o.latitude
    noise = tuple(jnp.asarray(pair) for pair in o.noise)
    return _Frozen(jnp.asarray(values), jnp.asarray(o.certainty), noise, any(walk > 0 for _, walk in o.noise))


@eqx.filter_jit
def _variances(table: Table, free: Array, frozen: _Frozen) -> Array:
    """Variance of the azimuth for every attitude."""

    def one(values: Array) -> Array:
        certainty = jnp.where(free, frozen.certainty, 0)
        jacobian = jacobian_at(table, values, certainty, frozen.noise, frozen.correlated)
        return inverse_information(jacobian, free, jnp.asarray(False))[2, 2]

    return jax.lax.map(one, frozen.values)


@eqx.filter_jit
def _gradient(angles: Array, shares: Array, table: Table, free: Array, frozen: _Frozen, largest: Array, index: Array, dwell: Any):
    """Half the logarithm of the variance, and its gradient by angles and logarithms of shares; `index` is the order of measuring."""

    def objective(p: tuple[Array, Array]) -> Array:
        share = jax.nn.softmax(p[1])
        least, time, halves = dwell
        times = time * (least + (1 - least * share.size) * share) / halves
        full = table.dwell.at[: index.size].set(times[index])
        start = table.start.at[: index.size].set(jnp.cumsum(times[index]) - times[index])
        moved = eqx.tree_at(lambda t: (t.angle, t.dwell, t.start), table, (table.angle.at[: index.size].set(p[0][index]), full, start))
        variance = _variances(moved, free, frozen)
        return 0.5 * jnp.log(jnp.where(largest, jnp.max(variance), jnp.mean(variance)))

    return jax.value_and_grad(objective)((angles, shares))


def _objective(p: np.ndarray, chosen: np.ndarray, o: _Options, words: tuple[str, ...]) -> tuple[float, np.ndarray]:
    count = len(words)
    value, slope = _evaluated(p[:count], p[count:], chosen, o, words)
    return float(value), np.concatenate([np.asarray(part) for part in slope])


def _evaluated(angles: np.ndarray, logits: np.ndarray, chosen: np.ndarray, o: _Options, words: tuple[str, ...]):
    count = len(words)
    index = np.concatenate([np.arange(count), np.arange(count)[::-1]]) if o.mirrored else np.arange(count)
    table = _table(Positions(np.zeros(len(index)), tuple(words[i] for i in index)), o)
    visits = len(index)
    time = o.total - o.slew * (visits - (2 if o.mirrored else 1))
    least = max(o.minimum * visits / time, _LEAST) / count
    dwell = (jnp.asarray(least), jnp.asarray(time), jnp.asarray(visits / count))
    return _gradient(
        jnp.asarray(angles), jnp.asarray(logits), table, jnp.asarray(chosen), _frozen(o), jnp.asarray(o.largest), jnp.asarray(index), dwell
    )


def _value(angles: np.ndarray, shares: np.ndarray, chosen: np.ndarray, o: _Options, words: tuple[str, ...]) -> float:
    """Standard deviation of the azimuth by the criterion; infinite where the positions do not determine it."""
    value = float(_evaluated(angles, np.log(np.maximum(shares, 1e-300)), chosen, o, words)[0])
    return float(np.exp(value)) if np.isfinite(value) and np.exp(value) < np.pi * 1e3 else np.inf
