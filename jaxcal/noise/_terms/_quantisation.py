"""Q: rounding of the integrated signal, and what a filter takes from white noise, which has the same shape."""

from typing import ClassVar

import numpy as np

from ..._precision import array_module
from ._base import Block, Term
from ._walk import angular


class Quantisation(Term):
    """Quantisation noise, the derivative of white noise: density dt omega^2, omega = (2/dt) sin(pi f dt). It needs dt."""

    name: ClassVar[str] = "Q"

    def psd(self, f, dt=None):
        """Dt omega^2; nothing without dt."""
        return array_module(f, dt).zeros_like(f) if dt is None else dt * angular(f, dt) ** 2

    def avar(self, tau, dt=None):
        """3/tau^2."""
        return 3.0 / tau**2

    def ordinates(self, k, n, dt):
        """(s^2 + (4/n) cos^2(a/2))/dt, a = pi k/n: the second part leaks from high frequencies."""
        half = np.pi * np.asarray(k) / n / 2.0
        return ((2.0 * np.sin(half)) ** 2 + 4.0 / n * np.cos(half) ** 2) / dt

    def lagged(self, h, small, large, dt):
        """From G = 1/dt^2 at lag 0: lives where a cluster ends on another's end."""
        pairs = [(a, b, w) for a, w1 in enumerate((1.0, -2.0, 1.0)) for b, w2 in enumerate((1.0, -2.0, 1.0)) for w in [w1 * w2]]
        return sum(w * (h == a * small - b * large) for a, b, w in pairs) / (2.0 * small * large * dt**2)

    def simulate(self, n, dt, random):
        """Differences of white noise."""
        return np.diff(random.standard_normal(n + 1)) / dt

    def states(self, dt):
        """The rounding errors of the integrated output after and before the sample."""
        return Block(
            names=("next", "last"), transition=[[0.0, 0.0], [1.0, 0.0]], process=[[1.0, 0.0], [0.0, 0.0]],
            output=[1.0 / dt, -1.0 / dt], initial=np.eye(2),
        )  # fmt: skip


class Filter(Quantisation):
    """What a low-pass takes from white noise well below its corner: exactly -1 times Q, so that never both are in a solution."""

    name: ClassVar[str] = "filter"

    def ordinates(self, k, n, dt):
        """-1 times that of Q."""
        return -super().ordinates(k, n, dt)
