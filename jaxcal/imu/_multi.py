"""`multi_position`: both triads from still poses and the turns between them, without a turntable."""

import dataclasses
from collections.abc import Callable
from functools import partial
from typing import Any, cast

import equinox as eqx
import jax
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from ..fitting import AbstractLoss, Fit, Huber, leverage
from . import _fits, _recording
from ._estimate import described, framed, placed, sandwich, solved, started
from ._fits import Joint, Options
from ._known import checked_gravity
from ._model import CONVENTIONS, EARTH_RATE, Imu, Triad, freed
from ._recording import Ends, Recording, Rests, StillIntervals, padded
from ._residuals import Weighted, pieces
from ._result import SINGULAR, ImuFit, finished, observability

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
    record = _recording.recording(log, time)
    empty = ImuFit(
        rate=record.rate, gravity=options.gravity, temperature=record.temperature, verdict="refused", reason="", convention=convention,
        method=method,
    )  # fmt: skip
    if not raw and (wrong := _recording.wrong_units(record.accel, options.gravity)):
        return dataclasses.replace(empty, reason=wrong)
    if method == "imu_tk":
        if record.gyro is None:
            raise DataError("method='imu_tk' needs a gyroscope; leave it out for an accelerometer alone")
        if model != "full" or latitude is not None or noise is not None:
            raise DataError("method='imu_tk' has none of model, latitude and noise; leave them out, or take method='joint'")
    start = started(None if isinstance(model, str) else model, record.gyro is not None, latitude is not None)
    needed = _count(freed(Imu(start.accel), convention, options.misalignment))
    still, tried, variance = _recording.still_tried(record.accel, record.rate, threshold, window, initial, least)
    empty = dataclasses.replace(empty, still=still, warnings=still.warnings)
    if initial is not None and (moved := _recording.not_still(still, variance)):
        return dataclasses.replace(empty, reason=moved)
    shortest = max(round(float(least) * record.rate), 2)
    usable = {k: ends for k, ends in tried.items() if len(ends[0]) >= needed}
    if not usable:
        most = max(len(still), *still.counts.values())
        name = model if isinstance(model, str) else type(start.accel).__name__
        reason = (
            f"There are {most} still intervals; the {name} model needs {needed} at least, 18 to 24 are advised: hold it still for "
            f"{max(2.0, 2 * float(least)):g} s on each face and edge, and some corners."
        )
        return dataclasses.replace(empty, reason=reason)
    chosen, fit = _chosen(record, empty, usable, start.accel, options, raw, shortest)
    if method == "imu_tk":
        return _fits.tedaldi(record, chosen, fit, options, shortest, raw, initial, held_out)
    return _joint(record, chosen, start, needed, options, raw, held_out)


def _chosen(
    record: Recording, empty: ImuFit, usable: dict[float, Ends], model: Triad, options: Options, raw: bool, shortest: int
) -> tuple[ImuFit, Fit]:
    """The multiple of the initial variance to use, judged by what it leaves of the calibration, and the fit of its norms.

    For imu_tk its own rule: the first samples of every interval, one residual each, and the smallest total cost. Else the most intervals
    among the multiples whose leave-one-out rms is within a standard error of the least: a total cost favours fewer poses.
    """
    by_cost, still = options.method == "imu_tk", cast(StillIntervals, empty.still)
    slots = _recording.power_of_two(max(len(start) for start, _ in usable.values()) + 1, 32)
    fits, table = {}, []
    for k, (start, stop) in usable.items():
        if by_cost:
            reading = np.concatenate([record.accel[i : i + shortest] for i in start])
        else:
            reading = _recording.means(record.accel, start, stop)
        count, each = len(start), len(reading) // len(start)
        start_at = _fits.nominal_start(model, reading.reshape(count, each, 3).mean(axis=1), options.gravity) if raw else model
        data = _recording.norms(reading, slots * each, options.gravity)
        fit = solved(Imu(start_at), data, options.convention, options.misalignment, rtol=None)
        # residual of every pose under the fit without it, to first order
        without = np.asarray(fit.residuals) / (1 - np.minimum(leverage(fit), 1 - 1e-6))
        rest = without[: count * each].reshape(count, each).mean(axis=1)
        fits[k] = fit
        table.append((k, count, float(fit.cost), np.sqrt(np.mean(rest**2)), np.std(rest**2) / np.sqrt(count)))
    rows = np.array(table)
    multiples, counts, cost, rms, error = rows.T
    cheapest, least = int(np.argmin(cost)), int(np.argmin(rms))
    close = rms**2 <= rms[least] ** 2 + error[least]
    best = cheapest if by_cost else int(np.argmax(np.where(close, counts, 0)))
    warnings = empty.warnings
    if not close[cheapest]:
        warnings += (
            f"The smallest total cost is at {multiples[cheapest]:g} times the initial variance, where poses left out fit worse than at "
            f"{multiples[least]:g} times: a total cost favours fewer intervals.",
        )
    k = float(multiples[best])
    start, stop = usable[k]
    still = dataclasses.replace(still, start=start, stop=stop, multiple=k, threshold=k * still.initial_variance)
    return dataclasses.replace(empty, still=still, thresholds=rows[:, :4], warnings=warnings), fits[k]


