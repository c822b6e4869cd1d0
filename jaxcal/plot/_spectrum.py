"""`spectrum`: power spectral density against frequency, with the noise model."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ..noise import Noise, NoiseFit
from ..spectrum import Spectrum
from ._allan import coefficient_label
from ._labels import display_unit, number_label
from ._style import INK, SERIES, TERM_COLORS, arrange, key_text, log_axes, new_panels, place_legend, term_color, text_only, tick_decades

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
_MOST_POINTS = 600  # drawn as points; more are drawn as a line
_MOST_COLUMNS = 1000  # stretches of the frequency axis; of each the lowest and the highest value is drawn
_VALUES = "#8b949e"  # under a model, which is drawn in ink
_MARKOV_COLOR = "#56b4e9"


class _Channel(eqx.Module):
    """One curve to draw, and the model on top of it: a `Noise`, a `NoiseFit` or None."""

    name: str
    sensor: str | None
    spectrum: Spectrum
    model: Noise | NoiseFit | None

    @property
    def label(self) -> str:
        """How the key calls it: the axis alone where the sensor is known."""
        return key_text(self.name if self.sensor is None else self.name.partition("_")[2])

    @property
    def noise(self) -> Noise | None:
        """The model without its uncertainty."""
        return self.model.noise if isinstance(self.model, NoiseFit) else self.model

    @property
    def scale(self) -> float:
        """SI value of the unit of the vertical axis: the square of that of B, per Hz."""
        return display_unit("B", self.sensor)[0] ** 2

    def points(self) -> np.ndarray:
        """Rows frequency, density, lower, upper in the unit of the axis, of values that a log axis can show."""
        s = self.spectrum
        rows = np.stack([np.asarray(s.frequency), *(np.asarray(v) / self.scale for v in (s.density, s.lower, s.upper))])
        rows = rows[:, np.isfinite(rows[1]) & (rows[1] > 0)]
        if rows.shape[1] <= 2 * _MOST_COLUMNS:
            return rows
        # lines and dips stay to be seen: what cannot be told apart is drawn from its lowest to its highest value
        edges = np.searchsorted(rows[0], np.geomspace(rows[0, 0], rows[0, -1], _MOST_COLUMNS + 1)[1:-1])
        parts = [(a, rows[1, a:b]) for a, b in zip([0, *edges], [*edges, rows.shape[1]], strict=True) if b > a]
        chosen = {a + int(pick) for a, part in parts for pick in (part.argmin(), part.argmax())}
        return rows[:, sorted(chosen | {0, rows.shape[1] - 1})]

    def curve(self, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        """Frequencies, and the density that a noise model gives there to samples, in the unit of the axis."""
        s = self.spectrum
        f = np.geomspace(np.min(s.frequency), np.max(s.frequency), 300)
        return f, np.asarray(noise.psd(f, dt=1.0 / s.rate)) * (2.0 if s.sided == 1 else 1.0) / self.scale


def spectrum(result: Any, ax: Any = None, noise: Any = None) -> Any:
    """Draw power spectral densities on log-log axes: density, chi-square interval, noise model.

    The vertical axis is in the squared unit of the bias instability per Hz (gyroscope deg/h, accelerometer mg, magnetometer nT) where
    the name of the channel tells the sensor, and in that of the record otherwise. The model is its exact density for samples. A
    single channel is drawn with the lines of the model's terms, dotted where a term is only known by its upper limit. Of many
    values at nearly one frequency the lowest and the highest are drawn.

    Parameters
    ----------
    result : a `Spectrum`, or a dictionary channel -> `Spectrum`.
    ax : matplotlib Axes to draw on; for a dictionary with several sensors an array with one for each. None makes a figure 1000
        pixels wide, which `jaxcal.plot.save` writes and which a notebook shows as ``ax.figure``.
    noise : a `Noise` or `NoiseFit` to draw on top, or a dictionary channel -> either, as `jaxcal.noise.characterise` returns.

    Returns
    -------
    The Axes; an array of Axes, one for each sensor, where there are several.

    Raises
    ------
    DataError
        If there is nothing to draw, or the number of axes or the noise does not suit.

    Examples
    --------
    >>> import jaxcal
    >>> gyro = jaxcal.noise.Noise(N=1e-4, K=1e-5)
    >>> y = gyro.simulate(10_000, rate=100.0, seed=0)
    >>> ax = jaxcal.plot.spectrum({"gyro_x": jaxcal.spectrum.density(y, 100.0, method="dct")}, noise=gyro)
    >>> ax.get_ylabel()
    'Two-sided power spectral density, (°/h)²/Hz'
    """
    groups = _groups(result, noise)
    if ax is None:
        axes = new_panels(len(groups))
    else:
        axes = list(np.ravel(np.asarray(ax, dtype=object)))
        if len(axes) != len(groups):
            raise DataError(f"{len(axes)} axes for {len(groups)} sensors, each with a unit of its own; give one Axes for each, or none")
    for panel, channels in zip(axes, groups, strict=True):
        _draw(panel, channels, own=ax is None)
    if ax is None:
        arrange(axes)
    return axes[0] if len(axes) == 1 else np.array(axes, dtype=object)


def _groups(result: Any, noise: Any) -> list[list[_Channel]]:
    """Channels by sensor, in the order in which they come."""
    named = result if isinstance(result, dict) else {"": result}
    groups: dict[Any, list[_Channel]] = {}
    for name, item in named.items():
        model = noise.get(name) if isinstance(noise, dict) else noise
        for channel in _channels(str(name), item, model):
            groups.setdefault((channel.sensor, channel.spectrum.sided), []).append(channel)
    if not groups:
        raise DataError("there is nothing to draw: the dictionary of results is empty")
    if isinstance(noise, dict) and noise and not set(noise) & set(named):
        raise DataError(f"noise names none of the channels drawn: it has {', '.join(map(str, noise))}")
    return list(groups.values())


def _channels(name: str, item: Any, model: Any) -> list[_Channel]:
    if not isinstance(item, Spectrum):
        raise DataError(f"cannot draw {type(item).__name__}; expected a Spectrum, or a dictionary channel -> Spectrum")
    if not (model is None or isinstance(model, (Noise, NoiseFit))):
        raise DataError(f"noise must be a Noise, a NoiseFit, or a dictionary channel -> these; got {type(model).__name__}")
    if np.ndim(item.density) == 2:
        found = []
        for i in range(item.density.shape[1]):
            found += _channels(f"{name} {i}".strip(), item.channel(i), _model_of(model, i))
        return found
    sensor = name.partition("_")[0]
    return [_Channel(name=name, sensor=sensor if sensor in _SENSORS else None, spectrum=item, model=model)]


def _model_of(model: Noise | NoiseFit | None, index: int) -> Noise | NoiseFit | None:
    """What belongs to one channel of a spectrum: the same for all where the model knows no channels."""
    if model is None or (isinstance(model, NoiseFit) and np.ndim(model.goodness) == 0):
        return model
    return model.channel(index)


def _draw(ax: "Axes", channels: list[_Channel], *, own: bool) -> None:
    sensor, sided = channels[0].sensor, channels[0].spectrum.sided
    unit = display_unit("B", sensor)[1] or "unit of the record"
    unit = f"({unit})" if set(unit) & set("/ ") else unit
    log_axes(ax, "Frequency (Hz)", f"{'One' if sided == 1 else 'Two'}-sided power spectral density, {unit}²/Hz")
    if len(channels) == 1:
        columns = _draw_one(ax, channels[0])
        title = " ".join(filter(None, (_SENSORS.get(sensor or ""), channels[0].label)))
    else:
        columns = _draw_several(ax, channels)
        title = "" if sensor is None else _SENSORS[sensor]
    _limit(ax, channels)
    tick_decades(ax)
    if not own:  # there is room for the marks alone
        columns = [[handle for column in columns for handle in column]] if len(channels) == 1 else columns[:1]
    place_legend(ax, columns, title, above=own, lines=len(channels) == 1)


def _draw_values(ax: "Axes", channel: _Channel, color: str, shade: float = 0.16) -> Any:
    frequency, density, lower, upper = channel.points()
    ax.fill_between(frequency, lower, upper, color=color, alpha=shade, linewidth=0)
    if len(frequency) > _MOST_POINTS:
        return ax.plot(frequency, density, color=color, linewidth=0.8)[0]
    return ax.plot(frequency, density, "o", markersize=3.0, color=color, markeredgewidth=0)[0]


def _draw_one(ax: "Axes", channel: _Channel) -> list[list[Any]]:
    """One channel, with the model in ink and the lines of its terms in colour; the columns of its key."""
    values = _draw_values(ax, channel, SERIES[0] if channel.noise is None else _VALUES)
    values.set_label(f"measured, {100 * channel.spectrum.confidence:g} % interval")
    if channel.noise is None:
        return [[values]]
    model = ax.plot(*channel.curve(channel.noise), color=INK, linewidth=1.8)[0]
    model.set_label("fitted model" if isinstance(channel.model, NoiseFit) else "noise model")
    return [[values, model], _draw_terms(ax, channel)]


def _draw_terms(ax: "Axes", channel: _Channel) -> list[Any]:
    """A line for every term that has a density, dotted at the upper limit of one that was not detected."""
    noise, lines = channel.noise, []
    assert noise is not None
    for term in _terms([channel]):
        value, style, label = _coefficient(channel, term)
        if term == "R" or not (np.isfinite(value) and value > 0):
            continue
        lines += ax.plot(*channel.curve(noise.only(term, value)), color=term_color(term), linewidth=1.3, linestyle=style, label=label)
    for pair in noise.markov:
        label = f"Gauss-Markov, {number_label(float(pair[1]))} s"
        lines += ax.plot(*channel.curve(Noise(markov=(pair,))), color=_MARKOV_COLOR, linewidth=1.3, linestyle="--", label=label)
    return lines


def _terms(channels: list[_Channel]) -> list[str]:
    """Letters, and terms of one's own that any of the models has."""
    return list(dict.fromkeys([*TERM_COLORS, *(term.name for channel in channels if channel.noise for _, term in channel.noise.further)]))


