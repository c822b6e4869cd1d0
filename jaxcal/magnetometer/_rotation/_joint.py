"""Hard iron, soft iron and rotation together, from field magnitudes and a second sensor."""

import contextlib
import dataclasses
from collections.abc import Callable
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import DataError
from ..._frozen import replaced
from ..._precision import host_float64
from ..._types import AnyArray
from ...fitting import Fit, Gaussian, information, solve
from .._design._coverage import covered, sphere_grid
from .._design._heading_error import heading_error, needed, turned_heading_error
from .._ellipsoid._algebraic import NotEllipsoid, algebraic, triangle
from .._ellipsoid._kinds import basis_of, parameters_of, upper_and_centre
from .._ellipsoid._orthogonal import CURVED
from .._ellipsoid._select import LONG, all_distances, thinned
from .._ellipsoid._shape import Found, Frame, covariance_of, ellipsoid_of_model, filled, model_of, padded_length, radius_of, root, unit
from .._judge import dip_differs, outliers
from .._result import Facts, MagFit, finished
from ._align import DELAY as PRIOR, Accelerometer, Alignment, Gyroscope, align, alignment_of, still, vertical
from ._joint_errors import examined, shares
from ._residuals import CENTRE, DELAY, EXTRA, TURN, JointPoses, JointTurns, joint_pose_residuals, joint_turn_residuals
from ._turning import SEGMENT, array, attitudes_in_segments, centred, like, permutations

_ROUNDS, _SETTLED = 6, 3e-3  # most rounds, and change of the noise that ends them
_LEAST = 1e-11  # smallest standard deviation in scaled units, for exact data
_PRECISE, _STEPS = 1e-5, 64  # remaining step in standard errors, and most steps
_NO_DIGIT = 1e-10  # singular value below which a combination of parameters does not reduce the residuals
_FEWEST = 13  # readings: one more than parameters
_DIAGONAL, _FLAT = [0, 3, 5], 1e-3  # of U, which may not change sign: share of its start
_PER_DIRECTION = 32  # readings kept in each of 500 directions
#: findings of the fit of magnitudes that hold for the joint fit too
_KEPT = ("clipped", "dip_assumed", "dip_differs", "averaged", "bent")


def checked_joint(method: str, model: str, aid: Any, field_error: Any) -> None:
    """Refuse options that `joint` lacks or does not support."""
    if not isinstance(aid, Accelerometer | Gyroscope) or not getattr(aid, "turns", True):
        raise DataError("A joint fit needs an `aid`, Accelerometer or Gyroscope; known headings are aligned to after the fit.",
                        code="joint_needs_aid")  # fmt: skip
    out = {
        f"is one of maximum likelihood: leave out the method {method!r}, or joint": method != "ml",
        "takes the size from the readings alone: leave out the field error, or joint": field_error is not None,
        f"has the full soft iron: leave out the model {model!r}, or joint": model not in ("auto", "symmetric"),
    }
    for why, wrong in out.items():
        if wrong:
            raise DataError(f"A joint fit {why}.", code="joint_options")


class Solution(eqx.Module):
    """Parameters with the rotation at zero, the fit, and the standard deviations that it uses."""

    parameters: np.ndarray
    base: np.ndarray
    fit: Fit
    function: Callable = eqx.field(static=True)
    data: Any
    sigma: np.ndarray
    noise2: float
    bias: np.ndarray
    count: int
    priors: Any

    def jacobian(self, u: np.ndarray) -> np.ndarray:
        """Derivative of the residuals for other readings: a fit with all parameters held, which reuses the compiled program."""
        held = (self.parameters, self.parameters)
        data = eqx.tree_at(lambda d: d.u, self.data, u)
        return np.asarray(_attempt(self.function, self.parameters, data, held, self.priors).jacobian)

    @property
    def upper(self) -> np.ndarray:
        return _upper(self.parameters)

    @property
    def matrix(self) -> np.ndarray:
        """W: the unit field in the second sensor's axes is W (u - centre)."""
        return self.base.T @ self.upper


def _delay(parameters: Any) -> Any:
    return parameters[DELAY]


def _attempt(function: Callable, start: AnyArray, data: Any, bounds: Any, priors: Any) -> Fit:
    return solve(function, start, data, bounds=bounds, priors=priors, rtol=_PRECISE, max_steps=_STEPS)


