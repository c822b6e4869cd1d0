"""`rate_test`: calibrate a gyroscope from the raw log of a rate table; `scale_figures`: deviations from a straight line, in ppm."""

import re
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray
from ._known import TriadFit, rate_table
from ._model import Triad
from ._recording import means
from ._rests import static_intervals
from ._session import Region, listed

_AXES = "xyz"
#: multiples of the variance at rest that are tried; the motor of a table shakes more at higher rates
_MULTIPLES = (4, 10, 30, 100, 300, 1000)
_TOLERANCE = 0.2  # relative error that an uncalibrated rate may have
_PIECES = 8
_LEAST_REPEATS = 6  # with at least so many degrees of freedom, the scatter of repeated rates replaces `sigma`
_COLLINEAR = 1e-2
_LABEL = re.compile(r"([xyz])[ _]*([+-]?\d+(?:\.\d+)?)|(rest|still|pose|static)[ _-]?\d*", re.IGNORECASE)
_PPM = 1e6


class ScaleFigures(eqx.Module):
    """Deviations of one axis from a straight line, in ppm; NaN for a figure that the inputs cannot show.

    Attributes
    ----------
    scale, offset : least-squares line: reading per input, and reading at zero input.
    nonlinearity : largest deviation of the mean at any input from the line, relative to the output at the largest input.
    nonlinearity_noise : nonlinearity that noise alone exceeds in one of twenty tests.
    asymmetry : scale for positive inputs minus that for negative inputs, relative to their mean.
    asymmetry_interval : (2,) limits of the 95 % confidence interval.
    repeatability : standard deviation of the reading when an input is set again, relative to the output at the largest input.
    hysteresis : largest difference at one input between approach from below and from above, relative to the output at the largest input.
    hysteresis_noise : hysteresis that noise alone exceeds in one of twenty tests.
    residual : (m,) reading minus the line, relative to the output at the largest input, ppm.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import scale_figures
    >>> rate = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    >>> found = scale_figures(rate, 1.01 * rate + 1e-4 * rate**3, sigma=1e-6)
    >>> round(float(found.scale), 3), round(float(found.nonlinearity))
    (1.01, 119)
    """

    scale: float
    offset: float
    nonlinearity: float
    nonlinearity_noise: float
    asymmetry: float
    asymmetry_interval: AnyArray
    repeatability: float
    hysteresis: float
    hysteresis_noise: float
    residual: AnyArray


def _reach(freedom: float, number: int) -> float:
    """Size that the largest of `number` independent deviations exceeds with a probability of 5 %."""
    return float(scipy.special.stdtrit(freedom, 0.5 + 0.95 ** (1 / max(number, 1)) / 2))


