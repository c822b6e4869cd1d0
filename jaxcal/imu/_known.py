"""`six_position` and `rate_table`: fit a triad to known inputs by least squares (host)."""

import dataclasses
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Finding, Message, Quantity, Result, Section, by_axis
from .._arrays import from_vector, skew
from .._errors import DataError
from .._precision import host_float64, real_numbers
from .._types import AnyArray, Numbers, Samples
from .._units import ON_EARTH, on_earth
from ..fitting import Estimate, information
from ._findings import FINDINGS
from ._model import EARTH_RATE, FITTED_LEVEL, LEVEL, Triad
from ._result import LABELS, assumed_gravity, parts_of, quantities, scale_error

_FORCE = ("rate about x", "rate about y", "rate about z", "bias", "g-sensitivity along x", "g-sensitivity along y", "g-sensitivity along z")
_FACES = "Turn the block so that the vertical passes through each face."
_UP = ("specific force along x", "specific force along y", "specific force along z", "bias")

#: fits of the levels, after which their size changes by less than 1 %; noise of a mean reading, relative to gravity, where nothing shows it
_ROUNDS, _UNSEEN = 12, 1e-3


class TriadFit(Result):
    """A triad fitted to known inputs.

    Attributes
    ----------
    findings : what to know about the fit; the worst one gives the `verdict`.
    triad : the fitted `Triad`.
    estimate : `jaxcal.fitting.Estimate` of its parameters, such as "matrix[0,1]" and "bias[2]", in the units of the readings per SI.
    residual : (k, 3) readings minus the fitted readings.
    sigma : (3,) standard deviation of a mean reading, as given or estimated from the residuals.
    level : rad, standard deviation of the levels of the positions, by which their verticals differ from those given; zero on a rate table.
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
    level: float = 0.0

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


def _followed(y: np.ndarray, residual: np.ndarray, triad: Triad) -> np.ndarray:
    """The residuals, unless they are a fifth of the readings: then these belong to other positions."""
    if np.linalg.norm(residual) > 0.2 * np.linalg.norm(y - residual - triad.bias):
        said = f"the readings do not follow the given positions: they are off by {np.sqrt(np.mean(residual**2)):.3g} rms. Check their order"
        raise DataError(said, code="order")
    return residual


def _deviation(sigma: Any) -> np.ndarray:
    """(3,) standard deviation of a mean reading, checked."""
    given = np.broadcast_to(np.asarray(sigma, dtype=float), (3,))
    if not (np.isfinite(given).all() and (given > 0).all()):
        raise DataError(f"sigma={given.tolist()} must be positive, in the unit of the readings", code="not_positive")
    return given


def _quantities(sensor: str) -> dict[str, str]:
    """Quantity of each field of one sensor."""
    return {name.partition(".")[2]: unit for name, unit in quantities().items() if name.startswith(f"{sensor}.")}


def _readings_of(values: Any, name: str) -> np.ndarray:
    """Return the values as a (k, 3) array of finite numbers, or refuse them."""
    array = real_numbers(values, name)
    if array.ndim != 2 or array.shape[1] != 3 or not len(array):
        raise DataError(f"{name} has shape {array.shape}; expected (k, 3), one row a position", code="shapes")
    if not np.isfinite(array).all():
        said = f"{name} holds {np.sum(~np.isfinite(array))} values that are not finite; leave those positions out"
        raise DataError(said, code="not_finite")
    return array


def _levels(y: np.ndarray, force: np.ndarray, noise: np.ndarray, beta: np.ndarray, level: float, free: np.ndarray) -> tuple[Any, ...]:
    """Iterate the fit of `levelled` from parameters (12,) by axis; `free` (12, q) are the combinations to fit.

    Returns parameters, their covariance, and the size of the levels.
    """
    tilt, reach, inner = np.zeros_like(force), 1.0, np.eye(12)
    least = np.eye(3) * (1e-9 * np.linalg.norm(y)) ** 2
    for _ in range(_ROUNDS):
        turned, matrix = np.einsum("kij,kj->ki", from_vector(tilt), force) * reach, beta.reshape(3, 4)[:, :3]
        along, across = turned @ matrix.T, -matrix @ skew(turned)
        outer = along[:, :, None] * along[:, None, :]
        # the second order: half the square of the error, and its product with an error of the misalignment
        errors = noise + level**2 * across @ across.swapaxes(1, 2) + level**4 * outer + least
        rows = np.einsum("ij,kc->kijc", np.eye(3), np.concatenate([turned, np.ones((len(y), 1))], axis=1)).reshape(len(y), 3, 12)
        weight, seen = np.linalg.inv(errors), y + np.einsum("kij,kj->ki", across, tilt)
        inner = free @ np.linalg.inv(free.T @ np.einsum("kia,kij,kjb->ab", rows, weight, rows) @ free) @ free.T
        beta = inner @ np.einsum("kia,kij,kj->a", rows, weight, seen)
        left, open_, slope = seen - rows @ beta, errors - rows @ inner @ rows.swapaxes(1, 2), level**2 * across.swapaxes(1, 2) @ weight
        tilt = np.einsum("kij,kj->ki", slope, left)
        # what is not known of a tilt shortens the force on average
        reach = 1 - (2 * level**2 - np.einsum("kij,kjl,kil->k", slope, open_, slope))[:, None] / 2
        # squares of the residuals across the verticals, and what the present size makes one expect
        aside = np.eye(3) - outer / np.einsum("kii->k", outer)[:, None, None]
        grown = np.einsum("ki,kij,kj->", left, aside, left) / np.einsum("kij,kij->", aside, open_)
        level = max(level * float(np.sqrt(grown)), 1e-9)  # exact readings would make it zero
    return beta, inner, level


def levelled(
    y: np.ndarray, force: np.ndarray, noise: np.ndarray | None, findings: tuple[Finding, ...] = (), exact: bool = False
) -> TriadFit:
    r"""Fit a triad to five positions or more, whose levels have errors of unknown size, which is estimated with the parameters.

    .. math:: y_k = M R(\epsilon_k) f_k + b + n_k,\qquad \epsilon_k \sim N(0, \delta^2)

    An error of the level moves the reading across the vertical at first order, and along it at second order. So bias and scale of an axis
    come from the faces with this axis up and down, and the others show delta. `noise` (k, 3, 3) is the covariance of each mean reading.

    Levels off by a degree give misalignments of a degree, and a matrix with these is worse than none. So the misalignment is left out where
    errors of the levels explain it (F test at 1 %), unless the block is `exact`.
    """
    triad, named = _fitted(np.concatenate([force, np.ones((len(y), 1))], axis=1), y, np.ones(3), _UP, _FACES)
    freedom, unit = 3 * len(y) - 12, float(np.linalg.norm(triad.matrix @ force.T) / np.sqrt(len(y)))
    level = float(np.linalg.norm(_followed(y, y - np.asarray(triad.measure(force)), triad)) / np.sqrt(freedom)) / unit
    given = noise is not None
    noise = noise if given else np.tile(np.eye(3) * (min(level, _UNSEEN) * unit) ** 2, (len(y), 1, 1))
    beta = np.concatenate([triad.matrix, triad.bias[:, None]], axis=1).ravel()
    fit = whole = _levels(y, force, noise, beta, level, np.eye(12))
    cross = np.flatnonzero([i < 3 and i != axis for axis in range(3) for i in range(4)])
    ratio = whole[0][cross] @ np.linalg.solve(whole[1][np.ix_(cross, cross)], whole[0][cross]) / len(cross)
    if not exact and (chance := float(scipy.special.fdtrc(len(cross), freedom, ratio))) > FITTED_LEVEL:
        fit = _levels(y, force, noise, whole[0], whole[2], np.delete(np.eye(12), cross, axis=1))
        findings = (*findings, FINDINGS("no_misalignment", level=chance, tilt=Quantity(fit[2], "angle")))
    apart = np.array([name.startswith("matrix") and name[7] != name[9] for name in named.names])
    place = np.array([4 * int(name[7]) + int(name[9]) if name.startswith("matrix") else 4 * int(name[5]) + 3 for name in named.names])
    # what is left out keeps its variance, and its size is added
    lost = (whole[1] - fit[1])[np.ix_(place, place)] + np.multiply.outer(*[(whole[0] - fit[0])[place]] * 2)
    found, spread = fit[0].reshape(3, 4), fit[1][np.ix_(place, place)] + lost * (apart & apart[:, None])
    triad, degrees = Triad(found[:, :3], found[:, 3]), np.where(apart | (not given), float(freedom), np.inf)
    known = Estimate(named.names, fit[0][place], spread, degrees, None, _quantities("accel"))
    sigma = np.sqrt(np.mean(np.diagonal(noise, axis1=1, axis2=2), axis=0))
    return TriadFit(triad, known, y - np.asarray(triad.measure(force)), sigma, freedom, findings, fit[2])


@host_float64
def six_position(
    readings: Numbers, gravity: float | int | None = None, *, up: Numbers | None = None, sigma: Numbers | None = None
) -> TriadFit:
    r"""Calibrate an accelerometer from positions of known attitude: the six faces of a rectangular block, or others.

    .. math:: y_k = M f_k + b,\qquad f_k = g\,u_k;\qquad
              M_{jj} = \frac{y_{j+,j} - y_{j-,j}}{2g},\quad b_j = \tfrac12 (y_{j+,j} + y_{j-,j})

    The second form is the solution for the six faces whose levels have larger errors than the readings; without errors of the levels it is
    least squares. The size of these errors is estimated. Where they explain the misalignment, it is left out.

    Parameters
    ----------
    readings : (6, 3) mean readings with x up, x down, y up, y down, z up, z down; or (k, 3) with `up`.
    gravity : local gravity, m/s^2. None takes standard gravity, which may be wrong by 0.3 %, as a finding says.
    up : (k, 3) upward direction in body axes of each position; None for the six faces.
    sigma : standard deviation of a mean reading, one or (3,), as its noise N / sqrt(dwell) gives it, without the error of the level. None
        takes 1e-3 of gravity, at most what the positions scatter by; most sensors have less.

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
    if len(y) < 5:
        said = f"{len(y)} positions cannot give a matrix, a bias and the errors of the levels; record the six faces"
        raise DataError(said, code="few")
    noise = None if sigma is None else np.tile(np.diag(_deviation(sigma) ** 2), (len(y), 1, 1))
    found = levelled(y, size * up / length, noise, assumed)
    if np.any(np.argmax(np.abs(found.triad.matrix), axis=1) != np.arange(3)) or np.any(np.diag(found.triad.matrix) < 0):
        return dataclasses.replace(found, findings=(*found.findings, FINDINGS("axes_exchanged")))
    return found


