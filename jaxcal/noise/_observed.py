r"""The likelihood of the observed samples of a record with gaps and regressors in the mean.

Under the DCT-Whittle model a complete record x is normal with precision Q = D' diag(dt / S_k) D, where D is the orthonormal DCT-II and
the mean is free. The observations are y = x + X b at the samples that are not missing. Let z be the expectation of x given y at the
generalised least squares estimate of b, and

.. math:: \rho_k = 1 - \frac{\mathrm{Var}[(Dx)_k \mid y]}{S_k/dt} - h_k

with h_k the leverage of ordinate k in the regression. The score of the restricted likelihood of y is then the score of a complete
record with ordinates P_k = dt (Dz)_k^2 / rho_k of weight rho_k. `Observed.bins` therefore returns bins that the rest of the package
treats like those of a complete record. They depend on the density S, so fits and bins are computed in turn until S no longer changes.
This is the EM algorithm, which finds the maximum of the likelihood of the observed samples (A. P. Dempster, N. M. Laird and D. B. Rubin,
J. R. Stat. Soc. B 39, 1977). The weights count the information of each ordinate, shared information included, in its own row.
"""

import dataclasses

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import runs
from .._errors import DataError
from ._ordinates import Bins, layout
from ._terms import Term

#: seed of the draws that estimate the conditional variance, so that a record always gives the same numbers; least number of samples in all
#: draws together, so that short records have more draws; most draws
_SEED, _DRAWN, _MOST_DRAWS = 20_211, 2**19, 32
#: relative residual at which conjugate gradients end: for the expectation, and for draws; most steps
_EXACT, _ROUGH, _ITERATIONS = 1e-4, 1e-2, 60
#: share of information left in an ordinate below which the ordinate is not used; least number of samples; share of the record below which
#: its remainder is only rounding
_LEAST, _FEWEST, _NOTHING = 0.02, 16, 1e-6
#: share of missing samples, and gaps over the root of the samples, up to which a draw about the mean of the neighbours fills gaps: it
#: moves no coefficient by a tenth of its error; neighbours on either side of a gap, beside as many as the gap has samples
_FEW, _GAPS, _NEIGHBOURS = 0.02, 0.03, 24
_REGRESSED = 4096  # lowest ordinates that determine the size of a regressor, which changes slowly


def _dct(x):
    return np.asarray(scipy.fft.dct(x, norm="ortho", axis=0))


def _idct(x):
    return np.asarray(scipy.fft.idct(x, norm="ortho", axis=0))


