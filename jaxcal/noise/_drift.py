r"""Whether a record follows a line in time, or its temperature: weighted least squares on the lowest ordinates.

With d_k and y_k the DCT-II of the regressor and of the record, times sqrt(dt), and S_k the fitted density without it,

.. math:: r = \frac{\sum d_k y_k/S_k}{\sum d_k^2/S_k},\qquad \mathrm{se}(r) = \Big(\sum d_k^2/S_k\Big)^{-1/2}
"""

import numpy as np
import scipy.fft

_ORDINATES = 48
_BLOCKS = 4096


def _averaged(x) -> tuple[np.ndarray, int]:
    """Means over blocks, which keep the lowest ordinates, and the length of a block."""
    size = max(len(x) // _BLOCKS, 1)
    return x[: len(x) // size * size].reshape(-1, size).mean(axis=1), size


def follows(y, regressor, density, dt: float) -> tuple[float, float]:
    """Coefficient of the regressor in the record and its standard error; (0, inf) for a regressor that does not move.

    Parameters
    ----------
    y, regressor : (n,) gap-free record, and what it may follow.
    density : (ordinates,) two-sided density of the noise at the first ordinates, at least 1.
    dt : sampling interval in s.
    """
    (y, size), (d, _) = _averaged(y), _averaged(regressor)
    count = min(_ORDINATES, len(density), len(y) - 1)
    rows = [np.sqrt(size * dt) * scipy.fft.dct(x - x.mean(), norm="ortho")[1 : count + 1] for x in (y, d)]
    information = float(np.sum(rows[1] ** 2 / density[:count]))
    if not information > 0.0:
        return 0.0, np.inf
    return float(np.sum(rows[0] * rows[1] / density[:count])) / information, information**-0.5
