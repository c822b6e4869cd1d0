"""`from_log`: positions, mean readings and their noise from the raw log of a table that moves between rests (host, NumPy)."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Quantity
from .._errors import DataError
from .._log import LogLike, as_log
from .._message import Message
from .._precision import host_float64
from .._types import NoiseLike, Numbers, Real
from ..evidence._rests import still_intervals
from ._findings import FINDINGS
from ._fit import fit
from ._model import Triads, Turntable
from ._noise import mixed, noise_of
from ._plausible import check_norm
from ._positions import Positions, Readings, distance
from ._result import AlignmentFit

#: smallest rotation that counts as a move, rad; largest share of a move about another axis; difference from the gyroscope that is a fault
_NO_MOVE, _ASIDE, _DIFFER = np.deg2rad(1.0), 0.05, np.deg2rad(5.0)
_BUMP = 2.0  # s; shorter interruptions of a rest, with the window of the detector, are not moves to another position
_SKEW = 5e-3  # rad: standard deviation of the angle between the z axes and the axis of the moves
_PARTS = 4  # of a rest, which show a drift inside it: they hold 15/16 of what a slope tells


class TableLog(eqx.Module):
    """Readings and positions from the raw log of a turntable.

    Attributes
    ----------
    readings : `Readings` with one row for each rest, or for each axis of each rest.
    model : `Turntable`, or `Triads` for sensors with three axes; the model for `fit`.
    free : names of the parameters to estimate from this log.
    priors : priors of the misalignments of the z axes, because the table's z axis is known only from the axis of the moves.
    start, stop : (k,) samples of each rest: start <= i < stop.
    angle : (k,) table angle of each rest, rad.
    frame : (3, 3) rotation matrix from the axes of the device to those of the table.
    findings : how rests and angles were found; `fit` adds them to its own.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng, time = np.random.default_rng(0), np.arange(0, 160, 0.05)
    >>> angle = np.deg2rad(90.0) * np.clip(np.floor(time / 40) + (time % 40 - 36) / 4 * (time % 40 > 36), 0, 3)
    >>> gyro = 6e-5 * np.cos(angle + 0.5) + 1e-5 * rng.normal(size=time.size)
    >>> found = jaxcal.alignment.from_log(jaxcal.Log(time, gyro=gyro), angle=angle)
    >>> print(np.rad2deg(found.angle).round(1), found.stop - found.start > 600)
    [  0.  90. 180. 270.] [ True  True  True  True]
    """

    readings: Readings
    model: Turntable
    free: tuple[str, ...] = eqx.field(static=True)
    priors: dict[str, Any]
    start: np.ndarray
    stop: np.ndarray
    angle: np.ndarray
    frame: np.ndarray
    findings: tuple[Finding, ...] = eqx.field(static=True)

    def fit(self, latitude: Real | None = None, **options: Any) -> AlignmentFit:
        """Call `jaxcal.alignment.fit` with the readings, model and free parameters of this log; `options` are passed on."""
        given = {"free": self.free, **options, "priors": self.priors | (options.get("priors") or {})}
        found = fit(self.readings, latitude, model=self.model, **given)
        return dataclasses.replace(found, findings=(*found.findings, *self.findings))


@host_float64
def from_log(
    log: LogLike,
    *,
    angle: Numbers | None = None,
    angles: Numbers | None = None,
    noise: NoiseLike | None = None,
    axis: str = "x",
    angle_std: Numbers | None = None,
    gyro_scale: float | int = 1e-3,
    least: float | int = 5.0,
) -> TableLog:
    r"""Find the rests of a turntable in its raw log, and average the readings of each rest.

    A rest is a time in which the sensors' variance stays low and the table angle does not change. The angle of a rest comes from the log,
    from the caller, or from the integral of a gyroscope with three axes over the moves:

    .. math:: \alpha_{k+1} = \alpha_k + \int n \cdot (\omega - b)\,dt

    where n is the axis of the moves and b the mean of the rests before and after. The frame of the result is that of the table at angle
    zero: z along n, downwards, and x close to the x axis of the device.

    Parameters
    ----------
    log : `jaxcal.Log` with one or three axes of an accelerometer, a gyroscope or both.
    angle : (n,) table angle of every sample, rad, wrapped or unwrapped; it increases when the table turns clockwise seen from above.
    angles : (k,) table angle of every rest in order, rad.
    noise : noise of the device for `noise_of`; None lets the fit estimate it from the residuals.
    axis : device axis of the sensor, to select from `noise`, if the log has one axis.
    angle_std : standard deviation of each angle given by the log or the caller, rad; None leaves it open, see `Positions`.
    gyro_scale : standard deviation of the gyroscope's scale factor, used if the angles come from its integral.
    least : shortest rest, s.

    Returns
    -------
    TableLog

    Raises
    ------
    DataError
        If the table rests less than twice, turns about several axes, or there is no source for its angles.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> rng, time = np.random.default_rng(0), np.arange(0, 160, 0.05)
    >>> angle = np.deg2rad(90.0) * np.clip(np.floor(time / 40) + (time % 40 - 36) / 4 * (time % 40 > 36), 0, 3)
    >>> gyro = 6e-5 * np.cos(angle + 0.5) + 1e-5 * rng.normal(size=time.size)
    >>> accel = -0.2 * np.sin(angle) + 1e-3 * rng.normal(size=time.size)
    >>> found = jaxcal.alignment.from_log(jaxcal.Log(time, gyro=gyro, accel=accel), angle=angle)
    >>> print(np.rad2deg(found.angle).round(1), np.rad2deg(found.fit(0.6).psi).round(1))
    [  0.  90. 180. 270.] 27.7

    References
    ----------
    Rests: D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, section IV-A.
    """
    log = as_log(log)
    samples = {name: np.array(v, dtype=float).reshape(len(v), -1) for name in ("accel", "gyro") if (v := getattr(log, name)) is not None}
    for x in samples.values():
        x[~np.isfinite(x).all(axis=1)] = np.nan
    if not samples:
        raise DataError("The log has neither accelerometer nor gyroscope; give a log with at least one of them.", code="no_sensor")
    if any(x.shape[1] == 2 for x in samples.values()):
        raise DataError(Message("A sensor of the log has two axes, not one or three. Choose them with {option.columns}."), code="axes")
    rate, time = float(log.rate), np.asarray(log.time)
    recorded = None if angle is None else _recorded(angle, len(time))
    rests = _Rests(samples, *_rests(samples, recorded, rate, float(least)), time, rate)
    length = rests.stop - rests.start
    least_rest, most_rest = (Quantity(float(x) / rate, "time") for x in (length.min(), length.max()))
    notes: list[Finding] = []
    turns, frame = _moves(rests)
    place, spread = _angles(rests, recorded, angles, turns, float(gyro_scale), angle_std, notes)
    shown = ", ".join(f"{x:.4g}" for x in np.rad2deg(place[:12])) + (" ..." if len(place) > 12 else "")
    notes.insert(0, FINDINGS("rests", count=len(length), least=least_rest, most=most_rest, angles=shown))
    told = {} if noise is None else noise_of(noise, None if _three(samples) else axis)
    return _gathered(rests, place, spread, frame, told, notes)


@dataclasses.dataclass
class _Rests:
    """Samples of the sensors, the first one of each rest and the one after its last, their times, and their rate."""

    samples: dict[str, np.ndarray]
    start: np.ndarray
    stop: np.ndarray
    time: np.ndarray
    rate: float


def _rests(samples: dict[str, np.ndarray], recorded: np.ndarray | None, rate: float, least: float) -> tuple[np.ndarray, np.ndarray]:
    """First sample of each rest, and the sample after its last one."""
    # ignore a sensor that is slower than the log and therefore missing in most samples
    seen = {name: x for name, x in samples.items() if np.mean(np.isfinite(x).all(axis=1)) > 0.5} or samples
    found = still_intervals(seen, rate, table=True, angle=recorded, least=least)
    if len(found) < 2:
        said = "the table {what} for {least:g} s or more; a test takes rests on several positions. Shorter rests need {option.least}"
        raise DataError(Message(said, what="rests once" if len(found) else "never rests", least=least), code="few_rests")
    return found.start, found.stop


def _three(samples: dict[str, np.ndarray]) -> bool:
    return any(x.shape[1] == 3 for x in samples.values())


def _recorded(angle: Any, size: int) -> np.ndarray:
    """Table angle of every sample, unwrapped, with gaps interpolated."""
    angle = np.asarray(angle, dtype=float)
    if angle.shape != (size,):
        raise DataError(f"angle has shape {angle.shape}; the log has {size} samples: give one angle for each.", code="angles")
    here = np.isfinite(angle)
    if np.count_nonzero(here) < 2:
        raise DataError("angle has no finite values; check the column.", code="angles")
    return np.interp(np.arange(size), np.flatnonzero(here), np.unwrap(angle[here]))


def _moves(rests: _Rests) -> tuple[np.ndarray | None, np.ndarray]:
    """Angle (k - 1,) of each move about the table's axis, rad, or None unless a gyroscope with three axes saw them; the table's frame."""
    gyro, start, stop = rests.samples.get("gyro"), rests.start, rests.stop
    if gyro is None or gyro.shape[1] != 3:
        return None, np.eye(3)
    means = _means(gyro, start, stop)
    vectors = []
    for k in range(len(start) - 1):
        part = gyro[stop[k] : start[k + 1]]
        there = np.isfinite(part).all(axis=1)
        if np.count_nonzero(~there) > 0.02 * len(part):
            return None, np.eye(3)
        vectors.append((part[there].mean(axis=0) - (means[k] + means[k + 1]) / 2) * len(part) / rests.rate)
    turned = np.array(vectors)
    size = np.linalg.norm(turned, axis=1)
    if not np.any(size > _NO_MOVE):
        return size * 0.0, np.eye(3)
    axis = np.linalg.eigh(turned.T @ turned)[1][:, -1]
    aside = np.linalg.norm(turned - (turned @ axis)[:, None] * axis, axis=1)
    if np.any(aside > _ASIDE * size.max() + _NO_MOVE):
        worst = int(np.argmax(aside))
        said = f"The moves turn about different axes: one is {np.rad2deg(aside[worst]):.3g} degrees off the axis of the others. Apply the "
        raise DataError(f"{said}calibration of the IMU first, or use jaxcal imu.", code="axes_of_moves")
    accel = rests.samples.get("accel")
    if accel is not None and accel.shape[1] == 3:
        force = _means(accel, start, stop)
        check_norm(force)
        axis = -axis if force.mean(axis=0) @ axis > 0 else axis
    elif axis[np.argmax(np.abs(axis))] < 0:
        axis = -axis
    reference = np.eye(3)[0 if abs(axis[0]) < 0.8 else 1]
    x = reference - (reference @ axis) * axis
    x /= np.linalg.norm(x)
    return turned @ axis, np.stack([x, np.cross(axis, x), axis])


def _angles(
    rests: _Rests, recorded: np.ndarray | None, given: Any, turns: np.ndarray | None, scale: float, angle_std: Any, notes: list[Finding]
) -> tuple[np.ndarray, np.ndarray | None]:
    """Table angle of each rest, and the covariance of the angle errors, if it is known."""
    start, stop, rate, count = rests.start, rests.stop, rests.rate, len(rests.start)
    if given is not None:
        angle = np.asarray(given, dtype=float)
        # a spike, a bump or missing samples can split a rest in two: give both parts the same angle
        there = np.all([np.isfinite(x).any(axis=1) for x in rests.samples.values()], axis=0)
        between = np.array([np.count_nonzero(there[i:j]) for i, j in zip(stop[:-1], start[1:], strict=True)])
        place = np.concatenate([[0], np.cumsum(between / rate > _BUMP)])
        angle = angle[place] if angle.shape == (place[-1] + 1,) else angle
        if angle.shape != (count,):
            raise DataError(f"{angle.size} angles were given for {count} rests.", code="angles")
    elif recorded is not None:
        angle = np.array([np.mean(recorded[i:j]) for i, j in zip(start, stop, strict=True)])
    elif turns is not None:
        angle = np.concatenate([[0.0], np.cumsum(turns)])
        gyro = rests.samples["gyro"]
        white = max(_white(gyro[i:j], rate).max() for i, j in zip(start, stop, strict=True))
        walk = np.concatenate([[0.0], np.cumsum((start[1:] - stop[:-1]) / rate)]) * white**2
        notes.append(FINDINGS("angles_of_gyro", ppm=1e6 * scale))
        return angle, scale**2 * np.outer(angle, angle) + np.minimum.outer(walk, walk)
    else:
        said = "Nothing tells the table's angle on its {count} rests. Give the angles of the rests in order with {option.angles}."
        raise DataError(Message(said, count=count), code="no_angles")
    if turns is not None:
        moved = np.diff(angle)
        off, other = (distance(sign * moved, turns) for sign in (1, -1))
        if off.max() > _DIFFER and other.max() <= _DIFFER:
            angle = -angle
            notes.append(FINDINGS("angle_turned"))
        elif off.max() > _DIFFER:
            worst = int(np.argmax(off))
            said, (own, other) = f"Between rests {worst + 1} and {worst + 2} the", np.rad2deg([turns[worst], moved[worst]])
            raise DataError(f"{said} gyroscope turned by {own:.4g} degrees, the angles by {other:.4g}. Check units.", code="angles")
    return angle, None if angle_std is None else np.asarray(angle_std, dtype=float) ** 2 * np.eye(count)


def _white(x: np.ndarray, rate: float) -> np.ndarray:
    """(axes,) white noise N of a rest, from means over one second, or over a tenth of a short rest."""
    block = max(min(round(rate), len(x) // 10), 1)
    means = np.nanmean(x[: len(x) // block * block].reshape(-1, block, x.shape[1]), axis=1)
    return np.nanstd(np.diff(means, axis=0), axis=0) / np.sqrt(2) * np.sqrt(block / rate)


def _gathered(
    rests: _Rests, angle: np.ndarray, spread: np.ndarray | None, frame: np.ndarray, told: dict[str, Any], notes: list[Finding]
) -> TableLog:
    """Collect the means of every rest and axis as readings, with the model, its free parameters and priors."""
    samples, start, stop = rests.samples, rests.start, rests.stop
    words = ("x", "y", "fixed z") if _three(samples) else ("x",)
    if not np.allclose(frame, np.eye(3)):
        told = {name: mixed(one, frame) if isinstance(one, tuple) else one for name, one in told.items()}
        off = float(np.arccos(np.clip(np.abs(frame[2, 2]), 0, 1)))
        notes += FINDINGS.over("axis_tilted", off, tilt=Quantity(off, "angle"))

    def averaged(start: np.ndarray, stop: np.ndarray, rest: np.ndarray, **more: Any) -> Readings:
        """Readings of stretches of the log, each in one of the rests."""
        values: dict[str, np.ndarray] = {}
        for name, x in samples.items():
            means = _means(x, start, stop)
            values[name] = np.full((len(start), len(words)), np.nan)
            values[name][:, : means.shape[1]] = means @ frame.T if means.shape[1] == 3 else means
        rows = np.repeat(np.eye(len(angle))[rest], len(words), axis=0)
        places = Positions(
            np.repeat(angle[rest], len(words)), words * len(start), np.repeat((stop - start) / rests.rate, len(words)),
            np.repeat(rests.time[start], len(words)), angle_std=None if spread is None else rows @ spread @ rows.T,
        )  # fmt: skip
        return Readings(places, *(None if name not in values else values[name].ravel() for name in ("accel", "gyro")), **told, **more)

    edges = np.linspace(start, stop, _PARTS + 1, axis=1).astype(int)
    every = np.arange(len(start))
    parts = averaged(edges[:, :-1].ravel(), edges[:, 1:].ravel(), np.repeat(every, _PARTS))
    readings = averaged(start, stop, every, parts=parts)
    priors = {f"ma_{name[0]}_z{axis}": _SKEW for name, x in samples.items() if x.shape[1] == 3 for axis in "xy"}
    return TableLog(readings, Triads() if len(words) == 3 else Turntable(), _free(samples), priors, start, stop, angle, frame, tuple(notes))


def _means(x: np.ndarray, start: np.ndarray, stop: np.ndarray) -> np.ndarray:
    """(k, axes) means over stretches; NaN where nothing was measured."""
    total, count = (np.concatenate([np.zeros((1, x.shape[1])), np.cumsum(one, axis=0)]) for one in (np.nan_to_num(x), np.isfinite(x)))
    count = count[stop] - count[start]
    return (total[stop] - total[start]) / np.where(count, count, np.nan)


def _free(samples: dict[str, np.ndarray]) -> tuple[str, ...]:
    """Names of the free parameters: the angles, and the biases of the existing axes."""
    names = [*(["phi", "theta"] if "accel" in samples else []), *(["psi"] if "gyro" in samples else [])]
    for name in sorted(samples):
        names += [f"b_{name[0]}{suffix}" for suffix in ("", "_y", "_z")[: samples[name].shape[1]]]
    return tuple(names)
