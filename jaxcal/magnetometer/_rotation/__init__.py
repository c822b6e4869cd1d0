"""The rotation that norms cannot show: alignment with another sensor, joint fits, rates."""
