"""Information of each recording about its parameters: a binned likelihood for noise, a normal distribution for other fits."""

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._types import Array
from ..noise import NoiseFit
from ..noise._binned import LogLikelihood

_SINGLE, _PER_DECADE = 16, 12  # bins of one ordinate, and bins per decade beyond; they resolve all differences of smooth densities
_SEEN = 0.25  # share of the recordings that must show a term for it to be pooled
_FLAT = 1e-3  # precision of a logarithm about which the record has no information
_ROUNDS = 15  # number of Fisher scoring steps of a profile
_TERMS = ("Q", "N", "B", "K")
_FIELDS = ("frequency", "density", "weight", "base")


class Recording(NamedTuple):
    """Noise of one recording: its likelihood, and its own coefficients, with their intervals and whether each was detected."""

    likelihood: LogLikelihood
    value: dict[str, float]
    interval: dict[str, tuple[float, float]]
    seen: dict[str, bool]

    @classmethod
    def of(cls, fit: NoiseFit) -> "Recording":
        """The recording that belongs to a fit."""
        values = {term: float(np.asarray(fit.noise.coefficient(term))) for term in fit.terms}
        limits = {term: (float(fit.interval[term][0]), float(fit.interval[term][1])) for term in fit.terms}
        seen = {term: values[term] > 0.0 and fit.presence[term] != "not detected" for term in fit.terms}
        return cls(fit.log_likelihood, values, limits, seen)


