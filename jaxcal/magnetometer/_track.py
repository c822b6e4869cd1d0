"""`track`: a hard iron that drifts during a long log, as a random walk beside a constant soft iron, in linear time."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import CAUTION, NOTE, Curve, Finding, Number, Quantity, Result, Section, by_axis, listed
from .._errors import DataError
from .._log import LogLike
from .._precision import host_float64, real_numbers
from .._special import NORMAL95
from .._types import AnyArray, Checked, Numbers, Samples
from ..fitting import Chain
from ..fitting._chain import Eliminated
from ._aided import ROUNDS, SETTLED
from ._field import INCLINATION
from ._findings import FINDINGS
from ._fit import fit, mag_of
from ._judge import outliers
from ._model import MagModel, quantity_of
from ._quadric import LONG, SYMMETRIC

_CLEAR = 9.0  # twice the logarithm of the likelihood by which a drift must gain: three standard deviations
_WINDOWS = 24  # of the log: half of them are left out, and between them the path is compared with itself


class Track(Result):
    """A drifting hard iron.

    Attributes
    ----------
    time : (k,) s, points of the path.
    hard_iron : (k, 3) hard iron at these times, in the unit of the readings.
    covariance : (k, 3, 3) of each.
    soft_iron : (3, 3), constant; `field` its magnitude of the corrected field.
    walk : standard deviation of the change of an axis after a second, in the unit of the readings over the root of a second.
    noise : standard deviation of one axis of a reading.
    inclination : dip of the field in rad, which turns a hard iron into a heading error.
    cost : heading error in rad of one calibration for the whole log, the root mean square over time.
    interval : s after which the drift alone costs the wanted heading error: calibrate again before.
    outliers : (j,) indices of readings that were left out.
    findings : "drifts", a caution if one calibration costs more than the limit; "steady"; or "disturbed", a caution: the readings vary
        in a way that is no drift, and the hard iron is one for the log.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, scenario, track
    >>> m = body_field(scenario("all", samples=3000), 50.0) + 0.2 * np.random.default_rng(0).normal(size=(3000, 3))
    >>> m = m + np.linspace(0.0, 10.0, 3000)[:, None]
    >>> found = track(m, np.arange(3000.0))
    >>> found.codes, found.at(1500.0).round(0).tolist()
    (frozenset({'drifts'}), [5.0, 5.0, 5.0])
    """

    time: AnyArray
    hard_iron: AnyArray
    covariance: AnyArray
    soft_iron: AnyArray
    field: float
    walk: float
    noise: float
    inclination: float
    cost: float
    interval: float
    outliers: AnyArray
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    def at(self, time: Samples) -> AnyArray:
        """Hard iron (..., 3) at times in s; before and after the log that of its ends."""
        return np.stack([np.interp(np.asarray(time), self.time, axis) for axis in self.hard_iron.T], axis=-1)

    def correct(self, m: Samples, time: Samples) -> AnyArray:
        """Corrected readings (n, 3), each with the hard iron of its time."""
        return (np.asarray(m) - self.at(time)) @ np.linalg.inv(self.soft_iron).T

    @property
    def headline(self) -> str:
        """How long a calibration holds."""
        if "drifts" not in self.codes:
            return "no drift shows"
        hourly = 100 * self.walk * np.sqrt(3600) / self.field
        return f"hard iron drifts by {hourly:.2g} % of the field in an hour; calibrate again every {self.interval / 3600:.2g} h"

    def sections(self) -> list[Section]:
        """The hard iron at the end, the drift, and the path."""
        quantity, error = quantity_of(self.field), NORMAL95 * np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))
        hard = [
            Number(f"hard_iron[{i}]", x, x - e, x + e, quantity) for i, (x, e) in enumerate(zip(self.hard_iron[-1], error[-1], strict=True))
        ]
        rows = [(name, Number(name, float(getattr(self, name)), quantity=quantity)) for name in ("noise", "field")]
        rows.append(("drift after an hour", Number("drift", self.walk * 60, quantity=quantity)))
        rows.append(("one calibration for all costs", Number("cost", self.cost, quantity="angle")))
        path = {"time": ("s", self.time)}
        for name, values in (("hard_iron", self.hard_iron), ("error", error)):
            path |= {f"{name}_{axis}": (quantity, column) for axis, column in zip("xyz", values.T, strict=True)}
        return [by_axis("track", "at the end of the log", hard), listed("drift", "drift", rows), Curve("path", "path", path)]


@host_float64
def track(
    m: Checked[LogLike | Numbers], time: Samples | None = None, *, model: MagModel | None = None, field: float | int | None = None,
    inclination: float | None = None, limit: float = FINDINGS["heading"].limits[0],
) -> Track:  # fmt: skip
    r"""A hard iron that drifts during a long log (an underwater vehicle, a phone), with its error at each time.

    .. math:: |C^{-1}(m_i - b(t_i))| = H,\qquad b(t + \Delta) - b(t) \sim N(0, q \Delta I)

    The attitudes are unknown. The path b is a chain of at most 20,000 points; C is a symmetric soft iron, or given. Gauss-Newton steps of
    the whole log eliminate the chain (filter and smoother) in a time linear in the number of readings. The walk q maximises the likelihood
    in which path and C are integrated out (restricted maximum likelihood). A drift is believed only if the path predicts parts of the log
    that it did not see better than one calibration does: fields that differ from place to place look like a drift too. The errors assume
    that the noise of the readings is white.

    Parameters
    ----------
    m : (n, 3) readings; or a `Log`, or a path of one, with its times.
    time : (n,) s, increasing.
    model : a calibration whose soft iron holds, for a sensor that stays level or hardly turns; its hard iron is the start. By default the
        soft iron is estimated.
    field : magnitude of the field, in the unit of the readings; needed with `model`, and by default estimated without.
    inclination : dip of the field in rad; 57 degrees by default.
    limit : heading error in rad for which `interval` is stated.

    Returns
    -------
    Track

    Raises
    ------
    DataError
        If times do not increase ("time"), readings are not (n, 3) finite numbers, do not determine a path ("undetermined"), or
        `field` is missing beside `model` ("no_field").

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, scenario, track
    >>> m = body_field(scenario("all", samples=2000), 50.0) + 0.2 * np.random.default_rng(0).normal(size=(2000, 3))
    >>> track(m, np.arange(2000.0)).codes
    frozenset({'steady'})

    References
    ----------
    H. E. Rauch, F. Tung, C. T. Striebel, AIAA J. 3 (1965) 1445 (the smoother); D. A. Harville, J. Am. Stat. Assoc. 72 (1977) 320 (the
    restricted likelihood).
    """
    m, time = _timed(m, time)
    dip, basis = INCLINATION if inclination is None else float(inclination), SYMMETRIC.T.reshape(6, 3, 3)[: 6 if model is None else 0]
    if model is None:
        first = fit(m[:: max(len(m) // LONG, 1)], field=field, inclination=dip)
        if first.model is None or first.kind == "planar":
            raise DataError("The readings determine no soft iron: turn the sensor further, or give `model`.", code="undetermined")
        model, field = first.model, float(first.field if field is None else field)
    if field is None:
        raise DataError("With a `model`, give `field`, the magnitude of the field in the unit of the readings.", code="no_field")
    path = _Path(m, time, np.asarray(model.soft_iron) * field, np.asarray(model.hard_iron), basis)
    try:
        code = path.solve()
    except np.linalg.LinAlgError as error:
        raise DataError("The readings do not determine the hard iron: turn the sensor further.", code="undetermined") from error
    found, noise, matrix = path.found, path.noise, path.matrix
    spread = noise**2 * path.chain.variances(np.linalg.inv(found.information), found.carried)
    # headings see the path as corrected, in units of the field
    inverse, q = np.linalg.inv(matrix), path.ratio * noise**2
    seen, walked = path.points @ inverse.T / np.cos(dip), q * np.sum(inverse**2) / (3 * np.cos(dip) ** 2)
    cost, interval = float(np.sqrt(np.mean((seen - seen.mean(axis=0)) ** 2))), _interval(path.time, seen, walked, limit)
    facts = {"cost": cost, "angle": Quantity(cost, "angle"), "percent": 100 * np.sqrt(3600 * q) / field, "hours": interval / 3600}
    said = FINDINGS(code, severity=CAUTION if cost > limit else NOTE, **facts) if code == "drifts" else FINDINGS(code)
    return Track(
        path.time, path.points, spread, matrix / field, float(field), float(np.sqrt(q)), noise, dip, cost, interval, path.far, (said,)
    )


def _interval(time: np.ndarray, seen: np.ndarray, walked: float, limit: float) -> float:
    """Time in s after which headings are off by `limit`: by the walk, or in the log itself, where a trend may move them sooner."""
    even = np.linspace(time[0], time[-1], _WINDOWS + 1)
    points = np.stack([np.interp(even, time, axis) for axis in seen.T], axis=1)
    moved = [0.0, *(np.sqrt(np.mean((points[lag:] - points[:-lag]) ** 2)) for lag in range(1, len(even)))]
    return float(min(np.interp(limit, np.maximum.accumulate(moved), even - even[0], right=np.inf), limit**2 / walked))


def _timed(m: Any, time: Any) -> tuple[np.ndarray, np.ndarray]:
    """Readings (n, 3) and their times (n,) in s."""
    if time is None:
        log, m = mag_of(m)
        time = log.time + np.nan_to_num(log.offset.get("mag", 0.0))
        there = np.isfinite(m).all(axis=1)
        m, time = m[there], time[there]
    m, time = real_numbers(m, "the readings"), real_numbers(time, "the times")
    if time.shape != m.shape[:1] or m.shape[1:] != (3,) or not np.isfinite(m).all():
        raise DataError(f"The readings have shape {m.shape} and the times {time.shape}; expected (n, 3) finite and (n,).", code="bad_shape")
    if not np.all(np.diff(time) > 0):
        raise DataError("The times do not increase.", code="time")
    return m, time


class _Path:
    """Readings in blocks, one for each point of the path, with the present path (k, 3) and C."""

    def __init__(self, m: np.ndarray, time: np.ndarray, matrix: np.ndarray, hard: np.ndarray, basis: np.ndarray):
        width = -(-len(m) // LONG)
        count = len(m) // width  # the readings of a last block that is not full are left out
        self.m, self.time = m[: count * width].reshape(count, width, 3), time[: count * width].reshape(count, width).mean(axis=1)
        self.points, self.matrix, self.basis = np.tile(hard, (count, 1)), matrix, basis

    def sums(self) -> None:
        """Normal equations (k, w, w) of every block: hard iron, parameters of C, distance to the surface."""
        inverse = np.linalg.inv(self.matrix)
        y = (self.m - self.points[:, None]) @ inverse.T
        size = np.linalg.norm(y, axis=2, keepdims=True)
        y /= size
        normal = y @ inverse
        slope = np.linalg.norm(normal, axis=2, keepdims=True)
        normal /= slope
        others = (normal[..., None] * y[..., None, :]).reshape(*y.shape[:2], 9) @ self.basis.reshape(-1, 9).T
        rows = np.concatenate([normal, others, (size - 1) / slope], axis=2)
        self.far = outliers(rows[..., -1].ravel())
        rows.reshape(-1, rows.shape[2])[self.far] = 0.0
        self.blocks, self.freedom = np.swapaxes(rows, 1, 2) @ rows, self.m[..., 0].size - len(self.far) - 3 - len(self.basis)

    def solved(self, blocks: np.ndarray, ratio: float) -> tuple[Chain, Eliminated, np.ndarray, np.ndarray, float]:
        """The chain for q = `ratio` sigma^2, eliminated, the steps of the path and of C, and the sum of squares after them."""
        weight = 1 / (ratio * np.diff(self.time))
        links, change = blocks[:, :3, :3].copy(), weight[:, None] * np.diff(self.points, axis=0)
        eye = weight[:, None, None] * np.eye(3)
        links[:-1] += eye
        links[1:] += eye
        score = -blocks[:, :3, -1]
        score[:-1] -= change
        score[1:] += change
        total = blocks[:, 3:, 3:].sum(axis=0)
        chain = Chain(links, -eye, blocks[:, :3, 3:-1], total[:-1, :-1], score, -total[:-1, -1])
        found = chain.eliminated()
        step = -np.linalg.solve(found.information, found.score)
        moved = found.links(step)
        squares = total[-1, -1] + np.sum(change * np.diff(self.points, axis=0)) + np.sum(score * moved) + chain.score @ step
        return chain, found, moved, step, float(squares)

    def fall(self, log_ratio: float) -> float:
        """Minus twice the logarithm of the restricted likelihood, but for a constant."""
        _, found, _, _, squares = self.solved(self.blocks, np.exp(log_ratio))
        whole = found.log_determinant + np.linalg.slogdet(found.information)[1] + 3 * (len(self.time) - 1) * log_ratio
        return float(self.freedom * np.log(squares) + whole)

    def missed(self, log_ratio: float) -> float:
        """Sum of squares in every other window of the log, predicted from the rest."""
        left = np.arange(len(self.time)) * _WINDOWS // len(self.time) % 2 > 0
        _, _, moved, step, _ = self.solved(np.where(left[:, None, None], 0.0, self.blocks), np.exp(log_ratio))
        change = np.column_stack([-moved, np.tile(np.append(-step, 1.0), (len(left), 1))])[left]
        return float(np.einsum("ki,kij,kj->", change, self.blocks[left], change))

    def stepped(self, log_ratio: float) -> float:
        """A Gauss-Newton step with this walk, and its rms in units of the noise."""
        self.chain, self.found, moved, step, squares = self.solved(self.blocks, np.exp(log_ratio))
        self.noise, self.ratio = np.sqrt(squares / self.freedom), np.exp(log_ratio)
        self.points, self.matrix = self.points + moved, self.matrix + np.einsum("p,pij->ij", step, self.basis)
        return float(np.sqrt(np.mean(moved**2)) / self.noise)

    def solve(self) -> str:
        """Gauss-Newton steps, each with the most likely walk, and what that is: the code of a finding."""
        span = self.time[-1] - self.time[0]
        # from a drift in all the log that no reading shows, to one of the noise of a reading between neighbours
        low, high = np.log(0.01 / (self.m[..., 0].size * span)), np.log(len(self.time) / span)
        for _ in range(ROUNDS):
            self.sums()
            best = scipy.optimize.minimize_scalar(self.fall, bounds=(low, high), method="bounded", options={"xatol": 0.05})
            if self.stepped(best.x) < SETTLED:
                break
        clear = self.fall(low) - best.fun > _CLEAR
        if clear and self.missed(best.x) < self.missed(low):
            return "drifts"
        for _ in range(2):  # back to one hard iron; the second step is exact
            self.stepped(low)
            self.sums()
        return "disturbed" if clear else "steady"
