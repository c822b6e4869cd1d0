"""A common style for all figures: colours that colour-blind readers can separate, a light grid, readable numbers and units; `save`."""

import io
import math
import os
import pathlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from .._errors import DataError, ExportError
from .._files import write_atomically
from .._types import Checked
from .._units import noise_factor, noise_units, unit_label

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: axes to draw on
Drawing: TypeAlias = Checked["Axes | Sequence[Axes] | np.ndarray"]

INK = "#1b1f24"
MUTED = "#68707c"
GRID = "#e4e7eb"
SHADE = "#f1f3f5"

#: colours of channels, and of the terms of a noise model: Okabe and Ito's palette (jfly.uni-koeln.de/color) without yellow
SERIES = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")
TERM_COLORS = {"Q": "#cc79a7", "N": "#0072b2", "B": "#009e73", "K": "#d55e00", "R": "#e69f00"}
_TEXT = 10.0
MOST = 1000  # points of a curve, and stretches of a long one whose extremes are drawn: more than the eye can separate
SENSORS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
_SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def new_figure(height: float = 5.0) -> "Figure":
    """An empty figure, 1000 pixels wide and `height` inches high, with matplotlib's layout; it opens no window."""
    from matplotlib.figure import Figure

    return Figure(figsize=(8.0, height), dpi=125, layout="constrained")


def cannot_draw(found: Any, expected: str) -> DataError:
    """The error for something that a function of this package does not draw."""
    return DataError(f"cannot draw {type(found).__name__}; expected {expected}", code="not_a_result")


def stacked(ax: Any, count: int, height: float, meant: str) -> Any:
    """The given axes, (count,), or new ones below one another in a figure `height` inches high; `meant` describes them in an error."""
    axes = np.atleast_1d(np.asarray(new_figure(height).subplots(count, 1) if ax is None else ax, dtype=object)).ravel()
    if len(axes) != count:
        raise DataError(f"there are {len(axes)} Axes for {count} panels; give one {meant}", code="axes")
    return axes


def log_axes(ax: "Axes", x_label: str, y_label: str) -> None:
    """Make log-log axes with a light grid and readable numbers."""
    from matplotlib.ticker import FuncFormatter, NullFormatter

    ax.set_xscale("log")
    ax.set_yscale("log")
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(FuncFormatter(_tick))
        axis.set_minor_formatter(NullFormatter())
    style_axes(ax, x_label, y_label)


def style_axes(ax: "Axes", x_label: str, y_label: str, size: float = _TEXT) -> None:
    """Draw a light grid behind the data, and axes on the left and below, with labels of this size."""
    ax.set_axisbelow(True)
    ax.grid(True, which="major", color=GRID, linewidth=0.8)
    ax.tick_params(which="both", color=GRID, labelcolor=INK, labelsize=size - 1)
    ax.tick_params(which="minor", length=2)
    for side, spine in ax.spines.items():
        spine.set_visible(side in ("left", "bottom"))
        spine.set_color(MUTED)
        spine.set_linewidth(0.8)
    ax.set_xlabel(x_label, color=INK, fontsize=size)
    ax.set_ylabel(y_label, color=INK, fontsize=size)


