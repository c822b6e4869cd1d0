"""`ImuFit`: both triads with what is known about them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.stats

from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray
from ._model import Imu, entries, replaced, values
from ._observe import Observability
from ._static import StillIntervals
from ._triad import Triad

_UNITS = {"matrix": "1", "g_sensitivity": "rad/s per m/s^2"}


def _unknown(*shape: int, fill: float = np.nan) -> Any:
    return eqx.field(default_factory=lambda: np.full(shape, fill))


class ImuFit(Result):
    """An accelerometer and a gyroscope from a recording of still poses and the turns between them.

    Attributes
    ----------
    accel, gyro : `Triad`s, or the subclasses that were fitted, in the frame of `convention`; None where the recording allows none, or has
        no gyroscope.
    covariance : (p, p) of the parameters in `names`, in units of the readings per SI. What the convention or an option fixes has
        zeros. Poses and turns are the independent units of it: errors that are common to a still interval are in it.
    interval : (p, 2) limits of the intervals of 95 %.
    robust_covariance : (p, p) the sandwich form, clusters being poses and turns, which also holds where their errors differ in size.
    degrees_of_freedom : (p,) of the estimate of each parameter's standard error.
    residual_norm : (k,) gravity less the norm of the corrected specific force of each pose, m/s^2.
    residual_turn : (s,) angle between the vertical that the gyroscope predicts after each turn and the accelerometer's; rad.
    residual_rest : (k, 3) still rates less the model, rad/s.
    sigma : standard deviations of the three, one pose or turn: m/s^2, rad, rad/s.
    down_weighted : (poses, turns) whose weight under the robust loss is below one half, as two index arrays.
    cost : (2,) half the sums of squared residuals, accelerometer (m/s^2)^2 and gyroscope; imu_tk's cost for method="imu_tk".
    held_out : (2,) rms of the norms (m/s^2) and of the turns' components (rad) on poses and turns that the fit did not see.
    still : `StillIntervals` that were used.
    thresholds : per multiple of the initial variance (multiple, intervals, total cost, leave-one-out rms in m/s^2), (m, 4).
    observability : `Observability`: condition, missing attitudes, sentence.
    drift : (3,) drift of the gyroscope's bias, rad/s per s; zero where the F test finds none.
    rate, gravity : Hz, m/s^2.
    temperature : mean of the recording, degC; NaN where it was not recorded.
    verdict : "good", "weak" or "refused".
    reason : one sentence or more.
    warnings : sentences.
    convention, method : as asked for.
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
    thresholds: AnyArray = _unknown(0, 4)
    observability: Observability | None = None
    drift: AnyArray = _unknown(3, fill=0.0)

    @property
    def model(self) -> Imu:
        """Both sensors; a sensor that is missing is a `Triad` of NaN."""
        missing = Triad(np.full((3, 3), np.nan), np.full(3, np.nan), np.full((3, 3), np.nan))
        return Imu(*(missing if sensor is None else sensor for sensor in (self.accel, self.gyro)))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters: 33 of both triads, and those that a subclass of `Triad` adds."""
        return entries(self.model)[0]

    @property
    def values(self) -> AnyArray:
        """(p,) parameters in the order of `names`; NaN for those of a sensor that is missing."""
        return values(self.model)

    def _rows(self) -> list[Row]:
        fields = [name.split("[")[0].split(".") for name in self.names]
        units = [_UNITS.get(field[1], ("m/s^2" if field[0] == "accel" else "rad/s") if field[1] == "bias" else "") for field in fields]
        rows = zip(self.names, self.values, self.interval, units, strict=True)
        return [Row(name, value, low, high, unit) for name, value, (low, high), unit in rows if np.isfinite(value)]

    @property
    def standard_error(self) -> np.ndarray:
        """(p,) roots of the diagonal of the covariance."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @host_float64
    def propagate(self, function: Any) -> tuple[AnyArray, AnyArray]:
        """Value and covariance of anything computed from both triads, to first order.

        Parameters
        ----------
        function : of (accel, gyro), the two sensors, that returns an array; traced by JAX.

        Returns
        -------
        Its value, and the covariance of its entries in the order of `ravel`.
        """
        unit = Triad(np.eye(3), np.zeros(3))
        model = Imu(*(unit if sensor is None else sensor for sensor in (self.accel, self.gyro)))

        def of(x: AnyArray) -> AnyArray:
            moved = replaced(model, x)
            return function(moved.accel, moved.gyro)

        value, slope = jax.jit(lambda x: (of(x), jax.jacfwd(lambda x: jnp.ravel(of(x)))(x)))(values(model))
        return value, np.asarray(slope) @ self.covariance @ np.asarray(slope).T


def intervals(values: np.ndarray, covariance: np.ndarray, freedom: np.ndarray) -> np.ndarray:
    """(p, 2) limits of 95 % by Student's t."""
    half = scipy.stats.t.ppf(0.975, np.maximum(freedom, 1)) * np.sqrt(np.maximum(np.diag(covariance), 0))
    return np.stack([values - half, values + half], axis=1)
