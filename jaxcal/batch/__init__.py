"""Many logs, and logs larger than memory."""

from ._components import Components as Components, components as components, gauge as gauge
from ._deviation import deviation as deviation, reduce as reduce
from ._fleet import (
    Coefficient as Coefficient,
    Entry as Entry,
    Fleet as Fleet,
    Outlier as Outlier,
    Spread as Spread,
    Trend as Trend,
)
from ._line import Line as Line, line as line
from ._pooled import pool as pool
from ._population import Population as Population, population as population
from ._run import run as run
