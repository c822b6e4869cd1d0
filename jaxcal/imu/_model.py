"""`Triad` and `Imu`, the sensor models; the frames in which they are described; `gravity`."""

from typing import Any

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._frozen import Model
from .._precision import array_module, host_float64, is_traced
from .._types import AnyArray, Array, Held, Numbers
from .._units import EARTH_RATE as EARTH_RATE
from ..fitting._problem import names_of

_CONVENTIONS = ("upper", "lower", "full")
#: level of the tests whose outcome widens intervals or lowers the verdict: one false alarm in a thousand; level of the tests that decide
#: on a term which is then fitted, and whose false alarm costs little
LEVEL, FITTED_LEVEL = 1e-3, 0.01
#: condition number above which a matrix is no calibration, because scale factors of any sensor are within a factor of ten; the same of
#: columns of unit length, whose errors grow a hundredfold
CONDITION = 100.0


class Triad(Model):
    r"""Scale factors, misalignment, bias and g-sensitivity of an accelerometer or gyroscope triad.

    .. math:: y = M x + b + G a

    Attributes
    ----------
    matrix : (3, 3) M: reading per SI unit, I + S + N of the thesis; the identity for a sensor without errors.
    bias : (3,) b, in the unit of the readings.
    g_sensitivity : (3, 3) G: reading per m/s^2 of specific force; zero for an accelerometer.

    Examples
    --------
    >>> import equinox as eqx
    >>> import numpy as np
    >>> import jaxcal
    >>> triad = jaxcal.imu.Triad(np.diag([1.01, 1.0, 0.99]), np.array([0.1, 0.0, -0.2]))
    >>> reading = triad.measure(np.array([0.0, 0.0, 10.0]))
    >>> print(reading.round(3), triad.correct(reading).round(3))
    [0.1 0.  9.7] [ 0.  0. 10.]

    For another sensor model, write a subclass with its own fields, `measure` and `correct`. `estimate` and `multi_position` fit all its
    floating-point fields. This example adds a quadratic term:

    >>> class SquareTriad(jaxcal.imu.Triad):
    ...     square: np.ndarray = eqx.field(default_factory=lambda: np.zeros(3))
    ...     def measure(self, x, accel=None):
    ...         return super().measure(x, accel) + self.square * x**2
    ...     def correct(self, y, accel=None):
    ...         x = super().correct(y, accel)
    ...         for _ in range(5):  # a fixed point: the term is small
    ...             x = super().correct(y - self.square * x**2, accel)
    ...         return x
    >>> sensor = SquareTriad(np.eye(3), np.zeros(3), square=np.array([1e-4, 0.0, 2e-4]))
    >>> print(sensor.correct(sensor.measure(np.array([3.0, 0.0, 9.0]))).round(6))
    [3. 0. 9.]

    References
    ----------
    The thesis's equations (5.1) to (5.5), with M = I + S + N and a full matrix for the sensitivity to g.
    """

    matrix: Held
    bias: Held
    g_sensitivity: Held = eqx.field(default_factory=lambda: np.zeros((3, 3)))

    @host_float64
    def measure(self, x: Numbers, accel: Numbers | None = None) -> AnyArray:
        """Compute the readings M x + b + G a.

        Parameters
        ----------
        x : (3,) or (n, 3) angular rate in rad/s, or specific force in m/s^2.
        accel : specific force, same shape, m/s^2; required if the triad has a g-sensitivity.

        Returns
        -------
        Readings in the shape of `x`.

        Raises
        ------
        DataError
            If the triad has a g-sensitivity and `accel` is missing, or if the shapes differ.
        """
        x, matrix, offset = self._terms(x, accel)
        return x @ matrix.T + offset

    @host_float64
    def correct(self, y: Numbers, accel: Numbers | None = None) -> AnyArray:
        """Correct readings: the measured quantity M^-1 (y - b - G a).

        Parameters
        ----------
        y : (3,) or (n, 3) readings.
        accel : specific force from the corrected accelerometer, same shape, m/s^2; required if the triad has a g-sensitivity.

        Returns
        -------
        rad/s or m/s^2, in the shape of `y`.

        Raises
        ------
        DataError
            If `matrix` is singular or nearly so (condition number above 100), if the triad has a g-sensitivity and `accel` is
            missing, or if the shapes differ.
        """
        y, matrix, offset = self._terms(y, accel)
        if not is_traced(matrix):
            condition = np.linalg.cond(np.asarray(matrix, dtype=float))
            if not condition <= CONDITION:
                said = f"The matrix has the condition number {condition:.3g}, beyond {CONDITION:g}: the axes span no space. Calibrate again"
                raise DataError(said, code="singular")
        return (y - offset) @ inverse(matrix).T

    def _terms(self, x: Any, accel: Any) -> tuple[AnyArray, AnyArray, AnyArray]:
        """The vectors, M, and b + G a for each vector, as arrays of one dtype; NumPy arrays unless JAX traces."""
        if accel is None and not is_traced(self.g_sensitivity) and np.any(np.asarray(self.g_sensitivity)):
            raise DataError("This triad has a g-sensitivity: give the specific force with accel=.", code="no_force")
        xp, force = array_module(self, x, accel), [] if accel is None else [accel]
        leaves = [x, self.matrix, self.bias, *force]
        kind = np.result_type(*(leaf.dtype if hasattr(leaf, "dtype") else np.dtype(float) for leaf in leaves), np.float32)
        dtype = jax.dtypes.canonicalize_dtype(kind)
        x, matrix, bias, *force = (xp.asarray(leaf, dtype=dtype) for leaf in leaves)
        if x.ndim not in (1, 2) or x.shape[-1] != 3 or any(f.shape != x.shape for f in force):
            other = "".join(f" and accel {f.shape}" for f in force)
            raise DataError(f"The vectors have shape {x.shape}{other}; expected (3,) or (n, 3), and the same for both.", code="shapes")
        offset = xp.broadcast_to(bias, x.shape)
        for f in force:
            offset = offset + f @ xp.asarray(self.g_sensitivity, dtype=dtype).T
        return x, matrix, offset


