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
from ._terms import Term

#: bins of every record, so that records of all lengths share one compilation
BINS = 384
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


@functools.lru_cache(maxsize=256)
def _layout(n: int, dt: float, terms: tuple[Term, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """First ordinate, count, columns (bins, p) and mean frequency of the bins of a gap-free stretch of n samples."""
    starts, count = log_groups(n - 1, keep_tail=True)
    count = count.astype(float)
    with jax.ensure_compile_time_eval():  # they do not depend on the record
        expected = [np.asarray(term.ordinates(np.arange(1, n), n, dt)) for term in terms]
    columns = np.stack([np.add.reduceat(values, starts) / count for values in expected], axis=1)
    frequency = np.add.reduceat(np.arange(1.0, n), starts) / count / (2.0 * n * dt)
    for array in (starts, count, columns, frequency):
        array.flags.writeable = False
    return starts, count, columns, frequency


def stretches(y) -> list[slice]:
    """The gap-free stretches of a record that are long enough to take part, longest first."""
    edges = np.flatnonzero(np.diff(np.concatenate([[True], np.isnan(y), [True]]).astype(np.int8)))
    found = [slice(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True) if b - a >= _SHORTEST]
    return sorted(found, key=lambda part: part.start - part.stop)


def bins_of(y, dt: float, terms: tuple[Term, ...]) -> Bins:
    """Bins of a record: of its one stretch, or of all gap-free stretches, each with a basis of its own.

    Parameters
    ----------
    y : (n,) samples; NaN marks a gap (not where y is traced).
    dt : sampling interval in s.
    terms : the term of each column.

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
