"""`propagate`: the errors of the sensors through the strapdown equations; `increments`: what of them a filter has to expect."""

from collections.abc import Mapping, Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from .._answer import Quantity
from .._frozen import replaced
from .._precision import array_module, host_float64
from .._types import NoiseLike
from ..noise._terms import BUILT_IN
from ._findings import FINDINGS
from ._motion import PLACES, UP, Motion
from ._response import CELLS, LEVEL, dynamics, lags, response
from ._result import GROUPS, Budget, summed
from ._sensors import Sensors, sensors_of

TIMES = (1.0, 10.0, 60.0, 600.0, 3600.0)  # s, of the table
_DENSITY = 5  # points of the curves per decade
_FIRST = 0.1  # s, of the curves
_SETTLED = 20.0  # time constants after which an aid has forgotten: exp(-20) is 2e-9
#: a random walk that starts at zero has a mean of zero over this part of the span before it: exact to 5e-8
_START = 1e-7


_STARTS = 32  # windows along a motion: their mean is known to a fifth of its scatter
#: covariances (3, 3, 9, 9) by sensor and axis of each law (by its id), drivers (3, 9, 3, k), and transition (9, 9), of one span
Unit = tuple[dict[int, Any], Any, Any]


def unit_errors(
    sensors: Sensors, motion: Motion, table: Any, start: float, stop: float, sample: float, *, first: Any = None, mean: Any = None,
    rest: float = 0.0, aid: float | None = None, dip: float = 0.0, field: float = 1.0, latitude: float | None = None,
) -> Unit:  # fmt: skip
    """The errors at the end of a span for unit coefficients.

    table : `Motion.table`.
    sample : s between samples; the others as for `propagate`.
    first : turns the level frame, for the axes of the body at the start.
    mean : drivers whose part is known, as a bias.
    """
    begin = start if aid is None else max(start, stop - _SETTLED * aid)
    cells = motion.cells(begin, stop, CELLS, table, first)
    a, b = dynamics(aid, dip, field, latitude)
    laws = list({id(law): law for law in (BUILT_IN["N"], *(law for _, _, law, _ in sensors.terms))}.values())
    anchors = [rest or {"K": _START * (stop - start), "B": sample}.get(law.name, 0.0) for law in laws]
    tables = [lags(law, begin - start, stop - start, CELLS, anchor) for law, anchor in zip(laws, anchors, strict=True)]
    found = response(a, b, cells, np.asarray((stop - begin) / CELLS), tuple(map(np.stack, zip(*tables, strict=True))))
    xp = array_module(found)
    found = jax.tree.map(xp.asarray, found)
    driven, white, transition = found["driven"], found["white"], found["transition"] * float(begin == start)
    driven = driven if mean is None else driven - driven[..., :1] * mean
    if rest:
        # over the rest the gyroscope's mean is its bias, and the accelerometer's mean is the level
        still = np.zeros(driven.shape[-1])
        still[PLACES["one"]], still[PLACES["force"]] = 1.0, motion.attitude[0].T @ UP
        level = transition[:, :3] @ (LEVEL @ motion.attitude[0])
        own = xp.stack([-driven[0, ..., 0], level, 0 * level])  # (sensor, 9, axis)
        driven = driven + own[..., None] * still
        white = white + xp.einsum("sac,sbc->scab", own, own) / rest
    noise = {id(law): white if law.name == "N" else part for law, part in zip(laws, found["coloured"], strict=True)}
    return noise, driven, transition


def combined(sensors: Sensors, unit: Unit) -> tuple[Any, dict[str, Any], Any]:
    """Covariance (9, 9) at the end of a span, the part of each cause in its diagonal, and slopes (terms, 3, 9) by squared coefficient."""
    xp, (noise, driven, _) = array_module(sensors, unit), unit
    whole: Any = np.zeros((9, 9))
    parts: dict[str, Any] = {}
    slopes = []
    for cause, sensor, law, squares in sensors.terms:
        own = noise[id(law)][sensor]
        part = xp.einsum("c,cab->ab", squares, own)
        slopes.append(xp.diagonal(own, axis1=1, axis2=2))
        whole, parts[cause] = whole + part, parts.get(cause, 0.0) + xp.diagonal(part)
    if sensors.causes:
        drive = xp.einsum("sack,psck->ap", driven, sensors.shape[..., : driven.shape[-1]])
        each = drive * (drive @ sensors.covariance)  # parts of correlated parameters share what they have in common
        whole = whole + drive @ sensors.covariance @ drive.T
        for cause in dict.fromkeys(sensors.causes):
            parts[cause] = each[:, np.array([one == cause for one in sensors.causes])].sum(axis=1)
    return whole, parts, slopes