def inverse(matrix: AnyArray) -> AnyArray:
    """Inverse of a (3, 3) matrix by cofactors, which compile ten times as fast as LAPACK's factorisation."""
    xp = array_module(matrix)
    cofactor = xp.cross(xp.roll(matrix, -1, axis=0), xp.roll(matrix, -2, axis=0))
    return cofactor.T / xp.sum(matrix[0] * cofactor[0])


class Imu(Model):
    """Accelerometer and gyroscope of one device.

    Attributes
    ----------
    accel, gyro : `Triad`, or a subclass with its own fields, `measure` and `correct`; None for a missing sensor.
    drift : (3,) drift of the gyroscope's bias, readings per s; None for no drift.
    accel_drift : (3,) drift of the accelerometer's bias, readings per s; None for no drift. The bias is that of the middle of the record.
    accel_warm_up : (3,) offset of the accelerometer's bias at the beginning, in readings. It decays with a time constant of a quarter of
        the recording, and the bias is the settled value. None for no warm-up.
    accel_creep : (3,) share of a change of the force that the accelerometer follows with a time constant of 15 s; None for no creep.
    north : (2,) direction of the horizontal part of the Earth's rate in the first pose, as cosine and sine of a heading; None if the
        Earth's rate is ignored.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Imu, Triad
    >>> Imu(Triad(np.eye(3), np.zeros(3))).gyro is None
    True
    """

    accel: Any
    gyro: Any = None
    drift: Any = None
    north: Any = None
    accel_drift: Any = None
    accel_warm_up: Any = None
    accel_creep: Any = None

    @property
    def plain(self) -> bool:
        """Whether both sensors are plain `Triad`s, which are linear in their readings, and not subclasses."""
        return all(type(sensor) in (Triad, type(None)) for sensor in (self.accel, self.gyro))


def checked_convention(convention: str, plain: bool) -> None:
    """Refuse an unknown convention, and "full" for a subclass of `Triad`, which cannot be turned into it."""
    if convention not in _CONVENTIONS:
        raise DataError(f"There is no convention {convention!r}; known are {', '.join(map(repr, _CONVENTIONS))}.", code="option")
    if convention == "full" and not plain:
        said = "A subclass of Triad cannot be turned into the frame 'full'; take the convention 'upper' or 'lower'."
        raise DataError(said, code="full_of_own_model")


def entries(model: Imu) -> tuple[tuple[str, ...], np.ndarray]:
    """Names of the parameters of both sensors, and their indices among all floating-point leaves of the model.

    The g-sensitivity of an accelerometer is not a parameter.
    """
    names = names_of(model)
    kept = [name for name in names if name.startswith(("accel.", "gyro.")) and not name.startswith("accel.g_sensitivity")]
    return tuple(kept), np.array([names.index(name) for name in kept])


def values(model: Imu) -> Any:
    """Parameters in the order of `entries`."""
    xp = array_module(model)
    leaves = [xp.ravel(xp.asarray(leaf)) for leaf in jax.tree.leaves(eqx.filter(model, eqx.is_inexact_array))]
    return xp.concatenate(leaves)[entries(model)[1]]


