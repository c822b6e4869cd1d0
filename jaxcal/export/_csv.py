"""Write a calibration as a table with one row per number."""

import csv
import io
import math
from typing import Any

from .._answer._sections import flat
from .._errors import ExportError
from ..calibration import Calibration
from ..calibration._show import sections_of
from ._findings import FINDINGS
from ._options import Product


def write_csv(calibration: Calibration, options: Any) -> Product:
    """Write every number that the calibration prints, in SI, with the limits of its 95 % interval where it is known."""
    rows = list(flat(sections_of(calibration)))
    if not rows:
        raise ExportError("the calibration holds no numbers", code="no_part")
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(rows[0])
    table.writerows(["" if isinstance(cell, float) and not math.isfinite(cell) else cell for cell in row.values()] for row in rows)
    return Product(text.getvalue(), [] if calibration.temperature is None else [FINDINGS("models_left_out")])
