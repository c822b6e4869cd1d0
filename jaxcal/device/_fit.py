"""`fit`: calibrate all sensors of a device from one recording by hand."""

import dataclasses
from typing import Any

import jax
import numpy as np

from .._arrays import runs
from .._log import LogLike, as_log
from .._precision import host_float64
from .._units import BEYOND, STANDARD_GRAVITY
from ..fitting import Estimate
from ..imu._fits import Knowledge, coefficients
from ..imu._known import checked_gravity
from ..noise import Noise as SlowNoise
from ._findings import Facts, findings_of, sensor_of
from ._judge import Known, known
from ._model import AT, KINDS, NAMES, DeviceModel, field_of, model_of, template, vector_of
from ._noise_floor import Floor
from ._result import DeviceFit
from ._solve import rounds
from ._start import Start, recorded, started
from ._state import Place, Solution, nuisance
from ._windows import ACCEL_POLE, GYRO_POLE, Record

_BELOW = ("accel.matrix[1,0]", "accel.matrix[2,0]", "accel.matrix[2,1]")  # zero by the convention of the frame
#: rad of latitude, within which the dip may have either sign, because the magnetic equator leaves the geographic one by 14 degrees
_TROPIC = 0.35


@host_float64
def fit(
    log: LogLike, *, gravity: float | int | None = None, field: float | int | None = None, latitude: float | int | None = None,
    g_sensitivity: bool = False, lever: bool = False, noise: Knowledge = None,
) -> DeviceFit:  # fmt: skip
    r"""Calibrate accelerometer, gyroscope and magnetometer, and the delays between them, from one recording by hand.

    One likelihood contains all readings. The fit integrates the corrected rates and forces over windows of 0.2 s. Attitude R, velocity v
    and position p at the ends of the windows are unknowns, as are the parameters:

    .. math:: R_{k+1} = R_k\,\Delta R_k,\quad v_{k+1} = v_k + R_k\,\Delta v_k - g t,\quad
              p_{k+1} = p_k + v_k t + R_k\,\Delta p_k - \tfrac12 g t^2,\quad y_m = C R^T h + b_m.

    Here t is the length of a window, g gravity, h the field, C the soft iron and b_m the hard iron. The device rotates about a point, such
    as the wrist; the fit estimates its distance. The position of that point is a Matern process, whose size and speed come from the
    recording. The fit detects rests and uses them. It begins with the noise above 15 Hz, where hands hardly move; for an accelerometer in
    motion it continues this spectrum to 5 Hz. If the residuals of a sensor, summed over 0.2 to 13 s, in motion or at rest, are larger than
    this noise explains, the fit raises the noise level of that sensor to explain them. At low frequencies the noise may be stronger
    than this level. So the fit describes the spectrum of the residuals as white noise and a Gauss-Markov process with a time constant of
    0.4 to 13 s. The power above the level adds to the intervals.

    Parameters
    ----------
    log : `jaxcal.Log`, or what `jaxcal.read` takes, with all three sensors. Record three minutes in which a hand rotates the device through
        all attitudes, within arm's reach and far from iron. Rests make the errors of the accelerometer ten times smaller.
    gravity : local gravity, m/s^2; see `jaxcal.imu.gravity`. None takes standard gravity, and a finding says so.
    field : magnitude of the Earth's field in the unit of the readings. With it, the soft iron includes the scale of the magnetometer;
        without it, the soft iron has determinant 1.
    latitude : rad, to account for the Earth's rate; None ignores this rate.
    g_sensitivity, lever : whether to fit the gyroscope's sensitivity to specific force, and the positions of the accelerometer's elements.
    noise : {"gyro": noise, "accel": noise}, each a `jaxcal.noise.Noise` or {"N": ..., "B": ..., "K": ...} in SI; or what
        `jaxcal.noise.characterise` returns, or a `Calibration` with noise. The errors of the biases then include flicker and random walk,
        and the bias is the mean over a day; a single recording cannot show this noise. With None, noise comes from the recording itself,
        and the bias is the mean over the recording.

    Returns
    -------
    DeviceFit
        It includes a verdict for each sensor. Parameters that the motion does not determine are open: they have no value.

    Raises
    ------
    DataError
        If a sensor is missing, the recording is shorter than 20 s, or an option is out of range.

    Examples
    --------
    >>> import jaxcal
    >>> log, true, _ = jaxcal.device.simulate(60.0, 50.0, seed=1)
    >>> found = jaxcal.device.fit(log)
    >>> bool(abs(found.model.magnetometer.hard_iron - true.magnetometer.hard_iron).max() < 1e-7)
    True

    References
    ----------
    Preintegration: C. Forster et al., IEEE Trans. Robotics 33 (2017) 1. The position as a Gauss-Markov process: S. Sarkka and A. Solin,
    Applied Stochastic Differential Equations, 2019, section 12.3.
    """
    log, size = as_log(log), checked_gravity(STANDARD_GRAVITY if gravity is None else gravity)
    record, floors, mag = recorded(log, size, None if latitude is None else float(latitude))
    (gyro, accel), slow = floors, dict[str, SlowNoise]()
    if noise is not None:
        (own, *of_gyro), (white, *of_accel) = (coefficients(noise, sensor) for sensor in ("gyro", "accel"))
        gyro, accel = (Floor(one, one) if one else floor for one, floor in ((own, gyro), (white, accel)))
        slow = {sensor: SlowNoise(B=one[0], K=one[1]) for sensor, one in (("gyro", of_gyro), ("accel", of_accel))}
    start = started(record, mag)
    held = {"accel.g_sensitivity", "gyro.g_sensitivity", "lever", "field", "accel_pole", "gyro_pole"}
    held -= {*["gyro.g_sensitivity"] * g_sensitivity, *["lever"] * lever}
    free = np.array([i for i, name in enumerate(NAMES) if field_of(name) not in held and name not in _BELOW])
    answers: list[Any] = []
    for poles in ([], [ACCEL_POLE, GYRO_POLE]):
        found, place = rounds(record, start, np.array([*free, *poles]), (gyro, accel))
        answers.append((found, place, told := known(found, record, slow)))
        # a longer time constant than a step is no error of the integration, and no delay: fit again with the poles of both sensors
        if not told.lacks.pop("low_pass", 0.0) > record.grid.step**2 / 2:
            break
        start = dataclasses.replace(start, vector=found.vector, way=found.way)
    # a loose magnetometer looks like a low-pass of the gyroscope, but the fit with it does not converge
    found, place, told = next(one for one in reversed(answers) if one[0].converged or one is answers[0])
    estimate, model = _reported(found, told, start, None if field is None else float(field))
    # the dip has the sign of the latitude but near the equator; a magnetometer whose axes mirror looks remounted, with the other dip
    sign = float(np.sign(latitude)) if latitude is not None and abs(latitude) > _TROPIC else 0.0
    return _result(log, record, found, place, told, start, estimate, model, gravity is None, sign)