class Pairs(eqx.Module):
    """Data of the second sensor beside the fitted rows. Rates are kept for all rows, because they are integrated before any is omitted."""

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
            # estimate white noise of the rates from their second differences; equally fast motion counts as noise
            second = np.diff(gyro, 2, axis=0)
            second = np.abs(second[np.isfinite(second).all(axis=1)])
            noise = 1.4826 * float(np.median(second)) / np.sqrt(6) if len(second) else 0.0
            return Pairs(rows, gyro=gyro, rate=float(aid.rate), step=noise / float(aid.rate))
        force = like(aid.accel, m, "specific force")
        rest = still(force)
        safe = np.where(rest[:, None], force, [0.0, 0.0, 1.0])
        return Pairs(rows, force=unit(safe)[rows], paired=rest[rows])

    @property
    def function(self) -> Callable:
        return joint_turn_residuals if self.force is None else joint_pose_residuals

    def data(self, u: np.ndarray, parameters: np.ndarray, base: np.ndarray, sigma: np.ndarray, noise2: float, bias: np.ndarray) -> Any:
        """All inputs of the residuals that do not vary with the parameters, padded."""
        n, common = len(u), (sigma, np.float64(noise2), base)
        first = (filled(u, u[:1]), filled(np.ones(n)))
        if self.force is not None:
            return JointPoses(*first, filled(self.paired.astype(float)), *common, filled(self.force, self.force[:1]))
        segment_of_all, attitude, slope = attitudes_in_segments(self.gyro - bias[:3], self.rate, SEGMENT, bias[3])
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
        # Noise of the rates adds up to a random walk. Over n steps its slowest part, with the mean subtracted, has n^2/pi^2 times the
        # variance of a step, and the whole walk n/6. It cannot exceed the residual along the surface.
        steps = np.maximum(np.bincount(segment_of_all[segment_of_all >= 0], minlength=1)[np.maximum(segment, 0)], 1)
        radius = radius_of(upper.T @ upper)
        walk = np.minimum((self.step * radius / sigma[1]) ** 2, 6 / steps)
        heard = there / np.sqrt(1 + walk * (steps / np.pi) ** 2)
        return JointTurns(
            *first, filled(heard), *common, filled(place), filled(attitude, np.eye(3)), filled(slope), filled(_across(normal)),
            filled(metric), np.linalg.inv(total),
        )  # fmt: skip


def _across(normal: np.ndarray) -> np.ndarray:
    """Two unit vectors at right angles to each normal, (n, 3, 2)."""
    normal = unit(normal)
    first = unit(np.cross(normal, np.eye(3)[np.argmin(np.abs(normal), axis=1)]))
    return np.stack([first, np.cross(normal, first)], axis=2)


def _nearest(rotation: np.ndarray) -> np.ndarray:
    """The exchange of axes nearest to a rotation."""
    return max(permutations(), key=lambda p: np.trace(p.T @ rotation))


def _solved(u, pairs: Pairs, begin, base, noise: float, dip: float | None) -> Solution:
    """Fit and standard deviations in turn."""
    accel = pairs.force is not None
    bias, sigma = np.zeros(4), np.full(2, max(noise, _LEAST))
    extra = np.zeros(4)
    if accel:
        y = unit((u - begin[CENTRE]) @ _upper(begin).T @ base)
        product = np.sum(y * pairs.force, axis=1)[pairs.paired]
        extra = np.array([np.mean(product) if dip is None else -np.sin(dip)])
    parameters = np.concatenate([begin, np.zeros(3), extra])
    low, high = np.full(len(parameters), -np.inf), np.full(len(parameters), np.inf)
    if dip is not None and accel:
        low[EXTRA] = high[EXTRA] = extra
    # a change of sign in U would mirror the field
    low[_DIAGONAL] = _FLAT * np.abs(parameters[_DIAGONAL])
    for turn in range(_ROUNDS):
        radius = radius_of(_upper(parameters).T @ _upper(parameters))
        noise2 = sigma[0] ** 2 if 0.5 * radius > sigma[0] > CURVED * radius else 0.0
        data = pairs.data(u, parameters, base, sigma, noise2, bias)
        priors = () if accel else (Gaussian(_delay, -bias[3], PRIOR),)
        fit = _attempt(pairs.function, parameters, data, (low, high), priors)
        parameters = np.array(fit.parameters)
        base = base @ scipy.spatial.transform.Rotation.from_rotvec(parameters[TURN]).as_matrix()
        parameters[TURN] = 0.0
        if not accel:
            bias = bias + parameters[EXTRA]
            parameters[EXTRA] = 0.0
        last, sigma = sigma, _sizes(fit, data, parameters, base, sigma, accel)
        settled = np.all(np.abs(sigma - last) <= _SETTLED * np.maximum(last, 10 * _LEAST))
        if settled or not np.isfinite(sigma).all() or (turn and not bool(fit.usable)):
            break
    return Solution(parameters, base, fit, pairs.function, data, sigma, noise2, bias, len(u), priors)  # type: ignore[possibly-unbound]


def _upper(parameters: np.ndarray) -> np.ndarray:
    return upper_and_centre(parameters[:9], basis_of("symmetric"))[0]


