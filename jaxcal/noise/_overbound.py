"""`overbound`: conservative coefficients, whose Allan deviation lies at or above the upper limit of the measured one."""

import dataclasses

import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError, FitError
from .._frozen import replaced
from .._precision import host_float64, is_traced
from .._types import Any, Float
from ._model import Noise, checked_terms, noise_of
from ._result import NoiseFit, NoiseFits, stacked_noises


def conservative(fits: NoiseFits) -> NoiseFits:
    """The fits with their overbounds in place of the coefficients, for files and tables; a term that these lack is not detected."""
    found = {}
    for name, fit in fits.items():
        bound = overbound(fit)
        values = {term: float(bound.coefficient(term)) for term in fit.presence}
        presence = {term: "present" if value > 0.0 else "not detected" for term, value in values.items()}
        found[name] = replaced(fit, noise=bound, presence=presence, interval={term: (value, value) for term, value in values.items()})
    return NoiseFits(found)


def overbound(fit: NoiseFit) -> Noise:
    """Conservative coefficients of a fitted record: their Allan deviation is nowhere below the upper limit of the measured one.

    Calls `overbound_curve` with the terms of the fit, its cluster times, and the upper limits at these (`fit.deviation.upper`). At any
    single one of the cluster times the true deviation exceeds the bound with a probability of at most about (1 - confidence)/2. Beyond
    the longest cluster time, about a quarter of the record, the bound is an extrapolation without any guarantee.

    Parameters
    ----------
    fit : `NoiseFit` of one or several channels.

    Returns
    -------
    Noise
        Coefficients in SI units, arrays over channels if the fit has several. A coefficient is zero if other terms already reach the
        limits without it.

    Raises
    ------
    DataError
        If the fit is traced (`jit`, `grad`), or an upper limit is not finite.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.noise import overbound
    >>> record = jaxcal.noise.Noise(N=1e-3, K=1e-4).simulate(100_000, rate=100.0, seed=0)
    >>> fit = jaxcal.noise.fit(record, rate=100.0)
    >>> bound = overbound(fit).avar(fit.deviation.tau, dt=0.01) ** 0.5
    >>> bool((bound >= fit.deviation.upper)[fit.used].all())
    True
    """
    curve = fit.deviation
    if curve is None or is_traced(curve.upper, fit.used):
        raise DataError("overbound solves a linear programme on the host; call it outside of jit, vmap and grad")
    if curve.upper.ndim == 1:
        terms = [fit.noise.part(name)[2] for name in fit.terms if name != "markov"]
        beside = Noise(markov=fit.noise.markov, sinusoid=fit.noise.sinusoid)
        return overbound_curve(curve.tau[fit.used], curve.upper[fit.used], terms=terms, dt=1.0 / curve.rate, beside=beside)
    return stacked_noises([overbound(fit.channel(i)) for i in range(curve.upper.shape[1])])


@host_float64
def overbound_curve(tau: Any, upper: Any, *, terms: Any = ("Q", "N", "B", "K"), dt: Any = None, beside: Noise | None = None) -> Noise:
    r"""Smallest coefficients whose Allan deviation is at or above given limits at every cluster time.

    Of all coefficients that stay above the limits, the function finds those with the smallest mean excess of the variance, relative to
    the limit. With :math:`v_i` the squares of the limits, theta the squared coefficients, A the Allan variances per squared coefficient
    and g the Allan variance of the noise in `beside`, it solves

    .. math:: \min_\theta \sum_i \frac{(A\theta)_i}{v_i} \quad\text{subject to}\quad A\theta + g \ge v,\;\theta \ge 0.

    This is a linear programme, so the minimum is global. The result touches the limits at as many cluster times as it has positive
    coefficients. Give cluster times that are evenly spaced in the logarithm to weight every octave equally.

    Parameters
    ----------
    tau : (clusters,) cluster times in s.
    upper : (clusters,) upper limits of the Allan deviation, in the unit of B.
    terms : terms that the result may contain: letters among "Q", "N", "B", "K", "R", and `Term` objects of your own.
    dt : sampling interval in s, for the exact Allan variance of samples; None for the continuous form.
    beside : `Noise` whose Gauss-Markov processes and sinusoids become part of the result unchanged.

    Returns
    -------
    Noise
        Coefficients in SI units; those of all other terms are zero.

    Raises
    ------
    DataError
        If an upper limit is not positive and finite, or a term is unknown.
    FitError
        If the linear programme has no solution.

    Examples
    --------
    Limits that follow white noise of 1 rad/sqrt(s) need exactly that white noise. Flicker alone would have to reach the limit at the
    shortest cluster time:

    >>> import numpy as np
    >>> from jaxcal.noise._overbound import overbound_curve
    >>> tau = np.array([1.0, 10.0, 100.0])
    >>> f"{overbound_curve(tau, tau**-0.5, terms=('N', 'B')).N:.3f} {overbound_curve(tau, tau**-0.5, terms=('B',)).B:.3f}"
    '1.000 1.505'

    References
    ----------
    Noise bounds for filters when coefficients are uncertain: Langel, García Crespillo and Joerger, Navigation 68, 2021, 259-276. The
    linear programme is ours.
    """
    tau, upper, terms = np.asarray(tau, dtype=float), np.asarray(upper, dtype=float), checked_terms(terms)
    if not (np.all(np.isfinite(upper)) and np.all(upper > 0.0)):
        raise DataError("upper must be positive and finite throughout; leave the other cluster times out", code="no_upper")
    beside = Noise() if beside is None else beside
    columns = np.stack([np.asarray(term.avar(tau, dt)) for term in terms], axis=1) / upper[:, None] ** 2
    theta = _least(columns, 1.0 - np.asarray(beside.avar(tau, dt=dt)) / upper**2)
    found = noise_of(terms, list(np.sqrt(theta)))
    return dataclasses.replace(found, markov=(*beside.markov, *found.markov), sinusoid=beside.sinusoid)


def _least(columns, needed) -> Float[np.ndarray, " p"]:
    """Theta that minimises the mean of `columns` theta, subject to `columns` theta >= `needed` and theta >= 0."""
    open_rows = needed > 0.0
    if not open_rows.any():
        return np.zeros(columns.shape[1])
    # the columns span more powers of ten than the solver can resolve: each one is scaled by its largest value, and a positive need
    # counts as at least a thousandth of the limit
    needs = columns[open_rows] / np.maximum(needed[open_rows], 1e-3)[:, None]
    scale = np.max(needs, axis=0)
    needs, theta, cost = needs / scale, np.ones(1), np.mean(columns, axis=0) / scale
    if len(scale) > 1:
        found = scipy.optimize.linprog(cost / np.max(cost), A_ub=-needs, b_ub=-np.ones(len(needs)), method="highs")
        if not found.success:
            raise FitError(f"the terms cannot follow the limits: add N or B, or give fewer cluster times ({found.message})")
        theta = np.maximum(found.x, 0.0)
    # the solver's tolerance leaves the result slightly below a limit: scale it up until it reaches all of them
    return theta * (1.0 + 1e-12) / np.min(needs @ theta) / scale
