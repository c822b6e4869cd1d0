"""`multi_position`: calibrate both triads from still poses and the turns between them, without a turntable."""

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np

from .._arrays import power_of_two
from .._errors import DataError
from .._log import LogLike
from .._message import Message
from .._precision import host_float64, is_traced
from .._types import Checked, Given, NoiseLike, Samples
from ..evidence._rests import Ends, Multiples, StillIntervals, Variances
from ..fitting import AbstractLoss, Fit, Huber
from ..fitting._result import leverage
from . import _fits, _recording
from ._estimate import solved, started
from ._findings import FINDINGS
from ._fits import Options
from ._joint import Job, count_of
from ._known import checked_gravity
from ._model import Imu, Triad, checked_convention, freed
from ._nonlinear import with_terms
from ._prior import known_of, prior_of
from ._recording import Recording
from ._result import ImuFit, assumed_gravity

_HUBER = Huber()
_TYPICAL = 0.01  # m/s^2: assumed error of a magnitude, to weight a prior before the residuals show their size


@host_float64
def multi_position(
    log: LogLike, *, gravity: float | int | None = None, convention: str = "upper", model: str | Triad | Imu = "full",
    g_sensitivity: bool = True, loss: Checked[AbstractLoss | None] = _HUBER, latitude: float | None = None, noise: NoiseLike | None = None,
    raw: bool = False, rests: Samples | None = None, held_out: bool = True, terms: str | Iterable[str] = (), prior: Given | None = None,
) -> ImuFit:  # fmt: skip
    r"""Estimate scale factors, misalignments, biases and g-sensitivity from still poses and the turns between them.

    The fit uses three facts. At rest, the corrected specific force has the magnitude of gravity in every attitude. Between two poses,
    the integrated rate rotates one vertical into the next. At rest, the rates show the bias and its dependence on the specific force:

    .. math:: g = |D_a(y_k - b_a)|,\qquad R(q_k)^T u_k = u_{k+1},\ \dot q = \tfrac12 q\,\omega,\qquad
              \bar y_k = b_g + G f_k + M_g\,\omega_E,\quad \omega = D_g(y - b_g - G f).

    The joint fit weights the three kinds of residual by their size (or by the noise coefficients, if you give them). It models the error
    of a vertical as common to the two turns that meet in it, and counts every pose and every turn as one observation.

    Parameters
    ----------
    log : `jaxcal.Log` with 18 to 50 poses of 3 s or more: six faces, twelve edges and some corners, with turns of 45 to 180 degrees
        between them. Begin with a rest of 30 s, which shows the gyroscope's bias. Missing samples shorten a rest; in a turn, short gaps
        are interpolated.
    gravity : local gravity, m/s^2; see `jaxcal.imu.gravity`. None takes standard gravity, which may be wrong by 0.3 %, as a finding says.
    convention : frame of the result, "upper", "lower" or "full" (see `turned_to`); all describe the same calibration.
    model : "full" (9 accelerometer parameters) or "diagonal" (scale and bias only, 6 poses suffice). Or a model of your own, from which
        the fit starts: a subclass of `Triad` for the accelerometer, or an `Imu` with both sensors. Every floating-point field is fitted.
    g_sensitivity : whether to fit the gyroscope's sensitivity to specific force.
    loss : a loss of `jaxcal.fitting`; `Huber()` limits the influence of a disturbed pose. None uses least squares.
    latitude : rad, to account for the Earth's rate: its vertical part follows from the latitude, the heading of the first pose is fitted.
    noise : {"accel": noise, "gyro": noise}, each a `jaxcal.noise.Noise` or {"N": ..., "B": ..., "K": ...} in SI; or the result of
        `jaxcal.noise.characterise`, or a `Calibration` with noise. It weights each rest by its length and by the wander of the bias.
    raw : True if the log holds counts; the fit then estimates the scales. Otherwise the log is in m/s^2 and rad/s.
    rests : (k, 2) first sample of each rest, and the sample after its last one, if you know them. None detects them: it compares several
        multiples of the accelerometer's variance at rest, each with several of the gyroscope's, and chooses the pair with the smallest
        expected error on omitted poses and turns.
    held_out : whether to fit twice more, each time without half of the poses and turns, to compute `held_out` of the result.
    terms : names of further terms, such as ["accel.quadratic"]: accel or gyro with quadratic, cubic or asymmetry (see `Nonlinear`),
        "accel.drift", "accel.warm_up". "auto" adds each term for which both the F test and the held-out residuals give
        evidence.
    prior : earlier knowledge of the device. Either a data sheet as standard deviations, {"accel": {"scale": 0.03, "misalignment": 0.01,
        "bias": 0.6}, "gyro": {"scale": 0.03, "misalignment": 0.01, "bias": 0.3, "g_sensitivity": 2e-4}} (relative, rad, SI); or an earlier
        `ImuFit` or `Calibration`, whose parameters except the biases are used with their covariance. Fewer poses then suffice.

    Returns
    -------
    ImuFit
        It includes a verdict. A recording that determines nothing gives a "refused" fit without triads.

    Raises
    ------
    DataError
        If the log has no accelerometer with three axes, an option is unknown, or gravity is not in m/s^2.

    Examples
    --------
    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    >>> found = jaxcal.imu.multi_position(log, gravity=9.81)
    >>> print(found.verdict, len(found.still))
    good 18

    References
    ----------
    D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014 (the protocol and the two costs); the thesis, equations (5.1) to (5.5).
    """
    gravity, assumed = assumed_gravity(gravity)
    auto = isinstance(terms, str) and terms == "auto"
    asked = () if auto else (terms,) if isinstance(terms, str) else tuple(terms)
    options = _checked(log, gravity, convention, model, g_sensitivity, loss, latitude, noise, raw, terms, prior)
    record = _recording.recording(log)
    base = ImuFit(record.rate, options.gravity, record.temperature, convention, "joint", assumed)
    if not raw and (wrong := _recording.wrong_units(record.accel, options.gravity)):
        return dataclasses.replace(base, findings=(*base.findings, wrong))
    start = started(None if isinstance(model, str) else model, record.gyro is not None, latitude is not None)
    if rests is None:
        tried = Variances(record.sensors, record.rate).tried()
    else:
        tried = {(np.inf, np.inf): _recording.given_rests(rests, len(record.time))}
    found = _fitted(record, base, with_terms(start, asked), tried, options, raw, held_out)
    while auto and found.still is not None and (new := [term for term in found.asked if term not in asked]):
        asked = (*asked, *new)
        tried = {(np.inf, np.inf): (found.still.start, found.still.stop)}
        found = _fitted(record, base, with_terms(start, asked), tried, options, raw, held_out)
    said = [FINDINGS("terms_added", terms=", ".join(asked))] if auto and asked else []
    said += [FINDINGS("gyro_dead", "gyro")] if record.gyro is None and getattr(log, "gyro", None) is not None else []
    return dataclasses.replace(found, findings=(*found.findings, *said))


