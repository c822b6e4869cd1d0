"""Readers: logs in, `Log` out."""

from ._read import convert as convert, read as read