@host_float64
def rate_table(
    readings: Samples, rates: Samples, accel: Samples | None = None, *, latitude: float | None = None, sigma: Numbers | None = None,
    servo: float = 0.0,
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
            said = f"accel has a norm of {np.median(size):.3g}; expected m/s^2, about 9.81. Readings in g must be multiplied by it"
            raise DataError(said, code="unit")
        if latitude is not None:
            w = w + EARTH_RATE * np.sin(float(latitude)) * f / size[:, None]
    elif latitude is not None:
        raise DataError(Message("{option.latitude} needs the specific force, which shows where up is; give {option.accel}"), code="no_up")
    if len(y) < (needed := 4 if f is None else 7):
        said = f"{len(y)} positions cannot give {needed} parameters an axis; record both signs of the rate about each axis"
        raise DataError(said, code="few")
    given, columns = np.ones(3) if sigma is None else _deviation(sigma), [w, np.ones((len(y), 1))] + ([] if f is None else [f])
    advice = "Turn about each axis with both signs of the rate, each of the six faces up."
    triad, found = _fitted(np.concatenate(columns, axis=1), y, given, _FORCE, advice)
    residual, freedom = _followed(y, y - np.asarray(triad.measure(w, f)), triad), 3 * len(y) - len(found.names)
    if sigma is None and freedom < 1:
        said = Message("{count} readings leave nothing to show their noise; give {option.sigma}, that of a mean reading", count=len(y))
        raise DataError(said, code="no_noise")
    square, findings = float(np.sum((residual / given) ** 2)), ()
    if sigma is None:
        given = np.full(3, np.sqrt(square / freedom))
    elif freedom > 0 and square > 2 * scipy.special.gammaincinv(freedom / 2, 1 - LEVEL):
        findings = (FINDINGS("sigma_too_small", ratio=float(np.sqrt(square / freedom))),)
    scale = np.where([name.startswith("matrix") for name in found.names], found.values, 0.0)
    matrix = found.matrix * (given[0] ** 2 if sigma is None else 1.0) + float(servo) ** 2 * np.outer(scale, scale)
    degrees = float(freedom) if sigma is None else np.inf
    estimate = Estimate(found.names, found.values, matrix, degrees, None, _quantities("gyro"))
    return TriadFit(triad, estimate, residual, given, freedom, findings)
