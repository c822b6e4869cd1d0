"""Hard iron, soft iron and rotation together, from norms and a second sensor."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import numpy as np
from scipy.spatial.transform import Rotation

from ..._errors import DataError
from ..._types import AnyArray
from ...fitting import Fit, information, solve
from .._design._coverage import covered, sphere_grid
from .._design._heading_error import needed
from .._ellipsoid._algebraic import NotEllipsoid, algebraic, triangle
from .._ellipsoid._kinds import NAMES, basis_of, parameters_of, upper_and_centre
from .._ellipsoid._orthogonal import CURVED
from .._ellipsoid._select import LONG, all_distances, thinned
from .._ellipsoid._shape import Found, Frame, covariance_of, ellipsoid_of_model, filled, model_of, padded_length, radius_of, root, unit
from .._result import LIMITS, MagFit, outliers
from ._align import Accelerometer, Gyroscope, alignment_of, still
from ._joint_verdict import judged
from ._residuals import CENTRE, EXTRA, TURN, JointPoses, JointTurns, joint_pose_residuals, joint_turn_residuals
from ._turning import SEGMENT, array, attitudes_in_segments, centred, like, permutations

_ROUNDS, _SETTLED = 6, 3e-3
_LEAST = 1e-11  # of a standard deviation, in scaled units: exact data have none
_PRECISE, _STEPS = 1e-5, 64
_NO_DIGIT = 1e-10  # singular value below which a combination of parameters takes nothing from the residuals
_FEWEST = 13
_DIAGONAL, _FLAT = [0, 3, 5], 1e-3
_PER_DIRECTION = 32


def checked_joint(method: str, model: str, aid: Any, loss: Any, field_error: Any) -> None:
    """Options that `joint` needs, and those that it has no part in."""
    if not isinstance(aid, Accelerometer | Gyroscope):
        raise DataError("A joint fit needs an `aid`, Accelerometer or Gyroscope; known headings are aligned to after the fit.")
    if method != "ml":
        raise DataError(f"A joint fit is one of maximum likelihood: leave out method={method!r}, or joint.")
    if field_error is not None:
        raise DataError("A joint fit takes the size from the readings alone: leave out the field error, or joint.")
    if loss is not None:
        raise DataError(
            f"A joint fit has no robust loss: leave out loss={loss!r}, or joint; take away the outliers of a fit without joint."
        )
    if model not in ("auto", "symmetric"):
        raise DataError(f"A joint fit has the full soft iron: leave out model={model!r}, or joint.")


class Solution(eqx.Module):
    """Parameters with rotation at zero, what the fit says of them, and the standard deviations it stands on."""

    parameters: np.ndarray
    base: np.ndarray
    fit: Fit
    function: Callable = eqx.field(static=True)
    data: Any
    sigma: np.ndarray
    noise2: float
    bias: np.ndarray
    count: int

    @property
    def upper(self) -> np.ndarray:
        return _upper(self.parameters)

    @property
    def padded(self) -> int:
        """Number of readings with their padding: so many residuals are distances."""
        return len(self.data.u)

    @property
    def size_along(self) -> float:
        """Standard deviation that a residual of the second sensor was divided by, of a field of norm one."""
        if isinstance(self.data, JointTurns):
            return float(self.data.sigma[1])
        by_reading, by_force = _shares(self.data, self.parameters, self.base)
        return float(np.sqrt(np.mean(self.data.sigma[0] ** 2 * by_reading + self.data.sigma[1] ** 2 * by_force)))

    @property
    def matrix(self) -> np.ndarray:
        """W: the unit field in the second sensor's axes is W (u - centre)."""
        return self.base.T @ self.upper


@functools.partial(jax.jit, static_argnames=("function",))
def _attempt(function: Callable, start: AnyArray, data: Any, bounds: Any) -> Fit:
    fit = solve(function, start, data, bounds=bounds, rtol=_PRECISE, max_steps=_STEPS)
    return eqx.tree_at(lambda f: f.problem, fit, None)