@host_float64
def propagate(
    sensors: NoiseLike, motion: Motion, *, at: Sequence[float] | None = None, rest: float = 0.0, initial: tuple[float, float] = (0.0, 0.0),
    errors: Mapping[str, Any] | None = None, aid: float | None = None, dip: float = np.deg2rad(60.0), field: float = 50e-6,
    latitude: float | None = None, temperature: float | None = None, rate: float | None = None,
) -> Budget:  # fmt: skip
    r"""Errors of attitude, heading, velocity and position over time, with the share of each cause.

    The errors of the sensors pass through the linear strapdown equations in a level frame,

    .. math:: \dot\varphi = C\,\delta\omega,\qquad \dot{\delta v} = \varphi \times f + C\,\delta f,\qquad \dot{\delta p} = \delta v,

    each noise term by the generalised covariance of its integral, so that flicker, a random walk or a term of your own keeps its own law.

    Parameters
    ----------
    sensors : a `Calibration` (its noise, and the covariance of its models), a `Noise` of a gyroscope, or a `Noise` by sensor,
        {"gyro": ..., "accel": ..., "mag": ...}, whose coefficients may be (3,) arrays.
    motion : `Motion`.
    at : (k,) s, times of the table; by default 1, 10, 60, 600 and 3600 s as far as the motion lasts, and its end.
    rest : s at rest before the start, whose mean gives the bias of the gyroscope and the level. With 0, both are known at the start up to
        the covariance of the calibration: a random walk starts at zero, and flicker is known as a mean over one sample.
    initial : rad, standard deviations of the level (both axes) and of the heading at the start.
    errors : standard deviations of further errors, SI, by name: "gyro.bias", "gyro.scale", "gyro.misalignment", "gyro.g_sensitivity",
        "gyro.delay" (s), "gyro.drift" (rad/s^2), the same of "accel", "accel.lever" (m), "mag.hard_iron", "mag.soft_iron". One number or
        one for each axis (row). With a thermal model in the calibration also "temperature" (degC, by which its thermometer is wrong) and
        "warming" (degC/s, by which that grows, for the biases).
    aid : s, time constant with which an accelerometer corrects the level and a magnetometer the heading, as in an AHRS; None without aid.
    dip, field : rad and T, of the Earth's field, for an aid.
    latitude : rad, for a rotating Earth, a sphere; None for a flat one at rest.
    temperature : degC of the device, for its thermal models; by default that to which the calibration refers.
    rate : Hz of the sensors, for flicker without a rest; by default that of the calibration, or 100.

    Returns
    -------
    Budget
        Its intervals come from the covariance of the noise coefficients in a calibration.

    Raises
    ------
    DataError
        If the sensors or an error are of an unknown kind.

    Examples
    --------
    White noise turns into an angle that grows with the root of time:

    >>> import numpy as np
    >>> from jaxcal.budget import Motion, propagate
    >>> from jaxcal.noise import Noise
    >>> found = propagate(Noise(N=1e-4), Motion.rest(100.0), at=[25.0, 100.0])
    >>> [f"{found.std('heading')[place]:.1e}" for place in found.shown]
    ['5.0e-04', '1.0e-03']

    References
    ----------
    D. H. Titterton and J. L. Weston, Strapdown Inertial Navigation Technology, 2nd ed., 2004, chapter 12.
    """
    known = sensors_of(sensors, errors, temperature, aid is not None)
    how = {"rest": rest, "aid": aid, "dip": dip, "field": field, "latitude": latitude}
    table = motion.table(known.shape, field * np.array([0.0, np.cos(dip), -np.sin(dip)]))
    shown = sorted([*(one for one in TIMES if one < motion.duration * (1 - 1e-9)), motion.duration] if at is None else map(float, at))
    low = min(_FIRST, shown[0])
    time = np.unique(
        [*shown, *(np.geomspace(low, shown[-1], max(2, round(_DENSITY * np.log10(shown[-1] / low))))[:-1] if at is None else ())]
    )
    begun = np.diag([initial[0], initial[0], initial[1]]) ** 2
    covariances, parts, doubts = [], [], []
    for stop in time:
        unit = unit_errors(known, motion, table, 0.0, float(stop), 1 / (rate or known.rate), **how)
        whole, each, slopes = combined(known, unit)
        if any(initial):
            own = unit[2][:, :3] @ begun @ unit[2][:, :3].T
            whole, each["initial attitude"] = whole + own, own.diagonal()
        covariances.append(whole)
        parts.append(each)
        doubts.append(_doubts(known, slopes))
    xp = array_module(covariances)
    covariance = xp.stack(covariances)
    made = Budget(
        time, covariance, {cause: xp.stack([one[cause] for one in parts]) for cause in parts[0]},
        {group: np.array([one[group] for one in doubts]) for group in GROUPS},
        tuple(int(np.argmin(np.abs(time - one))) for one in shown), motion.name, aid is not None,
        known.noise,
    )  # fmt: skip
    if xp is jnp:
        return made
    angle = float(np.sqrt(np.max(np.diagonal(covariance, axis1=1, axis2=2)[:, :3])))
    return replaced(made, findings=(*known.findings, *FINDINGS.over("large_angles", angle, angle=Quantity(angle, "angle"))))