def _count(free: Any) -> int:
    return int(sum(np.sum(leaf) for leaf in jax.tree.leaves(free)))


def _joint(record: Recording, base: ImuFit, model: Imu, needed: int, options: Options, raw: bool, held_out: bool) -> ImuFit:
    still, notes = cast(StillIntervals, base.still), list(base.warnings)
    clipped = _recording.stuck(record.accel, still.start, still.stop)
    start, stop = still.start[~clipped], still.stop[~clipped]
    if clipped.any():
        notes.append(f"{clipped.sum()} poses were left out: an axis of the accelerometer is at the end of its range (saturated).")
    if len(start) < needed:
        reason = f"{len(start)} of {len(clipped)} still intervals are left, {needed} are needed: an axis of the accelerometer saturates."
        return dataclasses.replace(base, reason=reason)
    rests = _recording.rests_of(record, start, stop)
    begin = Imu(_fits.nominal_start(model.accel, rests.accel, options.gravity) if raw else model.accel)
    data = _recording.norms(rests.accel, rests.slots, options.gravity)
    fit = solved(begin, data, options.convention, options.misalignment, rtol=None)
    at_rest = pieces(fit.model, data)
    vertical, size = at_rest.vertical[: len(start)], options.gravity - at_rest.norm[: len(start)]
    accel, force = jax.tree.map(np.asarray, fit.model.accel), size[:, None] * vertical
    seen = observability(vertical, not options.misalignment)
    base = dataclasses.replace(base, observability=seen)
    if not seen.condition <= SINGULAR:
        return dataclasses.replace(base, reason=seen.sentence)
    if record.gyro is None:
        size = float(np.sqrt(_fits.excess(at_rest.norm[: len(start)], np.zeros(len(start)), needed)))
        data = _recording.norms(rests.accel, rests.slots, options.gravity, size)
        if options.loss is not None:
            fit = solved(fit.model, data, options.convention, options.misalignment, loss=options.loss, rtol=None)
        alone = Joint(fit, data, pieces(fit.model, data), np.array([size, np.nan, np.nan]))
        return _result(base, alone, rests, needed, options, notes, lambda: None)
    turns = _recording.turns_of(record, start, stop, rests.slots)
    over, valid = _recording.pinned(record.gyro), np.isfinite(turns.sigma)
    bad = np.zeros(len(valid), dtype=bool)
    bad[: len(start) - 1] = [over[i:j].any() for i, j in zip(stop[:-1] - 1, start[1:], strict=True)]
    if lost := len(start) - 1 - int(valid.sum()):
        notes.append(f"{lost} turns were left out: samples are missing in them.")
    if bad.any():
        notes.append(f"{bad.sum()} turns were left out: the gyroscope saturates in them. Turn more slowly.")
        turns = dataclasses.replace(turns, sigma=np.where(bad, np.inf, turns.sigma))
    if (kept := int(np.isfinite(turns.sigma).sum())) < 6:
        why = " ".join(notes[len(base.warnings) :]) or "There are too few poses."
        return dataclasses.replace(base, reason=f"{kept} turns are left, 6 are needed for a gyroscope. {why}")
    up = padded(vertical, rests.slots)
    bias, cross, drift = _fits.rest_start(rests, force, options.g_sensitivity, np.zeros(3))
    scale = _fits.scanned_scale(bias, up, turns) if raw else 1.0
    if options.latitude is not None:
        earth = EARTH_RATE * np.sin(options.latitude) * vertical / scale
        bias, cross, drift = _fits.rest_start(rests, force, options.g_sensitivity, earth)
    matrix = np.eye(3) / scale if raw else model.gyro.matrix
    gyro = eqx.tree_at(lambda t: (t.matrix, t.bias, t.g_sensitivity), model.gyro, (matrix, bias, cross))
    one = np.ones((len(start), 3))
    data = Weighted(rests.poses(one[:, 0], one), turns, np.asarray(options.gravity), options.latitude)
    found = _fits.joint_fit(Imu(accel, gyro, np.zeros(3) if drift else None, model.north), data, rests, options, needed)
    if held_out:
        base = dataclasses.replace(base, held_out=_fits.held_out(found, options))
    if drift:
        notes.append("The gyroscope's bias drifts during the record (F test, 1 %); a linear drift is part of the fit. Let it warm up.")
    return _result(base, found, rests, needed, options, notes, partial(_fits.explanation, bias, up, turns, scale))


