"""`six_position` and `rate_table`: fit a triad to known inputs by least squares (host)."""

import dataclasses
from typing import Any

import equinox as eqx
import jax
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Message, Result, Section, by_axis
from .._errors import DataError
from .._precision import host_float64, real_numbers
from .._types import AnyArray
from .._units import ON_EARTH, on_earth
from ..fitting import Estimate, covariance, identifiability, information, solve
from ._findings import FINDINGS
from ._model import EARTH_RATE, LEVEL, Triad
from ._result import LABELS, assumed_gravity, parts_of, quantities, scale_error

_FORCE = ("rate about x", "rate about y", "rate about z", "bias", "g-sensitivity along x", "g-sensitivity along y", "g-sensitivity along z")
_UP = ("specific force along x", "specific force along y", "specific force along z", "bias")


class TriadFit(Result):
    """A triad fitted to known inputs.

    Attributes
    ----------
    findings : what to know about the fit; the worst one gives the `verdict`.
    triad : the fitted `Triad`, or the subclass given as model.
    estimate : `jaxcal.fitting.Estimate` of its parameters, such as "matrix[0,1]" and "bias[2]", in the units of the readings per SI.
    residual : (k, 3) readings minus the fitted readings.
    sigma : (3,) standard deviation of a mean reading, as given or estimated from the residuals.
    degrees_of_freedom : number of readings of an axis times three, minus that of the parameters.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import Triad, six_position
    >>> true = Triad(np.diag([1.01, 0.99, 1.0]), np.array([0.1, -0.2, 0.0]))
    >>> found = six_position(true.measure(9.81 * np.kron(np.eye(3), np.array([[1.0], [-1.0]]))), 9.81, sigma=1e-3)
    >>> found.headline, found.estimate["bias[1]"].unit
    ('scale to 140 ppm', 'm/s^2')
    """

    triad: Triad
    estimate: Estimate
    residual: AnyArray
    sigma: AnyArray
    degrees_of_freedom: int
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def headline(self) -> str:
        """How well the scale factors are known: half of the 95 % interval."""
        return f"scale to {parts_of(scale_error(self.estimate))}"

    def sections(self) -> list[Section]:
        """The parameters."""
        return [by_axis("triad", "triad", self.estimate.numbers(), LABELS)]


def checked_gravity(gravity: Any) -> float:
    """Return gravity as a float in m/s^2, or refuse a value that is not found on Earth."""
    value = float(gravity)
    if not on_earth("gravity", value):
        said = Message("gravity is {gravity:g} m/s^2; on Earth it is {low} to {high} m/s^2. Check {option.gravity}",
                       gravity=value, low=ON_EARTH["gravity"][0], high=ON_EARTH["gravity"][1])  # fmt: skip
        raise DataError(said, code="gravity")
    return value


def _fitted(x: np.ndarray, y: np.ndarray, sigma: np.ndarray, words: tuple[str, ...], advice: str) -> tuple[Triad, Estimate]:
    """Fit readings `y` to columns [input, 1] or [input, 1, specific force], axis by axis."""
    known = information(x)
    share = np.sqrt(np.sum(known.vectors[known.singular_values == 0] ** 2, axis=0))
    if np.any(share > 1e-3):
        open_ = ", ".join(word for word, part in zip(words, share, strict=False) if part > 0.1)
        said = f"{len(x)} positions do not determine every parameter: {open_} cannot be told apart. {advice}"
        raise DataError(said, code="positions_open")
    columns, beta = x.shape[1], known.covariance @ (x.T @ y)
    # the fit is ordered by axis, the names by field: name -> (axis, column)
    fields = {"matrix[{},{}]": range(3), "bias[{}]": (3,), "g_sensitivity[{},{}]": range(4, columns)}
    names = {name.format(axis, i): (axis, column) for name, part in fields.items() for axis in range(3) for i, column in enumerate(part)}
    axis, column = np.array(list(names.values())).T
    place = columns * axis + column
    triad = Triad(beta[:3].T, beta[3], beta[4:].T if columns == 7 else np.zeros((3, 3)))
    return triad, Estimate(names, beta[column, axis], np.kron(np.diag(sigma**2), known.covariance)[np.ix_(place, place)])


