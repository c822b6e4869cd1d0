"""`Noise`: the noise family of IEEE Std 952 as one composable model."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._precision import host_float64
from .._types import Any
from ._columns import allan_column, spectral_column

#: the terms that a coefficient of its own describes, in the order of every table
TERMS = ("Q", "N", "B", "K", "R")


class Noise(eqx.Module):
    r"""Independent noise terms of a rate or specific-force channel: SI units, two-sided densities.

    Attributes
    ----------
    Q : quantisation noise, rad (accelerometer: m/s).
    N : angle or velocity random walk, rad/sqrt(s) (m/s/sqrt(s)). A data-sheet density is one-sided: sqrt(2) N.
    B : bias instability (flicker), rad/s (m/s^2). The flat part of the Allan deviation is 0.664 B.
    K : rate random walk, rad/s/sqrt(s) (m/s^2/sqrt(s)).
    R : ramp, rad/s^2 (m/s^3).
    markov : ((qc, Tc), ...) first-order Gauss-Markov processes; qc as K, correlation time Tc in s.
    sinusoid : ((A, f0), ...) sinusoids of amplitude A (as B) and frequency f0 in Hz, random phase.

    Each coefficient is a number, or an array over channels.

    Examples
    --------
    A gyroscope with 0.25 deg/sqrt(h) and a bias instability of 8 deg/h:

    >>> import numpy as np
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=np.deg2rad(0.25 / 60), B=np.deg2rad(8 / 3600))
    >>> f"{np.rad2deg(np.sqrt(gyro.avar(100.0))) * 3600:.2f} deg/h"
    '5.52 deg/h'

    References
    ----------
    IEEE Std 952-1997, annex C. The exact forms for sampled data follow from the phase covariance, see `avar`.
    """

    Q: Any = 0.0
    N: Any = 0.0
    B: Any = 0.0
    K: Any = 0.0
    R: Any = 0.0
    markov: tuple[tuple[Any, Any], ...] = ()
    sinusoid: tuple[tuple[Any, Any], ...] = ()

    @host_float64
    def avar(self, tau, dt=None):
        r"""Allan variance at cluster time tau.

        Continuous, for cluster times much longer than the sampling interval,

        .. math:: \sigma^2(\tau) = \frac{3Q^2}{\tau^2} + \frac{N^2}{\tau} + \frac{2\ln 2}{\pi}B^2 + \frac{K^2\tau}{3}
                  + \frac{R^2\tau^2}{2} + \ldots

        With `dt`, the exact expectation of the Allan variance of samples taken every dt seconds: at tau = dt flicker is 1.44
        times, a random walk 1.5 times the continuous value.

        Parameters
        ----------
        tau : cluster time in s, any shape.
        dt : sampling interval in s; None for the continuous form.

        Returns
        -------
        Array of the shape of tau, with channels as a last axis where coefficients are arrays; unit of B squared.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> float(Noise(K=3.0).avar(2.0)), float(Noise(K=3.0).avar(2.0, dt=2.0))
        (6.0, 9.0)

        References
        ----------
        IEEE Std 952-1997, annex C; thesis equations 5.15 to 5.32.
        """
        return self._sum(allan_column, tau, dt)

    @host_float64
    def psd(self, f, dt=None):
        r"""Two-sided power spectral density at frequency f; sinusoids are lines and not part of it, nor is the ramp.

        .. math:: S(f) = Q^2 (2\pi f)^2 dt + N^2 + \frac{B^2}{2\pi f} + \frac{K^2}{(2\pi f)^2} + \ldots

        Continuous, quantisation noise has no density of its own (it needs the sampling interval); with `dt` the exact density
        of the samples, in which 2 pi f becomes (2/dt) sin(pi f dt).

        Parameters
        ----------
        f : frequency in Hz, above 0, any shape.
        dt : sampling interval in s; None for the continuous form, which leaves Q out.

        Returns
        -------
        Array of the shape of f, with channels as a last axis where coefficients are arrays; unit of B squared per Hz.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> float(Noise(N=2.0).psd(1.0))
        4.0

        References
        ----------
        IEEE Std 952-1997, annex C.
        """
        return self._sum(spectral_column, f, dt)

    def simulate(self, n, rate, *, seed):
        """Samples of this noise, exact in distribution; see `jaxcal.noise._simulate` for the rule of each term.

        Parameters
        ----------
        n : number of samples.
        rate : sampling rate in Hz.
        seed : integer seed, or a `numpy.random.Generator`; the same seed gives the same record.

        Returns
        -------
        (n,) array, or (n, channels) where coefficients are arrays over channels, in the unit of B.

        Raises
        ------
        DataError
            If n or the rate is not positive, or a coefficient is negative or not finite.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=1.0, K=0.01).simulate(5, rate=100.0, seed=0).shape
        (5,)
        """
        from ._simulate import simulate

        return simulate(self, n, rate, seed)

    def channel(self, index: int) -> "Noise":
        """The noise of one channel, where coefficients are arrays over channels."""

        def pick(value):
            return value if np.ndim(value) == 0 else value[index]

        return Noise(
            **{term: pick(getattr(self, term)) for term in TERMS},
            markov=tuple((pick(q), pick(t)) for q, t in self.markov),
            sinusoid=tuple((pick(a), pick(f)) for a, f in self.sinusoid),
        )

    def _sum(self, column, x, dt):
        x = jnp.asarray(x, dtype=jnp.result_type(float))
        if any(np.ndim(leaf) for leaf in jax.tree.leaves(self)):
            x = x[..., None]  # channels last

        def shaped(value):
            value = jnp.asarray(value, dtype=x.dtype)
            return value.reshape((1,) * (x.ndim - value.ndim) + value.shape)

        total = jnp.zeros_like(x)
        for term in TERMS:
            total = total + shaped(getattr(self, term)) ** 2 * column(term, x, dt)
        for kind, pairs in (("markov", self.markov), ("sinusoid", self.sinusoid)):
            for strength, scale in pairs:
                total = total + shaped(strength) ** 2 * column(kind, x, dt, shaped(scale))
        return total


def with_coefficients(values: dict[str, Any]) -> Noise:
    """Noise of the named terms alone."""
    return Noise(**values)
