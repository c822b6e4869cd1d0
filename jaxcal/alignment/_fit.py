"""`fit`: attitude, sensor errors and latitude from all readings at once."""

from collections.abc import Iterable
from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import jax.scipy.special
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._types import Array
from ..fitting import Outcome, solve
from ._begin import begin
from ._describe import know, physical
from ._equation import WEAK
from ._frames import GRAVITY, angles_of, table_from_nav, wrap
from ._model import COUNT, INDEX, Rows, Table, as_arrays, euler, parameters_at, residuals, tabulate, whitening
from ._options import check_latitude_free, free_of, given_of, priors_of
from ._positions import Readings, check_gravity, check_latitude
from ._result import AlignmentFit
from ._verdict import Verdict

#: noise that weighs the sensors against one another where none is given: 50 micro-g sqrt(s), 0.01 deg/sqrt(h)
_NOMINAL = (50e-6 * GRAVITY, np.deg2rad(0.01) / 60)
_STEEP = np.deg2rad(80.0)
_POLE = np.deg2rad(89.9)
_MISFIT = 1e-3
_ROUNDS = 3
#: step to go, over the statistical uncertainty, at which the fit ends
_SETTLED = 1e-6
_DONE = 1e-4


@host_float64
def fit(
    readings: Readings,
    latitude: Any = None,
    *,
    free: Iterable[str] | None = None,
    priors: dict[str, Any] | None = None,
    start: dict[str, Any] | None = None,
    hint: Any = None,
    hemisphere: str | None = None,
    gravity: Any = GRAVITY,
) -> AlignmentFit:
    r"""Roll, pitch, azimuth, sensor errors and, where it is asked for, latitude by joint nonlinear least squares.

    .. math:: \min \sum_k \frac{(a_k - \hat a_k)^2}{N_a^2/T_k} + \sum_k \frac{(w_k - \hat w_k)^2}{N_g^2/T_k}
        + \sum_j \frac{(x_j - x_{j0})^2}{\sigma_j^2}

    over any positions and mountings, at the information bound. A random walk K of the bias adds its covariance between the dwells.

    Parameters
    ----------
    readings : of either sensor or both, with their noise. Without noise the residuals give it, and there is no test of fit.
    latitude : rad, north positive; None estimates it.
    free : names out of `jaxcal.alignment.NAMES`; by default the angles and biases, and the scale errors where there is a z reading.
        Parameters with a prior are free as well.
    priors : name -> standard deviation about zero, or (mean, standard deviation), SI; angles need the mean.
    start : name -> value, SI: where to start, and the value of a parameter that is not free (zero otherwise).
    hint : rough azimuth, rad, for readings that allow two.
    hemisphere : "north" or "south", for a latitude that the table alone gives.
    gravity : local gravity, m/s^2.

    Returns
    -------
    AlignmentFit
        With covariance, observability, chi-square test and a verdict. Traced, it holds numbers alone and no sentences.

    Raises
    ------
    DataError
        For unknown names, readings of too few kinds, and a latitude that these positions cannot give.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Sensor, fit, simulate
    >>> angles = np.deg2rad([0.0, 90.0, 180.0, 270.0])
    >>> gyro, accel = Sensor(bias=5e-8, white=1e-8), Sensor(bias=1e-3, white=1e-6)
    >>> readings = simulate(angles, np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    >>> found = fit(readings, 0.6)
    >>> print(np.rad2deg(found.psi).round(1), np.rad2deg(found.azimuth_std).round(3))
    40.0 0.007

    References
    ----------
    The whole model of the north-finding paper, equations (16) to (39) in corrected form, solved jointly.
    """
    check_gravity(gravity)
    if latitude is not None:
        check_latitude(latitude)
    sensors = readings.accel is not None, readings.gyro is not None
    chosen = free_of(free, priors, readings.positions, latitude, sensors)
    mean, certainty = priors_of(priors)
    given, known = given_of(start)
    for sensor, there, needed in (
        ("accelerometer", sensors[0], ("b_a", "s_a", "ma_a_xy", "ma_a_xz", "b_a_rate")),
        ("gyro", sensors[1], ("psi", "b_g", "s_g")),
    ):
        if not there and free is not None and any(chosen[INDEX[name]] for name in needed):
            raise DataError(
                f"There are no {sensor} readings, and {', '.join(n for n in needed if chosen[INDEX[n]])} cannot be free without."
            )
    if not any(sensors):
        raise DataError("There are neither accelerometer nor gyro readings; give at least one of them.")
    if hemisphere not in (None, "north", "south"):
        raise DataError(f"The hemisphere is {hemisphere!r}; expected 'north' or 'south'.")
    if latitude is not None:
        given[INDEX["latitude"]] = latitude
        known = known | (np.arange(COUNT) == INDEX["latitude"])
    elif certainty[INDEX["latitude"]] != 0:
        given[INDEX["latitude"]], known = mean[INDEX["latitude"]], known | (np.arange(COUNT) == INDEX["latitude"])
    check_latitude_free(chosen, certainty, readings.positions)
    if not chosen.any():
        raise DataError("No parameter is free; name some in `free`.")
    side = {None: 0.0, "north": 1.0, "south": -1.0}[hemisphere]
    return _driven(readings, chosen, (mean, certainty), (given, known), np.nan if hint is None else hint, side, gravity)


