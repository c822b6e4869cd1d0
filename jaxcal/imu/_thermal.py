"""`ThermalTriad` and `over_temperature`: scale factors, misalignment and bias as functions of the temperature, from several sessions."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import merged
from .._errors import DataError
from .._precision import host_float64
from .._types import AnyArray, Held, Leaf, Numbers
from ..fitting import Estimate
from ..fitting._information import symmetric_inverse
from ._model import Triad
from ._result import ImuFit

_FIELDS = ("matrix", "bias", "g_sensitivity")
_APART = 5.0  # K between the coldest and the warmest session: nearer ones show no dependence on the temperature


class ThermalTriad(Triad):
    r"""A triad whose parameters are polynomials of the temperature.

    .. math:: y = M(T)\,x + b(T) + G(T)\,a,\qquad M(T) = M + \sum_{i \ge 1} M_i (T - T_r)^i

    Outside of the range of its sessions it keeps the values at the end of the range.

    Attributes
    ----------
    matrix, bias, g_sensitivity : as in `Triad`, at the reference temperature.
    matrix_powers, bias_powers, g_sensitivity_powers : (degree, 3, 3), (degree, 3) and (degree, 3, 3), coefficients of the powers 1, 2, ...
        per degC.
    reference, low, high : reference temperature and range, degC.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.imu import ThermalTriad
    >>> sensor = ThermalTriad(np.eye(3), np.zeros(3), matrix_powers=1e-4 * np.eye(3)[None], bias_powers=np.full((1, 3), 1e-3))
    >>> sensor.measure(np.array([[0.0, 0.0, 10.0]]), temperature=np.array([35.0])).round(4).tolist()
    [[0.01, 0.01, 10.02]]
    """

    matrix_powers: Held = eqx.field(default_factory=lambda: np.zeros((1, 3, 3)))
    bias_powers: Held = eqx.field(default_factory=lambda: np.zeros((1, 3)))
    g_sensitivity_powers: Held = eqx.field(default_factory=lambda: np.zeros((1, 3, 3)))
    reference: Leaf = 25.0
    low: Leaf = -np.inf
    high: Leaf = np.inf

    def at(self, temperature: Numbers) -> list[np.ndarray]:
        """Matrix, bias and g-sensitivity at each temperature (n,), with n as their first axis."""
        above = np.clip(np.atleast_1d(np.asarray(temperature, dtype=float)), self.low, self.high) - self.reference
        powers = above[:, None] ** np.arange(1, len(self.bias_powers) + 1)
        return [np.asarray(getattr(self, x)) + np.tensordot(powers, getattr(self, f"{x}_powers"), 1) for x in _FIELDS]

    @host_float64
    def measure(self, x: Numbers, accel: Numbers | None = None, temperature: Numbers | None = None) -> AnyArray:
        """Compute the readings at the temperatures (n,), degC; None is the reference. See `Triad.measure`."""
        matrix, bias, cross = self.at(self.reference if temperature is None else temperature)
        force = np.zeros_like(x) if accel is None else accel
        return np.einsum("...ij,...j->...i", matrix, x) + bias + np.einsum("...ij,...j->...i", cross, force)

    @host_float64
    def correct(self, y: Numbers, accel: Numbers | None = None, temperature: Numbers | None = None) -> AnyArray:
        """Correct readings at the temperatures (n,), degC; None is the reference. See `Triad.correct`."""
        matrix, bias, cross = self.at(self.reference if temperature is None else temperature)
        force = np.zeros_like(y) if accel is None else accel
        return np.linalg.solve(matrix, (y - bias - np.einsum("...ij,...j->...i", cross, force))[..., None])[..., 0]


@host_float64
def over_temperature(fits: Sequence[ImuFit], degree: int | None = None) -> ImuFit:
    r"""One calibration from sessions of the same device at several temperatures.

    .. math:: \min \sum_s (\theta_s - \theta(T_s))^T C_s^{-1} (\theta_s - \theta(T_s)),\qquad \theta(T) = \sum_i c_i (T - T_r)^i

    Every parameter is a polynomial of the temperature, fitted with the covariance C of each session.

    Parameters
    ----------
    fits : two results or more, of `multi_position` or `ferraris` in one convention, of logs with a thermometer.
    degree : of the polynomials; None takes two, or one for two temperatures. Where a kind of parameter scatters more than its errors, as
        biases do from start to start, these grow.

    Returns
    -------
    ImuFit, with a `ThermalTriad` of each sensor. `Calibration(imu=...)` stores it, and corrects a log at its temperatures.

    Raises
    ------
    DataError
        If a fit is refused or has no temperature, the sessions differ, or their temperatures are within 5 K.

    Examples
    --------
    >>> import dataclasses
    >>> import jaxcal
    >>> log = jaxcal.imu.simulate(poses=18, rate=50, still=3, turn=2, seed=0)
    >>> one = jaxcal.imu.multi_position(log, gravity=9.81, held_out=False)
    >>> found = jaxcal.imu.over_temperature([dataclasses.replace(one, temperature=t) for t in (0.0, 25.0, 50.0)])
    >>> bool(abs(found.accel.matrix_powers).max() < 1e-12), found.estimate["accel.matrix_powers[0,0,0]"].name
    (True, 'accel.matrix_powers[0,0,0]')

    References
    ----------
    The thesis, section 5.2 and equation (5.2), with every parameter as a polynomial of the temperature.
    """
    at, first = np.array([fit.temperature for fit in fits], dtype=float), fits[0]
    names = first.estimate.names
    if any(fit.verdict == "refused" or (fit.estimate.names, fit.convention) != (names, first.convention) for fit in fits):
        raise DataError("A session is refused, or has other sensors or another convention than the first.", code="unlike")
    if not np.ptp(at) > _APART:
        said = f"The sessions are at {at.round(1).tolist()} degC; record them 20 K apart or more, with a thermometer."
        raise DataError(said, code="range")
    reference = float(np.round((at.min() + at.max()) / 2, 2))
    values, errors = np.array([fit.estimate.values for fit in fits]), np.array([fit.estimate.error for fit in fits])
    kinds, free = np.array([name.partition("[")[0] for name in names]), errors[0] > 0
    order = min(len(np.unique(at)) - 1, 2) if degree is None else degree
    # in units of the errors and of half of the range, so that parameters of different units do not decide on the rank
    unit, half = np.where(free, errors[0], 1.0), float(np.ptp(at)) / 2
    powers = ((at - reference) / half)[:, None] ** np.arange(order + 1)
    weights = [symmetric_inverse(np.asarray(fit.estimate.matrix) / np.outer(unit, unit)) for fit in fits]
    inner = symmetric_inverse(sum(np.kron(np.outer(v, v), w) for v, w in zip(powers, weights, strict=True)))  # type: ignore[arg-type]
    scaled = inner @ sum(np.kron(v, w @ (y / unit)) for v, w, y in zip(powers, weights, values, strict=True))
    scale = np.outer(half ** -np.arange(order + 1.0), unit)
    ratio = (values - unit * (powers @ scaled.reshape(order + 1, -1))) / np.where(free, errors, np.inf)
    found = np.where(free, scale * scaled.reshape(order + 1, -1), values[0] * (np.arange(order + 1) == 0)[:, None])
    freedom = len(at) - order - 1
    square = {kind: float(np.sum(ratio[:, kinds == kind] ** 2)) / max(freedom * np.sum((kinds == kind) & free), 1) for kind in set(kinds)}
    grown = np.array([np.sqrt(max(square[kind], 1.0)) if freedom else 1.0 for kind in kinds])
    spread = np.tile(grown, order + 1) * scale.ravel()
    further = [f"{kind}_powers[{i},{name.partition('[')[2]}" for i in range(order) for name, kind in zip(names, kinds, strict=True)]
    states = {name: "held" for name, known in zip((*names, *further), np.tile(free, order + 1), strict=True) if not known}
    limits: dict[str, Any] = {"reference": reference, "low": float(at.min()), "high": float(at.max())}
    sensors: dict[str, Any] = {}
    for sensor in ("accel", "gyro"):
        if getattr(first, sensor) is not None:
            held = {x: found[:, kinds == f"{sensor}.{x}"].reshape(order + 1, 3, -1) for x in _FIELDS if np.any(kinds == f"{sensor}.{x}")}
            parts = {x: rows[..., 0] if x == "bias" else rows for x, rows in held.items()}
            own = {x: rows[0] for x, rows in parts.items()} | {f"{x}_powers": rows[1:] for x, rows in parts.items()}
            sensors[sensor] = ThermalTriad(**({"g_sensitivity_powers": np.zeros((order, 3, 3))} | own), **limits)
    degrees = np.tile(np.sum([fit.estimate.freedom for fit in fits], axis=0), order + 1)
    matrix = inner * spread * spread[:, None]
    estimate = Estimate((*names, *further), found.ravel(), matrix, degrees, states, first.estimate.quantities)
    told = tuple(merged(one for fit in fits for one in fit.findings))
    return dataclasses.replace(first, **sensors, estimate=estimate, temperature=reference, findings=told, held_out=np.full(2, np.nan))