@host_float64
def scale_figures(inputs: Any, readings: Any, sigma: Any = None) -> ScaleFigures:
    r"""Compute nonlinearity, asymmetry, repeatability and hysteresis of one axis, in ppm.

    .. math:: y_i = K\,x_i + y_0 + r_i,\qquad \text{nonlinearity} = \frac{\max_x|\bar r(x)|}{K\max|x|},\qquad
              \text{asymmetry} = \frac{2 (K_+ - K_-)}{K_+ + K_-}

    Parameters
    ----------
    inputs : (m,) rates or specific forces, in the order in which they were set, because hysteresis depends on the order. Repeated inputs
        show the repeatability.
    readings : (m,) mean readings.
    sigma : standard deviation of a mean reading, one or (m,); used if few inputs were repeated (less than 6 repetitions).

    Returns
    -------
    ScaleFigures

    Raises
    ------
    DataError
        If there are fewer than three different inputs, or neither repeated inputs nor `sigma` to give the noise.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import scale_figures
    >>> rate = np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
    >>> found = scale_figures(rate, 1.01 * rate + 1e-4 * rate**3, sigma=1e-6)
    >>> print(round(found.nonlinearity), round(found.asymmetry))
    119 0

    References
    ----------
    IEEE Std 952-1997 and Std 1431-2004 (scale factor tests), Std 1293-1998, and Std 528 for the words.
    """
    x, y = (np.asarray(part, dtype=float) for part in (inputs, readings))
    if x.ndim != 1 or x.shape != y.shape or not (np.isfinite(x).all() and np.isfinite(y).all()):
        raise DataError(f"inputs have shape {x.shape}, readings {y.shape}; expected finite numbers, (m,) both")
    levels, which, number = np.unique(x, return_inverse=True, return_counts=True)
    if len(levels) < 3:
        raise DataError(f"the inputs have {len(levels)} different values; a straight line is tested with three or more")
    mean = np.bincount(which, y) / number
    repeats = int(np.sum(number - 1))
    between = np.sum((y - mean[which]) ** 2)
    if sigma is None and repeats < 1:
        raise DataError("no input was set twice; give sigma=, the standard deviation of a mean reading, or repeat some inputs")
    spread = np.sqrt(between / repeats) if repeats else np.nan
    error, freedom = float(spread), float(repeats)
    if sigma is not None and repeats < _LEAST_REPEATS:
        error, freedom = float(np.sqrt(np.mean(np.square(sigma)))), np.inf
    columns = np.stack([x, np.ones_like(x)], axis=1)
    inner = np.linalg.inv(columns.T @ columns)
    scale, offset = inner @ columns.T @ y
    left, full = y - columns @ np.array([scale, offset]), scale * np.abs(x).max()
    level = np.stack([levels, np.ones_like(levels)], axis=1)
    open_ = error * np.sqrt(np.maximum(1 / number - np.einsum("ij,jk,ik->i", level, inner, level), 0))
    curved = np.abs(np.bincount(which, left) / number)
    asymmetry, interval = _asymmetry(x, y, error, freedom)
    hysteresis, least = _hysteresis(x, left, which, error, freedom)
    over = _PPM / abs(full)
    noise = _reach(freedom, len(levels) - 2) * float(open_.max())
    return ScaleFigures(
        float(scale), float(offset), float(curved.max() * over), noise * over, asymmetry, interval, float(spread * over),
        hysteresis * over, least * over, left * over,
    )  # fmt: skip


def _asymmetry(x: np.ndarray, y: np.ndarray, error: float, freedom: float) -> tuple[float, np.ndarray]:
    """Asymmetry in ppm with its interval; NaN if the inputs do not determine a scale for each sign and an offset."""
    columns = np.stack([np.maximum(x, 0), np.minimum(x, 0), np.ones_like(x)], axis=1)
    if np.linalg.matrix_rank(columns) < 3:
        return np.nan, np.full(2, np.nan)
    inner = np.linalg.inv(columns.T @ columns)
    up, down, _ = inner @ columns.T @ y
    apart = np.array([1.0, -1.0, 0.0])
    half = scipy.special.stdtrit(freedom, 0.975) * error * np.sqrt(apart @ inner @ apart)
    over = 2 * _PPM / (up + down)
    value = (up - down) * over
    return float(value), value + abs(half * over) * np.array([-1.0, 1.0])


def _hysteresis(x: np.ndarray, left: np.ndarray, which: np.ndarray, error: float, freedom: float) -> tuple[float, float]:
    """Largest difference between inputs reached from below and from above, and the largest difference that noise would give."""
    step = np.concatenate([[0.0], np.diff(x)])
    found = []
    for level in range(which.max() + 1):
        up, down = (left[(which == level) & side] for side in (step > 0, step < 0))
        if len(up) and len(down):
            found.append((abs(up.mean() - down.mean()), error * np.sqrt(1 / len(up) + 1 / len(down))))
    if not found:
        return np.nan, np.nan
    size, noise = np.array(found).T
    return float(size.max()), float(_reach(freedom, len(found)) * noise.max())


