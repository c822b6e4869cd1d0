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
_FURTHER = ("#56b4e9", "#8c564b", "#7f7f7f")


def term_color(term: str) -> str:
    """Colour of the line of a term; a term of one's own has one that its name decides."""
    return TERM_COLORS.get(term) or _FURTHER[sum(map(ord, term)) % len(_FURTHER)]


_TEXT = 10.0
_PAD = 0.06  # inches around what is drawn


def new_figure(panels: int) -> "Figure":
    """An empty figure, 1000 pixels wide, for panels below one another, laid out by matplotlib; it belongs to no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(8.0, 5.0 * panels), dpi=125, layout="constrained")


def new_panels(count: int) -> list["Axes"]:
    """Axes below one another in a figure of their own; `arrange` places them when all is drawn."""
    figure = new_figure(count)
    figure.set_layout_engine("none")
    return list(figure.subplots(count, 1, squeeze=False)[:, 0])


def arrange(panels: list["Axes"]) -> None:
    """Give each panel of `new_panels` what its labels and the key above it leave.

    One look at the texts: matplotlib's constrained layout, in every file that is written, costs more than the drawing itself.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = panels[0].get_figure(root=True)
    assert figure is not None  # that of new_panels
    renderer = FigureCanvasAgg(figure).get_renderer()
    (width, height), pad = figure.bbox.size, _PAD * figure.dpi
    across, up = ([_extent(axis, renderer) for axis in axes] for axes in ([ax.xaxis for ax in panels], [ax.yaxis for ax in panels]))
    left = max(ax.bbox.x0 - box.x0 for ax, box in zip(panels, up, strict=True)) + pad
    right = max(max(box.x1 - ax.bbox.x1, 0.0) for ax, box in zip(panels, across, strict=True)) + pad
    for i, (ax, box) in enumerate(zip(panels, across, strict=True)):
        key = ax.get_legend()
        above = 0.0 if key is None else key.get_window_extent(renderer).height
        bottom = height * (len(panels) - 1 - i) / len(panels) + ax.bbox.y0 - box.y0 + pad
        top = height * (len(panels) - i) / len(panels) - above - 2 * pad
        ax.set_position((left / width, bottom / height, (width - left - right) / width, (top - bottom) / height))


def _extent(axis: Any, renderer: Any) -> Any:
    """Box around the labels of one axis, in pixels."""
    box = axis.get_tightbbox(renderer)
    assert box is not None  # an axis of ours is never hidden
    return box


def log_axes(ax: "Axes", x_label: str, y_label: str) -> None:
    """Log-log axes with a light grid and numbers as people write them."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(FuncFormatter(_tick))
        axis.set_minor_formatter(NullFormatter())
    style_axes(ax, x_label, y_label)


def style_axes(ax: "Axes", x_label: str, y_label: str) -> None:
    """A light grid behind the data, axes left and below, named."""
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
    """Ticks for the limits that the axes have: powers of ten, with 2 and 5 or small ticks between them."""
    from matplotlib.ticker import LogLocator, NullLocator

    for axis, (low, high) in ((ax.xaxis, ax.get_xlim()), (ax.yaxis, ax.get_ylim())):
        decades = math.log10(high / low)
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if decades < 3.2 else (1.0,), numticks=12))
        # a tick is the dearest thing to draw: none that tells no more
        axis.set_minor_locator(LogLocator(subs=tuple(range(2, 10)), numticks=12) if 3.2 <= decades < 8 else NullLocator())


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
