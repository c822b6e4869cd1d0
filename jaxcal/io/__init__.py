"""Read recordings in many formats into a `Log`."""

from ._flight import Flight as Flight, flight as flight
from ._inspect import Inspection as Inspection, inspect as inspect
from ._read import convert as convert, read as read
