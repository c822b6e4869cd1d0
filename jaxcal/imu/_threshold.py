"""Which multiple of the initial variance is the limit of stillness: judged by what it leaves of the calibration."""

import dataclasses

import equinox as eqx
import numpy as np

from .._types import Any
from ._estimate import solved
from ._joint import Options
from ._model import Imu
from ._poses import padded, power_of_two
from ._recording import Recording
from ._residuals import Poses, Weighted
from ._scales import leverage
from ._start import nominal_start
from ._static import StillIntervals, runs
from ._triad import Triad


class Choice(eqx.Module):
    """still : the chosen intervals. table : (multiple, intervals, total cost, leave-one-out rms). fits : multiple -> fit of the norms."""

    still: StillIntervals
    table: np.ndarray
    fits: dict[float, Any]
    warnings: tuple[str, ...] = eqx.field(static=True)


def norms(mean: np.ndarray, slots: int, gravity: float, sigma: float = 1.0) -> Weighted:
    """Readings at rest, padded, as a fit of the accelerometer alone takes them."""
    return Weighted(Poses(padded(mean, slots), padded(np.full(len(mean), sigma), slots, np.inf)), None, gravity)


def chosen(
    record: Recording, still: StillIntervals, variance: np.ndarray, model: Triad, needed: int, options: Options, threshold: Any,
    window: Any, least: Any, raw: bool, all_samples: bool,
) -> Choice | None:  # fmt: skip
    """The intervals to use, or None where no multiple leaves enough poses.

    With `all_samples`, imu_tk's rule: the first samples of every interval, one residual each, and the smallest total cost. Else the
    most intervals among the multiples whose leave-one-out rms is within a standard error of the least: a total cost favours fewer poses.
    """
    half = max(round(float(window) * record.rate / 2), 1)
    shortest = max(round(float(least) * record.rate), 2)
    multiples = list(still.counts) if threshold is None else [float(threshold)]
    found = {k: runs(variance, k * still.initial_variance, half, shortest) for k in multiples}
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
        start_at = nominal_start(model, reading.reshape(count, each, 3).mean(axis=1), options.gravity) if raw else model
        fit = solved(Imu(start_at), norms(reading, slots * each, options.gravity), options.convention, options.misalignment, rtol=None)
        # residual of every pose under the fit without it, to first order
        without = np.asarray(fit.residuals) / (1 - np.minimum(leverage(fit), 1 - 1e-6))
        rest = without[: count * each].reshape(count, each).mean(axis=1)
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
