"""`fit`: calibrate all sensors of a device from one recording by hand."""

from typing import Any

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs
from .._errors import DataError
from .._log import as_log
from .._precision import host_float64
from .._types import AnyArray
from .._units import STANDARD_GRAVITY, on_earth
from ..imu import windowed_variance
from ..imu._fits import coefficients
from ..magnetometer import MagModel
from ..noise import Noise as SlowNoise
from ._contribution import shares
from ._gradient import gradients
from ._judge import NUISANCE, known, lacks, stretches, unseen
from ._levels import Levels
from ._model import DeviceModel
from ._noise_floor import Floor
from ._normal import GYRO, HARD, IRON, logarithm
from ._record import recorded, unfilled
from ._result import DeviceFit, gauged
from ._solve import REACH, STEPS, Noise, Place, Record, Rests, Solution, solved
from ._start import started, undisturbed
from ._verdict import judged, sensor_of
from ._windows import NAMES, model_of, template, vector_of

_ROUNDS, _MOST, _BLIND = 3, 8, 5  # rounds of fits: at least, at most, and at most where the motion does not determine all parameters
_FEW = 10  # steps of a fit where the motion does not determine all parameters
_SAME = 0.05  # the rounds end when weights, and logarithms of noise levels, change by less
_HELD = ("accel.g_sensitivity", "field")
_BELOW = ("accel.matrix[1,0]", "accel.matrix[2,0]", "accel.matrix[2,1]")
_FIELD_NOISE = 0.01  # of a reading, as a part of the field, in the first fit
_LEAST, _READINGS = 20.0, 100  # shortest recording, s; fewest readings of the magnetometer
_FAR, _GONE = 1.5, 4.0  # rms field residual of a window in standard deviations: above the first it gets less weight, above the second none
_LITTLE = 1e-2  # weight of a window that is left out: not zero, so that its residuals are still computed
#: m/s^2 and rad/s: at rest, readings scatter by less, and the mean rate is below the second number
_STILL_FORCE, _STILL_RATE = 0.35, 0.06
_SLOWEST = 1e-4  # m/s, smallest standard deviation of the velocity at rest
_SHOWN = 0.1  # smallest part of the variance of the velocity at rest that is taken as seen by the sensors
#: how much more than inside the rest a window at its edge may scatter; number of windows by which a rest may grow at each edge
_CALM, _MARGIN_WINDOWS = 1.1, 4


