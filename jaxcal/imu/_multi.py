"""`multi_position`: both triads from still poses and the turns between them, without a turntable."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from ..fitting import AbstractLoss, Fit, Huber, Outcome
from ._estimate import described, framed, placed, solved, started
from ._frames import CONVENTIONS
from ._gravity import EARTH_RATE
from ._joint import Joint, Options, held_out as left_out, joint_fit, rest_start
from ._known import checked_gravity
from ._model import Imu, entries, freed, values
from ._observe import SINGULAR, Observability, observability
from ._poses import Rests, padded, rests_of, turns_of
from ._recording import Recording, not_still, pinned, recording, stuck, wrong_units
from ._residuals import Weighted, pieces
from ._result import ImuFit, intervals
from ._scales import coefficients, excess, sandwich
from ._start import explanation, nominal_start, scanned_scale
from ._static import StillIntervals, static_intervals, windowed_variance
from ._tedaldi import tedaldi
from ._threshold import Choice, chosen, norms
from ._triad import Triad
from ._verdict import Judgement, judge

METHODS = ("joint", "imu_tk")
MODELS = ("full", "diagonal")
_HUBER = Huber()


@host_float64
def multi_position(
    log: Any,
    *,
    gravity: float | int,
    convention: str = "upper",
    method: str = "joint",
    model: Any = "full",
    g_sensitivity: bool = True,
    loss: Any = _HUBER,
    latitude: float | None = None,
    noise: Any = None,
    raw: bool = False,
    threshold: float | int | None = None,
    initial: float | int | None = 30.0,
    window: float | int = 1.0,
    least: float | int = 1.0,
    time: Any = None,
    held_out: bool = True,
) -> ImuFit:
    r"""Scale factors, misalignments, biases and g-sensitivity from poses held still and the turns between them.

    At rest the corrected specific force has the length of gravity, whatever the attitude; between two poses the integrated rate
    turns one vertical into the next; and the still rates show the bias and its dependence on the specific force,

    .. math:: g = |D_a(y_k - b_a)|,\qquad R(q_k)^T u_k = u_{k+1},\ \dot q = \tfrac12 q\,\omega,\qquad
              \bar y_k = b_g + G f_k + M_g\,\omega_E,\quad \omega = D_g(y - b_g - G f).

    The joint fit weighs the three by the size of their residuals (from noise coefficients where they are given), shares the errors of
    the verticals among the turns that meet in them, and counts every pose and every turn as one observation.

    Parameters
    ----------
    log : `jaxcal.Log` of a rest of at least 30 s, and 18 to 50 poses of 2 s or more: six faces, twelve edges, some corners, with turns of
        45 to 180 degrees between them.
    gravity : m/s^2 at the place; see `jaxcal.imu.gravity`.
    convention : frame of the result, "upper", "lower" or "full" (see `turned_to`); all describe the same calibration.
    method : "joint", or "imu_tk": the two-step fit of that program, with its thresholds, weights and frozen bias.
    model : "full" (9 parameters of the accelerometer), or "diagonal" (scale and bias, 6 poses); or a model of your own, where the fit
        starts: a subclass of `Triad` for the accelerometer, or an `Imu` with both sensors. Every floating-point field is fitted.
    g_sensitivity : whether to fit the gyroscope's sensitivity to specific force.
    loss : of `jaxcal.fitting`; `Huber()` bounds the influence of a disturbed pose. None for least squares.
    latitude : rad, to account for the Earth's rate: vertical part known, heading of the first pose fitted.
    noise : {"accel": noise, "gyro": noise}, each a `jaxcal.noise.Noise` or {"N": ..., "B": ...} in SI, for weights by dwell and turn.
    raw : whether the log holds counts: scales are then found from the data. Otherwise it is in m/s^2 and rad/s.
    threshold : multiple of the initial variance below which the sensor is still; None compares 2 to 10.
    initial : length of the rest at the beginning, s; None where there is none.
    window, least : window of the variance and shortest interval, s.
    time : (n,) stamps in s, where those of the log's even grid are not wanted.
    held_out : whether to fit twice more, each time without half the poses and turns, for `held_out`.

    Returns
    -------
    ImuFit
        With a verdict. Recordings that determine nothing give a "refused" fit without triads.

    Raises
    ------
    DataError
        If the log has no accelerometer with three axes, its stamps do not grow, it is shorter than the initial rest, or an option is
        unknown or gravity is not in m/s^2.

    Examples
    --------
    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    >>> found = jaxcal.imu.multi_position(log, gravity=9.81)
    >>> print(found.verdict, len(found.still))
    good 18

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014 (the protocol and the two costs); the thesis, equations (5.1) to (5.5).
    """
    options = _checked(log, gravity, convention, method, model, g_sensitivity, loss, latitude, noise)
    record = recording(log, time)
    if not raw and (wrong := wrong_units(record.accel, options.gravity)):
        return _refusal(record, options, method, wrong)
    if method == "imu_tk":
        if record.gyro is None:
            raise DataError("method='imu_tk' needs a gyroscope; leave it out for an accelerometer alone")
        if model != "full" or latitude is not None or noise is not None:
            raise DataError("method='imu_tk' has none of model, latitude and noise; leave them out, or take method='joint'")
    start = started(None if isinstance(model, str) else model, record.gyro is not None, latitude is not None)
    needed = _count(freed(Imu(start.accel), convention, options.misalignment))
    still = static_intervals(record.accel, record.rate, threshold=threshold, window=window, initial=initial, least=least)
    variance = windowed_variance(record.accel, 2 * max(round(float(window) * record.rate / 2), 1) + 1)
    if initial is not None and (moved := not_still(still, variance)):
        return _refusal(record, options, method, moved, still)
    choice = chosen(record, still, variance, start.accel, needed, options, threshold, window, least, raw, all_samples=method == "imu_tk")
    if choice is None:
        most = max(len(still), *still.counts.values())
        name = model if isinstance(model, str) else type(start.accel).__name__
        return _refusal(
            record, options, method,
            f"There are {most} still intervals; the {name} model needs {needed} at least, 18 to 24 are advised: hold it still "
            f"for {max(2.0, 2 * float(least)):g} s on each face and edge, and some corners.", still,
        )  # fmt: skip
    if method == "imu_tk":
        return tedaldi(record, choice, options, least, raw, initial, held_out)
    return _joint(record, choice, start, needed, options, raw, held_out)


def _count(free: Any) -> int:
    return int(sum(np.sum(leaf) for leaf in jax.tree.leaves(free)))


def _joint(record: Recording, choice: Choice, model: Imu, needed: int, options: Options, raw: bool, held_out: bool) -> ImuFit:
    clipped = stuck(record.accel, choice.still.start, choice.still.stop)
    notes = list(choice.warnings)
    start, stop = choice.still.start[~clipped], choice.still.stop[~clipped]
    if clipped.any():
        notes.append(f"{clipped.sum()} poses were left out: an axis of the accelerometer is at the end of its range (saturated).")
    if len(start) < needed:
        reason = f"{len(start)} of {len(clipped)} still intervals are left, {needed} are needed: an axis of the accelerometer saturates."
        return _refusal(record, options, "joint", reason, choice.still)
    rests = rests_of(record, start, stop)
    begin = Imu(nominal_start(model.accel, rests.accel, options.gravity) if raw else model.accel)
    data = norms(rests.accel, rests.slots, options.gravity)
    fit = solved(begin, data, options.convention, options.misalignment, rtol=None)
    at_rest = pieces(fit.model, data)
    up, size = np.asarray(at_rest.vertical)[: len(start)], options.gravity - np.asarray(at_rest.norm)[: len(start)]
    accel, force = jax.tree.map(np.asarray, fit.model.accel), size[:, None] * up
    seen = observability(up, not options.misalignment)
    if not seen.condition <= SINGULAR:
        return _refusal(record, options, "joint", seen.sentence, choice.still, seen)
    if record.gyro is None:
        return _accel_only(record, choice, rests, fit, needed, seen, options, notes)
    turns = turns_of(record, start, stop, rests.slots)
    over, valid = pinned(record.gyro), np.isfinite(turns.sigma)
    bad = np.zeros(len(valid), dtype=bool)
    bad[: len(start) - 1] = [over[i:j].any() for i, j in zip(stop[:-1] - 1, start[1:], strict=True)]
    if lost := len(start) - 1 - int(valid.sum()):
        notes.append(f"{lost} turns were left out: samples are missing in them.")
    if bad.any():
        notes.append(f"{bad.sum()} turns were left out: the gyroscope saturates in them. Turn more slowly.")
        turns = dataclasses.replace(turns, sigma=np.where(bad, np.inf, turns.sigma))
    if (kept := int(np.isfinite(turns.sigma).sum())) < 6:
        why = " ".join(notes[len(choice.warnings) :]) or "There are too few poses."
        return _refusal(record, options, "joint", f"{kept} turns are left, 6 are needed for a gyroscope. {why}", choice.still, seen)
    vertical = padded(up, rests.slots)
    bias, cross, drift = rest_start(rests, force, options.g_sensitivity, np.zeros(3))
    scale = scanned_scale(bias, vertical, turns) if raw else 1.0
    if options.latitude is not None:
        earth = EARTH_RATE * np.sin(options.latitude) * up / scale
        bias, cross, drift = rest_start(rests, force, options.g_sensitivity, earth)
    matrix = np.eye(3) / scale if raw else model.gyro.matrix
    gyro = eqx.tree_at(lambda t: (t.matrix, t.bias, t.g_sensitivity), model.gyro, (matrix, bias, cross))
    one = np.ones(len(start))
    data = Weighted(rests.poses(one, np.ones((len(start), 3))), turns, np.asarray(options.gravity), options.latitude)
    found = joint_fit(Imu(accel, gyro, np.zeros(3) if drift else None, model.north), data, rests, options, needed)
    outside = left_out(found, options) if held_out else np.full(2, np.nan)
    if drift:
        notes.append("The gyroscope's bias drifts during the record (F test, 1 %); a linear drift is part of the fit. Let it warm up.")
    return _result(record, choice, found, rests, needed, seen, options, notes, outside, vertical, bias, scale)


def _result(
    record: Recording, choice: Choice, joint: Joint, rests: Rests, needed: int, seen: Observability, options: Options, notes: list[str],
    outside: np.ndarray, vertical: np.ndarray, bias: np.ndarray, scale: float,
) -> ImuFit:  # fmt: skip
    fit, found, slots, count = joint.fit, joint.found, rests.slots, len(rests.accel)
    clusters = np.concatenate([np.arange(slots), np.repeat(slots + np.arange(slots - 1), 2), np.repeat(np.arange(slots), 3), [-1, -1]])
    turned, measured = np.asarray(found.turned), joint.data.turns
    assert measured is not None
    valid = np.isfinite(measured.sigma)
    turns, own = int(valid.sum()), _count(freed(Imu(None, fit.model.gyro), options.convention, g_sensitivity=False)) - 3
    still = 3 * (count - 1 - 3 * options.g_sensitivity)
    by_field = {"accel": count - needed, "gyro": 2 * turns - own, "gyro.bias": still, "gyro.g_sensitivity": still}
    names = entries(fit.model)[0]
    freedom = np.array([by_field.get(name.split("[")[0], by_field[name.split(".")[0]]) for name in names], dtype=float)
    angle = np.linalg.norm(turned[valid], axis=1)
    weight = np.asarray(fit.weights)
    pairs = weight[slots : 3 * slots - 2].reshape(-1, 2)[valid]
    low = (np.flatnonzero(weight[:count] < 0.5), np.flatnonzero(np.min(pairs, axis=1) < 0.5))
    model, at, plain, robust = _covariances(fit, joint.data, options, clusters[: len(weight)])
    judged = judge(fit, at, plain, seen, count, turns, angle, low, joint.sigma, options, True, list(notes))
    if judged.verdict == "refused" and (why := explanation(bias, vertical, measured, scale)):
        judged = Judgement(judged.verdict, f"{judged.reason} {why}", judged.warnings)
    gyro = np.linalg.inv(fit.model.gyro.matrix)
    return ImuFit(
        accel=model.accel, gyro=model.gyro, covariance=plain, interval=intervals(at, plain, freedom), robust_covariance=robust,
        degrees_of_freedom=freedom, residual_norm=found.norm[:count], residual_turn=angle, residual_rest=found.rest[:count] @ gyro.T,
        sigma=joint.sigma, down_weighted=low, cost=np.array([0.5 * np.sum(found.norm[:count] ** 2), 0.5 * np.sum(turned[valid] ** 2)]),
        held_out=outside, still=choice.still, thresholds=choice.table, observability=seen,
        drift=np.zeros(3) if fit.model.drift is None else gyro @ fit.model.drift, rate=record.rate, gravity=options.gravity,
        temperature=record.temperature, verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings,
        convention=options.convention, method="joint",
    )  # fmt: skip


def _covariances(fit: Fit, data: Weighted, options: Options, clusters: np.ndarray) -> tuple[Imu, Any, Any, Any]:
    """Model, its parameters, and their covariance with its sandwich form, in the frame of the convention."""
    found = described(fit, data, options.convention)
    model = jax.tree.map(np.asarray, found.model)
    if bool(fit.outcome == Outcome.unidentifiable):
        return model, values(model), np.asarray(found.covariance), np.full(found.covariance.shape, np.inf)
    matrix = placed(fit.names, sandwich(fit, clusters), found.names)
    return model, values(model), np.asarray(found.covariance), np.asarray(framed(fit.model, options.convention, matrix)[1][0])


def _accel_only(
    record: Recording, choice: Choice, rests: Rests, fit: Fit, needed: int, seen: Observability, options: Options, notes: list[str]
) -> ImuFit:
    """Without a gyroscope: the norms alone."""
    count, gravity = len(rests.accel), options.gravity
    residual = np.asarray(fit.residuals)[:count]
    size = float(np.sqrt(excess(residual, np.zeros(count), needed)))
    data = norms(rests.accel, rests.slots, gravity, size)
    if options.loss is not None:
        fit = solved(fit.model, data, options.convention, options.misalignment, loss=options.loss, rtol=None)
        residual = np.asarray(fit.residuals)[:count] * size
    model, at, plain, robust = _covariances(fit, data, options, np.arange(rests.slots))
    freedom = np.full(len(at), float(count - needed))
    low = (np.flatnonzero(np.asarray(fit.weights)[:count] < 0.5), np.zeros(0, dtype=int))
    sigma = np.array([size, np.nan, np.nan])
    judged = judge(fit, at, plain, seen, count, 0, np.zeros(0), low, sigma, options, False, list(notes))
    made = ImuFit(
        accel=model.accel, residual_norm=residual, sigma=sigma, down_weighted=low, cost=np.array([0.5 * np.sum(residual**2), np.nan]),
        still=choice.still, thresholds=choice.table, observability=seen, rate=record.rate, gravity=gravity, temperature=record.temperature,
        verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings, convention=options.convention, method="joint",
    )  # fmt: skip
    names = entries(model)[0]
    limits = [intervals(at, plain, freedom)[names.index(name)] if name in names else np.full(2, np.nan) for name in made.names]
    return dataclasses.replace(
        made, covariance=placed(names, plain, made.names), robust_covariance=placed(names, robust, made.names),
        degrees_of_freedom=np.full(len(limits), float(count - needed)), interval=np.array(limits),
    )  # fmt: skip


def _refusal(
    record: Recording, options: Options, method: str, reason: str, still: StillIntervals | None = None, seen: Observability | None = None
) -> ImuFit:
    """A fit without triads."""
    return ImuFit(
        still=still, observability=seen, rate=record.rate, gravity=options.gravity, temperature=record.temperature, verdict="refused",
        reason=reason, warnings=() if still is None else still.warnings, convention=options.convention, method=method,
    )  # fmt: skip


def _checked(log, gravity, convention, method, model, g_sensitivity, loss, latitude, noise) -> Options:
    if is_traced(getattr(log, "accel", None)):
        raise DataError("`multi_position` decides on the host and cannot be traced; take `imu.estimate`, which can.")
    for name, value, known in (("convention", convention, CONVENTIONS), ("method", method, METHODS)):
        if value not in known:
            raise DataError(f"There is no {name} {value!r}; known are {', '.join(map(repr, known))}.")
    if not (model in MODELS if isinstance(model, str) else isinstance(model, (Triad, Imu))):
        raise DataError(f"There is no model {model!r}; known are 'full' and 'diagonal', or give a Triad or an Imu.")
    if convention == "full" and not (isinstance(model, str) or Imu(model).plain):
        raise DataError("A subclass of Triad cannot be turned into the frame 'full'; take convention='upper' or 'lower'.")
    if not isinstance(loss, AbstractLoss | None):
        raise DataError(f"There is no loss {loss!r}; give one of jaxcal.fitting, such as Huber(), or None.")
    if latitude is not None and not abs(float(latitude)) <= np.pi / 2:
        raise DataError(f"latitude={latitude:g} rad lies beyond a pole; degrees must be multiplied by pi/180")
    return Options(
        checked_gravity(gravity), convention, bool(g_sensitivity), model != "diagonal", loss, coefficients(noise, "accel"),
        coefficients(noise, "gyro"), None if latitude is None else float(latitude),
    )  # fmt: skip