class RateTest(Result):
    """Result of a rate-table test of a gyroscope.

    Attributes
    ----------
    fit : `TriadFit` of matrix, bias and, if the positions determine it, g-sensitivity; None unless every axis was turned both ways.
    figures : axis -> `ScaleFigures`.
    start, stop : (m,) samples of the stretches of constant rate; axis : (m,) index of the rotation axis, -1 at rest.
    rates : (m, 3) rates of the table, rad/s. readings : (m, 3) mean readings. sigma : (m, 3) their standard deviation from the noise
        within a stretch.
    verdict : "good", or "weak" if an axis is missing or no rate was repeated.
    reason : sentences that explain the verdict. warnings : further sentences.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> set_to = [(axis, sign * size) for axis in range(3) for sign in (1, -1) for size in (1.0, 2.0, 1.0)]
    >>> w = np.concatenate([np.tile(rate * np.eye(3)[axis], (400, 1)) for axis, rate in set_to])
    >>> log = jaxcal.Log(None, gyro=1.01 * w + 1e-3 * np.random.default_rng(0).normal(size=w.shape), rate=100.0)
    >>> found = jaxcal.imu.rate_test(log, [1.0, 2.0])
    >>> len(found.rates), sorted(found.figures)
    (18, ['x', 'y', 'z'])
    """

    fit: TriadFit | None
    figures: dict[str, ScaleFigures]
    start: AnyArray
    stop: AnyArray
    axis: AnyArray
    rates: AnyArray
    readings: AnyArray
    sigma: AnyArray
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def gyro(self) -> Triad | None:
        """The gyroscope; None unless every axis was turned both ways."""
        return None if self.fit is None else self.fit.triad

    def _rows(self) -> list[Row]:
        rows = []
        for axis, one in self.figures.items():
            low, high = one.asymmetry_interval
            rows += [
                Row(f"{axis} scale", one.scale),
                Row(f"{axis} nonlinearity", one.nonlinearity, unit="ppm", remark=f"noise alone: up to {one.nonlinearity_noise:.2g}"),
                Row(f"{axis} asymmetry", one.asymmetry, low, high, "ppm"),
                Row(f"{axis} repeatability", one.repeatability, unit="ppm"),
                Row(f"{axis} hysteresis", one.hysteresis, unit="ppm", remark=f"noise alone: up to {one.hysteresis_noise:.2g}"),
            ]
        return [row for row in rows if np.isfinite(row.value)]


