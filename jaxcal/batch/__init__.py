"""Many logs, and logs larger than memory."""

from ._coefficients import Coefficient as Coefficient
from ._deviation import deviation as deviation
from ._fleet import Entry as Entry, Fleet as Fleet
from ._merge import reduce as reduce
from ._run import run as run
from ._spread import Outlier as Outlier, Spread as Spread, Trend as Trend
