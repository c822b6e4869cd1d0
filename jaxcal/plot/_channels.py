"""Channels of several sensors, each sensor on its own axes: shared by `allan`, `spectrum` and `temperature`."""

import abc
import itertools
import math
from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ..noise import Noise, NoiseFit
from ._style import INK, SENSORS, SERIES, TERM_COLORS, display_unit, interval_labels, new_figure, number_label, place_legend, text_only

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_FURTHER = ("#56b4e9", "#8c564b", "#7f7f7f")  # for the user's own terms
_PAD = 0.06  # inches around the drawing


class Channel(eqx.Module):
    """One curve to draw; its name tells the sensor if it begins with one."""

    name: str

    @property
    def sensor(self) -> str | None:
        """Sensor that the channel belongs to: gyro_x -> gyro."""
        sensor = self.name.partition("_")[0]
        return sensor if sensor in SENSORS else None

    @property
    def label(self) -> str:
        """Name in the legend: only the axis if the sensor is known. No "$" may start a formula, and no leading underscore may hide it."""
        name = (self.name if self.sensor is None else self.name.partition("_")[2]).replace("$", r"\$")
        return f" {name}" if name.startswith("_") else name

    @property
    def unit(self) -> tuple[float, str]:
        """SI value and label of the unit of the bias instability, so that the plateau of an Allan deviation can be read directly."""
        return display_unit("B", self.sensor)


