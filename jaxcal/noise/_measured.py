r"""Degrees of freedom of a measured Allan variance, from a spectrum.

The overlapped Allan variance of n samples is a weighted sum of the ordinates of the record, whose weights are those of the transfer
function, :math:`w_k = \sin^4(\pi f_k\tau)/(m\sin \pi f_k dt)^2`. Each ordinate is a chi-square of one degree of freedom, so that

.. math:: \nu = \frac{(\sum_k w_k S_k)^2}{\sum_k (w_k S_k)^2}

times the share (n - 2m + 1)/n of the record that the differences cover. S is any spectrum, that of the rival of a fit, so that an interval
of the deviation does not rest on the terms of the model.
"""

import functools

import numpy as np

from .._types import AnyArray
from ..spectrum._average import log_groups

_NARROW = 0.1  # width of a bin in radians of the weights below which its middle stands for it, exact to 1e-3


@functools.lru_cache(maxsize=16)
def _weights(n: int, sizes: tuple[int, ...]) -> tuple[AnyArray, AnyArray]:
    """Sums over the ordinates of each bin of w and of w^2, (clusters, bins)."""
    starts, count = log_groups(n - 1, keep_tail=True)
    edges = np.append(starts, starts[-1] + count[-1]) + 0.5
    middle = starts + 0.5 * (count + 1.0)
    x = np.pi * np.array(sizes)[:, None] * edges[None, :] / (2.0 * n)
    fourth = 3.0 * x / 8.0 - np.sin(2 * x) / 4.0 + np.sin(4 * x) / 32.0
    eighth = 35.0 * x / 128.0 - 7.0 * np.sin(2 * x) / 32.0 + 7.0 * np.sin(4 * x) / 128.0 - np.sin(6 * x) / 96.0 + np.sin(8 * x) / 1024.0
    lower = np.sin(np.pi * middle / (2.0 * n)) ** 2
    # the antiderivatives lose their digits where a bin is narrow beside the oscillation of the weights
    narrow, centre = np.diff(x, axis=1) < _NARROW, np.sin(0.5 * (x[:, 1:] + x[:, :-1]))
    mean4, mean8 = (np.where(narrow, centre**power, np.diff(one, axis=1) / np.diff(x, axis=1)) for one, power in ((fourth, 4), (eighth, 8)))
    return mean4 * count / lower, mean8 * count / lower**2


def edf_of(m: AnyArray, n: int, columns: AnyArray, level: AnyArray, theta: AnyArray, widened: AnyArray) -> AnyArray:
    """Degrees of freedom at cluster sizes of records of n samples whose densities in the bins are `level`: (channels, clusters).

    Each coefficient of a fit, `theta`, (channels, p), says by how much the variance of its share in a deviation is `widened`.
    """
    first, second = _weights(n, tuple(m.tolist()))
    edf = (level @ first.T) ** 2 / (level**2 @ second.T) * (n - 2.0 * m + 1.0) / n
    parts = np.abs(theta[:, None, :] * (first @ columns))
    return edf / np.maximum(np.vecdot(parts, widened[:, None, :]) / np.maximum(parts.sum(axis=-1), np.finfo(float).tiny), 1.0)
