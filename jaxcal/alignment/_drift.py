"""What a fit leaves out (host): drifts of the biases and a tilting base, what they change, and the order of positions that defeats them."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from .._answer import Finding, Quantity
from .._special import chi_square_tail, f_tail
from ..fitting import Estimate
from ._findings import FINDINGS, has_number
from ._positions import EARTH_RATE, ROUNDING, Readings, wrap
from ._result import AlignmentFit
from ._start import DRIFTS

#: parameters of what may change during the test; the twist is added where a smoother drift was found
_TILT, _SMOOTH, _TWIST = ("phi_rate", "theta_rate"), DRIFTS[::3] + DRIFTS[1::3], DRIFTS[2::3]
TERMS = frozenset((*_TILT, *DRIFTS))
_DEG_PER_HOUR = np.deg2rad(1.0) / 3600
_ENCODER = np.deg2rad(0.1)  # errors of a plain encoder or of angles set by hand
_OPPOSITE = 0.1  # rad: positions this close to a half turn apart are a pair
(_SHOWN,) = FINDINGS["drift"].limits


def checked(found: AlignmentFit, free: set[str], refit: Callable[..., AlignmentFit]) -> AlignmentFit:
    """A fit after a look for drifts: with those that the readings show; the errors hold those that they do not exclude.

    With the terms, the fit is x_1 +- C_1, without them x_0, whose error is then C_1 + (x_1 - x_0)(x_1 - x_0)' for whatever values of
    the terms the readings allow. x_0 is kept, because it is the better one without a drift.

    Parameters
    ----------
    found : the fit without terms. free : names of its free parameters.
    refit : (readings, free) -> fit of these readings with these free parameters, without such a look.
    """
    first, readings = found, found.readings
    if readings.parts is not None:
        readings = dataclasses.replace(readings.parts, accel_noise=readings.accel_noise, gyro_noise=readings.gyro_noise)
    inside = found.readings.parts is not None
    usable = lambda one: has_number(one.outcome) and not np.any(one.lost)  # noqa: E731
    allowed, lacking = np.zeros_like(found.covariance), False
    for sensor, group in (("accel", _TILT), ("gyro", _SMOOTH), ("gyro", _TWIST)):
        wanted = tuple(name for name in group if name in found.names)
        terms = _determined(readings, sensor, wanted)
        # without a given noise, and for a tilt, readings inside the rests decide: errors of the table's angles scatter the rests as well
        within = sensor == "accel" or not found.noise_known
        if not terms or not usable(found) or (group is _TWIST and free.isdisjoint(_SMOOTH)) or within > inside:
            continue
        full = refit(readings, free.union(terms))
        if not usable(full):
            continue
        # a drift that shows is seldom straight: the third power costs a sixth of the error in a good order
        if group is _TWIST or (_inside(found, readings, sensor, terms) if within else _level(full, terms)) < _SHOWN:
            found, free, lacking = full, free.union(terms), lacking or len(terms) < len(wanted)
        elif found.noise_known:
            change, keep = _change(found, full), np.isin(found.names, list(free))
            allowed += np.where(np.outer(keep, keep), full.covariance - found.covariance + np.outer(change, change), 0.0)
    old, more = found.estimate, _order(first) + _exact(first)
    said, states = _said(first, found, free), old.states
    if not free.isdisjoint(_SMOOTH) and (lacking or "misfit" in found.codes):
        said, states = [FINDINGS("drift_open", "gyro"), *said], states | {"psi": "open"}
    estimate = Estimate(old.names, old.values, old.matrix + allowed, old.freedom, states, old.quantities)
    return dataclasses.replace(found, estimate=estimate, findings=(*found.findings, *said, *more))


def _determined(readings: Readings, sensor: str, terms: tuple[str, ...]) -> tuple[str, ...]:
    """The terms that readings of a sensor determine beside offset and two harmonics; of a drift, the rates at least."""
    values, channel = getattr(readings, sensor), readings.positions.channel
    spare = 0 if values is None else np.count_nonzero(np.isfinite(np.asarray(values)) & (channel == 0)) - 3
    axes = 1 + int(np.any(channel > 0))
    return terms if spare * axes >= len(terms) else terms[:axes] if spare > 0 else ()


def _change(found: AlignmentFit, full: AlignmentFit) -> np.ndarray:
    """(p,) change of the parameters by the terms."""
    change = np.asarray(full.estimate.values) - np.asarray(found.estimate.values)
    return np.concatenate([wrap(change[:3]), change[3:]])


def _level(full: AlignmentFit, terms: tuple[str, ...]) -> float:
    """Probability of such terms by chance."""
    at = [full.names.index(term) for term in terms]
    values, root = np.asarray(full.estimate.values)[at], np.sqrt(np.diag(full.covariance)[at])
    correlation = np.asarray(full.covariance)[np.ix_(at, at)] / np.outer(root, root)
    return float(chi_square_tail(float(values / root @ np.linalg.solve(correlation, values / root)), len(at)))


def _inside(found: AlignmentFit, parts: Readings, sensor: str, terms: tuple[str, ...]) -> float:
    """Probability by chance of what the terms explain of the changes inside the rests."""
    size = 1e-3 * _DEG_PER_HOUR  # of a term, in SI: the readings are linear in them
    models = [found.model, *(dataclasses.replace(found.model, **{term: getattr(found.model, term) + size}) for term in terms)]
    made = np.array([one.measure(parts.positions)[sensor == "gyro"] for one in models])
    y, rows = np.asarray(getattr(parts, sensor)) - made[0], ((made[1:] - made[0]) / size).T
    rest = len(parts.positions) // len(np.unique(found.readings.positions.start))
    label = np.arange(len(y)) // rest * 3 + parts.positions.channel
    here = np.isfinite(y)
    part = (label[here, None] == np.unique(label[here])).astype(float)
    clear = lambda x: x - part @ (part.T @ x / part.sum(axis=0).reshape(-1, *[1] * (x.ndim - 1)))  # noqa: E731
    y, rows = clear(y[here]), clear(rows[here])
    rows = rows / np.maximum(np.linalg.norm(rows, axis=0), ROUNDING)
    explained = rows @ np.linalg.lstsq(rows, y, rcond=None)[0]
    square, left, freedom = float(np.sum(explained**2)), float(np.sum((y - explained) ** 2)), len(y) - part.shape[1] - len(terms)
    variance = parts.variance(sensor)
    if variance is not None:
        return float(chi_square_tail(square / float(np.mean(np.asarray(variance)[here])), len(terms)))
    return float(f_tail(square / len(terms) / (left / freedom), len(terms), freedom)) if freedom > 0 else 1.0


def _said(first: AlignmentFit, found: AlignmentFit, free: set[str]) -> list[Finding]:
    """Findings about the terms that were added to the first fit."""
    places, change = found.readings.positions, _change(first, found)
    time = float(np.max(places.start + places.dwell) - np.min(places.start))
    size = {name: abs(float(found.estimate.values[found.names.index(name)])) * time for name in TERMS & free}
    said = []
    if not free.isdisjoint(_SMOOTH):
        largest = max(size[name] for name in _SMOOTH if name in size)
        said.append(FINDINGS("drift", "gyro", size=Quantity(largest, "B.gyro"), change=Quantity(abs(float(change[2])), "angle")))
    if not free.isdisjoint(_TILT):
        off = Quantity(math.hypot(*change[:2]), "angle")
        said.append(FINDINGS("tilt", "accel", tilt=Quantity(math.hypot(*(size[name] for name in _TILT)), "angle"), change=off))
    return said


def _order(found: AlignmentFit) -> list[Finding]:
    """What a drift of the gyro's bias does to the azimuth, and the order of positions that it hurts less."""
    places = found.readings.positions
    if found.parameters.get("psi") is None or found.readings.gyro is None:
        return []
    here = np.isfinite(np.asarray(found.readings.gyro)) & np.isin(places.mounting, ["x", "y"])
    angle, time, axis = np.asarray(places.angle)[here], np.asarray(places.start + places.dwell / 2)[here], places.channel[here]
    order = there_and_back(angle[axis == axis.min(initial=1)])
    if len(order) < 4 or len(np.unique(time)) < 2:  # not two angles
        return []
    now, then = _sensitivity(angle, time, axis), _sensitivity(order, np.arange(len(order)), 0 * order)
    size = Quantity(now / float(np.cos(found.latitude)), "angle")
    return FINDINGS.over("drift_order", now / then, size=size, order=", ".join(f"{round(x, 1):g}" for x in np.rad2deg(order)))