def _sizes(fit: Fit, data: Any, parameters, base, sigma, accel: bool) -> np.ndarray:
    """Standard deviations of both kinds of residual, each with its degrees of freedom: number of residuals minus fitted parameters."""
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
    # the noise of the force explains what the noise of the readings does not
    by_reading, by_force = shares(data, parameters, base)
    there, r = data.paired > 0, residuals[n:]
    before = sigma[0] ** 2 * by_reading + sigma[1] ** 2 * by_force
    total = np.sum((before * r**2)[there]) * there.sum() / max(there.sum() - taken[n:].sum(), 1.0)
    more = (total - first**2 * np.sum(by_reading[there])) / max(np.sum(by_force[there]), 1e-300)
    return np.array([first, np.sqrt(max(more, _LEAST**2))])


def jointly(after: MagFit, m: Any, aid: Accelerometer | Gyroscope, *, rows: np.ndarray | None = None) -> MagFit:
    """Fit magnitudes and second sensor together, starting from separate fits; with some `rows`, or as many as a long log needs."""
    m = array(m, "readings")
    there = np.flatnonzero(np.isfinite(m).all(axis=1))
    whole = m[there]
    if rows is None:
        rows = there[thinned(Frame.of(whole).scaled(whole), _PER_DIRECTION)] if len(there) > LONG else there
    if len(rows) < _FEWEST:
        raise DataError(f"{len(rows)} readings are left for a joint fit; at least {_FEWEST} are needed, in attitudes that differ.",
                        code="few_readings")  # fmt: skip
    pairs, dip = Pairs.of(m, rows, aid), getattr(aid, "dip", None)
    frame = Frame.of(m[rows])
    u = frame.scaled(m[rows])
    begin = parameters_of("symmetric", *ellipsoid_of_model(after.model, frame, after.field))  # type: ignore[arg-type]
    base = _upper(begin) @ np.asarray(after.model.soft_iron) * after.field / frame.scale  # type: ignore[union-attr]
    begins = [(begin, base)]
    if after.verdict != "good":
        # a rotation found with a diverged ellipsoid is a poor start: also start from a sphere with axes only exchanged
        with contextlib.suppress(NotEllipsoid):
            begins.append((parameters_of("symmetric", *algebraic(u, "sphere")), _nearest(base)))
    tries = [_solved(u, pairs, *begin, after.noise / frame.scale, dip) for begin in begins]
    return _result(after, min(tries, key=_order), frame, u, whole, isinstance(aid, Gyroscope))


def _spread(found: Solution, u: np.ndarray) -> float:
    """`Alignment.spread` after the fit, in rad: the scatter of the dip, or of an axis of the unit field while the sensor turns."""
    data, there = found.data, found.data.paired[: len(u)] > 0
    y = unit((u - found.parameters[CENTRE]) @ found.matrix.T)[there]
    if isinstance(data, JointPoses):
        return float(np.std(np.arcsin(np.clip(np.sum(y * data.force[: len(u)][there], axis=1), -1, 1))))
    back = np.einsum("nij,nj->ni", data.attitude[: len(u)][there], y)
    number, member = np.unique(data.member[: len(u)][there], return_inverse=True)
    return float(np.sqrt(np.sum(centred(back, member) ** 2) / (3 * max(len(y) - len(number), 1))))


def _order(found: Solution) -> tuple[bool, float]:
    """Sorting key of solutions from several starts: whether one failed, then -log of its likelihood as lengths among the readings."""
    data = found.data
    pairs = data.paired > 0
    along = 2 * np.sum(pairs) * np.log(found.sigma[1])
    if isinstance(data, JointPoses):
        by_reading, by_force = shares(data, found.parameters, found.base)
        along = 0.5 * np.sum(np.log(found.sigma[0] ** 2 + found.sigma[1] ** 2 * by_force / np.maximum(by_reading, 1e-12))[pairs])
    return not bool(found.fit.usable), float(found.count * np.log(found.sigma[0]) + along)


