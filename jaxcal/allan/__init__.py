"""Time-domain statistics of a record: Allan deviation and its relatives."""

from ._accumulator import Accumulator as Accumulator
from ._deviation import deviation as deviation
from ._kinds import cluster_sizes as cluster_sizes
from ._result import Deviation as Deviation, Deviations as Deviations
from ._uncertainty._edf import degrees_of_freedom as degrees_of_freedom