def replaced(model: Imu, parameters: AnyArray) -> Imu:
    """The model with new parameters, given in the order of `entries`."""
    floats, rest = eqx.partition(model, eqx.is_inexact_array)
    vector, unravel = jax.flatten_util.ravel_pytree(floats)
    return eqx.combine(unravel(vector.at[entries(model)[1]].set(parameters)), rest)


def freed(model: Imu, convention: str, misalignment: bool = True, g_sensitivity: bool = True) -> Imu:
    """A tree of the model's form that marks the entries to fit: all except those that the convention or an option holds fixed."""
    free = jax.tree.map(lambda leaf: np.ones(np.shape(leaf), dtype=bool), eqx.filter(model, eqx.is_inexact_array))
    if model.accel is not None:
        square = np.ones((3, 3), dtype=bool)
        matrix = np.eye(3, dtype=bool) if not misalignment else np.tril(square) if convention == "lower" else np.triu(square)
        free = eqx.tree_at(lambda m: (m.accel.matrix, m.accel.g_sensitivity), free, (matrix, ~square))
    if model.gyro is not None:
        free = eqx.tree_at(lambda m: m.gyro.g_sensitivity, free, np.full((3, 3), g_sensitivity))
    return free


def turned_to(correction: Any, convention: str) -> Array:
    """Rotate a correction matrix D into the frame of a convention: the D' of that form with D'^T D' = D^T D.

    Parameters
    ----------
    correction : (3, 3) D = T K, from readings to m/s^2.
    convention : "upper": sensor axis z lies along frame axis z, sensor y in the plane of y and z; "lower": x along x, y in the plane
        of x and y; "full": symmetric, the frame nearest to the sensor's axes.

    Returns
    -------
    (3, 3); D' D^-1 is the rotation of the frame.

    References
    ----------
    The Cholesky factor of D'D; for "full" the polar factor by Newton's iteration: N. J. Higham, SIAM J. Sci. Stat. Comput. 7, 1986,
    equation (3.3).
    """
    correction = jnp.asarray(correction)
    if convention != "full":
        flip = slice(None, None, 1 if convention == "upper" else -1)
        return jnp.linalg.cholesky((correction.T @ correction)[flip, flip]).T[flip, flip]
    # Newton's iteration for the polar factor: unlike that of an SVD, its derivative exists for equal singular values
    rotation = correction / jnp.cbrt(jnp.linalg.det(correction))
    for _ in range(12):
        rotation = (rotation + jnp.linalg.inv(rotation).T) / 2
    half = rotation.T @ correction
    return (half + half.T) / 2


@host_float64
def in_convention(imu: Imu, convention: str) -> Imu:
    """Describe the same device in the frame of a convention: matrices M Q', sensitivities G Q', unchanged biases.

    Parameters
    ----------
    imu : accelerometer and optional gyroscope; both plain `Triad`s.
    convention : "upper", "lower" or "full", see `turned_to`.

    Returns
    -------
    Imu

    Raises
    ------
    DataError
        For a subclass of `Triad`, because jaxcal cannot rotate its additional parameters.
    """
    if not imu.plain:
        raise DataError(f"A sensor has parameters of its own, which cannot be turned into the frame {convention!r}; fit it in that frame.")
    accel = jnp.asarray(imu.accel.matrix)
    new = turned_to(inverse(accel), convention)
    turn = (new @ accel).T
    turned = eqx.tree_at(lambda m: m.accel.matrix, imu, inverse(new))
    if imu.gyro is None:
        return turned
    gyro = (jnp.asarray(imu.gyro.matrix) @ turn, jnp.asarray(imu.gyro.g_sensitivity) @ turn)
    return eqx.tree_at(lambda m: (m.gyro.matrix, m.gyro.g_sensitivity), turned, gyro)


@host_float64
def gravity(latitude: Numbers, height: Numbers = 0.0) -> AnyArray:
    r"""Normal gravity of WGS 84.

    .. math:: g = g_e\frac{1 + k\sin^2\varphi}{\sqrt{1 - e^2\sin^2\varphi}} - 3.086\cdot10^{-6}\,h

    Parameters
    ----------
    latitude : rad.
    height : m above the ellipsoid.

    Returns
    -------
    m/s^2; gravity anomalies change the true value by up to 1e-3 m/s^2.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import gravity
    >>> print(f"{gravity(np.deg2rad(45.0)):.5f}")
    9.80620

    References
    ----------
    NIMA TR8350.2, Department of Defense World Geodetic System 1984, equation 4-1, and the free-air gradient.
    """
    square = jnp.sin(jnp.asarray(latitude, dtype=jnp.result_type(float))) ** 2
    return 9.7803253359 * (1 + 0.00193185265241 * square) / jnp.sqrt(1 - 0.00669437999014 * square) - 3.086e-6 * jnp.asarray(height)
