"""`ImuFit`: both triads with what is known about them."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._precision import host_float64
from .._results import Result, Row
from .._types import AnyArray, Array
from ._frames import in_convention
from ._joint import ImuParameters
from ._observe import Observability
from ._static import StillIntervals
from ._triad import Triad

NAMES = (
    *(f"accel.matrix[{i},{j}]" for i in range(3) for j in range(3)), *(f"accel.bias[{i}]" for i in range(3)),
    *(f"gyro.matrix[{i},{j}]" for i in range(3) for j in range(3)), *(f"gyro.bias[{i}]" for i in range(3)),
    *(f"gyro.g_sensitivity[{i},{j}]" for i in range(3) for j in range(3)),
)  # fmt: skip


class ImuFit(Result):
    """An accelerometer and a gyroscope from a recording of still poses and the turns between them.

    Attributes
    ----------
    accel, gyro : `Triad`s, in the frame of `convention`; None where the recording allows none, or has no gyroscope.
    covariance : (33, 33) of the parameters in `names`, in units of the readings per SI. What the convention or an option fixes has
        zeros. Poses and turns are the independent units of it: errors that are common to a still interval are in it.
    interval : (33, 2) limits of the intervals of 95 %.
    robust_covariance : (33, 33) the sandwich form, clusters being poses and turns, which also holds where their errors differ in size.
    degrees_of_freedom : (33,) of the estimate of each parameter's standard error.
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

    accel: Triad | None
    gyro: Triad | None
    covariance: AnyArray
    interval: AnyArray
    robust_covariance: AnyArray
    degrees_of_freedom: AnyArray
    residual_norm: AnyArray
    residual_turn: AnyArray
    residual_rest: AnyArray
    sigma: AnyArray
    down_weighted: tuple[Any, Any]
    cost: AnyArray
    held_out: AnyArray
    still: StillIntervals | None
    thresholds: AnyArray
    observability: Observability | None
    drift: AnyArray
    rate: float
    gravity: float
    temperature: float
    verdict: str = eqx.field(static=True)
    reason: str = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)
    convention: str = eqx.field(static=True)
    method: str = eqx.field(static=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the 33 parameters."""
        return NAMES

    @property
    def values(self) -> np.ndarray:
        """(33,) parameters in the order of `names`; NaN for those of a sensor that is missing."""
        parts = []
        for triad, size in ((self.accel, 12), (self.gyro, 21)):
            if triad is None:
                parts.append(np.full(size, np.nan))
            else:
                flat = [np.ravel(triad.matrix), np.ravel(triad.bias)] + ([np.ravel(triad.g_sensitivity)] if size == 21 else [])
                parts.append(np.concatenate(flat))
        return np.concatenate(parts)

    def _rows(self) -> list[Row]:
        units = ["1"] * 9 + ["m/s^2"] * 3 + ["1"] * 9 + ["rad/s"] * 3 + ["rad/s per m/s^2"] * 9
        rows = zip(self.names, self.values, self.interval, units, strict=True)
        return [Row(name, value, low, high, unit) for name, value, (low, high), unit in rows if np.isfinite(value)]

    @property
    def standard_error(self) -> np.ndarray:
        """(33,) roots of the diagonal of the covariance."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))

    @host_float64
    def propagate(self, function: Any) -> tuple[AnyArray, AnyArray]:
        """Value and covariance of anything computed from both triads, to first order.

        Parameters
        ----------
        function : of (accel, gyro), two `Triad`s, that returns an array; traced by JAX.

        Returns
        -------
        Its value, and the covariance of its entries in the order of `ravel`.
        """
        x = jnp.asarray(self.values)
        missing = jnp.isnan(x)
        x = jnp.where(missing, jnp.asarray(np.concatenate([np.eye(3).ravel(), np.zeros(3), np.eye(3).ravel(), np.zeros(12)])), x)

        def flat(x: Array) -> Array:
            accel = Triad(x[:9].reshape(3, 3), x[9:12])
            return function(accel, Triad(x[12:21].reshape(3, 3), x[21:24], x[24:].reshape(3, 3)))

        value = flat(x)
        slope = jax.jacfwd(lambda x: jnp.ravel(flat(x)))(x)
        return value, slope @ jnp.asarray(self.covariance) @ slope.T


def flattened(p: ImuParameters, convention: str) -> Array:
    """The 33 named parameters of a fit, in the frame of the convention."""
    accel = jnp.linalg.inv(p.accel.correction())
    gyro = jnp.linalg.inv(p.gyro.correction())
    turned = in_convention(accel, gyro, p.gyro.g_sensitivity, convention)
    return jnp.concatenate([turned.accel.ravel(), p.accel.bias, turned.gyro.ravel(), p.gyro.bias, turned.g_sensitivity.ravel()])