def _result(
    base: ImuFit, joint: Joint, rests: Rests, needed: int, options: Options, notes: list[str], explain: Callable[[], str | None]
) -> ImuFit:
    """The result of a fit with or without a gyroscope, judged."""
    fit, found, slots, count = joint.fit, joint.found, rests.slots, len(rests.accel)
    blocks = np.concatenate([np.arange(slots), np.repeat(slots + np.arange(slots - 1), 2), np.repeat(np.arange(slots), 3), [-1, -1]])
    weight, gyro, drift = np.asarray(fit.weights), fit.model.gyro, np.zeros(3)
    turned, rest, pairs, own = np.zeros((0, 3)), np.zeros((0, 3)), np.ones((0, 2)), 0
    if gyro is not None and joint.data.turns is not None:
        valid = np.isfinite(joint.data.turns.sigma)
        turned, pairs = found.turned[valid], weight[slots : 3 * slots - 2].reshape(-1, 2)[valid]
        rest = found.rest[:count] @ np.linalg.inv(gyro.matrix).T
        own = _count(freed(Imu(None, gyro), options.convention, g_sensitivity=False)) - 3
        drift = drift if fit.model.drift is None else np.linalg.solve(gyro.matrix, fit.model.drift)
    made = described(fit, joint.data, options.convention)
    robust = framed(fit.model, options.convention, placed(fit.names, sandwich(fit, blocks[: len(weight)]), made.names))[1][0]
    model = jax.tree.map(np.asarray, made.model)
    result = dataclasses.replace(
        base, accel=model.accel, gyro=model.gyro, residual_norm=found.norm[:count], residual_turn=np.linalg.norm(turned, axis=1),
        residual_rest=rest, sigma=joint.sigma, drift=drift,
        down_weighted=(np.flatnonzero(weight[:count] < 0.5), np.flatnonzero(np.min(pairs, axis=1, initial=1) < 0.5)),
        cost=0.5 * np.array([np.sum(found.norm[:count] ** 2), np.sum(turned**2) if len(turned) else np.nan]),
    )  # fmt: skip
    still = 3 * (count - 1 - 3 * options.g_sensitivity) if len(turned) else 0
    by_field = {"accel": count - needed, "gyro": 2 * len(turned) - own, "gyro.bias": still, "gyro.g_sensitivity": still}
    freedom = np.array([by_field.get(name.split("[")[0], by_field[name.split(".")[0]]) for name in result.names], dtype=float)
    plain, robust = (np.asarray(placed(made.names, np.asarray(matrix), result.names)) for matrix in (made.covariance, robust))
    result = dataclasses.replace(result, covariance=plain, robust_covariance=robust, degrees_of_freedom=freedom)
    return finished(result, fit, options, notes, explain)


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
        checked_gravity(gravity), convention, method, bool(g_sensitivity), model != "diagonal", loss, _fits.coefficients(noise, "accel"),
        _fits.coefficients(noise, "gyro"), None if latitude is None else float(latitude),
    )  # fmt: skip