def _result(after: MagFit, found: Solution, frame: Frame, u, whole, rates: bool) -> MagFit:
    upper, matrix, n = _upper(found.parameters), found.matrix, len(u)
    shape, centre = upper.T @ upper, found.parameters[CENTRE]
    given = after._facts.given and after.plane is None
    size = after.field / frame.scale if given else radius_of(shape)
    rotation = root(shape) @ np.linalg.inv(matrix)
    ellipsoid = Found(
        found.parameters[:9], shape, centre, np.zeros((9, 9)), float(found.sigma[0]),
        np.asarray(found.fit.residuals)[:n] * np.asarray(found.data.sigma)[0], bool(found.fit.usable), "symmetric",
        noise2=found.noise2,
    )  # fmt: skip
    left = _spread(found, u)
    level = after.inclination, None if after.down is None else rotation.T @ after.down
    joint, turned, error, told = examined(found, left, level, len(outliers(ellipsoid.distance)))
    ellipsoid = dataclasses.replace(ellipsoid, covariance=joint[:9, :9])
    covariance = covariance_of(ellipsoid, frame)
    said = alignment_of(
        model_of(shape, centre, frame, size), rotation, _nearest(rotation), turned, np.array([after.alignment.spread[0], left]),
        int(np.sum(found.data.paired > 0)), after.alignment.source, found.fit,
        dip=float("nan") if rates else -float(np.arcsin(np.clip(found.parameters[12], -1, 1))), bias=found.bias[:3],
        delay=(float(found.bias[3]), float(np.sqrt(joint[DELAY, DELAY]))) if rates else None,
    )  # fmt: skip
    if len(whole) > n:
        distance = all_distances(ellipsoid, frame.scaled(whole))
        ellipsoid = dataclasses.replace(ellipsoid, distance=distance)
    wanted = np.zeros((0, 3))
    if np.isfinite(covariance).all():
        wanted = needed(shape / frame.scale**2, covariance, sphere_grid()) @ rotation
    kept = tuple(one for one in after._facts.known if one.code in _KEPT)
    facts = Facts(covariance, n, given, (*kept, *told.pop("known")), after._facts.limits, **told)
    return finished(
        after, model=said.model, coverage=covered((frame.scaled(whole) - centre) @ matrix.T), residual=ellipsoid.distance * frame.scale,
        outliers=outliers(ellipsoid.distance), needed=wanted, noise=float(found.sigma[0]) * frame.scale,
        field=size * frame.scale, plane=None, method="joint", kind="symmetric", alignment=said, down=after.down,
        heading_error=error, _facts=facts,
    )  # fmt: skip


@host_float64
def aligned(found: MagFit, m: Any, aid: Any, *, joint: bool = False) -> MagFit:
    """Add the rotation that another sensor shows to a fit; its readings may differ from the fitted ones.

    Parameters
    ----------
    found : a fit with a model, to these readings or to some of them.
    m : (n, 3) readings; rows with NaN are left out.
    aid : `Accelerometer`, `Gyroscope` or `Headings`, one row for each reading.
    joint : fit magnitudes and other sensor together, as `fit` does with `joint`, starting from `found`.

    Returns
    -------
    The fit with its `alignment`. Its model includes the rotation, and its `heading_error` the uncertainty of the rotation.

    Raises
    ------
    DataError
        As for `align`, and for a fit without a model.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.magnetometer import Accelerometer, aligned, body_field, scenario
    >>> m, up = body_field(scenario("all"), 50.0), -9.81 * body_field(scenario("all"), 1.0, np.pi / 2)
    >>> aligned(jaxcal.magnetometer.fit(m), m, Accelerometer(up)).alignment.verdict
    'good'

    References
    ----------
    The rotation comes from `align`; the heading error adds its variance to that of the fit of magnitudes.
    """
    if found.model is None:
        raise DataError(f"The fit has no model to turn: {found.reason}", code="no_model")
    if joint:
        checked_joint(found.method, "auto", aid, None)
    turn = align(m, found.model, aid)
    dip, down = vertical(aid, turn)
    matrix = found._facts.covariance
    if dip is not None and found.plane is None and np.isfinite(matrix).all():
        down = found.down if down is None else down
        shape = ellipsoid_of_model(found.model, Frame(np.zeros(3), 1.0), found.field)[0]
        error, before = heading_error(shape, matrix, dip, down), found._facts
        facts = dataclasses.replace(
            before, known=tuple(one for one in before.known if one.code != "dip_assumed")
        )  # fmt: skip
        found = replaced(found, inclination=dip, down=down, heading_error=error, _facts=facts)
    after = with_rotation(found, turn, None)
    return jointly(after, m, aid) if joint else after


def with_rotation(result: MagFit, alignment: Alignment, field: Any) -> MagFit:
    """The fit with the rotation in its soft iron and in its heading error; a rotation that is not determined is not applied."""
    if alignment.verdict == "refused":
        return finished(result, alignment=alignment)
    facts, error = result._facts, result.heading_error
    if np.ndim(field) == 1:
        facts = dataclasses.replace(facts, known=(*facts.known, *dip_differs(float(alignment.dip), float(result.inclination))))
    if result.plane is None:
        down = None if result.down is None else np.asarray(alignment.rotation).T @ result.down
        error = np.hypot(error, turned_heading_error(np.asarray(alignment.covariance), result.inclination, down))
    return finished(result, model=alignment.model, alignment=alignment, heading_error=error, _facts=facts)
