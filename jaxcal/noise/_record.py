"""`Record`: what a fit is made of. It is checked once, where it comes in."""

import contextlib
import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from .._errors import DataError
from .._quality import checked_record, refuse_infinite
from ..evidence import bursts

_AXES = 3  # most channels that are axes of one sensor, which a knock or a warm-up changes together


@dataclasses.dataclass
class Record:
    """The channels of one sensor, after checks.

    Parameters
    ----------
    y : (n,) or (n, channels) samples; NaN where one is missing.
    names : of the channels.
    temperature : (n,) at the samples; None if it is not known.
    aside : stretches of samples (first, last) to leave out; None if they are to be found.

    Attributes
    ----------
    channels : list of (n,) samples. traced : whether they are traced; only their shape is known then. found : whether what is set aside
        was found here, and was not said elsewhere.
    """

    y: Any
    names: tuple[str, ...] = ()
    temperature: Any = None
    aside: Sequence[tuple[int, int]] | None = None

    def __post_init__(self):
        y = checked_record(self.y)
        self.traced = not isinstance(y, np.ndarray)
        self.found = self.aside is None
        self.channels = list(y.T) if y.ndim == 2 else [y]
        self.names = self.names or (tuple(f"channel {i}" for i in range(y.shape[1])) if y.ndim == 2 else ("",))

    @property
    def samples(self) -> int:
        """Number of samples of a channel."""
        return len(self.channels[0])

    @property
    def sensor(self) -> str:
        """The sensor, if the channels are axes of a known one."""
        return self.names[0].partition("_")[0] if "_" in self.names[0] else ""

    def sensors(self) -> list["Record"]:
        """The record, or one for each channel if it has more of them than a sensor has axes."""
        if len(self.names) <= _AXES or self.traced:
            return [self]
        return [Record(x, (name,), self.temperature, self.aside) for name, x in zip(self.names, self.channels, strict=True)]

    def set_aside(self, rate: float) -> None:
        """Refuse channels that hold no noise, and leave out the stretches in which the sensor is not at rest."""
        for name, x in zip(self.names, self.channels, strict=True):
            with naming(name):
                refuse_infinite(x, "the record")
                if np.nanmin(x, initial=np.inf) == np.nanmax(x, initial=-np.inf):
                    raise DataError(
                        "the record is constant (every sample equal): there is no noise to characterise. Check that the sensor was running "
                        "and that its resolution is finer than its noise; leave a dead channel out"
                    )
        if self.aside is None:
            self.aside = bursts(np.stack(self.channels, axis=1), rate)
        self.channels = [without(x, self.aside) for x in self.channels]


@contextlib.contextmanager
def naming(name: str) -> Iterator[None]:
    """Errors about the data name the channel."""
    try:
        yield
    except DataError as error:
        raise error.of(name) if name else error from None


def without(y: Any, aside: Sequence[tuple[int, int]]) -> Any:
    """The samples without the stretches that are set aside."""
    if aside:
        y = np.array(y, dtype=float)
        for first, last in aside:
            y[first:last] = np.nan
    return y
