"""`LogLikelihood`: log-likelihood of any noise model, given a record reduced to bins; and `log_likelihood`, which makes it."""

import dataclasses
from collections.abc import Mapping
from functools import partial
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._errors import DataError
from .._precision import host_float64, is_traced
from .._quality import checked_rate
from .._types import AnyArray, Numbers, Samples
from ._model import Noise
from ._observed import Observed, bins_of
from ._solve import solve
from ._terms import BUILT_IN

_TERMS = ("Q", "N", "B", "K")  # terms with exact expected ordinates; for other terms the density replaces them


class LogLikelihood(eqx.Module):
    r"""Whittle log-likelihood of a noise model given a record, up to a constant: `log_likelihood(noise)`.

    .. math:: \ell = -\frac12 \sum_b \nu_b\,\Big[\ln S_b + \frac{P_b}{S_b}\Big]

    The record is reduced to a few hundred bins at most, so that a call takes microseconds under `jax.jit` and well below a millisecond
    on the host. The result can be differentiated with respect to every coefficient of the model. The object is a tree of arrays, so
    that you can `jax.vmap` over a stack of them or pass one to a sampler. The ramp and the sinusoids of a model are ignored.

    Attributes
    ----------
    frequency : (bins,) mean frequency in Hz.
    density : (bins,) mean ordinate P_b, two-sided, in the unit of the record squared per Hz.
    weight : (bins,) number of ordinates nu_b; 0 for bins that are left out.
    columns : term -> (bins,) contribution of the term to S_b for a squared coefficient of one. Terms without a column contribute their
        density.
    base : (bins,) density that is added to that of the model, such as the effect of a filter in the sensor.
    dt : sampling interval in s.

    Examples
    --------
    >>> import jax
    >>> import jaxcal
    >>> record = jaxcal.noise.Noise(N=1e-3).simulate(10_000, rate=100.0, seed=0)
    >>> likelihood = jaxcal.noise.log_likelihood(record, 100.0)
    >>> bool(likelihood(jaxcal.noise.Noise(N=1e-3)) > likelihood(jaxcal.noise.Noise(N=1.1e-3)))
    True
    >>> slope = jax.grad(lambda n: likelihood(jaxcal.noise.Noise(N=n)))(0.9e-3)
    >>> bool(slope > 0)
    True
    """

    frequency: AnyArray
    density: AnyArray
    weight: AnyArray
    columns: Mapping[str, AnyArray]
    base: AnyArray
    dt: float = eqx.field(static=True)

    def __call__(self, noise: Noise) -> Any:
        """Log-likelihood of the model, a scalar."""
        coefficients, columns = self._parts(noise)
        arrays = (self.base, self.density, self.weight)
        if is_traced(arrays, coefficients, columns):
            return _compiled(*arrays, [jnp.asarray(one) for one in coefficients], [jnp.asarray(one) for one in columns])
        return _log_likelihood(np, *arrays, coefficients, columns)

    def expected(self, noise: Noise) -> Any:
        """Mean ordinates S_b, (bins,), that the model expects."""
        return _expected(self.base, *self._parts(noise))

    def _parts(self, noise: Noise) -> tuple[list[Any], list[Any]]:
        """Coefficients and columns of the random parts of a model."""
        parts = [part for part in noise.parts if part[0] not in ("R", "sinusoid")]
        columns = [self.columns[name] if name in self.columns else term.psd(self.frequency, self.dt) for name, _, term in parts]
        return [coefficient for _, coefficient, _ in parts], columns


def _expected(base: Any, coefficients: list[Any], columns: list[Any]) -> Any:
    return sum((coefficient**2 * column for coefficient, column in zip(coefficients, columns, strict=True)), base)


def _log_likelihood(xp: Any, base: Any, density: Any, weight: Any, coefficients: list[Any], columns: list[Any]) -> Any:
    s = _expected(base, coefficients, columns)
    s = xp.where(weight > 0, xp.maximum(s, np.finfo(s.dtype).tiny ** 0.5), 1.0)
    return -0.5 * xp.sum(weight * (xp.log(s) + density / s))


#: compiled as one operation, so that a derivative outside of jit needs a single call
_compiled = jax.jit(partial(_log_likelihood, jnp))


@host_float64
def log_likelihood(y: Samples, rate: Numbers) -> LogLikelihood:
    """Whittle log-likelihood of a record, as a function of a noise model. Use it for your own optimiser or sampler.

    If the record has gaps, its ordinates are estimated from the observed samples under the noise model that `fit` finds, and each is
    weighted with the share of it that was observed. Nothing is removed from the record. `NoiseFit.log_likelihood`, in contrast, leaves
    out what the fit left out: lines, steps, and high frequencies that a filter attenuates.

    Parameters
    ----------
    y : (n,) record in rad/s, m/s^2 or T. NaN marks a gap, except in a traced y, which must have no gaps. y can be differentiated.
    rate : sampling rate in Hz.

    Returns
    -------
    LogLikelihood
        Call it with a `Noise`. If two models differ in one coefficient only, a difference of 1.92 in log-likelihood is significant at
        95 %.

    Raises
    ------
    DataError
        If the record is not (n,), or has fewer than 16 samples.

    Examples
    --------
    >>> import jaxcal
    >>> noise = jaxcal.noise.Noise(N=1e-3)
    >>> record = noise.simulate(10_000, rate=100.0, seed=0)
    >>> likelihood = jaxcal.noise.log_likelihood(record, 100.0)
    >>> louder = jaxcal.noise.Noise(N=1.1e-3)
    >>> bool(likelihood(noise) > likelihood(louder))
    True

    References
    ----------
    P. Whittle, J. R. Stat. Soc. B 15, 1953, on the DCT-II in place of the periodogram.
    """
    record: Any = y if is_traced(y) else np.asarray(y, dtype=np.float64)
    if record.ndim != 1:
        raise DataError(f"y must be (n,), one channel; got shape {record.shape}")
    dt = 1.0 / checked_rate(rate)
    terms = tuple(BUILT_IN[term] for term in _TERMS)
    if is_traced(y):
        bins = bins_of(record, dt, terms)
    else:
        observed = Observed(record, dt)
        bins = observed.bins(terms) if observed.complete else solve([observed], terms, None).bins.of(0)
    columns = {term: bins.columns[:, i] for i, term in enumerate(_TERMS)}
    return LogLikelihood(bins.frequency, bins.density * bins.unit, bins.weight, columns, np.zeros_like(bins.frequency), dt)


def likelihood_of(spectrum: Any, noise: Noise, dt: float) -> LogLikelihood:
    """Log-likelihood of the bins that a fit used. Lines and causes are left out, and `base` holds the effect of a filter."""
    used = np.asarray(spectrum.used) & (np.asarray(spectrum.edf) > 0)
    columns = {name: np.where(used, np.asarray(column), 0.0) for name, column in spectrum.columns.items()}
    found = LogLikelihood(spectrum.frequency, spectrum.density, np.where(used, spectrum.edf, 0.0), columns, np.zeros(len(used)), dt)
    rest = np.asarray(spectrum.model) - found.expected(noise)
    return dataclasses.replace(found, base=np.where(used, rest, 0.0))
