r"""DCT-II ordinates of a record in bins, and what each squared coefficient contributes to them.

With y the orthonormal DCT-II of n samples, P_k = dt y_k^2 estimates the two-sided density at f_k = k/(2T), k = 1 .. n-1. The mean
drops out, nothing leaks, and the ordinates are nearly independent. For a process with (generalised) autocovariance g,

.. math:: E\,P_k = dt\Big\{g_0 + \frac2n\sum_{h=1}^{n-1} g_h\Big[(n-h)\cos\frac{\pi k h}{n}
          - \frac{\sin(\pi k h/n)}{\sin(\pi k/n)}\Big]\Big\}

which for a random walk is K^2 dt^2/s_k^2 exactly, s_k = 2 sin(pi k/2n), and for flicker B^2 dt/s_k (1 - 2/(pi^2 k)) nearly.
Everything is linear in the squared coefficients, so bins of ordinates, and bins of several gap-free stretches, obey the same
relation exactly: density and columns are averaged alike.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import scipy.fft

from .._errors import DataError
from .._precision import is_traced
from .._types import Any, AnyArray
from ..spectrum._average import log_groups

#: bins of every record, so that records of all lengths share one compilation
BINS = 384
#: what a low-pass takes from white noise well below its corner: exactly -1 times Q, so that never both are in a solution
FILTER = "filter"
_EXACT = 1 << 16  # records up to this length have the flicker column from its sum, longer ones by its scaling
_SCALED = 4096
_SHORTEST = 16  # gap-free samples that a stretch needs to take part


class Bins(eqx.Module):
    """Ordinates averaged in bins of frequency.

    Attributes
    ----------
    density : (bins,) mean ordinate, the unit of B squared per Hz, divided by `unit`.
    weight : (bins,) number of ordinates, their degrees of freedom; 0 for padding.
    columns : (bins, p) expected mean ordinate per squared coefficient.
    frequency : (bins,) mean frequency in Hz.
    unit : what `density` was divided by.
    """

    density: AnyArray
    weight: AnyArray
    columns: AnyArray
    frequency: AnyArray
    unit: Any


@functools.lru_cache(maxsize=8)
def _flicker_ratio(n: int) -> np.ndarray:
    """E P_k s_k / (B^2 dt), k = 1 .. n-1, from the sum over lags."""
    h = np.arange(n, dtype=float)
    g = np.concatenate([[0.0], -(2.0 / np.pi) * np.cumsum(1.0 / (2.0 * h[1:] - 1.0))])
    cosine = np.fft.rfft(g * (n - h), 2 * n)[1:n].real
    sine = -np.fft.rfft(g, 2 * n)[1:n].imag
    a = np.pi * h[1:] / n
    return 2.0 / n * (cosine - sine / np.sin(a)) * 2.0 * np.sin(a / 2.0)


def expected(term: str, k, n: int, dt: float, scale: float | None = None) -> np.ndarray:
    """E P_k per squared coefficient at the ordinates k of n samples; `scale` is the correlation time of a Gauss-Markov process."""
    a = np.pi * np.asarray(k) / n
    s = 2.0 * np.sin(a / 2.0)
    if term == "N":
        return np.ones(len(a))
    if term in ("Q", FILTER):
        return (s**2 + 4.0 / n * np.cos(a / 2.0) ** 2) / (dt if term == "Q" else -dt)
    if term == "K":
        return (dt / s) ** 2
    if term == "B":
        table = _flicker_ratio(min(n, _EXACT))
        ratio = 1.0 - 2.0 / (np.pi**2 * np.asarray(k, dtype=float))
        known = np.asarray(k) <= (len(table) if n <= _EXACT else _SCALED)
        ratio[known] = table[np.asarray(k)[known] - 1]
        return dt / s * ratio
    if term == "markov" and scale is not None:
        # the sum over lags of a geometric series: z^h with z = e^{-dt/Tc + i pi k/n}
        z = np.exp(-dt / scale + 1j * a)
        last = np.exp(-n * dt / scale) * (1.0 - 2.0 * (np.asarray(k) % 2))  # z^n
        cosine = (z * ((n - 1.0) - n * z + last) / (1.0 - z) ** 2).real
        sine = ((z - last) / (1.0 - z)).imag
        return scale / 2.0 * dt * (1.0 + 2.0 / n * (cosine - sine / np.sin(a)))
    raise ValueError(f"unknown term {term!r}")


@functools.lru_cache(maxsize=256)
def _layout(n: int, dt: float, terms: tuple[tuple[str, float | None], ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First ordinate, count, columns (bins, p) and mean frequency of the bins of a gap-free stretch of n samples."""
    starts, count = log_groups(n - 1, keep_tail=True)
    count = count.astype(float)
    columns = np.stack([np.add.reduceat(expected(term, np.arange(1, n), n, dt, scale), starts) / count for term, scale in terms], axis=1)
    frequency = np.add.reduceat(np.arange(1.0, n), starts) / count / (2.0 * n * dt)
    for array in (starts, count, columns, frequency):
        array.flags.writeable = False
    return starts, count, columns, frequency


