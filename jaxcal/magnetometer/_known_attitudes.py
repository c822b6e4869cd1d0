"""`fit_attitudes`: the whole soft iron, from readings in fields that are known."""

from typing import Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray
from ._current import columns_of
from ._model import MagModel
from ._rotation._align import array


class AttitudeFit(eqx.Module):
    """Full calibration from known attitudes.

    Attributes
    ----------
    model : `MagModel` with any soft iron, rotation included.
    currents : (3, c) field per unit of each current, in the unit of the readings.
    error : (3, 4 + c) standard errors, those of the columns of C, then of b, then of each k.
    noise : standard deviation of one axis of a reading, in its unit.
    """

    model: MagModel
    currents: AnyArray
    error: AnyArray
    noise: float


@host_float64
def fit_attitudes(m: Any, field: Any, *, current: Any = None) -> AttitudeFit:
    r"""Hard iron and the whole soft iron, rotation included, from readings in known fields: linear least squares.

    .. math:: m_i = C h_i + b + \sum_j k_j I_{ij}

    Parameters
    ----------
    m : (n, 3) readings.
    field : (n, 3) true field in body axes at each, from the attitude and a field model, as `body_field` gives it.
    current : (n,) or (n, currents), for the vehicle's own fields.

    Returns
    -------
    AttitudeFit

    Raises
    ------
    DataError
        If shapes differ, or the attitudes do not determine twelve numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import MagModel, body_field, fit_attitudes, scenario
    >>> h = body_field(scenario("twelve_points"), 50.0)
    >>> true = MagModel(np.array([[1.0, 0.1, 0.0], [-0.1, 1.0, 0.0], [0.0, 0.0, 1.0]]), np.array([1.0, 2.0, 3.0]))
    >>> print(fit_attitudes(true.measure(h), h).model.soft_iron.round(6)[0] + 0.0)
    [1.  0.1 0. ]

    References
    ----------
    The magnetometer paper, equation (5), which is linear in C and b where the field in body axes is known; A. Bjorck, Numerical Methods
    for Least Squares Problems, 1996, section 1.
    """
    m = array(m, "readings")
    field = array(field, "fields")
    if len(field) != len(m):
        raise DataError(f"There are {len(m)} readings and {len(field)} fields; give one for each reading.")
    extra = np.zeros((len(m), 0)) if current is None else columns_of(current, len(m))
    size = np.sqrt(np.mean(field**2)) or 1.0
    columns = np.concatenate([field / size, np.ones((len(m), 1)), extra / (np.abs(extra).max(axis=0) if extra.size else 1.0)], axis=1)
    if len(m) <= columns.shape[1] or np.linalg.cond(columns) > 1e6:
        raise DataError("The attitudes (or currents) do not determine soft iron and hard iron; take readings in more attitudes.")
    scale = np.concatenate([np.full(3, size), [1.0], np.abs(extra).max(axis=0) if extra.size else []])
    found = np.linalg.lstsq(columns, m, rcond=None)[0]
    variance = np.sum((m - columns @ found) ** 2, axis=0) / (len(m) - columns.shape[1])
    error = np.sqrt(np.outer(variance, np.diag(np.linalg.inv(columns.T @ columns)))) / scale
    found = (found / scale[:, None]).T
    return AttitudeFit(MagModel(found[:, :3], found[:, 3]), found[:, 4:], error, float(np.sqrt(variance.mean())))