class Leaves(NamedTuple):
    """Information of all recordings, side by side.

    names : names of the parameters. logarithm : whether `start` holds logarithms of them. raw, interval : estimates of each recording
        alone.
    start : (n, p). step : (n, p, p) roots of the covariances of proposals. data : data of the likelihoods, (n, ...) each.
    scale : (p,) unit in which the parameters are sampled.
    """

    names: tuple[str, ...]
    logarithm: bool
    raw: np.ndarray
    interval: np.ndarray
    start: np.ndarray
    step: np.ndarray
    data: Any
    scale: np.ndarray

    @property
    def log_likelihood(self) -> Any:
        """(parameters, data of one recording) -> scalar; None for normal distributions."""
        return binned if self.logarithm else None

    def seen_from(self, middle: np.ndarray, spread: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Mean and standard error (n, p) of the normal distribution that replaces each recording, as seen from the population.

        The signed root of the profile likelihood, r(v), is normal about zero at the true value v. It is replaced by a straight line between
        one standard deviation of the population on either side of `middle`, (n, p), where it decides whether a recording belongs there.
        """
        if not self.logarithm:
            value, root = self.data
            return value, np.sqrt(np.einsum("nij,nij->ni", root, root))
        at = middle[None] + spread * np.array([-1.0, 0.0, 1.0])[:, None, None]
        low, here, high = np.asarray(_signed_roots(jnp.asarray(self.start), jax.tree.map(jnp.asarray, self.data), jnp.asarray(at)))
        error = 2.0 * spread / np.maximum(low - high, 1e-6)
        return middle + here * error, error


def binned(x: Array, data: Any) -> Array:
    """Whittle log-likelihood of logarithms of coefficients, from binned data."""
    s = data["columns"] @ jnp.exp(2.0 * x) + data["base"]
    return -0.5 * jnp.sum(data["weight"] * (jnp.log(s) + data["density"] / s))


def of_noise(recordings: Sequence[Recording], terms: Sequence[str] | None) -> Leaves:
    """`Leaves` of noise, whose parameters are logarithms of the coefficients."""
    names = _chosen(recordings, terms)
    raw = np.array([[one.value[term] for term in names] for one in recordings])
    interval = np.array([[one.interval[term] for term in names] for one in recordings])
    usual = np.array([np.median(column[column > 0.0]) for column in raw.T])
    parts = [_coarse(one, names) for one in recordings]
    rows = max(len(part["weight"]) for part in parts)
    data = {}
    for name in parts[0]:
        fill = 0.0 if name == "weight" else 1.0
        data[name] = np.stack(
            [np.pad(p[name], ((0, rows - len(p[name])), *((0, 0),) * (p[name].ndim - 1)), constant_values=fill) for p in parts]
        )
    start = np.log(np.where([[one.seen[term] for term in names] for one in recordings], raw, usual))
    shares = data["columns"] * np.exp(2.0 * start)[:, None, :]
    slopes = 2.0 * shares / (shares.sum(axis=2) + data["base"])[..., None]
    information = 0.5 * np.einsum("nbp,nb,nbq->npq", slopes, data["weight"], slopes)
    spread = np.maximum(np.var(start, axis=0), 0.05**2)
    step = np.linalg.cholesky(np.linalg.inv(information + np.diag(1.0 / spread)))
    return Leaves(names, True, raw, interval, start, step, data, np.ones(len(names)))


def of_estimates(fits: Sequence[Any], terms: Sequence[str] | None, confidence: float) -> Leaves:
    """`Leaves` of fits with an `estimate`, as of a magnetometer or an IMU; their parameters are not transformed."""
    fits = [getattr(fit, "estimate", fit) for fit in fits]
    for i, fit in enumerate(fits):
        if any(getattr(fit, name, None) is None for name in ("names", "values", "covariance")):
            known = "a NoiseFit of one channel by method 'whittle', or a result with names, values and covariance"
            raise DataError(f"fit {i}: expected {known}; got {type(fit).__name__}", code="fits")
    names = tuple(fits[0].names if terms is None else terms)
    if not names or any(not set(names) <= set(fit.names) for fit in fits):
        raise DataError(f"parameters {names}: every fit must have them; the first has {tuple(fits[0].names)}", code="terms")
    values = np.array([[np.asarray(fit.values, dtype=float)[list(fit.names).index(name)] for name in names] for fit in fits])
    where = [[list(fit.names).index(name) for name in names] for fit in fits]
    spread = np.array([np.asarray(fit.covariance, dtype=float)[np.ix_(at, at)] for fit, at in zip(fits, where, strict=True)])
    if not (np.isfinite(values).all() and np.isfinite(spread).all()):
        raise DataError("a value or a covariance is not finite; leave out the fits without a result", code="not_finite")
    fixed = [name for name, column in zip(names, values.T, strict=True) if not np.ptp(column) > 0.0]
    if fixed and terms is None:
        kept = [i for i, name in enumerate(names) if name not in fixed]
        names, values, spread = tuple(names[i] for i in kept), values[:, kept], spread[:, kept][:, :, kept]
    if not names or (fixed and terms is not None):
        raise DataError(f"parameters {tuple(fixed)} are the same in all fits: there is nothing to pool", code="terms")
    size, turn = np.linalg.eigh(spread)
    root = turn * np.sqrt(np.maximum(size, 0.0))[:, None, :]
    scale = np.std(values, axis=0)
    error = float(scipy.special.ndtri((1.0 + confidence) / 2.0)) * np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    data = (values / scale, root / scale[:, None])
    return Leaves(names, False, values, np.stack([values - error, values + error], -1), data[0], data[1], data, scale)


def _chosen(recordings: Sequence[Recording], terms: Sequence[str] | None) -> tuple[str, ...]:
    asked = tuple(terms) if terms is not None else _TERMS
    found = {term: [one.seen[term] for one in recordings] for term in asked if all(term in one.value for one in recordings)}
    if terms is not None and len(found) < len(asked):
        raise DataError(f"terms {asked}: every fit must have them; all have {tuple(found)}", code="terms")
    chosen = tuple(term for term, seen in found.items() if np.mean(seen) >= (_SEEN if terms is None else 0.0) and any(seen))
    if not chosen:
        raise DataError("no term is found in a quarter of the fits: there is nothing to pool; record longer", code="nothing")
    return chosen


def _coarse(one: Recording, terms: tuple[str, ...]) -> dict[str, Any]:
    """Density, weight and columns of wider bins; `base` is the density of the terms that are not pooled."""
    held = coarse(one.likelihood)
    columns = np.stack([held.columns[term] for term in terms], axis=1)
    rest = [value**2 * held.columns[term] for term, value in one.value.items() if term not in terms]
    base = np.maximum(held.base + sum(rest), 0.0)
    return {"density": held.density, "weight": held.weight, "columns": columns, "base": base}


def held(likelihood: LogLikelihood) -> dict[str, Any]:
    """A likelihood in the form of a result file: wide bins, rounded numbers."""
    few = coarse(likelihood)
    fields = {name: _rounded(getattr(few, name)) for name in _FIELDS}
    return fields | {"columns": {name: _rounded(column) for name, column in few.columns.items()}, "dt": few.dt}


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.6e}") for value in np.asarray(values)]


def released(kept: dict[str, Any]) -> LogLikelihood:
    """The likelihood from the form of a result file."""
    fields = {name: np.array(kept[name]) for name in _FIELDS}
    return LogLikelihood(**fields, columns={name: np.array(column) for name, column in kept["columns"].items()}, dt=kept["dt"])


def coarse(held: LogLikelihood) -> LogLikelihood:
    """The likelihood with neighbouring bins merged, which is accurate for smooth densities and faster."""
    used = np.asarray(held.weight) > 0
    f, weight = np.asarray(held.frequency)[used], np.asarray(held.weight)[used]
    number = np.floor(_PER_DECADE * np.log10(f / f[0]))
    number[:_SINGLE] = -np.arange(_SINGLE, 0, -1)[: len(f)]
    starts = np.flatnonzero(np.diff(number, prepend=-np.inf) != 0)
    total = np.add.reduceat(weight, starts)

    def mean(values):
        return np.add.reduceat(np.asarray(values)[used] * weight, starts) / total

    columns = {name: mean(column) for name, column in held.columns.items()}
    return LogLikelihood(mean(held.frequency), mean(held.density), total, columns, mean(held.base), held.dt)


@eqx.filter_jit
def _signed_roots(start: Array, data: Any, at: Array) -> Array:
    """R = sign(v_max - v) sqrt(2 (l_max - l(v))) of the profile likelihood of each parameter at `at`, (points, n, p)."""
    p = start.shape[1]

    def scored(x, one, free, anchor):
        shares = one["columns"] * jnp.exp(2.0 * x)[None, :]
        s = shares.sum(axis=1) + one["base"]
        slope = 2.0 * shares / s[:, None] * free[None, :]
        pull = 0.5 * slope.T @ (one["weight"] * (one["density"] / s - 1.0)) - _FLAT * (x - anchor) * free
        information = 0.5 * (slope * one["weight"][:, None]).T @ slope + jnp.diag(jnp.where(free > 0, _FLAT, 1.0))
        return x + jnp.clip(jnp.linalg.solve(information, pull), -0.7, 0.7) * free

    def highest(x, one, free):
        return jax.lax.fori_loop(0, _ROUNDS, lambda _, y: scored(y, one, free, x), x)

    top = jax.vmap(partial(highest, free=jnp.ones(p)))(start, data)
    best = jax.vmap(binned)(top, data)

    def root(v, j):
        free = jnp.arange(p) != j
        held = jnp.where(free[None, :], top, v)
        found = jax.vmap(partial(highest, free=free.astype(held.dtype)))(held, data)
        fall = jnp.maximum(best - jax.vmap(binned)(found, data), 0.0)
        return jnp.sign(top[:, j] - v[:, j]) * jnp.sqrt(2.0 * fall)

    return jnp.stack([jnp.stack([root(v, j) for j in range(p)], axis=1) for v in at])
