"""`ImuFit`, the result of a calibration; `observability`, how well still poses determine an accelerometer; the verdict."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray
from ..fitting import Fit, Outcome, identifiability
from ._model import Imu, Triad, entries, replaced, values
from ._prior import CONFLICT, conflict
from ._rests import StillIntervals

PLACES = np.array([p for p in itertools.product((-1.0, 0.0, 1.0), repeat=3) if any(p)])
_UP = PLACES / np.linalg.norm(PLACES, axis=1, keepdims=True)
_WORDS = (
    "scale along x", "scale along y", "scale along z", "misalignment of x and y", "misalignment of x and z", "misalignment of y and z",
    "bias along x", "bias along y", "bias along z",
)  # fmt: skip
_DIAGONAL = [0, 1, 2, 6, 7, 8]
#: limits of the condition number (18 evenly spread poses have 3 to 4): above them poses are missing, the result is uncertain, or singular
_ENOUGH, _ILL, SINGULAR = 12.0, 60.0, 300.0
_NEAR = np.cos(np.deg2rad(25.0))
_ALIKE = 20.0  # degrees
_FEW_POSES, _FEW_TURNS = 12, 10
_TURN = np.deg2rad(5.0)
#: relative standard error above which a matrix counts as unknown, and above which the verdict is weak
UNKNOWN, POOR = 0.1, 0.01
_ROTATION = np.deg2rad(0.03)
_UNITS = {"matrix": "1", "g_sensitivity": "rad/s per m/s^2"}


class Observability(eqx.Module):
    """How well the attitudes of the still poses determine the accelerometer.

    Attributes
    ----------
    condition : ratio of the largest to the smallest singular value of the Jacobian, for parameter errors of equal size.
    missing : (m, 3) directions in body axes that should point up in further poses, the most useful first.
    sentence : which parameters the poses determine, and which poses are missing.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> found = jaxcal.imu.observability(np.concatenate([np.eye(3), -np.eye(3)]))
    >>> found.condition, found.sentence[:52]
    (inf, 'The 6 poses do not determine misalignment of x and y')
    """

    condition: float
    missing: AnyArray
    sentence: str = eqx.field(static=True)


def _rows_of(up: np.ndarray) -> np.ndarray:
    """Derivative of |f|/g with respect to a symmetric change E of the correction and a change c of the bias: u'Eu + u'c."""
    x, y, z = up.T
    return np.stack([x * x, y * y, z * z, 2 * x * y, 2 * x * z, 2 * y * z, x, y, z], axis=1)


def _condition(information: np.ndarray) -> tuple[float, np.ndarray]:
    """Condition number of the Jacobian, and the share of each parameter in the least determined directions."""
    values, vectors = np.linalg.eigh(information)
    least = max(float(values[0]), 0.0)
    weak = values <= max(values[-1] / SINGULAR**2, 1.5 * least)
    condition = float(np.sqrt(values[-1] / least)) if least > 1e-12 * values[-1] else np.inf
    return condition, np.sqrt(np.sum(vectors[:, weak] ** 2, axis=1))


def _name(direction: np.ndarray) -> str:
    """Name a direction by the nearest face, edge or corner of the case."""
    place = PLACES[np.argmax(_UP @ direction)]
    axes = [f"{'+' if sign > 0 else '-'}{axis}" for sign, axis in zip(place, "xyz", strict=True) if sign]
    return " and ".join([", ".join(axes[:-1]), axes[-1]] if len(axes) > 1 else axes) + " up"


def observability(up: np.ndarray, diagonal: bool = False) -> Observability:
    """Check how well the attitudes of still poses determine an accelerometer, before or after you record them.

    Parameters
    ----------
    up : (k, 3) unit vectors, the upward direction in body axes of each pose.
    diagonal : True for a model without misalignment: three scales and three biases.

    Returns
    -------
    Observability
        Condition number, missing directions, and a sentence.

    Examples
    --------
    The six faces determine scale and bias, but not misalignment:

    >>> import numpy as np
    >>> import jaxcal
    >>> faces = np.concatenate([np.eye(3), -np.eye(3)])
    >>> jaxcal.imu.observability(faces).condition
    inf
    >>> jaxcal.imu.observability(faces, diagonal=True).sentence[:33]
    'The 6 poses determine every param'

    References
    ----------
    The singular values of the Jacobian of the magnitude residuals of D. Tedaldi, A. Pretto and E. Menegatti, ICRA 2014, equation (10),
    for parameter errors of equal size.
    """
    chosen = _DIAGONAL if diagonal else list(range(9))
    told = _rows_of(up)[:, chosen]
    information = told.T @ told / len(up)
    condition, share = _condition(information)
    words = ", ".join(_WORDS[chosen[i]] for i in range(len(chosen)) if share[i] > 0.5 * share.max())
    if condition <= _ENOUGH:
        return Observability(condition, np.zeros((0, 3)), f"The {len(up)} poses determine every parameter; least certain: {words}.")
    extra = _rows_of(_UP)[:, chosen] / len(up)
    free = np.all(_UP @ up.T < _NEAR, axis=1)
    picked: list[np.ndarray] = []
    grown = information + 1e-6 * np.eye(len(chosen))
    while free.any() and len(picked) < 9 and _condition(grown)[0] > _ENOUGH / 2:
        # choose the pose that increases the information most; it counts as if it were held three times
        gain = np.array([np.linalg.slogdet(grown + 3 * len(up) * np.outer(row, row))[1] for row in extra])
        best = int(np.argmax(np.where(free, gain, -np.inf)))
        picked.append(_UP[best])
        grown = grown + 3 * len(up) * np.outer(extra[best], extra[best])
        free &= _UP @ _UP[best] < _NEAR
    if (apart := spread_of(up)) < _ALIKE:
        words = f"the accelerometer: they are all alike, within {max(apart, 1):.0f} degrees of one attitude"
    degree = "do not determine" if condition > SINGULAR else "hardly determine" if condition > _ILL else "leave uncertain"
    advice = "; ".join(_name(direction) for direction in picked)
    sentence = f"The {len(up)} poses {degree} {words} (condition number {condition:.3g})."
    return Observability(condition, np.array(picked).reshape(-1, 3), sentence + (f" Add poses with {advice}." if picked else ""))


def spread_of(up: np.ndarray) -> float:
    """Largest angle between a pose's vertical and the mean of all, in degrees."""
    middle = up.mean(axis=0)
    return float(np.rad2deg(np.arccos(np.clip(np.min(up @ middle) / max(np.linalg.norm(middle), 1e-12), -1, 1))))


