"""`Prior`: knowledge of a device before its recording, from a data sheet or an earlier calibration."""

from collections.abc import Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._types import Array
from ..fitting import AbstractPrior, Estimate, Fit, identifiability
from ._estimate import turned
from ._model import Imu, Triad, entries, values

_SHEET = {"accel": ("scale", "misalignment", "bias"), "gyro": ("scale", "misalignment", "bias", "g_sensitivity")}
_FIELDS = ("matrix", "bias", "g_sensitivity")


class Prior(AbstractPrior):
    """Normal prior distribution of the triads, in the frame "upper" in which the fit runs.

    Attributes
    ----------
    accel, gyro : (mean (21,), root (21, 21)) of matrix, bias and g-sensitivity by rows: root @ (value - mean) has standard deviation one.
        A row of zeros carries no information. None for a sensor without prior knowledge.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu._prior import Prior
    >>> mean = np.concatenate([np.eye(3).ravel(), np.zeros(12)])
    >>> known = Prior(accel=(mean, np.zeros((21, 21))), gyro=(mean, np.diag(np.repeat([100.0, 0.0], [9, 12]))))
    >>> float(1 / known.gyro[1][0, 0])
    0.01
    """

    accel: Any = None
    gyro: Any = None

    def residuals(self, model: Any) -> Array:
        """(n,) prior residuals of the sensors in the model."""
        parts = [jnp.zeros(0)]
        for known, sensor in ((self.accel, model.accel), (self.gyro, model.gyro)):
            if known is not None and sensor is not None:
                value = jnp.concatenate([jnp.ravel(getattr(sensor, name)) for name in _FIELDS])
                parts.append(known[1].astype(value.dtype) @ (value - known[0].astype(value.dtype)))
        return jnp.concatenate(parts)


def prior_of(source: Any) -> Prior | None:
    """Make a prior from a data sheet or an earlier calibration.

    A data sheet is {"accel": {"scale": relative, "misalignment": rad, "bias": m/s^2}, "gyro": {"scale", "misalignment", "bias": rad/s,
    "g_sensitivity": rad/s per m/s^2}} with standard deviations; each entry is optional. An `ImuFit` or a `Calibration` gives matrices and
    g-sensitivity with their covariance, but not the biases, because these change each time the device is switched on.
    """
    if source is None or isinstance(source, Prior):
        return source
    if isinstance(source, Mapping):
        return _of_sheet(source)
    held = getattr(source, "imu", source)
    models: dict[str, Triad] = {}
    known: dict[str, np.ndarray] = {}
    for sensor in _SHEET:
        part = getattr(held, sensor, None)
        model = getattr(part, "model", part)
        if not isinstance(model, Triad):
            continue
        covariance = _covariance(held, part, sensor)
        if covariance is None:
            said = f"The earlier calibration has no covariance of {sensor}; calibrate again, or give a data sheet as prior."
            raise DataError(said, code="prior")
        models[sensor], known[sensor] = Triad(*(np.asarray(getattr(model, name)) for name in _FIELDS)), covariance
    if "accel" not in models:
        said = f"prior is a {type(source).__name__}; expected a data sheet (a dictionary), an ImuFit or a Calibration with imu"
        raise DataError(said, code="prior")
    imu = Imu(models["accel"], models.get("gyro"))
    matrix = scipy.linalg.block_diag(*known.values())
    if np.any(np.tril(np.asarray(imu.accel.matrix), -1)):
        imu, (matrix,) = turned(imu, "upper", matrix)
    whole = Estimate(entries(imu)[0], values(imu), np.asarray(matrix))
    return Prior(**{sensor: _known(getattr(imu, sensor), whole.select(f"{sensor}.*")) for sensor in known})


def _covariance(held: Any, part: Any, sensor: str) -> np.ndarray | None:
    """Covariance of a sensor's parameters from a fit or from a part of a calibration; None if it has none."""
    fields = [name for name in _FIELDS if sensor == "gyro" or name != "g_sensitivity"]
    names = [f"{name}[{','.join(map(str, i))}]" for name in fields for i in np.ndindex((3,) if name == "bias" else (3, 3))]
    if hasattr(held, "estimate"):
        matrix = held.estimate.covariance[[f"{sensor}.{name}" for name in names]].array
        return matrix if np.isfinite(matrix).all() else None
    return part.spread(names) if hasattr(part, "spread") else None


