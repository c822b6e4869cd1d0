"""The ramp R and sinusoids: terms without a density, random only in their slope or phase."""

import math
from typing import Any, ClassVar

import numpy as np

from ..._arrays import namespace
from ..._precision import array_module
from ..._types import Real
from ._base import Block, Term


class _NoDensity(Term):
    """A term that contributes nothing to the density."""

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """Zero."""
        return array_module(f, dt).zeros_like(f)

    def integral(self, h: Real) -> Any:
        """Zero."""
        return namespace(h).zeros_like(h)


class Ramp(_NoDensity):
    """A straight line in time, which has no density."""

    name: ClassVar[str] = "R"

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """tau^2/2."""
        return tau**2 / 2.0

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        """Product of the second differences of two parabolas; a ramp only multiplies the noise of other terms."""
        return np.zeros_like(h) + dt**2 * small * large / 2.0

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """The time in s since the first sample."""
        return dt * np.arange(n)

    def states(self, dt: float) -> Block | None:
        """Two states: the value of the line, and its slope, which differs from record to record."""
        return Block(
            names=("ramp", "slope"), transition=[[1.0, dt], [0.0, 1.0]], process=np.zeros((2, 2)), output=[1.0, 0.0],
            initial=[[0.0, 0.0], [0.0, 1.0]],
        )  # fmt: skip


class Sinusoid(_NoDensity):
    """A sinusoid of random phase. Its spectrum is a line, which is not part of the density.

    Attributes
    ----------
    frequency : f0 in Hz.
    """

    frequency: Real
    name: ClassVar[str] = "sinusoid"

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """[sin^2(a)/a]^2 with a = pi f0 tau; for samples sin^4(a)/(m sin(a/m))^2 with m = tau/dt."""
        xp = array_module(tau, dt, self)
        angle = math.pi * self.frequency * tau
        if dt is None:
            return (xp.sin(angle) ** 2 / angle) ** 2
        m = tau / dt
        return xp.sin(angle) ** 4 / (m * xp.sin(angle / m)) ** 2

    def integral(self, h: Real) -> Any:
        """cos(omega h)/(2 omega^2)."""
        omega = 2.0 * math.pi * self.frequency
        return namespace(h, self).cos(omega * h) / (2.0 * omega**2)

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """A sinusoid of random phase."""
        return np.sin(2.0 * math.pi * self.frequency * dt * np.arange(n) + random.uniform(0.0, 2.0 * math.pi))

    def states(self, dt: float) -> Block | None:
        """Two states, which rotate by 2 pi f0 dt in each step."""
        c, s = (function(2.0 * math.pi * self.frequency * dt) for function in (math.cos, math.sin))
        return Block(
            names=("cos", "sin"), transition=[[c, s], [-s, c]], process=np.zeros((2, 2)), output=[1.0, 0.0], initial=0.5 * np.eye(2)
        )
