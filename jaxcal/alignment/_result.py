"""`AlignmentFit` and `Bound`, the information in a Jacobian, and the verdicts with their sentences for each method."""

from typing import Any

import equinox as eqx
import numpy as np

from .._precision import array_module, is_traced
from .._results import Result, Row
from .._special import student_quantile
from .._types import AnyArray
from ..fitting import Information, information
from ._model import UNITS, Turntable
from ._positions import EARTH_RATE

_RANK = 1e-9


class Verdict(eqx.Enumeration):
    """The possible verdicts of a method; `Verdict[item]` is the sentence.

    Examples
    --------
    >>> from jaxcal.alignment import Verdict
    >>> Verdict[Verdict.ok]
    'The readings determine the answer.'
    """

    ok = "The readings determine the answer."
    undecided = "Several roots fit the readings and nothing decides between them: give a compass azimuth as `hint`; no root is chosen."
    scale_chosen = "Two roots have a positive scale factor; the one with the scale factor nearest 1 is chosen."
    ambiguous = "The next root is closer to the chosen one than the hint is accurate; the choice may be wrong."
    clipped = "The sine or cosine asked for exceeds 1, as noise, a wrong gravity or a scale error can make it; the nearest angle is given."
    double_root = "Two roots merge here: noise moves the angle by its square root, and the standard deviation is a rough one."
    weak = "The geometry hardly determines the angle: its standard deviation exceeds 10 degrees, or it magnifies errors 50 times."
    misfit = (
        "The residuals are larger than the noise explains (p < 0.001): the table moved, a misalignment was left out, or the noise is wrong."
    )
    unobservable = "The readings do not determine every free parameter; those named have no number."
    unfinished = "The fit did not converge; start nearer to the truth, or free fewer parameters."
    integrity = "The latitude found differs from the given one by over four standard deviations: a bias, or a wrong level or latitude."
    infeasible = "No angle fits the readings: a bias or scale error, a wrong latitude or a wrong level; no azimuth is given."
    degenerate = "The readings hold no information on the angle in this geometry; no number is given."
    pole = "The latitude is within 0.1 degrees of a pole, where the Earth's rate has no horizontal part; no azimuth is given."
    missing = "A position that the method needs was not measured; no number is given."


#: verdicts that come without a number
NO_NUMBER = (Verdict.undecided, Verdict.infeasible, Verdict.degenerate, Verdict.pole, Verdict.missing, Verdict.unfinished)

_FOUR, _LEAST = ("four_point_x", "four_point_y"), ("least_squares_x", "least_squares_y")
_FEW = "fewer than three distinct table angles cannot tell the offset from the amplitudes: measure at a third angle, such as 90 degrees"
_MORE: dict[str, dict[str, str]] = {
    "degenerate": {
        **dict.fromkeys(_FOUR, "The x axis is vertical (pitch 90 degrees): roll is not defined. The pitch stands."),
        **dict.fromkeys(_LEAST, f"Either the x axis is vertical and roll is not defined, or {_FEW}."),
        "opposed": "The table's x axis is vertical: its rate does not depend on the azimuth.",
        "four_point": "Roll or pitch is 90 degrees; use 'triad', or `fit` with z readings.",
        "scale_first": "Roll or pitch is 90 degrees, or the Earth's rate lies along the table's axis; use 'triad', or `fit` with z.",
        "bias_and_scale": "The Earth's rate (or gravity) lies along the table's axis; use 'triad', or `fit` with z readings.",
        "maximum": "The table is level: the largest rate is that of the horizontal Earth's rate, whatever the azimuth and the noise; or "
        f"{_FEW}. Use 'four_point'.",
    },
    "double_root": {
        "opposed": "The x axis lies in the meridian, where 'opposed' is blind; use 'four_point', or add 90 and 270 degrees.",
        "quadrature": "The y axis lies in the meridian, where 'quadrature' is blind; use 'four_point', or add 0 and 180 degrees.",
        "maximum": "The signs of the rate along the table's axis, or two of the roots, merge; use 'four_point'.",
        **dict.fromkeys(_FOUR, "Roll is 90 degrees; add a z reading and use 'bias_and_scale'."),
    },
    "infeasible": {
        "maximum": "The amplitude exceeds what the Earth's rate can give: a bias or a scale error was left in, or the level is wrong.",
        **dict.fromkeys(("scale_first", "bias_and_scale"), "No root has a positive scale factor, or none is real."),
    },
    "undecided": {"bias_and_scale": "The roots agree in their scale factor, which cannot decide."},
}