def _fitted(
    record: Recording, base: ImuFit, start: Imu, tried: dict[Multiples, Ends], options: Options, raw: bool, held_out: bool
) -> ImuFit:
    """Fit the best of several sets of rests."""
    needed = max(count_of(freed(Imu(start.accel), options.convention, options.misalignment)) - known_of(options.prior), 1)
    usable = {pair: ends for pair, ends in tried.items() if len(ends[0]) >= needed}
    if not usable:
        few = FINDINGS("few_rests", count=max(len(ends[0]) for ends in tried.values()), needed=needed)
        return dataclasses.replace(base, findings=(*base.findings, few))
    count, error, fits = _norm_fits(record, usable, start.accel, options, raw)
    pair, begun, joint = (job := Job(record, start, needed, options, raw)).best(count, error, usable, fits)
    return job.result(dataclasses.replace(base, still=StillIntervals(*usable[pair], *pair)), begun, joint, held_out)


def _norm_fits(
    record: Recording, usable: dict[Multiples, Ends], model: Triad, options: Options, raw: bool
) -> tuple[np.ndarray, np.ndarray, dict[Multiples, Fit]]:
    """Fit the accelerometer to the magnitudes of every set of rests: number of rests, leave-one-out mean square, and fit of each set."""
    slots = power_of_two(max(len(start) for start, _ in usable.values()) + 1, 32)
    fits, count, error = {}, [], []
    sigma = 1.0 if options.prior is None else _TYPICAL
    for pair, ends in usable.items():
        reading = _recording.means(record.accel, *ends)
        begin = _fits.nominal_start(model, reading, options.gravity) if raw else model
        data = _recording.norms(reading, slots, options.gravity, sigma)
        fit = solved(Imu(begin), data, options.convention, options.misalignment, rtol=None, priors=options.priors)
        # leave-one-out residual of every pose, to first order
        without = sigma * np.asarray(fit.residuals) / (1 - np.minimum(leverage(fit), 1 - 1e-6))
        fits[pair] = fit
        count.append(len(reading))
        error.append(np.mean(without[: len(reading)] ** 2))
    return np.array(count), np.array(error), fits


def _checked(log, gravity, convention, model, g_sensitivity, loss, latitude, noise, raw, terms, prior) -> Options:
    if is_traced(getattr(log, "accel", None)):
        raise DataError("`multi_position` decides on the host and cannot be traced; take `imu.estimate`, which can.")
    if not (model in ("full", "diagonal") if isinstance(model, str) else isinstance(model, (Triad, Imu))):
        raise DataError(f"There is no model {model!r}; known are 'full' and 'diagonal', or give a Triad or an Imu.", code="option")
    checked_convention(convention, isinstance(model, str) or Imu(model).plain)
    if not isinstance(loss, AbstractLoss | None):
        raise DataError(f"There is no loss {loss!r}; give one of jaxcal.fitting, such as Huber(), or None.", code="option")
    if latitude is not None and not abs(float(latitude)) <= np.pi / 2:
        raise DataError(f"latitude={latitude:g} rad lies beyond a pole; degrees must be multiplied by pi/180", code="latitude")
    known = prior_of(prior)
    if raw and isinstance(prior, Mapping):
        raise DataError("A data sheet goes with readings in SI units; leave out one of them.", code="prior")
    if len(terms) and convention == "full":
        raise DataError(Message("{option.terms} goes with the convention upper or lower; leave it out."), code="term")
    return Options(
        checked_gravity(gravity), convention, bool(g_sensitivity), model != "diagonal", loss, _fits.coefficients(noise, "accel"),
        _fits.coefficients(noise, "gyro"), None if latitude is None else float(latitude), known,
    )  # fmt: skip
