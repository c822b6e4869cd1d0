"""N: white noise of the samples, the random walk of their integral."""

import math
from typing import ClassVar

import numpy as np

from ..._precision import array_module
from ._base import Block, Term


class White(Term):
    """Angle or velocity random walk, density 1."""

    name: ClassVar[str] = "N"

    def psd(self, f, dt=None):
        """1."""
        return array_module(f, dt).ones_like(f)

    def avar(self, tau, dt=None):
        """1/tau."""
        return 1.0 / tau

    def ordinates(self, k, n, dt):
        """1."""
        return np.ones(len(k))

    def lagged(self, h, small, large, dt):
        """From G = -|h|/(2 dt): the second difference of -|x|/2 with step m is -max(m - |x|, 0)."""
        return outer_difference(lambda x: -np.maximum(small - np.abs(x), 0.0), h, small, large) / dt

    def simulate(self, n, dt, random):
        """Independent samples."""
        return random.standard_normal(n) / math.sqrt(dt)

    def states(self, dt):
        """No state: white noise of variance 1/dt."""
        return Block(white=1.0 / dt)


def outer_difference(inner, h, small, large):
    """`Term.lagged` from the second difference with step `small` of the generalised covariance of phase, a function of the lag."""
    centre = h - small
    return (inner(centre) - 2.0 * inner(centre + large) + inner(centre + 2 * large)) / (2.0 * small * large)
