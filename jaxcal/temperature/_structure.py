r"""Choice of a curve's structure by the restricted likelihood: lag, play, a term in dT/dt, and jumps.

The search for a jump computes the score of a logistic step for many centres and widths, under the curve without the jump, whose series
absorbs everything smooth. Without a jump each score is normal, and the probability that the largest score exceeds u is at most

.. math:: 2\,\Phi(-u) + \frac{1}{\pi} \sum_i \arccos(\rho_{i,i+1})\, e^{-u^2/2}

for each chain of neighbouring steps with correlations rho (R. B. Davies, Biometrika 64 (1977) 247). A jump is accepted if this probability
for its likelihood ratio is below `CHANCE`.
"""

import dataclasses

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ._design import COARSE, Design, Form, Jump, Part, column_of
from ._restricted import Restricted

#: probability by chance below which a jump is accepted; gain in -2 log likelihood required of lag, play or the term in dT/dt (by chance in
#: one of 500 records), and of a jump beside its test
CHANCE, PRICE, PRICE_OF_JUMP = 0.003, 12.0, 20.0
#: degC, degC, share of the range: limits of a jump's width, because wider steps belong to the curve; the second is also the least distance
#: from the ends. Two jumps nearer than the last number of widths are one
_NARROW, _WIDE, _PART, _APART = 0.01, 0.5, 1 / 40, 3.0
_ROUNDS, _STEPS, _HALVINGS, _MOST = 4, 12, 6, 4  # the last one is the largest number of jumps
#: starts of the searches: s, degC, s, degC
_STARTS = {"lag": (5.0, 15.0, 40.0, 100.0, 250.0), "play": (0.1, 0.3, 0.7, 1.2), "slow": (30.0, 200.0, 1000.0), "width": (0.04, 0.12, 0.36)}


@dataclasses.dataclass(frozen=True)
class Found:
    """A form with its hyperparameters, -log posterior density, and the false-alarm probability of every jump."""

    form: Form
    phi: AnyArray
    value: float
    chances: tuple[float, ...] = ()


def settled(design: Design, form: Form, phi: AnyArray | None = None, *, near: bool = False) -> Found:
    """Fit the form's nonlinear parameters and the hyperparameters in turn until convergence; `near` as in `Restricted.fitted`."""
    restricted = design.restricted(form)
    phi, value = restricted.fitted(phi, near=near)
    for _ in range(_ROUNDS if len(form.vector) else 0):
        form = _refined(design, form, phi)
        before = value
        restricted = design.restricted(form)
        phi, value = restricted.fitted(phi, near=True)
        if abs(before - value) < 0.01:
            break
    return Found(form, phi, value)


def _limits(design: Design, form: Form) -> tuple[AnyArray, AnyArray]:
    wide = min(_WIDE, _PART * (design.high - design.low))
    low = [0.0] * len(form.free) + [design.low + _WIDE / 2, np.log(_NARROW)] * len(form.jumps)
    high = [{"play": (design.high - design.low) / 4}.get(name, 3600.0) for name in form.free]
    return np.array(low), np.array([*high, *[design.high - _WIDE / 2, np.log(wide)] * len(form.jumps)])


def _refined(design: Design, form: Form, phi: AnyArray) -> Form:
    """Gauss-Newton steps for the nonlinear parameters, with the linear coefficients eliminated."""
    low, high = _limits(design, form)
    at = design.restricted(form).solved(phi)
    for _ in range(_STEPS):
        vector = form.vector
        joint = design.restricted(form, slopes=design.slopes(form, at.beta)).solved(phi)
        longest = np.concatenate([np.maximum(0.5 * vector[: len(form.free)], 0.05), *([2 * np.exp(j.log_width), 0.7] for j in form.jumps)])
        step = np.clip(joint.beta[len(joint.beta) - len(vector) :], -longest, longest)
        error = np.sqrt(np.diag(joint.covariance))[len(joint.beta) - len(vector) :]
        for halving in range(_HALVINGS):
            tried = form.at(np.clip(vector + step * 0.5**halving, low, high))
            new = design.restricted(tried).solved(phi)
            if new.misfit < at.misfit:
                break
        else:
            return form
        gain, form, at = at.misfit - new.misfit, tried, new
        if gain < 1e-3 or np.all(np.abs(form.vector - vector) < 0.02 * error):
            return form
    return form


def with_jumps(design: Design, found: Found) -> Found:
    """Add jumps one by one, each where it improves the fit most, as long as they are significant."""
    while len(found.form.jumps) < _MOST:
        score, jump, chains = _candidate(design, found)
        if jump is None or chance(score, chains) > CHANCE:
            return found
        tried = settled(design, dataclasses.replace(found.form, jumps=(*found.form.jumps, jump)), found.phi)
        p = chance(np.sqrt(max(2 * (found.value - tried.value), 0.0)), chains)
        if p > CHANCE:
            return found
        found = dataclasses.replace(tried, chances=(*found.chances, min(p, 1.0)))
    return found