@host_float64
def fit(
    log: Any, *, gravity: float | int = STANDARD_GRAVITY, field: float | int | None = None, latitude: float | int | None = None,
    g_sensitivity: bool = False, lever: bool = False, noise: Any = None, derivatives: Any = (),
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
    gravity : local gravity, m/s^2; see `jaxcal.imu.gravity`.
    field : magnitude of the Earth's field in the unit of the readings. With it, the soft iron includes the scale of the magnetometer;
        without it, the soft iron has determinant 1.
    latitude : rad, to account for the Earth's rate; None ignores this rate.
    g_sensitivity, lever : whether to fit the gyroscope's sensitivity to specific force, and the positions of the accelerometer's elements.
    noise : {"gyro": noise, "accel": noise}, each a `jaxcal.noise.Noise` or {"N": ..., "B": ..., "K": ...} in SI; or what
        `jaxcal.noise.characterise` returns, or a `Calibration` with noise. The errors of the biases then include flicker and random walk,
        and the bias is the mean over a day; a single recording cannot show this noise. With None, noise comes from the recording itself,
        and the bias is the mean over the recording.
    derivatives : names of parameters, as in `DeviceFit.names`, for which to compute the derivatives by every reading. They hold noise
        levels, weights, rests, and reach and speed of the hand constant; see `DeviceFit`.

    Returns
    -------
    DeviceFit
        It includes a verdict for each sensor. Parameters that the motion does not determine are listed and have no value.

    Raises
    ------
    DataError
        If a name in `derivatives` is not a fitted parameter, a sensor is missing, the recording is shorter than 20 s, or an option is out
        of range.
    FitError
        If the recording determines the parameters too weakly to compute the derivatives.

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
    log = as_log(log)
    if not on_earth("gravity", gravity):
        raise DataError(f"gravity={gravity:g} m/s^2 is not that of a place on Earth; expected 9.76 to 9.84")
    if log.duration < _LEAST:
        raise DataError(f"The recording lasts {log.duration:.3g} s; {_LEAST:g} s are needed, and three minutes are advised.")
    record, (gyro, accel), mag = recorded(log, float(gravity), REACH, None if latitude is None else float(latitude))
    if (span := record.time * float(np.sum(~record.broken))) < _LEAST:
        raise DataError(f"Accelerometer and gyroscope have readings without gaps for {span:.3g} s in all; {_LEAST:g} s are needed.")
    if (number := int(record.there.sum())) < _READINGS:
        raise DataError(f"The magnetometer has {number} readings; {_READINGS} are needed, and several per second are advised.")
    slow: dict[str, SlowNoise] = {}
    if noise is not None:
        white = {}
        for sensor in ("gyro", "accel"):
            white[sensor], flicker, walk = coefficients(noise, sensor)
            slow[sensor] = SlowNoise(B=flicker, K=walk)
        gyro, accel = (Floor(white[name], white[name]) if white[name] else floor for name, floor in (("gyro", gyro), ("accel", accel)))
    vector, way, strength, axes = started(record, mag)
    held = (*_HELD, *(() if g_sensitivity else ("gyro.g_sensitivity",)), *(() if lever else ("lever",)))
    free = np.array([i for i, name in enumerate(NAMES) if name.partition("[")[0] not in held and name not in _BELOW])
    found, place, rests, level = _rounds(record, vector, way, free, gyro, accel)
    return _result(
        log, record, found, place, rests, level, strength, axes, None if field is None else float(field), slow, tuple(derivatives)
    )


def _rounds(record: Record, vector: Any, way: Any, free: Any, gyro: Floor, accel: Floor) -> tuple[Solution, Place, Rests, Noise]:
    """Fit repeatedly. Between fits, update the noise levels, the weights of disturbed windows, and the reach and speed of the hand."""
    place, rests, settled = Place(0.3, 0.4), _rests(record, vector), False
    # in motion the hand hides the noise of the accelerometer from the fit
    level = Noise(gyro.fast, np.where(rests.windows, accel.fast, accel.slow), _FIELD_NOISE)
    centre, white, levels = vector.copy(), level, Levels()
    counts = undisturbed(record, vector)
    # two steps show which parameters the motion does not determine. In their directions the cost is flat, so more steps are useless
    first = solved(record, vector, way, free, level, place, counts, 2, rests, centre)
    vector, way, blind = first.vector, first.way, bool(unseen(first).any())
    fewest = 2 if blind else _BLIND
    for turn in range(_MOST):
        found = solved(record, vector, way, free, level, place, counts, _FEW if blind else STEPS, rests, centre)
        vector, way, blind = found.vector, found.way, bool(unseen(found).any())
        if (settled and turn >= _ROUNDS - 1) or (blind and turn >= fewest - 1) or turn == _MOST - 1:
            break
        # rms field residual of each window; the median over windows ignores the few that may be disturbed
        power, number = _power(found.field, found.kept)
        some = found.kept.any(axis=1)
        size = found.noise.mag * np.sqrt(power)
        white = Noise(white.gyro, white.accel, float(np.sqrt(np.median(size[some] ** 2) / _median(3 * float(np.median(number[some]))))))
        grew, change = levels.next(found, place, rests, record.time, white)
        far = size / white.mag
        new = np.where(far > _GONE, _LITTLE, np.minimum(1.0, _FAR / np.maximum(far, 1e-9)))
        settled = bool(np.max(np.abs(new - counts)) < _SAME and change < _SAME)
        level, counts = grew, new
        spread = found.chain.variances(np.linalg.inv(found.eliminated.information), found.eliminated.carried)
        place, rests = _hand(found, np.diagonal(spread, axis1=1, axis2=2), rests, record, level)
    return found, place, rests, level  # type: ignore[possibly-unbound]


def _power(field: np.ndarray, kept: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(K,) mean square of the field residuals in each window, and its number of readings."""
    number = kept.sum(axis=1)
    return np.sum(np.where(kept[..., None], field, 0.0) ** 2, axis=(1, 2)) / (3 * np.maximum(number, 1)), number


def _median(freedom: float) -> float:
    """Median of a chi-square variable, divided by its degrees of freedom."""
    return float(scipy.special.chdtri(freedom, 0.5) / freedom)


def _hand(found: Solution, spread: np.ndarray, rests: Rests, record: Record, level: Noise) -> tuple[Place, Rests]:
    """Reach and speed of the hand in motion: mean squares of the estimates, plus their variances. Speed and turn at rest.

    The variance of the velocity at rest is the mean square of the estimates, divided by the part of the variance that the readings show
    (D. MacKay, Neural Computation 4, 1992, 415).
    """
    ends, way = rests.ends, found.way
    moving = ~ends
    reach = np.mean(way.place[moving] ** 2 + spread[moving, 6:9])
    speed = np.mean(way.velocity[moving] ** 2 + spread[moving, 3:6])
    place = Place(float(np.sqrt(reach)), float(np.sqrt(speed))).strained(way, record.time, rests.moving)
    if not ends.any():
        return place, rests
    # on a table the true velocity is zero. The mean square plus the variance of the estimate would need many rounds to come near it
    shown = 1 - np.mean(spread[ends, 3:6]) / rests.speed**2
    slow = np.mean(way.velocity[ends] ** 2) / max(shown, _SHOWN)
    back = np.swapaxes(way.rotation[:-1], 1, 2) @ way.rotation[1:]
    turned = np.mean(logarithm(back[rests.windows]) ** 2)
    least = 0.2 * np.min(level.gyro) * np.sqrt(record.time)
    return place, Rests(rests.windows, max(float(np.sqrt(slow)), _SLOWEST), max(float(np.sqrt(turned)), float(least)))


def _rests(record: Record, vector: np.ndarray) -> Rests:
    """Windows in which the specific force hardly changes and the device hardly rotates, for at least a second."""
    size = 2 * max(round(0.5 / record.grid.step), 2) + 1
    bias = vector[[NAMES.index(f"gyro.bias[{i}]") for i in range(3)]]
    rate_of = record.gyro - bias
    rate = np.stack([np.convolve(x, np.ones(size) / size, mode="same") for x in rate_of.T], axis=1)
    calm = np.zeros(len(record.gyro), dtype=bool)
    half = size // 2
    shaken, turned = windowed_variance(record.accel, size), windowed_variance(record.gyro, size)
    calm[half : half + len(shaken)] = (shaken < _STILL_FORCE**2) & (turned < _STILL_RATE**2)
    calm &= np.linalg.norm(rate, axis=1) < _STILL_RATE
    still = calm[record.grid.inner].all(axis=1)
    if not still.any():
        return Rests(still)
    # the scatter is computed over a second, which must fit into the rest: extend the rest while single windows are as calm as inside
    force, turns = record.accel[record.grid.inner], rate_of[record.grid.inner]
    own = [np.ptp(force, axis=1).max(axis=1), np.linalg.norm(turns.mean(axis=1), axis=1), np.ptp(turns, axis=1).max(axis=1)]
    for first, stop in zip(*runs(still), strict=True):
        usual = [_CALM * np.max(size[first:stop]) for size in own]
        for at, way in ((first - 1, -1), (stop, 1)):
            for k in range(at, at + way * _MARGIN_WINDOWS, way):
                if not 0 <= k < len(still) or any(size[k] > most for size, most in zip(own, usual, strict=True)):
                    break
                still[k] = True
    return Rests(still & ~record.broken)


def _result(
    log: Any, record: Record, found: Solution, place: Place, rests: Rests, level: Noise, strength: float, axes: tuple[Any, Any],
    field: float | None, slow: dict[str, SlowNoise], derivatives: tuple[str, ...],
) -> DeviceFit:  # fmt: skip
    told = known(found, place, rests, record.time, slow)
    fitted = tuple(np.array(NAMES)[found.free].tolist())
    sensors, slope = gauged(found.vector, found.free, fitted, strength, field)
    asked = np.array([*(name.partition("[")[0] not in NUISANCE for name in fitted), True])
    # a reported parameter is determined only if all free parameters that enter its value are
    blind = np.abs(slope) @ ~told.seen > 0
    names = tuple(name for name, own in zip((*fitted, "field"), asked, strict=True) if own)
    values, blind, slope = np.append(found.vector[found.free], 0.0)[asked], blind[asked], slope[asked]
    covariance = slope @ told.covariance @ slope.T
    if wrong := [name for name in derivatives if name not in names]:
        raise DataError(f"derivatives={wrong}: no such parameter was fitted; expected some of {', '.join(names)}")
    wanted = [slope[names.index(name)] for name in derivatives]
    derived: list[dict[str, AnyArray]] = []
    for own in gradients(found, record, place, rests, np.array(wanted), strength) if wanted else ():
        derived.append({name: unfilled(by, log, name) for name, by in own.items()})
    if any(lost and sensor_of(name) == "accel" for name, lost in zip(names, blind, strict=True)):
        # delays are relative to the accelerometer: if the device hardly tilts, a delay looks like an error of the accelerometer's axes
        blind |= np.array([name.endswith("_delay") for name in names])
    if not found.converged:
        # where the cost is flat, the errors at the last step mean nothing: a sensor with an undetermined parameter gets no numbers
        open_ = {sensor_of(name) for name, lost in zip(names, blind, strict=True) if lost}
        blind |= np.array([sensor_of(name) in open_ for name in names])
    plain = vector_of(template())
    plain[GYRO : GYRO + 9] = axes[0].ravel()
    vector = found.vector.copy()
    lost = [NAMES.index(name) for name, gone in zip(names[:-1], blind, strict=False) if gone]
    vector[lost] = plain[lost]
    model = model_of(vector)
    soft, offset = (np.isin(np.arange(first, first + size), lost) for first, size in ((IRON, 9), (HARD, 3)))
    iron = np.where(soft.reshape(3, 3), axes[1], sensors["soft_iron"])
    hard = np.where(offset, 0.0, sensors["hard_iron"])
    model = DeviceModel(
        model.accel, model.gyro, MagModel(iron, hard), float(sensors["field"]), float(model.dip),
        float(model.gyro_delay), float(model.mag_delay), np.asarray(model.lever), np.asarray(model.arm),
    )  # fmt: skip
    values[[names.index(f"magnetometer.soft_iron[{i},{j}]") for i in range(3) for j in range(3)]] = sensors["soft_iron"].ravel()
    values[[names.index(f"magnetometer.hard_iron[{i}]") for i in range(3)]] = sensors["hard_iron"]
    values[-1] = sensors["field"]
    if field is not None:
        names, values, covariance, blind = names[:-1], values[:-1], covariance[:-1, :-1], blind[:-1]
    values = np.where(blind, np.nan, values)
    covariance = np.where(blind[:, None] | blind[None], np.where(np.eye(len(blind), dtype=bool), np.inf, 0.0), covariance)
    half = scipy.special.stdtrit(told.freedom, 0.975) * np.sqrt(np.diag(covariance))
    missing = lacks(found, record, told.ratio)
    number = np.maximum(found.kept.sum(axis=1), 1)[:, None]
    mag = np.reshape(found.noise.mag, (-1, 1))
    rms = np.sqrt(np.sum(found.field**2, axis=1) / number) * mag * strength
    white = float(np.median(mag[:, 0] * np.sqrt(_power(found.field, found.kept)[0])))
    disturbed = stretches(found.kept.any(axis=1) & (found.counts < 0.5), record)
    undetermined = tuple(name for name, lost in zip(names, blind, strict=True) if lost)
    facts = {
        "names": names, "values": values, "covariance": covariance, "undetermined": undetermined, "disturbed": disturbed,
        "reach": place.reach, "place": found.way.place, "disagreement": told.ratio, "converged": found.converged, "field": model.field,
        "model": model, "lacks": missing, "duration": float(log.duration), "freedom": told.freedom, "strength": strength, "axes": axes,
        "rate": float(log.rate),
    }  # fmt: skip
    verdict, reason, warnings, verdicts = judged(facts)
    start = record.grid.first * record.grid.step
    return DeviceFit(
        verdict=verdict, reason=reason, warnings=warnings, model=model, names=names, values=values, covariance=covariance,
        interval=np.stack([values - half, values + half], axis=1), degrees_of_freedom=float(told.freedom), undetermined=undetermined,
        verdicts=verdicts, disturbed=disturbed, rests=stretches(rests.windows, record),
        noise={"gyro": float(np.median(level.gyro)), "accel": float(np.median(level.accel)), "mag": float(white * strength)},
        reach=place.reach, speed=place.speed,
        disagreement=told.ratio, held_out=told.held_out,
        derivatives=dict(zip(derivatives, derived, strict=True)), time=np.append(start, start[-1] + record.time),
        attitude=found.way.rotation, velocity=found.way.velocity, place=found.way.place,
        residual_inertial=found.rows.inertial, residual_field=rms,
        gravity=record.gravity, rate=float(log.rate),
        duration=float(log.duration), contribution={kind: part[: len(names)] for kind, part in shares(told.terms, slope).items()},
    )  # fmt: skip
