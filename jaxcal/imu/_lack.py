"""Lack of fit (host): named terms that the sensor model lacks, and their effect on the parameters."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Quantity
from .._arrays import padded
from .._special import student_quantile
from .._units import STANDARD_GRAVITY
from ..fitting._missing import LEAST, Missing, missing
from ._findings import FINDINGS
from ._fits import Joint
from ._model import LEVEL
from ._nonlinear import TERMS
from ._recording import Rests
from ._residuals import pieces
from ._result import parts_of

#: term -> how a sentence names it
_WORDS = {"quadratic": "a quadratic term", "cubic": "a cubic term", "asymmetry": "an asymmetry of sign", "drift": "a linear drift",
          "warm_up": "a drift of a warm-up", "curve": "a quadratic drift", "hysteresis": "a hysteresis",
          "creep": "a creep of 15 s"}  # fmt: skip
_IN_TIME = ("drift", "warm_up", "curve")
_KINDS = 4  # kinds of residuals in which terms are looked for: together they have one false alarm in a thousand recordings
#: probability of a term of time, of one of the past, and of one of size before the residuals are seen, relative to that of none: with 0.15
#: for the past, 40 plain recordings have intervals over 1.10 of the bound. Of sensors that remember, nine of ten follow late
_PRIOR, _LATE = 0.1, 0.9
_MOST = float(student_quantile(np.inf, 0.95))  # standard errors: a memory is larger in one case of twenty
_NUDGE = 1e-3  # step of the finite difference, relative to the full term


class Lack(eqx.Module):
    """What the model lacks, or may lack.

    spread : (p, p) by how much the squares of the errors of the fit's parameters grow. finding : what to say about it, if anything.
    term : name by which the term can be added, or None.
    """

    spread: np.ndarray
    finding: Finding | None = eqx.field(static=True, default=None)
    term: str | None = eqx.field(static=True, default=None)


def lacks(joint: Joint, rests: Rests, middle: float, error: np.ndarray) -> list[Lack]:
    """Find missing terms: the best one for the magnitudes, for the turns, and for the rates at rest, if it is significant.

    Residuals of one kind, in units of their standard deviation, are regressed on the parameters that determine them and on the effects
    of three coefficients, one for each axis. The F test compares with the remaining residuals, so their size need not be known. `middle`
    is the time of the middle of the record, s; `error` are the standard errors of the fit's parameters without any term.
    """
    fit, slots, count = joint.fit, len(joint.found.norm), len(rests.accel)
    names, root = np.array(fit.names), np.sqrt(np.asarray(fit.weights))
    rows, slope = root * np.asarray(fit.residuals), root[:, None] * np.asarray(fit.jacobian)
    turns, found, valid = joint.data.turns, [], np.any(slope != 0, axis=1)

    def judged(sensor: str, what: str, own: np.ndarray, part: slice, terms: dict[str, np.ndarray], at: float) -> None:
        """Test the terms (n, q) on some residuals, together with the parameters `own` that these residuals determine.

        The best one is found if it is significant. Otherwise each counts with its probability.
        """
        # the noise of the sensors alone is known: what exceeds it is a term, or an error of each pose and turn
        least = np.sqrt(np.mean(joint.least[joint.kinds[part]][valid[part]] ** 2))
        tried = missing(rows[part], slope[part] * own, terms, least=least)

        def facts_of(coefficient: float, shift: np.ndarray) -> dict[str, Any]:
            size = Quantity(coefficient * (at if what == "turns" else 1.0), sensor)
            moved = np.abs(shift)[np.char.startswith(names, f"{sensor}.matrix")].max(initial=0.0)
            per_unit = np.abs(np.diag(np.asarray(getattr(fit.model, sensor).matrix))).min()
            return {"what": what, "size": size, "cost": size.value, "matrix": parts_of(moved / per_unit)}

        for best in tried[:1]:
            spread, hint = np.outer(best.shift, best.shift), not best.shown or _KINDS * best.level > LEVEL
            if hint:
                groups = [_group(one.name) for one in tried]
                odds = np.array([_odds(one) / groups.count(group) for one, group in zip(tried, groups, strict=True)])
                shifts = np.array([one.shift for one in tried])
                spread = np.einsum("k,ki,kj->ij", odds / (1 + odds.sum()), shifts, shifts)
                # a creep moves the matrix by several errors before this test shows it
                best = max((one for one in tried if _group(one.name) == "past"), key=_odds, default=best)
            kind, _, where = best.name.partition("@")
            facts = facts_of(float(np.abs(best.coefficient).max()), best.shift)
            term = f"{sensor}.{kind}" if f"{sensor}.{kind}" in TERMS and not (turns is None and kind in (*_IN_TIME, "creep")) else None
            if hint:
                likely = _odds(best) / _PRIOR if _group(best.name) == "past" else 0.0
                said = FINDINGS.over("memory_possible", likely, sensor, term=_WORDS.get(kind), **facts)
                found.append(Lack(spread, said[0] if said else None))
                # with all that may remain, plain intervals would be 1.7 to 2.5 times as wide: it is said, and adds nothing
                for memory in tried if not said else ():
                    if _group(memory.name) == "past" and np.isfinite(memory.covariance).all():
                        most = float(memory.coefficient[0] + _MOST * np.sqrt(memory.covariance[0, 0]))
                        shift = memory.change[:, 0] * max(most, 0.0)
                        ratio = float(np.abs(shift / error)[own].max())
                        facts = facts_of(most, shift) | {"term": _WORDS[memory.name], "ratio": ratio}
                        found.extend(Lack(np.zeros_like(spread), one) for one in FINDINGS.over("memory_open", ratio, sensor, **facts))
                continue
            if where:
                time = float(middle + rests.time[int(where)] - rests.duration[int(where)] / 2)
                made = FINDINGS("lack_step", sensor, pose=int(where), time=Quantity(time, "time"), **facts)
            elif kind in _IN_TIME:
                made = FINDINGS("lack_drift", sensor, term=_WORDS[kind], **facts)
            else:
                code = "lack_memory" if term is None else f"lack_{sensor}"
                made = FINDINGS(code, sensor, term=_WORDS[kind], at=Quantity(at, sensor), **facts)
            found.append(Lack(spread, made, term))

    # the magnitude is gravity, not the measured one, because the error of the measured one is the residual itself
    force = joint.found.vertical * float(joint.data.gravity)
    part, own = slice(0, slots), np.char.startswith(names, "accel")
    shapes = _shapes(force, rests, np.abs(np.diag(np.asarray(fit.model.accel.matrix))))
    across = -joint.found.vertical / np.asarray(joint.data.poses.sigma)[:, None]  # effect on the magnitudes of the force along each axis
    terms = {name: across * shape for name, shape in shapes.items()}
    if turns is not None:
        # an error of a vertical also appears in the turns before and after it: this shows a term that the magnitudes do not
        part, own = slice(0, 3 * slots - 2), own | np.char.startswith(names, "gyro.matrix")
        terms = {name: np.concatenate([x, _between(joint, shapes[name])]) for name, x in terms.items()}
    terms = {name: root[part, None] * x for name, x in terms.items()}
    # one size for all axes, which has more power
    terms |= {name: terms[name].sum(axis=1, keepdims=True) for name in rests.past}
    judged("accel", "poses" if turns is None else "poses and turns", own, part, terms, STANDARD_GRAVITY)
    if turns is None:
        return found + _scattered(joint, count - int(np.sum(own)))
    scale = np.abs(np.diag(np.asarray(fit.model.gyro.matrix)))
    fast = float(np.quantile(np.abs(turns.gyro - np.asarray(fit.model.gyro.bias)) / scale, 0.999))
    part = slice(slots, 3 * slots - 2)
    terms = {name: root[part, None] * x for name, x in _turn_terms(joint, fast).items()}
    judged("gyro", "turns", np.char.startswith(names, "gyro.matrix"), part, terms, fast)
    part, weight = slice(3 * slots - 2, 6 * slots - 2), 1 / np.asarray(joint.data.poses.gyro_sigma)
    terms = {
        name: root[part, None] * (weight[:, :, None] * (np.eye(3) * shape[:, None, :])).reshape(-1, 3) * scale
        for name, shape in shapes.items() if name == "curve" or "@" in name
    }  # fmt: skip
    own = np.char.startswith(names, "gyro.bias") | np.char.startswith(names, "gyro.g_sens") | np.char.startswith(names, "drift")
    judged("gyro", "rates at rest", own, part, terms, fast)
    return found


def _group(name: str) -> str:
    """What a term depends on: time, the past, or the size of the force or rate."""
    return "time" if name in _IN_TIME or "@" in name else "past" if name in ("creep", "hysteresis") else "size"


def _odds(term: Missing) -> float:
    """Probability of a term relative to that of none. What remembers the past seldom overshoots, so a negative size counts less."""
    sure = 0.5
    if _group(term.name) == "past" and np.isfinite(error := np.sqrt(term.covariance[0, 0])):
        sure = float(scipy.special.ndtr(term.coefficient[0] / error))
    return _PRIOR * term.odds * 2 * (_LATE * sure + (1 - _LATE) * (1 - sure))


def _scattered(joint: Joint, freedom: int) -> list[Lack]:
    """Report magnitudes that scatter more than the noise within the rests explains, if there are too few to test for terms."""
    square = float(np.sum(np.asarray(joint.fit.residuals) ** 2)) / joint.least[0] ** 2
    if not 1 <= freedom < LEAST + 3 or scipy.special.chdtrc(freedom, square) > LEVEL:
        return []
    ratio = np.sqrt(square / freedom)
    return [Lack(np.zeros((len(joint.fit.names),) * 2), one) for one in FINDINGS.over("scatter_unexplained", ratio, "accel", ratio=ratio)]


def _shapes(force: np.ndarray, rests: Rests, scale: np.ndarray) -> dict[str, np.ndarray]:
    """Change of the force along each axis (slots, 3) for a unit of each term: its size at 1 g, or over the recording."""
    count, slots = len(rests.accel), len(force)
    time, size = (rests.time - rests.time.min()) / max(float(np.ptp(rests.time)), 1e-9), np.abs(force) / STANDARD_GRAVITY
    found = {"drift": time, "warm_up": np.exp(-4 * time), "curve": time**2}
    found |= {f"step@{k}": np.arange(count) >= k for k in range(LEAST, count - LEAST + 1)}
    found = {name: padded(x[:, None] * np.ones((1, 3)), slots) for name, x in found.items()}
    found |= {"quadratic": size**2, "cubic": force * size**2 / STANDARD_GRAVITY, "asymmetry": size}
    units = {"creep": scale * STANDARD_GRAVITY, "hysteresis": 1.0}
    return found | {name: padded(rests.past[name] / unit, slots) for name, unit in units.items()}


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
