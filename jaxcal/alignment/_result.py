"""`AlignmentFit` and `Bound`, and the information in a Jacobian."""

from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Finding, Number, Result, Section, cell_text, listed
from .._precision import array_module, is_traced
from .._types import AnyArray, Held, Leaf
from .._units import shown_in
from ..fitting import Estimate, Information, information
from ._findings import has_number
from ._model import Turntable
from ._positions import EARTH_RATE, ROUNDING, Readings

_LABELS = {
    "phi": "roll", "theta": "pitch", "psi": "azimuth", "b_a": "accelerometer bias", "s_a": "accelerometer scale error",
    "b_g": "gyro bias", "s_g": "gyro scale error", "ma_a_xy": "accelerometer misalignment 1", "ma_a_xz": "accelerometer misalignment 2",
    "ma_g_xy": "gyro misalignment 1", "ma_g_xz": "gyro misalignment 2", "b_a_rate": "accelerometer drift", "b_g_rate": "gyro drift",
    **{f"b_a_{axis}": f"accelerometer bias {axis}" for axis in "yz"}, **{f"b_g_{axis}": f"gyro bias {axis}" for axis in "yz"},
    **{f"ma_a_z{axis}": f"accelerometer z towards {axis}" for axis in "xy"}, **{f"ma_g_z{axis}": f"gyro z towards {axis}" for axis in "xy"},
}  # fmt: skip
#: parameter -> quantity of the table of units; biases are as small as bias instabilities, and are shown in their units
QUANTITIES: dict[str, str] = dict.fromkeys(("phi", "theta", "psi", "latitude"), "angle")
QUANTITIES |= {name: "angle" for name in _LABELS if name.startswith("ma_")}
QUANTITIES |= {name: f"B.{'accel' if name[2] == 'a' else 'gyro'}" for name in _LABELS if name.startswith("b_")}
QUANTITIES |= {name: f"R.{'accel' if name[2] == 'a' else 'gyro'}" for name in _LABELS if "drift" in _LABELS[name]}


class Knowledge(eqx.Module):
    """Information on the parameters in the rows of a Jacobian.

    covariance : (p, p) with the priors; zero rows for fixed parameters, infinite diagonal entries for undetermined parameters.
    rank : rank of the data alone. hidden : (p,) free parameters that the data alone do not determine. lost : (p,) free parameters that
    data and priors together do not determine.
    """

    covariance: AnyArray
    rank: Any
    rank_with_priors: Any
    hidden: AnyArray
    lost: AnyArray


def sizes_of(names: tuple[str, ...], gravity: Any, positions: Any) -> AnyArray:
    """(p,) unit in which each parameter is scaled: rad, gravity, the Earth's rate, one of these per duration of the test, or one."""
    xp = array_module(gravity, positions)
    duration = (positions.start + positions.dwell).max() - positions.start.min()
    sizes = {"b_a_rate": gravity / duration, "b_g_rate": EARTH_RATE / duration}
    for axis in ("", "_y", "_z"):
        sizes |= {f"b_a{axis}": gravity, f"b_g{axis}": EARTH_RATE}
    return xp.stack([xp.asarray(sizes.get(name, 1.0)) for name in names])


def know(jacobian: AnyArray, rows: int, free: np.ndarray, sizes: AnyArray) -> Knowledge:
    """Compute `Knowledge` from a Jacobian: its first `rows` rows belong to the readings, the others to the priors.

    It is differentiable if every parameter is determined.
    """
    data, whole = (_informed(part * sizes[None, :], free) for part in (jacobian[:rows], jacobian))
    covariance = whole.covariance * sizes[:, None] * sizes[None, :]
    return Knowledge(covariance, data.rank, whole.rank, free & ~data.determined, free & ~whole.determined)


def _informed(matrix: AnyArray, free: np.ndarray) -> Information:
    """Information on the free parameters; a column below 1e-9 of the largest is rounding and counts as zero."""
    xp = array_module(matrix)
    matrix = xp.where(free[None, :], matrix, 0)
    column = xp.sqrt(xp.sum(matrix**2, axis=0))
    return information(xp.where(column[None, :] > ROUNDING * xp.max(column), matrix, 0), held=xp.asarray(~free), tolerance=ROUNDING)


