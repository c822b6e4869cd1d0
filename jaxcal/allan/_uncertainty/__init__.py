"""Degrees of freedom, intervals and bias factors of the variances, by noise type."""