def _driven(readings, chosen, priors, starts, hint, side, gravity) -> AlignmentFit:
    white = [readings.white(sensor) for sensor in ("accel", "gyro")]
    walk = [readings.walk(sensor) for sensor in ("accel", "gyro")]
    correlated = any(isinstance(k, jax.core.Tracer) or float(k) > 0 for k in walk)
    there = [getattr(readings, sensor) is not None for sensor in ("accel", "gyro")]
    noise_known = all(w is not None for w, is_there in zip(white, there, strict=True) if is_there)
    white = [nominal if w is None else w for w, nominal in zip(white, _NOMINAL, strict=True)]
    table = tabulate(readings, gravity)
    dtype = jnp.asarray(table.accel).dtype
    to = lambda values: jnp.stack([jnp.asarray(value, dtype=dtype) for value in values])  # noqa: E731
    mean, certainty, given = to(priors[0]), to(priors[1]), to(starts[0])
    angle_prior = any(isinstance(c, jax.core.Tracer) or float(c) > 0 for c in priors[1][:3])
    turn = bool(chosen[:3].all()) and not angle_prior and not starts[1][:3].any()
    rest = (
        jnp.asarray(chosen),
        mean,
        certainty,
        given,
        jnp.asarray(starts[1]),
        jnp.asarray(hint, dtype=dtype),
        jnp.asarray(side, dtype=dtype),
    )
    table = as_arrays(table, dtype)
    plane = not {"z", "-z"} & set(readings.positions.mounting)
    for _ in range(1 if noise_known or is_traced(readings) else _ROUNDS):
        noise = tuple(jnp.stack([jnp.asarray(w, dtype=dtype), jnp.asarray(k, dtype=dtype)]) for w, k in zip(white, walk, strict=True))
        raw = _fitted(table, noise, correlated, jnp.asarray(turn), jnp.asarray(plane), *rest)
        if noise_known or is_traced(readings):
            break
        white = [w if readings.white(s) is not None else float(w * f) for w, f, s in zip(white, raw.factor, ("accel", "gyro"), strict=True)]
    return _result(raw, readings, chosen, certainty, noise_known, plane)


class _Raw(eqx.Module):
    """What the compiled part finds."""

    values: Array
    covariance: Array
    rank: Array
    hidden: Array
    lost: Array
    accel: Array
    gyro: Array
    chi_square: Array
    dof: Array
    p_value: Array
    other: Array
    twofold: Array
    usable: Array
    factor: Array
    redundant: Array
    verdict: Any


@eqx.filter_jit
def _fitted(table: Table, noise, correlated: bool, turn, plane, free, mean, certainty, given, known, hint, side) -> _Raw:
    by = whitening(table, noise, correlated)
    first = begin(table, given, known, free, hint, noise[1][0], side)
    rows = Rows(
        table, by, first.values, table_from_nav(*first.values[:3]), turn & (jnp.abs(jnp.cos(first.values[1])) < np.cos(_STEEP)), mean,
        jnp.where(free, certainty, 0),
    )  # fmt: skip
    limit = jnp.where(free, jnp.inf, 0)
    found = solve(residuals, jnp.zeros_like(first.values), rows, bounds=(-limit, limit), rtol=_SETTLED)
    step, jacobian, r = (jnp.asarray(part) for part in (found.parameters, found.jacobian, found.residuals))
    values = euler(step, rows)
    still = jax.lax.stop_gradient
    frozen = still(rows)
    duration = jnp.max(table.start + table.dwell) - jnp.min(table.start)
    sizes = physical(table.gravity, duration, step.dtype)
    known_of = know(still(jacobian), free, sizes)
    to_angles = jax.jacfwd(lambda s: angles_of(parameters_at(s, frozen)[1]))(still(step))
    change = jnp.eye(COUNT, dtype=step.dtype).at[:3].set(jnp.where(rows.rotate, to_angles, jnp.eye(COUNT, dtype=step.dtype)[:3]))
    finite = jnp.where(jnp.isfinite(known_of.covariance), known_of.covariance, 0)
    infinite = jnp.eye(COUNT, dtype=bool) & known_of.lost[:, None]
    covariance = jnp.where(infinite, jnp.inf, change @ finite @ change.T)

    n = table.angle.size
    counted = jnp.concatenate([table.has_accel, table.has_gyro, frozen.certainty > 0])
    count = jnp.sum(counted)
    dof = count - known_of.rank_with_priors
    chi_square = jnp.sum(r**2)
    p_value = jax.scipy.special.gammaincc(jnp.maximum(dof, 1) / 2, chi_square / 2)
    # share of every reading that the fit does not explain by itself: it tells the noise of each sensor
    root = still(jacobian)
    leverage = jnp.einsum("mi,ij,mj->m", root, finite, root)
    left = jnp.stack([jnp.sum(jnp.where(counted, 1 - leverage, 0)[part]) for part in (slice(0, n), slice(n, 2 * n))])
    square = jnp.stack([jnp.sum(r[:n] ** 2), jnp.sum(r[n : 2 * n] ** 2)])
    redundant = left > 0.5
    factor = jnp.where(redundant, jnp.maximum(jnp.sqrt(square / jnp.where(redundant, left, 1)), 1e-6), 1)

    mirror = values.at[0].set(wrap(np.pi - values[0])).at[2].set(wrap(-values[2]))
    other = jnp.where(first.twofold, first.other, jnp.where(plane, mirror, 0))
    # the solver's own test fails on readings without noise, whose residuals are rounding, and along open combinations
    gradient = root.T @ still(r)
    settled = gradient @ finite @ gradient < _DONE**2
    usable = found.usable | (settled & (found.outcome != Outcome.not_finite))
    verdict = Verdict.where(free[2] & (covariance[2, 2] > WEAK**2), Verdict.weak, Verdict.ok)
    verdict = Verdict.where((dof > 0) & (p_value < _MISFIT), Verdict.misfit, verdict)
    verdict = Verdict.where(first.twofold, Verdict.undecided, verdict)
    verdict = Verdict.where(jnp.any(known_of.lost), Verdict.unobservable, verdict)
    verdict = Verdict.where(free[2] & (jnp.abs(values[INDEX["latitude"]]) > _POLE), Verdict.pole, verdict)
    verdict = Verdict.where(usable & jnp.all(jnp.isfinite(values)), verdict, Verdict.unfinished)
    return _Raw(
        values, covariance, known_of.rank, known_of.hidden, known_of.lost, r[:n], r[n : 2 * n], chi_square, dof, p_value, other,
        first.twofold, usable, factor, redundant, verdict,
    )  # fmt: skip


