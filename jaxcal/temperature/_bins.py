"""Means in bins of temperature."""

from typing import Any

import equinox as eqx
import jax
import jax.core
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray

FINE, COARSE, BLOCK = 0.1, 0.25, 0.5  # degC: bins of curves and choices, bins of tables, blocks of cross-validation


class Bins(eqx.Module):
    """Means in bins of temperature.

    Attributes
    ----------
    t, b, count : mean temperature, degC, mean bias and number of samples, all (bins,), in order of temperature.
    error : standard deviation of one sample, where it is known.
    """

    t: AnyArray
    b: AnyArray
    count: AnyArray
    error: Any = 1.0

    def part(self, keep: AnyArray) -> "Bins":
        """Some of the bins."""
        return Bins(self.t[keep], self.b[keep], self.count[keep])


def binned(t: AnyArray, b: AnyArray, width: float = FINE, low: Any = None) -> Bins:
    """Means of temperature and bias in bins of `width` degC from `low` (default: the lowest temperature); empty bins are left out.

    Where the temperatures are traced there are as many bins as samples; the last ones are copies of the last that holds any, and count 0.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.temperature import binned
    >>> print(binned(np.array([20.0, 20.04, 20.3]), np.array([1.0, 3.0, 5.0])).b)
    [2. 5.]
    """
    place = number(t, width, t.min() if low is None else low)
    if not isinstance(place, jax.core.Tracer) and not isinstance(b, jax.core.Tracer):
        count = np.bincount(place)
        there = count > 0
        return Bins(np.bincount(place, t)[there] / count[there], np.bincount(place, b)[there] / count[there], count[there].astype(float))
    known = not isinstance(place, jax.core.Tracer)
    label = np.unique(place, return_inverse=True)[1] if known else jnp.unique(place, return_inverse=True, size=t.size)[1]
    size = label.max() + 1 if known else t.size
    total = lambda values: jax.ops.segment_sum(jnp.asarray(values), label, num_segments=int(size))  # noqa: E731
    count = total(jnp.ones_like(b))
    mean = lambda values: total(values) / jnp.maximum(count, 1)  # noqa: E731
    last = jnp.minimum(jnp.arange(count.size), jnp.sum(count > 0) - 1)
    return Bins(mean(t)[last], mean(b)[last], count)


def number(t: AnyArray, width: float, low: Any) -> AnyArray:
    """Number of the bin of each temperature."""
    # a temperature on an edge belongs above it, whatever its last digit
    xp = jnp if isinstance(t, jax.core.Tracer) else np
    return xp.maximum(xp.floor((t - low) / width + 1e-9), 0).astype(int)
