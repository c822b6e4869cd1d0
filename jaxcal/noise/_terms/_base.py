"""`Term`: one kind of noise, defined by the density of its samples; and `Block`, its state-space form."""

import abc
from typing import Any

import equinox as eqx
import numpy as np

from ..._errors import DataError
from ..._types import AnyArray, Float, Real, Samples
from . import _numeric


class Block(eqx.Module):
    """State-space form of a term for a coefficient of one. All its covariances scale with the square of the coefficient.

    Attributes
    ----------
    names : names of the states.
    transition : (states, states) transition matrix F of one step.
    process : (states, states) covariance P of the process noise of one step.
    initial : (states, states) covariance of the states at the first sample.
    output : (states,) H, which turns the states into the sample.
    white : variance of the white noise added to every sample.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.noise import Block
    >>> walk = Block(np.eye(1), np.ones((1, 1)), np.ones(1), np.zeros((1, 1)), 0.0, ("walk",))
    >>> walk.names
    ('walk',)
    """

    transition: Samples = ()
    process: Samples = ()
    output: Samples = ()
    initial: Samples = ()
    white: float = 0.0
    names: tuple[str, ...] = eqx.field(static=True, default=())


class Term(eqx.Module):
    r"""A kind of noise, described by the density of its samples for a coefficient of one. Subclass it to add your own.

    A subclass must have `name`, which labels the term in every table, and `psd`. Its other floating-point fields are parameters that
    shape the density, such as an exponent or a correlation time; a fit keeps them fixed. The terms of a noise model are independent,
    so that a coefficient c contributes :math:`c^2 S(f)` to the density of the samples.

    Everything else follows from the density by numerical integration: the Allan variance, the expected DCT-II ordinates,
    samples, and a state-space form. A subclass may override any of these with a closed form, as
    Q, N, B, K, R, `GaussMarkov` and sinusoids do. Towards low frequencies a density must rise more slowly than f^-3, because the
    Allan variance is infinite otherwise. Samples drawn from a density that rises as 1/f or faster start at about zero.

    Examples
    --------
    A density that falls as a power of the frequency. With exponent 2 it has the Allan variance of a random walk:

    >>> from typing import ClassVar
    >>> import numpy as np
    >>> import jaxcal
    >>> class PowerLaw(jaxcal.noise.Term):
    ...     exponent: float
    ...     name: ClassVar[str] = "P"
    ...
    ...     def psd(self, f, dt=None):
    ...         return (2 * np.pi * f) ** -self.exponent
    >>> walk = jaxcal.noise.Noise(further=((1.0, PowerLaw(2.0)),))
    >>> f"{walk.avar(300.0, dt=1.0):.2f} {jaxcal.noise.Noise(K=1.0).avar(300.0):.2f}"
    '100.00 100.00'

    A fit accepts the term together with letters:

    >>> record = jaxcal.noise.Noise(N=1.0, further=((0.1, PowerLaw(1.5)),)).simulate(4096, rate=1.0, seed=0)
    >>> found = jaxcal.noise.fit(record, rate=1.0, terms=("N", PowerLaw(1.5)))
    >>> found.terms, bool(found.interval["P"][0] < 0.1 < found.interval["P"][1])
    (('N', 'P'), True)

    References
    ----------
    Allan variance from the density: D. W. Allan, Proc. IEEE 54, 1966, 221-230.
    """

    name: eqx.AbstractVar[str]

    @abc.abstractmethod
    def psd(self, f: Real, dt: Real | None = None) -> Any:
        """Two-sided density at frequency f (Hz, above 0) of samples taken every dt seconds, for a coefficient of one.

        With dt = None, the density of the continuous signal. A term of your own may ignore dt.
        """

    def avar(self, tau: Real, dt: Real | None = None) -> Any:
        """Allan variance at cluster time tau (s, any shape) of samples taken every dt seconds, for a coefficient of one."""
        return _numeric.allan_variance(self.psd, tau, dt)

    def ordinates(self, k: AnyArray, n: int, dt: float) -> Float[np.ndarray, " ordinates"]:
        """Expected DCT-II ordinates of n samples at the given k, from 1 to n-1, for a coefficient of one."""
        return _numeric.ordinates(self.psd, k, n, dt)

    def lagged(self, h: Real, small: Real, large: Real, dt: Real) -> Any:
        r"""Covariance of two second differences of phase for a coefficient of one. None means that no closed form is known.

        .. math:: \frac{1}{2mm'} \sum_{a,b=0}^{2} w_a w_b\, G(h + b m' - a m),\quad w = (1, -2, 1)

        with G the generalised covariance of phase, m = `small` and m' = `large` the cluster sizes and h the lags, whole or not: numbers, or
        arrays of one shape.
        """
        return None

    def integral(self, h: Real) -> Any:
        r"""Generalised covariance G of the integral of the continuous signal at lags h (s, any shape), for a coefficient of one.

        .. math:: G(h) = \int S(f)\,\frac{\cos 2\pi f h - 1 + \ldots}{(2\pi f)^2}\,df

        up to a constant and a multiple of h^2. Neither affects the covariance of differences between means. A term of your own needs it
        for `mean_covariance` alone.
        """
        raise DataError(f"the covariance of means needs a closed form, which the term {self.name} lacks: define its `integral`")

    def simulate(self, n: int, dt: float, random: np.random.Generator) -> Float[np.ndarray, " n"]:
        """Samples for a coefficient of one."""
        return _numeric.simulate(self.psd, n, dt, random)

    def states(self, dt: float) -> Block | None:
        """Exact state-space form at a sampling interval. None means: approximate the term by first-order Gauss-Markov processes."""
        return None
