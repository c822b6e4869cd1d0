"""What a fit leaves out (host): drifts of the gyro, a tilting base and errors of the angles, what they change, and a better order."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from .._answer import Finding, Quantity
from .._arrays import padded as long
from .._special import chi_square_tail, student_quantile
from ..fitting import Estimate
from ..fitting._missing import LEVEL, Missing, missing
from ._findings import FINDINGS, has_number
from ._model import Table, residuals, tabulate, turned, with_angle_errors, with_values
from ._noise import SENSORS
from ._positions import EARTH_RATE, ROUNDING, SMALL, Readings, wrap
from ._result import AlignmentFit, sizes_of

_DEG_PER_HOUR = np.deg2rad(1.0) / 3600
#: standard deviations of a table's angles, from those set by hand to those of an encoder (11 arcsec). Where none is given, each is as
#: probable as it is large: a uniform density up to 0.2 degrees (A. Gelman, Bayesian Analysis 1, 2006, 515)
_ENCODER = np.deg2rad(0.2) / 2.0 ** np.arange(7)
_OPPOSITE = 0.1  # rad: positions this close to a half turn apart are a pair
_PASSES = 2  # of the linear search for terms: about the answer without them, and about that with them
(_MISFIT,) = FINDINGS["misfit"].limits


def checked(
    found: AlignmentFit, table: Table, gravity: Any, noise: dict, spare: dict[str, float] | None, refit: Callable[..., AlignmentFit]
) -> AlignmentFit:
    """A fit after a look for what it leaves out: with what the readings show; its errors allow for what they nearly show.

    A term that the model lacks is there with the odds LEVEL / `Missing.level`, which are even where a term counts as shown. The covariance
    is that of the mixture of all answers, about the most probable one. Both grow and shrink with the noise. A noise that comes from the
    residuals holds a drift already, but not errors of the angles, which are larger at some angles than at others.

    Parameters
    ----------
    found : the fit. table, gravity, noise : what it was fitted to, with the noise of each sensor.
    spare : sensor -> degrees of freedom of its residuals; None if the caller says what drifts.
    refit : (readings, start) -> fit of these readings, without such a look; a sensor without a noise takes that of its residuals.
    """
    said, spare = ([], {}) if spare is None else (_order(found), spare if found.noise_known else {})
    if not has_number(found.outcome) or np.any(found.lost):
        return dataclasses.replace(found, findings=(*found.findings, *said))
    first, readings, look = found, found.readings, _Look(found, table, gravity, noise)
    states, allowed, effect = dict(found.estimate.states), np.zeros_like(found.covariance), np.zeros((2, len(found.readings.positions)))
    for sensor in spare:
        best, more = look.searched(sensor, _log_tail(getattr(found, f"{sensor}_residual"), spare[sensor]))
        allowed[np.ix_(look.free, look.free)] += more
        if best is None:
            continue
        inside = look.terms[sensor][best.name] @ best.coefficient
        added = inside.reshape(2, look.rests, -1, effect.shape[1] // look.rests).mean(axis=2).reshape(2, -1)
        effect, change = effect + added, look.values - np.asarray(first.estimate.values)
        if sensor == "accel":
            tilt = Quantity(math.hypot(*best.coefficient) * float(np.ptp(readings.positions.time)), "angle")
            said.insert(0, FINDINGS("tilt", tilt=tilt, change=Quantity(math.hypot(*change[:2]), "angle")))
        else:
            size, change = Quantity(float(np.ptp(added[1])), "B.gyro"), Quantity(abs(float(wrap(change[2]))), "angle")
            said.insert(0, FINDINGS("drift", sensor, size=size, change=change))
            # the form of the drift stays open where it explains too little, and where there are too few readings to see that
            rows = look.rows(look.values)
            if _log_tail(rows, float(np.count_nonzero(rows) - len(look.free))) < np.log(LEVEL) or "power 2" not in look.terms[sensor]:
                said.insert(0, FINDINGS("drift_open", sensor))
                states["psi"] = "open"
    begin = {found.names[i]: look.values[i] for i in look.free}
    if np.any(effect):
        less = {name: own - more for name, more in zip(SENSORS, effect, strict=True) if (own := getattr(readings, name)) is not None}
        found = refit(dataclasses.replace(readings, **less), begin)
    own, wide = found.estimate, found.estimate
    if "misfit" in found.codes:
        off = [name for name in spare if _log_tail(getattr(found, f"{name}_residual"), spare[name]) < np.log((1 - _MISFIT) / len(SENSORS))]
        wide = refit(dataclasses.replace(found.readings, **{f"{name}_noise": None for name in off}), begin).estimate
    made = lambda matrix: Estimate(own.names, own.values, matrix, wide.freedom, own.states | states, own.quantities)  # noqa: E731
    estimate = made(wide.matrix + allowed)
    if readings.positions.angle_std is None:
        # the degrees of freedom are those of the noise: what the angles add to an interval has none
        narrow = student_quantile(np.inf, 0.975) / student_quantile(wide.freedom, 0.975)
        exact, estimate = estimate, made(estimate.matrix + look.angles() * np.outer(narrow, narrow))
        least, most = (np.diff(one.intervals(), axis=1)[:3, 0] / 2 for one in (exact, estimate))
        level, azimuth = Quantity(float(max(least[:2])), "angle"), Quantity(float(least[2]), "angle")
        if "misfit" not in found.codes and np.all(np.isfinite(most)):
            said += FINDINGS.over("angles_open", np.max(most / np.maximum(least, ROUNDING)), level=level, azimuth=azimuth)
    return dataclasses.replace(found, estimate=estimate, readings=readings, findings=(*found.findings, *said))


class _Look:
    """Search for terms that the model of a fit lacks, in the readings inside the rests where they are known.

    Attributes
    ----------
    values : (p,) parameters, with the terms that were found. free : places of those that are estimated.
    data : readings without these terms. terms : sensor -> term -> (2, n, q) its effect on these. rests : number of rests.
    turned : (2, n, rests) effect of an error of the angle of each rest, per rad. places : (rests,) angles in whole degrees.
    """

    def __init__(self, found: AlignmentFit, table: Table, gravity: Any, noise: dict[str, Any]):
        readings = found.readings
        parts = readings if readings.parts is None else readings.parts
        self.model, self.free, self.values = found.model, np.flatnonzero(found.free), np.array(found.estimate.values)
        self._known: tuple[np.ndarray, np.ndarray] | None = None
        self.sizes = np.asarray(sizes_of(found.names, gravity, readings.positions))
        begin, first = np.unique(np.asarray(readings.positions.start), return_index=True)
        self.terms, self.rests = _terms(found, parts, gravity), len(begin)
        self.places = whole(readings.positions.angle)[first]
        data = tabulate(parts, gravity, list(noise.values()), table.prior, table.certainty)
        rest = np.searchsorted(begin, np.asarray(parts.positions.start) + SMALL) - 1
        each = np.stack(turned(found.model, parts.positions, gravity, parts.lever_arm))
        self.turned = each[:, :, None] * np.eye(self.rests)[rest]
        self.data = with_angle_errors(data, found.model, parts.positions, gravity, parts.lever_arm)

    def rows(self, values: np.ndarray) -> np.ndarray:
        """Whitened residuals at these parameters."""
        return np.asarray(residuals(with_values(self.model, values), self.data))

    def searched(self, sensor: str, scattered: float) -> tuple[Missing | None, np.ndarray]:
        """The term of a sensor that the readings show, which moves into `values` and `data`; and what the others add to the covariance.

        `scattered` is the logarithm of the probability of the residuals: where errors at each position alone explain more, nothing shows.
        """
        terms, best = self.terms[sensor], None
        for _ in range(_PASSES):
            rows, slope = self.rows(self.values), self._slope()
            made = {name: self._moved(effect, len(rows)) for name, effect in terms.items()}
            tried = [one for one in missing(rows, slope, made, 1.0) if np.all(np.isfinite(one.covariance))]
            none = max(0.0, np.log(LEVEL / max(len(terms), 1)) - scattered)
            odds = np.array([none, *(np.log(LEVEL) - one.log_level for one in tried)])
            at = int(np.argmax(odds))
            if not at:
                break
            best = tried[at - 1]
            self.values[self.free] += best.shift - np.linalg.lstsq(slope, rows)[0]
        share = np.exp(odds - odds[at]) / np.sum(np.exp(odds - odds[at]))
        shift = np.array([np.zeros(len(self.free)), *(one.shift for one in tried)])
        allowed = np.einsum("k,ki,kj->ij", share, shift - shift[at], shift - shift[at])
        allowed += sum(weight * one.change @ one.covariance @ one.change.T for weight, one in zip(share[1:], tried, strict=True))
        if at and best is not None:
            effect = np.stack([long(one, self.data.readings.shape[1]) for one in terms[best.name] @ best.coefficient])
            self.data = dataclasses.replace(self.data, readings=self.data.readings - effect)
        return best if at else None, allowed

    def _slope(self) -> np.ndarray:
        """Derivative of the whitened residuals by the free parameters, as long as no term moves these."""
        if self._known is None or not np.array_equal(self._known[0], self.values):
            here, steps = self.rows(self.values), np.diag(SMALL * self.sizes)[self.free]
            self._known = self.values.copy(), np.stack([(self.rows(self.values + h) - here) / h.max() for h in steps], axis=1)
        return self._known[1]

    def _moved(self, effect: np.ndarray, length: int) -> np.ndarray:
        """Change of the whitened residuals by effects (2, n, q), (length, q); none of those of priors."""
        off, weight = np.concatenate([long(one, self.data.readings.shape[1]) for one in effect]), self.data.weight
        return long(-(weight[:, None] * off if weight.ndim == 1 else weight @ off), length, 0.0)

    def angles(self) -> np.ndarray:
        """(p, p) what errors of the table's angles add to the covariance, by what the residuals leave possible.

        Errors are of their own at each rest, or the same ones at the same angle, of which repeated readings show nothing: both are equally
        probable.
        """
        rows, slope = self.rows(self.values), self._slope()
        made, basis = self._moved(self.turned, len(rows)), np.linalg.qr(slope)[0]
        likely, added = [], []
        for which in (np.eye(self.rests), self.places[:, None] == np.unique(self.places)):
            effect, change = made @ which, np.zeros((len(self.values), which.shape[1]))
            change[self.free] = np.linalg.lstsq(slope, effect)[0]
            shapes, size, _ = np.linalg.svd(effect - basis @ (basis.T @ effect), full_matrices=False)
            larger = 1 + np.multiply.outer(_ENCODER**2, size**2)
            likely.append(np.sum((1 - 1 / larger) * (shapes.T @ rows) ** 2 - np.log(larger), axis=1) / 2 + np.log(_ENCODER))
            added.append(np.multiply.outer(_ENCODER**2, change @ change.T))
        share = np.exp(np.concatenate(likely) - np.max(np.concatenate(likely)))
        return np.tensordot(share / share.sum(), np.concatenate(added), 1)


def _log_tail(rows: np.ndarray, freedom: float) -> float:
    """Logarithm of the probability of larger residuals; its leading part where the number is too small."""
    square = float(np.sum(np.asarray(rows) ** 2))
    level = chi_square_tail(square, max(round(freedom), 1))
    return float(np.log(level)) if level > 0 else -square / 2


def _terms(found: AlignmentFit, parts: Readings, gravity: Any) -> dict[str, dict[str, np.ndarray]]:
    """Sensor -> term -> (2, n, q) change of the readings of accelerometer and gyro for a unit of each of its coefficients."""
    places, model, terms = parts.positions, found.model, {name: {} for name in SENSORS}
    time, channel = np.asarray(places.time), places.channel
    # what offset and two harmonics leave over
    read = {name: np.asarray(np.nan if (own := getattr(parts, name)) is None else own) for name in SENSORS}
    spare = {name: np.count_nonzero(np.isfinite(own) & (channel == 0)) - 3 for name, own in read.items()}
    if spare["accel"] > 2:
        ends = ((dataclasses.replace(model, **{name: getattr(model, name) + h}) for h in (SMALL, -SMALL)) for name in ("phi", "theta"))
        slope = np.stack([up.measure(places, gravity=gravity)[0] - down.measure(places, gravity=gravity)[0] for up, down in ends], axis=-1)
        accel = slope / (2 * SMALL) * time[:, None]  # it tilts the Earth's rate as well, by nothing that a gyro sees
        terms["accel"]["tilt"] = np.stack([accel, np.zeros_like(accel)])
    # a drift that shows is seldom straight
    most, part = min(spare["gyro"], 4), time / np.abs(time).max()
    shapes = {f"power {n}": [part**k for k in range(1, n + 1)] for n in range(min(most, 2), most + 1) if n > 0}
    moments = np.unique(found.readings.positions.start)[1:] if most > 0 else []
    shapes |= {f"step {i + 1}": [1.0 * (np.asarray(places.start) > moment - SMALL)] for i, moment in enumerate(moments)}
    for name, columns in shapes.items():
        gyro = np.stack([column * (channel == axis) for column in columns for axis in np.unique(channel[channel < 2])], axis=-1)
        terms["gyro"][name] = np.stack([np.zeros_like(gyro), gyro])
    return terms


def _order(found: AlignmentFit) -> list[Finding]:
    """What a drift of the gyro's bias does to the azimuth, and the order of positions that it hurts less."""
    places = found.readings.positions
    if found.parameters.get("psi") is None or found.readings.gyro is None:
        return []
    here = np.isfinite(np.asarray(found.readings.gyro)) & np.isin(places.mounting, ["x", "y"])
    angle, time, axis = np.asarray(places.angle)[here], np.asarray(places.start + places.dwell / 2)[here], places.channel[here]
    order = there_and_back(angle[axis == axis.min(initial=1)])
    if len(order) < 2 or len(np.unique(time)) < 2:  # not two angles
        return []
    whole_order = np.concatenate([order, order[::-1]])
    now, then = _sensitivity(angle, time, axis), _sensitivity(whole_order, np.arange(len(whole_order)), 0 * whole_order)
    size = Quantity(now / float(np.cos(found.latitude)), "angle")
    return FINDINGS.over("drift_order", now / then, size=size, order=", ".join(f"{x:g}" for x in whole(order)))