def place_legend(ax: "Axes", columns: list[list[Any]], title: str, *, above: bool, lines: bool) -> None:
    """Place the legend, in columns: above the axes in jaxcal's own figures, where it covers nothing; inside axes given by the user.

    `lines` leaves room for samples of lines beside the points.
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


def text_only(text: str, **look: Any) -> Any:
    """A legend entry without a mark, or with a mark that no line of the figure has."""
    from matplotlib.lines import Line2D

    return Line2D([], [], label=text or " ", **{"linestyle": "none", **look})


def _tick(value: float, position: Any = None) -> str:
    if value <= 0:
        return ""
    exponent = math.floor(math.log10(value) + 1e-9)
    if -4 < exponent < 5:
        return f"{value:.{max(-exponent, 0)}f}"
    mantissa = value / 10.0**exponent
    lead = "" if abs(mantissa - 1) < 1e-6 else rf"{mantissa:.0f}\times"
    return f"${lead}10^{{{exponent}}}$"


def save(figure: Checked["Figure | Axes | np.ndarray"], path: str | os.PathLike[str], *, dpi: float | int = 150) -> None:
    """Write a figure to a file, in one step.

    Parameters
    ----------
    figure : a matplotlib Figure, an Axes, or an array of Axes as returned by `jaxcal.plot`.
    path : file to write; its extension sets the format (.png, .svg, .pdf, ...).
    dpi : pixels per inch, for pixel formats.

    Raises
    ------
    ExportError
        If the extension does not belong to an image format, or the file cannot be written.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import numpy as np
    >>> import jaxcal
    >>> deviation = jaxcal.allan.deviation(np.random.default_rng(0).normal(size=1000), 100.0)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "allan.png")
    ...     jaxcal.plot.save(jaxcal.plot.allan(deviation), path)
    ...     path.stat().st_size > 10_000
    True
    """
    first = np.ravel(np.asarray(figure, dtype=object))[0]
    drawn = first.figure if hasattr(first, "get_xlim") else first
    ending = pathlib.Path(path).suffix.lstrip(".").lower()
    known = drawn.canvas.get_supported_filetypes()
    if ending not in known:
        raise ExportError(f"cannot write {path}: {ending or 'no ending'} is no format; use .{', .'.join(sorted(known))}", code="ending")
    buffer = io.BytesIO()
    mark = {"png": "Software", "svg": "Creator", "pdf": "Creator"}  # the field of metadata by which jaxcal knows its own files
    drawn.savefig(buffer, format=ending, dpi=dpi, metadata={mark[ending]: "jaxcal"} if ending in mark else None)
    write_atomically(path, buffer.getvalue())


def interval_labels(value: float, low: float, high: float) -> tuple[str, str, str]:
    """A value and its interval, all three rounded to the first digit of the half width, with 2 to 4 digits of the value."""
    half = (high - low) / 2
    digits = 3
    if 0 < value < math.inf and 0 < half < math.inf:
        digits = min(max(_power(value) - _power(half) + 1, 2), 4)

    def like(end: float) -> str:
        """The limit with the decimals of the value."""
        return number_label(end, digits + _power(end) - _power(value)) if 0 < end < math.inf and value > 0 else number_label(end)

    return number_label(value, digits), like(low), like(high)


def _power(value: float) -> int:
    return math.floor(math.log10(value))


def number_label(value: float, digits: int = 3) -> str:
    """A number with `digits` significant digits, and a power of ten only if this saves zeros: 0.245, 1.8×10⁻⁷, 10000."""
    if not math.isfinite(value):
        return "∞" if value > 0 else "\u2013"
    if value == 0:
        return "0"
    digits = max(digits, 1)
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    exponent = int(power)
    if -4 < exponent < 5:
        return f"{float(f'{mantissa}e{exponent}'):.{max(digits - 1 - exponent, 0)}f}"
    return f"{mantissa}\u00d710{str(exponent).translate(_SUPERSCRIPT)}"


def display_unit(term: str, sensor: str | None) -> tuple[float, str]:
    """SI value and label of the unit in which a coefficient is shown; (1, "") for an unknown sensor."""
    if sensor is None:
        return 1.0, ""
    unit = noise_units(term, sensor)[0]
    return noise_factor(term, sensor, unit), unit_label(unit)


def duration_label(seconds: float) -> str:
    """A length of time in a convenient unit."""
    if not math.isfinite(seconds):
        return "∞"
    for size, name in ((86400.0 * 365.25, "years"), (86400.0, "days"), (3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{_brief(seconds / size)} {name}"
    return f"{_brief(seconds)} s"


def _brief(value: float) -> str:
    return f"{value:.0f}" if value >= 9.95 else f"{value:.2g}"