def chance(score: float, chains: list[AnyArray]) -> float:
    """Davies' bound of the probability that the largest score in several chains of normal scores exceeds `score`."""
    return sum(2 * scipy.special.ndtr(-score) + np.sum(np.arccos(np.clip(one, -1, 1))) / np.pi * np.exp(-(score**2) / 2) for one in chains)


def _candidate(design: Design, found: Found) -> tuple[float, Jump | None, list[AnyArray]]:
    """Largest score, its step, and the correlations of neighbouring scores in each chain."""
    restricted: Restricted = design.restricted(found.form)
    at = restricted.solved(found.phi)
    weight = 1 / np.sqrt(at.density)[design.bands.index]
    columns = design.columns(found.form)
    rest = (design.y - columns @ at.beta) * weight
    columns = columns * weight[:, None]
    t = design.filtered(found.form.lag, found.form.play)
    best: tuple[float, Jump | None] = 0.0, None
    chains: list[AnyArray] = []
    for width in _STARTS["width"]:
        centres = np.arange(float(t.min()) + _WIDE, float(t.max()) - _WIDE, width)
        for jump in found.form.jumps:
            reach = _APART * (np.exp(jump.log_width) + width)
            centres = centres[np.abs(centres - jump.centre) > reach]
        if not len(centres):
            continue
        steps = np.stack([column_of(Jump(c, np.log(width)), t) for c in centres], axis=1)
        steps = design.bands.transform(steps) * weight[:, None]
        inside = columns.T @ steps
        taken = at.covariance @ inside
        variance = np.sum(steps**2, axis=0) - np.sum(inside * taken, axis=0)
        neighbours = np.sum(steps[:, 1:] * steps[:, :-1], axis=0) - np.sum(inside[:, 1:] * taken[:, :-1], axis=0)
        # a step that the series reproduces to rounding cannot be detected
        seen = variance > 1e-9 * np.sum(steps**2, axis=0)
        variance = np.where(seen, variance, np.inf)
        score = np.abs(steps.T @ rest) / np.sqrt(variance)
        chains.append(neighbours / np.sqrt(np.where(seen, variance, 1)[1:] * np.where(seen, variance, 1)[:-1]))
        i = int(np.argmax(score))
        if score[i] > best[0]:
            best = float(score[i]), Jump(float(centres[i]), float(np.log(width)))
    return best[0], best[1], chains


@dataclasses.dataclass(frozen=True)
class Tried:
    """A structure that was compared: its name, its fit, and its penalised -2 log posterior density."""

    name: str
    found: Found
    score: float


def structures(design: Design, given: Form, searched: tuple[str, ...]) -> list[Tried]:
    """Fit the given form alone and with one or two of `searched` ("lag", "play", "rate"), on means over blocks to save time."""
    coarse = _coarser(design)
    plain = with_jumps(coarse, settled(coarse, given))
    tried = [_tried("none", plain)]
    for name in searched:
        tried.append(_one_more(coarse, tried[0].found, given, name))
    if "rate" in searched and tried[-1].score < tried[0].score - PRICE / 2:
        tried.append(_one_more(coarse, tried[-1].found, tried[-1].found.form, "slow", "rate behind a lag"))
    for first, second in (("lag", "play"), ("lag", "rate")):
        best = next((one for one in tried if one.name == first), None)
        if best is not None and second in searched and min(one.score for one in tried[1:]) < tried[0].score:
            tried.append(_one_more(coarse, best.found, best.found.form, second, f"{first} and {second}"))
    return tried


def _tried(name: str, found: Found) -> Tried:
    form = found.form
    return Tried(name, found, 2 * found.value + PRICE * (len(form.free) + form.rate) + PRICE_OF_JUMP * len(form.jumps))


def _one_more(design: Design, begin: Found, form: Form, name: str, label: str = "") -> Tried:
    """Add one term to a structure, from its best start, and search for jumps again."""
    form = dataclasses.replace(form, jumps=())
    if name == "rate":
        best = dataclasses.replace(form, rate=True)
    else:
        tried = [dataclasses.replace(form, **{name: x}, free=(*form.free, name)) for x in _STARTS[name]]
        best = min(tried, key=lambda one: design.restricted(one).posterior(begin.phi)[0])
    found = settled(design, best, begin.phi, near=True)
    return _tried(label or name, with_jumps(design, found) if begin.form.jumps else found)


def _coarser(design: Design) -> Design:
    size = max(len(design.t) // COARSE, 1)
    if size == 1:
        return design
    means = (Part(*(x[: len(x) // size * size].reshape(-1, size).mean(axis=1) for x in part)) for part in design.parts)
    return Design(list(means), design.dt * size)
