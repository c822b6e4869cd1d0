"""`spectrum`: power spectral density against frequency, with the noise model."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from .._types import Given
from ..noise import Noise, NoiseFit
from ..spectrum import Spectrum
from ._channels import ModelledChannel, draw_curves, draw_groups, finish, term_names
from ._style import MOST, Drawing, cannot_draw, log_axes, number_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_VALUES = "#8b949e"  # colour of values under a model, which is drawn in ink
_MARKOV_COLOR = "#56b4e9"


class _Channel(ModelledChannel):
    """One curve to draw, with a model on top of it."""

    spectrum: Spectrum

    def points(self) -> np.ndarray:
        """Rows frequency, density, lower, upper in the unit of the axis; only values that a log axis can show."""
        s, scale = self.spectrum, self.unit[0] ** 2  # the unit of the axis is the square of the unit of B, per Hz
        rows = np.stack([np.asarray(s.frequency), *(np.asarray(v) / scale for v in (s.density, s.lower, s.upper))])
        rows = rows[:, np.isfinite(rows[1]) & (rows[1] > 0)]
        if rows.shape[1] <= 2 * MOST:
            return rows
        # keep lines and dips visible: of values that the eye cannot separate, draw the lowest and the highest
        edges = np.searchsorted(rows[0], np.geomspace(rows[0, 0], rows[0, -1], MOST + 1)[1:-1])
        parts = [(a, rows[1, a:b]) for a, b in zip([0, *edges], [*edges, rows.shape[1]], strict=True) if b > a]
        chosen = {a + int(pick) for a, part in parts for pick in (part.argmin(), part.argmax())}
        return rows[:, sorted(chosen | {0, rows.shape[1] - 1})]

    def curve(self, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        s = self.spectrum
        f = np.geomspace(np.min(s.frequency), np.max(s.frequency), 300)
        return f, np.asarray(noise.psd(f, dt=1.0 / s.rate)) * (2.0 if s.sided == 1 else 1.0) / self.unit[0] ** 2

    def draw_values(self, ax: "Axes", color: str, *, alone: bool) -> Any:
        """Draw the interval, and points, or a line if there are many."""
        frequency, density, lower, upper = self.points()
        ax.fill_between(frequency, lower, upper, color=color, alpha=0.16 if alone else 0.1, linewidth=0)
        many = len(frequency) > MOST
        look: dict[str, Any] = {"linewidth": 0.8} if many else {"marker": "o", "linestyle": "none", "markersize": 3.0, "markeredgewidth": 0}
        return ax.plot(frequency, density, color=color, label=f"measured, {100 * self.spectrum.confidence:g} % interval", **look)[0]

    def draw_model(self, ax: "Axes", color: str) -> list[Any]:
        name = "fitted model" if isinstance(self.model, NoiseFit) else "noise model"
        return [] if self.noise is None else ax.plot(*self.curve(self.noise), color=color, linewidth=1.8, label=name)

    def draw_terms(self, ax: "Axes") -> list[Any]:
        """Draw terms and Gauss-Markov processes; a ramp has no density."""
        lines = self.term_lines(ax, [term for term in term_names([self]) if term != "R"])
        for pair in () if self.noise is None else self.noise.markov:
            label = f"Gauss-Markov, {number_label(float(pair[1]))} s"
            lines += ax.plot(*self.curve(Noise(markov=(pair,))), color=_MARKOV_COLOR, linewidth=1.3, linestyle="--", label=label)
        return lines


def spectrum(result: Given, ax: Drawing | None = None, noise: Given | None = None) -> Any:
    """Draw power spectral densities on log-log axes: density, chi-square interval, noise model.

    The vertical axis is in the squared unit of the bias instability per Hz (gyroscope deg/h, accelerometer mg, magnetometer nT) if the
    name of the channel tells the sensor, and in the record's unit otherwise. The model is drawn with its exact density for samples. A
    single channel is drawn with a line for each term of the model, dotted if only an upper limit of the term is known. Of many values at
    nearly the same frequency, the lowest and the highest are drawn.

    Parameters
    ----------
    result : a `Spectrum`, or a dictionary channel -> `Spectrum`.
    ax : matplotlib Axes to draw on; for a dictionary with several sensors an array with one for each. None makes a figure 1000
        pixels wide; `jaxcal.plot.save` writes it, and a notebook shows it as ``ax.figure``.
    noise : a `Noise` or `NoiseFit` to draw on top, or a dictionary channel -> either, as `jaxcal.noise.characterise` returns.

    Returns
    -------
    The Axes; for several sensors an array of Axes, one for each.

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
    named = result if isinstance(result, Mapping) else {"": result}
    models = noise if isinstance(noise, Mapping) else dict.fromkeys(named, noise)
    channels = [channel for name, item in named.items() for channel in _channels(str(name), item, models.get(name))]
    if channels and models and not set(models) & set(named):
        raise DataError(f"noise names none of the channels drawn: it has {', '.join(map(str, models))}", code="channels")
    return draw_groups(channels, ax, _draw, key=lambda channel: (channel.sensor, channel.spectrum.sided))


def _channels(name: str, item: Any, model: Any) -> list[_Channel]:
    if not isinstance(item, Spectrum):
        raise cannot_draw(item, "a Spectrum, or a dictionary channel -> Spectrum")
    if not (model is None or isinstance(model, (Noise, NoiseFit))):
        raise DataError(f"noise must be a Noise, a NoiseFit, or a dictionary channel -> these; got {type(model).__name__}", code="noise")
    if np.ndim(item.density) == 2:
        common = isinstance(model, NoiseFit) and np.ndim(model.goodness) == 0  # a model of this kind has no channels
        models = [model if model is None or common else model.channel(i) for i in range(item.density.shape[1])]
        return [one for i, own in enumerate(models) for one in _channels(f"{name} {i}".strip(), item.channel(i), own)]
    return [_Channel(name, model, item)]


def _draw(ax: "Axes", channels: list[_Channel], *, own: bool) -> None:
    unit = channels[0].unit[1] or "unit of the record"
    unit = f"({unit})" if set(unit) & set("/ ") else unit
    sided = "One" if channels[0].spectrum.sided == 1 else "Two"
    log_axes(ax, "Frequency (Hz)", f"{sided}-sided power spectral density, {unit}²/Hz")
    columns = draw_curves(ax, channels, beneath=_VALUES)
    _limit(ax, channels)
    finish(ax, channels, columns, own=own)


def _limit(ax: "Axes", channels: list[_Channel]) -> None:
    """Set limits from the values, except for the deepest dips; wide intervals and lines of single terms may leave the axes."""
    frequency, density = np.concatenate([channel.points()[:2] for channel in channels], axis=1)
    if density.size == 0:
        raise DataError("there is nothing to draw: no density is above zero", code="nothing")
    every = np.concatenate([np.asarray(channel.spectrum.density) / channel.unit[0] ** 2 for channel in channels])
    low, high = float(np.quantile(every[every > 0], 0.02)), float(density.max())
    ax.set(xlim=(frequency.min() / 1.2, max(frequency.max() * 1.2, frequency.min() * 2)), ylim=(low / 1.8, high * 1.8))
