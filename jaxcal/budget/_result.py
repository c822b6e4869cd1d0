"""`Budget`: errors over time with the share of each cause; `requirement`: by what each may grow."""

import itertools
from typing import Any

import equinox as eqx
import numpy as np

from .._answer import Curve, Finding, Grid, Number, Result, Section
from .._special import NORMAL95
from .._types import AnyArray, Leaf

#: what a reader asks for -> its states among the nine, quantity, and label
GROUPS = {
    "tilt": (slice(0, 2), "angle", "level (tilt)"), "heading": (slice(2, 3), "angle", "heading"),
    "velocity": (slice(3, 6), "speed", "velocity"), "position": (slice(6, 9), "length", "position"),
}  # fmt: skip
_LARGEST = 3  # causes shown
#: causes that grow with the turns of a motion
_TURNING = {"gyro scale", "gyro misalignment", "gyro delay", "accel delay", "accel lever"}


def summed(variances: Any, group: str) -> Any:
    """Sum of the variances (..., 9) of a group."""
    return variances[..., GROUPS[group][0]].sum(axis=-1)


class Budget(Result):
    """Standard deviations of attitude, velocity and position over time, and what causes them.

    Attributes
    ----------
    time : (k,) s.
    covariance : (k, 9, 9) of attitude (rad; x and y are tilts, z is the heading), velocity (m/s) and position (m) in the level frame. Of
        increments (k, m, 9, 9), at m places along the motion, in the axes of the body at the start.
    contributions : cause, such as "gyro N" -> (k, 9) its part of the variances.
    uncertainty : group -> (k,) standard error of its variance, from that of the coefficients; NaN if that is not known.
    noise : causes that are noise.
    aided : whether level and heading are aided; velocity and position are then left out.
    motion : its name.
    shown : indices of the times in the table.
    findings : what the numbers do not hold.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=np.deg2rad(0.3 / 60), K=1e-6)
    >>> found = jaxcal.budget.propagate({"gyro": gyro}, jaxcal.budget.Motion.rest(60.0))
    >>> f"{np.rad2deg(found.std('heading')[-1]):.3f} deg", found.largest("heading", 60.0)[0][0]
    ('0.042 deg', 'gyro N')
    """

    time: AnyArray
    covariance: AnyArray
    contributions: dict[str, AnyArray]
    uncertainty: dict[str, AnyArray]
    shown: tuple[int, ...] = eqx.field(static=True)
    motion: str = eqx.field(static=True)
    aided: bool = eqx.field(static=True)
    noise: tuple[str, ...] = eqx.field(static=True)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    @property
    def groups(self) -> tuple[str, ...]:
        """What is known: without velocity and position where the level is aided."""
        return tuple(GROUPS)[: 2 if self.aided else 4]

    def std(self, group: str) -> AnyArray:
        """(k,) root of the sum of the variances of "tilt", "heading", "velocity" or "position"."""
        return summed(sum(self.contributions.values()), group) ** 0.5

    def factor(self, sensor: str) -> AnyArray:
        """(k,) by what the N of "gyro" or "accel" has to be multiplied to give all its errors of attitude, or of velocity."""
        states = {"gyro": slice(0, 3), "accel": slice(3, 6)}[sensor]
        own = {cause: part[:, states].sum(axis=1) for cause, part in self.contributions.items() if cause.startswith(sensor)}
        return (sum(own.values()) / own[f"{sensor} N"]) ** 0.5

    def largest(self, group: str, time: Leaf) -> list[tuple[str, float]]:
        """The three causes with the largest shares of the variance at a time, and the shares."""
        place = int(np.argmin(np.abs(np.asarray(self.time) - time)))
        each = {cause: float(summed(part, group)[place]) for cause, part in self.contributions.items()}
        whole = float(self.std(group)[place]) ** 2
        ranked = sorted(each.items(), key=lambda one: -one[1])[:_LARGEST]
        return [(cause, part / whole) for cause, part in ranked if part > 0.005 * whole]

    @property
    def headline(self) -> str:
        """Heading at the last time of the table."""
        last = self.shown[-1]
        return f"heading to {np.rad2deg(self.std('heading')[last]):.3g} deg after {self.time[last]:g} s ({self.motion})"

    def number(self, group: str, place: int) -> Number:
        """The standard deviation of a group at one of the times, with its interval."""
        value, quantity = float(self.std(group)[place]), GROUPS[group][1]
        spread = float(self.uncertainty[group][place])
        # half of the relative error of the variance, on a logarithmic scale, because a variance is positive
        ratio = np.exp(NORMAL95 * spread / (2 * value**2)) if value > 0 else np.nan
        return Number(f"{group}[{self.time[place]:g} s]", value, value / ratio, value * ratio, quantity)

    def sections(self) -> list[Section]:
        """Errors at a few times with the three largest causes, and the curves by cause."""
        columns = tuple(f"{self.time[place]:g} s" for place in self.shown)
        rows = tuple((GROUPS[group][2], tuple(self.number(group, place) for place in self.shown)) for group in self.groups)
        causes = []
        for group in self.groups:
            ranked = [self.largest(group, self.time[place]) for place in self.shown]
            lines = itertools.zip_longest(*([f"{cause} {100 * share:.0f}%" for cause, share in one] for one in ranked), fillvalue="")
            causes += [("" if i else GROUPS[group][2], cells) for i, cells in enumerate(lines)]
        known = [one for one in ("gyro", "accel") if self.covariance.ndim == 4 and f"{one} N" in self.contributions]
        cells = [tuple(Number(f"{one}.factor[{at}]", float(x)) for at, x in zip(columns, self.factor(one), strict=True)) for one in known]
        tables = {"errors": rows, "causes": causes, "N to write": zip([f"{one} N times" for one in known], cells, strict=True)}
        found: list[Section] = [Grid(name.replace(" ", "_"), name, columns, tuple(each)) for name, each in tables.items()]
        for group in self.groups:
            quantity = GROUPS[group][1]
            parts = {cause: (quantity, np.maximum(summed(part, group), 0) ** 0.5) for cause, part in self.contributions.items()}
            curve = {"time": ("time", self.time), "all": (quantity, self.std(group)), **parts}
            found.append(Curve(group, f"{GROUPS[group][2]} by cause", curve))
        return found


