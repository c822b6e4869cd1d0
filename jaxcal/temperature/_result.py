"""`TemperatureFit`: a thermal model with its uncertainty and diagnostics; `TemperatureFits`: those of the channels of a log."""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
import scipy  # loads its parts when they are first used

from .._answer import Curve, Finding, Grid, Number, Result, Results, Section, joined_names
from .._precision import host_float64
from .._special import NORMAL95
from .._types import AnyArray, Checked, Leaf, Numbers
from .._units import shown_in
from ..fitting import Estimate
from ..noise import Noise
from ._model import ThermalModel
from ._record import Bins

_PARTS = ("centre", "width", "height")
_SENSORS = {"gyro": "gyroscope", "accel": "accelerometer", "mag": "magnetometer"}
_LABELS = {"height": "jump {}", "centre": "jump {} at", "width": "jump {} width"}


class Step(eqx.Module):
    """A jump of the bias at a certain temperature of the device.

    Attributes
    ----------
    centre : temperature of the jump, degC.
    width : width parameter w of the logistic function, degC; three quarters of the jump occur within 4 w.
    height : height in the unit of the bias.
    centre_error, width_error, height_error : standard errors of centre, width and height.
    chance : probability that a record without this jump shows an equally clear one at any temperature.

    Examples
    --------
    >>> from jaxcal.temperature import Step
    >>> Step(24.5, 0.05, 5e-3, 0.01, 0.01, 1e-4, 1e-6).height
    0.005
    """

    centre: float
    width: float
    height: float
    centre_error: float
    width_error: float
    height_error: float
    chance: float


def no_estimate() -> Estimate:
    """The estimate of a curve whose parameters have no errors of their own, such as a table."""
    return Estimate((), np.zeros(0), np.zeros((0, 0)))


class TemperatureFit(Result):
    """Bias of one channel as a function of temperature, with its uncertainty.

    `interval_at` gives the interval of the curve, relative to the mean noise of the record. `prediction_at` gives the interval of readings
    in the next cycle, including the bias drift until then.

    Attributes
    ----------
    model : `ThermalModel` with `bias_at` and `correct`.
    kind : "smooth", "polynomial", "table", or the class name of your own curve.
    quantity : what the readings are, for their unit: "B.gyro", "B.accel", "B.mag", "" if unknown.
    degree : degree of a polynomial; None for other models.
    estimate : parameters beside the smooth curve, by name: "lag", "play", "rate", "rate_lag", "jump.height[0]", "jump.centre[0]",
        "jump.width[0]"; those of your own curve; for a polynomial "a1", "a2", ... of the powers of T in degC, equation (5.3) of the thesis.
        Above degree 5 these alternate in sign and nearly cancel, so use `model` instead.
    chances : for each jump, the probability that a record without it shows an equally clear one.
    noise : `jaxcal.noise.Noise` with the N, B and K estimated together with the curve; None if the times are unknown.
    rms, worst, worst_at : rms residual of the means over 0.1 degC over the whole range; the same in the worst window of 1 degC; and the
        centre of this window, degC. `rms` alone hides a misfit at a jump.
    grid, error : (bins,) temperatures, degC, and the standard error of the curve there.
    bins : the fitted `Bins`, over the effective temperature. residual : (bins,) mean biases of the bins minus the curve.
    next_error : (bins,) standard deviation of the mean reading over 0.1 degC in the next cycle about the curve.
    level : (standard deviation of the level of the next cycle, its degrees of freedom), from the levels of several records.
    thermometer : standard deviation of the thermometer's noise, degC.
    confidence : level of `interval_at` and `prediction_at`.
    findings : what to know about the fit.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(jump=0.0)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time, model="polynomial", degree=3)
    >>> low, high = found.interval_at(np.array([30.0]))
    >>> found.kind, bool(low[0] < high[0])
    ('polynomial', True)
    """

    model: ThermalModel
    bins: Bins
    residual: AnyArray
    rms: Leaf
    kind: str = eqx.field(static=True)
    quantity: str = eqx.field(static=True, default="")
    degree: Checked[int | None] = None
    estimate: Estimate = eqx.field(default_factory=no_estimate)
    chances: tuple[float, ...] = ()
    worst: Any = None
    worst_at: Any = None
    grid: Any = None
    error: Any = None
    next_error: Any = None
    level: tuple[float, int] = eqx.field(static=True, default=(0.0, 0))
    noise: Checked[Noise | None] = None
    thermometer: Leaf | None = None
    confidence: float = eqx.field(static=True, default=0.95)
    findings: tuple[Finding, ...] = eqx.field(static=True, default=())

    _figure = ("temperature", False)

    @property
    def steps(self) -> tuple[Step, ...]:
        """The jumps, sorted by temperature."""
        each = [[self.estimate.select(f"jump.{part}[{i}]") for part in _PARTS] for i in range(len(self.chances))]
        sizes = [[*(float(one.values[0]) for one in parts), *(float(one.error[0]) for one in parts)] for parts in each]
        return tuple(Step(*[*known, chance]) for known, chance in zip(sizes, self.chances, strict=True))

    @property
    def headline(self) -> str:
        """The rms error over the range of the model."""
        return f"bias over {self.span_text()} to {self.rms_text()} rms"

    def span_text(self) -> str:
        """The range of the model in words."""
        return f"{float(self.model.low):.0f} to {float(self.model.high):.0f} degC"

    def rms_text(self) -> str:
        """The rms residual with its unit."""
        unit, size = shown_in(self.quantity)
        return f"{float(self.rms) / size:.3g} {unit}".strip()

    def sections(self) -> list[Section]:
        """Errors, jumps and parameters; the curve."""
        return [Grid("curve", self.kind, ("",), tuple((label, (cell,)) for label, cell in self.rows().items())), *self.details()]

    def rows(self, prefix: str = "") -> dict[str, Number]:
        """Numbers by their label."""
        found = {"rms left": Number("rms", float(self.rms), quantity=self.quantity)}
        if self.worst is not None:  # a traced fit has neither these nor errors
            found["worst degree"] = Number("worst", float(self.worst), quantity=self.quantity)
            found["worst degree at"] = Number("worst_at", float(self.worst_at), quantity="degC")
            middle = (float(self.model.low) + float(self.model.high)) / 2
            value, half = float(np.asarray(self.model.curve.value(middle))), NORMAL95 * float(np.interp(middle, self.grid, self.error))
            found["bias in the middle"] = Number("middle", value, value - half, value + half, self.quantity)
        change = float(np.ptp(np.asarray(self.model.curve.value(np.asarray(self.bins.t)))))
        found["change over range"] = Number("change", change, quantity=self.quantity)
        for one in self.estimate.numbers():
            name, _, place = one.name.removeprefix("jump.").partition("[")
            label = _LABELS[name].format(int(place[:-1]) + 1) if one.name.startswith("jump.") else one.name.replace("_", " ")
            found[label] = one
        return {label: one._replace(name=prefix + one.name) for label, one in found.items()}

    def details(self, prefix: str = "", title: str = "curve") -> list[Section]:
        """The curve with its interval at each bin."""
        t, unit = np.asarray(self.bins.t), self.quantity
        low, high = self.interval_at(t) if self.grid is not None else 2 * (np.full(len(t), np.nan),)
        columns = {"temperature": ("degC", t), "mean": (unit, np.asarray(self.bins.b)), "samples": ("", np.asarray(self.bins.count)),
                   "model": (unit, np.asarray(self.model.curve.value(t))), "low": (unit, low), "high": (unit, high)}  # fmt: skip
        return [Curve(f"{prefix}curve", title, columns)]

    @host_float64
    def interval_at(self, temperature: Numbers) -> tuple[AnyArray, AnyArray]:
        """Limits of the confidence interval of the curve at steady temperatures (n,) or (), degC, at level `confidence`."""
        return self._about(temperature, self.error)

    @host_float64
    def prediction_at(self, temperature: Numbers) -> tuple[AnyArray, AnyArray]:
        """Limits of the prediction interval of mean readings over 0.1 degC in the next cycle, at temperatures (n,) or (), degC.

        After one record, the next cycle is a repetition without a pause, during which the bias continues to drift with B and K. After
        several records, it is another cycle of the same kind, whose level scatters as their levels do (Student's t).

        Examples
        --------
        >>> import numpy as np
        >>> import jaxcal
        >>> made = jaxcal.temperature.simulate(jump=0.0)
        >>> low, high = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time).prediction_at(np.array([30.0]))
        >>> bool(low < jaxcal.temperature.reference_bias(np.array([30.0]), jump=0.0) < high)
        True
        """
        return self._about(temperature, self.next_error, *self.level)

    def _about(self, temperature: Any, error: AnyArray, spread: float = 0.0, freedom: int = 0) -> tuple[AnyArray, AnyArray]:
        """Limits about the curve, for an error at each bin and one common to all."""
        t, tail = np.clip(np.asarray(temperature, dtype=float), self.model.low, self.model.high), 0.5 + self.confidence / 2
        value, half = np.asarray(self.model.curve.value(t)), scipy.special.ndtri(tail) * np.interp(t, self.grid, error)
        half = np.hypot(half, scipy.special.stdtrit(freedom, tail) * spread) if freedom else half
        return np.asarray(value - half), np.asarray(value + half)


