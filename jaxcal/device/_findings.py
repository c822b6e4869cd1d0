"""Everything that `jaxcal.device` says about a result, and when."""

from typing import Any, NamedTuple

import numpy as np

from .._answer import CAUTION, FATAL, GRAVITY_ASSUMED, NOTE, WRONG_RANGE, Finding, Kind, Quantity, table, wrong_ranges
from .._arrays import axis_words
from ..fitting import Estimate
from ..magnetometer._beside import Axes, by_axes
from ._model import KINDS, field_of

FINDINGS = table(
    gravity_assumed=GRAVITY_ASSUMED,
    range=WRONG_RANGE,
    other_axes=Kind(
        NOTE, "Its x, y, z are {axes} of the accelerometer; its matrix contains this.", "To turn the log instead: {option.axes:{typed}}.",
        guess=True
    ),
    undetermined=Kind(
        FATAL, "The motion leaves parameters without a number (open).",
        "Turn the device about all three axes, through all attitudes, and let it rest in several.",
    ),
    not_converged=Kind(FATAL, "The fit did not converge, so its numbers are not reliable.", "Record again in one place, far from iron."),
    inaccurate=Kind(
        CAUTION, "Errors are up to {times:.2g} times those of a good calibration.",
        "Record longer, through all attitudes, with more rests.",
        limits=(1.0, 20.0),  # with the second, a matrix is known to a tenth only, which an IMU's fit calls unknown, too
    ),
    far=Kind(
        CAUTION, "The device went {distance:.2g} away from its mean position, farther than an arm reaches.",
        "Stand still and move only the arm.",
        limits=(1.5,),  # m: a hand with a reach of 0.25 m along each axis goes 1.1 m away in three minutes
    ),
    gradient=Kind(CAUTION, "The field varies with the place, by {percent:.2g} % per metre.", "Record farther from iron."),
    loose=Kind(CAUTION, "It turns against the other sensors by {angle:.2g} rms as the device accelerates.", "Mount it firmly."),
    disturbed=Kind(
        NOTE, "The field was disturbed for {time:.3g} ({percent:.2g} % of the log), which counts little or nothing.",
        limits=(0.0, 0.2),  # parts of the recording
    ),
    low_pass=Kind(NOTE, "A low-pass of about {hertz:.2g} Hz acts on it; the fit includes it."),
    drift=Kind(
        NOTE, "The bias drifted by {drift:.2g} along the recording; the result is its mean.", "Let the device warm up before you record."
    ),
    dead_band=Kind(
        CAUTION, "Its readings are exact zeros in a dead band: what is left there is no measurement, and the bias is less certain.",
        "Switch the dead band off."
    ),
    held_out=Kind(
        CAUTION, "A sixth of the recording deviates from the others by {times:.2g} times the noise.",
        "Record again in one place, without knocks, far from iron.",
        limits=(1.5,),  # in plain recordings 0.8 to 1.1
    ),
    disagree=Kind(NOTE, "Parts of the recording disagree {times:.2g} times as much as noise explains."),
)  # fmt: skip

SENSORS = ("accel", "gyro", "magnetometer")


def sensor_of(name: str) -> str:
    """Sensor to which a parameter belongs. Field, dip and the second delay belong to the magnetometer."""
    first = name.partition(".")[0]
    return {"gyro_delay": "gyro", "lever": "accel"}.get(field_of(first), first if first in SENSORS else "magnetometer")


class Facts(NamedTuple):
    """What the findings depend on, beside the estimate: see `DeviceFit`, and for the sizes of `lacks` the function of this name."""

    field: float
    gravity: float | None  # None if it was given
    axes: tuple[np.ndarray, ...]  # that rotate vectors from the axes of the accelerometer to those of gyroscope and magnetometer
    place: np.ndarray
    lacks: dict[str, float]
    poles: dict[str, float]  # sensor -> cut-off frequency of its low-pass, Hz
    disturbed: float  # s
    duration: float
    dead: bool  # whether the gyroscope has a dead band
    disagreement: float | None  # None if parts of the recording agree
    converged: bool
    held_out: dict[str, float]  # sensor -> rms residual of sixths that were left out, in its noise
    dip: float = 0.0
    hemisphere: float = 0.0  # sign of the dip at the place, or zero if the place does not tell it


def findings_of(estimate: Estimate, facts: Facts) -> tuple[Finding, ...]:
    """The findings of a fit."""
    found: list[Finding] = []
    if facts.gravity is not None:
        found.append(FINDINGS("gravity_assumed", severity=NOTE, gravity=Quantity(facts.gravity, "accel")))
    for sensor, short, turn in zip(SENSORS[1:], ("gyro", "mag"), facts.axes, strict=True):
        if not np.array_equal(turn, np.eye(3)):
            found.append(FINDINGS("other_axes", sensor, axes=axis_words(turn), typed=f"{short}={axis_words(turn.T)}"))
    lost = {sensor_of(name) for name, state in estimate.states.items() if state == "open"}
    error = dict(zip(estimate.names, estimate.error, strict=True))
    known = {name: (value, error[name]) for name, value in zip(estimate.names, estimate.values, strict=True)}
    turn = facts.axes[0]  # the scale of an axis stands in the column of its direction
    places = {f"gyro.matrix[{i},{i}]": (f"gyro.matrix[{i},{j}]", turn[i, j]) for i, j in zip(*np.nonzero(turn), strict=True)}
    scales = {name: (sign * known[own][0], known[own][1]) for name, (own, sign) in places.items() if own in known}
    found += wrong_ranges(FINDINGS, known | scales)
    for sensor in SENSORS:
        own = {name: size for name, size in error.items() if sensor_of(name) == sensor and np.isfinite(size)}
        unit = {"magnetometer.hard_iron": facts.field}
        times = max((size / KINDS[kind].good / unit.get(kind, 1.0) for name, size in own.items() if (kind := field_of(name))), default=0.0)
        found += [FINDINGS("undetermined", sensor)] if sensor in lost else FINDINGS.over("inaccurate", times, sensor, times=times)
        found += FINDINGS.over("held_out", facts.held_out[sensor], sensor, times=facts.held_out[sensor])
    if facts.dead:
        found.append(FINDINGS("dead_band", "gyro"))
    away = float(np.linalg.norm(facts.place - facts.place.mean(axis=0), axis=1).max())
    found += FINDINGS.over("far", away, "accel", distance=Quantity(away, "length"))
    for name, size in facts.lacks.items():
        units = {"drift": {"drift": Quantity(size, "gyro")}, "loose": {"angle": Quantity(size, "angle")}}
        shown: dict[str, Any] = units.get(name, {"percent": 100 * size})
        found.append(FINDINGS(name, "gyro" if name == "drift" else "magnetometer", **shown))
    found += [FINDINGS("low_pass", sensor, hertz=hertz) for sensor, hertz in facts.poles.items()]
    share = facts.disturbed / facts.duration
    found += FINDINGS.over("disturbed", share, "magnetometer", time=Quantity(facts.disturbed, "time"), percent=100 * share)
    if facts.disagreement is not None:
        times = float(np.sqrt(facts.disagreement))
        found.append(FINDINGS("disagree", cost=times, times=times))
    if not facts.converged and not lost:
        found.append(FINDINGS("not_converged", SENSORS))
    axes = by_axes(Axes(facts.axes[1], facts.dip), facts.hemisphere, turns=facts.hemisphere != 0.0)
    found += [one.of("magnetometer") for one in axes]
    return tuple(found)
