"""Sums for the deviations: phase from rates, squared differences by blocks or correlations, statistics of whole stretches."""
