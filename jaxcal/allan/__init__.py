"""Time-domain statistics of a record."""

from ._deviation import deviation as deviation
from ._result import Deviation as Deviation
