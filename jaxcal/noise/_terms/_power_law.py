"""Terms whose density is a power of the frequency (Q, N, K and any other exponent), and the effect of a filter on white noise."""

import math
from typing import Any, ClassVar

import equinox as eqx
import numpy as np

from ..._arrays import namespace
from ..._precision import array_module
from ..._types import AnyArray, Real
from ._base import Block, Term


def angular(f, dt=None):
    """2 pi f; for samples (2/dt) sin(pi f dt)."""
    return 2.0 * math.pi * f if dt is None else 2.0 / dt * array_module(f, dt).sin(math.pi * f * dt)


def outer_difference(inner, h, small, large):
    """`Term.lagged` from `inner`, the second difference of the generalised covariance of phase with step `small`, a function of the lag."""
    centre = h - small
    return (inner(centre) - 2.0 * inner(centre + large) + inner(centre + 2 * large)) / (2.0 * small * large)


class Quantisation(Term):
    """Quantisation noise, the derivative of white noise: density dt omega^2 with omega = (2/dt) sin(pi f dt). It needs dt."""

    name: ClassVar[str] = "Q"

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """Density dt omega^2; zero without dt."""
        return array_module(f, dt).zeros_like(f) if dt is None else dt * angular(f, dt) ** 2

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """3/tau^2."""
        return 3.0 / tau**2

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """(s^2 + (4/n) cos^2(a/2))/dt with a = pi k/n; the second part is leakage from high frequencies."""
        half = np.pi * np.asarray(k) / n / 2.0
        return ((2.0 * np.sin(half)) ** 2 + 4.0 / n * np.cos(half) ** 2) / dt

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        """From G = 1/dt^2 at lag 0 and zero elsewhere: not zero only where the ends of two clusters coincide."""
        return outer_difference(lambda x: (np.abs(x) == small) - 2.0 * (x == 0.0), h, small, large) / dt**2

    def integral(self, h: Real) -> Any:
        """One at lag 0 and zero elsewhere, because the errors of the integral are independent."""
        xp = namespace(h)
        return xp.where(h == 0.0, 1.0, 0.0)

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """Differences of white noise."""
        return np.diff(random.standard_normal(n + 1)) / dt

    def states(self, dt: float) -> Block | None:
        """Two states: the rounding errors of the integrated output after and before the sample."""
        return Block(
            names=("next", "last"), transition=[[0.0, 0.0], [1.0, 0.0]], process=[[1.0, 0.0], [0.0, 0.0]],
            output=[1.0 / dt, -1.0 / dt], initial=np.eye(2),
        )  # fmt: skip


class PowerLaw(Term):
    r"""Noise whose density falls as a power of the frequency.

    .. math:: S(f) = (2\pi f)^{-\alpha}

    which for samples is :math:`[(2/dt) \sin(\pi f\,dt)]^{-\alpha}`. White noise N has the exponent 0, flicker B 1, and a random walk K 2.

    Attributes
    ----------
    exponent : alpha, below 3.
    name : label; give each term its own name if a model has several.

    Examples
    --------
    >>> from jaxcal.noise import Noise
    >>> from jaxcal.noise._terms import PowerLaw
    >>> bool(Noise(further=((2.0, PowerLaw(2.0)),)).psd(0.1) == Noise(K=2.0).psd(0.1))
    True
    """

    exponent: Real = 1.0
    name: str = eqx.field(static=True, default="power law")

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """(2 pi f)^-exponent."""
        return angular(f, dt) ** -self.exponent


class Filter(Quantisation):
    """White noise that a low-pass filter removes well below its corner. It is -1 times Q, so a fit never contains both."""

    name: ClassVar[str] = "filter"

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """-1 times the ordinates of Q."""
        return -super().ordinates(k, n, dt)


class White(Term):
    """Angle or velocity random walk: white noise of density 1."""

    name: ClassVar[str] = "N"

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """1."""
        return array_module(f, dt).ones_like(f)

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """1/tau."""
        return 1.0 / tau

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """1."""
        return np.ones(len(k))

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        """From G = -|h|/(2 dt), because the second difference of -|x|/2 with step m is -max(m - |x|, 0)."""
        return outer_difference(lambda x: -np.maximum(small - np.abs(x), 0.0), h, small, large) / dt

    def integral(self, h: Real) -> Any:
        """-|h|/2."""
        return -namespace(h).abs(h) / 2.0

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """Independent samples."""
        return random.standard_normal(n) / math.sqrt(dt)

    def states(self, dt: float) -> Block | None:
        """No state, only white noise of variance 1/dt."""
        return Block(white=1.0 / dt)


class RandomWalk(Term):
    """Rate random walk with the density 1/(2 pi f)^2; for samples 2 pi f becomes (2/dt) sin(pi f dt)."""

    name: ClassVar[str] = "K"

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """1/omega^2."""
        return 1.0 / angular(f, dt) ** 2

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """tau/3; for samples multiplied by 1 + 1/(2 m^2) with m = tau/dt."""
        return tau / 3.0 if dt is None else tau / 3.0 * (1.0 + 0.5 / (tau / dt) ** 2)

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """dt^2/s^2, which is exact."""
        return (dt / (2.0 * np.sin(np.pi * np.asarray(k) / n / 2.0))) ** 2

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        """From G = dt (|h|^3 - |h|)/12."""

        def inner(x):
            x = np.abs(x)
            cubic = np.where(x >= small, 6.0 * small**2 * x, 2.0 * small**3 + 6.0 * small * x**2 - 2.0 * x**3)
            return (cubic - 2.0 * np.maximum(small - x, 0.0)) / 12.0

        return outer_difference(inner, h, small, large) * dt

    def integral(self, h: Real) -> Any:
        """|h|^3/12."""
        return namespace(h).abs(h) ** 3 / 12.0

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """Running sum of white noise."""
        return math.sqrt(dt) * np.cumsum(random.standard_normal(n))

    def states(self, dt: float) -> Block | None:
        """One state, which starts at zero."""
        return Block(names=("walk",), transition=[[1.0]], process=[[dt]], output=[1.0], initial=[[0.0]])
