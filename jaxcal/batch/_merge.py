"""`reduce`: partial results of one record put together."""

from collections.abc import Iterable
from typing import Any, TypeVar

from .._errors import DataError

T = TypeVar("T", bound=Any)


def reduce(parts: Iterable[T]) -> T:
    """Merge partial results of neighbouring stretches of one record, in a tree.

    Each part is merged with its neighbour, then each pair with the next: of n parts none goes through more than log2(n) merges, so that
    rounding errors do not grow with n, and merges of different pairs could run side by side.

    Parameters
    ----------
    parts : partial results in the order of the record, each with a method `merge(other)`: `jaxcal.allan.Accumulator`,
        `jaxcal.spectrum.Segments`, `jaxcal.magnetometer.Moments`.

    Returns
    -------
    As if one of them had been given the whole record.

    Raises
    ------
    DataError
        If there are no parts, or they do not join.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).standard_normal(1000)
    >>> parts = [jaxcal.allan.Accumulator(100.0, [1, 10]).update(each) for each in np.array_split(y, 5)]
    >>> jaxcal.batch.reduce(parts).samples
    1000
    """
    level = list(parts)
    if not level:
        raise DataError("there are no parts to merge")
    if missing := [type(part).__name__ for part in level if not hasattr(part, "merge")]:
        raise DataError(
            f"{missing[0]} cannot be merged; give parts such as jaxcal.allan.Accumulator, spectrum.Segments or magnetometer.Moments"
        )
    while len(level) > 1:
        pairs = [level[i].merge(level[i + 1]) for i in range(0, len(level) - 1, 2)]
        level = pairs + level[2 * len(pairs) :]
    return level[0]
