"""`allan`: deviation against cluster time, with the fitted model."""

from typing import TYPE_CHECKING, Any

import equinox as eqx
import numpy as np

from .._errors import DataError
from ..allan import Deviation
from ..noise import Noise, NoiseFit
from ._labels import display_unit, interval_labels, number_label
from ._style import (
    INK,
    MUTED,
    SERIES,
    SHADE,
    TERM_COLORS,
    arrange,
    key_text,
    log_axes,
    new_panels,
    place_legend,
    term_color,
    text_only,
    tick_decades,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
_KINDS = {
    "adev": "Allan deviation", "oadev": "Allan deviation", "mdev": "Modified Allan deviation", "tdev": "Time deviation",
    "hdev": "Hadamard deviation", "ohdev": "Hadamard deviation", "totdev": "Total deviation",
    "mtotdev": "Modified total deviation", "ttotdev": "Time total deviation", "htotdev": "Hadamard total deviation",
    "theo1": "Theo1 deviation", "mtie": "Maximum time interval error", "tierms": "RMS time interval error",
}  # fmt: skip
_MOST_POINTS = 400  # cluster sizes drawn; more cannot be told apart
_MODELLED = ("adev", "oadev", "totdev")  # statistics whose expectation is the Allan variance of the model


class _Channel(eqx.Module):
    """One curve to draw: `fit` is None where only the deviation is known."""

    name: str
    sensor: str | None
    deviation: Deviation
    fit: NoiseFit | None

    @property
    def label(self) -> str:
        """How the key calls it: the axis alone where the sensor is known."""
        return key_text(self.name if self.sensor is None else self.name.partition("_")[2])

    @property
    def scale(self) -> float:
        """SI value of the unit of the vertical axis: that of B, so that its plateau is read off."""
        return display_unit("B", self.sensor)[0]

    def points(self):
        """tau, deviation, lower, upper in the unit of the axis, and which sizes the fit used; those that a log axis can show."""
        d = self.deviation
        values = [np.asarray(v, dtype=np.float64) for v in (d.tau, d.deviation / self.scale, d.lower / self.scale, d.upper / self.scale)]
        used = np.ones(len(values[0]), dtype=bool) if self.fit is None else np.asarray(self.fit.used)
        keep = np.flatnonzero(np.isfinite(values[1]) & (values[1] > 0))
        if len(keep) > _MOST_POINTS:
            grid = np.geomspace(values[0][keep[0]], values[0][keep[-1]], _MOST_POINTS)
            keep = np.unique(keep[np.minimum(np.searchsorted(values[0][keep], grid), len(keep) - 1)])
        return (*(v[keep] for v in values), used[keep])

    def model(self, noise: Noise):
        """Cluster times and the deviation that a noise model gives there, in the unit of the axis."""
        d = self.deviation
        m = np.unique(np.round(np.geomspace(np.min(d.m), np.max(d.m), 160)))
        return m / d.rate, np.sqrt(np.asarray(noise.avar(m / d.rate, dt=1.0 / d.rate))) / self.scale


def allan(result: Any, ax: Any = None) -> Any:
    """Draw Allan deviations on log-log axes: points, chi-square interval, fitted model.

    The vertical axis is in the unit of the bias instability (gyroscope deg/h, accelerometer mg, magnetometer nT) where the name of
    the channel tells the sensor, and in the unit of the record otherwise. Hollow points and the shaded band were left out of the
    fit. A single fit is drawn with the lines of its terms, dotted where a term is only known by its upper limit.

    Parameters
    ----------
    result : a `Deviation`, a `NoiseFit`, or a dictionary channel -> either, such as `jaxcal.noise.characterise` returns.
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
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).normal(size=10_000)
    >>> ax = jaxcal.plot.allan({"gyro_x": jaxcal.allan.deviation(y, 100.0)})
    >>> ax.get_ylabel()
    'Allan deviation (°/h)'
    """
    groups = _groups(result)
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


def _groups(result: Any) -> list[list[_Channel]]:
    """Channels by sensor, in the order in which they come."""
    named = result if isinstance(result, dict) else {"": result}
    groups: dict[str | None, list[_Channel]] = {}
    for name, item in named.items():
        for channel in _channels(str(name), item):
            groups.setdefault(channel.sensor, []).append(channel)
    if not groups:
        raise DataError("there is nothing to draw: the dictionary of results is empty")
    return list(groups.values())


def _channels(name: str, item: Any) -> list[_Channel]:
    if not isinstance(item, (Deviation, NoiseFit)):
        raise DataError(f"cannot draw {type(item).__name__}; expected a Deviation, a NoiseFit, or a dictionary channel -> these")
    deviation = item.deviation if isinstance(item, NoiseFit) else item
    if np.ndim(deviation.deviation) == 2:
        count = deviation.deviation.shape[1]
        return [one for i in range(count) for one in _channels(f"{name} {i}".strip(), item.channel(i))]
    sensor = name.partition("_")[0]
    sensor = sensor if sensor in _SENSORS else None
    return [_Channel(name=name, sensor=sensor, deviation=deviation, fit=item if isinstance(item, NoiseFit) else None)]


def _draw(ax: "Axes", channels: list[_Channel], *, own: bool) -> None:
    sensor, deviation = channels[0].sensor, channels[0].deviation
    unit = (display_unit("B", sensor)[1] or "unit of the record") + (" s" if deviation.unit_of_phase else "")
    log_axes(ax, "Cluster time τ (s)", f"{_KINDS.get(deviation.kind, deviation.kind)} ({unit})")
    if len(channels) == 1:
        columns = _draw_one(ax, channels[0])
        title = " ".join(filter(None, (_SENSORS.get(sensor or ""), channels[0].label)))
    else:
        columns = _draw_several(ax, channels)
        title = "" if sensor is None else _SENSORS[sensor]
    _limit(ax, channels)
    _shade(ax, channels)
    tick_decades(ax)
    if not own:  # there is room for the marks alone
        columns = [[handle for column in columns for handle in column]] if len(channels) == 1 else columns[:1]
    place_legend(ax, columns, title, above=own, lines=len(channels) == 1)


def _draw_points(ax: "Axes", channel: _Channel, color: str, *, whole_interval: bool) -> Any:
    tau, deviation, lower, upper, used = channel.points()
    shown = used | whole_interval
    ax.fill_between(tau, lower, upper, where=shown, color=color, alpha=0.16, linewidth=0)
    hollow: dict[str, Any] = {"markerfacecolor": "none", "markeredgecolor": color, "markeredgewidth": 0.7, "alpha": 0.7}
    ax.plot(tau[~used], deviation[~used], "o", markersize=3.4, **hollow)
    return ax.plot(tau[used], deviation[used], "o", markersize=3.4, color=color, markeredgewidth=0)[0]


def _draw_model(ax: "Axes", channel: _Channel, noise: Noise, color: str) -> Any:
    """The whole curve thin and, inside the band of the fit, full."""
    tau, deviation = channel.model(noise)
    assert channel.fit is not None
    inside = (tau >= channel.fit.band[0] * (1 - 1e-9)) & (tau <= channel.fit.band[1] * (1 + 1e-9))
    ax.plot(tau, deviation, color=color, linewidth=0.8, alpha=0.6)
    return ax.plot(tau, np.where(inside, deviation, np.nan), color=color, linewidth=1.5)[0]


def _draw_one(ax: "Axes", channel: _Channel) -> list[list[Any]]:
    """One channel in ink, with the lines of its terms in colour; the columns of its key."""
    fit = channel.fit
    points = _draw_points(ax, channel, SERIES[0] if fit is None else INK, whole_interval=True)
    interval = "no interval known" if np.isnan(channel.deviation.lower).all() else f"{100 * channel.deviation.confidence:g} % interval"
    points.set_label(f"measured, {interval}")
    if fit is None or channel.deviation.kind not in _MODELLED:
        return [[points]]
    model = _draw_model(ax, channel, fit.noise, INK)
    model.set_label("fitted model")
    terms = [line for line in (_draw_term(ax, channel, term) for term in fit.terms) if line is not None]
    return [[points, model, *_left_out([channel], "left out of the fit")], terms]


def _draw_term(ax: "Axes", channel: _Channel, term: str) -> Any:
    """The line of one term, dotted at its upper limit where it was not detected."""
    fit = channel.fit
    assert fit is not None
    detected = fit.verdict.get(term) != "not detected"
    value = float(fit.noise.coefficient(term)) if detected else float(fit.upper_limit[term])
    if not (np.isfinite(value) and value > 0):
        return None
    tau, deviation = channel.model(fit.noise.only(term, value))
    line = ax.plot(tau, deviation, color=term_color(term), linewidth=1.3, linestyle="--" if detected else ":", zorder=1.5)[0]
    line.set_label(coefficient_label(term, fit, channel.sensor))
    return line


def coefficient_label(term: str, fit: NoiseFit, sensor: str | None) -> str:
    """A coefficient with its unit: "N = 0.245 °/√h", or "K < 1.8 °/h/√s" where it was not detected."""
    scale, unit = display_unit(term, sensor)
    if term not in fit.verdict:  # a method without uncertainty
        return f"{term} = {number_label(float(fit.noise.coefficient(term)) / scale)} {unit}".strip()
    value, low, high = (float(v) / scale for v in (fit.noise.coefficient(term), *fit.interval[term]))
    if fit.verdict[term] == "not detected":
        return f"{term} < {number_label(float(fit.upper_limit[term]) / scale, 2)} {unit}".strip()
    sign = "=" if fit.verdict[term] == "present" else "≈"
    return f"{term} {sign} {interval_labels(value, low, high)[0]} {unit}".strip()


def _draw_several(ax: "Axes", channels: list[_Channel]) -> list[list[Any]]:
    """Channels in a colour each; the key is a table of their coefficients."""
    names = []
    for i, channel in enumerate(channels):
        color = SERIES[i % len(SERIES)]
        names.append(_draw_points(ax, channel, color, whole_interval=channel.fit is None))
        names[-1].set_label(channel.label)
        if channel.fit is not None and channel.deviation.kind in _MODELLED:
            _draw_model(ax, channel, channel.fit.noise, color)
    fits = [channel.fit for channel in channels if channel.fit is not None]
    fitted = dict.fromkeys([*TERM_COLORS, *(term for fit in fits for term in fit.terms)])
    found = [term for term in fitted if any(term in fit.terms and fit.verdict.get(term) != "not detected" for fit in fits)]
    coefficients = ([text_only(_coefficient_of(channel, term)) for channel in channels] for term in found)
    return [[*names, *_left_out(channels, "left out")], *coefficients]


def _coefficient_of(channel: _Channel, term: str) -> str:
    if channel.fit is None or term not in channel.fit.terms:
        return ""
    return coefficient_label(term, channel.fit, channel.sensor)


def _left_out(channels: list[_Channel], label: str) -> list[Any]:
    """The entry of the key for hollow points, if there are any."""
    from matplotlib.lines import Line2D

    if all(np.all(channel.points()[4]) for channel in channels):
        return []
    look: dict[str, Any] = {"marker": "o", "markersize": 3.4, "markerfacecolor": "none", "markeredgecolor": MUTED, "linestyle": "none"}
    return [Line2D([], [], label=label, **look)]


def _limit(ax: "Axes", channels: list[_Channel]) -> None:
    """Limits from what is known within a factor of two; lines of single terms and wide intervals may leave the axes."""
    drawn = [np.array(channel.points()[:4]) for channel in channels]
    drawn = np.concatenate(drawn, axis=1)
    if drawn.size == 0:
        raise DataError("there is nothing to draw: no deviation is above zero; the record is constant")
    tau, values, lower, upper = drawn
    sure = (lower > values / 2) & (upper < values * 2)
    low, high = (lower[sure], upper[sure]) if np.any(sure) else (values, values)
    ax.set_xlim(tau.min() / 1.3, max(tau.max() * 1.3, tau.min() * 2))
    ax.set_ylim(low.min() / 1.6, high.max() * 1.6)


def _shade(ax: "Axes", channels: list[_Channel]) -> None:
    """Shade the cluster times that no fit used."""
    bands = np.array([[float(end) for end in channel.fit.band] for channel in channels if channel.fit is not None])
    if bands.size == 0:
        return
    taus = np.concatenate([channel.points()[0] for channel in channels])
    (low, high), shortest, longest = ax.get_xlim(), bands[:, 0].min(), bands[:, 1].max()
    for start, stop, there in ((low, shortest, taus < shortest * (1 - 1e-9)), (longest, high, taus > longest * (1 + 1e-9))):
        if np.any(there):
            ax.axvspan(start, stop, color=SHADE, linewidth=0, zorder=0)