def _reported(found: Solution, told: Known, start: Start, field: float | None) -> tuple[Estimate, DeviceModel]:
    """The estimate in the unit of the readings, and the model."""
    vector, slope = _gauged(found, start.strength, field)
    fitted = {field_of(NAMES[i]) for i in found.free} | {"field"}
    shown = [i for i, name in enumerate(NAMES) if field_of(name) in fitted and not nuisance(name)]
    names, slope = tuple(NAMES[i] for i in shown), slope[shown]
    # a parameter is determined only if all free parameters that enter its value are
    open_ = np.abs(slope) @ ~told.seen > 0
    lost = {sensor_of(name) for name, gone in zip(names, open_, strict=True) if gone}
    if "accel" in lost:
        # delays are relative to the accelerometer: if the device hardly tilts, a delay looks like an error of the accelerometer's axes
        open_ |= np.array([name.endswith("_delay") for name in names])
        lost |= {"gyro", "magnetometer"}
    held = ~np.any(slope != 0, axis=1)
    if not found.converged:
        # where the cost is flat, the errors at the last step mean nothing: a sensor with an undetermined parameter gets no numbers
        open_ |= np.array([sensor_of(name) in lost for name in names]) & ~held
    covariance = slope @ told.covariance @ slope.T
    covariance = np.where(open_[:, None] | open_, np.where(np.eye(len(open_), dtype=bool), np.inf, 0.0), covariance)
    unit = "mag" if vector[AT["field"]][0] < BEYOND["mag"] else "counts"
    estimate = Estimate(
        names, np.where(open_, np.nan, vector[shown]), covariance, np.min(np.where(slope != 0, told.freedom, np.inf), axis=1),
        {name: "open" if gone else "held" for name, gone, fixed in zip(names, open_, held, strict=True) if gone or fixed},
        {field: unit if kind.quantity == "mag" else kind.quantity for field, kind in KINDS.items()},
    )  # fmt: skip
    plain = vector_of(template())
    plain[AT["gyro.matrix"]], plain[AT["magnetometer.soft_iron"]] = (axes.ravel() for axes in start.axes)
    gone = [i for i in np.array(shown)[open_] if NAMES[i] != "field"]
    vector[gone] = plain[gone]
    model = jax.tree.map(lambda leaf: leaf if np.ndim(leaf) else float(leaf), model_of(vector))
    return estimate, model


