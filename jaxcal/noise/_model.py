"""`Noise`: the noise family of IEEE Std 952 as one composable model."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._frozen import direct, made
from .._precision import array_module, host_float64, real_numbers
from .._quality import checked_rate, checked_whole
from .._types import Any, Leaf, Numbers, Real, Seed
from ._terms import BUILT_IN, GaussMarkov, Sinusoid, Term

#: letters of the built-in terms, in the order of every table
TERMS = tuple(BUILT_IN)
#: order in which their samples are drawn; it never changes, so that a seed gives the same record in every version
_DRAWN = ("Q", "N", "K", "B", "R")


def _number(value: Any) -> Any:
    """Convert a list over channels to an array; leave other values as they are."""
    return np.asarray(value, dtype=float) if isinstance(value, list) else value


def _pairs(pairs: Any) -> tuple[tuple[Any, Any], ...]:
    return tuple((_number(strength), _number(scale)) for strength, scale in pairs)


class Noise(eqx.Module):
    r"""Noise model of a gyroscope, accelerometer or magnetometer channel: a sum of independent terms.

    Coefficients are in SI units and belong to two-sided densities. Units below are for a gyroscope, those of an accelerometer in
    brackets.

    Attributes
    ----------
    Q : quantisation noise, rad (m/s).
    N : angle or velocity random walk, rad/sqrt(s) (m/s/sqrt(s)). The noise density in a data sheet is one-sided and equals sqrt(2) N.
    B : bias instability (flicker), rad/s (m/s^2). The flat part of the Allan deviation is 0.664 B.
    K : rate random walk, rad/s/sqrt(s) (m/s^2/sqrt(s)).
    R : ramp, rad/s^2 (m/s^3).
    markov : ((qc, Tc), ...) first-order Gauss-Markov processes; qc in the unit of K, correlation time Tc in s.
    sinusoid : ((A, f0), ...) sinusoids of random phase; amplitude A in the unit of B, frequency f0 in Hz.
    further : ((coefficient, term), ...) terms of your own, see `Term`.

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

    if not TYPE_CHECKING:
        __getattribute__ = direct

    Q: Leaf = eqx.field(default=0.0, converter=_number)
    N: Leaf = eqx.field(default=0.0, converter=_number)
    B: Leaf = eqx.field(default=0.0, converter=_number)
    K: Leaf = eqx.field(default=0.0, converter=_number)
    R: Leaf = eqx.field(default=0.0, converter=_number)
    markov: tuple[tuple[Any, Any], ...] = eqx.field(default=(), converter=_pairs)
    sinusoid: tuple[tuple[Any, Any], ...] = eqx.field(default=(), converter=_pairs)
    further: tuple[tuple[Any, Term], ...] = eqx.field(default=(), converter=_pairs)

    @property
    def parts(self) -> list[tuple[str, Any, Term]]:
        """(name, coefficient, term) of every part of the model, including letters whose coefficient is zero.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> [(name, value) for name, value, _ in Noise(N=2.0, markov=((0.1, 5.0),)).parts if value]
        [('N', 2.0), ('markov', 0.1)]
        """
        return [
            *((name, getattr(self, name), BUILT_IN[name]) for name in _DRAWN),
            *(("markov", strength, GaussMarkov(time=time)) for strength, time in self.markov),
            *(("sinusoid", amplitude, Sinusoid(frequency=frequency)) for amplitude, frequency in self.sinusoid),
            *((term.name, coefficient, term) for coefficient, term in self.further),
        ]

    @classmethod
    def from_sheet(cls, text: str) -> dict[str, "Noise"]:
        r"""Noise by sensor from a data sheet.

        Items stand between commas. The unit tells what one is: deg/sqrt(h) and m/s/sqrt(h) are random walks, a density per sqrt(Hz) is
        one-sided (:math:`\sqrt{2} N`), a rate or an acceleration is the in-run bias instability (0.664 B), "rms in 50 Hz" an rms in a noise
        bandwidth (:math:`N \sqrt{2 \cdot 50\,\mathrm{Hz}}`), and deg/h/sqrt(h) a random walk of the bias K.

        Raises
        ------
        UnitError
            If an item is not understood.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> found = Noise.from_sheet("gyro: ARW 0.3 deg/sqrt(h), BI 2 deg/h; accel: 60 ug/sqrt(Hz)")
        >>> f"{found['gyro'].N:.3e} {found['gyro'].B:.2e} {found['accel'].N:.2e}"
        '8.727e-05 1.46e-05 4.16e-04'
        """
        from ._sheet import read_sheet  # which needs this module

        return read_sheet(text)[0]

    def coefficient(self, name: str) -> Any:
        """Coefficient of the term with this name: a letter, "markov" (the first process), or the name of a term of your own.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=2.0).coefficient("N")
        2.0
        """
        return getattr(self, name) if name in _DRAWN else self.part(name)[1]

    def only(self, name: str, value: Real | None = None) -> "Noise":
        """The model reduced to one of its terms; `value`, if given, replaces the coefficient.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=2.0, K=0.1).only("K", 0.3).avar(1.0).item()
        0.03
        """
        _, coefficient, term = self.part(name)
        return noise_of([term], [coefficient if value is None else value])

    def part(self, name: str) -> tuple[str, Any, Term]:
        """The entry of `parts` with this name; the first one if there are several.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=2.0).part("N")[1]
        2.0
        """
        for part in self.parts:
            if part[0] == name:
                return part
        raise DataError(f"the noise model has no term {name!r}; it has {', '.join(dict.fromkeys(own for own, _, _ in self.parts))}")

    @host_float64
    def avar(self, tau: Numbers, dt: Real | None = None) -> Any:
        r"""Allan variance at cluster time tau.

        Without `dt`, the continuous form, which holds for cluster times much longer than the sampling interval:

        .. math:: \sigma^2(\tau) = \frac{3Q^2}{\tau^2} + \frac{N^2}{\tau} + \frac{2\ln 2}{\pi}B^2 + \frac{K^2\tau}{3}
                  + \frac{R^2\tau^2}{2} + \ldots

        With `dt`, the exact expectation of the Allan variance of samples taken every dt seconds. At tau = dt it is 1.44 times the
        continuous value for flicker, and 1.5 times for a random walk.

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
        return self._sum("avar", tau, dt)

    @host_float64
    def psd(self, f: Numbers, dt: Real | None = None) -> Any:
        r"""Two-sided power spectral density at frequency f, without sinusoids, which are lines, and without the ramp.

        .. math:: S(f) = Q^2 (2\pi f)^2 dt + N^2 + \frac{B^2}{2\pi f} + \frac{K^2}{(2\pi f)^2} + \ldots

        Without `dt`, the density of the continuous signal. It leaves Q out, because quantisation noise depends on the sampling
        interval. With `dt`, the exact density of the samples, in which 2 pi f becomes (2/dt) sin(pi f dt).

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
        return self._sum("psd", f, dt)

    def simulate(self, n: Numbers, rate: Numbers, *, seed: Seed, resolution: Numbers | None = None) -> Any:
        r"""Samples of this noise, exact in distribution.

        Terms of your own without a `simulate` of their own are approximate. They are drawn from their density at frequencies eight times as
        close as those of the record, which keeps the Allan variance to a few parts in a thousand.

        With a `resolution` the samples are rounded to its multiples, as by an analogue-to-digital converter of that step. Where
        white noise dithers them, with a standard deviation of a step or more, the rounding error is white and uncorrelated with
        the signal. It adds to N, as :math:`N^2 + \mathrm{LSB}^2 dt/12` (at half a step the sum is 2 % less). It is not the
        quantisation noise Q, which belongs to sensors that round the *integral* of the rate. If the noise is well below half a
        step, the output sticks to a few values and neither model describes it.

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
            If n, the rate or the resolution is not positive, or a coefficient is negative or not finite.

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
        (n, dt), random = checked_sampling(n, rate), np.random.default_rng(seed)
        self.check()
        channels = {np.size(value) for value in jax.tree.leaves(self) if np.ndim(value)}
        if len(channels) > 1:
            raise DataError(f"coefficients are arrays over channels of different lengths: {sorted(channels)}")
        step = None if resolution is None else real_numbers(resolution, "resolution")
        if step is not None and not (np.all(np.isfinite(step) & (step > 0.0)) and step.shape in ((), (max(channels, default=1),))):
            raise DataError(f"resolution must be the positive step of the output, or one for each channel; got {resolution!r}")

        def drawn(noise):
            return sum((float(value) * term.simulate(n, dt, random) for _, value, term in noise.parts if value), np.zeros(n))

        x = np.stack([drawn(self.channel(i)) for i in range(channels.pop())], axis=1) if channels else drawn(self)
        return x if step is None else np.round(x / step) * step

    def check(self) -> None:
        """Raise a `DataError` unless every coefficient is finite and not negative.

        Examples
        --------
        >>> from jaxcal.noise import Noise
        >>> Noise(N=1e-3).check()
        """
        scales = (scale for pair in (*self.markov, *self.sinusoid) for scale in pair[1:])
        for value in (*(coefficient for _, coefficient, _ in self.parts), *scales):
            if not np.all(np.isfinite(value)) or np.any(np.asarray(value) < 0):
                raise DataError(f"noise coefficients must be finite and not negative; got {value!r}")

    def channel(self, index: int) -> "Noise":
        """The noise of one channel, if coefficients are arrays over channels."""
        return jax.tree.map(lambda value: value if np.ndim(value) == 0 else value[index], self)

    def _sum(self, kind: str, x, dt):
        xp = array_module(self, x, dt)
        x = xp.asarray(x, dtype=jnp.result_type(float))
        if any(np.ndim(value) for value in jax.tree.leaves(self)):
            x = x[..., None]  # channels last

        def shaped(value):
            if not eqx.is_array_like(value):
                return value
            value = xp.asarray(value, dtype=x.dtype)
            return value.reshape((1,) * (x.ndim - value.ndim) + value.shape) if value.ndim else value

        total = xp.zeros_like(x)
        for _, coefficient, term in self.parts:
            if isinstance(coefficient, float) and coefficient == 0.0:
                continue  # not part of the model
            total = total + shaped(coefficient) ** 2 * getattr(jax.tree.map(shaped, term), kind)(x, dt)
        return total


def noise_of(terms: Iterable[Term], values: Iterable[Any], sinusoid: Iterable[tuple[Any, Any]] = ()) -> Noise:
    """Make a noise model of the given terms and their coefficients."""
    found: dict[str, Any] = {"sinusoid": tuple(sinusoid)}
    for term, value in zip(terms, values, strict=True):
        if isinstance(term, GaussMarkov) and term.name == "markov":
            found["markov"] = (*found.get("markov", ()), (value, term.time))
        elif isinstance(term, Sinusoid):
            found["sinusoid"] = (*found["sinusoid"], (value, term.frequency))
        elif term.name in BUILT_IN:
            found |= {term.name: value}
        else:
            found["further"] = (*found.get("further", ()), (value, term))
    return made(Noise, **found)


def checked_terms(terms: Any) -> tuple[Term, ...]:
    """Convert letters to `Term` objects; check that no term occurs twice and that shape parameters are plain numbers."""
    letters = BUILT_IN | {"markov": GaussMarkov()}
    found: tuple[Any, ...] = tuple(letters.get(term, term) if isinstance(term, str) else term for term in terms)
    right = [isinstance(term, Term) and isinstance(term, type(BUILT_IN.get(term.name, term))) for term in found]
    if not all(right) or not found or len({term.name for term in found}) != len(found):
        raise DataError(f"terms must be distinct names among {', '.join(letters)}, or Term objects; got {tuple(terms)!r}")
    if any(np.ndim(value) for value in jax.tree.leaves(found)):
        raise DataError("the shape parameters of a term that is fitted must be numbers; fit channels with different ones one by one")
    return jax.tree.map(lambda value: float(value) if eqx.is_array_like(value) else value, found)


def checked_sampling(n: Any, rate: Any) -> tuple[int, float]:
    """Check the number of samples and the rate; return the number and the sampling interval in s."""
    return checked_whole("n", n, 1), 1.0 / checked_rate(rate)