def requirement(budget: Budget, *, after: float, **limits: float) -> dict[str, tuple[Any, Any]]:
    r"""By what errors, motion or record may be multiplied so that a requirement just holds, the inverse of `propagate` in closed form.

    The variance of a budget is a sum of squares, :math:`\sigma^2 = \sum_i \sigma_i^2`, and each cause enters in proportion to its size. So
    cause i alone may grow by

    .. math:: k_i = \sqrt{(L^2 - \sigma^2 + \sigma_i^2)/\sigma_i^2},

    and so may several together. The slope :math:`\partial\sigma/\partial k_i = \sigma_i^2/\sigma` says where an effort pays.

    Parameters
    ----------
    budget : `Budget`, of these sensors, motion, rest and aid.
    after : s, one of its times, or near.
    limits : heading, tilt, velocity or position = the limit of its standard deviation, rad, m/s or m. Give one.

    Returns
    -------
    dictionary cause -> (factor, slope); the factor is NaN if the others alone exceed the limit, and the slope is in the unit of the limit.
    Beside the causes: "all"; "noise" and "calibration", all terms of the one or of the other together; "turning", for larger or faster
    turns, with the errors that grow with them. If the calibration knows how certain its noise is, "record": the length of the record that
    it needs, over that which it had, so that the 95 % interval ends at the limit.

    Raises
    ------
    TypeError
        If not one limit is given.

    Examples
    --------
    >>> import numpy as np
    >>> from jaxcal.budget import Motion, propagate, requirement
    >>> from jaxcal.noise import Noise
    >>> found = requirement(propagate(Noise(N=1e-4), Motion.rest(100.0)), heading=2e-3, after=100.0)
    >>> round(float(found["gyro N"][0]), 6)
    2.0
    """
    if len(limits) != 1 or not set(limits) <= set(GROUPS):
        raise TypeError(f"requirement takes one limit of {', '.join(GROUPS)}; got {', '.join(limits) or 'none'}")
    (group, limit), place = next(iter(limits.items())), int(np.argmin(np.abs(np.asarray(budget.time) - after)))
    value = budget.std(group)[place]
    parts = {cause: one for cause, each in budget.contributions.items() if (one := summed(each, group)[place]) > 0}
    kinds = {"noise": budget.noise, "calibration": set(parts) - set(budget.noise), "turning": _TURNING}
    together = {"all": value**2} | {kind: sum(one for cause, one in parts.items() if cause in own) for kind, own in kinds.items()}
    found = {}
    for cause, part in (together | parts).items():
        if part > 0:
            room = (limit**2 - value**2) / part + 1
            found[cause] = room**0.5 if room >= 0 else np.nan, part / value
    spread = NORMAL95 * float(budget.uncertainty[group][place]) / (2 * float(value) ** 2)  # of the logarithm
    if spread > 0:
        enough = (spread / np.log(limit / value)) ** 2 if limit > value else np.nan
        found["record"] = enough, -value * spread * np.exp(spread) / 2
    return found
