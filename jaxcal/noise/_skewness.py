r"""The test for an absent term on an Allan variance curve, corrected for the skewness of the curve.

The variances at long cluster times have few degrees of freedom, and with them the statistic that shows K a long tail: taken
for a normal variable it passes the 1 % threshold in 3 % of records without K. The statistic is linear in the variances,
z = w'(v - A theta), and these are quadratic in the record, so its cumulants follow from the density S of the fitted noise and the
frequency response h = sum_m w_m H_m of what it measures,

.. math:: \kappa_2 = 2 \sum_k (S_k h_k)^2, \qquad \kappa_3 = 8 \sum_k (S_k h_k)^3,
          \qquad H_m(f) = \frac{2 \sin^4 \pi f m dt}{m^2 \sin^2 \pi f dt}

over the frequencies k/(2T). That leaves out the ends of the record, where the exact covariance gives the larger variance
w'Cw: as if there were fewer independent parts, so that the skewness grows with the root of their ratio. A gamma law of this
skewness is carried over to the normal one by its cube root.

Sources: spectral kernel, D. W. Allan, Proc. IEEE 54, 1966; cumulants of quadratic forms, A. M. Mathai and S. B. Provost,
Quadratic Forms in Random Variables, 1992; cube root, E. B. Wilson and M. M. Hilferty, Proc. Nat. Acad. Sci. 17, 1931.
"""

import equinox as eqx
import jax
import numpy as np

from .._types import Any, AnyArray, Float
from ._curve import Curve, correlation, whiten
from ._lanes import inverse, namespace
from ._terms import Term

_SINGLE = 64  # lowest frequencies kept apart
_PER_DECADE = 40
_LARGEST = 3.0  # beyond, the statistic is that of less than one degree of freedom


class Response(eqx.Module):
    """Bins of frequency: what every cluster size and every term has there.

    number : (bins,) frequencies in a bin. kernel : (clusters, bins). columns : (bins, p) density per squared coefficient.
    """

    number: Float[AnyArray, " bins"]
    kernel: Float[AnyArray, "clusters bins"]
    columns: Float[AnyArray, "bins p"]


def response(samples: int, m, dt: float, terms: tuple[Term, ...]) -> Response:
    """Kernels and densities for a record of `samples`."""
    per_decade = np.arange(np.log10(_SINGLE), np.log10(samples), 1.0 / _PER_DECADE)
    edges = np.unique(np.concatenate([np.arange(1, min(_SINGLE, samples)), np.round(10.0**per_decade), [samples]]))
    number, middle = np.diff(edges), (edges[:-1] + edges[1:] - 1) / 2.0
    half = np.pi * middle / (2.0 * samples)
    angle, width = half * m[:, None], np.maximum(number - 1, 0) / (2.0 * samples) * m[:, None]
    # sin^4 averaged over the bin, which spans many of its periods at high frequency
    fourth = 0.375 - np.cos(2.0 * angle) / 2.0 * np.sinc(width) + np.cos(4.0 * angle) / 8.0 * np.sinc(2.0 * width)
    kernel = 2.0 * fourth / (m[:, None] * np.sin(half)) ** 2 / (samples * dt)  # a sum over frequencies is the variance then
    frequency = middle / (2.0 * samples * dt)
    with jax.ensure_compile_time_eval():  # they do not depend on the record
        columns = [np.asarray(term.psd(frequency, dt)) for term in terms]
    return Response(number, kernel, np.stack(columns, axis=1))


def skewness(curve: Curve, used, heard: Response, at, index: int) -> Any:
    """Skewness of the statistic that shows coefficient `index`, for the noise of coefficients `at`."""
    xp = namespace(curve, used, heard, at)
    matrix, scale = correlation(curve, used, at)
    rows = xp.where(used[:, None], curve.columns, 0.0) / scale[:, None]
    white = whiten(matrix, xp.concatenate([rows, xp.eye(len(used), dtype=rows.dtype)], axis=1))
    rows, back = white[:, : rows.shape[1]], white[:, rows.shape[1] :]
    here = np.arange(rows.shape[1]) == index
    others = xp.where((at != 0.0) & ~here, rows, 0.0)
    mine = rows[:, index]
    along = mine - others @ (inverse(others.T @ others) @ (others.T @ mine))
    weight = xp.where(used, back.T @ along / scale, 0.0)
    part = (heard.columns @ curve.noise(at)) * (weight @ heard.kernel)
    second = xp.maximum(2.0 * heard.number @ part**2, np.finfo(rows.dtype).tiny)
    part = part / xp.sqrt(second)
    return 8.0 * (heard.number @ part**3) * xp.sqrt(along @ along / second)


def as_normal(rise, skew):
    """The rise that a statistic without skewness would have at the same chance."""
    xp = namespace(rise, skew)
    z = xp.sqrt(xp.maximum(rise, 0.0))
    skew = xp.clip(skew, 0.0, _LARGEST)
    small = skew < 1e-3
    g = xp.where(small, 1.0, skew)
    root = (6.0 / g) * (xp.cbrt(1.0 + g * z / 2.0) - 1.0 + g**2 / 36.0)
    return xp.where(small, z, xp.maximum(root, 0.0)) ** 2
