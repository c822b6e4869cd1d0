"""`Stretch`: a part of a recording that is no measurement of a sensor at rest, or none at all."""

import dataclasses

#: kinds that are no measurement, whatever the log is used for: a repeat of another reading, a value cut by a dead band or by the range
NO_READING = ("held", "stuck", "zeroed", "clipped")
#: kinds that are no noise of a sensor at rest; a log of movement may consist of them
NOT_STILL = ("knock", "moving", "step")
#: kinds that are told, and set nothing aside
TOLD = ("warm_up", "coarse", "wrapped", "resampled", "gap")
KINDS = (*NO_READING, *NOT_STILL, *TOLD)


@dataclasses.dataclass(frozen=True)
class Stretch:
    """A part of a recording in which something other than the sensor is seen.

    Attributes
    ----------
    kind : "knock" (at most 5 s, with the level before and after it alike), "moving" (longer), "step" (the mean shifts at an instant);
        "held" (all axes repeat an earlier reading: the sensor is slower than the log, or packets were repeated), "stuck" (the same for
        long), "zeroed" (exact zeros of a dead band, or of lost readings), "clipped" (at the end of the range); "warm_up" (the first
        minute is off), "coarse" (steps of the values as large as the noise), "wrapped" (a counter overflows, and its readings are joined),
        "resampled" (interpolated from another rate), "gap" (no readings).
    sensor : "gyro", "accel", "mag" or "temperature"; "" for all.
    axes : indices of the axes.
    start, stop : s from the start of the recording.
    size : largest distance from the level before and after, shift of the level, value, step, or rate, by kind; 0 if it has none.
    unit : of the size, in SI; "" if it has none.
    samples : number of readings concerned. Held, zeroed and clipped readings are scattered between `start` and `stop`.

    Examples
    --------
    >>> from jaxcal.evidence import Stretch
    >>> one = Stretch("knock", "gyro", (0, 1, 2), 12.0, 13.5, 0.03, "rad/s", 150)
    >>> one.stop - one.start, str(one)
    (1.5, '12 s to 13.5 s: knock of 0.03 rad/s (gyro)')
    """

    kind: str
    sensor: str
    axes: tuple[int, ...]
    start: float
    stop: float
    size: float = 0.0
    unit: str = ""
    samples: int = 0

    def __str__(self) -> str:
        size = f" of {self.size:.3g} {self.unit}" if self.size else ""
        return f"{self.start:.5g} s to {self.stop:.5g} s: {self.kind.replace('_', '-')}{size}" + f" ({self.sensor})" * bool(self.sensor)