class Pairs(eqx.Module):
    """What the second sensor said, on the rows that are fitted: of all rows at first, as rates are integrated before any is left out."""

    m: np.ndarray
    rows: np.ndarray
    force: Any = None
    paired: Any = None
    gyro: Any = None
    rate: float = 0.0
    step: float = 0.0

    @staticmethod
    def of(m: np.ndarray, rows: np.ndarray, aid: Accelerometer | Gyroscope) -> "Pairs":
        if isinstance(aid, Gyroscope):
            gyro = like(aid.gyro, m, "rates")
            return Pairs(m, rows, gyro=gyro, rate=float(aid.rate), step=_noise_of(gyro) / float(aid.rate))
        force = like(aid.accel, m, "specific force")
        rest = still(force)
        safe = np.where(rest[:, None], force, [0.0, 0.0, 1.0])
        return Pairs(m, rows, force=unit(safe)[rows], paired=rest[rows])

    @property
    def function(self) -> Callable:
        return joint_turn_residuals if self.force is None else joint_pose_residuals

    def data(self, u: np.ndarray, parameters: np.ndarray, base: np.ndarray, sigma: np.ndarray, noise2: float, bias: np.ndarray) -> Any:
        """Everything that the residuals stand on but do not vary with the parameters, padded."""
        n, common = len(u), (sigma, np.float64(noise2), base)
        first = (filled(u, u[:1]), filled(np.ones(n)))
        if self.force is not None:
            return JointPoses(*first, filled(self.paired.astype(float)), *common, filled(self.force, self.force[:1]))
        segment_of_all, attitude, slope = attitudes_in_segments(self.gyro - bias, self.rate, SEGMENT)
        segment, attitude, slope = (x[self.rows] for x in (segment_of_all, attitude, slope))
        there = segment >= 0
        number, member = np.unique(segment[there], return_inverse=True)
        place = np.zeros(n, dtype=int)
        place[there] = member
        upper = _upper(parameters)
        iron = np.linalg.inv(upper) @ base
        metric = there[:, None, None] * (attitude @ (iron.T @ iron) @ np.swapaxes(attitude, 1, 2))
        total = np.zeros((padded_length(len(number)), 3, 3))
        np.add.at(total, place, metric)
        total[len(number) :] = np.eye(3)
        normal = (u - parameters[CENTRE]) @ (upper.T @ upper)
        # noise of the rates adds up to a random walk, whose slowest part in n steps, the mean taken off, has n^2/pi^2 their variance;
        # all of it has n/6, and cannot be more than what is left along the surface
        steps = np.bincount(segment_of_all[segment_of_all >= 0])[np.maximum(segment, 0)]
        radius = radius_of(upper.T @ upper)
        walk = np.minimum((self.step * radius / sigma[1]) ** 2, 6 / steps)
        heard = there / np.sqrt(1 + walk * (steps / np.pi) ** 2)
        return JointTurns(
            *first, filled(heard), *common, filled(place), filled(attitude, np.eye(3)), filled(slope), filled(_across(normal)),
            filled(metric), np.linalg.inv(total),
        )  # fmt: skip


def _noise_of(gyro: np.ndarray) -> float:
    """Standard deviation of white noise of the rates, from their second differences; motion that is as fast counts as noise."""
    second = np.diff(gyro, 2, axis=0)
    second = second[np.isfinite(second).all(axis=1)]
    return 1.4826 * float(np.median(np.abs(second))) / np.sqrt(6) if len(second) else 0.0


def _across(normal: np.ndarray) -> np.ndarray:
    """Two unit vectors at right angles to each normal, (n, 3, 2)."""
    normal = unit(normal)
    first = unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)]))
    return np.stack([first, np.cross(normal, first)], axis=2)