def _unknown(*shape: int, fill: float = np.nan) -> Any:
    return eqx.field(default_factory=lambda: np.full(shape, fill))


class ImuFit(Result):
    """Accelerometer and gyroscope, calibrated from a recording of still poses and the turns between them.

    Attributes
    ----------
    accel, gyro : `Triad`s, or the subclasses that were fitted, in the frame of `convention`; None if the recording does not determine
        the sensor, or has no gyroscope.
    covariance : (p, p) covariance of the parameters in `names`, in units of the readings per SI; zero for parameters that the convention
        or an option fixes. Poses and turns count as independent; errors common to all samples of a still interval are included.
    interval : (p, 2) limits of the 95 % confidence intervals.
    robust_covariance : (p, p) sandwich covariance with poses and turns as clusters; it also holds if their errors differ in size.
    degrees_of_freedom : (p,) degrees of freedom of each parameter's standard error.
    residual_norm : (k,) gravity minus the magnitude of the corrected specific force of each pose, m/s^2.
    residual_turn : (s,) angle after each turn between the vertical predicted by the gyroscope and that of the accelerometer, rad.
    residual_rest : (k, 3) rates at rest minus the model, rad/s.
    sigma : (3,) standard deviations of these three residuals for one pose or turn: m/s^2, rad, rad/s.
    down_weighted : two index arrays, the poses and the turns whose weight under the robust loss is below one half.
    cost : (2,) half the sums of squared residuals, accelerometer (m/s^2)^2 and gyroscope; imu_tk's cost for method="imu_tk".
    held_out : (2,) rms error on poses and turns left out of the fit: magnitude (m/s^2) and components of the turns (rad).
    still : the `StillIntervals` that the fit used.
    thresholds : (m, 6) one row for each set of rests that was compared: multiple of the accelerometer's variance at rest, number of
        intervals, total cost of the magnitudes, leave-one-out rms of the magnitudes (m/s^2), multiple of the gyroscope's variance,
        leave-one-out rms of the components of the turns (rad; NaN if only the magnitudes were compared).
    observability : `Observability`: condition, missing attitudes, sentence.
    drift : (3,) drift of the gyroscope's bias, rad/s per s; zero if the F test finds none.
    asked : names of terms that the log supports and the model lacks; pass them as `terms`.
    rate : Hz. gravity : m/s^2.
    temperature : mean of the recording, degC; NaN if it was not recorded.
    verdict : "good", "weak" or "refused".
    reason : one or more sentences that explain the verdict.
    warnings : further sentences.
    convention, method : the options of the fit.

    Examples
    --------
    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=4, rate=50, still=3, turn=2, seed=0)
    >>> found = jaxcal.imu.multi_position(log, gravity=9.81)
    >>> found.verdict, found.reason[:28]
    ('refused', 'There are 4 still intervals;')
    """

    rate: float
    gravity: float
    temperature: float
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    convention: str = eqx.field(static=True)
    method: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True, default=())
    accel: Triad | None = None
    gyro: Triad | None = None
    covariance: AnyArray = _unknown(33, 33, fill=np.inf)
    interval: AnyArray = _unknown(33, 2)
    robust_covariance: AnyArray = _unknown(33, 33, fill=np.inf)
    degrees_of_freedom: AnyArray = _unknown(33, fill=0.0)
    residual_norm: AnyArray = _unknown(0)
    residual_turn: AnyArray = _unknown(0)
    residual_rest: AnyArray = _unknown(0, 3)
    sigma: AnyArray = _unknown(3)
    down_weighted: tuple[Any, Any] = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))
    cost: AnyArray = _unknown(2)
    held_out: AnyArray = _unknown(2)
    still: StillIntervals | None = None
    thresholds: AnyArray = _unknown(0, 6)
    observability: Observability | None = None
    drift: AnyArray = _unknown(3, fill=0.0)
    asked: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def model(self) -> Imu:
        """Both sensors; a missing sensor is a `Triad` of NaN."""
        return self._both(np.nan)

    def _both(self, missing: float) -> Imu:
        """Both sensors; a missing one is the unit triad multiplied by `missing`."""
        unit = Triad(missing * np.eye(3), missing * np.zeros(3), missing * np.zeros((3, 3)))
        return Imu(*(unit if sensor is None else sensor for sensor in (self.accel, self.gyro)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters: the 33 of both triads, then those of subclasses of `Triad`."""
        return entries(self.model)[0]

    @property
    def values(self) -> np.ndarray:
        """(p,) parameters in the order of `names`; NaN for a missing sensor."""
        return values(self.model)

    _figure = ("imu", False)

    def _rows(self) -> list[Row]:
        fields = [name.split("[")[0].split(".") for name in self.names]
        units = [_UNITS.get(field[1], ("m/s^2" if field[0] == "accel" else "rad/s") if field[1] == "bias" else "") for field in fields]
        rows = zip(self.names, self.values, self.interval, units, strict=True)
        return [Row(name, value, low, high, unit) for name, value, (low, high), unit in rows if np.isfinite(value)]

    @property
    def standard_error(self) -> np.ndarray:
        """(p,) standard errors: square roots of the diagonal of the covariance."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @host_float64
    def propagate(self, function: Any) -> tuple[AnyArray, AnyArray]:
        """Value and covariance of a function of both triads, to first order.

        Parameters
        ----------
        function : takes (accel, gyro), the two sensors, and returns an array; JAX traces it.

        Returns
        -------
        The value of the function, and the covariance of its entries in the order of `ravel`.
        """
        model = self._both(1.0)

        def of(x: AnyArray) -> AnyArray:
            moved = replaced(model, x)
            return function(moved.accel, moved.gyro)

        value, slope = jax.jit(lambda x: (of(x), jax.jacfwd(lambda x: jnp.ravel(of(x)))(x)))(values(model))
        return value, np.asarray(slope) @ self.covariance @ np.asarray(slope).T


def finished(
    result: ImuFit, fit: Fit, options: Any, notes: list[str], explain: Callable[[], str | None], missing: Sequence[str] = ()
) -> ImuFit:
    """Add the 95 % intervals (Student's t) and the verdict with the sentences that explain it, the most serious first.

    `explain` returns a unit or an order of axes that would repair a refused fit, or None; `missing` are sentences on terms that the
    model lacks.
    """
    half = scipy.special.stdtrit(np.maximum(result.degrees_of_freedom, 1), 0.975) * result.standard_error
    interval = np.stack([result.values - half, result.values + half], axis=1)
    seen: Any = result.observability
    gyro, poses, turns = result.gyro is not None, len(result.residual_norm), len(result.residual_turn)
    force = relative_error(result, 0)
    rate = relative_error(result, 12) if gyro else 0.0
    rms = float(np.sqrt(np.mean(result.residual_turn**2))) if turns else 0.0
    refused, weak = [], list(missing)
    if not bool(fit.usable) and fit.outcome != Outcome.unidentifiable:
        refused.append(f"The fit failed: {fit.message}")
    if rms > _TURN:
        refused.append(
            f"After a turn the gyroscope's vertical is {np.rad2deg(rms):.1f} degrees (rms) off the accelerometer's: wrong axes or unit."
        )
    if gyro and not refused and not rate <= UNKNOWN:
        refused.append(
            "The turns do not determine the gyroscope: turn by 45 to 180 degrees about several horizontal axes. A rotation about "
            "the vertical tells nothing."
        )
    if fit.outcome == Outcome.unidentifiable and not refused and (seen.condition <= SINGULAR or options.prior is not None):
        refused.append(identifiability(fit).sentence)
    elif not force <= UNKNOWN:
        refused.append(seen.sentence)
    apart = 1.0 if options.prior is None else conflict(fit)
    if apart < CONFLICT:
        weak.append(f"The prior contradicts the recording (p = {apart:.1g}): the device has changed, or the prior is another's.")
    if poses < _FEW_POSES and options.misalignment and options.prior is None:
        weak.append(f"There are {poses} poses, 18 to 24 are advised.")
    if seen.condition > _ILL and options.prior is None and not gyro:
        weak.append(seen.sentence)
    if gyro and turns < _FEW_TURNS and options.prior is None:
        weak.append(f"There are {turns} turns, 10 or more are advised.")
    if gyro and POOR < rate <= UNKNOWN:
        weak.append(f"The gyroscope's matrix is known to {100 * rate:.2g} % only; add turns of 45 to 180 degrees about other axes.")
    if POOR < force <= UNKNOWN:
        weak.append(f"The accelerometer's matrix is known to {100 * force:.2g} % only. {seen.sentence}")
    for kind, which, count in zip(("poses", "turns"), result.down_weighted, (poses, turns), strict=True):
        if len(which) > max(2, 0.2 * count):
            weak.append(f"{len(which)} of {count} {kind} do not agree with the others: the sensor moved, or was bumped.")
    if result.sigma[0] > 0.02 * options.gravity:
        weak.append(f"The norms scatter by {result.sigma[0]:.2g} m/s^2: the sensor moved while it should rest, or is not linear.")
    if gyro and options.latitude is None and 0 < rms < _ROTATION:
        notes.append("The turns agree so well that the Earth's rate matters: give the `latitude` (--earth-rate --latitude).")
    verdict, sentences = "refused" if refused else "weak" if weak else "good", [*refused, *weak]
    if refused and (why := explain()):
        sentences.append(why)
    if verdict == "good":
        second = f", gyroscope {parts_of(rate)}" if gyro else ""
        sentences = [f"Standard errors: accelerometer {parts_of(force)}{second} in scale and misalignment."]
    return dataclasses.replace(result, interval=interval, verdict=verdict, reason=" ".join(sentences), warnings=tuple(notes))


def relative_error(result: ImuFit, first: int) -> float:
    """Largest standard error of the entries of a matrix relative to its scale; `first` is the index of the matrix in `names`."""
    errors, matrix = (x[first : first + 9].reshape(3, 3) for x in (result.standard_error, result.values))
    return float(np.max(errors / np.abs(np.diag(matrix))[:, None]))


def parts_of(value: float) -> str:
    """Format a ratio in % or ppm."""
    return f"{100 * value:.2g} %" if value >= 1e-4 else f"{1e6 * value:.2g} ppm"
