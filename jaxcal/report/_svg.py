"""Small static SVG figures for pages without script and on paper, in the colours and fonts of the page."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..plot._style import number_label
from ._html import Markup, join, tag

#: size of a figure and its margins: small, so that text is readable on a phone
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _TOP, _BOTTOM = 480, 310, 82, 14, 12, 44
#: ratio of width to height of the plotting area
ASPECT = (_WIDTH - _LEFT - _RIGHT) / (_HEIGHT - _TOP - _BOTTOM)


class Axis(NamedTuple):
    """An axis: label with unit, limits, and whether it is logarithmic."""

    label: str
    low: float
    high: float
    log: bool = True

    def at(self, values: Any) -> np.ndarray:
        """Positions of values on the axis, from 0 to 1."""
        low, high, values = self.low, self.high, np.asarray(values, dtype=float)
        if self.log:
            low, high = math.log(low), math.log(high)
            with np.errstate(divide="ignore", invalid="ignore"):
                values = np.log(values)
        return (values - low) / (high - low)

    def ticks(self) -> list[float]:
        """Values to label: powers of ten (with 2 and 5 in between on a short axis), or round steps on a linear axis."""
        if not self.log:
            raw = (self.high - self.low) / 5
            size = 10.0 ** math.floor(math.log10(raw))
            step = next(size * k for k in (1, 2, 5, 10) if size * k >= raw)
            return [k * step for k in range(math.ceil(self.low / step), math.floor(self.high / step) + 1)]
        first, last = math.floor(math.log10(self.low)), math.ceil(math.log10(self.high))
        parts = (1, 2, 5) if self.high / self.low < 300 else (1,)
        every = max((last - first) // 7, 1)
        found = [part * 10.0**power for power in range(first, last + 1, every) for part in parts]
        return [value for value in found if self.low * (1 - 1e-9) <= value <= self.high * (1 + 1e-9)]


class Mark(NamedTuple):
    """Something to draw: a "line", "dots", or a "band" between y and `top`, or inside of the points if there is no `top`.

    `color` is a number, or the name of a CSS class; `log` is the name of the log that it belongs to, and `link` the address of its result.
    """

    kind: str
    x: Any
    y: Any
    color: int | str = 0
    top: Any = None
    look: str = ""
    log: str = ""
    link: str | None = None


def log_axis(label: str, values: Iterable[Any], pad: float = 1.3) -> Axis:
    """Make a logarithmic axis for all positive values."""
    found = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in values])
    found = found[np.isfinite(found) & (found > 0)]
    return Axis(label, float(found.min()) / pad, float(found.max()) * pad) if len(found) else Axis(label, 0.1, 10.0)


def linear_axis(label: str, values: Iterable[Any], pad: float = 0.05) -> Axis:
    """Make a linear axis for all finite values."""
    found = np.concatenate([np.ravel(np.asarray(part, dtype=float)) for part in values])
    found = found[np.isfinite(found)]
    low, high = (float(found.min()), float(found.max())) if len(found) else (0.0, 1.0)
    room = pad * (high - low) or max(abs(high), 1e-30) * 0.1
    return Axis(label, low - room, high + room, False)


def figure(
    prefix: str, title: str, about: str, x: Axis, y: Axis, marks: Sequence[Mark], names: Sequence[str] = (),
    letters: Sequence[tuple[str, Any, Any]] = (),
) -> Markup:  # fmt: skip
    """Make a figure with its caption; `names` label the colours in the key. With `letters` and their places it has no other axes."""
    placed = (
        tag("text", word, x=f"{_across(x, [a])[0]:.1f}", y=f"{_up(y, [b])[0] + 4:.1f}", text_anchor="middle") for word, a, b in letters
    )
    back = join(placed) if letters else _grid(x, y)
    parts = [tag("title", title, id=f"{prefix}-title"), tag("desc", about, id=f"{prefix}-desc"), back]
    clip = f"{prefix}-clip"
    box = tag("rect", x=_LEFT, y=_TOP, width=_WIDTH - _LEFT - _RIGHT, height=_HEIGHT - _TOP - _BOTTOM)
    parts.append(tag("clipPath", box, id=clip))
    parts.append(tag("g", *(_drawn(x, y, mark) for mark in marks), clip_path=f"url(#{clip})"))
    svg = tag(
        "svg", *parts, viewBox=f"0 0 {_WIDTH} {_HEIGHT}", role="img", aria_labelledby=f"{prefix}-title", aria_describedby=f"{prefix}-desc"
    )  # fmt: skip
    key = [tag("span", tag("i", "", class_=f"c{i % 6}"), f" {name}") for i, name in enumerate(names) if name]
    heading = tag("p", tag("b", title), *(piece for one in key for piece in (" ", one)), class_="key")
    return tag("figure", heading, tag("div", svg, class_="scroll", tabindex="0", role="region", aria_label=title),
               tag("figcaption", about), class_="drawn")  # fmt: skip


def _grid(x: Axis, y: Axis) -> Markup:
    right, bottom = _WIDTH - _RIGHT, _HEIGHT - _BOTTOM
    lines, letters = [], []
    for value in x.ticks():
        (at,) = _across(x, [value])
        lines.append(f"M{at:.1f} {_TOP}V{bottom}")
        letters.append(tag("text", _tick(value), x=f"{at:.1f}", y=bottom + 17, text_anchor="middle"))
    for value in y.ticks():
        (at,) = _up(y, [value])
        lines.append(f"M{_LEFT} {at:.1f}H{right}")
        letters.append(tag("text", _tick(value), x=_LEFT - 6, y=f"{at + 4:.1f}", text_anchor="end"))
    middle = (_TOP + bottom) / 2
    letters.append(tag("text", x.label, x=(_LEFT + right) / 2, y=_HEIGHT - 8, text_anchor="middle"))
    letters.append(tag("text", y.label, x=0, y=0, text_anchor="middle", transform=f"translate(14 {middle}) rotate(-90)"))
    frame = tag("path", d=f"M{_LEFT} {_TOP}V{bottom}H{right}", class_="frame")
    return join((tag("path", d="".join(lines), class_="grid"), frame, *letters))


def _tick(value: float) -> str:
    """Format a number without superfluous zeros: 0.5, 10⁻⁵."""
    if value == 0:
        return "0"
    power = math.floor(math.log10(abs(value)) + 1e-9)
    if -4 < power < 5:
        return f"{value:.6g}"
    mantissa, ten = f"{value / 10.0**power:.3g}", number_label(10.0**power, 1)[2:]
    return ten if mantissa == "1" else f"{mantissa}\u00d7{ten}"


def _across(x: Axis, values: Any) -> np.ndarray:
    return _LEFT + x.at(values) * (_WIDTH - _LEFT - _RIGHT)


def _up(y: Axis, values: Any) -> np.ndarray:
    # clip values far outside the figure, which would only add digits
    return _HEIGHT - _BOTTOM - np.clip(y.at(values), -1.0, 2.0) * (_HEIGHT - _TOP - _BOTTOM)


def _drawn(x: Axis, y: Axis, mark: Mark) -> Markup:
    color = f"c{mark.color % 6}" if isinstance(mark.color, int) else mark.color
    across, up = _across(x, mark.x), _up(y, mark.y)
    known = np.isfinite(across) & np.isfinite(up)
    if mark.kind == "dots":
        path = "".join(f"M{a:.1f} {b:.1f}h0" for a, b in zip(across[known], up[known], strict=True))
        return tag("path", d=path, class_=f"dots {mark.look} {color}".replace("  ", " "))
    if mark.kind == "band":
        top = up[:0] if mark.top is None else _up(y, mark.top)
        known &= mark.top is None or np.isfinite(top)
        there, back = (list(zip(across[known], edge[known], strict=True)) if len(edge) else [] for edge in (up, top))
        if not there:
            return Markup("")
        return tag("path", d=_path([*there, *back[::-1]]) + "Z", class_=f"band {mark.look} {color}".replace("  ", " "))
    pieces = np.split(np.arange(len(across)), np.flatnonzero(~known))
    runs = [[(across[i], up[i]) for i in piece if known[i]] for piece in pieces]
    line = tag("path", d="".join(_path(run) for run in runs if len(run) > 1), class_=f"line {mark.look} {color}".replace("  ", " "))
    return tag("a", tag("title", mark.log), line, href=mark.link, data_log=mark.log) if mark.log else line


def _path(points: Sequence[tuple[Any, Any]]) -> str:
    """A line in steps of a tenth, relative to the point before, since that is shortest; rounded before, so that no error adds up."""
    tenths = np.rint(10.0 * np.asarray(points, dtype=float)).astype(int)
    steps = (f"{_brief(a)} {_brief(b)}" for a, b in np.diff(tenths, axis=0).tolist())
    return f"M{_brief(int(tenths[0, 0]))} {_brief(int(tenths[0, 1]))}l" + " ".join(steps).replace(" -", "-")


def _brief(tenths: int) -> str:
    whole, part = divmod(abs(int(tenths)), 10)
    return "-" * int(tenths < 0) + (f"{whole or ''}.{part}" if part else f"{whole}")