@host_float64
def rate_test(
    log: Any, rates: Any = None, *, regions: Any = None, latitude: float | None = None, servo: float = 0.0, raw: bool = False
) -> RateTest:
    r"""Calibrate a gyroscope from the raw log of a rate table: the triad, and figures in ppm for each axis.

    The function finds the stretches of constant rate, fits their means as `rate_table` does, and describes each axis by `scale_figures`.

    Parameters
    ----------
    log : `jaxcal.Log` with a gyroscope. If it has an accelerometer in m/s^2 and each of the six faces was up, the g-sensitivity is fitted.
    rates : rates to which the table was set, rad/s, without sign. Axis and sign are taken from the gyroscope itself, so its scale must be
        correct to 20 %.
    regions : instead of `rates`, (label, start, stop) of every stretch, in samples. A label is an axis and a rate in deg/s, such as
        "z +100", or "rest". `read_regions` reads them from a file.
    latitude : rad, to subtract the Earth's rate; this needs the accelerometer.
    servo : relative standard deviation of the table's rate.
    raw : True if the gyroscope is in counts; the largest rate then gives the scale.

    Returns
    -------
    RateTest

    Raises
    ------
    DataError
        If no stretch of constant rate is found, or the rate of a stretch is none of `rates`.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng = np.random.default_rng(0)
    >>> set_to = [(axis, sign * size) for axis in range(3) for sign in (1, -1) for size in (1.0, 2.0, 1.0)]
    >>> w = np.concatenate([np.tile(rate * np.eye(3)[axis], (400, 1)) for axis, rate in set_to])
    >>> log = jaxcal.Log(None, gyro=1.01 * w + 1e-3 * rng.normal(size=w.shape), rate=100.0)
    >>> found = jaxcal.imu.rate_test(log, [1.0, 2.0])
    >>> print(found.verdict, found.gyro.matrix.diagonal().round(3))
    good [1.01 1.01 1.01]

    References
    ----------
    IEEE Std 952-1997, section 12 (scale factor); IEEE Std 1431-2004.
    """
    gyro = None if getattr(log, "gyro", None) is None else np.asarray(log.gyro, dtype=float)
    if gyro is None or gyro.ndim != 2 or gyro.shape[1] != 3:
        raise DataError("The log has no gyroscope with three axes, which a rate table calibrates.")
    if (rates is None) == (regions is None):
        raise DataError("give either rates=, those that the table was set to, or regions=, a rate for every stretch")
    if regions is not None:
        start, stop, set_to = _labelled(listed(regions), len(gyro))
    else:
        found = static_intervals(gyro, log.rate, multiples=_MULTIPLES)
        start, stop = _apart(gyro, found.start, found.stop)
        set_to = _assigned(means(gyro, start, stop), rates, raw)
    readings = means(gyro, start, stop)
    pieces = np.stack([means(gyro, *_cut(start, stop, k)) for k in range(_PIECES)])
    sigma = np.std(pieces, axis=0, ddof=1) / np.sqrt(_PIECES)
    axis = np.where(np.any(set_to != 0, axis=1), np.argmax(np.abs(set_to), axis=1), -1)
    notes: list[str] = []
    figures = {}
    for i, name in enumerate(_AXES):
        turned = np.flatnonzero(axis == i)
        if len(turned) < 2:
            continue
        # use only rests with the same face up as in the turns, because g-sensitivity shifts the bias between faces
        here = np.zeros(len(axis), dtype=bool)
        here[max(turned[0] - 1, 0) : turned[-1] + 2] = True
        here &= (axis == i) | (axis == -1)
        if len(np.unique(set_to[here, i])) < 3:
            continue
        figures[name] = scale_figures(set_to[here, i], readings[here, i], sigma[here, i])
    if not figures:
        raise DataError("No axis was turned at two rates or more besides rest; set the table to several rates of both signs.")
    missing = [name for i, name in enumerate(_AXES) if not {1.0, -1.0} <= set(np.sign(set_to[axis == i, i]))]
    fit = None if missing else _fitted(log, start, stop, readings, set_to, latitude, servo, notes)
    weak = [f"Axis {', '.join(missing)} was not turned in both directions, so that there is no matrix."] if missing else []
    if all(np.isnan(one.repeatability) for one in figures.values()):
        weak.append("No rate was set twice: intervals know only the noise inside a stretch. Set some rates again.")
    worst = max(figures, key=lambda name: figures[name].nonlinearity)
    one = figures[worst]
    text = f"Nonlinearity up to {one.nonlinearity:.3g} ppm of the largest output, about {worst}"
    text = f"{text}; noise alone gives up to {one.nonlinearity_noise:.2g}."
    return RateTest(
        fit, figures, start, stop, axis, set_to, readings, sigma, "weak" if weak else "good", " ".join([*weak, text]),
        (*notes, *(fit.warnings if fit is not None else ())),
    )  # fmt: skip


def _cut(start: np.ndarray, stop: np.ndarray, piece: int) -> tuple[np.ndarray, np.ndarray]:
    """Start and stop of piece number `piece` of every stretch; all pieces have the same length."""
    length = (stop - start) / _PIECES
    return start + np.floor(piece * length).astype(int), start + np.floor((piece + 1) * length).astype(int)


