"""Deviations of records that come in pieces: running sums that can be continued and merged."""
