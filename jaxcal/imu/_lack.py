"""Lack of fit (host): named terms that the sensor model lacks, and their effect on the parameters."""

import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Quantity
from .._units import STANDARD_GRAVITY
from ..fitting._missing import LEAST, missing
from ._findings import FINDINGS
from ._fits import Joint
from ._model import LEVEL
from ._recording import Rests
from ._residuals import pieces

_ENOUGH = 8  # least degrees of freedom of the magnitudes, to judge a term of the accelerometer without the turns
#: term -> how a sentence names it
_WORDS = {"quadratic": "a quadratic term", "cubic": "a cubic term", "asymmetry": "an asymmetry of sign", "drift": "a linear drift",
          "warm_up": "a drift of a warm-up"}  # fmt: skip
_NUDGE = 1e-3  # step of the finite difference, relative to the full term


class Lack(eqx.Module):
    """A term that the model lacks.

    shift : (p,) change of the fit's parameters that the term would cause. finding : what to say about it.
    term : name by which the term can be added, or None.
    """

    shift: np.ndarray
    finding: Finding = eqx.field(static=True)
    term: str | None = eqx.field(static=True, default=None)


def lacks(joint: Joint, rests: Rests) -> list[Lack]:
    """Find missing terms: the best one for the magnitudes, and for the turns, if it is significant.

    Residuals of one kind, in units of their standard deviation, are regressed on the parameters that determine them and on the effects
    of three coefficients, one for each axis. The F test compares with the remaining residuals, so their size need not be known.
    """
    fit, slots = joint.fit, len(joint.found.norm)
    names, root = np.array(fit.names), np.sqrt(np.asarray(fit.weights))
    rows, slope = root * np.asarray(fit.residuals), root[:, None] * np.asarray(fit.jacobian)
    found = []

    def judged(part: slice, own: np.ndarray, terms: dict[str, np.ndarray], sensor: str, said: Callable[[str, np.ndarray], Finding]) -> None:
        """Test the terms (n, q) on one kind of residual, together with the parameters `own` that these residuals determine."""
        for best in missing(rows[part], slope[part] * own, {name: root[part, None] * x for name, x in terms.items()})[:1]:
            if best.shown:
                drift = joint.data.turns is None and best.name in ("drift", "warm_up")
                found.append(Lack(best.shift, said(best.name, np.abs(best.coefficient)), None if drift else f"{sensor}.{best.name}"))

    # the magnitude is gravity, not the measured one, because the error of the measured one is the residual itself
    force, at_1g = joint.found.vertical * float(joint.data.gravity), Quantity(STANDARD_GRAVITY, "accel")

    def of_norms(name: str, coefficient: np.ndarray) -> Finding:
        code, size = "lack_drift" if name in ("drift", "warm_up") else "lack_accel", Quantity(float(coefficient.max()), "accel")
        return FINDINGS(code, "accel", cost=size.value, what=what, term=_WORDS[name], size=size, at=at_1g)

    norms, own = slice(0, slots), np.char.startswith(names, "accel")
    left = int(np.sum(np.any(slope[norms] != 0, axis=1)) - np.linalg.matrix_rank(slope[norms][:, own])) - 3
    shapes = _shapes(force, rests, max(float(np.ptp(rests.time)), 1e-9))
    across = -joint.found.vertical / np.asarray(joint.data.poses.sigma)[:, None]  # effect on the magnitudes of the force along each axis
    terms, what = {name: across * shape for name, shape in shapes.items()}, "poses"
    if left < _ENOUGH and joint.data.turns is not None:
        # few poses: use the turns as well, because an error of a vertical also appears in the turns before and after it
        norms, own = slice(0, 3 * slots - 2), own | np.char.startswith(names, "gyro.matrix")
        terms = {name: np.concatenate([x, _between(joint, shapes[name])]) for name, x in terms.items()}
        what = "poses and turns"
    judged(norms, own, terms, "accel", of_norms)
    if joint.data.turns is None:
        return found or _scattered(joint, rests, len(rests.accel) - int(np.sum(own)), left)
    scale = np.abs(np.diag(np.asarray(fit.model.gyro.matrix)))
    fast = float(np.quantile(np.abs(joint.data.turns.gyro - np.asarray(fit.model.gyro.bias)) / scale, 0.999))

    def of_turns(name: str, coefficient: np.ndarray) -> Finding:
        size = fast * float(coefficient.max())
        return FINDINGS("lack_gyro", "gyro", cost=size, term=_WORDS[name], size=Quantity(size, "gyro"), at=Quantity(fast, "gyro"))

    judged(slice(slots, 3 * slots - 2), np.char.startswith(names, "gyro.matrix"), _turn_terms(joint, fast), "gyro", of_turns)
    return found


