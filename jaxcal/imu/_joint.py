"""The joint fit of a recording (host): it chooses one of several sets of rests, fits it, and makes the result."""

import dataclasses
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Quantity, wrong_ranges
from .._arrays import padded
from .._special import student_quantile
from ..evidence._rests import Ends, Multiples
from ..fitting import Estimate, Fit, covariance
from ..fitting._missing import LEAST
from ..fitting._result import leverage
from . import _fits, _recording
from ._estimate import described, framed, placed, solved
from ._findings import FINDINGS
from ._fits import Joint, Options
from ._lack import lacks
from ._model import EARTH_RATE, FITTED_LEVEL, Imu, Triad
from ._nonlinear import Nonlinear
from ._observability import ONE_ATTITUDE, Observability, observability
from ._prior import known_of
from ._recording import Recording, Rests
from ._residuals import Turns, Weighted, pieces
from ._result import ImuFit, judged, quantities

_SURE = 0.9  # share of the noise inside the rests that counts for certain; with one, the errors of plain recordings grow by 5 %
_FAR_OFF = 2 * FINDINGS["turns_disagree"].limits[0] ** 2  # mean square of a turn's residual from which the fit starts at another scale


def count_of(free: Any) -> int:
    """Number of free parameters."""
    return int(sum(np.sum(leaf) for leaf in jax.tree.leaves(free)))


class Begun(eqx.Module):
    """Data and start of the fit of one set of rests; `turns` is None without a gyroscope."""

    rests: Rests
    fit: Fit
    vertical: np.ndarray
    start: Imu
    turns: Turns | None
    scale: float
    seen: Observability
    notes: tuple[Finding, ...] = eqx.field(static=True)


class Refusal(eqx.Module):
    """Why a set of rests cannot be fitted."""

    findings: tuple[Finding, ...] = eqx.field(static=True)
    seen: Observability | None = None