def _result(raw: _Raw, readings: Readings, chosen, certainty, noise_known: bool, plane: bool) -> AlignmentFit:
    n = len(readings.positions)
    prior_only = jnp.asarray(chosen) & (certainty > 0) & (jnp.diagonal(raw.covariance) * certainty**2 > 0.95**2)
    common: dict[str, Any] = {
        "covariance": raw.covariance, "free": chosen, "rank": raw.rank, "hidden": raw.hidden, "lost": raw.lost, "values": raw.values,
        "prior_only": prior_only, "accel_residual": raw.accel[:n], "gyro_residual": raw.gyro[:n], "chi_square": raw.chi_square,
        "degrees_of_freedom": raw.dof, "noise_known": noise_known, "verdict": raw.verdict,
    }  # fmt: skip
    if is_traced(raw):
        return AlignmentFit(p_value=raw.p_value, other=raw.other, **common)
    notes, dof = [], int(raw.dof)
    if not noise_known:
        sensors = zip((("accel", "accelerometer"), ("gyro", "gyro")), np.asarray(raw.redundant), strict=True)
        open_ = [(name, word) for (name, word), enough in sensors if not enough and getattr(readings, name) is not None]
        short = [word for name, word in open_ if readings.white(name) is None]
        notes.append("No noise was given: the residuals gave it, and there is no test of fit.")
        if short:
            notes.append(
                f"The {' and the '.join(short)} readings leave nothing to estimate noise from; their standard deviations are those of a "
                "nominal sensor (50 micro-g sqrt(s), 0.01 deg/sqrt(h)). Give noise coefficients, or measure more positions."
            )
    if dof <= 0:
        notes.append("There are as many parameters as readings: nothing checks the fit.")
    if np.any(prior_only):
        names = [name for name, i in INDEX.items() if np.asarray(prior_only)[i]]
        notes.append(f"From the prior alone: {', '.join(names)}.")
    twofold = bool(raw.twofold)
    if plane and not twofold and chosen[2] and chosen[0]:
        notes.append(
            "Without a z reading the mirrored attitude (180 degrees less roll, minus azimuth) gives the same readings; roll within 90 "
            "degrees is taken."
        )
    if float(readings.walk("gyro")) == 0 and any(
        float(getattr(noise, "B", 0.0)) > 0 for noise in (readings.accel_noise, readings.gyro_noise)
    ):
        notes.append("Bias instability B is not part of the weights; turn the table within the time of the Allan minimum.")
    p_value = float(raw.p_value) if noise_known and dof > 0 else None
    verdict = raw.verdict
    if p_value is None and bool(verdict == Verdict.misfit):
        verdict = Verdict.weak if float(raw.covariance[2, 2]) > WEAK**2 else Verdict.ok
    other = np.asarray(raw.other) if twofold or (plane and chosen[0] and chosen[2]) else None
    return AlignmentFit(p_value=p_value, other=other, notes=tuple(notes), **{**common, "verdict": verdict})
