"""Degrees of freedom and intervals of the variances, by noise type."""
