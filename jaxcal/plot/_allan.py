"""`allan`: deviation against cluster time, with the fitted model."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from .._types import Given
from ..allan import Deviation
from ..noise import Noise, NoiseFit
from ._channels import ModelledChannel, draw_curves, draw_groups, finish
from ._style import INK, MOST, MUTED, SHADE, Drawing, cannot_draw, log_axes, text_only

if TYPE_CHECKING:
    from matplotlib.axes import Axes

KINDS = {
    "adev": "Allan deviation", "oadev": "Allan deviation", "mdev": "Modified Allan deviation", "tdev": "Time deviation",
    "hdev": "Hadamard deviation", "ohdev": "Hadamard deviation",
    "mtie": "Maximum time interval error", "tierms": "Time interval error, rms",
}  # fmt: skip
_MODELLED = ("adev", "oadev")  # statistics whose expectation is the Allan variance of the model


class _Channel(ModelledChannel):
    """One curve to draw; the model is None if only the deviation is known."""

    model: NoiseFit | None
    deviation: Deviation

    def points(self):
        """tau, deviation, lower, upper in the unit of the axis, and which sizes the fit used; only values that a log axis can show."""
        d, scale = self.deviation, self.unit[0]
        values = [np.asarray(v, dtype=np.float64) for v in (d.tau, d.deviation / scale, d.lower / scale, d.upper / scale)]
        used = np.ones(len(values[0]), dtype=bool) if self.model is None else np.asarray(self.model.used)
        keep = np.flatnonzero(np.isfinite(values[1]) & (values[1] > 0))
        if len(keep) > MOST:
            grid = np.geomspace(values[0][keep[0]], values[0][keep[-1]], MOST)
            keep = np.unique(keep[np.minimum(np.searchsorted(values[0][keep], grid), len(keep) - 1)])
        return (*(v[keep] for v in values), used[keep])

    def curve(self, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
        d = self.deviation
        m = np.unique(np.round(np.geomspace(np.min(d.m), np.max(d.m), 160)))
        return m / d.rate, np.sqrt(np.asarray(noise.avar(m / d.rate, dt=1.0 / d.rate))) / self.unit[0]

    def draw_values(self, ax: "Axes", color: str, *, alone: bool) -> Any:
        """Draw the interval and the points, which are hollow if the fit did not use them."""
        tau, deviation, lower, upper, used = self.points()
        ax.fill_between(tau, lower, upper, where=used | alone | (self.model is None), color=color, alpha=0.16, linewidth=0)
        hollow: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": color, "markeredgewidth": 0.7, "alpha": 0.7}
        ax.plot(tau[~used], deviation[~used], "o", markersize=3.4, **hollow)
        label = f"measured, {100 * self.deviation.confidence:g} % interval"
        return ax.plot(tau[used], deviation[used], "o", markersize=3.4, color=color, markeredgewidth=0, label=label)[0]

    def draw_model(self, ax: "Axes", color: str) -> list[Any]:
        """Draw the whole curve thin and, inside the band of the fit, thick; nothing if the model does not predict the statistic."""
        fit = self.model
        if fit is None or self.deviation.kind not in _MODELLED:
            return []
        tau, deviation = self.curve(fit.noise)
        inside = (tau >= fit.band[0] * (1 - 1e-9)) & (tau <= fit.band[1] * (1 + 1e-9))
        ax.plot(tau, deviation, color=color, linewidth=0.8, alpha=0.6)
        return ax.plot(tau, np.where(inside, deviation, np.nan), color=color, linewidth=1.5, label="fitted model")

    def draw_terms(self, ax: "Axes") -> list[Any]:
        return self.term_lines(ax, () if self.model is None else self.model.terms, zorder=1.5)  # behind the points


def allan(result: Given, ax: Drawing | None = None) -> Any:
    """Draw Allan deviations on log-log axes: points, chi-square interval, fitted model.

    The vertical axis is in the unit of the bias instability (gyroscope deg/h, accelerometer mg, magnetometer nT) if the name of the
    channel tells the sensor, and in the unit of the record otherwise. The fit left out hollow points and the shaded band. A single fit is
    drawn with a line for each term, dotted if only an upper limit of the term is known.

    Parameters
    ----------
    result : a `Deviation`, a `NoiseFit`, or a dictionary channel -> either, such as the result of `jaxcal.noise.characterise`.
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
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).normal(size=10_000)
    >>> ax = jaxcal.plot.allan({"gyro_x": jaxcal.allan.deviation(y, 100.0)})
    >>> ax.get_ylabel()
    'Allan deviation (°/h)'
    """
    named = result if isinstance(result, Mapping) else {"": result}
    return draw_groups([channel for name, item in named.items() for channel in _channels(str(name), item)], ax, _draw)


def _channels(name: str, item: Any) -> list[_Channel]:
    if not isinstance(item, (Deviation, NoiseFit)):
        raise cannot_draw(item, "a Deviation, a NoiseFit, or a dictionary channel -> these")
    deviation = item.deviation if isinstance(item, NoiseFit) else item
    if np.ndim(deviation.deviation) == 2:
        count = deviation.deviation.shape[1]
        return [one for i in range(count) for one in _channels(f"{name} {i}".strip(), item.channel(i))]
    return [_Channel(name, item if isinstance(item, NoiseFit) else None, deviation)]


def _draw(ax: "Axes", channels: list[_Channel], *, own: bool) -> None:
    deviation = channels[0].deviation
    unit = (channels[0].unit[1] or "unit of the record") + (" s" if deviation.unit_of_phase else "")
    if channels[0].name.startswith("clock_"):  # fractions of the frequency
        unit = "s" if deviation.unit_of_phase else "1"
    log_axes(ax, "Cluster time τ (s)", f"{KINDS.get(deviation.kind, deviation.kind)} ({unit})")
    columns = draw_curves(ax, channels, beneath=INK)
    if not all(np.all(channel.points()[4]) for channel in channels):
        look: dict[str, Any] = {"marker": "o", "markersize": 3.4, "markerfacecolor": "none", "markeredgecolor": MUTED}
        columns[0].append(text_only("left out of the fit" if len(channels) == 1 else "left out", **look))
    _limit(ax, channels)
    _shade(ax, channels)
    finish(ax, channels, columns, own=own)


def _limit(ax: "Axes", channels: list[_Channel]) -> None:
    """Set limits from values known within a factor of two; lines of single terms and wide intervals may leave the axes."""
    tau, values, lower, upper = np.concatenate([np.array(channel.points()[:4]) for channel in channels], axis=1)
    if tau.size == 0:
        raise DataError("there is nothing to draw: no deviation is above zero; the record is constant", code="nothing")
    sure = (lower > values / 2) & (upper < values * 2)
    low, high = (lower[sure], upper[sure]) if np.any(sure) else (values, values)
    ax.set_xlim(tau.min() / 1.3, max(tau.max() * 1.3, tau.min() * 2))
    ax.set_ylim(min(low.min(), values.min()) / 1.6, max(high.max(), values.max()) * 1.6)


def _shade(ax: "Axes", channels: list[_Channel]) -> None:
    """Shade the cluster times that no fit used."""
    bands = np.array([[float(end) for end in channel.model.band] for channel in channels if channel.model is not None])
    if bands.size == 0:
        return
    taus = np.concatenate([channel.points()[0] for channel in channels])
    (low, high), shortest, longest = ax.get_xlim(), bands[:, 0].min(), bands[:, 1].max()
    for start, stop, there in ((low, shortest, taus < shortest * (1 - 1e-9)), (longest, high, taus > longest * (1 + 1e-9))):
        if np.any(there):
            ax.axvspan(start, stop, color=SHADE, linewidth=0, zorder=0)
