"""Means in bins of temperature."""

import equinox as eqx
import numpy as np

from .._types import AnyArray

FINE, COARSE, BLOCK = 0.1, 0.25, 0.5  # degC: bins of curves and choices, bins of tables, blocks of cross-validation


class Bins(eqx.Module):
    """Means in bins: `t` (degC), `b`, `count`, all (bins,), in order of temperature."""

    t: AnyArray
    b: AnyArray
    count: AnyArray

    def part(self, keep: AnyArray) -> "Bins":
        """Some of the bins."""
        return Bins(self.t[keep], self.b[keep], self.count[keep])


def binned(t: AnyArray, b: AnyArray, width: float = FINE, low: float | None = None) -> Bins:
    """Means of temperature and bias in bins of `width` degC from `low` (default: the lowest temperature); empty bins are left out."""
    place = number(t, width, float(t.min()) if low is None else low)
    count = np.bincount(place)
    there = count > 0
    return Bins(np.bincount(place, t)[there] / count[there], np.bincount(place, b)[there] / count[there], count[there].astype(float))


def number(t: AnyArray, width: float, low: float) -> AnyArray:
    """Number of the bin of each temperature."""
    # a temperature on an edge belongs above it, whatever its last digit
    return np.maximum(np.floor((t - low) / width + 1e-9), 0).astype(np.int64)
