"""Calibration on board: sums of fixed size, and the gate that admits readings to them."""
