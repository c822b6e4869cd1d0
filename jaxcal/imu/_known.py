"""`six_position` and `rate_table`: fit a triad to known inputs by linear least squares, axis by axis (host, NumPy)."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._precision import host_float64
from .._results import Row, Unjudged
from .._types import AnyArray
from ..fitting import information
from ._model import EARTH_RATE, Triad

#: upward axis of each of the six positions
SIX = np.kron(np.eye(3), np.array([[1.0], [-1.0]]))
_FORCE = ("rate about x", "rate about y", "rate about z", "bias", "g-sensitivity along x", "g-sensitivity along y", "g-sensitivity along z")
_UP = ("specific force along x", "specific force along y", "specific force along z", "bias")
_RANK = 1e-8


class TriadFit(Unjudged):
    """A triad fitted to known inputs.

    Attributes
    ----------
    triad : the fitted `Triad`.
    covariance : (p, p) covariance of the parameters in `names`, in the units of the readings per SI.
    interval : (p, 2) limits of the 95 % confidence intervals, in the order of `names`.
    residual : (k, 3) readings minus the fitted readings.
    sigma : (3,) standard deviation of a mean reading, as given or estimated from the residuals.
    degrees_of_freedom : degrees of freedom of the residuals of one axis.
    names : names of the parameters: matrix by rows, bias, and g-sensitivity by rows if it was fitted.
    warnings : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Triad, six_position
    >>> true = Triad(np.diag([1.01, 0.99, 1.0]), np.array([0.1, -0.2, 0.0]))
    >>> found = six_position(true.measure(9.81 * np.kron(np.eye(3), np.array([[1.0], [-1.0]]))), 9.81, sigma=1e-3)
    >>> print(repr(found).splitlines()[10])
      bias[0]      0.10000   0.09920 to 0.10080
    """

    triad: Triad
    covariance: AnyArray
    interval: AnyArray
    residual: AnyArray
    sigma: AnyArray
    degrees_of_freedom: int
    names: tuple[str, ...] = eqx.field(static=True)
    warnings: tuple[str, ...] = eqx.field(static=True)

    def _rows(self) -> list[Row]:
        fields = {"matrix": self.triad.matrix, "bias": self.triad.bias, "g_sensitivity": self.triad.g_sensitivity}
        value = np.concatenate([np.ravel(fields[name]) for name in fields])[: len(self.names)]
        return [Row(name, x, low, high) for name, x, (low, high) in zip(self.names, value, self.interval, strict=True)]


def checked_gravity(gravity: Any) -> float:
    """Return gravity as a float in m/s^2, or refuse a value in another unit."""
    value = float(gravity)
    if 0.5 < abs(value) < 2.0:
        raise DataError(f"gravity={value:g} looks like g; it is asked for in m/s^2, about 9.81 (jaxcal.imu.gravity(latitude) gives it)")
    if not 9.0 < value < 10.5:
        raise DataError(f"gravity={value:g} m/s^2 is not found on Earth; expected about 9.81 (jaxcal.imu.gravity(latitude) gives it)")
    return value


def _triad_of(
    x: np.ndarray, y: np.ndarray, sigma: Any, words: tuple[str, ...], advice: str, warnings: tuple[str, ...] = (), servo: float = 0.0
) -> TriadFit:
    """Fit readings `y` to columns [input, 1] or [input, 1, specific force]; `sigma` None estimates the noise from the residuals."""
    known = information(x, tolerance=_RANK)
    share = np.sqrt(np.sum(known.vectors[known.singular_values == 0] ** 2, axis=0))
    if np.any(share > 1e-3):
        open_ = ", ".join(word for word, part in zip(words, share, strict=False) if part > 0.1)
        raise DataError(f"{len(x)} positions do not determine every parameter: {open_} cannot be told apart. {advice}")
    unit, columns = known.covariance, x.shape[1]
    beta, freedom = unit @ (x.T @ y), len(x) - columns
    residual = y - x @ beta
    if sigma is None:
        if freedom < 1:
            raise DataError(
                f"{len(x)} readings leave nothing to tell their noise from; give sigma=, the standard deviation of a mean reading"
            )
        # the three axes share one noise level, which triples the degrees of freedom
        sigma = np.full(3, np.sqrt(np.sum(residual**2) / (3 * freedom)))
        quantile = scipy.special.stdtrit(3 * freedom, 0.975)
    else:
        sigma = np.broadcast_to(np.asarray(sigma, dtype=float), (3,))
        if not (np.isfinite(sigma).all() and (sigma > 0).all()):
            raise DataError(f"sigma={sigma.tolist()} must be positive, in the unit of the readings")
        quantile = scipy.special.ndtri(0.975)
        noise = np.sqrt(np.sum(residual**2, axis=0) / max(freedom, 1))
        limit = np.sqrt(2 * scipy.special.gammaincinv(max(freedom, 1) / 2, 0.999) / max(freedom, 1))
        if freedom > 0 and np.any(noise > limit * sigma):
            warnings = (
                *warnings,
                f"The readings scatter by {np.max(noise / sigma):.2g} times the noise given: levelling, repeatability or the model. The "
                "intervals are too narrow; leave out sigma= to take it from the scatter.",
            )
    # the fit is ordered by axis, the names are ordered by field: name -> (axis, column)
    fields = {"matrix[{},{}]": range(3), "bias[{}]": (3,), "g_sensitivity[{},{}]": range(4, columns)}
    names = {name.format(axis, i): (axis, column) for name, part in fields.items() for axis in range(3) for i, column in enumerate(part)}
    axis, column = np.array(list(names.values())).T
    value = beta[column, axis]
    scale = np.where(column < 3, value, 0.0)
    covariance = np.kron(np.diag(sigma**2), unit)[np.ix_(columns * axis + column, columns * axis + column)]
    covariance = covariance + servo**2 * np.outer(scale, scale)
    half = quantile * np.sqrt(np.diag(covariance))
    triad = Triad(beta[:3].T, beta[3], beta[4:].T if columns == 7 else np.zeros((3, 3)))
    interval = np.stack([value - half, value + half], axis=1)
    return TriadFit(triad, covariance, interval, residual, np.asarray(sigma), freedom, tuple(names), warnings)


def _readings_of(values: Any, name: str) -> np.ndarray:
    """Return the values as a (k, 3) array of finite numbers, or refuse them."""
    try:
        array = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{name} does not hold numbers; give an array of shape (k, 3)") from error
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise DataError(f"{name} has shape {array.shape}; expected (k, 3), one row a position")
    if not np.isfinite(array).all():
        raise DataError(f"{name} holds {np.sum(~np.isfinite(array))} values that are not finite; leave those positions out")
    return array


@host_float64
def six_position(readings: Any, gravity: float | int, *, up: Any = None, sigma: Any = None) -> TriadFit:
    r"""Calibrate an accelerometer from positions of known attitude: the six faces of a rectangular block, or others.

    .. math:: y_k = M f_k + b,\qquad f_k = g\,u_k;\qquad
              M_{\cdot j} = \frac{y_{j+} - y_{j-}}{2g},\quad b = \tfrac16\textstyle\sum y

    The second form is the least-squares solution for the six faces.

    Parameters
    ----------
    readings : (6, 3) mean readings with x up, x down, y up, y down, z up, z down; or (k, 3) with `up`.
    gravity : local gravity, m/s^2.
    up : (k, 3) upward direction in body axes of each position; None for the six faces.
    sigma : standard deviation of a mean reading, one or (3,); None estimates it from the residuals. It combines the noise,
        N / sqrt(dwell), and the repeatability of the table: a levelling error of 0.5 degrees alone causes a misalignment of 6e-3 and a
        bias of 0.03 m/s^2.

    Returns
    -------
    TriadFit

    Raises
    ------
    DataError
        If the readings have another shape, gravity is in g, or the positions do not determine every parameter.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Triad, six_position
    >>> true = Triad(np.diag([1.01, 0.99, 1.0]), np.array([0.1, -0.2, 0.0]))
    >>> f = 9.81 * np.kron(np.eye(3), np.array([[1.0], [-1.0]]))
    >>> print(six_position(true.measure(f), 9.81, sigma=1e-3).triad.bias.round(6) + 0.0)
    [ 0.1 -0.2  0. ]

    References
    ----------
    IEEE Std 1293 (multipoint tumble test); the thesis, equation (5.1).
    """
    y, size = _readings_of(readings, "readings"), checked_gravity(gravity)
    if up is None:
        if len(y) != 6:
            raise DataError(
                f"{len(y)} readings were given; the six positions are x up, x down, y up, y down, z up, z down. Give up= for others"
            )
        up = SIX
    up = _readings_of(up, "up")
    if up.shape != y.shape:
        raise DataError(f"up has shape {up.shape}, the readings {y.shape}; give one direction for each reading")
    length = np.linalg.norm(up, axis=1, keepdims=True)
    if np.any(length < 1e-6):
        raise DataError("up holds a vector of length zero; give the direction of the vertical in body axes")
    force = size * up / length
    if len(y) < 4:
        raise DataError(f"{len(y)} positions cannot give a matrix and a bias; record four that are not in a plane, better the six faces")
    x, advice = np.concatenate([force, np.ones((len(y), 1))], axis=1), "Turn the block so that the vertical passes through each face."
    found = _triad_of(x, y, sigma, _UP, advice)
    fitted = found.triad.measure(force)
    if np.linalg.norm(found.residual) > 0.2 * np.linalg.norm(fitted - found.triad.bias):
        raise DataError(
            f"the readings do not follow the given directions: they are off by {np.sqrt(np.mean(found.residual**2)):.3g} rms. Check "
            "the order of the positions (x up, x down, y up, y down, z up, z down)"
        )
    if np.any(np.argmax(np.abs(found.triad.matrix), axis=1) != np.arange(3)) or np.any(np.diag(found.triad.matrix) < 0):
        said = "The axes of the sensor are not those of the positions: some are exchanged or reversed. Check the order of the readings."
        return dataclasses.replace(found, warnings=(*found.warnings, said))
    return found


@host_float64
def rate_table(
    readings: Any, rates: Any, accel: Any = None, *, latitude: float | None = None, sigma: Any = None, servo: float = 0.0
) -> TriadFit:
    r"""Calibrate a gyroscope from mean readings on a rate table, with g-sensitivity if the specific force is known.

    .. math:: y_k = M\,(\omega_k + \Omega_E\sin\varphi\,u_k) + b + G f_k

    The model is fitted by least squares on [w, 1, f]. If body axis j is vertical at rates of both signs, column j of M is
    (y_+ - y_-) / (2 rate), and the Earth's rate, the bias and the g-sensitivity cancel.

    Parameters
    ----------
    readings : (k, 3) mean readings over whole turns.
    rates : (k, 3) angular rate of the table in body axes, rad/s.
    accel : (k, 3) mean specific force in body axes, m/s^2, in at least four positions that are not in a plane, preferably with each of
        the six faces up. Without it no g-sensitivity is fitted, and its effect is part of the bias.
    latitude : rad, to subtract the vertical part of the Earth's rate, which otherwise looks like a g-sensitivity of 10 deg/h/g. The
        table's axis must be vertical.
    sigma : standard deviation of a mean reading, one or (3,); None estimates it from the residuals.
    servo : relative standard deviation of the table's rate; it adds a scale error common to the matrix.

    Returns
    -------
    TriadFit

    Raises
    ------
    DataError
        If the shapes differ, or the positions do not determine every parameter.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Triad, rate_table
    >>> true = Triad(1.02 * np.eye(3), np.array([0.01, 0.0, 0.0]), 1e-4 * np.eye(3))
    >>> up = np.kron(np.eye(3), np.array([[1.0], [1.0], [-1.0], [-1.0]]))
    >>> rates, f = up * np.tile([1.0, -1.0], 6)[:, None], 9.81 * up
    >>> print(rate_table(true.measure(rates, f), rates, f, sigma=1e-5).triad.g_sensitivity.diagonal().round(7))
    [0.0001 0.0001 0.0001]

    References
    ----------
    IEEE Std 952 (scale factor test); the thesis, equation (5.2).
    """
    y, w = _readings_of(readings, "readings"), _readings_of(rates, "rates")
    f = None if accel is None else _readings_of(accel, "accel")
    for name, other in (("rates", w), ("accel", f)):
        if other is not None and other.shape != y.shape:
            raise DataError(f"{name} has shape {other.shape}, the readings {y.shape}; give one row for each reading")
    warnings: tuple[str, ...] = ()
    if f is not None:
        size = np.linalg.norm(f, axis=1)
        if not np.all((size > 5) & (size < 20)):
            raise DataError(
                f"accel has a norm of {np.median(size):.3g}; expected m/s^2, about 9.81. Readings in g must be multiplied by it"
            )
        if latitude is not None:
            w = w + EARTH_RATE * np.sin(float(latitude)) * f / size[:, None]
    elif latitude is not None:
        raise DataError("latitude= needs accel=, which tells where up is")
    if np.abs(w).max() > 100:
        warnings = (f"The largest rate is {np.abs(w).max():.3g} rad/s; rates in deg/s must be multiplied by pi/180.",)
    x = np.concatenate([w, np.ones((len(y), 1))] + ([] if f is None else [f]), axis=1)
    if len(y) < x.shape[1]:
        raise DataError(f"{len(y)} positions cannot give {x.shape[1]} parameters an axis; record both signs of the rate about each axis")
    advice = "Turn about each axis with both signs of the rate, each of the six faces up."
    return _triad_of(x, y, sigma, _FORCE, advice, warnings, float(servo))
