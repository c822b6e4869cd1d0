"""`temperature`: bias against temperature, with the thermal model."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._special import NORMAL95
from .._types import Given
from ..temperature import TemperatureFit
from ._channels import Channel, draw_groups
from ._style import INK, MOST, MUTED, SENSORS, SERIES, Drawing, cannot_draw, interval_labels, number_label, place_legend, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


class _Channel(Channel):
    """One thermal model to draw."""

    fit: TemperatureFit

    def change(self, bias: Any) -> np.ndarray:
        """A bias minus the model at the middle of the range, in the unit of the axis."""
        model = self.fit.model
        return (np.asarray(bias) - float(np.asarray(model.curve.value(np.asarray((model.low + model.high) / 2))))) / self.unit[0]


def temperature(result: Given, ax: Drawing | None = None) -> Any:
    """Draw the change of bias with temperature: means over 0.1 degC, the model with its interval, and jumps as dotted lines.

    Each channel is drawn relative to its value at the middle of the range, so that several can share an axis. The vertical axis is in the
    unit of the bias instability (gyroscope deg/h, accelerometer mg, magnetometer nT) if the name of the channel tells the sensor. The
    horizontal axis is the temperature that the sensor feels, after lag and play if the model has them.

    Parameters
    ----------
    result : a `TemperatureFit`, or a dictionary channel -> these, such as the result of `jaxcal.temperature.characterise`.
    ax : matplotlib Axes to draw on; for a dictionary with several sensors an array with one for each. None makes a figure 1000
        pixels wide; `jaxcal.plot.save` writes it, and a notebook shows it as ``ax.figure``.

    Returns
    -------
    The Axes; for several sensors an array of Axes, one for each.

    Raises
    ------
    DataError
        If there is nothing to draw, or the number of axes does not suit.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(seed=1)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, time=made.time)
    >>> jaxcal.plot.temperature({"gyro_x": found}).get_ylabel()
    'Change of bias (°/h)'
    """
    named: Mapping[str, Any] = result if isinstance(result, Mapping) else {"": result}
    for fit in named.values():
        if not isinstance(fit, TemperatureFit):
            raise cannot_draw(fit, "a TemperatureFit, or a dictionary channel -> these")
    return draw_groups([_Channel(str(name), fit) for name, fit in named.items()], ax, _draw)


def _draw(ax: "Axes", channels: list[_Channel], *, own: bool) -> None:
    style_axes(ax, "Temperature (°C)", f"Change of bias ({channels[0].unit[1] or 'unit of the record'})")
    points, lines = [], []
    for i, channel in enumerate(channels):
        fit, color = channel.fit, SERIES[i % len(SERIES)]
        dots = {"markersize": 2.6, "color": color, "markeredgewidth": 0, "alpha": 0.6}
        points += ax.plot(fit.bins.t, channel.change(fit.bins.b), "o", label=channel.label or "means over 0.1 °C", **dots)
        lines.append(_curve(ax, channel, color if len(channels) > 1 else INK))
    place_legend(ax, [points, lines], SENSORS.get(channels[0].sensor or "", ""), above=own, lines=True)


def _curve(ax: "Axes", channel: _Channel, color: str) -> Any:
    fit = channel.fit
    t = np.linspace(float(fit.model.low), float(fit.model.high), 2 * MOST)  # a jump is narrow
    low, high = (channel.change(end) for end in fit.interval_at(t))
    ax.fill_between(t, low, high, color=color, alpha=0.16, linewidth=0)
    for step in fit.steps:
        ax.axvline(step.centre, color=MUTED, linewidth=0.8, linestyle=":", zorder=0)
    label = _described(fit, *channel.unit)
    return ax.plot(t, channel.change(fit.model.curve.value(t)), color=color, linewidth=1.4, label=label)[0]


def _described(fit: TemperatureFit, scale: float, unit: str) -> str:
    """Description of a model for the legend: "smooth; 300 at 24.50 °C; lag 60 s"."""
    words = [fit.kind if fit.degree is None or fit.steps else f"{fit.kind} {fit.degree}"]
    for step in fit.steps:
        value, half = abs(step.height) / scale, NORMAL95 * step.height_error / scale
        height = interval_labels(value, value - half, value + half)[0]
        sign = "" if step.height > 0 else "\u2212"
        words.append(f"{sign}{height} {unit} at {step.centre:.2f} °C".replace("  ", " "))
    if fit.model.lag > 0:
        words.append(f"lag {number_label(float(fit.model.lag), 3)} s")
    if fit.model.play > 0:
        words.append(f"play {number_label(float(fit.model.play), 2)} °C")
    if fit.model.rate != 0:
        words.append(f"{number_label(float(fit.model.rate) / scale / 60, 3)} {unit} per °C/min".replace("  ", " "))
    return "; ".join(words)