def _apart(gyro: np.ndarray, start: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Keep the stretches that are long enough and not saturated: an axis that does not change at all is at the end of its range."""
    least = np.array([np.nanstd(gyro[i:j], axis=0).min() for i, j in zip(start, stop, strict=True)])
    kept = (stop - start >= 2 * _PIECES) & (least > 0)
    if not kept.any():
        raise DataError("No stretch of constant rate is found; hold every rate for 3 s or more, or give regions=")
    return start[kept], stop[kept]


def _assigned(readings: np.ndarray, rates: Any, raw: bool) -> np.ndarray:
    """(m, 3) rates of the table: to each stretch, assign the set rate that is nearest to its largest axis."""
    known = np.unique(np.abs(np.asarray(rates, dtype=float)))
    known = known[known > 0]
    if known.ndim != 1 or not len(known) or not np.isfinite(known).all():
        raise DataError(f"rates={rates!r}; expected the rates that the table was set to, in rad/s")
    rest = np.median(readings, axis=0)
    turned = readings - rest
    if raw:
        turned = turned * known[-1] / np.abs(turned).max()
    axis = np.argmax(np.abs(turned), axis=1)
    size = turned[np.arange(len(axis)), axis]
    with_rest = np.concatenate([[0.0], known])
    nearest = with_rest[np.argmin(np.abs(np.abs(size)[:, None] - with_rest), axis=1)]
    # the fastest stretch cannot be a rest: assigning it to zero means that the rates or the unit are wrong
    wrong = (np.abs(np.abs(size) - nearest) > _TOLERANCE * np.where(nearest > 0, nearest, known[0])) | (
        (np.abs(size) == np.abs(size).max()) & (nearest == 0)
    )
    if wrong.any():
        k = int(np.argmax(wrong))
        raise DataError(
            f"a stretch reads {abs(size[k]):.4g} rad/s about {_AXES[axis[k]]}, which is none of the rates {known.round(4).tolist()} rad/s. "
            "Check rates=, in rad/s, and the unit of the gyroscope"
        )
    set_to = np.zeros((len(axis), 3))
    set_to[np.arange(len(axis)), axis] = np.sign(size) * nearest
    return set_to


def _labelled(regions: list[Region], samples: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Start, stop and rates of labelled stretches, in order of time."""
    start, stop, set_to = [], [], []
    for label, first, last in sorted(regions, key=lambda region: region[1]):
        match = _LABEL.fullmatch(label.strip())
        if match is None:
            raise DataError(f"The label {label!r} is no rate; expected an axis and a rate in deg/s, such as z +100, or rest")
        if not 0 <= first < last <= samples or last - first < 2 * _PIECES:
            raise DataError(
                f"The region {label} goes from sample {first} to {last}; expected {2 * _PIECES} or more of the {samples} samples"
            )
        start.append(first)
        stop.append(last)
        set_to.append(np.zeros(3) if match[3] else np.deg2rad(float(match[2])) * np.eye(3)[_AXES.index(match[1].lower())])
    return np.array(start), np.array(stop), np.array(set_to)


def _fitted(
    log: Any, start: np.ndarray, stop: np.ndarray, readings: np.ndarray, set_to: np.ndarray, latitude: float | None, servo: float,
    notes: list[str],
) -> TriadFit:  # fmt: skip
    """Fit the triad, with g-sensitivity if the accelerometer was in enough positions."""
    force = None if log.accel is None else means(np.asarray(log.accel, dtype=float), start, stop)
    if force is not None:
        columns = np.concatenate([set_to, np.ones((len(force), 1)), force], axis=1)
        size = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
        if size[-1] < _COLLINEAR * size[0]:
            force = None
            notes.append("The faces up do not tell a g-sensitivity from the bias; turn with each of the six faces up to have one.")
    if force is None and latitude is not None:
        raise DataError("latitude= needs the accelerometer with each of the six faces up, which tells where up is")
    return rate_table(readings, set_to, force, latitude=latitude, servo=servo)