def _doubts(sensors: Sensors, slopes: list[Any]) -> dict[str, float]:
    """Standard error of the variance of each group, from the covariance of the squared coefficients; NaN where none is known."""
    found = dict.fromkeys(GROUPS, 0.0 if sensors.spread else np.nan)
    for names, values in sensors.spread:
        own = [(names.index(cause), slope) for (cause, *_), slope in zip(sensors.terms, slopes, strict=True) if cause in names]
        where = [place for place, _ in own]
        for group in found if own else ():
            slope = np.array([summed(np.asarray(one), group) for _, one in own])  # (terms, axis)
            found[group] += float(np.einsum("tc,ctu,uc->", slope, values[:, where][:, :, where], slope))
    return {group: max(one, 0.0) ** 0.5 for group, one in found.items()}


@host_float64
def increments(
    sensors: NoiseLike, motion: Motion, *, windows: Sequence[float] = (0.1, 1.0, 5.0, 20.0), errors: Mapping[str, Any] | None = None,
    temperature: float | None = None, rate: float | None = None,
) -> Budget:  # fmt: skip
    r"""Noise of preintegrated increments that is really to be expected under a motion: static noise and calibration errors together.

    A filter assumes that the attitude of an increment over a window W scatters by :math:`N^2 W` in each axis. Errors of scale,
    misalignment and g-sensitivity under rotation and acceleration add to that, but for their mean over the motion, which a filter
    estimates as a bias. The density to write is

    .. math:: N_\mathrm{filter}^2 = \frac{1}{3 W m} \sum_{i=1}^m \operatorname{tr} P_i

    over m windows along the motion, with the covariance P of the attitude for a gyroscope, and for an accelerometer with that part of the
    covariance of the velocity which its own errors cause.

    Parameters
    ----------
    sensors, motion, errors, temperature, rate : as for `propagate`.
    windows : s; those longer than the motion are left out.

    Returns
    -------
    Budget
        Its times are the windows, its `contributions` are means over places along the motion, and `factor` is the density to write over N.

    Examples
    --------
    >>> from jaxcal.budget import Motion, increments
    >>> from jaxcal.noise import Noise
    >>> noise = {"gyro": Noise(N=1e-4), "accel": Noise(N=1e-3)}
    >>> found = increments(noise, Motion.hand(10.0), windows=[1.0], errors={"gyro.scale": 1e-3})
    >>> bool(found.factor("gyro")[0] > 1), found.covariance.shape
    (True, (1, 32, 9, 9))

    References
    ----------
    Forster, Carlone, Dellaert and Scaramuzza, IEEE Trans. Robotics 33, 2017, 1-21.
    """
    known = sensors_of(sensors, errors, temperature)
    table = motion.table(known.shape)
    mean, sample = motion.cells(0.0, motion.duration, 1, table)["mean"], 1 / (rate or known.rate)
    window = np.array([one for one in windows if one <= motion.duration * (1 + 1e-9)])
    covariances, means = [], []
    for size in window:
        found = []
        for place in np.linspace(0.0, max(motion.duration - size, 0.0) / motion.step, _STARTS if len(motion.rate) > 1 else 1).astype(int):
            start = place * motion.step
            unit = unit_errors(known, motion, table, start, start + float(size), sample, first=motion.attitude[place].T, mean=mean)
            found.append(combined(known, unit))
        covariances.append(np.stack([one[0] for one in found]))
        means.append({cause: np.mean([one[1][cause] for one in found], axis=0) for cause in found[0][1]})
    parts: Any = {cause: np.stack([one[cause] for one in means]) for cause in means[0]}
    unknown: Any = dict.fromkeys(GROUPS, np.full(len(window), np.nan))
    return Budget(
        window, np.stack(covariances), parts, unknown, tuple(range(len(window))), motion.name, False, known.noise, tuple(known.findings)
    )
