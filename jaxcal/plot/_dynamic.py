"""`dynamic`: a deviation over time and cluster time, as colours."""

from typing import TYPE_CHECKING, Any

import numpy as np

from .._errors import DataError
from ..allan import DynamicDeviation
from ._allan import KINDS
from ._style import INK, MUTED, SHADE, color_bar, duration_label, log_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_COLORS = "viridis"  # even in lightness, also for colour-blind readers and in greyscale


def dynamic(result: Any, ax: Any = None) -> Any:
    """Draw a dynamic Allan deviation: time to the right, cluster time upwards, the deviation as colour on a logarithmic scale.

    Grey areas mean that a gap leaves no difference. A vertical edge between two colours is a change of the sensor; a horizontal one is the
    slope of the Allan deviation.

    Parameters
    ----------
    result : a `DynamicDeviation` of one channel; pick one of several with ``result.channel(0)``.
    ax : matplotlib Axes to draw on; None makes a figure 1000 pixels wide, which `jaxcal.plot.save` writes.

    Returns
    -------
    The Axes.

    Raises
    ------
    DataError
        If the result does not have a single channel, or no deviation is above zero.

    Examples
    --------
    >>> import numpy as np
    >>> import jaxcal
    >>> y = np.random.default_rng(0).normal(size=20_000)
    >>> ax = jaxcal.plot.dynamic(jaxcal.allan.dynamic(y, 100.0, window=20.0))
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('Time (s)', 'Cluster time τ (s)')
    """
    if not isinstance(result, DynamicDeviation):
        raise DataError(f"cannot draw {type(result).__name__}; expected a DynamicDeviation, as jaxcal.allan.dynamic returns it")
    if result.deviation.ndim != 2:
        raise DataError(f"the deviation has {result.deviation.shape[2]} channels, which need axes each; pick one with result.channel(0)")
    order = np.argsort(result.tau, kind="stable")
    tau, values = np.asarray(result.tau)[order], np.asarray(result.deviation)[:, order].T
    shown = np.ma.masked_where(~(values > 0), values)  # also masks NaN
    if shown.count() == 0:
        raise DataError("there is nothing to draw: no deviation is above zero; the record is constant")
    ax = new_figure().subplots() if ax is None else ax
    _draw(ax, result, tau, shown)
    return ax


def _draw(ax: "Axes", result: DynamicDeviation, tau: np.ndarray, shown: Any) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator, ScalarFormatter

    log_axes(ax, "Time (s)", "Cluster time τ (s)")
    formatter = ax.yaxis.get_major_formatter()
    low, high = float(shown.min()), float(shown.max())
    # a constant surface needs an artificial range of colours
    norm = LogNorm(low / 1.05, high * 1.05) if low == high else LogNorm(low, high)
    time = _edges(np.asarray(result.time), result.window)
    ax.set_facecolor(SHADE)
    ax.grid(False)
    image = ax.pcolormesh(time, np.exp(_edges(np.log(tau), 1.0)), shown, norm=norm, cmap=_COLORS, rasterized=True)
    ax.set_xscale("linear")
    ax.xaxis.set_major_formatter(ScalarFormatter())
    ax.set_xlim(time[0], time[-1])
    ax.xaxis.set_major_locator(MaxNLocator(8))
    ax.xaxis.set_minor_locator(NullLocator())
    ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if tau[-1] / tau[0] < 1000 else (1.0,), numticks=12))
    unit = "unit of the record" + (" s" if result.kind == "tdev" else "")
    bar = color_bar(ax, image, f"{KINDS[result.kind]} ({unit})")
    bar.ax.yaxis.set_major_formatter(formatter)
    if high / low < 30:
        bar.ax.yaxis.set_minor_formatter(formatter)
    bar.ax.tick_params(which="both", color=MUTED, labelcolor=INK, labelsize=9)
    ax.set_title(f"Windows of {duration_label(result.window)}", loc="left", color=INK, fontsize=11, fontweight="bold")


def _edges(centres: np.ndarray, alone: float) -> np.ndarray:
    """Borders of cells: half way between centres, and as far beyond the first and last one; `alone` is the width of a single cell."""
    if len(centres) == 1:
        return np.array([centres[0] - alone / 2, centres[0] + alone / 2])
    middle = (centres[1:] + centres[:-1]) / 2
    return np.concatenate([[2 * centres[0] - middle[0]], middle, [2 * centres[-1] - middle[-1]]])
