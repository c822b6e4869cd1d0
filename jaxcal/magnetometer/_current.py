"""`motor_terms` and `fit_current`: fields of the vehicle's own currents."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Array
from ..fitting import covariance, solve
from ._ellipsoid._algebraic import Frame
from ._ellipsoid._distance import signed_distance
from ._ellipsoid._orthogonal import padded
from ._ellipsoid._residuals import shape_and_centre
from ._ellipsoid._start import basis_of, parameters_of
from ._fit import fit
from ._result import MagFit
from ._rotation._align import array


class CurrentTerms(eqx.Module):
    """Field per ampere of each current.

    Attributes
    ----------
    terms : (3, currents) k, in the unit of the readings per unit of current: m = C h + b + k I.
    error : (3, currents) standard deviations.
    correlation : (currents,) largest correlation of a current with the readings' directions; above 0.5 it is told apart badly.
    noise : standard deviation of a reading.
    fit : `MagFit` of the readings with the currents' fields taken off; None where the attitude was held.
    """

    terms: AnyArray
    error: AnyArray
    correlation: AnyArray
    noise: float
    fit: MagFit | None

    @host_float64
    def correct(self, m: Any, current: Any) -> AnyArray:
        """Readings (n, 3) without the fields of the currents (n,) or (n, currents)."""
        return np.asarray(m) - columns_of(current, len(m)) @ np.asarray(self.terms).T


def columns_of(current: Any, count: int) -> np.ndarray:
    current = np.asarray(current, dtype=float)
    current = current[:, None] if current.ndim == 1 else current
    if current.ndim != 2 or len(current) != count or not np.isfinite(current).all():
        raise DataError(f"The current has shape {current.shape}; give finite numbers, (n,) or (n, currents), for {count} readings.")
    return current


@host_float64
def motor_terms(m: Any, current: Any) -> CurrentTerms:
    r"""Field per ampere from readings of a vehicle that stands still while its currents vary.

    .. math:: m_i = m_0 + \sum_j k_j I_{ij}

    Parameters
    ----------
    m : (n, 3) readings.
    current : (n,) or (n, currents) current or throttle of each motor.

    Returns
    -------
    CurrentTerms

    Raises
    ------
    DataError
        If shapes differ, or a current does not vary by itself.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import motor_terms
    >>> current = np.linspace(0, 20, 50)
    >>> print(motor_terms([20.0, 5.0, 40.0] + np.outer(current, [0.3, 0.0, -0.1]), current).terms.T.round(6) + 0.0)
    [[ 0.3  0.  -0.1]]

    References
    ----------
    Linear least squares of the reading against the currents, per axis: the compass-motor calibration of ArduPilot, with errors.
    """
    m = array(m, "readings")
    columns = columns_of(current, len(m))
    centred = columns - columns.mean(axis=0)
    if len(m) <= columns.shape[1] + 1 or np.linalg.cond(centred) > 1e6 or not centred.any():
        raise DataError("A current does not vary by itself in these readings; change the currents one after the other.")
    terms = np.linalg.lstsq(centred, m - m.mean(axis=0), rcond=None)[0]
    off = m - m.mean(axis=0) - centred @ terms
    variance = np.sum(off**2, axis=0) / (len(m) - columns.shape[1] - 1)
    error = np.sqrt(np.outer(variance, np.diag(np.linalg.inv(centred.T @ centred))))
    return CurrentTerms(terms.T, error, np.zeros(columns.shape[1]), float(np.sqrt(variance.mean())), None)


class Powered(eqx.Module):
    """Scaled readings u (n, 3), currents (n, c), weight (n,), and the basis of `shape_and_centre`."""

    u: Any
    current: Any
    weight: Any
    basis: Any


def powered(parameters: dict[str, Array], data: Powered) -> Array:
    """Weighted orthogonal distances of the readings less the fields of the currents."""
    shape, centre = shape_and_centre(parameters["p"], data.basis)
    return data.weight * signed_distance(shape, data.u - data.current @ parameters["k"].T - centre[None, :])


@host_float64
def fit_current(m: Any, current: Any, **options: Any) -> CurrentTerms:
    """Hard iron, soft iron and the fields of currents together, from readings in all attitudes while the currents vary.

    Parameters
    ----------
    m : (n, 3) readings.
    current : (n,) or (n, currents) current or throttle at the readings' times.
    options : those of `fit`, for the calibration of what remains; its `model` is symmetric here unless given.

    Returns
    -------
    CurrentTerms, with `fit`. The currents' terms are counted in its covariance only where they are not correlated with attitude.

    Raises
    ------
    DataError
        If shapes differ, a current does not vary, or the readings determine no ellipsoid.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, fit_current, scenario
    >>> rng = np.random.default_rng(0)
    >>> current = rng.uniform(0, 20, 360)
    >>> m = body_field(scenario("all"), 50.0) + np.outer(current, [0.5, 0.0, -0.2]) + 0.1 * rng.normal(size=(360, 3))
    >>> print(np.abs(fit_current(m, current).terms.T - [0.5, 0.0, -0.2]).max() < 0.01)
    True

    References
    ----------
    The magnetometer paper, equation (5), with k I(t) added; distances as in `residuals`.
    """
    m = array(m, "readings")
    columns = columns_of(current, len(m))
    options = {"model": "symmetric", **options}
    size, middle = np.ptp(columns, axis=0), columns.mean(axis=0)
    if not size.all():
        raise DataError("A current is constant: its field cannot be told from hard iron.")
    first = fit(m, method="consistent")
    if first.model is None:
        first = fit(m, model="symmetric", loss="huber")
    if first.model is None:
        raise DataError(f"The readings determine no ellipsoid to begin with. {first.reason}")
    frame = Frame.of(m)
    u = frame.scaled(m)
    inverse = np.linalg.inv(np.asarray(first.model.soft_iron)) / first.field * frame.scale
    begin = parameters_of("symmetric", inverse.T @ inverse, (np.asarray(first.model.hard_iron) - frame.centre) / frame.scale)
    data = padded(u, "symmetric")
    relative = np.zeros((len(data.u), columns.shape[1]))
    relative[: len(m)] = (columns - middle) / size
    start = {"k": np.zeros((3, columns.shape[1])), "p": begin}
    found = solve(powered, start, Powered(data.u, relative, data.weight, basis_of("symmetric")))
    spread = np.sqrt(np.diag(np.asarray(covariance(found, scaled=True))))
    where = [i for i, name in enumerate(found.names) if "k" in name]
    scale = frame.scale / size
    terms = np.asarray(found.model["k"]) * scale
    error = spread[where].reshape(3, -1) * scale
    rest = m - columns @ terms.T
    calibrated = fit(rest, **options)
    units = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    table = np.corrcoef(np.concatenate([units, columns], axis=1).T)
    correlation = np.abs(table[3:, :3]).max(axis=1)
    return CurrentTerms(terms, error, correlation, float(calibrated.noise), calibrated)
