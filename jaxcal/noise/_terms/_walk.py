"""K: random walk of the samples."""

import math
from typing import ClassVar

import numpy as np

from ..._precision import array_module
from ._base import Block, Term
from ._white import outer_difference


class RandomWalk(Term):
    """Rate random walk, density 1/(2 pi f)^2; for samples 2 pi f becomes (2/dt) sin(pi f dt)."""

    name: ClassVar[str] = "K"

    def psd(self, f, dt=None):
        """1/omega^2."""
        return 1.0 / angular(f, dt) ** 2

    def avar(self, tau, dt=None):
        """tau/3, for samples times 1 + 1/(2 m^2)."""
        return tau / 3.0 if dt is None else tau / 3.0 * (1.0 + 0.5 / (tau / dt) ** 2)

    def ordinates(self, k, n, dt):
        """dt^2/s^2, exactly."""
        return (dt / (2.0 * np.sin(np.pi * np.asarray(k) / n / 2.0))) ** 2

    def lagged(self, h, small, large, dt):
        """From G = dt (|h|^3 - |h|)/12."""

        def inner(x):
            x = np.abs(x)
            cubic = np.where(x >= small, 6.0 * small**2 * x, 2.0 * small**3 + 6.0 * small * x**2 - 2.0 * x**3)
            return (cubic - 2.0 * np.maximum(small - x, 0.0)) / 12.0

        return outer_difference(inner, h, small, large) * dt

    def simulate(self, n, dt, random):
        """Running sum of white noise."""
        return math.sqrt(dt) * np.cumsum(random.standard_normal(n))

    def states(self, dt):
        """One state, from zero."""
        return Block(names=("walk",), transition=[[1.0]], process=[[dt]], output=[1.0], initial=[[0.0]])


def angular(f, dt=None):
    """2 pi f, which for samples is (2/dt) sin(pi f dt)."""
    return 2.0 * math.pi * f if dt is None else 2.0 / dt * array_module(f, dt).sin(math.pi * f * dt)
