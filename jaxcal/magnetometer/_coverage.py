"""`coverage`: how evenly readings fill the sphere, by MotionCal's regions (with its southern index corrected) and by the largest gap."""

import functools
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._errors import DataError
from .._frozen import made
from .._precision import host_float64, real_numbers
from .._types import AnyArray, Samples

ZONES = (1, 15, 34, 34, 15, 1)  # sectors of the zones of latitude, from the north pole on: 100 regions of equal area
_GRID = 500  # points of the lattice, 9 degrees apart


class Coverage(eqx.Module):
    """How well readings fill the sphere of directions.

    Attributes
    ----------
    counts : (100,) readings per region of equal area: pole, 15 sectors, 34, 34, 15, pole.
    occupied : share of 500 equal bins that contain a reading.
    largest_gap : half-angle of the largest cap without a reading, rad.
    missing : (k, 3) unit vectors to the centres of the regions without a reading.

    Examples
    --------
    >>> from jaxcal.magnetometer import body_field, coverage, scenario
    >>> found = coverage(body_field(scenario("three_turns")))
    >>> f"{100 * found.occupied:.0f} % of the directions", len(found.missing) > 50
    ('13 % of the directions', True)
    """

    counts: AnyArray
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


@functools.cache
def _tree() -> Any:
    return scipy.spatial.KDTree(sphere_grid())


def bins(directions: np.ndarray) -> np.ndarray:
    """Index of the nearest of the 500 grid points for each unit vector."""
    return np.asarray(_tree().query(directions)[1])


def _edges() -> np.ndarray:
    """Heights of the upper edges of the zones, on a sphere of radius one."""
    return 1 - 2 * np.cumsum([0, *ZONES[:-1]]) / sum(ZONES)


def regions(directions: np.ndarray) -> np.ndarray:
    """Region of each direction, 0 to 99."""
    x, y, z = directions.T
    zone = np.searchsorted(-_edges(), -z, side="right") - 1
    sectors = np.array(ZONES)[zone]
    sector = np.minimum(sectors - 1, ((np.arctan2(y, x) + np.pi) * sectors / (2 * np.pi)).astype(int))
    return np.cumsum([0, *ZONES[:-1]])[zone] + sector


@functools.cache
def middles() -> np.ndarray:
    """Unit vectors to the centres of the regions, (100, 3)."""
    latitude = np.arcsin(np.append(_edges(), -1.0))
    middle = np.repeat((latitude[1:] + latitude[:-1]) / 2, ZONES)
    middle[[0, -1]] = latitude[[0, -1]]
    longitude = np.concatenate([(np.arange(n) + 0.5) * 2 * np.pi / n for n in ZONES]) - np.pi
    found = np.stack([np.cos(longitude) * np.cos(middle), np.sin(longitude) * np.cos(middle), np.sin(middle)], axis=1)
    found.flags.writeable = False
    return found


@host_float64
def coverage(m: Samples) -> Coverage:
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
    >>> len(full.missing) < 1, len(turns.missing) > 50
    (True, True)

    References
    ----------
    P. Stoffregen, MotionCal (quality.c), with corrected positions of the southern sectors.
    """
    return covered(real_numbers(m, "m"))


def covered(m: np.ndarray) -> Coverage:
    """`coverage` for NumPy arrays on the host."""
    if m.ndim != 2 or m.shape[-1] != 3 or not len(m):
        raise DataError(f"The corrected readings have shape {m.shape}; they must be (n, 3) with at least one row.")
    norm = np.linalg.norm(m, axis=1)
    if not (np.isfinite(norm) & (norm > 0)).all():
        raise DataError("A corrected reading is zero or not finite; leave it out.")
    directions = m / norm[:, None]
    region = regions(directions)
    counts = np.bincount(region, minlength=100)
    filled = counts > 0
    largest = float(np.max(scipy.spatial.KDTree(directions).query(sphere_grid())[0]))
    return made(
        Coverage,
        counts=counts,
        occupied=int(np.count_nonzero(np.bincount(bins(directions)))) / _GRID,
        largest_gap=2 * float(np.arcsin(min(largest / 2, 1.0))),
        missing=middles()[~filled],
    )
