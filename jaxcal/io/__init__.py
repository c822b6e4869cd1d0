"""Readers: logs in, `Log` out."""

from ._read import read as read
