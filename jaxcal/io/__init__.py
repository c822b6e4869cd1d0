"""Readers: logs in, `Log` out."""

from ._inspect import Inspection as Inspection, inspect as inspect
from ._read import convert as convert, read as read
