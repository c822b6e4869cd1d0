"""A first-order Gauss-Markov process beside the other terms: its correlation time by a scan of the likelihood."""

import equinox as eqx
import numpy as np

from .._types import AnyArray
from ._likelihood import ROUGH, lower_of, minimise
from ._spectral import Fitted
from ._terms import GaussMarkov

_TRIED = 14
#: likelihood ratio by chance in 1 % of records without the process (14 correlation times are tried)
PRESENT = 9.0


class Scan(eqx.Module):
    """Correlation times in s; twice the gain in likelihood with the process beside the others, and with it in place of B."""

    time: AnyArray
    gain: AnyArray
    instead: AnyArray


def times(dt: float, duration: float) -> np.ndarray:
    """Correlation times to try: log-spaced from ten samples (0.1 s at 100 Hz) to a sixth of the record, 200 s at most."""
    return np.geomspace(10.0 * dt, max(min(duration / 6.0, 2e4 * dt), 20.0 * dt), _TRIED)


def scan(fitted: Fitted, time, dt: float, flicker) -> Scan:
    """Likelihood with the process at each correlation time (host only).

    Parameters
    ----------
    fitted : the fit without it.
    time : (times,) correlation times in s.
    dt : sampling interval in s.
    flicker : (p,) 1 for the column of B, else 0.
    """
    bins, theta, count = fitted.bins, fitted.theta, len(time)
    frequency = np.where(bins.weight > 0, bins.frequency, 0.25 / dt)
    process = np.stack([GaussMarkov(time=correlation).psd(frequency, dt) for correlation in time])
    level = np.median((bins.columns @ (flicker * theta))[None, :] / process, axis=1)
    # beside the other terms, then in place of B, which is left out
    kept = np.where(np.arange(2 * count)[:, None] < count, 1.0, 1.0 - flicker)
    columns = np.concatenate([bins.columns * kept[:, None, :], np.tile(process, (2, 1))[:, :, None]], axis=2)
    start = np.concatenate([theta * kept, np.append(np.zeros(count), level)[:, None]], axis=1)
    gain = 2.0 * (fitted.cost - minimise(columns, bins.density, bins.weight, start, lower=lower_of(columns), rtol=ROUGH).cost)
    return Scan(np.asarray(time), gain[:count], gain[count:])
