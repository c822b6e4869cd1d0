"""`carousel`: sector means of a log taken on a table that turns all the time."""

from typing import Any

import equinox as eqx
import numpy as np
import scipy.stats

from .._errors import DataError
from .._precision import host_float64, is_traced
from ._positions import Positions, Readings


class Carousel(eqx.Module):
    """Sector means, and what they show of the table.

    Attributes
    ----------
    readings : `Readings` with one position per sector (and turn, unless folded), for `fit`.
    turns : number of turns in the log.
    rate : mean table rate, rad/s; rate_spread : its standard deviation from sector to sector.
    wobble : sensor -> (amplitude of the second harmonic, its standard deviation, p value), SI; the model has none, so that a
        significant one is table wobble or g-sensitivity.
    notes : sentences.
    """

    readings: Readings
    turns: float
    rate: float
    rate_spread: float
    wobble: dict[str, tuple[float, float, float]]
    notes: tuple[str, ...] = eqx.field(static=True)


@host_float64
def carousel(
    time: Any,
    angle: Any,
    accel: Any = None,
    gyro: Any = None,
    *,
    sectors: int = 12,
    fold: bool = True,
    accel_noise: Any = None,
    gyro_noise: Any = None,
    lever_arm: Any = 0.0,
) -> Carousel:
    r"""Sector means of a raw log with the table's angle, ready for `fit`.

    The mean over a sector of width :math:`\delta` lowers the turning part of a reading by :math:`\sin(\delta/2)/(\delta/2)`; `fit` knows.
    The offset it finds holds the table rate times a misalignment, so that the bias of the gyro must stay free.

    Parameters
    ----------
    time : (n,) s, increasing.
    angle : (n,) table angle, rad, wrapped or not.
    accel, gyro : (n,) samples along the sensitive axis, m/s^2 and rad/s; either may be None.
    sectors : per turn.
    fold : one mean for a sector over all turns, which loses nothing to white noise; False keeps the turns apart, for a drift.
    accel_noise, gyro_noise : as of `Readings`; by default what the samples scatter about the fitted harmonics, taken as white.
    lever_arm : m.

    Returns
    -------
    Carousel

    Raises
    ------
    DataError
        For arrays of different lengths, times that do not increase, less than one turn, or sectors with fewer than two samples.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import carousel, fit
    >>> time = np.arange(0.0, 720.0, 0.1)
    >>> angle, rate = 0.1 * time, 7.292115e-5 * np.cos(0.6)
    >>> found = carousel(time, angle, -9.80665 * 0.02 * np.sin(angle), rate * np.cos(angle + 0.5), accel_noise=5e-4, gyro_noise=3e-6)
    >>> print(round(found.turns, 1), np.rad2deg(fit(found.readings, 0.6).psi).round(1))
    11.5 28.0

    References
    ----------
    The north-finding paper's equations (36) to (39) with the table turning; the attenuation is the mean of a cosine over the sector.
    """
    if is_traced(time, angle, accel, gyro):
        raise DataError("`carousel` sorts a log on the host and cannot be traced; its result goes into `fit`, which can.")
    time, angle = (np.asarray(v, dtype=float) for v in (time, angle))
    samples = {"accel": accel, "gyro": gyro}
    samples = {name: np.asarray(v, dtype=float) for name, v in samples.items() if v is not None}
    if not samples:
        raise DataError("There are neither accelerometer nor gyro samples; give at least one of them.")
    for name, v in {"angle": angle, **samples}.items():
        if v.shape != time.shape or time.ndim != 1:
            raise DataError(f"The {name} has shape {v.shape} and the time {time.shape}; give one value per sample, (n,).")
        if not np.isfinite(v).all():
            raise DataError(f"{int(np.sum(~np.isfinite(v)))} values of the {name} are not finite; leave those samples out.")
    if len(time) < 2 or not (np.diff(time) > 0).all():
        raise DataError("The times do not increase; sort the log and leave out repeated stamps.")
    angle = np.unwrap(angle)
    turns = abs(angle[-1] - angle[0]) / (2 * np.pi)
    if turns < 1 or sectors < 4:
        raise DataError(f"The log holds {turns:.2g} turns in {sectors} sectors; it takes one whole turn and four sectors at least.")
    width = 2 * np.pi / sectors
    label = np.floor(angle / width).astype(int)
    # the first and last sectors are cut off by the log and have another mean angle
    kept = (label != label[0]) & (label != label[-1])
    names, place = np.unique(label[kept], return_inverse=True)
    count = np.bincount(place)
    if count.min() < 2:
        raise DataError(f"Some sectors hold {count.min()} samples; sample faster, turn slower, or use fewer sectors.")
    mean = lambda v: np.bincount(place, weights=v[kept]) / count  # noqa: E731
    step = float(np.median(np.diff(time)))
    dwell, start = count * step, np.array([time[kept][place == i][0] for i in range(len(names))])
    rates = np.gradient(angle, time)
    rate, mean_angle = mean(rates), mean(angle)
    noise = {"accel": accel_noise, "gyro": gyro_noise}
    wobble, notes = {}, []
    for name, v in samples.items():
        word, unit = ("accelerometer", "m/s^2") if name == "accel" else ("gyro", "rad/s")
        wobble[name], white = _second_harmonic(mean_angle, mean(v), dwell)
        if noise[name] is None:
            noise[name] = max(white, 1e-300)
            notes.append(f"The noise of the {word} is that of the scatter of its sector means.")
        if wobble[name][2] < 1e-3:
            notes.append(
                f"The {word} has a second harmonic of {wobble[name][0]:.3g} {unit} ({wobble[name][0] / wobble[name][1]:.1f} standard "
                "deviations): the table wobbles, or the sensor is sensitive to acceleration."
            )
    means = {name: mean(v) for name, v in samples.items()}
    spread = float(rate.std())
    if fold:
        over = np.unique(np.mod(names, sectors), return_inverse=True)[1]
        total = np.bincount(over, weights=dwell)
        # angles within the turn: means over several turns would lie turns apart
        folded = lambda v: np.bincount(over, weights=dwell * v) / total  # noqa: E731
        mean_angle, means, rate = folded(np.mod(mean_angle, 2 * np.pi)), {name: folded(v) for name, v in means.items()}, folded(rate)
        dwell, start = total, np.cumsum(total) - total
    positions = Positions(mean_angle, "x", dwell, start, rate=rate, width=width)
    noises = {"accel_noise": noise["accel"], "gyro_noise": noise["gyro"]}
    readings = Readings(positions, means.get("accel"), means.get("gyro"), lever_arm=lever_arm, **noises)
    return Carousel(readings, float(turns), float(rate.mean()), spread, wobble, tuple(notes))


def _second_harmonic(angle: np.ndarray, value: np.ndarray, dwell: np.ndarray) -> tuple[tuple[float, float, float], float]:
    """Amplitude, its standard deviation and p value, and the white noise for one second."""
    rows = np.stack([np.ones_like(angle), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], axis=1)
    root = np.sqrt(dwell)
    solution = np.linalg.lstsq(rows * root[:, None], value * root, rcond=None)[0]
    freedom = max(len(value) - rows.shape[1], 1)
    white = float(np.sqrt(np.sum((root * (value - rows @ solution)) ** 2) / freedom))
    covariance = white**2 * np.linalg.inv((rows * dwell[:, None]).T @ rows)[3:, 3:]
    pair = solution[3:]
    amplitude, sigma = float(np.hypot(*pair)), float(np.sqrt(np.trace(covariance) / 2))
    # readings without any noise: rounding is no wobble
    tiny = amplitude < 1e-9 * float(np.abs(value).max())
    statistic = 0.0 if tiny or sigma == 0 else float(pair @ np.linalg.solve(covariance, pair)) / 2
    return (amplitude, sigma, float(scipy.stats.f.sf(statistic, 2, freedom))), white
