"""R: a ramp, which is not random."""

from typing import ClassVar

import numpy as np

from ..._precision import array_module
from ._base import Block, Term


class Ramp(Term):
    """A straight line in time, of no density."""

    name: ClassVar[str] = "R"

    def psd(self, f, dt=None):
        """Nothing."""
        return array_module(f, dt).zeros_like(f)

    def avar(self, tau, dt=None):
        """tau^2/2."""
        return tau**2 / 2.0

    def lagged(self, h, small, large, dt):
        """Product of the second differences of two parabolas; a ramp only multiplies the noise of other terms."""
        return np.full_like(h, dt**2 * small * large / 2.0)

    def simulate(self, n, dt, random):
        """T."""
        return dt * np.arange(n)

    def states(self, dt):
        """The line and its slope, which varies from record to record."""
        return Block(
            names=("ramp", "slope"), transition=[[1.0, dt], [0.0, 1.0]], process=np.zeros((2, 2)), output=[1.0, 0.0],
            initial=[[0.0, 0.0], [0.0, 1.0]],
        )  # fmt: skip
