"""Least squares with a chain of nuisance unknowns beside the parameters: an arrow of blocks, solved in linear time (host, NumPy)."""

import dataclasses

import numpy as np
import scipy  # loads its parts when they are first used

from .._arrays import summed_product


@dataclasses.dataclass
class Chain:
    """Normal equations of K links of n unknowns each, which meet only their neighbours, and of p parameters, which all of them meet.

    Attributes
    ----------
    links : (K, n, n) J'J of each link.
    ties : (K - 1, n, n) J'J between each link (rows) and the next (columns).
    border : (K, n, p) J'J between each link and the parameters.
    corner : (p, p) J'J of the parameters.
    link_score : (K, n) J'r of each link.
    score : (p,) J'r of the parameters.

    Examples
    --------
    A mean (the parameter) of readings with a random walk (the links):

    >>> import numpy as np
    >>> from jaxcal.fitting import Chain
    >>> one = np.ones((50, 1, 1))
    >>> links = one + 2.0
    >>> links[[0, -1]] -= 1.0
    >>> readings = np.ones((50, 1))
    >>> chain = Chain(links, -one[1:], one, np.array([[50.0 + 1e-6]]), -readings, -readings.sum(axis=0))
    >>> found = chain.eliminated(1e-6)
    >>> step = -np.linalg.solve(found.information, found.score)
    >>> found.links(step).shape
    (50, 1)
    """

    links: np.ndarray
    ties: np.ndarray
    border: np.ndarray
    corner: np.ndarray
    link_score: np.ndarray
    score: np.ndarray

    def eliminated(self, damping: np.ndarray | float = 0.0) -> "Eliminated":
        """The equations of the parameters alone; `damping` (n,) is added to the diagonal of every link."""
        count, size, width = self.border.shape
        banded = _banded(self.links + np.diag(np.broadcast_to(damping, size)), self.ties)
        factor = scipy.linalg.cholesky_banded(banded, lower=True, overwrite_ab=True, check_finite=False)
        sides = np.concatenate([self.border, self.link_score[..., None]], axis=2).reshape(count * size, width + 1)
        solved = scipy.linalg.cho_solve_banded((factor, True), sides, check_finite=False).reshape(count, size, width + 1)
        inner = summed_product(self.border, solved)
        return Eliminated(self.corner - inner[:, :-1], self.score - inner[:, -1], solved[..., :-1], solved[..., -1],
                          2.0 * float(np.log(factor[0]).sum()))  # fmt: skip

    def steps(self, link_scores: np.ndarray, scores: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Steps (K, n, m) of the links and (p, m) of the parameters for m other scores, (K, n, m) and (p, m)."""
        count, size, width = self.border.shape
        sides = np.concatenate([self.border, link_scores], axis=2).reshape(count * size, -1)
        solved = scipy.linalg.solveh_banded(_banded(self.links, self.ties), sides, lower=True, overwrite_ab=True, check_finite=False)
        solved = solved.reshape(count, size, -1)
        inner = summed_product(self.border, solved)
        step = -np.linalg.solve(self.corner - inner[:, :width], scores - inner[:, width:])
        return -solved[..., width:] - solved[..., :width] @ step, step

    def variances(self, covariance: np.ndarray, carried: np.ndarray) -> np.ndarray:
        """(K, n, n) covariances of the links, from that of the parameters and `Eliminated.carried`."""
        count = len(self.links)
        pivots, gains = np.empty_like(self.links), np.empty_like(self.ties)
        pivots[0] = self.links[0]
        for k in range(count - 1):
            gains[k] = np.linalg.solve(pivots[k], self.ties[k])
            pivots[k + 1] = self.links[k + 1] - self.ties[k].T @ gains[k]
        inverse = np.linalg.inv(pivots)
        for k in range(count - 2, -1, -1):
            inverse[k] += gains[k] @ inverse[k + 1] @ gains[k].T
        return inverse + np.einsum("kna,ab,kmb->knm", carried, covariance, carried, optimize=True)


@dataclasses.dataclass
class Eliminated:
    """Equations of the parameters with the chain eliminated.

    Attributes
    ----------
    information : (p, p) of the parameters, the Schur complement: its inverse is their covariance.
    score : (p,) gradient of half the sum of squares, with the chain at its best.
    carried : (K, n, p) by how much each link falls when a parameter rises.
    fall : (K, n) by how much each link falls while the parameters stay.
    log_determinant : of the chain alone; that of all is larger by that of `information`.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting import Chain
    >>> one = np.ones((3, 1, 1))
    >>> found = Chain(2 * one, -0.5 * one[1:], 0.5 * one, 9 * one[0], one[:, 0], np.ones(1)).eliminated()
    >>> found.information.shape, found.carried.shape
    ((1, 1), (3, 1, 1))
    """

    information: np.ndarray
    score: np.ndarray
    carried: np.ndarray
    fall: np.ndarray
    log_determinant: float = 0.0

    def links(self, step: np.ndarray) -> np.ndarray:
        """(K, n) steps of the links that belong to a step of the parameters."""
        return -self.fall - self.carried @ step


def _banded(links: np.ndarray, ties: np.ndarray) -> np.ndarray:
    """Lower bands (2n, K n) of the matrix with these blocks on and beside its diagonal."""
    count, size, _ = links.shape
    bands = np.zeros((2 * size, count, size))
    for column in range(size):
        bands[: size - column, :, column] = links[:, column:, column].T
        bands[size - column : 2 * size - column, :-1, column] = ties[:, column, :].T
    return bands.reshape(2 * size, count * size)
