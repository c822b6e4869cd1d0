r"""From the samples of a record, with gaps and regressors in the mean, to DCT-II ordinates that are averaged in bins.

With y the orthonormal DCT-II of n samples, P_k = dt y_k^2 estimates the two-sided density at f_k = k/(2T), k = 1 .. n-1. The mean
does not enter, there is almost no leakage, and the ordinates are nearly independent. For a process with (generalised) autocovariance g,

.. math:: E\,P_k = dt\Big\{g_0 + \frac2n\sum_{h=1}^{n-1} g_h\Big[(n-h)\cos\frac{\pi k h}{n}
          - \frac{\sin(\pi k h/n)}{\sin(\pi k/n)}\Big]\Big\}

With s_k = 2 sin(pi k/2n) this is exactly K^2 dt^2/s_k^2 for a random walk, and nearly B^2 dt/s_k (1 - 2/(pi^2 k)) for flicker. The
expectation is linear in the squared coefficients. If density and columns are averaged in the same way, over bins, the averages therefore
obey the same relation exactly.

*Gaps and regressors.* Under the DCT-Whittle model a complete record x is normal with precision Q = D' diag(dt / S_k) D, where D is the
orthonormal DCT-II and the mean is free. The observations are y = x + X b at the samples that are not missing. Let z be the expectation of
x given y at the generalised least squares estimate of b, and

.. math:: \rho_k = 1 - \frac{\mathrm{Var}[(Dx)_k \mid y]}{S_k/dt} - h_k

with h_k the leverage of ordinate k in the regression. The score of the restricted likelihood of y is then the score of a complete
record with ordinates P_k = dt (Dz)_k^2 / rho_k of weight rho_k. `Observed.bins` therefore returns bins that the rest of the package
treats like those of a complete record. They depend on the density S, so fits and bins are computed in turn until S no longer changes.
This is the EM algorithm, which finds the maximum of the likelihood of the observed samples (A. P. Dempster, N. M. Laird and D. B. Rubin,
J. R. Stat. Soc. B 39, 1977). The weights count the information of each ordinate, shared information included, in its own row.
"""

import copy
import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs
from .._errors import DataError
from .._types import AnyArray, Array
from ..spectrum._average import log_groups
from ._terms import Term

#: seed of the draws that estimate the conditional variance, so that a record always gives the same numbers; least number of samples in all
#: draws together, so that short records have more draws; most draws
_SEED, _DRAWN, _MOST_DRAWS = 20_211, 2**19, 32
#: relative residual at which conjugate gradients end: for the expectation, and for draws; most steps
_EXACT, _ROUGH, _FOLLOWS, _ITERATIONS = 1e-4, 1e-2, 0.3, 60
#: share of information left in an ordinate below which the ordinate is not used; least number of samples; share of the record below which
#: its remainder is only rounding
_LEAST, _FEWEST, _NOTHING = 0.02, 16, 1e-6
#: share of missing samples, and gaps over the root of the samples, up to which a draw about the mean of the neighbours fills gaps: it
#: moves no coefficient by a tenth of its error; neighbours on either side of a gap, beside as many as the gap has samples
_FEW, _GAPS, _NEIGHBOURS = 0.02, 0.03, 24
_SMOOTH = 4096  # ordinates that hold a smooth function of time: those of a line fall with the square of their number


class Bins(NamedTuple):
    """Ordinates of a channel, or of channels (channels, bins) of the same bins, averaged in bins of frequency.

    density : mean ordinate divided by `unit`, (channels,), which is in the unit of B squared per Hz. weight : number of ordinates, which
    are the degrees of freedom; 0 for bins that are left out. columns : (bins, p) expected mean ordinate per squared coefficient.
    frequency : (bins,) mean frequency in Hz.
    """

    density: AnyArray
    weight: AnyArray
    unit: Any
    columns: AnyArray
    frequency: AnyArray

    def of(self, rows: Any) -> "Bins":
        """The bins of some channels."""
        return Bins._make((*(values[rows] for values in self[:3]), *self[3:]))


def beside(channels: Sequence[Bins]) -> Bins:
    """The bins of channels of one length, in one table."""
    return Bins._make((*map(np.array, zip(*(one[:3] for one in channels), strict=True)), *channels[0][3:]))


