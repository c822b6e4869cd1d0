"""Results that are curves, and curves of several channels as tables: a few of their values, one column for each channel."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, ClassVar, TypeVar

import numpy as np

from .._frozen import channel_of, replaced
from .._units import si_unit_of
from ._findings import Finding
from ._result import Result, Results
from ._sections import Curve, Grid, Number, Section

#: sensor, which the name of a channel begins with -> its name for readers
SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer", "clock": "clock"}
_SHOWN = (1.0, 10.0, 100.0)  # places of the abscissa whose values are shown first, where the curve covers them
#: label -> number, of a channel; the second ones are details
Labelled = tuple[dict[str, Number], dict[str, Number]]


def at_decades(x: Any, *curves: Any) -> dict[float, list[float]]:
    """Values of curves at the powers of ten that their abscissa covers, interpolated on logarithmic axes.

    Examples
    --------
    >>> from jaxcal._answer._curves import at_decades
    >>> {x: round(value, 3) for x, (value,) in at_decades([0.5, 2.0, 10.0], [2.0, 0.5, 0.1]).items()}
    {1.0: 1.0, 10.0: 0.1}
    """
    order = np.argsort(x, kind="stable")
    log = np.log10(np.asarray(x, dtype=float)[order])
    powers = np.arange(math.ceil(log[0] - 1e-9), math.floor(log[-1] + 1e-9) + 1)
    with np.errstate(divide="ignore", invalid="ignore"):  # a curve may be zero, or unknown
        found = [10.0 ** np.interp(powers, log, np.log10(np.asarray(curve, dtype=float)[order])) for curve in curves]
    return {10.0**power: list(map(float, values)) for power, *values in zip(powers.tolist(), *found, strict=True)}


def labelled(numbers: Mapping[float, Number], label: str) -> Labelled:
    """Numbers at places of the abscissa by label, such as "at {:g} s": those at 1, 10 and 100, or else the first three, and the others."""
    first = [place for place in numbers if place in _SHOWN] or list(numbers)[:3]
    parts: Labelled = ({}, {})
    for place, one in numbers.items():
        parts[place not in first][label.format(place)] = one
    return parts


def by_channel(key: str, title: str, channels: Mapping[str, Labelled], note: str = "") -> list[Grid]:
    """A table with one column for each channel, and one of the details."""
    grids = []
    for detail in (False, True):
        labels = dict.fromkeys(label for parts in channels.values() for label in parts[detail])
        rows = tuple((label, tuple(parts[detail].get(label) for parts in channels.values())) for label in labels)
        if rows:
            suffix = "-more" if detail else ""
            grids.append(Grid(key + suffix, title, tuple(channels), rows, detail, note))
    return grids


def by_sensor(names: Iterable[str]) -> Iterator[tuple[str, str, dict[str, str]]]:
    """Sensor, its name for readers, and its channels with their axes: gyro_x -> x. Other channels stand alone."""
    groups: dict[str, dict[str, str]] = {}
    for name in names:
        sensor, _, axis = name.partition("_")
        groups.setdefault(sensor if sensor in SENSORS else name, {})[name] = axis if sensor in SENSORS else ""
    for sensor, channels in groups.items():
        yield sensor, SENSORS.get(sensor, sensor), channels


def of_channel(findings: Iterable[Finding], index: int) -> tuple[Finding, ...]:
    """Findings of all channels, and those of one, whose subject is "channel 0"."""
    mine = f"channel {index}"
    kept = (one for one in findings if not one.subject or mine in one.subject)
    return tuple(dataclasses.replace(one, subject=()) if one.subject else one for one in kept)


class Curved(Result):
    """A result that is a curve, of one channel or several, such as a deviation or a spectrum."""

    _curve = True
    _value: ClassVar[str] = ""  # the attribute that holds its values
    _note: ClassVar[str] = ""

    def _numbers(self, name: str) -> Labelled:
        """A few numbers of a curve of one channel, whose name may begin with a sensor and tells the unit."""
        raise NotImplementedError

    def _drawn(self, name: str) -> Curve:
        """Such a curve as a section."""
        raise NotImplementedError

    def _quantity(self, name: str) -> str:
        """Quantity of its values."""
        raise NotImplementedError

    @property
    def _title(self) -> str:
        raise NotImplementedError

    def sections(self) -> list[Section]:
        """A few values of each channel, and the curves."""
        values = getattr(self, self._value)
        one = {str(i): self.channel(i) for i in range(values.shape[1])} if values.ndim > 1 else {"": self}
        grids = by_channel(self._value, self._title, {name: single._numbers(name) for name, single in one.items()}, self._note)
        return [*grids, *(single._drawn(name) for name, single in one.items())]

    def channel(self, index: int) -> Any:
        """The same result for one of several channels."""
        return replaced(channel_of(self, self._value, index), findings=of_channel(self.findings, index))


C = TypeVar("C", bound=Curved)


class Curves(Results[C]):
    """Curves of the channels of a log. The sensor that a name begins with tells the unit."""

    _curve = True

    @property
    def headline(self) -> str:
        """Number of channels, and the headline of the first."""
        first = next(iter(self.values()))
        return f"{len(self)} channel{'s' * (len(self) != 1)}, {first.headline}"

    def sections(self) -> list[Section]:
        """A few values of the channels of each sensor, and the curves."""
        found: list[Section] = []
        for sensor, title, names in by_sensor(self):
            first = self[next(iter(names))]
            found += by_channel(sensor, title, {axis: self[name]._numbers(name) for name, axis in names.items()}, first._note)
        return [*found, *(one._drawn(name) for name, one in self.items())]

    def _fields(self) -> dict[str, Any]:
        found = super()._fields()
        for name, fields in found["channels"].items():
            fields["unit"] = si_unit_of(self[name]._quantity(name))
        return found
