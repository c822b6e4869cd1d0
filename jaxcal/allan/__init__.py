"""Time-domain statistics of a record."""

from ._accumulator import Accumulator as Accumulator
from ._deviation import deviation as deviation
from ._dynamic import DynamicDeviation as DynamicDeviation, dynamic as dynamic
from ._result import Deviation as Deviation
