"""The rotation that field magnitudes cannot show: alignment with another sensor, joint fits, rates."""