@dataclasses.dataclass
class Observed:
    """The observed samples of a record.

    Parameters
    ----------
    y : (n,) samples; NaN marks a missing one.
    dt : sampling interval in s.
    regressors : (n, p) functions of time that the mean may contain beside a constant.

    Attributes
    ----------
    complete : whether every sample is observed, and there are no regressors. The bins then do not depend on a density.
    filled : (n,) expectation of the record without the regressors, given the observations, from the last call of `bins`.
    drawn : (n,) the same, with a random draw in place of the expectation of unknown samples, so that it scatters like a complete record.
    factors, covariance : estimate of the factors b of the regressors, and its covariance, from the last call of `bins`.
    """

    y: np.ndarray
    dt: float
    regressors: np.ndarray | None = None

    def __post_init__(self):
        y = np.asarray(self.y, dtype=float)
        n, missing = len(y), np.isnan(y)
        columns = np.zeros((n, 0)) if self.regressors is None else np.array(self.regressors, dtype=float)
        self._there = 1.0 - missing.mean()
        if n - missing.sum() < _FEWEST:
            raise DataError(f"{n - int(missing.sum())} of {n} samples are there; a noise model needs {_FEWEST} at least")
        if 0.0 < 1.0 - self._there <= _FEW and len(runs(missing)[0]) <= _GAPS * np.sqrt(n):
            for column in columns.T:  # a step inside of a gap is bridged in the record, too
                column[:] = bridged(np.where(missing, np.nan, column))
            y, missing = bridged(y), np.zeros(n, dtype=bool)
        else:
            self._there = 1.0
        self._open = np.flatnonzero(missing)
        # the regressors have the gaps of the record
        self._given = np.concatenate([y[:, None], columns], axis=1)
        self._given[missing] = 0.0
        self._given -= self._given.sum(axis=0) / (n - missing.sum())
        self._given[missing] = 0.0
        self._spectrum: np.ndarray | None = None
        self._whole: Bins | None = None
        self._runs = _runs_of(self._open)
        self._draws = 0 if not len(self._open) else min(_MOST_DRAWS, max(2, -(-_DRAWN // n)))
        self._white = np.random.default_rng(_SEED).standard_normal((self._draws, n))
        self._before: dict[object, np.ndarray] = {}
        self._transformed = None if len(self._open) else _dct(self._given)[1:]
        self.complete = not len(self._open) and not columns.shape[1]
        self.filled = self.drawn = y if not len(self._open) else without_gaps(y)
        self.factors, self.covariance = np.zeros(columns.shape[1]), np.zeros((columns.shape[1],) * 2)

    def bins(self, terms: tuple[Term, ...], density: np.ndarray | None = None) -> Bins:
        """Bins of the ordinates.

        Parameters
        ----------
        terms : the term of each column of the bins.
        density : (bins,) density at the bins of an earlier call, in the unit of the record squared per Hz. None if none is known yet;
            straight lines then fill the gaps.
        """
        n, dt = len(self.y), self.dt
        starts, count, columns, frequency = layout(n, dt, terms)
        if self._whole is not None:
            return self._whole._replace(columns=columns)
        lost, kept = np.zeros(n - 1), min(n - 1, _REGRESSED)
        if self._transformed is None:
            kept = n - 1
            if density is None:
                level, z = np.ones(1), without_gaps(np.where(np.isnan(self.y)[:, None], np.nan, self._given))
            else:
                level = _at_ordinates(density, frequency, n, kept, dt)
                z, lost = self._expected(level)
            spectrum = _dct(z)[1:]
        else:
            level = np.ones(1) if density is None else _at_ordinates(density, frequency, n, kept, dt)
            z, spectrum = self._given, self._transformed
        precision = dt / level
        design = spectrum[:, 1:]
        if design.shape[1]:
            x = design[:kept]
            scale = np.sqrt(np.maximum(np.sum(x**2 * precision[:, None], axis=0), np.finfo(float).tiny))
            weighted = x * (np.sqrt(precision)[:, None] / scale)
            inverse = np.linalg.pinv(weighted.T @ weighted, rcond=1e-12, hermitian=True)
            self.factors = inverse @ (weighted.T @ (np.sqrt(precision) * spectrum[:kept, 0])) / scale
            self.covariance = inverse / np.outer(scale, scale)
            lost[:kept] += np.einsum("ki,ij,kj->k", weighted, inverse, weighted)
        remainder = spectrum[:, 0] - design @ self.factors if design.shape[1] else spectrum[:, 0]
        squares = remainder**2
        if not np.sum(squares) > _NOTHING**2 * np.sum(self._given[:, 0] ** 2):
            raise DataError(
                "the record is a step, a ramp or another smooth change to within rounding: there is no noise to characterise. Check that "
                "the log holds what the sensor sent"
            )
        self.filled = z[:, 0] - z[:, 1:] @ self.factors if design.shape[1] else z[:, 0]
        self.drawn, self._spectrum = self.filled, remainder
        if self._draws and density is not None:
            self.drawn = self.filled.copy()
            self.drawn[self._open] += self._before[0]
            self._spectrum = None
        share = np.clip(1.0 - np.add.reduceat(lost, starts) / count, 0.0, 1.0)
        weight = np.where(share < _LEAST, 0.0, count * share * self._there)
        ordinates = dt * np.add.reduceat(squares, starts) / count / np.maximum(share, _LEAST)
        unit = np.exp(np.sum(weight * np.log(np.maximum(ordinates, np.finfo(float).tiny))) / max(np.sum(weight), 1.0))
        found = Bins(ordinates / unit, weight, columns, frequency, unit)
        if self.complete:  # nothing but the columns will differ
            self._whole = found
        return found

    def spectrum(self) -> np.ndarray:
        """Ordinates (n - 1,) of `drawn` by the orthonormal DCT-II, without that of the mean."""
        return _dct(self.drawn - self.drawn.mean())[1:] if self._spectrum is None else self._spectrum

    def _expected(self, level):
        """Expectation of the record and of the regressors, and the conditional variance of each ordinate over its density, (n - 1,)."""
        n, lost = len(self.y), np.zeros(len(self.y) - 1)
        if not len(self._open):
            return self._given, lost
        precision = np.concatenate([[0.0], self.dt / level])
        # in a gap, the eigenvectors of a random walk and of white noise are sines: this is nearly the inverse
        at, n = np.arange(1, n), len(self.y)
        sines = {length: np.interp(np.arange(1, length + 1) * n / (length + 1.0), at, level) / self.dt for length in self._runs}
        known = self._given.copy()
        known[self._open] = 0.0
        pull = -_idct(precision[:, None] * _dct(known))[self._open]
        z = known
        for i in range(z.shape[1]):
            z[self._open, i] = self._before["y", i] = self._solve(pull[:, i], precision, sines, self._before.get(("y", i)), _EXACT)
        for i, white in enumerate(self._white):
            pull = _idct(np.sqrt(precision) * white)[self._open]
            self._before[i] = self._solve(pull, precision, sines, self._before.get(i), _ROUGH)
            drawn = np.zeros(n)
            drawn[self._open] = self._before[i]
            lost += _dct(drawn)[1:] ** 2 * precision[1:] / self._draws
        return z, lost

    # a record that is a ramp to within rounding has precisions beyond the range of floats; it is refused after the fit
    @np.errstate(over="ignore", invalid="ignore")
    def _solve(self, b, precision, sines, start, tolerance):
        """Q^-1 b over the missing samples, by conjugate gradients with a preconditioner of sines in each gap."""
        full = np.zeros(len(self.y))

        def product(v):
            full[self._open] = v
            return _idct(precision * _dct(full))[self._open]

        def nearly_inverse(r):
            out = np.empty_like(r)
            for length, where in self._runs.items():
                waves = scipy.fft.dst(r[where], type=1, norm="ortho", axis=-1) * sines[length]
                out[where] = scipy.fft.idst(waves, type=1, norm="ortho", axis=-1)
            return out

        v = np.zeros_like(b) if start is None else start.copy()
        r = b.copy() if start is None else b - product(v)
        enough = tolerance**2 * (b @ nearly_inverse(b))
        z = nearly_inverse(r)
        direction, size = z, r @ z
        for _ in range(_ITERATIONS):
            if size <= enough:
                break
            image = product(direction)
            step = size / (direction @ image)
            v, r = v + step * direction, r - step * image
            z = nearly_inverse(r)
            size, last = r @ z, size
            direction = z + size / last * direction
        return v


def _at_ordinates(density, frequency, n: int, kept: int, dt: float):
    """The density at the first ordinates."""
    at = np.log(np.arange(1, kept + 1) / (2.0 * n * dt))
    return np.exp(np.interp(at, np.log(frequency), np.log(density[: len(frequency)])))


def bridged(y: np.ndarray) -> np.ndarray:
    """The record (n,) with a draw in its gaps: white noise as strong as beside the gap, about the line between the means on either side."""
    missing = np.isnan(y)
    first, last = runs(missing)
    reach = _NEIGHBOURS + last - first
    known = np.where(missing, 0.0, y - np.nanmean(y))
    sums = [np.concatenate([[0.0], np.cumsum(values)]) for values in (~missing, known, known**2)]

    def beside(a, b):
        a, b = np.clip(a, 0, len(y)), np.clip(b, 0, len(y))
        count, total, square = (np.maximum(one[b] - one[a], 0.0) for one in sums)
        mean = total / np.maximum(count, 1.0)
        return count, mean, square - count * mean**2

    before, after = beside(first - reach, first), beside(last, last + reach)
    means = [np.where(one[0] > 0, one[1], other[1]) for one, other in ((before, after), (after, before))]
    spread = np.sqrt(np.maximum(before[2] + after[2], 0.0) / np.maximum(before[0] + after[0] - 2.0, 1.0))
    which = np.repeat(np.arange(len(first)), last - first)
    at = np.flatnonzero(missing)
    part = (at - first[which] + 0.5 + reach[which] / 2.0) / (last - first + reach)[which]
    filled = y.copy()
    middle = means[0][which] * (1.0 - part) + means[1][which] * part
    filled[at] = middle + spread[which] * np.random.default_rng(_SEED).standard_normal(len(at)) + np.nanmean(y)
    return filled


def _runs_of(index) -> dict[int, np.ndarray]:
    """Length -> (runs, length) positions in `index` of all runs of consecutive numbers of this length."""
    if not len(index):
        return {}
    edges = np.concatenate([[0], np.flatnonzero(np.diff(index) > 1) + 1, [len(index)]])
    lengths = np.diff(edges)
    return {int(length): edges[:-1][lengths == length][:, None] + np.arange(length) for length in np.unique(lengths)}


def without_gaps(y: np.ndarray) -> np.ndarray:
    """The record, (n,) or (n, channels), with straight lines in the gaps of each channel."""
    filled = np.array(y, dtype=float)
    for column in filled.reshape(len(filled), -1).T:
        missing = np.isnan(column)
        if missing.any() and not missing.all():
            column[missing] = np.interp(np.flatnonzero(missing), np.flatnonzero(~missing), column[~missing])
    return filled