class ModelledChannel(Channel):
    """One curve to draw, with a model on top of it: a `Noise`, a `NoiseFit` or None."""

    model: Noise | NoiseFit | None

    @property
    def noise(self) -> Noise | None:
        """The model without its uncertainty."""
        return self.model.noise if isinstance(self.model, NoiseFit) else self.model

    def coefficient(self, term: str) -> tuple[float, str, str]:
        """Value, line style and label of a term, such as "N = 0.245 °/√h"; value 0 if the model does not have the term.

        For a term that was not detected, the upper limit with a dotted line: "K < 1.8 °/h/√s".
        """
        fit, noise = self.model if isinstance(self.model, NoiseFit) else None, self.noise
        if noise is None or term not in ([name for name, _, _ in noise.parts] if fit is None else fit.terms):
            return 0.0, "", ""
        scale, unit = display_unit(term, self.sensor)
        value, presence = float(noise.coefficient(term)), None if fit is None else fit.presence.get(term)
        if fit is None or presence is None:  # a method without uncertainty
            words = f"= {number_label(value / scale)}"
        elif presence == "not detected":
            value = float(fit.upper_limit[term])
            if not np.isfinite(value):
                return 0.0, "", ""
            words = f"< {number_label(value / scale, 2)}"
        else:
            words = "= " if presence == "present" else "≈ "
            words += interval_labels(value / scale, *(float(end) / scale for end in fit.interval[term]))[0]
        return value, ":" if presence == "not detected" else "--", f"{term} {words} {unit}".strip()

    def term_lines(self, ax: "Axes", terms: Iterable[str], **look: Any) -> list[Any]:
        """Draw a line for every term, dotted at the upper limit of a term that was not detected."""
        lines = []
        for term in terms:
            value, style, label = self.coefficient(term)
            if self.noise is not None and 0 < value < np.inf:
                color = TERM_COLORS.get(term) or _FURTHER[sum(map(ord, term)) % len(_FURTHER)]
                lines += ax.plot(
                    *self.curve(self.noise.only(term, value)), color=color, linewidth=1.3, linestyle=style, label=label, **look
                )
        return lines

    @abc.abstractmethod
    def curve(self, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """Points of the line of a noise model, in the units of the axes."""

    @abc.abstractmethod
    def draw_values(self, ax: "Axes", color: str, *, alone: bool) -> Any:
        """Draw the measured values with their interval; returns the legend handle, whose label names the interval."""

    @abc.abstractmethod
    def draw_model(self, ax: "Axes", color: str) -> list[Any]:
        """Draw the model if there is one; returns its legend handle."""

    @abc.abstractmethod
    def draw_terms(self, ax: "Axes") -> list[Any]:
        """Draw the lines of the terms of the model; returns their legend handles."""


def term_names(channels: Sequence[ModelledChannel]) -> list[str]:
    """The letters of the terms, and the names of all user's terms in the models."""
    models = [channel.noise for channel in channels if channel.noise is not None]
    return list(dict.fromkeys([*TERM_COLORS, *(term.name for noise in models for _, term in noise.further)]))


def draw_curves(ax: "Axes", channels: Sequence[ModelledChannel], beneath: str) -> list[list[Any]]:
    """Draw channels, and return the columns of their legend.

    A single channel is drawn in the colour `beneath`, under its model in ink, with coloured lines for its terms. Several channels have a
    colour each, and their legend is a table with the coefficients of every term that was found in any of them.
    """
    if len(channels) == 1:
        values = channels[0].draw_values(ax, SERIES[0] if channels[0].model is None else beneath, alone=True)
        model = channels[0].draw_model(ax, INK)
        return [[values, *model], channels[0].draw_terms(ax) if model else []]
    names = []
    for channel, color in zip(channels, itertools.cycle(SERIES)):
        names.append(channel.draw_values(ax, color, alone=False))
        names[-1].set_label(channel.label)
        channel.draw_model(ax, color)
    rows = [[channel.coefficient(term) for channel in channels] for term in term_names(channels)]
    shown = [row for row in rows if any(value > 0 and style == "--" for value, style, _ in row)]
    return [names, *([text_only(label) for _, _, label in row] for row in shown)]


def draw_groups(channels: Sequence[Any], ax: Any, draw: Callable[..., None], key: Callable[[Any], Any] = lambda one: one.sensor) -> Any:
    """Draw the channels by sensor (`key`), with `draw(axes, channels, own=...)`, on the given axes or on new ones below one another.

    Returns the Axes, or an array of Axes for several groups.
    """
    groups: dict[Any, list[Any]] = {}
    for channel in channels:
        groups.setdefault(key(channel), []).append(channel)
    if not groups:
        raise DataError("there is nothing to draw: the dictionary of results is empty", code="nothing")
    own = ax is None
    if own:
        figure = new_figure(5.0 * len(groups))
        figure.set_layout_engine("none")
        ax = figure.subplots(len(groups), 1)
    axes = list(np.ravel(np.asarray(ax, dtype=object)))
    if len(axes) != len(groups):
        raise DataError(f"{len(axes)} axes for {len(groups)} sensors with units of their own; give one for each, or none", code="axes")
    for panel, group in zip(axes, groups.values(), strict=True):
        draw(panel, group, own=own)
    if own:
        _arrange(axes)
    return axes[0] if len(axes) == 1 else np.array(axes, dtype=object)


def finish(ax: "Axes", channels: Sequence[Channel], columns: list[list[Any]], *, own: bool) -> None:
    """Set the ticks of log axes, and the legend from its columns; axes of the user have room for the first column only."""
    _tick_decades(ax)
    title, single = SENSORS.get(channels[0].sensor or "", ""), len(channels) == 1
    if single:
        title = " ".join(filter(None, (title, channels[0].label)))
    if not own:
        columns = [[handle for column in columns for handle in column]] if single else columns[:1]
    place_legend(ax, columns, title, above=own, lines=single)


def _tick_decades(ax: "Axes") -> None:
    """Set ticks for the limits of the axes: powers of ten, with 2 and 5 or small ticks between them."""
    from matplotlib.ticker import LogLocator, NullLocator

    for axis, (low, high) in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
        decades = math.log10(high / low)
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 3.2 else (1.0,), numticks=12))
        # ticks take the most time to draw, so omit those that tell nothing more
        axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=12) if 3.2 <= decades < 8 else NullLocator())


def _arrange(panels: list[Any]) -> None:
    """Arrange the panels of a figure without a layout, so that labels and the legend above each panel fit.

    Each text is measured once: matplotlib's constrained layout costs more than the drawing itself, in every file that is written.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = panels[0].figure
    renderer = FigureCanvasAgg(figure).get_renderer()
    (width, height), pad = figure.bbox.size, _PAD * figure.dpi
    across, up = ([axis.get_tightbbox(renderer) for axis in axes] for axes in ([ax.xaxis for ax in panels], [ax.yaxis for ax in panels]))
    left = max(ax.bbox.x0 - box.x0 for ax, box in zip(panels, up, strict=True)) + pad
    right = max(max(box.x1 - ax.bbox.x1, 0.0) for ax, box in zip(panels, across, strict=True)) + pad
    for i, (ax, box) in enumerate(zip(panels, across, strict=True)):
        key = ax.get_legend()
        above = 0.0 if key is None else key.get_window_extent(renderer).height
        bottom = height * (len(panels) - 1 - i) / len(panels) + ax.bbox.y0 - box.y0 + pad
        top = height * (len(panels) - i) / len(panels) - above - 2 * pad
        ax.set_position((left / width, bottom / height, (width - left - right) / width, (top - bottom) / height))
