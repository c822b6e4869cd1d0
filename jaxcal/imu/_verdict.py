"""Good, weak or refused, and why."""

import equinox as eqx
import numpy as np

from ..fitting import Fit, Outcome, identifiability
from ._observe import ILL, SINGULAR, Observability

_FEW_POSES, _FEW_TURNS = 12, 10
_TURN = np.deg2rad(5.0)
_UNKNOWN, _POOR = 0.1, 0.01
_ROTATION = np.deg2rad(0.03)


class Judgement(eqx.Module):
    """What to think of a fit."""

    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)


def relative_errors(values: np.ndarray, covariance: np.ndarray, first: int) -> float:
    """Largest standard error of the entries of a matrix, over its scale."""
    errors = np.sqrt(np.maximum(np.diag(covariance)[first : first + 9], 0)).reshape(3, 3)
    scale = np.abs(np.diag(values[first : first + 9].reshape(3, 3)))
    return float(np.max(errors / scale[:, None]))


def judge(
    fit: Fit, values: np.ndarray, covariance: np.ndarray, seen: Observability, poses: int, turns: int, angle: np.ndarray, low: tuple,
    sigma: np.ndarray, options, gyro: bool, notes: list[str],
) -> Judgement:  # fmt: skip
    """Verdict with the sentences that lead to it, the gravest first."""
    refused, weak = [], []
    force = relative_errors(values, covariance, 0)
    rate = relative_errors(values, covariance, 12) if gyro else 0.0
    rms = float(np.sqrt(np.mean(angle**2))) if len(angle) else 0.0
    if not bool(fit.usable) and fit.outcome != Outcome.unidentifiable:
        refused.append(f"The fit failed: {fit.message}")
    if rms > _TURN:
        refused.append(
            f"After a turn the gyroscope's vertical is {np.rad2deg(rms):.1f} degrees (rms) off the accelerometer's: wrong axes or unit."
        )
    if gyro and not refused and not rate <= _UNKNOWN:
        refused.append(
            "The turns do not determine the gyroscope: turn by 45 to 180 degrees about several horizontal axes. A rotation about "
            "the vertical tells nothing."
        )
    if fit.outcome == Outcome.unidentifiable and not refused and seen.condition <= SINGULAR:
        refused.append(identifiability(fit).sentence)
    elif not force <= _UNKNOWN:
        refused.append(seen.sentence)
    if poses < _FEW_POSES and options.misalignment:
        weak.append(f"There are {poses} poses, 18 to 24 are advised.")
    if seen.condition > ILL:
        weak.append(seen.sentence)
    if gyro and turns < _FEW_TURNS:
        weak.append(f"There are {turns} turns, 10 or more are advised.")
    if gyro and _POOR < rate <= _UNKNOWN:
        weak.append(f"The gyroscope's matrix is known to {100 * rate:.2g} % only; add turns of 45 to 180 degrees about other axes.")
    if _POOR < force <= _UNKNOWN:
        weak.append(f"The accelerometer's matrix is known to {100 * force:.2g} % only. {seen.sentence}")
    for kind, which, count in (("poses", low[0], poses), ("turns", low[1], turns)):
        if len(which) > max(2, 0.2 * count):
            weak.append(f"{len(which)} of {count} {kind} do not agree with the others: the sensor moved, or was bumped.")
    if sigma[0] > 0.02 * options.gravity:
        weak.append(f"The norms scatter by {sigma[0]:.2g} m/s^2: the sensor moved while it should rest, or is not linear.")
    if gyro and options.latitude is None and 0 < rms < _ROTATION:
        notes.append("The turns agree so well that the Earth's rate matters: give latitude=.")
    if refused or weak:
        return Judgement("refused" if refused else "weak", " ".join([*refused, *weak]), tuple(notes))
    text = f"Standard errors: accelerometer {_parts(force)}"
    text += f", gyroscope {_parts(rate)} in scale and misalignment." if gyro else " in scale and misalignment."
    return Judgement("good", text, tuple(notes))


def _parts(value: float) -> str:
    return f"{100 * value:.2g} %" if value >= 1e-4 else f"{1e6 * value:.2g} ppm"