def _residuals(model: Triad, data: tuple[Any, ...]) -> Any:
    inputs, force, readings, sigma = data
    return (readings - model.measure(inputs, force)) / sigma


def _own_model(
    model: Triad, inputs: np.ndarray, force: np.ndarray | None, y: np.ndarray, sigma: np.ndarray, advice: str
) -> tuple[Triad, Estimate]:
    """Fit all floating-point fields of a model of the user's own; the g-sensitivity only with a specific force."""
    free = jax.tree.map(lambda leaf: np.ones(np.shape(leaf), dtype=bool), eqx.filter(model, eqx.is_inexact_array))
    free = eqx.tree_at(lambda triad: triad.g_sensitivity, free, np.full((3, 3), force is not None))
    fit = solve(_residuals, model, (inputs, force, y, sigma[None, :]), free=free)
    if not bool(fit.usable):
        raise DataError(f"The {type(model).__name__} cannot be fitted: {identifiability(fit).sentence} {advice}", code="positions_open")
    return jax.tree.map(np.asarray, fit.model), Estimate(fit.names, np.asarray(fit.parameters), np.asarray(covariance(fit)))


def _triad_of(
    inputs: np.ndarray, force: np.ndarray | None, y: np.ndarray, sigma: Any, words: tuple[str, ...], advice: str, model: Triad | None,
    sensor: str, findings: tuple[Finding, ...] = (), servo: float = 0.0,
) -> TriadFit:  # fmt: skip
    """Fit readings `y` to known inputs; `sigma` None estimates the noise, which the axes share, from the residuals."""
    given = np.broadcast_to(np.asarray(1.0 if sigma is None else sigma, dtype=float), (3,))
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise DataError(f"sigma={given.tolist()} must be positive, in the unit of the readings", code="not_positive")
    if model is None:
        columns = [inputs, np.ones((len(y), 1))] + ([] if force is None else [force])
        triad, found = _fitted(np.concatenate(columns, axis=1), y, given, words, advice)
    else:
        triad, found = _own_model(model, inputs, force, y, given, advice)
    residual, freedom = y - np.asarray(triad.measure(inputs, force)), 3 * len(y) - len(found.names)
    noise, matrix = np.sqrt(np.sum(residual**2) / max(freedom, 1)), found.matrix
    if sigma is None and freedom < 1:
        said = Message("{count} readings leave nothing to show their noise; give {option.sigma}, that of a mean reading", count=len(y))
        raise DataError(said, code="no_noise")
    if sigma is None:
        given, matrix = np.full(3, noise), noise**2 * matrix
    elif freedom > 0 and (ratio := float(np.sum((residual / given) ** 2))) > 2 * scipy.special.gammaincinv(freedom / 2, 1 - LEVEL):
        findings = (*findings, FINDINGS("sigma_too_small", ratio=float(np.sqrt(ratio / freedom))))
    scale = np.where([name.startswith("matrix") for name in found.names], found.values, 0.0)
    units = {name.partition(".")[2]: unit for name, unit in quantities().items() if name.startswith(f"{sensor}.")}
    degrees = float(freedom) if sigma is None else np.inf
    estimate = Estimate(found.names, found.values, matrix + servo**2 * np.outer(scale, scale), degrees, None, units)
    return TriadFit(triad, estimate, residual, given, freedom, findings)


def _readings_of(values: Any, name: str) -> np.ndarray:
    """Return the values as a (k, 3) array of finite numbers, or refuse them."""
    array = real_numbers(values, name)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise DataError(f"{name} has shape {array.shape}; expected (k, 3), one row a position", code="shapes")
    if not np.isfinite(array).all():
        raise DataError(
            f"{name} holds {np.sum(~np.isfinite(array))} values that are not finite; leave those positions out", code="not_finite"
        )
    return array


