"""What a log says about the values of a sensor, as findings."""

import numpy as np

from .._answer import Finding
from .._log_findings import LOG
from ._stretch import Stretch
from ._values import STUCK


def seen_in(sensor: str, names: list[str], values: np.ndarray, rate: float, unit: str, stretches: list[Stretch]) -> list[Finding]:
    """Findings about the values (n, axes) of a sensor, and about the stretches that are seen in them."""
    found = []
    low, high = np.fmin.reduce(values, axis=0), np.fmax.reduce(values, axis=0)
    constant = low == high
    if sensor != "temperature" and constant.any():
        of = [name for name, same in zip(names, constant, strict=True) if same]
        found.append(LOG("constant", of, values=", ".join(f"{value:.6g}" for value in low[constant]), unit=unit))
    if stuck := [one for one in stretches if one.kind == "stuck"]:
        longest = max(stuck, key=lambda one: one.samples)
        facts = {"length": longest.stop - longest.start, "at": longest.start - 1 / rate, "samples": sum(one.samples for one in stuck)}
        found.append(LOG("frozen", sensor, count=len(stuck), run=STUCK, **facts))
    for one in stretches:
        about = [names[axis] for axis in one.axes]
        if one.kind == "held":
            share = one.samples / len(values)
            found.append(LOG("repeats", sensor, percent=100 * share, rate=rate * (1 - share)))
        elif one.kind == "zeroed":
            found.append(LOG("zeroed", about, count=one.samples))
        elif one.kind == "clipped":
            found.append(LOG("clipped", about, count=one.samples, value=one.size, unit=unit))
        elif one.kind == "coarse":
            found.append(LOG("steps", about, step=float(f"{one.size:.4g}"), unit=unit))
        elif one.kind == "warm_up":
            found.append(LOG("warm_up", sensor, length=one.stop, shift=one.size, unit=unit))
    return found
