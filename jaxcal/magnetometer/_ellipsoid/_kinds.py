"""The kinds of ellipsoid {b + S h : |h| = 1} with a symmetric S, the soft iron times the field; entries of symmetric matrices."""

import functools
from typing import Any

import numpy as np

from ..._precision import array_module

#: place of each entry of a symmetric matrix among its six upper ones, the their rows and columns, and the matrix (9, 6) from them to all
PLACE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
UPPER = np.triu_indices(len(PLACE))
SYMMETRIC = np.equal.outer(PLACE.ravel(), np.unique(PLACE)).astype(float)
#: number of parameters of each kind
COUNT = {"sphere": 4, "diagonal": 6, "symmetric": 9}


@functools.cache
def basis_of(kind: str) -> np.ndarray:
    """Matrix (12, 9) from the parameters of a kind, padded with zeros, to the entries of S and the centre."""
    diagonal, free = SYMMETRIC[:, np.diag(PLACE)], COUNT[kind] - 3
    basis = np.zeros((12, 9))
    basis[:9, :free] = {"sphere": diagonal.sum(axis=1, keepdims=True), "diagonal": diagonal, "symmetric": SYMMETRIC}[kind]
    basis[9:, free : free + 3] = np.eye(3)
    basis.flags.writeable = False
    return basis


def soft_and_centre(parameters: Any, basis: Any) -> tuple[Any, Any]:
    """S and the centre."""
    full = basis @ parameters
    return full[:9].reshape(3, 3), full[9:]


def parameters_of(kind: str, soft: Any, centre: Any) -> Any:
    """Parameters of the given kind nearest to S and a centre, padded with zeros."""
    xp = array_module(soft)
    return xp.asarray(np.linalg.pinv(basis_of(kind)), dtype=soft.dtype) @ xp.concatenate([soft.ravel(), centre])