def decided(*cases: tuple[Any, Any]) -> Any:
    """Verdict of the last (condition, verdict) pair whose condition is true, or ok; conditions may be traced."""
    found = Verdict.ok
    for condition, verdict in cases:
        if is_traced(condition):
            found = Verdict.where(condition, verdict, found)
        elif bool(condition):
            found = verdict
    return found


def verdict_name(verdict: Any) -> str:
    """Return the name of a verdict, an item of `Verdict` (host only).

    Examples
    --------
    >>> from jaxcal.alignment import Verdict, verdict_name
    >>> verdict_name(Verdict.weak)
    'weak'
    """
    number = int(np.asarray(verdict._value))
    return next(name for name, item in Verdict._name_to_item.items() if int(np.asarray(item._value)) == number)


def sentence(verdict: Any, method: str) -> str:
    """Sentence that explains a verdict for a method (host only)."""
    more = _MORE.get(verdict_name(verdict), {}).get(method)
    return Verdict[verdict] + (f" {more}" if more else "")


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
    return information(xp.where(column[None, :] > _RANK * xp.max(column), matrix, 0), held=xp.asarray(~free), tolerance=_RANK)


class _Known(eqx.Module):
    """Covariance of the parameters, and flags of those that the positions determine."""

    names: tuple[str, ...] = eqx.field(static=True)
    covariance: Any
    free: Any
    rank: Any
    hidden: Any
    lost: Any

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

    @property
    def observability(self) -> str:
        """Sentence that says what the readings determine (host only)."""
        count, rank, open_ = int(np.sum(np.asarray(self.free))), int(self.rank), self.unobservable
        if not open_:
            return f"The readings determine all {count} free parameters."
        said = f"The readings determine {rank} combinations of {count} free parameters and cannot tell apart {', '.join(open_)}"
        if len(open_) == 1:
            said = f"The readings determine {rank} of {count} free parameters and say nothing about {open_[0]}"
        left = self.undetermined
        return said + (f"; give a prior for {' or '.join(left)}, or {_remedy(left)}." if left else "; the priors decide.")


def _remedy(left: tuple[str, ...]) -> str:
    if {"s_a", "latitude"} & set(left) or any(name.startswith("ma_") for name in left):
        return "measure with mountings 'z' and '-z', or hold one of them fixed"
    return "measure at more table angles, or hold one of them fixed"


class Bound(_Known):
    """Cramer-Rao bound.

    Attributes
    ----------
    names : names of the p parameters: `jaxcal.alignment.NAMES`, and those of a subclass of `Turntable`.
    covariance : (p, p) in the order of `names`, SI; zero for fixed parameters, infinite for undetermined ones.
    free : (p,) flags of the estimated parameters. rank : rank of the information in the readings.
    hidden : (p,) flags of the parameters that the readings do not determine. lost : (p,) flags of those that readings and priors together
        do not determine.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Positions, crlb
    >>> four = Positions(np.deg2rad([0.0, 90.0, 180.0, 270.0]), dwell=60.0)
    >>> bound = crlb(four, np.deg2rad([0.0, 0.0, 88.0]), 0.6, accel_noise=5e-4, gyro_noise=3e-6)
    >>> bound.observability
    'The readings determine all 5 free parameters.'
    """


