"""`log_likelihood`: of a record under a noise model, alone."""

import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from ._likelihood import density
from ._model import Noise
from ._ordinates import bins_of
from ._terms import BUILT_IN

_TERMS = ("Q", "N", "B", "K")  # whose ordinates are exact; that of others is the density


@host_float64
def log_likelihood(noise: Noise, y, rate):
    r"""Whittle log-likelihood of a record under a noise model, up to a constant.

    .. math:: \ell = -\frac12 \sum_b \nu_b\,\Big[\ln S_b + \frac{P_b}{S_b}\Big]

    with P_b the mean of nu_b ordinates of the DCT-II of the record and S_b the expected value under the model. It can be
    differentiated with respect to every coefficient of the model, Gauss-Markov processes included, and with respect to the
    record; use it in a sampler, or with a prior. The ramp and sinusoids of the model play no part.

    Parameters
    ----------
    noise : the model; coefficients in SI, numbers.
    y : (n,) record in rad/s, m/s^2 or T. NaN marks a gap (not where y is traced).
    rate : sampling rate in Hz.

    Returns
    -------
    Scalar. A difference of 1.92 in favour of one of two models that differ in one coefficient is one of 95 %.

    Raises
    ------
    DataError
        If the record is not (n,), or has no gap-free stretch of 16 samples.

    Examples
    --------
    >>> import jaxcal
    >>> noise = jaxcal.noise.Noise(N=1e-3)
    >>> record = noise.simulate(10_000, rate=100.0, seed=0)
    >>> louder = jaxcal.noise.Noise(N=1.1e-3)
    >>> bool(jaxcal.noise.log_likelihood(noise, record, 100.0) > jaxcal.noise.log_likelihood(louder, record, 100.0))
    True

    References
    ----------
    P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram.
    """
    y = y if is_traced(y) else np.asarray(y, dtype=np.float64)
    if y.ndim != 1:
        raise DataError(f"y must be (n,), one channel; got shape {y.shape}")
    dt = 1.0 / float(rate)
    bins = bins_of(y, dt, tuple(BUILT_IN[term] for term in _TERMS))
    dtype = jnp.asarray(bins.density).dtype
    theta = jnp.stack([jnp.asarray(getattr(noise, term), dtype=dtype) ** 2 for term in _TERMS])
    s = density(bins.columns, theta)
    used = bins.weight > 0
    frequency = jnp.where(used, bins.frequency, 0.25 / dt)
    for name, coefficient, term in noise.parts:
        if name not in _TERMS:
            s = s + jnp.asarray(coefficient, dtype=dtype) ** 2 * jnp.asarray(term.psd(frequency, dt), dtype=dtype)
    ordinate = bins.density * bins.unit
    return -0.5 * jnp.sum(jnp.where(used, bins.weight * (jnp.log(jnp.where(used, s, 1.0)) + ordinate / s), 0.0))
