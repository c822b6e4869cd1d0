"""`AlignmentFit` and `Bound`."""

from typing import Any

import equinox as eqx
import numpy as np

from .._results import NORMAL95, Result, Row
from ._model import INDEX, NAMES, UNITS
from ._verdict import NO_NUMBER, Verdict, word


class _Known(eqx.Module):
    """Covariance of the parameters, and which of them the positions determine."""

    covariance: Any
    free: Any
    rank: Any
    hidden: Any
    lost: Any

    @property
    def std(self) -> dict[str, float]:
        """Standard deviation of every free parameter; infinite where nothing determines it (host only)."""
        size = np.sqrt(np.diag(np.asarray(self.covariance)))
        return {name: float(size[i]) for name, i in INDEX.items() if np.asarray(self.free)[i]}

    @property
    def azimuth_std(self) -> Any:
        """Standard deviation of the azimuth, rad."""
        return self.covariance[..., 2, 2] ** 0.5

    @property
    def unobservable(self) -> tuple[str, ...]:
        """Free parameters that the readings alone do not determine (host only)."""
        return tuple(name for name, i in INDEX.items() if np.asarray(self.hidden)[i])

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Free parameters that neither the readings nor the priors determine (host only)."""
        return tuple(name for name, i in INDEX.items() if np.asarray(self.lost)[i])

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
    covariance : (14, 14), in the order of `jaxcal.alignment.NAMES`, SI; zero for parameters that are held, infinite where nothing
        determines them.
    free : (14,) which parameters are estimated. rank : of the readings' information.
    hidden, lost : (14,) parameters that the readings, and the readings with the priors, leave open (see `unobservable`).
    """


class AlignmentFit(_Known, Result):
    """The joint fit of attitude, sensor errors and latitude.

    Attributes
    ----------
    values : (14,) parameters in the order of `jaxcal.alignment.NAMES`, SI; those that nothing determines keep their start.
    covariance, free, rank, hidden, lost : as of `Bound`, at the solution.
    prior_only : (14,) parameters whose standard deviation is that of their prior.
    accel_residual, gyro_residual : (n,) reading less model, over its standard deviation (decorrelated where there is a random walk).
    chi_square, degrees_of_freedom, p_value : of the whitened residuals with the priors; p_value is None without redundancy, or where
        the noise came from the residuals themselves.
    other : (14,) another solution that fits as well; None where there is none.
    noise_known : whether the noise was given; otherwise the residuals gave it.
    verdict : item of `Verdict`. notes : sentences.
    """

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

    def _angle(self, name: str) -> float | None:
        gone = name in self.undetermined or (name == "psi" and word(self.verdict) in {word(item) for item in NO_NUMBER})
        return None if gone or word(self.verdict) == word(Verdict.unfinished) else float(self.values[INDEX[name]])

    @property
    def phi(self) -> float | None:
        """Roll, rad; None where it is not determined (host only)."""
        return self._angle("phi")

    @property
    def theta(self) -> float | None:
        """Pitch, rad; None where it is not determined (host only)."""
        return self._angle("theta")

    @property
    def psi(self) -> float | None:
        """Azimuth, rad; None where it is not determined or nothing decides between two (host only)."""
        return self._angle("psi")

    @property
    def latitude(self) -> float | None:
        """Latitude, rad, given or found; None where it is not determined (host only)."""
        return self._angle("latitude")

    @property
    def parameters(self) -> dict[str, float | None]:
        """Free parameters by name, SI; None where nothing determines one (host only)."""
        return {name: self._angle(name) for name, i in INDEX.items() if np.asarray(self.free)[i]}

    @property
    def warnings(self) -> tuple[str, ...]:
        """The notes."""
        return self.notes

    def _rows(self) -> list[Row]:
        half = {name: NORMAL95 * std for name, std in self.std.items()}
        known = {name: value for name, value in self.parameters.items() if value is not None}
        return [Row(name, x, x - half[name], x + half[name], UNITS[INDEX[name]]) for name, x in known.items()]

    @property
    def reason(self) -> str:
        """What the verdict means here, and what the readings leave open (host only)."""
        more = f" {self.observability}" if word(self.verdict) == "unobservable" else ""
        return Verdict[self.verdict] + more


__all__ = ["NAMES", "AlignmentFit", "Bound"]