def there_and_back(angle: np.ndarray) -> np.ndarray:
    """First half of the best order of table angles, which the second half reverses: a, a + 180, a + 180, a for each pair, or each once.

    Of the 2,520 orders of twice 0, 90, 180 and 270 degrees, it leaves least of a linear drift, of a quadratic one and of a step. Reversed,
    it leaves a quarter of a quadratic drift, and of a base that tilts evenly nothing.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment._lack import there_and_back
    >>> np.rad2deg(there_and_back(np.deg2rad([0, 90, 180, 270]))).round()
    array([  0., 180., 180.,   0.,  90., 270., 270.,  90.])
    """
    distinct = np.deg2rad(np.unique(whole(angle)))
    pairs = [(a, b) for a in distinct for b in distinct if a < b and abs(b - a - np.pi) < _OPPOSITE]
    return np.ravel([(a, b, b, a) for a, b in pairs]) if 2 * len(pairs) == len(distinct) else distinct


def whole(angle: Any) -> np.ndarray:
    """Angles (rad) in whole degrees, from 0 to 359."""
    return np.mod(np.round(np.rad2deg(np.asarray(angle))), 360)


def _sensitivity(angle: np.ndarray, time: np.ndarray, axis: np.ndarray) -> float:
    """Largest change of the azimuth (rad) at the equator if a bias of the gyro changes by 1 deg/h: evenly in time, or in one step."""
    turn = np.exp(1j * (angle + np.pi / 2 * (axis > 0)))  # gain of a reading: both harmonics of the Earth's rate
    shapes = [(time - time.min()) / np.ptp(time), *(time >= moment for moment in np.unique(time)[1:])]
    each = [abs(np.sum((turn * (shape - shape[axis == i].mean()))[axis == i])) for shape in shapes for i in np.unique(axis)]
    return 2 * float(max(each)) / len(turn) / EARTH_RATE * _DEG_PER_HOUR
