"""`motion`: delay and lever arms of the sensors, from the specific force during the turns."""

from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Quantity, Result, Section, by_axis
from .._arrays import from_vector, skew
from .._errors import DataError
from .._log import LogLike
from .._precision import host_float64
from .._types import Numbers
from ..fitting import Estimate
from ._findings import FINDINGS
from ._model import Imu
from ._recording import given_rests, means, recording
from ._result import ImuFit

LEAST = 14  # turns: enough for ten parameters and their errors


class Motion(Result):
    """Delay of the gyroscope and lever arms of the accelerometer's axes.

    Attributes
    ----------
    delay : delay of the gyroscope relative to the accelerometer, s; positive if the gyroscope is later.
    lever_arm : (3, 3) m: row i is the position of accelerometer axis i relative to the centre of the turns. Differences between rows are
        the distances between the axes.
    estimate : `jaxcal.fitting.Estimate` of "delay" and "lever_arm[i,j]".
    turns : number of turns.
    residual : rms of the remaining specific force, m/s^2: linear acceleration of the hand.
    findings : what to know about the estimate; the worst one gives the `verdict`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import MEMS, motion, simulate
    >>> log = simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    >>> ends = np.array([[0, 1500]] + [[1600 + 250 * k, 1750 + 250 * k] for k in range(17)])
    >>> found = motion(log, MEMS, gravity=9.81, rests=ends)
    >>> found.turns, found.lever_arm.shape
    (17, (3, 3))
    """

    estimate: Estimate
    turns: int
    residual: float
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def delay(self) -> float:
        """Delay of the gyroscope relative to the accelerometer, s."""
        return float(self.estimate["delay"].value)

    @property
    def lever_arm(self) -> np.ndarray:
        """(3, 3) positions of the accelerometer's axes, m."""
        return np.asarray(self.estimate.select("lever_arm*").values).reshape(3, 3)

    @property
    def headline(self) -> str:
        """The delay, with half of its 95 % interval."""
        return f"gyroscope {1e3 * self.delay:.2g} ± {1e3 * self.estimate['delay'].half:.2g} ms later than the accelerometer"

    def sections(self) -> list[Section]:
        """The delay, and the lever arm of each axis of the accelerometer."""
        return [by_axis("motion", "delay and lever arms", self.estimate.numbers(), {"delay": "delay of the gyroscope"})]