@host_float64
def six_position(
    readings: Any, gravity: float | int | None = None, *, up: Any = None, sigma: Any = None, model: Triad | None = None
) -> TriadFit:
    r"""Calibrate an accelerometer from positions of known attitude: the six faces of a rectangular block, or others.

    .. math:: y_k = M f_k + b,\qquad f_k = g\,u_k;\qquad
              M_{\cdot j} = \frac{y_{j+} - y_{j-}}{2g},\quad b = \tfrac16\textstyle\sum y

    The second form is the least-squares solution for the six faces.

    Parameters
    ----------
    readings : (6, 3) mean readings with x up, x down, y up, y down, z up, z down; or (k, 3) with `up`.
    gravity : local gravity, m/s^2. None takes standard gravity, which may be wrong by 0.3 %, as a finding says.
    up : (k, 3) upward direction in body axes of each position; None for the six faces.
    sigma : standard deviation of a mean reading, one or (3,); None estimates it from the residuals. It combines the noise,
        N / sqrt(dwell), and the repeatability of the table: a levelling error of 0.5 degrees alone causes a misalignment of 6e-3 and a
        bias of 0.03 m/s^2.
    model : a model of your own, a subclass of `Triad` from which the fit starts; every floating-point field is fitted.

    Returns
    -------
    TriadFit

    Raises
    ------
    DataError
        If the readings have another shape, gravity is not found on Earth, or the positions do not determine every parameter.

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
    gravity, assumed = assumed_gravity(gravity)
    y, size = _readings_of(readings, "readings"), checked_gravity(gravity)
    if up is None and len(y) != 6:
        said = Message("there are {count} readings, not six: x up, x down, y up, y down, z up, z down. Give {option.up}",
                       count=len(y))  # fmt: skip
        raise DataError(said, code="six")
    up = _readings_of(np.kron(np.eye(3), [[1.0], [-1.0]]) if up is None else up, "up")
    if up.shape != y.shape:
        raise DataError(f"up has shape {up.shape}, the readings {y.shape}; give one direction for each reading", code="shapes")
    length = np.linalg.norm(up, axis=1, keepdims=True)
    if np.any(length < 1e-6):
        raise DataError("up holds a vector of length zero; give the direction of the vertical in body axes", code="shapes")
    if len(y) < 4:
        raise DataError(
            f"{len(y)} positions cannot give a matrix and a bias; record four that are not in a plane, better the six faces", code="few"
        )
    force, advice = size * up / length, "Turn the block so that the vertical passes through each face."
    found = _triad_of(force, None, y, sigma, _UP, advice, model, "accel", assumed)
    if np.linalg.norm(found.residual) > 0.2 * np.linalg.norm(y - found.residual - found.triad.bias):
        raise DataError(
            f"the readings do not follow the given directions: they are off by {np.sqrt(np.mean(found.residual**2)):.3g} rms. Check "
            "the order of the positions (x up, x down, y up, y down, z up, z down)",
            code="order",
        )
    if np.any(np.argmax(np.abs(found.triad.matrix), axis=1) != np.arange(3)) or np.any(np.diag(found.triad.matrix) < 0):
        return dataclasses.replace(found, findings=(*found.findings, FINDINGS("axes_exchanged")))
    return found


@host_float64
def rate_table(
    readings: Any, rates: Any, accel: Any = None, *, latitude: float | None = None, sigma: Any = None, servo: float = 0.0,
    model: Triad | None = None,
) -> TriadFit:  # fmt: skip
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
    model : a model of your own, a subclass of `Triad` from which the fit starts; every floating-point field is fitted.

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
            raise DataError(f"{name} has shape {other.shape}, the readings {y.shape}; give one row for each reading", code="shapes")
    if f is not None:
        size = np.linalg.norm(f, axis=1)
        if not np.all((size > 5) & (size < 20)):
            raise DataError(
                f"accel has a norm of {np.median(size):.3g}; expected m/s^2, about 9.81. Readings in g must be multiplied by it",
                code="unit",
            )
        if latitude is not None:
            w = w + EARTH_RATE * np.sin(float(latitude)) * f / size[:, None]
    elif latitude is not None:
        raise DataError(Message("{option.latitude} needs the specific force, which shows where up is; give {option.accel}"), code="no_up")
    if len(y) < (needed := 4 if f is None else 7):
        said = f"{len(y)} positions cannot give {needed} parameters an axis; record both signs of the rate about each axis"
        raise DataError(said, code="few")
    advice = "Turn about each axis with both signs of the rate, each of the six faces up."
    return _triad_of(w, f, y, sigma, _FORCE, advice, model, "gyro", servo=float(servo))