def _coefficient(channel: _Channel, term: str) -> tuple[float, str, str]:
    """Value, line style and label of a term; value 0 where the model does not have it."""
    fit, noise = channel.model, channel.noise
    if isinstance(fit, NoiseFit):
        if term not in fit.terms:
            return 0.0, "", ""
        absent = fit.verdict.get(term) == "not detected"
        value = float(fit.upper_limit[term] if absent else fit.noise.coefficient(term))
        return value, ":" if absent else "--", coefficient_label(term, fit, channel.sensor)
    assert noise is not None
    value = float(noise.coefficient(term))
    scale, unit = display_unit(term, channel.sensor)
    return value, "--", f"{term} = {number_label(value / scale)} {unit}".strip()


def _draw_several(ax: "Axes", channels: list[_Channel]) -> list[list[Any]]:
    """Channels in a colour each; the key is a table of the coefficients of their models."""
    names = []
    for i, channel in enumerate(channels):
        color = SERIES[i % len(SERIES)]
        names.append(_draw_values(ax, channel, color, shade=0.1))
        names[-1].set_label(channel.label)
        if channel.noise is not None:
            ax.plot(*channel.curve(channel.noise), color=color, linewidth=1.8)
    found = [[_coefficient(channel, term) if channel.model else (0.0, "", "") for channel in channels] for term in _terms(channels)]
    shown = (row for row in found if any(value > 0 and style == "--" for value, style, _ in row))
    return [names, *([text_only(label) for _, _, label in row] for row in shown)]


def _limit(ax: "Axes", channels: list[_Channel]) -> None:
    """Limits from the values, but for the deepest dips; wide intervals and lines of single terms may leave the axes."""
    frequency, density = np.concatenate([channel.points()[:2] for channel in channels], axis=1)
    if density.size == 0:
        raise DataError("there is nothing to draw: no density is above zero")
    every = np.concatenate([np.asarray(channel.spectrum.density) / channel.scale for channel in channels])
    low, high = float(np.quantile(every[every > 0], 0.02)), float(density.max())
    ax.set_xlim(frequency.min() / 1.2, max(frequency.max() * 1.2, frequency.min() * 2))
    ax.set_ylim(low / 1.8, high * 1.8)
