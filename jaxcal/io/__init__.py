"""Read recordings in many formats into a `Log`."""

from ._inspect import Inspection as Inspection, inspect as inspect
from ._read import convert as convert, read as read
