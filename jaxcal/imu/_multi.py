"""`multi_position`: both triads from still poses and the turns between them, without a turntable."""

import dataclasses
from typing import Any

import numpy as np
import scipy.stats

from .._errors import DataError
from .._precision import host_float64, is_traced
from ..fitting import Outcome
from ._estimate import (
    Estimate,
    Means,
    Options,
    describe,
    fit_norms,
    free_of,
    joint_data,
    joint_fit,
    means_of,
    padded,
    refitted,
    rest_start,
    spread,
    weights,
)  # fmt: skip
from ._frames import CONVENTIONS
from ._gravity import EARTH_RATE
from ._joint import ImuParameters
from ._known import checked_gravity
from ._norms import AccelParameters, GyroParameters, nominal_start
from ._observe import SINGULAR, Observability, observability
from ._recording import Recording, not_still, pinned, recording, stuck, wrong_units
from ._result import ImuFit
from ._scales import coefficients, excess
from ._start import explanation, scanned_scale
from ._static import StillIntervals, static_intervals, windowed_variance
from ._tedaldi import tedaldi
from ._threshold import Choice, chosen
from ._triad import Triad
from ._turns import power_of_two, segments_of
from ._verdict import Judgement, judge

METHODS = ("joint", "imu_tk")
MODELS = ("full", "diagonal")
LEAST = {"full": 9, "diagonal": 6}


