"""Time-domain statistics of a record."""

from ._result import Deviation as Deviation
