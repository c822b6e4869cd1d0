"""`Noise`: the noise family of IEEE Std 952 as one composable model."""

import math

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._precision import array_module, host_float64
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
    cutoff : frequency in Hz above which flicker B has no density; inf, the default, for none. Samples do not feel a cut-off at
        half the sampling rate or above.

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
    cutoff: Any = math.inf

    @host_float64
    def avar(self, tau, dt=None):
        r"""Allan variance at cluster time tau.

        Continuous, for cluster times much longer than the sampling interval,

        .. math:: \sigma^2(\tau) = \frac{3Q^2}{\tau^2} + \frac{N^2}{\tau} + \frac{2\ln 2}{\pi}B^2 + \frac{K^2\tau}{3}
                  + \frac{R^2\tau^2}{2} + \ldots

        With `dt`, the exact expectation of the Allan variance of samples taken every dt seconds: at tau = dt flicker is 1.44
        times, a random walk 1.5 times the continuous value.

        Flicker with a cut-off frequency contributes, with :math:`u = \pi f_c \tau`,

        .. math:: \frac{2B^2}{\pi}\Big[\ln 2 - \frac{\sin^3 u}{2u^2}(\sin u + 4u\cos u) + \mathrm{Ci}(2u) - \mathrm{Ci}(4u)\Big]
                  = \frac{2B^2}{\pi}\int_0^u \frac{\sin^4 v}{v^3}\,dv,

        which rises as :math:`\pi B^2 f_c^2\tau^2` far below 1/fc. With `dt` the density that is cut is that of the samples (see
        `psd`); it is integrated numerically, to rounding.

        Parameters
        ----------
        tau : cluster time in s, any shape; with `dt`, multiples of dt.
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
        of the samples, in which 2 pi f becomes (2/dt) sin(pi f dt). Flicker ends at `cutoff` in both.

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

    def simulate(self, n, rate, *, seed, resolution=None):
        r"""Samples of this noise, exact in distribution; see `jaxcal.noise._simulate` for the rule of each term.

        Flicker with a cut-off below half the rate is the one approximation: its density is drawn on frequencies eight times as
        close as those of the record, which keeps the Allan variance to a few parts in a thousand.

        With a `resolution` the samples are rounded to its multiples, as by an analogue-to-digital converter of that step. Where
        white noise dithers them, with a standard deviation of a step or more, the rounding error is white and uncorrelated with
        the signal: it adds to N, as :math:`N^2 + \mathrm{LSB}^2 dt/12` (at half a step the sum is 2 % less). It is not the
        quantisation noise Q, which belongs to sensors that round the *integral* of the rate. With noise well below half a
        step the output sticks to a few values, and no such model holds.

        Parameters
        ----------
        n : number of samples.
        rate : sampling rate in Hz.
        seed : integer seed, or a `numpy.random.Generator`; the same seed gives the same record.
        resolution : step of the output (least significant bit) in the unit of B, or one per channel; None for no rounding.

        Returns
        -------
        (n,) array, or (n, channels) where coefficients are arrays over channels, in the unit of B.

        Raises
        ------
        DataError
            If n, the rate, the cut-off or the resolution is not positive, or a coefficient is negative or not finite.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=1.0, K=0.01).simulate(5, rate=100.0, seed=0).shape
        (5,)
        >>> steps = Noise(N=0.1).simulate(5, rate=100.0, seed=0, resolution=0.5) / 0.5
        >>> bool((steps == steps.round()).all())
        True

        References
        ----------
        Rounding error of a dithered signal: Widrow, Kollár and Liu, IEEE Trans. Instrum. Meas. 45, 1996, 353-361.
        """
        from ._simulate import simulate

        return simulate(self, n, rate, seed, resolution)

    def channel(self, index: int) -> "Noise":
        """The noise of one channel, where coefficients are arrays over channels."""

        def pick(value):
            return value if np.ndim(value) == 0 else value[index]

        return Noise(
            **{term: pick(getattr(self, term)) for term in TERMS},
            markov=tuple((pick(q), pick(t)) for q, t in self.markov),
            sinusoid=tuple((pick(a), pick(f)) for a, f in self.sinusoid),
            cutoff=pick(self.cutoff),
        )

    def _sum(self, column, x, dt):
        xp = array_module(self, x, dt)
        x = xp.asarray(x, dtype=jnp.result_type(float))
        if any(np.ndim(value) for value in numbers(self)):
            x = x[..., None]  # channels last

        def shaped(value):
            value = xp.asarray(value, dtype=x.dtype)
            return value.reshape((1,) * (x.ndim - value.ndim) + value.shape)

        uncut = not isinstance(self.cutoff, jax.core.Tracer) and bool(np.all(np.isposinf(self.cutoff)))
        total = xp.zeros_like(x)
        for term in TERMS:
            if isinstance(getattr(self, term), float) and getattr(self, term) == 0.0:
                continue  # not part of the model
            scale = shaped(self.cutoff) if term == "B" and not uncut else None
            total = total + shaped(getattr(self, term)) ** 2 * column(term, x, dt, scale)
        for kind, pairs in (("markov", self.markov), ("sinusoid", self.sinusoid)):
            for strength, scale in pairs:
                total = total + shaped(strength) ** 2 * column(kind, x, dt, shaped(scale))
        return total


def numbers(noise: Noise) -> list[Any]:
    """Every number or array of a noise model: the coefficients, then Tc and f0 beside their strengths, and the cut-off last."""
    pairs = (*noise.markov, *noise.sinusoid)
    return [*(getattr(noise, term) for term in TERMS), *(value for pair in pairs for value in pair), noise.cutoff]


def with_coefficients(values: dict[str, Any]) -> Noise:
    """Noise of the named terms alone."""
    return Noise(**values)
