"""`rate_test`: calibrate a gyroscope from the raw log of a rate table."""

from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Grid, Message, Quantity, Result, Section, by_axis
from .._errors import DataError
from .._log import Log
from .._precision import host_float64
from .._types import AnyArray, Checked, Numbers
from ..evidence._rests import still_intervals
from ._findings import FINDINGS
from ._known import TriadFit, rate_table
from ._model import CONDITION, Triad
from ._recording import means
from ._result import LABELS
from ._scale import ScaleFigures, figure_numbers, scale_figures

_AXES = "xyz"
_TOLERANCE = 0.2  # relative error that an uncalibrated rate may have
_PIECES = 8  # parts of a stretch, whose scatter gives the noise of its mean with 7 degrees of freedom


class RateTest(Result):
    """Result of a rate-table test of a gyroscope.

    Attributes
    ----------
    fit : `TriadFit` of matrix, bias and, if the positions determine it, g-sensitivity; None unless every axis was turned both ways.
    figures : axis -> `ScaleFigures`.
    start, stop : (m,) samples of the stretches of constant rate; axis : (m,) index of the rotation axis, -1 at rest.
    rates : (m, 3) rates of the table, rad/s. readings : (m, 3) mean readings. sigma : (m, 3) their standard deviation from the noise
        within a stretch.
    findings : what to know about the test; the worst one gives the `verdict`.

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
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def gyro(self) -> Triad | None:
        """The gyroscope; None unless every axis was turned both ways."""
        return None if self.fit is None else self.fit.triad

    @property
    def headline(self) -> str:
        """The uncertainty of the scale factors, and the largest nonlinearity."""
        worst = max(self.figures, key=lambda axis: self.figures[axis].nonlinearity)
        said = f"{self.figures[worst].headline} about {worst}"
        return said if self.fit is None else f"{self.fit.headline}, {said}"

    def sections(self) -> list[Section]:
        """The parameters of the triad, and the figures of each axis."""
        found: list[Section] = []
        if self.fit is not None:
            found.append(by_axis("gyro", "gyroscope", self.fit.estimate.numbers("gyro."), LABELS))
        cells = {axis: figure_numbers(one, f"{axis}.") for axis, one in self.figures.items()}
        labels = dict.fromkeys(label for axis in cells.values() for label in axis)
        rows = tuple((label.rstrip(), tuple(one.get(label) for one in cells.values())) for label in labels)
        return [*found, Grid("figures", "scale factor", tuple(self.figures), rows)]


@host_float64
def rate_test(log: Checked[Log], rates: Numbers, *, latitude: float | None = None, servo: float = 0.0, raw: bool = False) -> RateTest:
    r"""Calibrate a gyroscope from the raw log of a rate table: the triad, and figures in ppm for each axis.

    The function finds the stretches of constant rate, fits their means as `rate_table` does, and describes each axis by `scale_figures`.

    Parameters
    ----------
    log : `jaxcal.Log` with a gyroscope. If it has an accelerometer in m/s^2 and each of the six faces was up, the g-sensitivity is fitted.
    rates : rates to which the table was set, rad/s, without sign. Axis and sign are taken from the gyroscope itself, so its scale must be
        correct to 20 %.
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
    if log.gyro is None or np.shape(log.gyro)[1:] != (3,):
        raise DataError("The log has no gyroscope with three axes, which a rate table calibrates.")
    gyro = log.usable("gyro", keep=("zeroed",))
    still = still_intervals({"gyro": gyro}, log.rate)
    start, stop = still.ends[still.stop - still.start >= 2 * _PIECES].T
    if not len(start):
        raise DataError("No stretch of constant rate is found; hold every rate for 3 s or more", code="no_stretch")
    readings = means(gyro, start, stop)
    set_to = _assigned(readings, rates, raw)
    parts = (np.array_split(gyro[a:b], _PIECES) for a, b in zip(start, stop, strict=True))
    sigma = np.array([np.std([np.nanmean(part, axis=0) for part in own], axis=0, ddof=1) for own in parts]) / np.sqrt(_PIECES)
    axis = np.where(np.any(set_to != 0, axis=1), np.argmax(np.abs(set_to), axis=1), -1)
    found: list[Finding] = []
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
    fit = None if missing else _fitted(log, start, stop, readings, set_to, latitude, servo, found)
    if missing:
        found.append(FINDINGS("one_way", tuple(f"gyro_{axis}" for axis in missing), axes=", ".join(missing)))
    if all(np.isnan(one.repeatability) for one in figures.values()):
        found.append(FINDINGS("no_repeats"))
    return RateTest(fit, figures, start, stop, axis, set_to, readings, sigma, (*found, *(() if fit is None else fit.findings)))


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
        facts = {"size": Quantity(abs(size[k]), "gyro"), "axis": _AXES[axis[k]], "largest": Quantity(known[-1], "gyro")}
        said = "a stretch reads {size:.4g} about {axis}, which is none of the rates, up to {largest:.4g}. Check {option.rates} and the unit"
        raise DataError(Message(said, **facts), code="no_such_rate")
    set_to = np.zeros((len(axis), 3))
    set_to[np.arange(len(axis)), axis] = np.sign(size) * nearest
    return set_to


def _fitted(
    log: Any, start: np.ndarray, stop: np.ndarray, readings: np.ndarray, set_to: np.ndarray, latitude: float | None, servo: float,
    found: list[Finding],
) -> TriadFit:  # fmt: skip
    """Fit the triad, with g-sensitivity if the accelerometer was in enough positions."""
    force = None if log.accel is None else means(np.asarray(log.accel, dtype=float), start, stop)
    if force is not None:
        columns = np.concatenate([set_to, np.ones((len(force), 1)), force], axis=1)
        size = np.linalg.svd(columns / np.linalg.norm(columns, axis=0), compute_uv=False)
        if size[0] > CONDITION * size[-1]:
            force = None
            found.append(FINDINGS("faces", "gyro"))
    if force is None and latitude is not None:
        said = Message("{option.latitude} needs the accelerometer with each of the six faces up, which shows where up is")
        raise DataError(said, code="no_up")
    return rate_table(readings, set_to, force, latitude=latitude, servo=servo)