class Job(eqx.Module):
    """A recording, the model to fit, the number of poses that the model needs, and the options."""

    record: Recording
    model: Imu
    needed: int
    options: Options
    raw: bool

    def best(
        self, count: np.ndarray, error: np.ndarray, usable: dict[Multiples, Ends], fits: dict[Multiples, Fit]
    ) -> tuple[Multiples, Any, Joint | None]:
        """Choose a set of rests; return it, and the start and first fit of the set.

        The criterion is proportional to the variance of the parameters: leave-one-out mean square over number, of the poses (`error` and
        `count` of each set) and, with a gyroscope, of the turns. Each comparison of turns needs a joint fit, so for each bound on the
        gyroscope only the best bound on the accelerometer is tried. The same criterion decides whether turns connect mean attitudes,
        which avoids the effect of hand motion, or the ends of the rests, which avoids integrating the gyroscope's noise over the rests.
        """
        pairs, found = list(usable), []
        score, near, refused = error / count, None, {}

        def tried(i: int, whole: bool) -> tuple[float, int, Begun, Joint] | None:
            begun = self.begun(usable[pairs[i]], fits[pairs[i]], whole, near)
            if isinstance(begun, Refusal) or begun.turns is None:
                refused[i] = begun
                return None
            joint = self.joint(begun, near is not None, 1 if near is not None else 2)
            variance, number = _fits.left_out(joint)
            return score[i] * variance / number, i, begun, joint

        # sets with hardly more poses than parameters are left out: their prediction errors look too small
        bounds, enough = np.array(pairs)[:, 1], count >= min(self.needed + LEAST, count.max())
        for bound in np.unique(bounds[enough])[::-1]:
            here = np.flatnonzero((bounds == bound) & enough)
            if (one := tried(int(here[np.argmin(score[here])]), True)) is not None:
                found.append(one)
                near = (one[3].fit.model, one[2].scale) if bool(one[3].fit.usable) and near is None else near
        if not found:  # no gyroscope, or every set was refused: report the set with the best magnitudes
            i = min(refused, key=lambda i: score[i])
            return pairs[i], refused[i], None
        best = min(found, key=lambda entry: entry[0])
        if (other := tried(best[1], False)) is not None and other[0] < best[0]:
            best = other
        return pairs[best[1]], best[2], best[3]

    def begun(self, ends: Ends, fit: Fit, whole: bool, near: tuple[Imu, float] | None) -> Begun | Refusal:
        """Compute means and turns of a set of rests, and the start of its fit: `near` (model and scale of another set) if it is given."""
        record, options, notes = self.record, self.options, []
        start, stop = ends
        rests = _recording.rests_of(record, start, stop)
        data = _recording.norms(rests.accel, rests.slots, options.gravity)
        at_rest = pieces(fit.model, data)
        vertical, size = at_rest.vertical[: len(start)], options.gravity - at_rest.norm[: len(start)]
        rests = rests.shortened(np.linalg.inv(np.asarray(fit.model.accel.matrix)), vertical, size)
        seen = observability(vertical, not options.misalignment)
        # with a gyroscope the joint fit judges this later: six faces and the turns between them determine the misalignment. Poses of one
        # attitude determine nothing, and the joint fit would take all its steps to find that
        one = record.gyro is None or seen.spread < ONE_ATTITUDE
        if not seen.determined and one and not known_of(options.prior):
            return Refusal((seen.finding,), seen)
        accel = jax.tree.map(np.asarray, fit.model.accel)
        if record.gyro is None:
            return Begun(rests, fit, vertical, Imu(accel), None, 1.0, seen, tuple(notes))
        turns = _recording.turns_of(record, start, stop, rests.slots, whole)
        if lost := len(start) - 1 - int(np.isfinite(turns.sigma).sum()):
            notes.append(FINDINGS("turns_lost", "gyro", lost=lost))
        if record.band.any():
            notes.append(FINDINGS("dead_band", "gyro", size=Quantity(float(record.band.max()), "gyro")))
        if (kept := int(np.isfinite(turns.sigma).sum())) < 6:
            return Refusal((FINDINGS("few_turns_left", "gyro", kept=kept), *notes), seen)
        force = size[:, None] * vertical
        bias, cross, drift = _fits.rest_start(rests, force, options.g_sensitivity, np.zeros(3))
        scale, matrix = 1.0 if near is None else near[1], self.model.gyro.matrix
        if near is None and (self.raw or _fits.turn_costs(np.eye(3)[None], bias, padded(vertical, rests.slots), turns)[0] > _FAR_OFF):
            found = _fits.scanned_scale(bias, padded(vertical, rests.slots), turns)
            scale, matrix = (found, np.eye(3) / found) if self.raw else (1.0, matrix / found)
        if options.latitude is not None:
            earth = EARTH_RATE * np.sin(options.latitude) * vertical / scale
            bias, cross, drift = _fits.rest_start(rests, force, options.g_sensitivity, earth)
        moving = np.zeros(3) if drift else None
        if near is not None:
            return Begun(rests, fit, vertical, dataclasses.replace(near[0], drift=moving), turns, scale, seen, tuple(notes))
        gyro = eqx.tree_at(lambda t: (t.matrix, t.bias, t.g_sensitivity), self.model.gyro, (matrix, bias, cross))
        start = dataclasses.replace(self.model, accel=accel, gyro=gyro, drift=moving)
        return Begun(rests, fit, vertical, start, turns, scale, seen, tuple(notes))

    def joint(self, begun: Begun, near: bool, rounds: int) -> Joint:
        """Fit one set of rests, with `rounds` rounds of estimating the sizes of the errors."""
        one = np.ones((len(begun.rests.accel), 3))
        poses, gravity = begun.rests.poses(one[:, 0], one), np.asarray(self.options.gravity)
        data = Weighted(poses, begun.turns, gravity, self.options.latitude)
        return _fits.joint_fit(begun.start, data, begun.rests, self.options, self.needed, near, rounds)

    def result(self, base: ImuFit, begun: Begun | Refusal, joint: Joint | None, held_out: bool) -> ImuFit:
        """The calibration from the chosen set of rests; `joint` is its first fit."""
        options = self.options
        base = dataclasses.replace(base, observability=begun.seen)
        if isinstance(begun, Refusal):
            return dataclasses.replace(base, findings=(*base.findings, *begun.findings))
        notes = list(begun.notes)
        rests, count = begun.rests, len(begun.rests.accel)
        if joint is None:
            data = _recording.norms(rests.accel, rests.slots, options.gravity)
            known = rests.norm_variance(begun.vertical @ np.linalg.inv(begun.start.accel.matrix))
            extra = _fits.excess(pieces(begun.fit.model, data).norm[:count], known, self.needed)
            sigma = padded(np.sqrt(known + extra), rests.slots, np.inf)
            short = padded(rests.short, rests.slots)
            data = eqx.tree_at(lambda d: (d.poses.sigma, d.poses.short), data, (sigma, short), is_leaf=lambda x: x is None)
            fit = solved(
                begun.fit.model, data, options.convention, options.misalignment, loss=options.loss, rtol=None, priors=options.priors
            )
            sizes = np.sqrt([[np.mean(known + extra), np.nan, np.nan], [np.mean(known / (known + extra)), np.nan, np.nan]])
            return self.made(base, Joint(fit, data, pieces(fit.model, data), *sizes), rests, notes, list)
        turns: Any = begun.turns
        start = dataclasses.replace(begun.start, accel=joint.fit.model.accel, gyro=joint.fit.model.gyro)
        found = self.joint(dataclasses.replace(begun, start=start), True, _fits.ROUNDS - 1)
        found, options, shift = self.without_sensitivity(found, rests, notes)
        if held_out:
            sizes, angles = _fits.held_out(found, options)
            base = dataclasses.replace(base, held_out=sizes, held_out_turn=angles)
        causes = partial(_fits.causes, np.asarray(begun.start.gyro.bias), padded(begun.vertical, rests.slots), turns, begun.scale)
        return self.made(base, found, rests, notes, causes, shift)

    def without_sensitivity(self, joint: Joint, rests: Rests, notes: list[Finding]) -> tuple[Joint, Options, np.ndarray | None]:
        """Drop the g-sensitivity of the gyroscope if neither the F test nor the leave-one-out error of the turns supports it.

        Rates at rest in a hand hardly determine the g-sensitivity, and fitting it would absorb errors of the turns. The third result
        widens the intervals for this choice: the covariance of the dropped parameters, and the squared step of the others.
        """
        options, fit = self.options, joint.fit
        names = np.array(fit.names)
        where = np.char.startswith(names, "gyro.g_sensitivity")
        if not where.any() or options.prior is not None or not _known_kind(fit.model) or not bool(fit.usable):
            return joint, options, None
        matrix = _own_sizes(joint)[0]
        value, inner = np.asarray(fit.parameters)[where], matrix[np.ix_(where, where)]
        ratio = value @ np.linalg.solve(inner, value) / len(value)
        level = float(scipy.special.fdtrc(len(value), max(3 * (len(rests.accel) - 4), 1), ratio))
        if not level > FITTED_LEVEL:
            return joint, options, None
        options = dataclasses.replace(options, held=1e-3 * np.sqrt(np.diag(inner)))
        start = eqx.tree_at(lambda m: m.gyro.g_sensitivity, fit.model, np.zeros((3, 3)))
        start = _fits.refitted(start, joint.data, options).model
        less = _fits.joint_fit(start, joint.data, rests, options, self.needed, True, 1)
        if not (bool(less.fit.usable) and _fits.left_out(less)[0] < _fits.left_out(joint)[0]):
            return joint, self.options, None
        notes.append(FINDINGS("no_g_sensitivity", level=level))
        step = np.asarray(fit.parameters) - np.asarray(less.fit.parameters)
        lost = np.outer(step, step)
        lost[np.ix_(where, where)] += inner
        return less, options, lost

    def made(
        self, base: ImuFit, joint: Joint, rests: Rests, notes: list[Finding], causes: Callable[[], Sequence[Finding]],
        lost: np.ndarray | None = None,
    ) -> ImuFit:  # fmt: skip
        """Make and judge the result of a fit, with or without a gyroscope; `lost` widens the covariance."""
        fit, found, slots, count, options = joint.fit, joint.found, rests.slots, len(rests.accel), self.options
        weight, gyro, drift = np.asarray(fit.weights), fit.model.gyro, np.zeros(3)
        turned, rest, pairs = np.zeros((0, 3)), np.zeros((0, 3)), np.ones((0, 2))
        if gyro is not None and joint.data.turns is not None:
            valid = np.isfinite(joint.data.turns.sigma)
            turned, pairs = found.turned[valid], weight[slots : 3 * slots - 2].reshape(-1, 2)[valid]
            rest = found.rest[:count] @ np.linalg.inv(gyro.matrix).T
            drift = drift if fit.model.drift is None else np.linalg.solve(gyro.matrix, fit.model.drift)
        made = described(fit, joint.data, options.convention)
        names = made.estimate.names
        matrix, known = _own_sizes(joint)
        # one for each field: another frame mixes its entries
        freedom = [min((known[one] for one in known if one.startswith(name.partition("[")[0])), default=np.inf) for name in names]
        if options.prior is not None:  # not rescaled by the residuals, because that would rescale the prior, too
            matrix = np.asarray(covariance(fit, scaled=True))
        middle, error = float(self.record.time[-1]) / 2, np.sqrt(np.diag(matrix))
        nameable = _known_kind(fit.model) and bool(fit.usable)
        missing = lacks(joint, rests.remembering(self.record), middle, error) if nameable else []
        matrix = matrix + sum(lack.spread for lack in missing if lack.finding or options.prior is None) + (0.0 if lost is None else lost)
        matrix = np.asarray(framed(fit.model, options.convention, placed(fit.names, matrix, names))[1][0])
        for sensor, rate in (("gyro", fit.model.drift), ("accel", fit.model.accel_drift)):  # the bias may be that of any time of the record
            reach = {} if rate is None else {f"{sensor}.bias[{i}]": float(one) * self.record.time[-1] / 2 for i, one in enumerate(rate)}
            matrix = matrix + np.diag([reach.get(name, 0.0) ** 2 / 3 for name in names])
        for axis, size in enumerate(self.record.band):  # a dead band hides a bias of its size, evenly distributed
            hidden = np.array([1.0 * (name == f"gyro.bias[{axis}]") for name in names])
            hidden += [name.startswith(f"gyro.g_sensitivity[{axis}") / options.gravity for name in names]
            matrix = matrix + np.diag((size * hidden) ** 2 / 3)
        model, values = jax.tree.map(np.asarray, (made.model, made.estimate.values))
        result = dataclasses.replace(
            base, accel=model.accel, gyro=model.gyro, residual_norm=found.norm[:count], residual_turn=np.linalg.norm(turned, axis=1),
            estimate=Estimate(names, values, matrix, freedom, made.estimate.states, quantities(self.raw)), residual_rest=rest,
            sigma=joint.sigma, drift=drift, asked=tuple(dict.fromkeys(lack.term for lack in missing if lack.term is not None)),
            down_weighted=(np.flatnonzero(weight[:count] < 0.5), np.flatnonzero(np.min(pairs, axis=1, initial=1) < 0.5)),
        )  # fmt: skip
        time = Quantity(float(self.record.time[-1]), "time")
        for code, change, unit in (
            ("drift", drift * time.value, "gyro"),
            ("drift", time.value * _force(fit.model, fit.model.accel_drift), "accel"),
            ("warm_up", _force(fit.model, fit.model.accel_warm_up), "accel"),
        ):  # fmt: skip
            if np.any(change):
                notes.append(FINDINGS(code, unit, size=Quantity(float(np.abs(change).max()), unit), time=time))
        if not self.raw:
            known = zip(names, zip(values, result.estimate.error, strict=True), strict=True)
            notes += wrong_ranges(FINDINGS, dict(known))
        return judged(result, fit, options, notes, causes, [lack.finding for lack in missing if lack.finding])