class Bound(Result):
    """Cramer-Rao bound.

    Attributes
    ----------
    estimate : `jaxcal.fitting.Estimate` of the parameters by name, SI, at the values for which the bound holds. A fixed parameter is
        "held", and one that is not determined "open".
    rank : rank of the information in the readings.
    hidden : (p,) flags of the parameters that the readings do not determine. lost : (p,) flags of those that readings and priors together
        do not determine.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions, crlb
    >>> four = Positions(np.deg2rad([0.0, 90.0, 180.0, 270.0]), dwell=60.0)
    >>> bound = crlb(four, np.deg2rad([0.0, 0.0, 88.0]), 0.6, accel_noise=5e-4, gyro_noise=3e-6)
    >>> int(bound.rank), bound.unobservable
    (5, ())
    """

    estimate: Estimate
    rank: Leaf
    hidden: Held
    lost: Held
    findings: tuple[Finding, ...] = eqx.field(static=True, default=(), kw_only=True)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the p parameters: the fields of `Turntable`, and those of a subclass."""
        return self.estimate.names

    @property
    def covariance(self) -> Any:
        """(p, p) covariance; zero for held parameters, infinite variance for undetermined ones."""
        return self.estimate.matrix

    @property
    def free(self) -> np.ndarray:
        """(p,) flags of the estimated parameters."""
        return np.array([self.estimate.states.get(name) != "held" for name in self.names])

    def _named(self, flags: Any) -> tuple[str, ...]:
        return tuple(name for name, flag in zip(self.names, np.asarray(flags), strict=True) if flag)

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of every free parameter; infinite if undetermined (host only)."""
        size = dict(zip(self.names, np.sqrt(np.diag(np.asarray(self.covariance))), strict=True))
        return {name: float(size[name]) for name in self._named(self.free)}

    @property
    def azimuth_std(self) -> Any:
        """Standard deviation of the azimuth, rad."""
        return self.covariance[..., 2, 2] ** 0.5

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Free parameters that the readings alone do not determine (host only)."""
        return self._named(self.hidden)

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Free parameters that neither the readings nor the priors determine (host only)."""
        return self._named(self.lost)

    def _label(self, name: str) -> str:
        return _LABELS.get(name, name) + " x" * (f"{name}_y" in self.names)

    @property
    def headline(self) -> str:
        """The azimuth with half of its 95 % interval."""
        wanted = [self.estimate[name] for name in ("psi", "s_g", "phi", *self.names)]
        first = next((one for one in wanted if one.state != "held"), wanted[0])
        label = self._label(first.name)
        return f"{label} {cell_text(first)} {shown_in(first.quantity)[0]}".strip() if first.state == "estimated" else f"no {label}"

    def sections(self) -> list[Section]:
        """Table of the free parameters."""
        rows = [(self._label(one.name), one) for one in self.estimate.numbers() if one.state != "held"]
        return [listed("alignment", "joint fit", rows)]


class AlignmentFit(Bound):
    """Result of the joint fit of attitude, sensor errors and latitude.

    Attributes
    ----------
    estimate, rank, hidden, lost : see `Bound`; evaluated at the solution. Without given noise, the degrees of freedom of the estimate are
        those of the residuals.
    model : the fitted model, a `Turntable` or the given subclass.
    readings : the `Readings` that were fitted.
    prior_only : (p,) flags of the parameters whose standard deviation is that of their prior.
    accel_residual, gyro_residual : (n,) model minus reading in units of the standard deviation (decorrelated if the noise is not white).
    chi_square, degrees_of_freedom, p_value : test of the whitened residuals with the priors; p_value is None without redundancy, or if
        the noise was estimated from the residuals.
    noise_known : True if the noise was given, False if it was estimated from the residuals.
    outcome : number of the outcome, for traced fits, which have no findings: 0 if all is well, see `answered`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Sensor, fit, simulate
    >>> gyro, accel = Sensor(bias=5e-8, white=1e-8), Sensor(bias=1e-3, white=1e-6)
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    >>> found = fit(readings, 0.6)
    >>> found.verdict, found.unobservable
    ('good', ())
    """

    model: Turntable
    readings: Readings
    prior_only: Held
    accel_residual: Any
    gyro_residual: Any
    chi_square: Leaf
    degrees_of_freedom: Leaf
    p_value: Any
    noise_known: bool = eqx.field(static=True)
    outcome: Leaf = 0

    _figure = ("north", True)

    @property
    def usable(self) -> bool:
        """Whether there is a result, with an azimuth if one was asked for (host only)."""
        return super().usable and ("psi" not in self.parameters or self.psi is not None)

    @property
    def answered(self) -> Any:
        """Whether the readings determine an azimuth; an array for vectorised fits."""
        return has_number(self.outcome)

    def _value(self, name: str) -> Any:
        own, at = self.estimate, self.estimate.names.index(name)
        if is_traced(own.values):
            return own.values[at]
        return None if own.states.get(name) == "open" else float(own.values[at])

    @property
    def phi(self) -> Any:
        """Roll, rad; None if not determined (never in a trace)."""
        return self._value("phi")

    @property
    def theta(self) -> Any:
        """Pitch, rad; None if not determined (never in a trace)."""
        return self._value("theta")

    @property
    def psi(self) -> Any:
        """Azimuth, rad; None if not determined, or two fit equally well (never in a trace)."""
        return self._value("psi")

    @property
    def latitude(self) -> Any:
        """Given or estimated latitude, rad; None if not determined (never in a trace)."""
        return self._value("latitude")

    @property
    def parameters(self) -> dict[str, float | None]:
        """Free parameters by name, SI; None for an undetermined parameter (host only)."""
        return {name: self._value(name) for name in self._named(self.free)}

    def sections(self) -> list[Section]:
        """Table of the free parameters; in detail, the test of the fit."""
        test = [("chi-square", Number("chi_square", float(self.chi_square))),
                ("degrees of freedom", Number("degrees_of_freedom", float(self.degrees_of_freedom)))]  # fmt: skip
        test += [] if self.p_value is None else [("p value", Number("p_value", float(self.p_value)))]
        return [*super().sections(), listed("test", "test of the fit", test, detail=True)]