def _exact(found: AlignmentFit) -> list[Finding]:
    """What errors of the table's angles would do that are not given."""
    places, known = found.readings.positions, found.parameters
    if places.angle_std is not None or not found.noise_known or None in (known.get("phi"), known.get("theta")):
        return []
    each = _ENCODER / np.sqrt(len(np.unique(places.start)))
    level, azimuth = np.hypot(found.phi, found.theta) * each, each * ("psi" in known)
    ratio = max(level / max(found.std["phi"], found.std["theta"]), azimuth / max(found.std.get("psi", np.inf), ROUNDING))
    return FINDINGS.over("angles_exact", ratio, level=Quantity(float(level), "angle"), azimuth=Quantity(float(azimuth), "angle"))


def there_and_back(angle: np.ndarray) -> np.ndarray:
    """Table angles in the order a, a + 180, a + 180, a for each pair of opposite ones, or all forth and back.

    Of the 2,520 orders of twice 0, 90, 180 and 270 degrees, it leaves least of a linear drift, of a quadratic one and of a step.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment._drift import there_and_back
    >>> np.rad2deg(there_and_back(np.deg2rad([0, 90, 180, 270]))).round()
    array([  0., 180., 180.,   0.,  90., 270., 270.,  90.])
    """
    distinct = np.unique(np.round(np.mod(angle, 2 * np.pi), 3))
    pairs = [(a, b) for a in distinct for b in distinct if a < b and abs(b - a - np.pi) < _OPPOSITE]
    forth = [(a, b, b, a) for a, b in pairs] if 2 * len(pairs) == len(distinct) else [distinct, distinct[::-1]]
    return np.concatenate(forth)


def _sensitivity(angle: np.ndarray, time: np.ndarray, axis: np.ndarray) -> float:
    """Largest change of the azimuth (rad) at the equator if a bias of the gyro changes by 1 deg/h: evenly in time, or in one step."""
    turn = np.exp(1j * (angle + np.pi / 2 * (axis > 0)))  # gain of a reading: both harmonics of the Earth's rate
    shapes = [(time - time.min()) / np.ptp(time), *(time >= moment for moment in np.unique(time)[1:])]
    each = [abs(np.sum((turn * (shape - shape[axis == i].mean()))[axis == i])) for shape in shapes for i in np.unique(axis)]
    return 2 * float(max(each)) / len(turn) / EARTH_RATE * _DEG_PER_HOUR
