"""`Estimate`: parameters by name, with their covariance. What a fit knows, in one object that no code cuts by position."""

import fnmatch
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Number
from .._errors import DataError
from .._special import student_quantile
from .._types import AnyArray, Samples


class NamedMatrix(eqx.Module):
    """A matrix whose rows and columns have names.

    Attributes
    ----------
    names : of the rows and columns.
    array : (p, p) the numbers.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting import Estimate
    >>> found = Estimate(("N", "K"), np.array([1.0, 2.0]), np.array([[4.0, 1.0], [1.0, 9.0]]))
    >>> float(found.covariance["N", "K"]), found.covariance[["K"]].array.tolist()
    (1.0, [[9.0]])
    """

    names: tuple[str, ...] = eqx.field(static=True)
    array: AnyArray

    def __getitem__(self, key: Any) -> Any:
        """An entry for two names; the block of a list of names."""
        if isinstance(key, tuple):
            row, column = (_place(self.names, name) for name in key)
            return self.array[row, column]
        where = np.array([_place(self.names, name) for name in key], dtype=int)
        return NamedMatrix(tuple(key), self.array[np.ix_(where, where)])

    def __array__(self, dtype: Any = None, copy: Any = None) -> np.ndarray:
        return np.asarray(self.array, dtype=dtype)


class Estimate(eqx.Module):
    """Estimated parameters: values, covariance, degrees of freedom, state and unit of each, by name.

    Names are paths such as "gyro.matrix[0,1]" and "gyro.bias[2]".

    Parameters
    ----------
    names : of the p parameters.
    values : (p,) in SI; ignored for an open parameter.
    covariance : (p, p).
    freedom : degrees of freedom of the standard errors, one for all or (p,); infinite for normal intervals.
    states : name -> "held" (fixed by an option or convention) or "open" (the data do not determine it); others are estimated.
    quantities : name, or the part before its bracket -> name of the quantity in the table of units ("gyro", "accel", "mag", ...).

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.fitting import Estimate
    >>> names = ("gyro.bias[0]", "gyro.bias[1]", "lever")
    >>> known = {"states": {"lever": "held"}, "quantities": {"gyro.bias": "gyro"}}
    >>> found = Estimate(names, np.array([0.1, 0.2, 0.0]), np.diag([1e-4, 4e-4, 0.0]), **known)
    >>> found["gyro.bias[1]"].unit, round(found["gyro.bias[1]"].half, 3), found["lever"].state
    ('rad/s', 0.039, 'held')
    >>> found.select("gyro.*").names
    ('gyro.bias[0]', 'gyro.bias[1]')
    """

    names: tuple[str, ...] = eqx.field(static=True)
    values: AnyArray
    matrix: AnyArray
    freedom: AnyArray
    states: dict[str, str] = eqx.field(static=True)
    quantities: dict[str, str] = eqx.field(static=True)

    def __init__(
        self, names: Iterable[str], values: AnyArray, covariance: AnyArray, freedom: Samples = np.inf,
        states: Mapping[str, str] | None = None, quantities: Mapping[str, str] | None = None,
    ):  # fmt: skip
        self.names, self.values, self.matrix = tuple(names), values, covariance
        self.freedom = np.broadcast_to(np.asarray(freedom, dtype=float), (len(self.names),))
        self.states, self.quantities = dict(states or {}), dict(quantities or {})
        if np.shape(values) != (len(self.names),) or np.shape(covariance) != 2 * (len(self.names),):
            raise DataError(f"{len(self.names)} names, values of shape {np.shape(values)}, covariance of shape {np.shape(covariance)}",
                            code="estimate_shapes")  # fmt: skip

    @property
    def covariance(self) -> NamedMatrix:
        """The covariance, by names: `covariance["N", "K"]`."""
        return NamedMatrix(self.names, self.matrix)

    @property
    def error(self) -> np.ndarray:
        """(p,) standard errors: 0 where held, infinite where open."""
        known = np.sqrt(np.maximum(np.diag(np.asarray(self.matrix)), 0.0))
        states = np.array([self.states.get(name, "estimated") for name in self.names])
        return np.where(states == "held", 0.0, np.where(states == "open", np.inf, known))

    def intervals(self, level: float = 0.95) -> np.ndarray:
        """(p, 2) limits of the intervals by Student's t."""
        half = np.ravel(student_quantile(self.freedom, 0.5 + level / 2)) * self.error
        with np.errstate(invalid="ignore"):
            return np.stack([np.asarray(self.values) - half, np.asarray(self.values) + half], axis=1)

    def __getitem__(self, name: str) -> Number:
        """The number of this name, with its 95 % interval."""
        return self.numbers()[_place(self.names, name)]

    def __contains__(self, name: str) -> bool:
        return name in self.names

    def numbers(self, prefix: str = "") -> list[Number]:
        """All numbers, in order, with their 95 % intervals; `prefix` is put before each name."""
        found = []
        for name, value, (low, high) in zip(self.names, np.asarray(self.values).tolist(), self.intervals().tolist(), strict=True):
            state: Any = self.states.get(name, "estimated")
            limits = (low, high) if state == "estimated" else (np.nan, np.nan)
            found.append(Number(prefix + name, np.nan if state == "open" else value, *limits, self.quantity(name), state))
        return found

    def quantity(self, name: str) -> str:
        """Quantity of a parameter: by its name, or by that of its field."""
        return self.quantities.get(name, self.quantities.get(name.partition("[")[0], "ratio"))

    def select(self, *patterns: str) -> "Estimate":
        """The parameters whose names match one of the patterns ("gyro.*"), in the order of the estimate."""
        literal = [pattern.replace("[", "[[]") for pattern in patterns]  # brackets belong to names
        kept = [i for i, name in enumerate(self.names) if any(fnmatch.fnmatchcase(name, pattern) for pattern in literal)]
        names = tuple(self.names[i] for i in kept)
        where = np.array(kept, dtype=int)
        states = {name: state for name, state in self.states.items() if name in names}
        return Estimate(names, self.values[where], self.matrix[np.ix_(where, where)], self.freedom[where], states, self.quantities)

    def renamed(self, new: Callable[[str], str]) -> "Estimate":
        """The same estimate under other names."""
        quantities = {name: self.quantity(name) for name in self.names}
        return Estimate(
            tuple(map(new, self.names)), self.values, self.matrix, self.freedom,
            {new(name): state for name, state in self.states.items()}, {new(name): one for name, one in quantities.items()},
        )  # fmt: skip

    def to_dict(self) -> dict[str, Any]:
        """Names, covariance and degrees of freedom for JSON; the values stand in `numbers` of the result."""
        return {"parameters": list(self.names), "covariance": np.asarray(self.matrix).tolist(), "freedom": self.freedom.tolist()}


def _place(names: Sequence[str], name: str) -> int:
    if name not in names:
        raise KeyError(f"no parameter {name!r}; the parameters are {', '.join(names)}")
    return names.index(name)
