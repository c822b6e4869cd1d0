"""`save`: a figure as a file."""

import io
import os
import pathlib
from typing import TYPE_CHECKING, Any

from .._errors import ExportError
from .._files import write_atomically

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save(figure: Any, path: str | os.PathLike[str], *, dpi: float | int = 150) -> None:
    """Write a figure to a file, in one step.

    Parameters
    ----------
    figure : a matplotlib Figure, an Axes, or an array of Axes as `jaxcal.plot` returns them.
    path : file to write; its ending chooses the format (.png, .svg, .pdf, ...).
    dpi : pixels per inch of formats made of pixels.

    Raises
    ------
    ExportError
        If the ending is not that of an image format, or the file cannot be written.

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
    drawn = figure_of(figure)
    ending = pathlib.Path(path).suffix.lstrip(".").lower()
    known = drawn.canvas.get_supported_filetypes()
    if ending not in known:
        raise ExportError(f"cannot write {path}: {ending or 'no ending'} is not an image format; use one of .{', .'.join(sorted(known))}")
    buffer = io.BytesIO()
    drawn.savefig(buffer, format=ending, dpi=dpi)
    write_atomically(path, buffer.getvalue())


def figure_of(figure: Any) -> "Figure":
    """The figure that something drawn belongs to."""
    import numpy as np

    first = np.ravel(np.asarray(figure, dtype=object))[0]
    return first.figure if hasattr(first, "get_xlim") else first
