"""Deviations of records that arrive in pieces: running sums that can be continued and merged."""
