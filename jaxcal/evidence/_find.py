"""The evidence of a recording: what is not the sensor under test, found once for every estimator."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from .._units import si_unit
from ._bursts import LONGEST, bursts
from ._gaps import Gap
from ._stretch import NO_READING, NOT_STILL, Stretch
from ._values import columns_of, masked, of_values, unwrapped


def find(
    sensors: Mapping[str, Any], rate: float | int, gaps: Iterable[Gap] = (), known: Mapping[str, Any] | None = None
) -> tuple[Stretch, ...]:
    """Everything in a recording that is not the sensor under test, in the order of time.

    Parameters
    ----------
    sensors : "gyro", "accel", "mag" or "temperature" -> readings (n, axes) or (n,), in SI; NaN where missing.
    rate : Hz.
    gaps : `Log.gaps`.
    known : what is seen in the readings of a sensor themselves, where that was looked for already.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.evidence import find
    >>> gyro = np.random.default_rng(0).normal(size=(20_000, 3)) * 1e-3
    >>> gyro[5_000:5_100] += 0.05 * np.sin(np.linspace(0, np.pi, 100))[:, None]
    >>> [(one.kind, one.sensor, round(one.start)) for one in find({"gyro": gyro}, 100.0)]
    [('knock', 'gyro', 50)]
    """
    found = [Stretch("gap", "", (), gap.start, gap.start + gap.length, samples=gap.samples) for gap in gaps]
    for sensor, given in sensors.items():
        values = columns_of(given)
        if len(values) < 2:
            continue
        if (seen := (known or {}).get(sensor)) is None:
            values, joined = unwrapped(sensor, values, rate, si_unit(sensor))
            seen = joined + of_values(sensor, values, rate, si_unit(sensor))
        found += [*seen, *events(sensor, set_aside(sensor, values, rate, seen), rate)]
    return tuple(sorted(found, key=lambda one: one.start))


def events(sensor: str, values: np.ndarray, rate: float | int) -> list[Stretch]:
    """Knocks, movement and steps of one sensor (n, axes) at rest; none of a thermometer, which may change at any time."""
    if sensor == "temperature":
        return []
    found = bursts(values, rate)
    alive = np.isfinite(values).any(axis=0) if found else ()
    return [_named(sensor, values, alive, rate, first, last) for first, last in found]


def _named(sensor: str, values: np.ndarray, alive: Any, rate: float | int, first: int, last: int) -> Stretch:
    """A burst with its kind and size."""
    width = round(LONGEST * rate)

    def known(*parts: np.ndarray) -> list[np.ndarray]:
        return [seen for part in parts if len(seen := part[np.isfinite(part[:, alive]).all(axis=1)])]

    # the whole record only where nothing is known beside the stretch
    sides = known(values[max(first - width, 0) : first], values[last : last + width]) or known(values)
    level = np.stack([np.median(side, axis=0) for side in sides])
    noise = np.std(np.concatenate(sides), axis=0)
    # the distance from what lies between the levels on both sides, beyond what the noise reaches
    inside, reach = values[first:last], np.sqrt(2.0 * np.log(max(last - first, 2)))  # standard deviations
    away = np.fmax.reduce(np.fmax(inside - level.max(axis=0), level.min(axis=0) - inside), axis=0, initial=0.0) - reach * noise
    shift = np.ptp(level, axis=0)
    axes = np.flatnonzero(np.maximum(away, shift - noise * (2 / width) ** 0.5 * reach) > 0.0)
    size, moved = float(np.fmax.reduce(away, initial=0.0)), float(np.fmax.reduce(shift))
    kind = "moving" if last - first > width else "step" if moved > size else "knock"
    of = tuple(axes.tolist()) or tuple(range(values.shape[1]))
    return Stretch(kind, sensor, of, first / rate, last / rate, max(size, moved), si_unit(sensor), last - first)


def ranges(found: Iterable[Stretch], sensor: str, rate: float | int) -> list[tuple[int, int]]:
    """The stretches of a sensor that are not at rest, as ranges of samples like those of `bursts`."""
    return [(round(one.start * rate), round(one.stop * rate)) for one in found if one.sensor == sensor and one.kind in NOT_STILL]


def set_aside(
    sensor: str, values: np.ndarray, rate: float | int, found: Iterable[Stretch], still: bool = False, keep: Iterable[str] = ()
) -> np.ndarray:
    """The readings (n, axes) with NaN where they are no measurement, or, with `still`, not of a sensor at rest."""
    kinds = {*NO_READING, *(NOT_STILL if still else ())} - set(keep)
    out = values
    for one in found:
        if one.kind in kinds and one.sensor == sensor:
            out = np.where(masked(one, values, rate), np.nan, out)
    return out
