"""`coverage`: how evenly readings fill the sphere, by MotionCal's regions (with its southern index corrected) and by gaps."""

import functools
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from ..._errors import DataError
from ..._frozen import made
from ..._precision import host_float64
from ..._types import AnyArray

_POLE, _RING = 1.37046, 0.74776  # latitudes that bound the 100 regions of equal area
_HIGH, _LOW = 1.05911, 0.37388  # latitudes of the regions' centres
_GRID = 500  # points of the lattice, 9 degrees apart
_GAPS = np.array([1.0, 0.2, 0.01, 0.0])  # weight of a region with 0, 1, 2, or more readings
_MANY = 2000  # number of readings above which a tree finds neighbours faster than all products
_BLOCK = 128  # rows that stay in the cache


class Coverage(eqx.Module):
    """How well readings fill the sphere of directions.

    Attributes
    ----------
    counts : (100,) readings per region of equal area: pole, 15 sectors, 34, 34, 15, pole.
    gaps : weight of the empty regions in per cent: an empty region counts 1, one with a single reading 0.2, one with two 0.01.
    occupied : share of 500 equal bins that contain a reading.
    largest_gap : half-angle of the largest cap without a reading, rad.
    missing : (k, 3) unit vectors to the centres of the regions without a reading.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, coverage, scenario
    >>> found = coverage(body_field(scenario("three_turns")))
    >>> f"{100 * found.occupied:.0f} % of the directions", found.gaps > 50
    ('13 % of the directions', True)
    """

    counts: AnyArray
    gaps: float
    occupied: float
    largest_gap: float
    missing: AnyArray


@functools.cache
def sphere_grid(count: int = _GRID) -> np.ndarray:
    """Points of a Fibonacci lattice, (count, 3); each represents nearly the same area."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + np.sqrt(5)) * k
    grid = np.stack([np.sqrt(1 - z**2) * np.cos(angle), np.sqrt(1 - z**2) * np.sin(angle), z], axis=1)
    grid.flags.writeable = False
    return grid


def _cosines(directions: np.ndarray) -> np.ndarray:
    """Products of unit vectors with the grid points, by blocks: BLAS would start threads, which wait while other work keeps a core busy."""
    found = np.empty((len(directions), _GRID))
    for i in range(0, len(found), _BLOCK):
        np.matmul(directions[i : i + _BLOCK], sphere_grid().T, out=found[i : i + _BLOCK])
    return found


def bins(directions: np.ndarray) -> np.ndarray:
    """Index of the nearest of the 500 grid points for each unit vector."""
    if len(directions) <= _MANY:
        return _cosines(directions).argmax(axis=1)
    return np.asarray(_tree().query(directions)[1])


@functools.cache
def _tree() -> Any:
    return scipy.spatial.KDTree(sphere_grid())


def regions(directions: np.ndarray) -> np.ndarray:
    """Region of each direction, 0 to 99."""
    x, y, z = directions.T
    latitude, longitude = np.pi / 2 - np.arctan2(np.hypot(x, y), z), np.arctan2(y, x) + np.pi
    few, many = (np.minimum(n - 1, np.floor(longitude * n / (2 * np.pi)).astype(int)) for n in (15, 34))
    ring = np.where(latitude >= 0, 16 + many, 50 + many)
    ring = np.where(latitude > _RING, 1 + few, np.where(latitude < -_RING, 84 + few, ring))
    return np.where(latitude > _POLE, 0, np.where(latitude < -_POLE, 99, ring))


@functools.cache
def middles() -> np.ndarray:
    """Unit vectors to the centres of the regions, (100, 3)."""

    def zone(n, latitude):
        longitude = (np.arange(n) + 0.5) * 2 * np.pi / n
        return np.stack([-np.cos(longitude) * np.cos(latitude), -np.sin(longitude) * np.cos(latitude), np.full(n, np.sin(latitude))], 1)

    pole = np.array([[0.0, 0.0, 1.0]])
    found = np.concatenate([pole, zone(15, _HIGH), zone(34, _LOW), zone(34, -_LOW), zone(15, -_HIGH), -pole])
    found.flags.writeable = False
    return found


@host_float64
def coverage(m: Any) -> Coverage:
    """How evenly corrected readings fill the sphere.

    Parameters
    ----------
    m : (n, 3) corrected readings in any unit; the hard iron must be subtracted already.

    Returns
    -------
    Coverage

    Raises
    ------
    DataError
        If a reading is zero or not finite, or there are no readings.

    Examples
    --------
    >>> import jaxcal
    >>> from jaxcal.magnetometer import body_field, scenario
    >>> full = jaxcal.magnetometer.coverage(body_field(scenario("all", samples=2000)))
    >>> turns = jaxcal.magnetometer.coverage(body_field(scenario("three_turns")))
    >>> full.gaps < 1, turns.gaps > 50
    (True, True)

    References
    ----------
    P. Stoffregen, MotionCal (quality.c), with corrected positions of the southern sectors.
    """
    return covered(m)


def covered(m: Any) -> Coverage:
    """`coverage` for NumPy arrays on the host."""
    m = np.asarray(m, dtype=float)
    if m.ndim != 2 or m.shape[-1] != 3 or not len(m):
        raise DataError(f"The corrected readings have shape {m.shape}; they must be (n, 3) with at least one row.")
    norm = np.linalg.norm(m, axis=1)
    if not (np.isfinite(norm) & (norm > 0)).all():
        raise DataError("A corrected reading is zero or not finite; leave it out.")
    directions = m / norm[:, None]
    region = regions(directions)
    counts = np.bincount(region, minlength=100)
    filled = counts > 0
    if len(m) <= _MANY:
        cosine = _cosines(directions)
        bin_of, square = cosine.argmax(axis=1), 2 - 2 * float(cosine.max(axis=0).min())
    else:
        bin_of, square = bins(directions), float(np.max(scipy.spatial.KDTree(directions).query(sphere_grid())[0])) ** 2
    return made(
        Coverage,
        counts=counts,
        gaps=float(np.sum(_GAPS[np.minimum(counts, 3)])),
        occupied=int(np.count_nonzero(np.bincount(bin_of))) / _GRID,
        largest_gap=2 * float(np.arcsin(min(np.sqrt(max(square, 0.0)) / 2, 1.0))),
        missing=middles()[~filled],
    )
