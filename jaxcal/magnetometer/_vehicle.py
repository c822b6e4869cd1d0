"""Magnetometers on a vehicle: the fields of its currents."""

import dataclasses
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Array
from ..fitting import Fit, solve
from ._diagnosis import at_end
from ._ellipsoid._distance import signed_distance
from ._ellipsoid._shape import Frame, ellipsoid_of_model, filled
from ._findings import FINDINGS
from ._fit import fit
from ._result import MagFit
from ._rotation._align import spread_of
from ._rotation._joint import aligned, checked_joint
from ._rotation._turning import array
from ._term_errors import jointly_with_terms, widened_by_terms


class CurrentTerms(eqx.Module):
    """Field per ampere of each current, as `fit_current` finds it.

    Attributes
    ----------
    terms : (3, currents) k, in the unit of the readings per unit of current: m = C h + b + k I.
    error : (3, currents) standard deviations.
    correlation : (currents,) largest correlation of a current with the readings' directions; above 0.5 its field is hard to separate.
    noise : standard deviation of a reading.
    fit : `MagFit` of the readings after the fields of the currents were subtracted; its errors include the errors of the terms.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.magnetometer import body_field, fit_current, scenario
    >>> current = np.random.default_rng(0).uniform(0, 20, 360)
    >>> h = body_field(scenario("all"), 50.0)
    >>> found = fit_current(h + np.outer(current, [0.5, 0.0, -0.2]), current)
    >>> bool(np.abs(found.correct(h + np.outer(current, [0.5, 0.0, -0.2]), current) - h).max() < 1e-6)
    True
    """

    terms: AnyArray
    error: AnyArray
    correlation: AnyArray
    noise: float
    fit: MagFit

    @host_float64
    def correct(self, m: Any, current: Any) -> AnyArray:
        """Readings (n, 3) without the fields of the currents (n,) or (n, currents)."""
        return np.asarray(m) - _columns_of(current, len(m)) @ np.asarray(self.terms).T


def _columns_of(current: Any, count: int) -> np.ndarray:
    current = np.asarray(current, dtype=float)
    current = current[:, None] if current.ndim == 1 else current
    if current.ndim != 2 or len(current) != count or not np.isfinite(current).all():
        raise DataError(
            f"The current has shape {current.shape}; give finite numbers, (n,) or (n, currents).",
            code="current_shape",
        )
    return current


def _distances(iron: dict[str, Array], data: tuple[Array, Array, Array]) -> Array:
    """Weighted distances to {x : |U (x - b)| = s}, after subtracting the fields of currents; `data`: readings, currents and weights."""
    u, current, weight = data
    shape = iron["upper"].T @ iron["upper"] * jnp.exp(-2 * iron["log_size"])
    return weight * signed_distance(shape, u - current @ iron["terms"].T - iron["centre"][None, :])


def _fitted(u: np.ndarray, current: np.ndarray, start: dict[str, Any], free: dict[str, Any]) -> tuple[Fit, np.ndarray]:
    """The fit, and the covariance of its free parameters, in the order centre, size, terms, U."""
    found = solve(_distances, start, (filled(u, u[:1]), filled(current), filled(np.ones(len(u)))), free=free)
    return found, spread_of(found)


@host_float64
def fit_current(m: Any, current: Any, **options: Any) -> CurrentTerms:
    """Hard iron, soft iron and the fields of currents together, from readings in all attitudes while the currents vary.

    The hard iron is the one without currents. The same fit serves anything else that shifts the hard iron in proportion, such as a
    temperature. The heading error holds at zero current, or at the recorded current nearest to zero.

    Parameters
    ----------
    m : (n, 3) readings. Rows with NaN are left out; with a `Gyroscope` its rates in these rows are still used.
    current : (n,) or (n, currents) current or throttle at the times of the readings; or a dictionary, name -> (n,).
    options : options of `fit`, for the readings after the fields of the currents are subtracted. `model` is "symmetric" by default and
        cannot be "planar". With `joint`, these readings are fitted together with the `aid`; the terms come from the magnitudes alone.

    Returns
    -------
    CurrentTerms, with `fit`. Estimate, heading error and verdict of `fit` include the errors of the terms; `fit.estimate` has them as
        "currents.NAME[i]".

    Raises
    ------
    DataError
        If the shapes differ, a current does not vary, or the readings determine no ellipsoid.

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
    names = list(current) if isinstance(current, dict) else None
    columns = _columns_of(np.column_stack(list(current.values())) if isinstance(current, dict) else current, len(m))
    names = names or [f"current {i + 1}" for i in range(columns.shape[1])]
    if options.get("model") == "planar":
        raise DataError("Currents are fitted to norms in all attitudes: leave out the model 'planar'.", code="currents_in_plane")
    joint, aid = options.pop("joint", False), options.pop("aid", None)
    if joint:
        checked_joint(options.get("method", "ml"), options.get("model", "auto"), aid, options.get("field_error"))
    there = np.isfinite(m).all(axis=1)
    kept = there.copy()
    kept[there] = ~at_end(m[there])
    whole, given, m, columns = m, columns, m[kept], columns[kept]
    size = np.ptp(columns, axis=0)
    if not size.all():
        raise DataError("A current is constant: its field cannot be told from hard iron.", code="current_constant")
    first = fit(m, method="consistent")
    if first.model is None:
        raise DataError(f"The readings determine no ellipsoid to begin with. {first.reason}", code="no_ellipsoid")
    frame = Frame.of(m)
    u, (shape, centre) = frame.scaled(m), ellipsoid_of_model(first.model, frame, first.field)
    start = {"upper": np.linalg.cholesky(shape).T, "centre": centre, "log_size": 0.0, "terms": np.zeros((3, columns.shape[1]))}
    free = {"upper": np.triu(np.ones((3, 3), dtype=bool)), "centre": True, "log_size": False, "terms": True}
    found, matrix = _fitted(u, (columns - columns.mean(axis=0)) / size, start, free)
    scale = frame.scale / size
    terms = np.asarray(found.model["terms"]) * scale
    matrix = matrix[3:-6, 3:-6] * np.outer(np.tile(scale, 3), np.tile(scale, 3))
    error = np.sqrt(np.diag(matrix)).reshape(3, -1)
    calibrated = fit(m - columns @ terms.T, **{"model": "symmetric", **options})
    units = u / np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    table = np.corrcoef(np.concatenate([units, columns], axis=1).T)
    if calibrated.model is not None:
        rows = np.where(kept[:, None], whole - given @ terms.T, np.nan)
        by_name = {name: np.stack([terms[:, i], error[:, i]]) for i, name in enumerate(names)}
        if lost := int(np.sum(there & ~kept)):
            known = (*calibrated._facts.known, FINDINGS("clipped", count=lost))
            calibrated = dataclasses.replace(calibrated, _facts=dataclasses.replace(calibrated._facts, known=known))
        if joint:
            calibrated = jointly_with_terms(calibrated, rows, given, matrix, aid, by_name)
        else:
            calibrated = widened_by_terms(calibrated, m - columns @ terms.T, columns, matrix, by_name)
        if aid is not None and not joint:
            calibrated = aligned(calibrated, rows, aid)
    return CurrentTerms(terms, error, np.abs(table[3:, :3]).max(axis=1), float(calibrated.noise), calibrated)
