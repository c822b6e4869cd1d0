"""Many logs, and logs larger than memory."""

from ._deviation import deviation as deviation, reduce as reduce
from ._fleet import Fleet as Fleet
from ._run import run as run