@functools.lru_cache(maxsize=256)
def layout(n: int, dt: float, terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First ordinate, count, columns (bins, p) and mean frequency of the bins of a gap-free stretch of n samples."""
    starts, count = log_groups(n - 1, keep_tail=True)
    count = count.astype(float)
    with jax.ensure_compile_time_eval():  # the columns do not depend on the record
        expected = [np.asarray(term.ordinates(np.arange(1, n), n, dt)) for term in terms]
    columns = np.stack([np.add.reduceat(values, starts) / count for values in expected], axis=1)
    frequency = np.add.reduceat(np.arange(1.0, n), starts) / count / (2.0 * n * dt)
    for array in (starts, count, columns, frequency):
        array.flags.writeable = False
    return starts, count, columns, frequency


def bins_of(y: Array, dt: float, terms: tuple[Term, ...]) -> Bins:
    """Bins of a traced record (n,), which has no gaps, with a column for each term."""
    starts, count, columns, frequency = layout(y.shape[0], dt, terms)
    y = eqx.error_if(y, jnp.any(jnp.isnan(y)), "a traced record must not have gaps; cut it into gap-free stretches before tracing")
    ordinates = dt * jax.scipy.fft.dct(y - jnp.mean(y), norm="ortho")[1:] ** 2
    group = np.repeat(np.arange(len(starts)), count.astype(int))
    found = jax.ops.segment_sum(ordinates, group, len(starts), indices_are_sorted=True) / count.astype(y.dtype)
    unit = jax.lax.stop_gradient(jnp.mean(found))
    count, columns, frequency = (np.asarray(array, dtype=found.dtype) for array in (count, columns, frequency))
    return Bins(found / unit, count, unit, columns, frequency)


def dct(x: np.ndarray) -> np.ndarray:
    """Orthonormal DCT-II of the last axis."""
    return np.asarray(scipy.fft.dct(x, norm="ortho"))


def _idct(x: np.ndarray) -> np.ndarray:
    return np.asarray(scipy.fft.idct(x, norm="ortho"))


class Regressors:
    """Functions of time that the mean of a record may contain beside a constant, p columns, with what all axes of a sensor share.

    Parameters
    ----------
    functions : of times in s, (count,), which give one or several columns, (count, columns). n, dt : samples, and their interval in s.
    shares : the probability that each function is in the mean.
    smooth : whether the ordinates beyond the first `_SMOOTH` hold nothing of them.

    Attributes
    ----------
    columns : (p, n) the columns; of smooth ones, (p, 4 `_SMOOTH`) at evenly spaced times.
    spectra : (p, n - 1) their DCT-II without that of the mean; of smooth ones, (p, `_SMOOTH`).
    groups, shares : (p,) the function of each column, and its probability. both : (p, p) the probability that two columns are in the mean.
    """

    def __init__(
        self, functions: Sequence[Callable[[AnyArray], AnyArray]], n: int, dt: float, shares: Sequence[float] = (), smooth: bool = False
    ):
        count, width = (4 * _SMOOTH, _SMOOTH) if smooth and n > 4 * _SMOOTH else (n, n - 1)
        self._edges = np.arange(count + 1) * (n / count)
        times = (0.5 * (self._edges[1:] + self._edges[:-1]) - 0.5) * dt
        parts = [np.zeros((0, count)), *(function(times).T for function in functions)]
        self.columns, self.groups = np.concatenate(parts), np.repeat(np.arange(len(functions)), [len(one) for one in parts[1:]])
        self.spectra = np.sqrt(n / count) * (dct(self.columns) if len(self.columns) else self.columns)[:, 1 : width + 1]
        self.shares = np.array(shares or np.ones(len(functions)))[self.groups]
        self.both = np.where(np.equal.outer(self.groups, self.groups), self.shares, np.outer(self.shares, self.shares))
        self._products: np.ndarray | None = None

    def at_samples(self, values: np.ndarray) -> np.ndarray:
        """What is known at the times of the columns, (..., count), at each sample, (..., n)."""
        return values if values.shape[-1] == self._edges[-1] else np.repeat(values, np.diff(np.rint(self._edges).astype(int)), axis=-1)

    def products(self, starts: np.ndarray) -> np.ndarray:
        """Sums over each bin of the products of the spectra, (p, p, bins)."""
        self._products = _products(self.spectra, self.spectra, starts) if self._products is None else self._products
        return self._products


class Observed:
    """The observed samples of a record.

    Parameters
    ----------
    y : (n,) samples; NaN marks a missing one.
    dt : sampling interval in s.
    name : of the channel, for messages.

    Attributes
    ----------
    complete : whether every sample is observed, and there are no regressors. The bins then do not depend on a density.
    factors, covariance : estimate of the factors b of the regressors, and its covariance, from the last call of `bins`.
    doubts : (groups, bins) standard deviation of the density for not knowing whether functions are in the mean.
    """

    def __init__(self, y: np.ndarray, dt: float, name: str = ""):
        self.y, self.dt, self.name = np.asarray(y, dtype=float), dt, name
        y, n, missing = self.y, len(y), np.isnan(y)
        known = n - np.count_nonzero(missing)
        self._there = known / n
        if known < _FEWEST:
            raise DataError(f"{known} of {n} samples are there; a noise model needs {_FEWEST} at least").of(name)
        if 0.0 < 1.0 - self._there <= _FEW and len(runs(missing)[0]) <= _GAPS * np.sqrt(n):
            y, missing = bridged(y), np.zeros(n, dtype=bool)
        else:
            self._there = 1.0
        self._open = np.flatnonzero(missing)
        self._given = self._centred(y[None, :])  # the record, and regressors where samples are missing
        self._spectrum = dct(self._given[0])[1:] if not len(self._open) else None
        self._runs = _runs_of(missing) if len(self._open) else {}
        self._draws = 0 if not len(self._open) else min(_MOST_DRAWS, max(2, -(-_DRAWN // n)))
        self._white = np.random.default_rng(_SEED).standard_normal((self._draws, n))
        self._mean = Regressors((), n, dt, smooth=True)
        self._begin()

    def beside(self, regressors: Regressors) -> "Observed":
        """The record with functions of time in its mean."""
        found = copy.copy(self)
        found._mean = regressors
        if len(self._open):
            found._given = np.concatenate([self._given[:1], self._centred(regressors.at_samples(regressors.columns))])
        found._begin()
        return found

    def _begin(self) -> None:
        p = len(self._mean.spectra)
        self.complete = not len(self._open) and not p
        self._z, self._before = self._given, {}
        self._known: tuple[np.ndarray, np.ndarray] | None = None
        self.factors, self.covariance, self.doubts = np.zeros(p), np.zeros((p, p)), np.zeros((0, 0))

    def _centred(self, x: np.ndarray) -> np.ndarray:
        """Functions of time, (p, n), less their means, with the gaps of the record."""
        if not len(self._open):
            return x - x.mean(axis=1, keepdims=True)
        x = np.array(x, dtype=float)
        x[:, self._open] = 0.0
        x -= x.sum(axis=1, keepdims=True) / (x.shape[1] - len(self._open))
        x[:, self._open] = 0.0
        return x

    def bins(self, terms: tuple[Term, ...], density: np.ndarray | None = None) -> Bins:
        """Bins of the ordinates.

        Parameters
        ----------
        terms : the term of each column of the bins.
        density : (bins,) density at the bins of an earlier call, in the unit of the record squared per Hz. None if none is known yet;
            straight lines then fill the gaps.
        """
        starts, count, columns, frequency = layout(len(self.y), self.dt, terms)
        level, lost = np.ones(len(count)) if density is None else density[: len(count)], np.zeros(len(count))
        if self._spectrum is None:
            at = np.log(np.arange(1, len(self.y)) / (2.0 * len(self.y) * self.dt))
            everywhere = None if density is None else np.exp(np.interp(at, np.log(frequency), np.log(level)))
            self._z, lost = self._expected(everywhere, starts)
            spectra = dct(self._z)[:, 1:]
            record, own = _products(spectra, spectra[:1], starts)[:, 0], _products(spectra[1:], spectra[1:], starts)
            squares, cross = record[0], record[1:]
        else:
            own = self._mean.products(starts)
            if self._known is None:
                cross = _products(self._mean.spectra, self._spectrum[None, :], starts)[:, 0]
                self._known = np.add.reduceat(self._spectrum**2, starts), cross
            squares, cross = self._known
        power, eps = np.sum(squares), np.finfo(float).eps
        rounding = eps**2 * power * count  # ordinates are never zero, not even those of a record without noise
        if len(own):  # within a bin, all ordinates have the weight of their mean
            precision = self.dt / level
            gram = own @ precision
            scale = np.sqrt(np.maximum(np.diagonal(gram), np.finfo(float).tiny))
            self.covariance = np.linalg.pinv(gram / np.outer(scale, scale), rcond=1e-12, hermitian=True) / np.outer(scale, scale)
            self.factors = self.covariance @ (cross @ precision)
            lost = lost + np.einsum("ij,ijb->b", self.covariance * self._mean.both, own) * precision
            # their expectation over the functions that may be in the mean
            parts = self.factors[:, None] * (
                np.einsum("ij,ijb->ib", self._mean.both * self.factors, own) - 2.0 * self._mean.shares[:, None] * cross
            )
            rounding = rounding + eps * squares  # of the difference
            squares = np.maximum(squares + np.sum(parts, axis=0), 0.0)
            self.doubts = self._doubts(own, cross) * self.dt / count
        if not np.sum(squares) > _NOTHING**2 * power:
            why = "there is no noise to characterise. Check that the log holds what the sensor sent"
            raise DataError(f"the record is a step, a ramp or another smooth change to within rounding: {why}").of(self.name)
        share = np.clip(1.0 - lost / count, 0.0, 1.0)
        weight = np.where(share < _LEAST, 0.0, count * share * self._there)
        ordinates = self.dt * np.maximum(squares, rounding) / count / np.maximum(share, _LEAST)
        unit = np.exp(np.sum(weight * np.log(ordinates)) / max(np.sum(weight), 1.0))
        return Bins(ordinates / unit, weight, unit, columns, frequency)

    @property
    def filled(self) -> np.ndarray:
        """(n,) expectation of the record without the regressors, given the observations."""
        if self.complete:
            return self._z[0]
        mean, parts = self._mean, self._z[1:] if len(self._open) else self._mean.columns
        return self._z[0] - mean.at_samples((mean.shares * self.factors) @ parts)

    @property
    def drawn(self) -> np.ndarray:
        """(n,) the same, with a random draw in place of the expectation of unknown samples, so that it scatters like a complete record."""
        if "draws" not in self._before:
            return self.filled
        found = self.filled.copy()
        found[self._open] += self._before["draws"][0]
        return found

    def spectrum(self) -> np.ndarray:
        """Ordinates (n - 1,) of `drawn` by the orthonormal DCT-II, without that of the mean."""
        if self._spectrum is None:
            return dct(self.drawn)[1:]
        if self.complete:
            return self._spectrum
        found = self._spectrum.copy()
        found[: self._mean.spectra.shape[1]] -= (self._mean.shares * self.factors) @ self._mean.spectra
        return found

    def _doubts(self, own: np.ndarray, cross: np.ndarray) -> np.ndarray:
        """By how much each group of functions that may be in the mean changes the squares in each bin, as standard deviations."""
        mean, found = self._mean, []
        for group in np.unique(mean.groups[mean.shares < 1.0]):
            here = mean.groups == group
            with_others = np.where(here, 0.5, mean.shares) * self.factors
            change = 2.0 * self.factors[here] @ (np.einsum("j,ijb->ib", with_others, own[here]) - cross[here])
            share = float(mean.shares[here][0])
            found.append(np.sqrt(share * (1.0 - share)) * change)
        return np.reshape(found, (-1, own.shape[-1]))

    def _expected(self, level: np.ndarray | None, starts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Expectation of the record and of the regressors, and the conditional variance over the density, summed in bins."""
        n, z = len(self.y), self._given.copy()
        if level is None:
            known = np.delete(np.arange(n), self._open)
            for row in z:
                row[self._open] = np.interp(self._open, known, row[known])
            return z, np.zeros(len(starts))
        precision = np.concatenate([[0.0], self.dt / level])
        # in a gap, the eigenvectors of a random walk and of white noise are sines: this is nearly the inverse
        at = np.arange(1, n)
        sines = {length: np.interp(np.arange(1, length + 1) * n / (length + 1.0), at, level) / self.dt for length in self._runs}
        pull = -_idct(precision * dct(z))[:, self._open]
        z[:, self._open] = self._solve("expected", pull, precision, sines, _EXACT)
        pull = _idct(np.sqrt(precision) * self._white)[:, self._open]
        drawn = np.zeros((self._draws, n))
        drawn[:, self._open] = self._solve("draws", pull, precision, sines, _ROUGH)
        lost = np.sum(dct(drawn)[:, 1:] ** 2, axis=0) * precision[1:] / self._draws
        return z, np.add.reduceat(lost, starts)

    # a record that is a ramp to within rounding has precisions beyond the range of floats; it is refused after the fit
    @np.errstate(over="ignore", invalid="ignore")
    def _solve(self, key, b, precision, sines, tolerance):
        """Q^-1 b over the missing samples, (vectors, samples), by conjugate gradients with a preconditioner of sines in each gap.

        They begin at the last vectors of this key.
        """

        def product(v):
            full = np.zeros((len(v), len(self.y)))
            full[:, self._open] = v
            return _idct(precision * dct(full))[:, self._open]

        def nearly_inverse(r):
            out = np.empty_like(r)
            for length, where in self._runs.items():
                waves = scipy.fft.dst(r[:, where], type=1, norm="ortho", axis=-1) * sines[length]
                out[:, where] = scipy.fft.idst(waves, type=1, norm="ortho", axis=-1)
            return out

        def dot(one, other):
            return np.sum(one * other, axis=1, keepdims=True)

        last = self._before.get(key)
        v, r = (np.zeros_like(b), b) if last is None else (last.copy(), b - product(last))
        whole, direction = dot(b, nearly_inverse(b)), nearly_inverse(r)
        size, on = dot(r, direction), np.arange(len(b))  # on: the vectors that are not yet exact
        # however near they begin, the vectors follow the density: rounds of filling would else swing about the solution
        enough = np.minimum(tolerance**2 * whole, np.maximum(_FOLLOWS**2 * size, _EXACT**4 * whole))
        for _ in range(_ITERATIONS):
            more = ~(size <= enough)[:, 0]
            r, direction, size, enough, on = (values[more] for values in (r, direction, size, enough, on))
            if not len(on):
                break
            image = product(direction)
            step = size / dot(direction, image)
            v[on] += step * direction
            r = r - step * image
            z = nearly_inverse(r)
            size, before = dot(r, z), size
            direction = z + size / before * direction
        self._before[key] = v
        return v


def _products(spectra: np.ndarray, others: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Sums over each bin of the products of spectra, (p, ordinates) and (q, ordinates): (p, q, bins)."""
    found, width = np.zeros((len(spectra), len(others), len(starts))), spectra.shape[1]
    held = starts[starts < width]
    for i, j in np.ndindex(*found.shape[:2]):
        found[i, j, : len(held)] = np.add.reduceat(spectra[i] * others[j, :width], held)
    return found


def bridged(y: np.ndarray) -> np.ndarray:
    """The record (n,) with a draw in its gaps: white noise as strong as beside the gap, about the line between the means on either side."""
    filled, random = y.copy(), np.random.default_rng(_SEED)
    for first, last in zip(*runs(np.isnan(y)), strict=True):
        reach = _NEIGHBOURS + last - first
        sides = [side[~np.isnan(side)] for side in (y[max(first - reach, 0) : first], y[last : last + reach])]
        means = [side.mean() for side in sides if len(side)] or [np.nanmean(y)]
        spread = np.sqrt(sum(len(side) * side.var() for side in sides if len(side)) / max(sum(map(len, sides)) - 2.0, 1.0))
        part = (np.arange(last - first) + 0.5 + reach / 2.0) / (last - first + reach)
        filled[first:last] = means[0] * (1.0 - part) + means[-1] * part + spread * random.standard_normal(last - first)
    return filled


def _runs_of(missing: np.ndarray) -> dict[int, np.ndarray]:
    """Length -> (gaps, length) positions among the missing samples, of all gaps of this length."""
    lengths = np.subtract(*runs(missing)[::-1])
    first = np.cumsum(lengths) - lengths
    return {int(length): first[lengths == length][:, None] + np.arange(length) for length in np.unique(lengths)}