def _sphere_start(u: np.ndarray, base: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """A sphere with the axes merely exchanged: a rotation found with an ellipsoid that ran off is no start."""
    try:
        return [(parameters_of("symmetric", *algebraic(u, "sphere")), _nearest(base))]
    except NotEllipsoid:
        return []


def _nearest(rotation: np.ndarray) -> np.ndarray:
    """The exchange of axes nearest to a rotation."""
    return max(permutations(), key=lambda p: np.trace(p.T @ rotation))


def _solved(u, pairs: Pairs, begin, base, noise: float, dip: float | None) -> Solution:
    """Fit and standard deviations by turns."""
    accel = pairs.force is not None
    bias, sigma = np.zeros(3), np.full(2, max(noise, _LEAST))
    extra = np.zeros(3)
    if accel:
        y = unit((u - begin[CENTRE]) @ _upper(begin).T @ base)
        product = np.sum(y * pairs.force, axis=1)[pairs.paired]
        extra = np.array([np.mean(product) if dip is None else -np.sin(dip)])
    parameters = np.concatenate([begin, np.zeros(3), extra])
    low, high = np.full(len(parameters), -np.inf), np.full(len(parameters), np.inf)
    if dip is not None and accel:
        low[EXTRA] = high[EXTRA] = extra
    # a sign of U would mirror the field
    low[_DIAGONAL] = _FLAT * np.abs(parameters[_DIAGONAL])
    for turn in range(_ROUNDS):
        radius = radius_of(_upper(parameters).T @ _upper(parameters))
        noise2 = sigma[0] ** 2 if 0.5 * radius > sigma[0] > CURVED * radius else 0.0
        data = pairs.data(u, parameters, base, sigma, noise2, bias)
        fit = _attempt(pairs.function, parameters, data, (low, high))
        parameters = np.array(fit.parameters)
        base = base @ Rotation.from_rotvec(parameters[TURN]).as_matrix()
        parameters[TURN] = 0.0
        if not accel:
            bias = bias + parameters[EXTRA]
            parameters[EXTRA] = 0.0
        last, sigma = sigma, _sizes(fit, data, parameters, base, sigma, accel)
        settled = np.all(np.abs(sigma - last) <= _SETTLED * np.maximum(last, 10 * _LEAST))
        if settled or not np.isfinite(sigma).all() or (turn and not bool(fit.usable)):
            break
    return Solution(parameters, base, fit, pairs.function, data, sigma, noise2, bias, len(u))  # type: ignore[possibly-unbound]


def _upper(parameters: np.ndarray) -> np.ndarray:
    return upper_and_centre(parameters[:9], basis_of("symmetric"))[0]


def _sizes(fit: Fit, data: Any, parameters, base, sigma, accel: bool) -> np.ndarray:
    """Standard deviations of both kinds of residual, each by its own degrees of freedom: its number less what the fit took from it."""
    residuals, n = np.array(fit.residuals), len(data.u)
    weight = np.repeat(data.paired, 1 if accel else 2)
    residuals[n:] /= np.where(weight > 0, weight, 1.0)
    taken = information(triangle(np.asarray(fit.jacobian)), tolerance=_NO_DIGIT).leverage(np.asarray(fit.jacobian))
    segments = 0 if accel else len(np.unique(data.member[data.paired > 0]))
    parts = (slice(0, n), data.weight > 0, 0), (slice(n, None), weight > 0, 2 * segments)
    ratio = []
    for part, there, nuisance in parts:
        r, free = residuals[part][there], there.sum() - taken[part].sum() - nuisance
        ratio.append(np.sum(r**2) / max(free, 1.0))
    first = max(sigma[0] * np.sqrt(ratio[0]), _LEAST)
    if not accel:
        return np.array([first, max(sigma[1] * np.sqrt(ratio[1]), _LEAST)])
    # what the noise of the readings does not explain is that of the force
    by_reading, by_force = _shares(data, parameters, base)
    there, r = data.paired > 0, residuals[n:]
    before = sigma[0] ** 2 * by_reading + sigma[1] ** 2 * by_force
    total = np.sum((before * r**2)[there]) * there.sum() / max(there.sum() - taken[n:].sum(), 1.0)
    more = (total - first**2 * np.sum(by_reading[there])) / max(np.sum(by_force[there]), 1e-300)
    return np.array([first, np.sqrt(max(more, _LEAST**2))])


def _shares(data: JointPoses, parameters, base) -> tuple[np.ndarray, np.ndarray]:
    """Variance of the products per variance of a reading, and of the force's direction."""
    upper = _upper(parameters)
    y = unit((data.u - parameters[CENTRE]) @ upper.T)
    force = data.force @ base.T
    normal = unit(y @ upper)
    slope = force @ upper
    slope = slope - np.sum(slope * normal, axis=1, keepdims=True) * normal
    return np.sum(slope**2, axis=1), 1 - np.sum(y * force, axis=1) ** 2


def jointly(
    after: MagFit, m: Any, aid: Accelerometer | Gyroscope, *, limits: tuple[float, float] = LIMITS, rows: np.ndarray | None = None
) -> MagFit:
    """The fit of norms and second sensor, from that of one after the other; of some `rows`, or of all that a long log needs."""
    m = array(m, "readings")
    there = np.flatnonzero(np.isfinite(m).all(axis=1))
    whole = m[there]
    if rows is None:
        rows = there[thinned(Frame.of(whole).scaled(whole), _PER_DIRECTION, None)] if len(there) > LONG else there
    if len(rows) < _FEWEST:
        raise DataError(f"{len(rows)} readings are left for a joint fit; at least {_FEWEST} are needed, in attitudes that differ.")
    pairs, dip = Pairs.of(m, rows, aid), getattr(aid, "dip", None)
    frame = Frame.of(m[rows])
    u = frame.scaled(m[rows])
    begin = parameters_of("symmetric", *ellipsoid_of_model(after.model, frame, after.field))  # type: ignore[arg-type]
    base = _upper(begin) @ np.asarray(after.model.soft_iron) * after.field / frame.scale  # type: ignore[union-attr]
    begins = [(begin, base), *(_sphere_start(u, base) if after.verdict != "good" else [])]
    tries = [_solved(u, pairs, *begin, after.noise / frame.scale, dip) for begin in begins]
    return _result(after, min(tries, key=_order), frame, u, whole, limits, isinstance(aid, Gyroscope))


def _spread(found: Solution, u: np.ndarray) -> float:
    """What `Alignment.spread` has: of the dip, or of an axis of the unit field while the sensor turns, rad."""
    data, there = found.data, found.data.paired[: len(u)] > 0
    y = unit((u - found.parameters[CENTRE]) @ found.matrix.T)[there]
    if isinstance(data, JointPoses):
        return float(np.std(np.arcsin(np.clip(np.sum(y * data.force[: len(u)][there], axis=1), -1, 1))))
    back = np.einsum("nij,nj->ni", data.attitude[: len(u)][there], y)
    number, member = np.unique(data.member[: len(u)][there], return_inverse=True)
    return float(np.sqrt(np.sum(centred(back, member) ** 2) / (3 * max(len(y) - len(number), 1))))


def _order(found: Solution) -> tuple[bool, float]:
    """Worth of a solution among those from several starts: -log of the likelihood, of lengths among the readings."""
    data = found.data
    pairs = data.paired > 0
    along = 2 * np.sum(pairs) * np.log(found.sigma[1])
    if isinstance(data, JointPoses):
        by_reading, by_force = _shares(data, found.parameters, found.base)
        along = 0.5 * np.sum(np.log(found.sigma[0] ** 2 + found.sigma[1] ** 2 * by_force / np.maximum(by_reading, 1e-12))[pairs])
    return not bool(found.fit.usable), float(found.count * np.log(found.sigma[0]) + along)


def _result(after: MagFit, found: Solution, frame: Frame, u, whole, limits, rates: bool) -> MagFit:
    upper, matrix, n = _upper(found.parameters), found.matrix, len(u)
    shape, centre = upper.T @ upper, found.parameters[CENTRE]
    given = abs(abs(np.linalg.det(after.model.soft_iron)) - 1) > 1e-9 and after.plane is None  # type: ignore[union-attr]
    size = after.field / frame.scale if given else radius_of(shape)
    rotation = root(shape) @ np.linalg.inv(matrix)
    ellipsoid = Found(
        found.parameters[:9], shape, centre, np.zeros((9, 9)), float(found.sigma[0]),
        np.asarray(found.fit.residuals)[:n] * np.asarray(found.data.sigma)[0], np.asarray(found.fit.weights)[:n],
        bool(found.fit.usable), "symmetric", noise2=found.noise2,
    )  # fmt: skip
    left = _spread(found, u)
    verdict = judged(found, left, after.inclination, limits, len(outliers(ellipsoid)))
    ellipsoid = eqx.tree_at(lambda f: f.covariance, ellipsoid, verdict.covariance[:9, :9])
    covariance = covariance_of(ellipsoid, frame)
    said = alignment_of(
        model_of(shape, centre, frame, size), rotation, _nearest(rotation), verdict.turned, np.array([after.alignment.spread[0], left]),
        int(np.sum(found.data.paired > 0)), after.alignment.source, found.fit,
        dip=float("nan") if rates else -float(np.arcsin(np.clip(found.parameters[12], -1, 1))), bias=found.bias,
    )  # fmt: skip
    if len(whole) > n:
        distance = all_distances(ellipsoid, frame.scaled(whole))
        ellipsoid = eqx.tree_at(lambda f: (f.distance, f.weight), ellipsoid, (distance, np.ones(len(whole))))
    wanted = np.zeros((0, 3))
    if np.isfinite(covariance).all():
        wanted = needed(shape / frame.scale**2, covariance, sphere_grid()) @ rotation
    return dataclasses.replace(
        after, model=said.model, covariance=covariance, heading_error=verdict.heading_error,
        coverage=covered((frame.scaled(whole) - centre) @ matrix.T), residual=ellipsoid.distance * frame.scale,
        noise=float(found.sigma[0]) * frame.scale, field=size * frame.scale, outliers=outliers(ellipsoid), used=n, needed=wanted,
        condition=verdict.condition, plane=None, verdict=verdict.verdict, reason=verdict.reason, names=NAMES, kind="symmetric",
        alignment=said, penalty=0.0, field_error=None, joint=True,
    )  # fmt: skip
