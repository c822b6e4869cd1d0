"""A first-order Gauss-Markov process beside the other terms: its correlation time by a scan of the likelihood."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ._columns import spectral_column
from ._likelihood import minimise
from ._ordinates import Bins
from ._spectral import Fitted

_TRIED = 14
#: rises of the likelihood ratio by chance in 5 % and in 1 % of records without the process (14 correlation times are tried)
HINT, PRESENT = 6.0, 9.0


class Scan(eqx.Module):
    """Correlation times in s; twice the gain in likelihood with the process beside the others, and with it in place of B."""

    time: AnyArray
    gain: AnyArray
    instead: AnyArray


def times(dt: float, duration: float) -> np.ndarray:
    """Correlation times to try: log-spaced from ten samples (0.1 s at 100 Hz) to a sixth of the record, 200 s at most."""
    return np.geomspace(10.0 * dt, max(min(duration / 6.0, 2e4 * dt), 20.0 * dt), _TRIED)


@eqx.filter_jit
def scan(fitted: Fitted, time: AnyArray, dt: AnyArray, flicker: AnyArray) -> Scan:
    """Likelihood with the process at each correlation time.

    Parameters
    ----------
    fitted : the fit without it.
    time : (times,) correlation times in s.
    dt : sampling interval in s.
    flicker : (p,) 1 for the column of B, else 0.
    """
    bins = fitted.bins
    frequency = jnp.where(bins.weight > 0, bins.frequency, 0.25 / dt)

    def one(correlation):
        column = spectral_column("markov", frequency, dt, correlation)
        more = Bins(bins.density, bins.weight, jnp.concatenate([bins.columns, column[:, None]], axis=1), bins.frequency, bins.unit)
        start = jnp.append(fitted.theta, 0.0)
        beside = minimise(more, start)
        less = eqx.tree_at(lambda b: b.columns, more, more.columns * jnp.append(1.0 - flicker, 1.0)[None, :])
        level = jnp.sum(bins.columns * flicker[None, :] @ fitted.theta[:, None], axis=1) / column
        instead = minimise(less, jnp.append(fitted.theta * (1.0 - flicker), jnp.median(level)))
        return 2.0 * (fitted.nll - beside.nll), 2.0 * (fitted.nll - instead.nll)

    gain, instead = jax.lax.map(one, time)
    return Scan(time, gain, instead)