def stretches(y) -> list[slice]:
    """The gap-free stretches of a record that are long enough to take part, longest first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], np.isnan(y), [True]]).astype(np.int8)))
    found = [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST]
    return sorted(found, key=lambda part: part.start - part.stop)


def bins_of(y, dt: float, terms: tuple[tuple[str, float | None], ...]) -> Bins:
    """Bins of a record: of its one stretch, or of all gap-free stretches, each with a basis of its own.

    Parameters
    ----------
    y : (n,) samples; NaN marks a gap (not where y is traced).
    dt : sampling interval in s.
    terms : (name, correlation time) of each column, the time only for "markov".

    Raises
    ------
    DataError
        If no stretch of 16 samples is free of gaps.
    """
    if is_traced(y):
        n = y.shape[0]
        starts, count, columns, frequency = _layout(n, dt, terms)
        y = eqx.error_if(y, jnp.any(jnp.isnan(y)), "a traced record must not have gaps; cut it into gap-free stretches before tracing")
        ordinates = dt * jax.scipy.fft.dct(y - jnp.mean(y), norm="ortho")[1:] ** 2
        group = np.repeat(np.arange(len(starts)), count.astype(int))
        density = jax.ops.segment_sum(ordinates, group, len(starts), indices_are_sorted=True) / count.astype(y.dtype)
        return _padded(density, count, columns, frequency, jnp)
    parts = []
    for part in stretches(y):
        x = y[part]
        starts, count, columns, frequency = _layout(len(x), dt, terms)
        ordinates = dt * np.asarray(scipy.fft.dct(x - np.mean(x), norm="ortho", overwrite_x=True))[1:] ** 2
        parts.append((np.add.reduceat(ordinates, starts) / count, count, columns, frequency))
    if not parts:
        raise DataError(
            f"no stretch of {_SHORTEST} samples is free of gaps ({int(np.isnan(y).sum())} of {len(y)} samples are missing): a spectrum "
            "needs one; use a method of the Allan variance, such as gls, or mend the recording"
        )
    if len(parts) > 1:
        parts = [_merged(parts)]
    return _padded(*parts[0], np)


def _merged(parts):
    """Bins of several stretches on the grid of the first: averages weighted by the number of ordinates."""
    grid = parts[0][3]
    edges = np.sqrt(grid[1:] * grid[:-1])
    where = np.searchsorted(edges, np.concatenate([part[3] for part in parts]))
    count = np.bincount(where, np.concatenate([part[1] for part in parts]), len(grid))

    def mean(which):
        values = np.concatenate([part[which].T * part[1] for part in parts], axis=-1)
        return np.apply_along_axis(lambda row: np.bincount(where, row, len(grid)), -1, values).T / (count if which != 2 else count[:, None])

    return mean(0), count, mean(2), mean(3)


def _padded(density, count, columns, frequency, xp) -> Bins:
    pad = BINS - len(count)
    unit = xp.exp(xp.sum(count * xp.log(density)) / np.sum(count)) if xp is np else jax.lax.stop_gradient(jnp.mean(density))
    dtype = density.dtype
    return Bins(
        density=xp.pad(density / unit, (0, pad), constant_values=1.0),
        weight=np.pad(count, (0, pad)).astype(dtype),
        columns=np.pad(columns, ((0, pad), (0, 0)), constant_values=1.0).astype(dtype),
        frequency=np.pad(frequency, (0, pad), constant_values=np.inf).astype(dtype),
        unit=unit,
    )
