"""A first-order Gauss-Markov process beside the other terms: its correlation time by a scan of the likelihood."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from .._types import AnyArray
from ._likelihood import minimise
from ._ordinates import Bins
from ._spectral import Fitted
from ._terms import GaussMarkov

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

    columns = jax.vmap(lambda correlation: GaussMarkov(time=correlation).psd(frequency, dt), out_axes=1)(time)
    theta = jnp.asarray(fitted.theta)
    level = jnp.median(jnp.sum(bins.columns * (flicker * theta)[None, :], axis=1)[:, None] / columns, axis=0)
    beside, instead = jnp.append(jnp.ones_like(flicker), 1.0), jnp.append(1.0 - flicker, 1.0)

    def one(problem):
        column, keep, strength = problem
        more = jnp.concatenate([bins.columns, column[:, None]], axis=1) * keep[None, :]
        start = jnp.append(theta, strength) * keep
        found = minimise(Bins(bins.density, bins.weight, more, bins.frequency, bins.unit), start)
        return 2.0 * (fitted.nll - found.nll)

    # both questions in one loop, which halves the program to compile
    count = time.shape[0]
    kept = jnp.concatenate([jnp.tile(beside[None, :], (count, 1)), jnp.tile(instead[None, :], (count, 1))])
    gains = jax.lax.map(one, (jnp.concatenate([columns.T, columns.T]), kept, jnp.concatenate([jnp.zeros_like(level), level])))
    return Scan(time, gains[:count], gains[count:])
