"""`temperature`: bias against temperature, with the thermal model."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from ..temperature import TemperatureFit
from ._labels import display_unit, interval_labels, number_label
from ._style import INK, MUTED, SERIES, key_text, new_figure, place_legend, style_axes

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
_FINE = 2000  # temperatures at which a curve is drawn: a jump is narrow


def temperature(result: Any, ax: Any = None) -> Any:
    """Draw the change of bias with temperature: means over 0.1 degC, the model with its interval, and jumps as dotted lines.

    Channels are drawn from their value at the middle of the range, so that several share an axis. The vertical axis is in the unit of the
    bias instability (gyroscope deg/h, accelerometer mg, magnetometer nT) where the name of the channel tells the sensor. The horizontal
    axis is the temperature that the sensor feels, behind lag and play where it has them.

    Parameters
    ----------
    result : a `TemperatureFit`, or a dictionary channel -> these, such as `jaxcal.temperature.characterise` returns.
    ax : matplotlib Axes to draw on; for a dictionary with several sensors an array with one for each. None makes a figure 1000
        pixels wide, which `jaxcal.plot.save` writes and which a notebook shows as ``ax.figure``.

    Returns
    -------
    The Axes; an array of Axes, one for each sensor, where there are several.

    Raises
    ------
    DataError
        If there is nothing to draw, or the number of axes does not suit.

    Examples
    --------
    >>> import jaxcal
    >>> made = jaxcal.temperature.simulate(seed=1)
    >>> found = jaxcal.temperature.fit(made.temperature, made.bias, model="steps")
    >>> jaxcal.plot.temperature({"gyro_x": found}).get_ylabel()
    'Change of bias (°/h)'
    """
    groups: dict[str | None, dict[str, TemperatureFit]] = {}
    for name, fit in (result if isinstance(result, dict) else {"": result}).items():
        if not isinstance(fit, TemperatureFit):
            raise DataError(f"cannot draw {type(fit).__name__}; expected a TemperatureFit, or a dictionary channel -> these")
        sensor = str(name).partition("_")[0]
        groups.setdefault(sensor if sensor in _SENSORS else None, {})[str(name)] = fit
    if not groups:
        raise DataError("there is nothing to draw: the dictionary of results is empty")
    if ax is None:
        axes = list(new_figure(len(groups)).subplots(len(groups), 1, squeeze=False)[:, 0])
    else:
        axes = list(np.ravel(np.asarray(ax, dtype=object)))
        if len(axes) != len(groups):
            raise DataError(f"{len(axes)} axes for {len(groups)} sensors, each with a unit of its own; give one Axes for each, or none")
    for panel, (sensor, fits) in zip(axes, groups.items(), strict=True):
        _draw(panel, sensor, fits, own=ax is None)
    return axes[0] if len(axes) == 1 else np.array(axes, dtype=object)


def _draw(ax: "Axes", sensor: str | None, fits: dict[str, TemperatureFit], *, own: bool) -> None:
    scale, unit = display_unit("B", sensor)
    scale_factor = any(fit.model.scale for fit in fits.values())
    what = "Change of scale factor" if scale_factor else f"Change of bias ({unit or 'unit of the record'})"
    style_axes(ax, "Temperature (°C)", what)
    points, lines = [], []
    for i, (name, fit) in enumerate(fits.items()):
        color = SERIES[i % len(SERIES)]
        label = name if sensor is None else name.partition("_")[2]
        points.append(_points(ax, fit, scale, color))
        points[-1].set_label(key_text(label or "means over 0.1 °C"))
        lines.append(_curve(ax, fit, scale, color if len(fits) > 1 else INK))
        lines[-1].set_label(_described(fit, scale, unit))
    place_legend(ax, [points, lines], "" if sensor is None else _SENSORS[sensor], above=own, lines=True)


def _middle(fit: TemperatureFit) -> float:
    return float(np.asarray(fit.model.curve.value(np.asarray((fit.model.low + fit.model.high) / 2))))


def _points(ax: "Axes", fit: TemperatureFit, scale: float, color: str) -> Any:
    values = (np.asarray(fit.bins.b) - _middle(fit)) / scale
    return ax.plot(fit.bins.t, values, "o", markersize=2.6, color=color, markeredgewidth=0, alpha=0.6)[0]


def _curve(ax: "Axes", fit: TemperatureFit, scale: float, color: str) -> Any:
    t = np.linspace(float(fit.model.low), float(fit.model.high), _FINE)
    low, high = ((end - _middle(fit)) / scale for end in fit.interval_at(t))
    ax.fill_between(t, low, high, color=color, alpha=0.16, linewidth=0)
    for step in fit.steps:
        ax.axvline(step.centre, color=MUTED, linewidth=0.8, linestyle=":", zorder=0)
    return ax.plot(t, (np.asarray(fit.model.curve.value(t)) - _middle(fit)) / scale, color=color, linewidth=1.4)[0]


def _described(fit: TemperatureFit, scale: float, unit: str) -> str:
    """What the key says about a model: "steps, 300 at 24.50 °C; lag 60 s"."""
    words = [fit.kind if fit.degree is None or fit.steps else f"{fit.kind} {fit.degree}"]
    for step in fit.steps:
        value, half = abs(step.height) / scale, 1.96 * step.height_error / scale
        height = interval_labels(value, value - half, value + half)[0]
        sign = "" if step.height > 0 else "\u2212"
        words.append(f"{sign}{height} {unit} at {step.centre:.2f} °C".replace("  ", " "))
    if fit.model.lag > 0:
        words.append(f"lag {number_label(float(fit.model.lag), 3)} s")
    if fit.model.play > 0:
        words.append(f"play {number_label(float(fit.model.play), 2)} °C")
    return "; ".join(words)