def _force(model: Imu, readings: Any) -> np.ndarray:
    """A change of the accelerometer's readings in m/s^2; zero for None."""
    return np.zeros(3) if readings is None else np.linalg.solve(np.asarray(model.accel.matrix), np.asarray(readings))


def _known_kind(model: Imu) -> bool:
    """Whether both sensors are jaxcal's own models, for which missing terms can be named."""
    return all(type(sensor) in (Triad, Nonlinear, type(None)) for sensor in (model.accel, model.gyro))


def _own_sizes(joint: Joint) -> tuple[np.ndarray, dict[str, float]]:
    """Covariance of the parameters, and the degrees of freedom of each variance, if each kind of residual has a size of its own.

    A size comes from the residuals of its kind. Where it is small by chance, an interval is as wide as the noise of the sensors alone
    makes it. A variance is the sum of what each kind contributes; its degrees of freedom are those of Satterthwaite.
    """
    fit, kind = joint.fit, joint.kinds
    square, share, jacobian = (
        np.asarray(part)[: len(kind)] for part in ((fit.weights * fit.residuals) ** 2, fit.counted - leverage(fit), fit.jacobian)
    )
    size, freedom = (np.bincount(kind, part, 3) for part in (square, share))
    size = np.where(freedom < 1, 1.0, size / np.maximum(freedom, 1) / np.asarray(fit.mean_curvature) ** 2)
    freedom = np.maximum(freedom, 1)
    # rates at rest oscillate in a hand, so that their means scatter less than the noise inside the rests suggests
    sure = np.array([_SURE, _SURE, 0.0]) * student_quantile(np.inf, 0.975) / student_quantile(freedom, 0.975)
    matrix = np.asarray(covariance(fit, scaled=True))
    effect = (jacobian @ np.where(np.isfinite(matrix), matrix, 0.0)) ** 2
    each = np.stack([effect[kind == i].sum(axis=0) for i in range(3)])
    each = each / np.maximum(each.sum(axis=0), 1e-300) * np.maximum(size, (sure * np.nan_to_num(joint.least)) ** 2)[:, None]
    total = each.sum(axis=0)
    own = np.sqrt(total / np.asarray(fit.variance))
    known = total**2 / np.maximum(np.sum(each**2 / freedom[:, None], axis=0), 1e-300)
    return matrix * np.multiply.outer(own, own), dict(zip(fit.names, known, strict=True))