class TemperatureFits(Results[TemperatureFit]):
    """Thermal models of the channels of a log: channel name -> `TemperatureFit`, rendered as one result.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(jump=0.0)
    >>> log = jaxcal.Log(made.time, gyro=made.bias, temperature=made.temperature)
    >>> found = jaxcal.temperature.characterise(log)
    >>> found.headline[:24]
    'bias over 20 to 45 degC '
    """

    _figure = ("temperature", False)

    @property
    def headline(self) -> str:
        """The rms error of the worst axis of each sensor."""
        worst = {name: max(axes.values(), key=lambda fit: float(fit.rms)) for name, axes in self.by_sensor().items()}
        said = ", ".join(f"{fit.rms_text()} ({name})" for name, fit in worst.items())
        return f"bias over {next(iter(worst.values())).span_text()} to {said} rms"

    def by_sensor(self) -> Mapping[str, dict[str, TemperatureFit]]:
        """Sensor -> axis -> fit; a channel of no known sensor counts as a sensor of its own."""
        found: dict[str, dict[str, TemperatureFit]] = {}
        for name, fit in self.items():
            sensor, _, axis = name.rpartition("_")
            found.setdefault(sensor if sensor in _SENSORS else name, {})[axis if sensor in _SENSORS else ""] = fit
        return found

    def sections(self) -> list[Section]:
        """A table for each sensor, with a column for each axis; curves of each channel."""
        tables: list[Section] = []
        for sensor, axes in self.by_sensor().items():
            columns = [fit.rows(f"{sensor}_{axis}.".replace("_.", ".")) for axis, fit in axes.items()]
            labels = dict.fromkeys(label for column in columns for label in column)
            rows = tuple((label, tuple(column.get(label) for column in columns)) for label in labels)
            tables.append(Grid(sensor, _SENSORS.get(sensor, sensor), tuple(axes), rows))
        return tables + [one for name, fit in self.items() for one in fit.details(f"{name}.", joined_names([name]))]


TemperatureFit._several = TemperatureFits