def _poles(found: Solution, told: Known) -> dict[str, float]:
    """Cut-off frequencies in Hz of the low-passes that the fit clearly shows."""
    error = dict(zip(found.free, np.sqrt(np.diag(told.covariance)), strict=True))
    poles = {"accel": ACCEL_POLE, "gyro": GYRO_POLE}
    shown = {sensor: float(found.vector[i]) for sensor, i in poles.items() if i in error and found.vector[i] > 3 * error[i]}
    return {sensor: float(1 / (2 * np.pi * np.sqrt(2 * pole))) for sensor, pole in shown.items()}


def _gauged(found: Solution, strength: float, field: float | None) -> tuple[np.ndarray, np.ndarray]:
    """All parameters in the unit of the readings, and their derivative by the free ones.

    Within the fit the field has magnitude 1, and readings are divided by `strength`. In the result det C = 1, or the field is given.
    """
    vector, slope = found.vector.copy(), np.eye(len(NAMES))
    soft, hard, size = AT["magnetometer.soft_iron"], AT["magnetometer.hard_iron"], AT["field"]
    iron = vector[soft].reshape(3, 3)
    root = np.cbrt(np.linalg.det(iron)) if field is None else field / strength
    slope[soft, soft], slope[hard, hard], slope[size] = np.eye(9) / root, strength * np.eye(3), 0.0
    if field is None:
        inverse = np.linalg.inv(iron).T.ravel() / 3
        slope[soft, soft] -= np.outer(iron.ravel(), inverse) / root
        slope[size, soft] = strength * root * inverse
    vector[soft], vector[hard], vector[size] = iron.ravel() / root, strength * vector[hard], strength * root
    return vector, slope[:, found.free]


def _result(
    log: Any, record: Record, found: Solution, place: Place, told: Known, start: Start, estimate: Estimate, model: DeviceModel,
    assumed: bool, hemisphere: float,
) -> DeviceFit:  # fmt: skip
    begin = record.grid.first * record.grid.step
    mag = np.reshape(found.noise.mag, (-1, 1)) * start.strength
    rms = np.sqrt(np.sum(found.field**2, axis=1) / np.maximum(found.kept.sum(axis=1), 1)[:, None]) * mag
    flags = found.kept.any(axis=1) & (found.counts < 0.5), found.rests.windows
    disturbed, resting = (_stretches(which, begin, record.time) for which in flags)
    facts = Facts(
        field=float(model.field), gravity=record.gravity if assumed else None, axes=start.axes, place=found.way.place,
        lacks=told.lacks, poles=_poles(found, told), duration=float(log.duration),
        disturbed=sum((stop - first for first, stop in disturbed), 0.0),
        dead=bool(np.any(np.isnan(log.usable("gyro", keep=("held", "stuck", "clipped"))) & np.isfinite(log.gyro))),
        disagreement=told.apart, converged=found.converged, held_out=told.held_out, dip=float(model.dip), hemisphere=hemisphere,
    )  # fmt: skip
    return DeviceFit(
        findings=findings_of(estimate, facts), model=model, estimate=estimate, disturbed=disturbed, rests=resting,
        noise={"gyro": float(np.median(found.noise.gyro)), "accel": float(np.median(found.noise.accel)),
               "mag": float(np.median(mag[:, 0] * np.sqrt(found.field_power)))},
        reach=place.reach, speed=place.speed, disagreement=told.ratio, held_out=told.held_out,
        time=np.append(begin, begin[-1] + record.time),
        attitude=found.way.rotation, velocity=found.way.velocity, place=found.way.place, residual_inertial=found.rows.inertial,
        residual_field=rms, gravity=record.gravity, rate=float(log.rate), duration=float(log.duration),
    )  # fmt: skip


def _stretches(flags: np.ndarray, begin: np.ndarray, time: float) -> tuple[tuple[float, float], ...]:
    """Times (start, stop) in s of flagged windows that begin at `begin` (K,) and last `time`; neighbouring windows are joined."""
    ends = zip(*runs(flags), strict=True)
    return tuple((round(float(begin[first]), 3), round(float(begin[stop - 1] + time), 3)) for first, stop in ends)
