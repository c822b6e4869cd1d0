"""`AlignmentFit` and `Bound`."""

from typing import Any

import equinox as eqx
import numpy as np

from .._results import NORMAL95, Result, Row
from ._model import UNITS, Turntable
from ._verdict import NO_NUMBER, Verdict, verdict_name


class _Known(eqx.Module):
    """Covariance of the parameters, and which of them the positions determine."""

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
        """Standard deviation of every free parameter; infinite where nothing determines it (host only)."""
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
        """What the readings determine, in a sentence (host only)."""
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
    names : the p parameters: `jaxcal.alignment.NAMES`, and those that a subclass of `Turntable` adds.
    covariance : (p, p), in the order of `names`, SI; zero for parameters that are held, infinite where nothing determines them.
    free : (p,) which parameters are estimated. rank : of the readings' information.
    hidden, lost : (p,) parameters that the readings, and the readings with the priors, leave open (see `unobservable`).
    """


class AlignmentFit(_Known, Result):
    """The joint fit of attitude, sensor errors and latitude.

    Attributes
    ----------
    model : the fitted `Turntable`, of the class of the one given.
    values : (p,) its parameters in the order of `names`, SI; those that nothing determines keep their start.
    names, covariance, free, rank, hidden, lost : as of `Bound`, at the solution.
    prior_only : (p,) parameters whose standard deviation is that of their prior.
    accel_residual, gyro_residual : (n,) reading less model, over its standard deviation (decorrelated where there is a random walk).
    chi_square, degrees_of_freedom, p_value : of the whitened residuals with the priors; p_value is None without redundancy, or where
        the noise came from the residuals themselves.
    other : (p,) another solution that fits as well; None where there is none.
    noise_known : whether the noise was given; otherwise the residuals gave it.
    verdict : item of `Verdict`. notes : sentences.
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
    verdict: Any = None
    notes: tuple[str, ...] = eqx.field(static=True, default=())

    def _value(self, name: str) -> float | None:
        said = verdict_name(self.verdict)
        gone = name in self.undetermined or said == "unfinished" or (name == "psi" and said in {verdict_name(item) for item in NO_NUMBER})
        return None if gone else float(self.values[self.names.index(name)])

    @property
    def phi(self) -> float | None:
        """Roll, rad; None where it is not determined (host only)."""
        return self._value("phi")

    @property
    def theta(self) -> float | None:
        """Pitch, rad; None where it is not determined (host only)."""
        return self._value("theta")

    @property
    def psi(self) -> float | None:
        """Azimuth, rad; None where it is not determined or nothing decides between two (host only)."""
        return self._value("psi")

    @property
    def latitude(self) -> float | None:
        """Latitude, rad, given or found; None where it is not determined (host only)."""
        return self._value("latitude")

    @property
    def parameters(self) -> dict[str, float | None]:
        """Free parameters by name, SI; None where nothing determines one (host only)."""
        return {name: self._value(name) for name in self._named(self.free)}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes."""
        return self.notes

    def _rows(self) -> list[Row]:
        half = {name: NORMAL95 * std for name, std in self.std.items()}
        known = {name: value for name, value in self.parameters.items() if value is not None}
        return [Row(name, x, x - half[name], x + half[name], UNITS.get(name, "")) for name, x in known.items()]

    @property
    def reason(self) -> str:
        """What the verdict means here, and what the readings leave open (host only)."""
        more = f" {self.observability}" if verdict_name(self.verdict) == "unobservable" else ""
        return Verdict[self.verdict] + more