def _known(triad: Triad, known: Estimate) -> Any:
    """Mean and root of a sensor's parameters except the bias."""
    error = known.error
    # leave out the biases, and the fixed parameters, whose error is zero
    taken = np.array([i for i, name in enumerate(known.names) if error[i] > 0 and ".bias" not in name])
    scaled = np.asarray(known.matrix)[np.ix_(taken, taken)] / np.outer(error[taken], error[taken])
    values, vectors = np.linalg.eigh(scaled)
    kept = values > len(values) * np.finfo(float).eps * values[-1]
    mean = _flat(triad)
    root = np.zeros((len(mean), len(mean)))
    root[np.ix_(np.arange(kept.sum()), taken)] = (vectors[:, kept] / np.sqrt(values[kept])).T / error[taken]
    return mean, root


def _flat(triad: Triad) -> np.ndarray:
    """The parameters of a triad as one vector."""
    return np.concatenate([np.ravel(getattr(triad, name)) for name in _FIELDS])


def _of_sheet(sheet: Mapping[str, Any]) -> Prior:
    found: dict[str, Any] = {}
    for sensor, given in sheet.items():
        if sensor not in _SHEET or not isinstance(given, Mapping) or set(given) - set(_SHEET[sensor]):
            raise DataError(f"prior has {sensor!r}: {given!r}; expected accel and gyro with {', '.join(_SHEET['gyro'])}", code="prior")
        sizes = {name: float(value) for name, value in given.items()}
        if not all(np.isfinite(size) and size > 0 for size in sizes.values()):
            raise DataError(f"prior of {sensor} has {sizes}; expected standard deviations above zero, in SI units", code="prior")
        aside = np.ones((3, 3), dtype=bool) if sensor == "gyro" else np.triu(np.ones((3, 3), dtype=bool))
        scale = np.where(np.eye(3, dtype=bool), 1 / sizes.get("scale", np.inf), aside / sizes.get("misalignment", np.inf))
        bias, cross = (np.full(count, 1 / sizes.get(name, np.inf)) for count, name in ((3, "bias"), (9, "g_sensitivity")))
        found[sensor] = (_flat(Triad(np.eye(3), np.zeros(3))), np.diag(np.concatenate([scale.ravel(), bias, cross])))
    return Prior(**found)


def known_of(prior: Prior | None) -> int:
    """Number of accelerometer parameters that the prior determines."""
    return 0 if prior is None or prior.accel is None else int(np.linalg.matrix_rank(np.asarray(prior.accel[1])))


def complete(prior: Prior | None, held: np.ndarray | None = None) -> Prior:
    """A prior with rows for all parameters of both sensors, zero without knowledge; `held` holds the g-sensitivity near zero."""
    parts = []
    for known in (prior.accel, prior.gyro) if prior is not None else (None, None):
        zero = np.zeros_like(_flat(Triad(np.eye(3), np.zeros(3))))
        mean, root = (zero, np.outer(zero, zero)) if known is None else known
        parts.append((mean, np.concatenate([root, 0 * root[-9:]])))
    if held is not None:
        parts[1][1][-9:, -9:] = np.diag(1 / held)
    return Prior(*parts)


def conflict(fit: Fit) -> float:
    """The p value of a contradiction between prior and data: largest weighted residual (chi-square, Bonferroni)."""
    r = np.asarray(fit.prior_residuals)
    slope = np.asarray(fit.prior_jacobian)
    if not r.size:
        return 1.0
    share = np.asarray(identifiability(fit).leverage(slope))
    used = np.any(slope != 0, axis=1) & (share < 1 - 1e-9)
    if not used.any():
        return 1.0
    largest = float(np.max(r[used] ** 2 / (1 - share[used])))
    return float(min(1.0, used.sum() * scipy.special.chdtrc(1, largest)))