class AlignmentFit(_Known, Result):
    """Result of the joint fit of attitude, sensor errors and latitude.

    Attributes
    ----------
    model : the fitted model, a `Turntable` or the given subclass.
    values : (p,) fitted parameters in the order of `names`, SI; undetermined parameters keep their initial values.
    names, covariance, free, rank, hidden, lost : see `Bound`; evaluated at the solution.
    prior_only : (p,) flags of the parameters whose standard deviation is that of their prior.
    accel_residual, gyro_residual : (n,) model minus reading in units of the standard deviation (decorrelated if the noise is not white).
    chi_square, degrees_of_freedom, p_value : test of the whitened residuals with the priors; p_value is None without redundancy, or if
        the noise was estimated from the residuals.
    other : (p,) a second solution that fits equally well; None if there is none.
    noise_known : True if the noise was given, False if it was estimated from the residuals.
    freedom : (p,) degrees of freedom of each standard deviation, for the intervals by Student's t; infinite if the noise was given.
    verdict : item of `Verdict`. notes : sentences.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.alignment import Sensor, fit, simulate
    >>> gyro, accel = Sensor(bias=5e-8, white=1e-8), Sensor(bias=1e-3, white=1e-6)
    >>> readings = simulate(np.deg2rad([0.0, 90.0, 180.0, 270.0]), np.deg2rad([2.0, -1.0, 40.0]), 0.6, accel=accel, gyro=gyro)
    >>> found = fit(readings, 0.6)
    >>> low, high = found.interval["psi"]
    >>> bool(low < np.deg2rad(40.0) < high), found.unobservable
    (True, ())
    """

    model: Turntable
    values: Any
    prior_only: Any
    accel_residual: Any
    gyro_residual: Any
    chi_square: Any
    degrees_of_freedom: Any
    p_value: Any
    other: Any
    noise_known: bool = eqx.field(static=True)
    freedom: Any = None
    verdict: Any = None
    notes: tuple[str, ...] = eqx.field(static=True, default=())

    def _value(self, name: str) -> float | None:
        said = verdict_name(self.verdict)
        gone = name in self.undetermined or said == "unfinished" or (name == "psi" and said in {verdict_name(item) for item in NO_NUMBER})
        return None if gone else float(self.values[self.names.index(name)])

    @property
    def phi(self) -> float | None:
        """Roll, rad; None if not determined (host only)."""
        return self._value("phi")

    @property
    def theta(self) -> float | None:
        """Pitch, rad; None if not determined (host only)."""
        return self._value("theta")

    @property
    def psi(self) -> float | None:
        """Azimuth, rad; None if not determined, or if two solutions fit equally well (host only)."""
        return self._value("psi")

    @property
    def latitude(self) -> float | None:
        """Given or estimated latitude, rad; None if not determined (host only)."""
        return self._value("latitude")

    @property
    def parameters(self) -> dict[str, float | None]:
        """Free parameters by name, SI; None for an undetermined parameter (host only)."""
        return {name: self._value(name) for name in self._named(self.free)}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes of the fit."""
        return self.notes

    @property
    def interval(self) -> dict[str, tuple[float, float]]:
        """95 % confidence interval of every determined free parameter, SI (host only)."""
        reach = dict(zip(self.names, np.ravel(student_quantile(self.freedom, 0.975)), strict=True))
        known = {name: value for name, value in self.parameters.items() if value is not None and np.isfinite(self.std[name])}
        return {name: (x - reach[name] * self.std[name], x + reach[name] * self.std[name]) for name, x in known.items()}

    _figure = ("north", True)

    def _rows(self) -> list[Row]:
        interval = self.interval
        known = {name: value for name, value in self.parameters.items() if value is not None}
        return [Row(name, x, *interval.get(name, (-np.inf, np.inf)), UNITS.get(name, "")) for name, x in known.items()]

    @property
    def reason(self) -> str:
        """Sentence that explains the verdict and, if the verdict is "unobservable", names the undetermined parameters (host only)."""
        more = f" {self.observability}" if verdict_name(self.verdict) == "unobservable" else ""
        return Verdict[self.verdict] + more
