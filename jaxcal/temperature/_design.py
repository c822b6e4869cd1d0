"""Design matrix of a thermal curve over one or several records for a given structure, and its derivatives."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import scipy  # loads its parts when they are first used

from .._types import AnyArray
from ._curves import sigmoid
from ._hysteresis import felt, lagged, rate_of
from ._linear import basis
from ._prior import DEGREE
from ._restricted import Bands, Restricted, bands

_STEP = {"lag": 0.5, "play": 0.01, "slow": 0.5}  # s, degC, s: steps of central differences

#: samples: fewest of a record, up to which a gap is interpolated, or up to this share of a record; most of all records together, more are
#: averaged; and number for the comparison of structures
FEWEST, SHARE, MANY, COARSE = 16, 0.01, 2**15, 2000
_LOCAL, _LOCAL_RATE = 31.0, 121.0  # s: window for smoothing a thermometer, and its rate of change


class Jump(NamedTuple):
    """A jump: its centre, degC, and the logarithm of its width."""

    centre: float
    log_width: float


@dataclasses.dataclass(frozen=True)
class Form:
    """Structure of a curve in addition to its series: lag, play, a term in dT/dt with its own lag, jumps. `free` names what is fitted."""

    lag: float = 0.0
    play: float = 0.0
    rate: bool = False
    slow: float = 0.0
    free: tuple[str, ...] = ()
    jumps: tuple[Jump, ...] = ()

    @property
    def vector(self) -> AnyArray:
        """The nonlinear parameters: those in `free`, then centre and log width of every jump."""
        return np.array([*(getattr(self, name) for name in self.free), *(x for jump in self.jumps for x in jump)], dtype=float)

    def at(self, vector: AnyArray) -> "Form":
        """The same form with new nonlinear parameters."""
        first = len(self.free)
        pairs = np.asarray(vector[first:], dtype=float).reshape(-1, 2)
        jumps = tuple(Jump(float(centre), float(width)) for centre, width in pairs)
        held: dict[str, Any] = {name: max(float(x), 0.0) for name, x in zip(self.free, vector[:first], strict=True)}
        return dataclasses.replace(self, jumps=jumps, **held)


class Part(NamedTuple):
    """One record without gaps, at even intervals: temperature, dT/dt and bias."""

    t: AnyArray
    rate: AnyArray
    b: AnyArray


def part_of(t: AnyArray, b: AnyArray, dt: float, *, smooth: bool = True) -> Part:
    """Make a record, with its thermometer smoothed by local parabolas: A. Savitzky and M. Golay, Anal. Chem. 36 (1964) 1627.

    This smoothing causes no delay. Without it, the thermometer's noise would look like noise of the bias where the bias is steep.
    """

    def local(seconds: float) -> AnyArray:
        window = min(2 * int(seconds / dt / 2) + 1, 2 * ((len(t) - 1) // 2) + 1)
        return t if window < 5 else np.asarray(scipy.signal.savgol_filter(t, window, 2))

    # use the same filter as the model, because it attenuates a quickly changing rate
    return Part(local(_LOCAL) if smooth else t, rate_of(local(_LOCAL_RATE), dt), b)


class Design:
    """Records on a common time grid, and the columns of the design matrix of a form."""

    def __init__(self, parts: list[Part], dt: float):
        self.parts, self.dt = parts, dt
        self.t = np.concatenate([part.t for part in parts])
        self.b = np.concatenate([part.b for part in parts])
        self.record = np.repeat(np.arange(len(parts)), [len(part.t) for part in parts])
        self.bands: Bands = bands(tuple(len(part.t) for part in parts), dt)
        self.y = self.bands.transform(self.b - self.b.mean())
        self.least = max(1e-12 * float(np.abs(self.b).max()), 1e-150)
        self.low, self.high = float(self.t.min()), float(self.t.max())
        self._kept: dict[tuple[float, float], AnyArray] = {}

    def filtered(self, lag: float, play: float) -> AnyArray:
        """Temperature at the sensor, behind lag and play."""
        return np.concatenate([felt(part.t, lag, play, self.dt) for part in self.parts])

    def rate(self, slow: float) -> AnyArray:
        """dT/dt behind a lag, degC/s."""
        return np.concatenate([lagged(part.rate, self.dt, slow) for part in self.parts])

    def chebyshev(self, t: AnyArray) -> AnyArray:
        """Columns of the curve at the given temperatures, without the constant."""
        return basis(t, self.low, self.high, DEGREE)[:, 1:]

    def base(self, form: Form) -> AnyArray:
        """Transformed columns of the series; the result for the last lag and play is cached."""
        key = form.lag, form.play
        if key not in self._kept:
            self._kept = {key: self.bands.transform(self.chebyshev(self.filtered(*key)))}
        return self._kept[key]

    def further(self, form: Form) -> AnyArray:
        """(samples, k) columns in addition to the series: dT/dt and the jumps."""
        t = self.filtered(form.lag, form.play)
        columns = [self.rate(form.slow)] * form.rate + [column_of(jump, t) for jump in form.jumps]
        return np.stack(columns, axis=1) if columns else np.zeros((len(t), 0))

    def columns(self, form: Form) -> AnyArray:
        """All transformed columns: the series, dT/dt and the jumps."""
        return np.concatenate([self.base(form), self.bands.transform(self.further(form))], axis=1)

    def restricted(self, form: Form, *, slopes: AnyArray | None = None) -> Restricted:
        """Restricted likelihood of a form; `slopes` adds columns for its nonlinear parameters."""
        columns = self.columns(form)
        columns = columns if slopes is None else np.concatenate([columns, slopes], axis=1)
        return Restricted(self.bands, columns, self.y, least=self.least, doubtful=slopes is not None)

    def slopes(self, form: Form, beta: AnyArray) -> AnyArray:
        """Transformed derivative of the curve by `form.vector`."""
        columns, vector = [], form.vector
        for i, name in enumerate(form.free):
            step = _STEP[name] * np.eye(len(vector))[i]
            up, down = form.at(vector + step), form.at(vector - step)
            change = self.columns(up) @ beta - self.columns(down) @ beta
            columns.append(change / (getattr(up, name) - getattr(down, name)))
        t, heights = self.filtered(form.lag, form.play), beta[len(beta) - len(form.jumps) :]
        for jump, height in zip(form.jumps, heights, strict=True):
            columns += [*self.bands.transform(np.stack(shape_slopes(jump, height, t), axis=1)).T]
        return np.stack(columns, axis=1) if columns else np.zeros((len(self.y), 0))


def column_of(jump: Jump, t: AnyArray) -> AnyArray:
    """Column of one jump."""
    return np.asarray(sigmoid(t, jump.centre, np.exp(jump.log_width)))


def shape_slopes(jump: Jump, height: float, t: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Derivatives of a jump by its centre and by its log width."""
    step = column_of(jump, t)
    bell = height * step * (1 - step) / np.exp(jump.log_width)
    return -bell, -bell * (t - jump.centre)