def _scattered(joint: Joint, rests: Rests, freedom: int, left: int) -> list[Lack]:
    """Report magnitudes that scatter more than the noise within the rests explains, if there are too few to test for terms."""
    if freedom < 1 or left >= LEAST:
        return []
    count = len(rests.accel)
    known = rests.norm_variance(joint.found.vertical[:count] @ np.linalg.inv(np.asarray(joint.fit.model.accel.matrix)))
    square = float(np.sum(joint.found.norm[:count] ** 2 / known))
    ratio = np.sqrt(square / freedom)
    told = FINDINGS.over("scatter_unexplained", ratio, "accel", ratio=ratio) if scipy.special.chdtrc(freedom, square) < LEVEL else []
    return [Lack(np.zeros(len(joint.fit.names)), one) for one in told]


def _shapes(force: np.ndarray, rests: Rests, duration: float) -> dict[str, np.ndarray]:
    """Change of the force along each axis (k, 3) for a unit coefficient of each term (its value at 1 g, or over the recording)."""
    count, slots, g = len(rests.accel), len(force), STANDARD_GRAVITY
    time = np.zeros((slots, 1))
    time[:count, 0] = (rests.time - rests.time.min()) / duration
    size, one = np.abs(force) / g, np.ones((1, 3))
    return {
        "quadratic": size**2, "cubic": force / g * size**2, "asymmetry": size, "drift": time * one, "warm_up": np.exp(-4 * time) * one,
    }  # fmt: skip


def _between(joint: Joint, shape: np.ndarray) -> np.ndarray:
    """Whitened effect on the turns (2s, 3) of a change of the force, which tilts the verticals before and after each turn."""
    data, up = joint.data, joint.found.vertical
    tilt = (np.eye(3)[None] - up[:, :, None] * up[:, None, :]) * shape[:, None, :] / float(data.gravity)  # (k, component, axis)
    moved = np.einsum("sji,sjc->sic", joint.found.rotation, tilt[:-1]) - tilt[1:]
    return np.asarray(data.whiten) @ np.einsum("sij,sic->sjc", data.tangent, moved).reshape(-1, 3)


def _turn_terms(joint: Joint, fast: float) -> dict[str, np.ndarray]:
    """Whitened effect on the turns (2s, 3) of each term of the gyroscope; coefficients are relative to the rate at the rate `fast`."""
    model, data = joint.fit.model, joint.data
    turns: Any = data.turns
    gyro = jax.tree.map(np.asarray, model.gyro)
    scale = np.diag(gyro.matrix)
    rate = (turns.gyro - gyro.bias) / scale / fast
    slots = len(turns.sigma) + 1
    terms = {}
    for name, part in (("cubic", rate**3), ("asymmetry", np.abs(rate)), ("quadratic", rate**2)):
        columns = []
        for axis in range(3):
            nudged = turns.gyro.copy()
            nudged[..., axis] += _NUDGE * fast * scale[axis] * part[..., axis]
            moved = pieces(model, dataclasses.replace(data, turns=dataclasses.replace(turns, gyro=nudged))).turned - joint.found.turned
            across = np.einsum("sij,si->sj", data.tangent, moved).reshape(-1) / _NUDGE
            columns.append(np.asarray(data.whiten) @ across)
        terms[name] = np.stack(columns, axis=1).reshape(2 * slots - 2, 3)
    return terms
