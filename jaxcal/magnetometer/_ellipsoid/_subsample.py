"""Long logs: as many readings as there are directions to tell apart, from all directions alike."""

import jax
import jax.numpy as jnp
import numpy as np

from ...fitting import AbstractLoss
from .._design._coverage import bins
from ._algebraic import NotEllipsoid
from ._orthogonal import Found
from ._residuals import Readings, orthogonal
from ._shape import root
from ._start import basis_of, robust_start, start

#: logs that are fitted whole
LONG = 20_000
_FIRST = 4000
_CHUNK = 16_384


def thinned(u: np.ndarray, per_bin: int, loss: AbstractLoss | None) -> np.ndarray:
    """Indices of at most so many readings in each of 500 directions, evenly over their times.

    The directions are those of a rough fit of every so manieth reading, along whatever quadric there is.
    """
    few = u[:: max(len(u) // _FIRST, 1)]
    try:
        shape, centre = (start if loss is None else robust_start)(few, "symmetric")
    except NotEllipsoid:
        shape, centre = np.eye(3), few.mean(axis=0)
    z = (u - centre) @ root(shape)
    cell = bins(z / np.maximum(np.linalg.norm(z, axis=1, keepdims=True), 1e-300))
    order = np.argsort(cell, kind="stable")
    count = np.bincount(cell, minlength=500)
    first = np.repeat(np.cumsum(count) - count, count)
    place, size = np.arange(len(u)) - first, count[cell[order]]
    # of a bin of n every n/k-th: where floor(i k/n) moves on
    kept = (size <= per_bin) | (place * per_bin // size != (place - 1) * per_bin // size)
    return np.sort(order[kept])


_distance = jax.jit(orthogonal)


def all_distances(found: Found, u: np.ndarray) -> np.ndarray:
    """Distance of every reading to an ellipsoid that some of them gave, in chunks of one size: nothing to compile per length."""
    basis, parts = jnp.asarray(basis_of(found.kind)), []
    for begin in range(0, len(u), _CHUNK):
        part = u[begin : begin + _CHUNK]
        full = np.concatenate([part, np.repeat(part[:1], _CHUNK - len(part), axis=0)])
        data = Readings(jnp.asarray(full), jnp.ones(_CHUNK), jnp.asarray(1.0), jnp.asarray(found.noise2), basis)
        parts.append(np.asarray(_distance(jnp.asarray(found.parameters), data))[: len(part)])
    return np.concatenate(parts)
