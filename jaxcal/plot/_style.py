"""One look for every figure: colours that colour-blind readers tell apart, light grid, plain numbers on log axes."""

import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INK = "#1b1f24"
MUTED = "#68707c"
GRID = "#e4e7eb"
SHADE = "#f1f3f5"

#: channels, and the terms of a noise model: Okabe and Ito's palette (jfly.uni-koeln.de/color), yellow left out
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
TERM_COLORS = {"Q": "#cc79a7", "N": "#0072b2", "B": "#009e73", "K": "#d55e00", "R": "#e69f00"}

_TEXT = 10.0


def new_figure(panels: int) -> "Figure":
    """An empty figure, 1000 pixels wide, for panels below one another; it belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(8.0, 5.0 * panels), dpi=125, layout="constrained")


def style_axes(ax: "Axes", x_label: str, y_label: str) -> None:
    """Log-log axes with a light grid and numbers as people write them."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(FuncFormatter(_tick))
        axis.set_minor_formatter(NullFormatter())
    ax.set_axisbelow(True)
    ax.grid(True, which="major", color=GRID, linewidth=0.8)
    ax.tick_params(which="both", color=GRID, labelcolor=INK, labelsize=_TEXT - 1)
    ax.tick_params(which="minor", length=2)
    for side, spine in ax.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(MUTED)
        spine.set_linewidth(0.8)
    ax.set_xlabel(x_label, color=INK, fontsize=_TEXT)
    ax.set_ylabel(y_label, color=INK, fontsize=_TEXT)


def tick_decades(ax: "Axes") -> None:
    """Ticks for the limits that the axes have: powers of ten, with 2 and 5 between them where there are few."""
    from matplotlib.ticker import LogLocator

    for axis, (low, high) in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
        decades = math.log10(high / low)
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 3.2 else (1.0,), numticks=12))
        axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=12) if decades < 8 else LogLocator(subs=(1.0,)))


def place_legend(ax: "Axes", columns: list[list[Any]], title: str, *, above: bool, lines: bool) -> None:
    """The key, in columns: above the axes in a figure of our own, where it covers nothing; inside axes that belong to the user.

    `lines` makes room for samples of lines beside the points.
    """
    columns = [column for column in columns if column]
    rows = max(len(column) for column in columns)
    handles = [handle for column in columns for handle in column + [text_only("")] * (rows - len(column))]
    place: dict[str, Any] = {"loc": "lower left", "bbox_to_anchor": (0.0, 1.0), "frameon": False, "borderaxespad": 0.2}
    if not above:
        place = {"loc": "best", "frameon": True, "framealpha": 0.85, "edgecolor": "none"}
    legend = ax.legend(
        handles=handles, ncols=len(columns), title=title or None, alignment="left", fontsize=_TEXT - 1, labelcolor=INK,
        handlelength=1.8 if lines else 0.5, handletextpad=0.6, columnspacing=0.8 if lines else 1.0, labelspacing=0.35, **place,
    )  # fmt: skip
    legend.get_title().set(fontsize=_TEXT + 1, fontweight="bold", color=INK)


def key_text(name: str) -> str:
    """A name as matplotlib shows it: no formulas, and not hidden for a leading underscore."""
    name = name.replace("$", r"\$")
    return f" {name}" if name.startswith("_") else name


def text_only(text: str) -> Any:
    """An entry of the key without a mark."""
    from matplotlib.lines import Line2D

    return Line2D([], [], linestyle="none", label=text or " ")


def _tick(value: float, position: Any = None) -> str:
    if value <= 0:
        return ""
    exponent = math.floor(math.log10(value) + 1e-9)
    if -4 < exponent < 5:
        return f"{value:.{max(-exponent, 0)}f}"
    mantissa = value / 10.0**exponent
    lead = "" if abs(mantissa - 1) < 1e-6 else rf"{mantissa:.0f}\times"
    return f"${lead}10^{{{exponent}}}$"