@host_float64
def motion(log: LogLike, found: ImuFit | Imu, *, gravity: float | int | None = None, rests: Numbers | None = None) -> Motion:
    r"""Estimate the delay between gyroscope and accelerometer, and the accelerometer's lever arms, from the turns of a calibration.

    During a turn the gyroscope predicts the direction of gravity. The accelerometer measures in addition

    .. math:: f - g u = \tau\, g\,(u\times\omega) + e_i^T(\dot\omega\times r_i + \omega\times(\omega\times r_i)) + \ldots

    where the dots stand for the linear acceleration of the hand, which is treated as noise. The ten numbers are fitted by least squares;
    their intervals come from a jackknife over the turns.

    Parameters
    ----------
    log : `jaxcal.Log` of the calibration.
    found : the `ImuFit` of that log, or an `Imu` of calibrated sensors.
    gravity : m/s^2; None uses that of the `ImuFit`.
    rests : (k, 2) first sample of each rest and the one after its last; None uses those of the `ImuFit`.

    Returns
    -------
    Motion

    Raises
    ------
    DataError
        If the fit has no gyroscope, the log has fewer than 14 usable turns, or gravity or rests are missing for an `Imu`.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> from jaxcal.imu import MEMS, motion, simulate
    >>> log = simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    >>> ends = np.array([[0, 1500]] + [[1600 + 250 * k, 1750 + 250 * k] for k in range(17)])
    >>> print(abs(motion(log, MEMS, gravity=9.81, rests=ends).delay) < 2e-3)
    True

    References
    ----------
    J. Rehder et al., ICRA 2016 (lever arms of single axes); R. G. Miller, Biometrika 61 (1974) 1 (jackknife).
    """
    if isinstance(found, ImuFit):
        gravity = found.gravity if gravity is None else gravity
        if rests is None and found.still is not None:
            rests = found.still.ends
        found = Imu(found.accel, found.gyro)
    if found.accel is None or found.gyro is None:
        raise DataError("There is no calibrated gyroscope; delay and lever arms need both sensors.", code="no_gyro")
    if gravity is None or rests is None:
        raise DataError("Give gravity= and rests=, or the ImuFit of the log, which has both.", code="no_rests")
    record, size = recording(log), float(gravity)
    start, stop = given_rests(rests, len(record.time))
    readings = np.asarray(record.bridged)
    force = np.asarray(found.accel.correct(readings[:, 3:]))
    rate = np.asarray(found.gyro.correct(readings[:, :3], force))
    up = np.asarray(found.accel.correct(means(record.accel, start, stop)))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    products = [
        made
        for k, (i, j) in enumerate(zip(stop[:-1] - 1, start[1:], strict=True))
        if j - i > 5 and np.isfinite(rate[i : j + 1]).all() and np.isfinite(force[i : j + 1]).all()
        for made in [_products(record.time[i : j + 1], force[i : j + 1], rate[i : j + 1], up[k], size)]
    ]
    count = len(products)
    if count < LEAST:
        raise DataError(f"{count} turns can be used, {LEAST} are needed for delay and lever arms; record 18 poses or more")
    inner, right, square, number = (np.array(part) for part in zip(*products, strict=True))
    whole = np.linalg.solve(inner.sum(axis=0), right.sum(axis=0))
    without = np.linalg.solve(inner.sum(axis=0) - inner, (right.sum(axis=0) - right)[..., None])[..., 0]
    error = np.sqrt((count - 1) / count * np.sum((without - without.mean(axis=0)) ** 2, axis=0))
    names = ("delay", *(f"lever_arm[{i},{j}]" for i in range(3) for j in range(3)))
    estimate = Estimate(names, whole, np.diag(error**2), count - 1, None, {"delay": "delay", "lever_arm": "length"})
    left = square.sum() - whole @ right.sum(axis=0)
    half = estimate["delay"].half
    findings = () if half < 1 / record.rate else (FINDINGS("delay_unsure", cost=half, half=Quantity(half, "delay")),)
    return Motion(estimate, count, float(np.sqrt(max(left, 0.0) / number.sum())), findings)


def _products(time: np.ndarray, force: np.ndarray, rate: np.ndarray, up: np.ndarray, gravity: float) -> tuple[Any, ...]:
    """Normal matrix (10, 10), right side (10,), sum of squares and number of samples of one turn."""
    middle = (rate[:-1] + rate[1:]) / 2 * np.diff(time)[:, None]
    vertical = np.empty_like(force)
    vertical[0] = up
    for k, step in enumerate(from_vector(-middle)):
        vertical[k + 1] = step @ vertical[k]
    inside, spacing = slice(2, -2), (time[-1] - time[0]) / (len(time) - 1)
    slope = (2 * (rate[4:] - rate[:-4]) + rate[3:-1] - rate[1:-3]) / (10 * spacing)  # of the line through five samples
    w, u = rate[inside], vertical[inside]
    turning = skew(slope) + skew(w) @ skew(w)  # (n, 3, 3): row i times the lever arm of axis i is its acceleration
    columns = np.zeros((len(w), 3, 10))
    columns[..., 0] = gravity * np.cross(u, w)
    for axis in range(3):
        columns[:, axis, 1 + 3 * axis : 4 + 3 * axis] = turning[:, axis]
    columns, seen = columns.reshape(-1, 10), (force[inside] - gravity * u).reshape(-1)
    return columns.T @ columns, columns.T @ seen, float(seen @ seen), len(seen)