@host_float64
def multi_position(
    log: Any,
    *,
    gravity: float | int,
    convention: str = "upper",
    method: str = "joint",
    model: str = "full",
    g_sensitivity: bool = True,
    loss: str | None = "huber",
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
    model : "full" (9 parameters of the accelerometer), or "diagonal" (scale and bias, 6 poses).
    g_sensitivity : whether to fit the gyroscope's sensitivity to specific force.
    loss : "huber", which bounds the influence of a disturbed pose, or None.
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
        return _refusal(record, options, convention, method, wrong)
    if method == "imu_tk":
        if record.gyro is None:
            raise DataError("method='imu_tk' needs a gyroscope; leave it out for an accelerometer alone")
        if options.diagonal or latitude is not None or noise is not None:
            raise DataError("method='imu_tk' has none of model, latitude and noise; leave them out, or take method='joint'")
    still = static_intervals(record.accel, record.rate, threshold=threshold, window=window, initial=initial, least=least)
    variance = windowed_variance(record.accel, 2 * max(round(float(window) * record.rate / 2), 1) + 1)
    if initial is not None and (moved := not_still(still, variance)):
        return _refusal(record, options, convention, method, moved, still)
    choice = chosen(record, still, variance, options, threshold, window, least, raw, all_samples=method == "imu_tk")
    if choice is None:
        most = max(len(still), *still.counts.values())
        return _refusal(
            record, options, convention, method,
            f"There are {most} still intervals; the {model} model needs {LEAST[model]} at least, 18 to 24 are advised: hold it still "
            f"for {max(2.0, 2 * float(least)):g} s on each face and edge, and some corners.", still,
        )  # fmt: skip
    if method == "imu_tk":
        return tedaldi(record, choice, options, convention, least, raw, initial, held_out)
    return _joint(record, choice, options, convention, raw, held_out)


def _joint(record: Recording, choice: Choice, options: Options, convention: str, raw: bool, held_out: bool) -> ImuFit:
    clipped = stuck(record.accel, choice.still.start, choice.still.stop)
    notes = list(choice.warnings)
    start, stop = choice.still.start[~clipped], choice.still.stop[~clipped]
    if clipped.any():
        notes.append(f"{clipped.sum()} poses were left out: an axis of the accelerometer is at the end of its range (saturated).")
    needed = 6 if options.diagonal else 9
    if len(start) < needed:
        reason = f"{len(start)} of {len(clipped)} still intervals are left, {needed} are needed: an axis of the accelerometer saturates."
        return _refusal(record, options, convention, "joint", reason, choice.still)
    means = means_of(record, start, stop)
    slots = power_of_two(len(start) + 1, 32)
    begin = nominal_start(means.accel, options.gravity, raw)
    fit = fit_norms(padded(means.accel, slots), weights(len(start), slots), begin, options.gravity, options.diagonal)
    accel = fit.model
    up = (means.accel - np.asarray(accel.bias)) @ np.asarray(accel.correction()).T
    seen = observability(up / np.linalg.norm(up, axis=1, keepdims=True), options.diagonal)
    if not seen.condition <= SINGULAR:
        return _refusal(record, options, convention, "joint", seen.sentence, choice.still, seen)
    if record.gyro is None:
        return _accel_only(record, choice, means, fit, seen, options, convention, notes)
    segments = segments_of(record.time, record.gyro, record.accel, start, stop, slots)
    over = pinned(record.gyro)
    first, last = stop[:-1] - 1, start[1:]
    bad = np.zeros(slots, dtype=bool)
    bad[: len(first)] = [over[i:j].any() for i, j in zip(first, last, strict=True)]
    lost = int(len(first) - segments.weight.sum())
    if lost:
        notes.append(f"{lost} turns were left out: samples are missing in them.")
    if bad.any():
        notes.append(f"{bad.sum()} turns were left out: the gyroscope saturates in them. Turn more slowly.")
        segments = dataclasses.replace(segments, weight=np.where(bad, 0.0, segments.weight))
    if segments.weight.sum() < 6:
        why = " ".join(notes[len(choice.warnings) :]) or "There are too few poses."
        return _refusal(
            record, options, convention, "joint", f"{int(segments.weight.sum())} turns are left, 6 are needed for a gyroscope. {why}",
            choice.still, seen,
        )  # fmt: skip
    vertical = padded(up / np.linalg.norm(up, axis=1, keepdims=True), slots)
    latitude = options.latitude
    bias, cross, drift = rest_start(means, up, options.g_sensitivity, np.zeros(3))
    scale = scanned_scale(bias, vertical, segments) if raw else 1.0
    if latitude is not None:
        earth = EARTH_RATE * np.sin(latitude) * vertical[: len(up)] / scale
        bias, cross, drift = rest_start(means, up, options.g_sensitivity, earth)
    start_at = ImuParameters(accel, GyroParameters(np.zeros(6), np.full(3, scale), bias, cross), np.zeros(3), np.zeros(2))
    data = joint_data(record, means, segments, accel, bias, options, slots)
    found = joint_fit(start_at, data, means, options, drift)
    outside = _held_out(found, means, options) if held_out else np.full(2, np.nan)
    if drift:
        notes.append("The gyroscope's bias drifts during the record (F test, 1 %); a linear drift is part of the fit. Let it warm up.")
    return _result(record, choice, found, means, seen, options, convention, notes, outside, vertical, bias, scale)


def _result(
    record, choice, found: Estimate, means: Means, seen, options: Options, convention, notes, outside, vertical, bias, scale
) -> ImuFit:
    fit, data = found.fit, found.data
    slots, count = len(data.poses.weight), len(means.accel)
    clusters = np.concatenate([np.arange(slots), np.repeat(slots + np.arange(slots), 2), np.repeat(np.arange(slots), 3), [-1, -1]])
    known = bool(fit.outcome != Outcome.unidentifiable)
    free = free_of(options, found.free_drift)
    values, plain, robust = spread(fit, free, convention, clusters if known else None)
    robust = np.full_like(plain, np.inf) if robust is None else robust
    valid = data.segments.weight > 0
    turns, norms = int(valid.sum()), count
    freedom = np.concatenate([
        np.full(12, norms - (6 if options.diagonal else 9)), np.full(9, 2 * turns - 9),
        np.full(12, 3 * (norms - 1 - 3 * options.g_sensitivity)),
    ]).astype(float)  # fmt: skip
    norm, turned, rest, _, _ = found.pieces
    rest_si = rest[:count] @ np.asarray(fit.model.gyro.correction()).T
    angle = np.linalg.norm(turned[valid], axis=1)
    weight = np.asarray(fit.weights)
    low = (
        np.flatnonzero(weight[:count] < 0.5),
        np.flatnonzero(np.min(weight[slots : 3 * slots].reshape(-1, 2)[valid], axis=1) < 0.5),
    )
    judged = judge(fit, values, plain, seen, norms, turns, angle, low, found.sigma, options, record.gyro is not None, list(notes))
    if judged.verdict == "refused" and (why := explanation(bias, vertical, data.segments, scale)):
        judged = Judgement(judged.verdict, f"{judged.reason} {why}", judged.warnings)
    half = scipy.stats.t.ppf(0.975, np.maximum(freedom, 1)) * np.sqrt(np.maximum(np.diag(plain), 0))
    return ImuFit(
        accel=Triad(values[:9].reshape(3, 3), values[9:12]),
        gyro=Triad(values[12:21].reshape(3, 3), values[21:24], values[24:].reshape(3, 3)),
        covariance=plain, interval=np.stack([values - half, values + half], axis=1), robust_covariance=robust,
        degrees_of_freedom=freedom, residual_norm=norm[:count], residual_turn=angle, residual_rest=rest_si, sigma=found.sigma,
        down_weighted=low, cost=np.array([0.5 * np.sum(norm[:count] ** 2), 0.5 * np.sum(turned[valid] ** 2)]), held_out=outside,
        still=choice.still, thresholds=choice.table, observability=seen,
        drift=np.asarray(fit.model.gyro.correction()) @ np.asarray(fit.model.drift), rate=record.rate, gravity=options.gravity,
        temperature=record.temperature, verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings, convention=convention,
        method="joint",
    )  # fmt: skip


def _held_out(found: Estimate, means: Means, options: Options) -> np.ndarray:
    """Root mean square of norms and of turns' components, fitted on even poses and turns and seen on odd ones, and the reverse."""
    squares: list[list[np.ndarray]] = [[], []]
    poses, turns = found.data.poses, found.data.segments
    slots = np.arange(len(poses.weight))
    for parity in (0, 1):
        inside = slots % 2 == parity
        if np.sum(poses.weight[inside]) < 9 or np.sum(turns.weight[inside]) < 6:
            return np.full(2, np.nan)
        keep = np.repeat(inside, 2)
        data = dataclasses.replace(
            found.data, poses=dataclasses.replace(poses, weight=np.where(inside, poses.weight, 0.0)),
            whiten=np.where(keep[:, None] & keep[None, :], found.data.whiten, 0.0),
        )  # fmt: skip
        model = refitted(found.fit.model, data, options, found.free_drift).model
        norm, turned = describe(model, found.data)[:2]
        squares[0].append(norm[~inside & (poses.weight > 0)] ** 2)
        squares[1].append(turned[~inside & (turns.weight > 0)] ** 2)
    return np.array([np.sqrt(np.mean(np.concatenate(part))) for part in squares])


def _accel_only(record, choice, means: Means, fit, seen: Observability, options: Options, convention, notes) -> ImuFit:
    """Without a gyroscope: the norms alone."""
    count = len(means.accel)
    residual = np.asarray(fit.residuals)[:count]
    size = np.sqrt(excess(residual, np.zeros(count), 6 if options.diagonal else 9))
    slots = len(np.asarray(fit.residuals))
    if options.robust:
        fit = fit_norms(padded(means.accel, slots), weights(count, slots), fit.model, options.gravity, options.diagonal, size)
        residual = np.asarray(fit.residuals)[:count] * size
    gyro = GyroParameters(np.zeros(6), np.ones(3), np.zeros(3), np.zeros((3, 3)))
    model = ImuParameters(fit.model, gyro, np.zeros(3), np.zeros(2))
    free = ImuParameters(AccelParameters(not options.diagonal, True, True), GyroParameters(False, False, False, False), False, False)
    values, plain, robust = spread(dataclasses.replace(fit, model=model), free, convention, np.arange(slots))
    freedom = np.full(33, float(count - (6 if options.diagonal else 9)))
    low = (np.flatnonzero(np.asarray(fit.weights)[:count] < 0.5), np.zeros(0, dtype=int))
    sigma = np.array([size, np.nan, np.nan])
    judged = judge(fit, values, plain, seen, count, 0, np.zeros(0), low, sigma, options, False, list(notes))
    half = scipy.stats.t.ppf(0.975, np.maximum(freedom, 1)) * np.sqrt(np.maximum(np.diag(plain), 0))
    interval = np.stack([values - half, values + half], axis=1)
    interval[12:] = np.nan
    return ImuFit(
        accel=Triad(values[:9].reshape(3, 3), values[9:12]), gyro=None, covariance=plain, interval=interval,
        robust_covariance=plain if robust is None else robust, degrees_of_freedom=freedom, residual_norm=residual,
        residual_turn=np.zeros(0), residual_rest=np.zeros((0, 3)), sigma=sigma, down_weighted=low,
        cost=np.array([0.5 * np.sum(residual**2), np.nan]), held_out=np.full(2, np.nan), still=choice.still, thresholds=choice.table,
        observability=seen, drift=np.zeros(3), rate=record.rate, gravity=options.gravity, temperature=record.temperature,
        verdict=judged.verdict, reason=judged.reason, warnings=judged.warnings, convention=convention, method="joint",
    )  # fmt: skip


def _refusal(
    record: Recording, options: Options, convention: str, method: str, reason: str, still: StillIntervals | None = None, seen=None
) -> ImuFit:
    """A fit without triads."""
    return ImuFit(
        accel=None, gyro=None, covariance=np.full((33, 33), np.inf), interval=np.full((33, 2), np.nan),
        robust_covariance=np.full((33, 33), np.inf), degrees_of_freedom=np.zeros(33), residual_norm=np.zeros(0), residual_turn=np.zeros(0),
        residual_rest=np.zeros((0, 3)), sigma=np.full(3, np.nan), down_weighted=(np.zeros(0, dtype=int), np.zeros(0, dtype=int)),
        cost=np.full(2, np.nan), held_out=np.full(2, np.nan), still=still, thresholds=np.zeros((0, 4)), observability=seen,
        drift=np.zeros(3),
        rate=record.rate, gravity=options.gravity, temperature=record.temperature, verdict="refused", reason=reason,
        warnings=() if still is None else still.warnings, convention=convention, method=method,
    )  # fmt: skip


def _checked(log, gravity, convention, method, model, g_sensitivity, loss, latitude, noise) -> Options:
    if is_traced(getattr(log, "accel", None)):
        raise DataError("`multi_position` decides on the host and cannot be traced; differentiate the residuals instead.")
    for name, value, known in (("convention", convention, CONVENTIONS), ("method", method, METHODS), ("model", model, MODELS)):
        if value not in known:
            raise DataError(f"There is no {name} {value!r}; known are {', '.join(map(repr, known))}.")
    if loss not in (None, "huber"):
        raise DataError(f"There is no loss {loss!r}; known are 'huber' and None.")
    if latitude is not None and not abs(float(latitude)) <= np.pi / 2:
        raise DataError(f"latitude={latitude:g} rad lies beyond a pole; degrees must be multiplied by pi/180")
    return Options(
        checked_gravity(gravity), bool(g_sensitivity), model == "diagonal", loss == "huber", coefficients(noise, "accel"),
        coefficients(noise, "gyro"), None if latitude is None else float(latitude),
    )  # fmt: skip
