"""Readers: logs in, `Log` out."""

from ._convert import convert as convert
from ._read import read as read
