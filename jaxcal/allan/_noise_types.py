"""Noise types at very many cluster sizes: identified at some, held between them."""

import numpy as np

from ._identify import identify
from ._kinds import Kind

_MOST = 512  # cluster sizes identified; neighbours then differ by 3 % in a record of 10^7 samples


def noise_types(theta, marks, sizes, kind: Kind, samples: int, data: str) -> np.ndarray:
    """Noise types at ascending cluster sizes, (clusters,), as `identify` finds them.

    Of more than 512 cluster sizes 512, spaced evenly in their logarithm, are identified; each of the others has the type of the
    next smaller one identified.

    Parameters
    ----------
    theta : (points,) phase in samples.
    marks : what `identify` takes as missing.
    sizes : ascending cluster sizes.
    kind, samples, data : as for `identify`.
    """
    if len(sizes) <= _MOST:
        return identify(theta, marks, sizes, kind, samples, data)
    # rounding up keeps the first; small sizes are few per decade, so fewer than 512 remain
    chosen = np.unique(np.searchsorted(sizes, np.geomspace(sizes[0], sizes[-1], _MOST)).clip(max=len(sizes) - 1))
    found = identify(theta, marks, sizes[chosen], kind, samples, data)
    return found[np.searchsorted(chosen, np.arange(len(sizes)), side="right") - 1]
