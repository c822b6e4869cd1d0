"""Time-domain statistics of a record."""

from ._deviation import deviation as deviation
from ._dynamic import DynamicDeviation as DynamicDeviation, dynamic as dynamic
from ._result import Deviation as Deviation
from ._streaming._accumulator import Accumulator as Accumulator
