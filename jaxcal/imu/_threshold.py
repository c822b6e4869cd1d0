"""Which multiple of the initial variance is the limit of stillness: judged by what it leaves of the calibration."""

import dataclasses

import equinox as eqx
import numpy as np

from .._types import Any
from ._estimate import Options, fit_norms, padded, weights
from ._norms import nominal_start
from ._recording import Recording
from ._static import StillIntervals, runs
from ._turns import power_of_two


class Choice(eqx.Module):
    """still : the chosen intervals. table : (multiple, intervals, total cost, leave-one-out rms). fits : multiple -> fit of the norms."""

    still: StillIntervals
    table: np.ndarray
    fits: dict[float, Any]
    warnings: tuple[str, ...] = eqx.field(static=True)


def leave_one_out(fit: Any, count: int) -> np.ndarray:
    """Residual of every pose under the fit without it, to first order: r / (1 - leverage)."""
    jacobian = np.asarray(fit.jacobian)
    size = np.linalg.norm(jacobian, axis=0)
    q = np.linalg.qr(jacobian / np.where(size > 0, size, 1))[0]
    leverage = np.minimum(np.sum(q**2, axis=1), 1 - 1e-6)
    return (np.asarray(fit.residuals) / (1 - leverage))[:count]


def chosen(
    record: Recording, still: StillIntervals, variance: np.ndarray, options: Options, threshold: Any, window: Any, least: Any, raw: bool,
    all_samples: bool,
) -> Choice | None:  # fmt: skip
    """The intervals to use, or None where no multiple leaves enough poses.

    With `all_samples`, imu_tk's rule: the first samples of every interval, one residual each, and the smallest total cost. Else the
    most intervals among the multiples whose leave-one-out rms is within a standard error of the least: a total cost favours fewer poses.
    """
    half = max(round(float(window) * record.rate / 2), 1)
    shortest = max(round(float(least) * record.rate), 2)
    multiples = list(still.counts) if threshold is None else [float(threshold)]
    found = {k: runs(variance, k * still.initial_variance, half, shortest) for k in multiples}
    needed = 6 if options.diagonal else 9
    found = {k: ends for k, ends in found.items() if len(ends[0]) >= needed}
    if not found:
        return None
    slots = power_of_two(max(len(start) for start, _ in found.values()) + 1, 32)
    fits, table = {}, []
    for k, (start, stop) in found.items():
        count = len(start)
        if all_samples:
            reading = np.concatenate([record.accel[i : i + shortest] for i in start])
        else:
            reading = np.array([record.accel[i:j].mean(axis=0) for i, j in zip(start, stop, strict=True)])
        each = len(reading) // count
        begin = nominal_start(reading.reshape(count, each, 3).mean(axis=1), options.gravity, raw)
        fit = fit_norms(padded(reading, slots * each), weights(count * each, slots * each), begin, options.gravity, options.diagonal)
        rest = leave_one_out(fit, count * each).reshape(count, each).mean(axis=1)
        fits[k] = fit
        table.append((k, count, float(fit.cost), float(np.sqrt(np.mean(rest**2))), float(np.std(rest**2) / np.sqrt(count))))
    rows = np.array(table)
    by_cost = int(np.argmin(rows[:, 2]))
    limit = rows[:, 3] ** 2 <= np.min(rows[:, 3]) ** 2 + rows[np.argmin(rows[:, 3]), 4]
    best = by_cost if all_samples else int(np.argmax(np.where(limit, rows[:, 1], 0)))
    k = rows[best, 0]
    start, stop = found[float(k)]
    warnings = list(still.warnings)
    if rows[by_cost, 3] ** 2 > np.min(rows[:, 3]) ** 2 + rows[np.argmin(rows[:, 3]), 4]:
        warnings.append(
            f"The smallest total cost is at {rows[by_cost, 0]:g} times the initial variance, where poses left out fit worse than at "
            f"{rows[np.argmin(rows[:, 3]), 0]:g} times: a total cost favours fewer intervals."
        )
    kept = dataclasses.replace(still, start=start, stop=stop, multiple=float(k), threshold=float(k) * still.initial_variance)
    return Choice(kept, rows[:, :4], fits, tuple(warnings))
