"""First-order Gauss-Markov process."""

import math
from typing import Any

import equinox as eqx
import numpy as np

from ..._arrays import decaying_sum, namespace
from ..._precision import array_module
from ..._types import AnyArray, Real
from ._base import Block, Term
from ._power_law import RandomWalk, angular

#: tau/Tc below which the closed form loses its digits to cancellation; that of a random walk, exact to 1e-5 there, replaces it; |h|/Tc
#: below which six terms of the series are exact to rounding
_SHORT, _SERIES = 2e-5, 0.03


class GaussMarkov(Term):
    r"""First-order Gauss-Markov process: white noise of coefficient one, filtered by a first-order lag of correlation time Tc.

    .. math:: S(f) = \frac{T_c^2}{1 + (2\pi f T_c)^2}

    For times well below Tc it behaves as a random walk with K = 1, for times far above Tc as white noise with N = Tc. Its variance
    is Tc/2.

    Attributes
    ----------
    time : correlation time Tc in s. With None, method "whittle" estimates it, as for the letter "markov".
    name : label; give each process its own name if a fit has several.

    Examples
    --------
    >>> from jaxcal.noise import GaussMarkov, Noise
    >>> bool(GaussMarkov(3.0).avar(10.0) == Noise(markov=((1.0, 3.0),)).avar(10.0))
    True
    """

    time: Any = None
    name: str = eqx.field(static=True, default="markov")

    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """Tc^2/(1 + (omega Tc)^2); for samples Tc/2 (1 - a^2) dt/(1 + a^2 - 2 a cos(2 pi f dt)) with a = exp(-dt/Tc)."""
        omega = angular(f, dt)
        if dt is None:
            return self.time**2 / (1.0 + (omega * self.time) ** 2)
        a = array_module(f, dt, self).exp(-dt / self.time)
        return self.time / 2.0 * (1.0 - a**2) * dt / ((1.0 - a) ** 2 + a * (omega * dt) ** 2)

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """Tc^2/tau [1 - Tc/(2 tau) (3 - 4 exp(-tau/Tc) + exp(-2 tau/Tc))], and its exact form for samples."""
        xp, correlation = array_module(tau, dt, self), self.time
        x = tau / correlation
        short = x < _SHORT
        x = xp.where(short, 1.0, x)  # both branches must stay finite for the gradients to be finite
        if dt is None:
            u = -xp.expm1(-x)
            full = correlation / x * (1.0 - u * (2.0 + u) / (2.0 * x))
        else:
            m = tau / dt
            e, q = -xp.expm1(-dt / correlation), -xp.expm1(-x)  # 1 - a and 1 - a^m without loss of digits
            full = correlation / 2.0 * (m * e * (2.0 - e) - (1.0 - e) * q * (2.0 + q)) / (m * e) ** 2
        return xp.where(short, RandomWalk().avar(tau, dt), full)

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Any:
        """From the sum over lags, which is a geometric series in z = exp(-dt/Tc + i pi k/n)."""
        a = np.pi * np.asarray(k) / n
        z = np.exp(-dt / self.time + 1j * a)
        last = np.exp(-n * dt / self.time) * (1.0 - 2.0 * (np.asarray(k) % 2))  # z^n
        cosine = (z * ((n - 1.0) - n * z + last) / (1.0 - z) ** 2).real
        sine = ((z - last) / (1.0 - z)).imag
        return self.time / 2.0 * dt * (1.0 + 2.0 / n * (cosine - sine / np.sin(a)))

    def integral(self, h: Real) -> Any:
        """-Tc^3/2 (exp(-x) - 1 + x) with x = |h|/Tc. For small x a series avoids the loss of digits."""
        xp = namespace(h, self)
        x = xp.abs(h) / self.time
        near = x < _SERIES
        small, large = xp.where(near, x, 0.0), xp.where(near, 1.0, x)
        series = small**2 * (1 / 2 - small * (1 / 6 - small * (1 / 24 - small * (1 / 120 - small * (1 / 720 - small / 5040)))))
        return -(self.time**3) / 2.0 * xp.where(near, series, xp.expm1(-large) + large)

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Any:
        """First-order recursion whose first sample has the stationary variance."""
        z = random.standard_normal(n)
        z[1:] *= math.sqrt(-math.expm1(-2.0 * dt / self.time))
        return math.sqrt(self.time / 2.0) * decaying_sum(z, math.exp(-dt / self.time))

    def states(self, dt: float) -> Block | None:
        """One state, the process itself, stationary from the first sample."""
        variance = self.time / 2.0
        return Block(
            names=(self.name,), transition=[[math.exp(-dt / self.time)]], process=[[-variance * math.expm1(-2.0 * dt / self.time)]],
            output=[1.0], initial=[[variance]],
        )  # fmt: skip


def is_sought(term: Term) -> bool:
    """Whether the term is a Gauss-Markov process whose correlation time a fit finds."""
    return isinstance(term, GaussMarkov) and term.time is None
